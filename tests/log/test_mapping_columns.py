"""Columns without names: recognised by their numbers, or left open."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from ballbot.log.formats import read_foreign_table
from ballbot.log.mapping_inference.column_values import _shared_steps, _slower_than_a_fall, roles_by_data
from ballbot.log.mapping_inference.evidence import CONFIDENT, Conclusion
from ballbot.log.mapping_inference.open_names import settled, with_heading_behind
from ballbot.log.mapping_inference.recognition import recognise
from ballbot.log.mapping_inference.roles import Roles, half_turn_of, quaternion_of, roles_by_name
from tests.support.foreign_log_examples import (
    Habits,
    columns_of,
    small_robot,
    swaying_log,
    write_foreign,
)


def unnamed(habits: Habits, *names: str) -> tuple[Roles | None, list[str]]:
    """Return the roles of columns of a foreign log, in this order and without their names, and the columns used."""
    logged = columns_of(swaying_log(), habits)
    table = {f"column_{place}": logged[name] for place, name in enumerate(names, start=1)}
    found = roles_by_data(table, small_robot())
    if found is None:
        return None, []
    meant = dict(zip(table, names, strict=True))
    return found, [meant[name] for name in (*found.attitude, *found.angles, *found.commands)]


def renamed(habits: Habits, forms: dict[str, str], **more: np.ndarray) -> Roles:
    """Return the roles of a log whose wheels, commands and speeds have other names, settled by the values."""
    columns = columns_of(swaying_log(), habits)
    t = columns["t_now"]
    columns |= {f"speed{k}": np.gradient(columns[f"psi_{k}"], t) for k in (1, 2, 3)}
    table = {"t": t, "roll": columns["theta_x"], "pitch": columns["theta_y"], **more}
    for stem, form in forms.items():
        table |= {form.format(k): columns[f"{stem}{k}"] for k in (1, 2, 3)}
    return settled(roles_by_name(table, wheel_count=3), table, small_robot())


def series(form: str) -> tuple[str, ...]:
    return tuple(form.format(k) for k in (1, 2, 3))


@pytest.mark.parametrize("letters", ["em", "me", "wm", "pm", "Me", "qm", "mu", "sr"])
def test_of_two_series_with_open_names_the_slower_one_is_the_angles(letters):
    angles, commands = (letter + "{}" for letter in letters)
    found = renamed(Habits(counts=True, full_duty=255.0), {"psi_": angles, "u": commands})
    assert (found.angles, found.commands) == (series(angles), series(commands))
    assert found.confidence == 1.0


def test_a_series_that_is_the_rate_of_the_angles_is_their_speeds():
    found = renamed(Habits(), {"psi_": "m{}", "speed": "w{}", "u": "e{}"})
    assert (found.angles, found.speeds, found.commands) == (series("m{}"), series("w{}"), series("e{}"))


def test_series_that_nothing_tells_apart_leave_the_columns_open():
    found = renamed(Habits(), {"psi_": "m{}"}, **dict(zip(series("e{}"), still_columns(), strict=True)))
    same = columns_of(swaying_log(), Habits())
    twice = renamed(Habits(), {"psi_": "m{}"}, **{f"e{k}": 2.0 * same[f"psi_{k}"] for k in (1, 2, 3)})
    assert found.angles == series("m{}")
    assert twice.confidence < CONFIDENT
    assert twice.alternatives


def test_duties_that_follow_the_speeds_and_have_their_letter_leave_the_columns_open():
    found = renamed(Habits(), {"psi_": "M{}", "u": "w{}"})
    assert found.angles == series("M{}")
    assert found.confidence < CONFIDENT
    assert found.alternatives == ("w1, w2, w3 are the commands",)


def still_columns() -> list[np.ndarray]:
    return [np.full(len(columns_of(swaying_log(), Habits())["t_now"]), float(k)) for k in (1, 2, 3)]


def test_a_row_of_units_decides_what_letters_leave_open():
    found = roles_by_name(
        ["t", "roll", "pitch", *series("w{}"), *series("m{}")],
        wheel_count=3,
        units=dict.fromkeys(series("w{}"), "deg") | dict.fromkeys(series("m{}"), "[A]"),
    )
    assert (found.angles, found.commands, found.open_series) == (series("w{}"), series("m{}"), ())
    reading = found.reading(found.commands)
    assert reading is not None
    assert (reading.unit, reading.input_kind) == ("A", "current")


LEAN, WHEELS, COMMANDS = ("theta_x", "theta_y", "theta_z"), ("psi_1", "psi_2", "psi_3"), ("u1", "u2", "u3")


@pytest.mark.parametrize(
    "habits",
    [
        Habits(),
        Habits(order=(2, 1, 3), signs=(1, -1, 1), turn=1.0),
        Habits(signs=(-1, -1, -1), command_sign=-1, counts=True),
        Habits(order=(3, 1, 2), signs=(-1, 1, 1), degrees=False, full_duty=255.0),
    ],
)
def test_lean_heading_wheels_and_commands_are_found_in_any_order_and_with_any_signs(habits):
    found, columns = unnamed(habits, "t_now", *LEAN, *WHEELS, *COMMANDS)
    assert columns == [*LEAN, *WHEELS, *COMMANDS]
    assert found is not None
    assert found.confidence >= 0.85


def test_a_log_without_a_heading_has_none():
    found, columns = unnamed(Habits(yaw=False), "t_now", *LEAN[:2], *WHEELS, *COMMANDS)
    assert found is not None
    assert columns == [*LEAN[:2], *WHEELS, *COMMANDS]


def test_columns_between_lean_and_wheels_that_may_be_a_heading_leave_it_open():
    logged = columns_of(swaying_log(), Habits())
    still = 1e-3 * np.random.default_rng(5).standard_normal(len(logged["t_now"]))
    named = {"t": logged["t_now"], "a": logged["theta_x"], "b": logged["theta_y"], "c": still}
    named |= {name: logged[name] for name in (*WHEELS, *COMMANDS)}
    found = roles_by_data(named, small_robot())
    assert found is not None
    assert len(found.attitude) == 2
    assert found.confidence < CONFIDENT


@pytest.mark.parametrize("lean", [LEAN, LEAN[:2]])
def test_a_lean_that_the_wheels_explain_badly_is_found_if_every_column_then_has_a_role(lean):
    logged = columns_of(swaying_log(), Habits())
    # 1 deg at 1 to 3 Hz, such as a soft mount's: so much that the fit of the lean alone finds nothing
    hann = np.hanning(30) / np.linalg.norm(np.hanning(30))
    white = np.random.default_rng(6).standard_normal((2, len(logged["t_now"])))
    shaken = [np.convolve(one, hann, mode="same") for one in white]
    logged |= {name: logged[name] + one for name, one in zip(LEAN[:2], shaken, strict=True)}
    table = {name: logged[name] for name in ("t_now", *lean, *WHEELS, *COMMANDS)}
    found = roles_by_data(table, small_robot())
    assert found is not None
    assert (found.attitude, found.angles, found.commands) == (lean, WHEELS, COMMANDS)
    assert found.confidence >= CONFIDENT
    # a column beside the lean that has no role may be a part of it
    doubted = roles_by_data({"t_now": table.pop("t_now"), "a": shaken[0], **table}, small_robot())
    assert doubted is None or doubted.confidence < CONFIDENT


@pytest.mark.parametrize(
    ("confidence", "shown"), [(0.999, "> 99"), (0.991, "> 99"), (0.98, "98"), (0.8999, "89")]
)
def test_no_confidence_is_shown_as_certain_or_above_what_it_is(confidence, shown):
    assert Conclusion(name="", value="", confidence=confidence, evidence="").percent == shown


def by_letters(turned: float) -> Roles:
    """Return the roles of a log with a compass heading [deg], roll and pitch as x, y and z, in a BNO055's order."""
    columns = columns_of(swaying_log(), Habits())
    heading = np.mod(turned - columns["theta_z"], 360.0)
    table = {"t": columns["t_now"], "orientation_x": heading}
    table |= {"orientation_y": columns["theta_x"], "orientation_z": columns["theta_y"]}
    table |= {f"enc{k}": columns[f"psi_{k}"] for k in (1, 2, 3)}
    return with_heading_behind(roles_by_name(table, wheel_count=3), table, small_robot())


