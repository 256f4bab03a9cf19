"""Gyros under any name, encoders that begin again, clocks that count loops, and set points as commands."""

from dataclasses import replace

import numpy as np
import pytest

from ballbot.errors import InputError
from ballbot.log import Log
from ballbot.log.formats import read_foreign_table
from ballbot.log.mapping_inference.command_conclusions import possible_commands
from ballbot.log.mapping_inference.conclusions import conclusions_of
from ballbot.log.mapping_inference.counted_time import seconds_of_a_count
from ballbot.log.mapping_inference.gyro_columns import with_gyro
from ballbot.log.mapping_inference.proposal import propose
from ballbot.log.mapping_inference.recognition import Recognised, recognise
from ballbot.log.mapping_inference.report import evaluate, mapping_text
from ballbot.log.mapping_inference.roles import Roles, roles_by_name
from ballbot.log.mapping_inference.time_units import time_conclusion, time_scale
from ballbot.log.mapping_inference.wrapped_encoders import wrapped_encoders
from tests.support.foreign_log_examples import (
    POLL,
    Habits,
    columns_of,
    small_robot,
    swaying_log,
    write_foreign,
)

Table = dict[str, np.ndarray]


def with_rates(*names: str) -> Table:
    """Return a foreign log in degrees with a gyro in deg/s under these names."""
    columns = columns_of(swaying_log(), Habits())
    t = columns["t_now"]
    for name, angle in zip(names, ("theta_x", "theta_y", "theta_z"), strict=True):
        columns[name] = np.gradient(np.convolve(columns[angle], np.full(5, 0.2), mode="same"), t)
    return columns


def recognised(tmp_path, columns: Table) -> Recognised:
    path = write_foreign(tmp_path / "run.txt", columns, Habits())
    return recognise(path, read_foreign_table(path), small_robot())


@pytest.mark.parametrize(
    "names",
    [
        ("p", "q", "r"),
        ("p_dps", "q_dps", "r_dps"),
        ("gx_mdps", "gy_mdps", "gz_mdps"),
        ("alpha", "beta", "gamma"),
        ("bodyrate1", "bodyrate2", "bodyrate3"),
    ],
)
def test_a_gyro_is_found_under_any_name(tmp_path, names):
    assert recognised(tmp_path, with_rates(*names)).roles.gyro == names


def test_a_gyro_is_found_beside_columns_that_only_their_values_show(tmp_path):
    columns = with_rates("wx", "wy", "wz")
    others = {"psi_1": "Strecke1", "psi_2": "Strecke2", "psi_3": "Strecke3"}
    found = recognised(tmp_path, {others.get(name, name): values for name, values in columns.items()})
    assert found.by_data
    assert found.roles.gyro == ("wx", "wy", "wz")


@pytest.mark.parametrize("turn", [360.0, 2.0 * np.pi])
def test_a_gyro_is_found_beside_a_yaw_that_jumps_and_without_a_yaw(tmp_path, turn):
    columns = with_rates("a", "b", "c")
    unit = 1.0 if turn == 360.0 else np.pi / 180.0
    columns |= {"theta_z": np.mod(columns["theta_z"] * unit, turn)}
    assert recognised(tmp_path, columns).roles.gyro == ("a", "b", "c")
    del columns["theta_z"]
    before = {"x9": np.cos(columns["t_now"]), **{name: columns.pop(name) for name in "abc"}}
    assert recognised(tmp_path, {**columns, **before}).roles.gyro == ("a", "b", "c")


def test_columns_that_do_not_follow_the_lean_are_no_gyro(tmp_path):
    columns = columns_of(swaying_log(), Habits())
    random = np.random.default_rng(5)
    columns |= {name: random.standard_normal(len(columns["t_now"])) for name in ("a1", "a2", "a3")}
    assert recognised(tmp_path, columns).roles.gyro == ()


def test_columns_that_are_plainly_something_else_are_no_wheels_though_they_look_like_some(tmp_path):
    columns = columns_of(swaying_log(), Habits())
    names = {f"psi_{i}": f"axle_{i}" for i in "123"}
    fields = {f"mag_{axis}": 0.9 * columns[f"psi_{i}"] for i, axis in zip("123", "xyz", strict=True)}
    renamed = {names.get(name, name): values for name, values in columns.items()}
    found = recognised(tmp_path, {"t_now": renamed.pop("t_now"), **fields, **renamed})
    assert found.roles.angles == ("axle_1", "axle_2", "axle_3")
    assert not found.roles.alternatives


