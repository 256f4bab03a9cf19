"""Foreign logs whose columns are not what their names promise: before the gear, mixed, scaled, dead, copied."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ballbot.errors import InputError
from ballbot.findings import Finding
from ballbot.log.checks.kinematics import check_wheels
from ballbot.log.mapping_inference.command_units import unit_probabilities
from ballbot.log.mapping_inference.commands import Response
from ballbot.log.mapping_inference.evidence import CONFIDENT
from ballbot.log.mapping_inference.proposal import propose
from ballbot.log.mapping_inference.refusal import contradiction, errors_of
from ballbot.log.mapping_inference.report import Evaluation, evaluate
from tests.support.foreign_log_examples import Habits, columns_of, small_robot, swaying_log, write_foreign

Columns = dict[str, np.ndarray]


def written(columns: Columns) -> Columns:
    """Return the columns with torques of the wheels [N m] in place of duties."""
    truth = swaying_log()
    torques = [np.interp(columns["t_now"] + 0.010, truth.t, one) for one in truth.torques.T]
    lean = {name: values for name, values in columns.items() if not name.startswith("u")}
    return lean | {f"torque{i}_Nm": one for i, one in enumerate(torques, start=1)}


@pytest.fixture
def evaluated(tmp_path: Path) -> Callable[[Columns], Evaluation]:
    """Return a function that writes columns as a stranger's file and evaluates its proposal."""

    def made(columns: Columns) -> Evaluation:
        path = write_foreign(tmp_path / "run.csv", columns, Habits(separator=","))
        robot = small_robot()
        return evaluate(propose(path, robot), robot, file=path)

    return made


@pytest.fixture(scope="module")
def plain() -> Columns:
    return written(columns_of(swaying_log(), Habits(counts=True)))


@pytest.mark.parametrize("unit", ["Nm", "mNm"])
def test_torques_of_the_motors_shaft_are_multiplied_by_the_gear_ratio(evaluated, plain: Columns, unit: str):
    before_gear = small_robot().drive.gear_ratio * (1.0 if unit == "Nm" else 1e-3)
    columns = {
        name.replace("_Nm", f"_{unit}"): values / before_gear if "_Nm" in name else values
        for name, values in plain.items()
    }
    found: Evaluation = evaluated(columns)
    assert found.log is not None, found.refusal
    truth = swaying_log()
    for i in (1, 2, 3):
        # means over a quarter of a second, as the host misses some of what chatters
        true, own = (
            np.convolve(one, np.ones(50) / 50.0, mode="valid")
            for one in (np.interp(found.log.t, truth.t, truth[f"u{i}"]), found.log[f"u{i}"])
        )
        assert np.vdot(true, own) / np.vdot(true, true) == pytest.approx(1.0, abs=0.1)


def test_currents_under_the_name_of_torques_are_not_taken_for_torques(evaluated, plain: Columns):
    drive = small_robot().drive
    milliampere = 1e3 / (drive.gear_ratio * drive.torque_constant)
    found: Evaluation = evaluated({k: milliampere * v if "_Nm" in k else v for k, v in plain.items()})
    (unit,) = (one for one in found.conclusions if one.name == "unit of the command")
    assert unit.value == "mA"
    # the torque constant is right here, and what the motion says of it is within two of its standard errors
    note = next(one.text for one in found.findings if one.code == "drive")
    ratio, error = map(float, re.findall(r"([\d.]+) times as large \(standard error (\d+) %\)", note)[0])
    assert abs(ratio - 1.0) < 0.02 * error