@pytest.mark.parametrize("turned", [200.0, 0.0])
def test_a_compass_heading_as_x_is_the_heading(turned):
    found = by_letters(turned)
    assert found.attitude == ("orientation_y", "orientation_z", "orientation_x")
    assert not found.alternatives


def test_a_heading_that_turns_as_y_is_the_heading():
    columns = columns_of(swaying_log(heading=3.0), Habits())
    table = {"t": columns["t_now"], "theta_x": columns["theta_x"]}
    table |= {"theta_y": columns["theta_z"], "theta_z": columns["theta_y"]}
    table |= {f"enc{k}": columns[f"psi_{k}"] for k in (1, 2, 3)}
    found = with_heading_behind(roles_by_name(table, wheel_count=3), table, small_robot())
    assert found.attitude == ("theta_x", "theta_z", "theta_y")
    assert not found.alternatives


def test_angles_x_y_and_z_in_the_usual_order_keep_it():
    columns = columns_of(swaying_log(), Habits())
    table = {"t": columns["t_now"], **{f"orientation_{a}": columns[f"theta_{a}"] for a in "xyz"}}
    table |= {f"enc{k}": columns[f"psi_{k}"] for k in (1, 2, 3)}
    named = roles_by_name(table, wheel_count=3)
    assert with_heading_behind(named, table, small_robot()) == named