def test_a_gyro_that_lacks_an_axis_is_named(tmp_path):
    columns = with_rates("gyro_x", "gyro_y", "gyro_z")
    del columns["gyro_y"]
    found = recognised(tmp_path, columns)
    assert found.roles.gyro == ()
    assert any(
        "gyro_x, gyro_z look like columns of a gyro and are not used" in one for one in found.table.notes
    )


def test_roles_with_a_gyro_keep_it():
    named = roles_by_name(with_rates("gyro_x", "gyro_y", "gyro_z"), wheel_count=3)
    assert with_gyro(named, {})[0] is named


def absolute(counts: int, *, start: int = 100) -> Table:
    """Return a foreign log with absolute encoders on the wheels."""
    columns = columns_of(swaying_log(), Habits())
    for k in (1, 2, 3):
        turned = columns.pop(f"psi_{k}")
        columns[f"as5600_{k}"] = np.mod(np.round(turned * counts / (2.0 * np.pi)) + start, counts)
    return columns


def test_absolute_encoders_are_continued_and_have_their_own_counts_a_turn(tmp_path):
    columns, robot = absolute(4096), small_robot()
    path = write_foreign(tmp_path / "run.txt", columns, Habits())
    found = propose(path, robot, dead_band=0.0)
    assert found.roles.wrap == 4096.0
    assert found.wheel.description == "counts, 4096 a turn"
    assert any("begin again after 4096 counts" in one for one in found.table.notes)
    (tmp_path / "mapping.toml").write_text(
        mapping_text(found, robot, file=path).replace("complete = false", "")
    )
    log, truth = Log.read(path, mapping=tmp_path / "mapping.toml"), swaying_log()
    for k in (1, 2, 3):
        true = np.interp(log.t, truth.t, truth[f"wheel{k}"])
        # one row of rolling: the host's rows are up to 5 ms old
        np.testing.assert_allclose(log[f"wheel{k}"] - log[f"wheel{k}"][0], true - true[0], atol=0.15)


@pytest.mark.parametrize("bits", [8, 12, 16])
@pytest.mark.parametrize("signed", [False, True])
def test_encoders_that_begin_again_after_a_power_of_two_are_recognised(bits, signed):
    turned = np.cumsum(2.0 ** (bits - 6) * (1.0 + np.sin(np.linspace(0.0, 9.0, 800))))
    low = -(2 ** (bits - 1)) if signed else 0
    columns = {f"e{k}": np.mod(np.round(k * turned) - low, 2**bits) + low for k in (1, 2, 3)}
    assert wrapped_encoders(columns, {}, 3) == (("e1", "e2", "e3"), 2**bits)
    assert wrapped_encoders({name: 0.5 * values for name, values in columns.items()}, {}, 3) is None
    assert wrapped_encoders(dict(list(columns.items())[:2]), {}, 3) is None


@pytest.mark.parametrize("counts", [500, 1000, 2000, 4000, 8000, 16000])
def test_encoders_that_begin_again_after_a_decimal_number_keep_it(counts):
    """The next power of two is 2.4 % more, which would be gained at each jump."""
    turned = np.cumsum(counts / 50.0 * (1.0 + np.sin(np.linspace(0.0, 9.0, 800))))
    columns = {f"e{k}": np.mod(np.round(k * turned), counts) for k in (1, 2, 3)}
    assert wrapped_encoders(columns, {}, 3) == (("e1", "e2", "e3"), counts)


def test_encoders_that_begin_again_after_the_robot_files_counts_keep_them():
    turned = np.cumsum(20.0 * (1.0 + np.sin(np.linspace(0.0, 9.0, 800))))
    columns = {f"e{k}": np.mod(np.round(k * turned), 1124) for k in (1, 2, 3)}
    assert wrapped_encoders(columns, {}, 3, encoder_counts=1124) == (("e1", "e2", "e3"), 1124)
    assert wrapped_encoders(columns, {}, 3) is None


def test_duties_and_encoders_that_do_not_jump_are_not_continued():
    random = np.random.default_rng(8)
    duties = {f"pwm{k}": random.integers(-255, 256, 900).astype(float) for k in (1, 2, 3)}
    noise = {f"e{k}": random.integers(0, 4096, 900).astype(float) for k in (1, 2, 3)}
    slow = {f"e{k}": np.round(900.0 + 20.0 * np.sin(0.01 * k * np.arange(900.0))) for k in (1, 2, 3)}
    assert [wrapped_encoders(one, {}, 3) for one in (duties, noise, slow)] == [None, None, None]