def test_a_name_of_a_wrong_unit_is_no_proof_of_the_kind():
    # at 1.16 N m an ampere mN m are 16 % beside mA, as near as the robot file's masses are known
    robot = small_robot()
    per_ampere = 1.16
    drive = replace(robot.drive, torque_constant=per_ampere / robot.drive.gear_ratio)
    log = swaying_log()
    milliampere = np.column_stack([log[f"u{i}"] for i in (1, 2, 3)]) * 1e3 / per_ampere
    found = unit_probabilities(
        replace(robot, drive=drive),
        Response(gain=1e3 / per_ampere, gain_error=0.03, damping=0.01, damping_error=0.01),
        milliampere,
        named_kind="torque",
        named_unit="N m",
    )
    kinds = {kind: sum(p for one, p in found.items() if one.kind == kind) for kind in ("torque", "current")}
    assert max(kinds.values()) < CONFIDENT


@pytest.mark.parametrize("factor", [0.3, 1.6])
def test_torques_unlike_those_that_the_motion_needs_are_asked_for(evaluated, plain: Columns, factor: float):
    found: Evaluation = evaluated({k: factor * v if "_Nm" in k else v for k, v in plain.items()})
    assert "unit of the command (N m or" in found.refusal
    assert re.search(
        "or a robot unlike its file: these are [01][.][0-9]+ times what the motion needs", found.refusal
    )


def test_torques_about_the_bodys_axes_are_not_taken_for_the_motors(evaluated, plain: Columns):
    robot = small_robot()
    names = [f"torque{i}_Nm" for i in (1, 2, 3)]
    azimuth = np.asarray(robot.wheels.azimuths)
    about = np.array([np.cos(azimuth), np.sin(azimuth), np.ones(3)])
    mixed = np.column_stack([plain[name] for name in names]) @ about.T
    found: Evaluation = evaluated(plain | dict(zip(names, mixed.T, strict=True)))
    assert "order and signs of the commands" in found.refusal
    assert "torques about the body's axes" in found.refusal


def test_a_dead_encoder_stops_the_mapping(evaluated, plain: Columns):
    with pytest.raises(InputError, match="psi_2 is 0 in every row while other wheels turn: a dead encoder"):
        evaluated(plain | {"psi_2": np.zeros_like(plain["psi_2"])})


def test_wheels_that_never_turn_are_named(evaluated, plain: Columns):
    with pytest.raises(InputError, match=r"no wheel turns \(psi_1, psi_2, psi_3 keep their values\)"):
        evaluated({name: 0.0 * v if name.startswith("psi") else v for name, v in plain.items()})


def test_a_heading_that_never_changes_is_left_out(evaluated, plain: Columns):
    found: Evaluation = evaluated(plain | {"theta_z": np.zeros_like(plain["theta_z"])})
    assert found.proposal.roles.attitude == ("theta_x", "theta_y")
    assert any(one.text.startswith("theta_z has one value in all rows") for one in found.findings)


def test_two_series_of_another_number_than_the_wheels_are_another_robots(evaluated, plain: Columns):
    four = {"psi_": "e", "torque": "m"}
    names = {
        f"{new}{i}": plain[next(k for k in plain if k.startswith(old))]
        for old, new in four.items()
        for i in range(1, 5)
    }
    rest = {f"c{chr(97 + k)}": v for k, (n, v) in enumerate(plain.items()) if n.startswith("theta")}
    with pytest.raises(InputError, match="4 columns each of e1 to e4 and m1 to m4, but the robot"):
        evaluated({"t": plain["t_now"], **rest, **names})


@pytest.mark.parametrize("jump", [30.0, 3600.0])
def test_a_clock_that_is_set_while_the_log_runs_leaves_the_longer_part(
    evaluated, plain: Columns, jump: float
):
    t = plain["t_now"]
    row = 2 * len(t) // 3
    found: Evaluation = evaluated(plain | {"t_now": t + jump * (np.arange(len(t)) >= row)})
    assert found.proposal.rows == (1, row)
    assert any("jumps by more than 10 s" in one.text for one in found.findings)


def test_an_encoder_of_half_the_counts_is_not_mapped(evaluated, plain: Columns):
    found: Evaluation = evaluated(plain | {"psi_2": 0.5 * plain["psi_2"]})
    assert found.refusal