@pytest.mark.parametrize("noisy", "xy")
def test_a_heading_as_z_stays_the_heading_beside_a_noisy_lean(noisy):
    """The wheels explain the other angle and a heading that turns much better than a noisy roll and pitch."""
    columns = columns_of(swaying_log(heading=3.0), Habits())
    table = {"t": columns["t_now"], **{f"orientation_{a}": columns[f"theta_{a}"] for a in "xyz"}}
    noise = 10.0 * np.random.default_rng(1).standard_normal(len(columns["t_now"]))  # [deg]
    table[f"orientation_{noisy}"] = table[f"orientation_{noisy}"] + noise
    table |= {f"enc{k}": columns[f"psi_{k}"] for k in (1, 2, 3)}
    named = roles_by_name(table, wheel_count=3)
    assert with_heading_behind(named, table, small_robot()) == named


def test_beside_wheels_without_a_name_plain_names_are_believed(tmp_path):
    """The motion explains a gyro's rates as well as commands, and does not explain a heading turned by hand."""
    columns = columns_of(swaying_log(), Habits())
    t = columns["t_now"]
    table = {"Zeit_s": t, "Rollwinkel": columns["theta_x"], "Nickwinkel": columns["theta_y"]}
    table |= {"Gierwinkel": np.cumsum(np.random.default_rng(2).standard_normal(len(t)))}
    table |= {
        f"Drehrate_{axis}": np.gradient(columns[f"psi_{k}"], t) for k, axis in enumerate("XYZ", start=1)
    }
    table |= {f"Stift_{'PQR'[k - 1]}": columns[f"psi_{k}"] for k in (1, 2, 3)}
    table |= {f"Motorstrom{k}_mA": columns[f"u{k}"] for k in (1, 2, 3)}
    path = write_foreign(tmp_path / "log.txt", table, Habits())
    found = recognise(path, read_foreign_table(path), small_robot())
    assert found.by_data
    assert found.roles.angles == ("Stift_P", "Stift_Q", "Stift_R")
    assert found.roles.attitude == ("Rollwinkel", "Nickwinkel", "Gierwinkel")
    assert found.roles.commands == series("Motorstrom{}_mA")
    assert found.roles.confidence > CONFIDENT


def swaying_quaternion(yaw: float) -> dict[str, np.ndarray]:
    """Return w, x, y and z of a robot that leans a little around a heading, in a file with other columns."""
    t = 0.01 * np.arange(500)
    angles = np.column_stack([yaw + 0.3 * np.sin(t), 0.05 * np.sin(3.0 * t), 0.04 * np.cos(2.0 * t)])
    x, y, z, w = Rotation.from_euler("ZYX", angles).as_quat().T
    return {"w": w, "x": x, "y": y, "z": z}