def counted(*gyro: str) -> Table:
    columns = with_rates(*gyro) if gyro else columns_of(swaying_log(), Habits())
    t = columns.pop("t_now")
    even = np.arange(t[0], t[-1], POLL)
    columns = {name: np.interp(even, t, values) for name, values in columns.items() if name != "i"}
    return {"loop": np.arange(len(even), dtype=float), **columns}


@pytest.mark.parametrize(
    ("gyro", "hint"),
    [
        (("gx_dps", "gy_dps", "gz_dps"), r'from = "loop", scale = 0.011\d* \} if a count is 11.\d* ms'),
        ((), r'from = "loop", scale = \.\. \} with the seconds of one of its counts'),
    ],
)
def test_a_counter_is_no_clock(tmp_path, gyro, hint):
    with pytest.raises(InputError, match="cannot determine the time: .*loop rises by 1 a row.*" + hint):
        recognised(tmp_path, counted(*gyro))


def test_the_seconds_of_a_count_follow_from_a_gyro_with_a_unit():
    columns = counted("gx_dps", "gy_dps", "gz_dps")
    named = roles_by_name(columns, wheel_count=3)
    # 3 %: noise of the differentiated angles and of the gyro, which is made of them
    assert seconds_of_a_count(columns["loop"], named, columns) == pytest.approx(POLL, rel=0.03)
    bare = {name.removesuffix("_dps"): values for name, values in columns.items()}
    assert seconds_of_a_count(columns["loop"], roles_by_name(bare, wheel_count=3), bare) is None


@pytest.mark.parametrize(("gain", "clear"), [(1.0, True), (0.107, False), (5.0, False)])
def test_gravity_confirms_no_unit_of_whole_numbers_if_the_lean_responds_unlike_the_robots(gain, clear):
    """A log with 5 ms a count, taken for 1 ms, has a response of 0.107 and a gravity of 0.9 times the robot's."""
    whole = time_scale(np.arange(900.0), None)
    assert whole is not None
    found = time_conclusion(whole, by_gyro=None, gyro_named=False, by_gravity=(0.9, 0.2), gain=gain)
    assert found.determined == clear


def test_set_points_of_torque_are_the_commands_where_there_are_no_others():
    columns = ["t", "roll", "pitch", *[f"enc{k}" for k in (1, 2, 3)], *[f"torque_set{k}" for k in (1, 2, 3)]]
    speeds = [f"speed_set{k}" for k in (1, 2, 3)]
    found = roles_by_name([*columns, *speeds], wheel_count=3)
    assert (found.commands, found.set_points) == (("torque_set1", "torque_set2", "torque_set3"), True)
    reading = found.reading(found.commands)
    assert reading is not None
    assert reading.input_kind == "torque"
    measured = roles_by_name([*columns, *[f"torque{k}" for k in (1, 2, 3)]], wheel_count=3)
    assert (measured.commands, measured.set_points) == (("torque1", "torque2", "torque3"), False)
    assert roles_by_name([*columns[:6], *speeds], wheel_count=3).commands == ()


def test_a_log_whose_commands_may_be_in_unnamed_columns_is_asked_about(tmp_path):
    columns = columns_of(swaying_log(), Habits())
    renamed = {f"u{k}": f"foo_{letter}" for k, letter in ((1, "A"), (2, "B"), (3, "C"))}
    path = write_foreign(
        tmp_path / "run.txt", {renamed.get(name, name): one for name, one in columns.items()}, Habits()
    )
    proposal = propose(path, small_robot())
    (asked,) = [one for one in conclusions_of(proposal) if one.name == "columns of the commands"]
    assert asked.question == "columns of the commands (none or foo_A, foo_B, foo_C)"
    found = evaluate(proposal, small_robot(), file=path)
    assert "name them with --columns" in found.refusal


def test_a_quaternion_is_no_command_of_a_log_without(tmp_path):
    columns = columns_of(swaying_log(), Habits())
    proposal = propose(write_foreign(tmp_path / "run.txt", columns, Habits()), small_robot())
    moving, four = columns["theta_x"], ("quat0", "quat1", "quat2", "quat3")
    more = dict.fromkeys((*four, "enc1", "enc2", "enc3", "enc4"), moving)
    table = replace(proposal.table, columns={"t_now": columns["t_now"], **more})
    roles = Roles(time="t_now", attitude=(), angles=tuple(more)[4:], speeds=(), commands=(), body_commands=())
    bare = replace(proposal, table=table, roles=roles)
    assert possible_commands(bare) == four
    assert possible_commands(replace(bare, roles=replace(roles, quaternion=four))) == ()