def test_a_wheel_that_turns_unlike_the_others_is_named():
    log = swaying_log()
    slow = log.with_columns({"wheel2": 0.7 * log["wheel2"], "wheel2_dot": 0.7 * log["wheel2_dot"]})
    (found,) = (one for one in check_wheels(slow, small_robot()) if one.code == "wheel-unlike")
    assert "wheel 2 is unlike the others" in found.text
    assert not [one for one in check_wheels(log, small_robot()) if one.code == "wheel-unlike"]


def test_an_encoder_that_sticks_for_a_while_stops_the_mapping_which_keeps_the_rest(evaluated, plain: Columns):
    angle, t = plain["psi_2"].copy(), plain["t_now"]
    rows = (t > 10.0) & (t < 15.0)
    angle[rows] = angle[rows][0]
    found: Evaluation = evaluated(plain | {"psi_2": angle})
    assert "psi_2 holds its value from 10" in found.refusal
    assert "[time] keep is the rest" in found.refusal
    assert all(end < 10.1 or start > 14.9 for start, end in found.proposal.keep or ())
    # what the rest says is as if the log had no such rows
    assert found.proposal.frame.order == (1, 2, 3)


def test_a_torque_that_is_not_recorded_stops_the_mapping(evaluated, plain: Columns):
    with pytest.raises(InputError, match="torque2_Nm is 0 in every row while other motors' commands vary"):
        evaluated(plain | {"torque2_Nm": 0.0 * plain["torque2_Nm"]})


def test_every_error_is_shown_and_those_of_the_recording_do_not_stop_the_mapping():
    scale = Finding(code="torque-scale", severity="error", text="The torques are too large.")
    missing = Finding(code="missing", severity="error", text="Rows are missing.")
    note = Finding(code="use", severity="note", text="A column is missing.")
    errors = errors_of([note, missing, scale])
    assert [(one.code, one.severity) for one in errors] == [("contradiction", "error"), ("missing", "error")]
    assert "The torques are too large. Correct mapping.toml" in contradiction(errors, "mapping.toml")
    assert contradiction(errors_of([missing]), "mapping.toml") == ""


def test_missing_cells_leave_the_conclusions_and_no_unbelieved_delay_is_told(evaluated, plain: Columns):
    angle, roll = plain["psi_2"].copy(), plain["theta_x"].copy()
    angle[[300, 900, 1500]] = np.nan
    roll[200:2000:90] = np.nan
    found: Evaluation = evaluated(plain | {"psi_2": angle, "theta_x": roll})
    assert found.log is not None, found.refusal
    assert found.proposal.wheel.unit == "counts"
    (missing,) = (one for one in found.findings if one.code == "missing")
    assert "23 cells of theta_x, psi_2 are missing" in missing.text
    drive = [one.text for one in found.findings if one.code == "drive"]
    applied = found.proposal.command_delay.applied
    assert any("after the command" in text for text in drive) == (applied > 0.0)


WHEELS = ("psi_1", "psi_2", "psi_3")


@pytest.fixture(scope="module")
def angles() -> Columns:
    """Return the columns with wheel angles [rad] whose steps no longer show the encoder."""
    columns, random = written(columns_of(swaying_log(), Habits())), np.random.default_rng(0)
    fine = {name: 1e-5 * random.standard_normal(len(columns["t_now"])) for name in WHEELS}
    return columns | {name: columns[name] + fine[name] for name in WHEELS}


def test_degrees_are_not_certain_where_a_path_in_mm_fits_as_well(evaluated, angles: Columns):
    """48 mm a radian is 0.84 times 57.3 degrees."""
    path = 1e3 * small_robot().wheels.radius
    found: Evaluation = evaluated(angles | {name: path * angles[name] for name in WHEELS})
    (asked,) = found.undetermined
    assert asked.name == "unit of the wheel angles"
    assert "mm of path" in asked.answers
    assert "deg" in asked.answers
    # degrees are never a path without such doubt
    degrees: Evaluation = evaluated(angles | {name: np.degrees(angles[name]) for name in WHEELS})
    assert degrees.proposal.wheel.unit == "deg"
    assert not degrees.refusal