@pytest.mark.parametrize(
    ("names", "order"),
    [
        ("qw qx qy qz", "wxyz"),
        ("orientation_x orientation_y orientation_z orientation_w", "xyzw"),
        ("imu.orientation.x imu.orientation.y imu.orientation.z imu.orientation.w", "xyzw"),
        ("QuatW QuatX QuatY QuatZ", "wxyz"),
        ("q0 q1 q2 q3", "wxyz"),
        ("q[1] q[2] q[3] q[4]", "xyzw"),
        ("quatI quatJ quatK quatReal", "xyzw"),
        ("rot_i rot_j rot_k rot_r", "xyzw"),
        ("QUAT_REAL QUAT_I QUAT_J QUAT_K", "wxyz"),
    ],
)
@pytest.mark.parametrize("yaw", [0.0, 1.2, -2.0])
def test_a_quaternion_is_found_by_its_names_and_its_norm(names, order, yaw):
    parts = swaying_quaternion(yaw)
    columns = {"t": 0.01 * np.arange(500)} | dict(
        zip(names.split(), [parts[one] for one in order], strict=True)
    )
    columns |= {f"motor{k}": np.sin(k * columns["t"]) for k in range(4)}
    assert quaternion_of(columns) == tuple(names.split()[order.index(part)] for part in "wxyz")


@given(
    values=arrays(np.float64, (4, 30), elements=st.floats(-1.0, 1.0)),
    names=st.sampled_from(["w x y z", "a0 a1 a2 a3", "ref_qw ref_qx ref_qy ref_qz"]),
)
def test_four_columns_that_are_no_rotation_are_no_quaternion(values, names):
    columns = dict(zip(names.split(), values, strict=True))
    one = np.mean(np.abs(np.linalg.norm(values, axis=0) - 1.0) < 0.02) >= 0.5
    assert quaternion_of(columns) == () or one


def test_a_roll_near_half_a_turn_is_that_of_an_imu_upside_down():
    random = np.random.default_rng(1)
    lean = 3.0 * random.standard_normal(1000)  # [deg]
    over = np.mod(lean, 360.0) - 180.0
    assert half_turn_of(over, None) == half_turn_of(over, "deg") == 180.0
    assert (
        half_turn_of(np.radians(over), None) == half_turn_of(np.radians(over), "rad") == pytest.approx(np.pi)
    )
    for upright in (
        lean,
        np.radians(lean),
        3.1 + 0.05 * lean,
    ):  # the last: 3.1 deg beside upright, all its time
        assert half_turn_of(upright, None) is None
    assert half_turn_of(np.full(10, np.nan), None) is None


def test_a_column_too_fast_to_show_its_step_has_that_of_its_neighbour():
    random, t = np.random.default_rng(4), np.arange(1000)
    slow = np.cumsum(random.integers(-1, 2, 1000)).astype(float)
    fast = np.asarray(np.round(9e4 * np.sin(0.05 * t)), dtype=np.float64)
    lean = random.standard_normal(1000)
    found = _shared_steps({"slow": slow, "fast": fast, "lean": lean, "small": 0.01 * lean})
    assert found == {"slow": 1.0, "fast": 1.0, "lean": None, "small": None}
    # and of the one behind it
    assert _shared_steps({"fast": 0.01 * fast, "slow": 0.01 * slow})["fast"] == pytest.approx(0.01)


def test_a_set_point_that_changes_slowly_is_no_lean():
    t = np.linspace(0.0, 20.0, 4000)
    lean = np.column_stack([np.sin(3.0 * t), np.cos(2.0 * t)])
    rates = np.array([3.0, 2.0])
    assert not _slower_than_a_fall(lean, -(rates**2) * lean, 11.0)
    lean[:, 1], rates[1] = np.sin(0.5 * t), 0.5
    assert _slower_than_a_fall(lean, -(rates**2) * lean, 11.0)