def test_a_path_in_mm_by_name_is_mapped(evaluated, angles: Columns):
    path = 1e3 * small_robot().wheels.radius
    named = {f"{name}_mm" if name in WHEELS else name: values for name, values in angles.items()}
    found: Evaluation = evaluated(named | {f"{name}_mm": path * angles[name] for name in WHEELS})
    assert found.log is not None, found.refusal
    turned, true = found.log["wheel1"], np.interp(found.log.t, swaying_log().t, swaying_log()["wheel1"])
    assert np.std(turned - true) < 0.01 * np.std(true)


@pytest.mark.parametrize(("factor", "asked"), [(4.0, "17920 a turn"), (0.25, "1120 a turn")])
def test_counts_of_other_edges_are_offered_exactly(evaluated, plain: Columns, factor: float, asked: str):
    """The heading shows 17700 and 1110."""
    found: Evaluation = evaluated(plain | {name: np.round(factor * plain[name]) for name in WHEELS})
    assert asked in found.refusal
    assert "the robot file's 4480" in found.undetermined[0].evidence


@pytest.mark.parametrize("stretched", [0.5, 1.0 / 1.5, 1.5, 2.0])
def test_a_wrong_clock_is_named_before_what_follows_from_it(evaluated, plain: Columns, stretched: float):
    found: Evaluation = evaluated(plain | {"t_now": stretched * plain["t_now"]})
    assert found.undetermined[0].name == "clock"
    assert found.refusal.startswith("cannot determine: clock")
    seconds = float(found.undetermined[0].alternatives[0].split(" s of")[0].split()[-1])
    # by the lean's acceleration, which noise of the angles makes too small
    assert seconds == pytest.approx(1.0 / stretched, rel=0.15)


def test_a_set_point_among_the_commands_is_named(evaluated, plain: Columns):
    found: Evaluation = evaluated(plain | {"torque2_Nm": np.sin(1.3 * plain["t_now"])})
    (asked,) = found.undetermined
    assert asked.name == "columns of the commands"
    assert "torque2_Nm as a set point" in asked.answers


def test_a_gyro_with_an_offset_is_left_out_for_that_reason(evaluated, plain: Columns):
    """131 counts per deg/s and an offset of 3 deg/s, without a yaw."""
    log, t = swaying_log(), plain["t_now"] - 0.0175
    rates = (log["theta_dot"] + 1j * log["phi_dot"]) * np.exp(-1j * log["psi"])
    gyro = zip("xyz", (rates.real, rates.imag, log["psi_dot"]), strict=True)
    columns = {name: values for name, values in plain.items() if name != "theta_z"}
    for axis, rate in gyro:
        offset = 3.0 if axis == "z" else 0.0
        columns[f"gyro_{axis}"] = np.round(131.0 * (np.degrees(np.interp(t, log.t, rate)) + offset))
    found: Evaluation = evaluated(columns)
    (text,) = (one.text for one in found.findings if "is not used" in one.text)
    assert "its offset about the vertical would turn the heading by" in text


def test_a_log_of_a_robot_with_more_wheels_is_refused():
    log = swaying_log()
    more = log.with_columns({"u4": log["u1"], "wheel4_dot": log["wheel1_dot"]})
    (found,) = check_wheels(more, small_robot())
    assert found.severity == "error"
    assert found.text.startswith("The log has values of u4, wheel4_dot, but the robot has 3 wheels.")
    unused = log.with_columns({"u4": np.zeros(len(log))})
    assert check_wheels(unused, small_robot()) == check_wheels(log, small_robot())
