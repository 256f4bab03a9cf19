"""`propose`: foreign logs of a simulated robot, whose order, signs, units, turn and delays are known."""

import contextlib
import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ballbot.errors import InputError
from ballbot.log import Log
from ballbot.log.mapping_file import parse_mapping
from ballbot.log.mapping_inference.command_units import Unit
from ballbot.log.mapping_inference.conclusions import conclusions_of
from ballbot.log.mapping_inference.evidence import Conclusion
from ballbot.log.mapping_inference.placement import torque_free_gains
from ballbot.log.mapping_inference.proposal import Proposal, propose
from ballbot.log.mapping_inference.report import evaluate, findings_of, mapping_text
from ballbot.log.mapping_inference.units import lean_units, wheel_units
from ballbot.log.pose import with_odometry
from tests.support.foreign_log_examples import (
    COMMAND_DELAY,
    POLL,
    SENSOR_DELAY,
    Habits,
    columns_of,
    small_robot,
    swaying_log,
    write_foreign,
)

CASES = {
    "as the robot's": Habits(),
    "other way round": Habits(order=(1, 3, 2), turn=np.radians(30.0)),
    "signs of all": Habits(signs=(-1, -1, -1), counts=True, turn=np.radians(-90.0)),
    "one wheel": Habits(signs=(1, -1, 1), degrees=False, full_duty=255.0, separator=","),
    "cyclic": Habits(order=(2, 3, 1), command_sign=-1, separator="\t"),
    "no header": Habits(names=(), signs=(-1, -1, -1), counts=True, degrees=False, yaw=False),
}


def proposed(folder, habits: Habits, *, tail: str = "") -> Proposal:
    path = write_foreign(folder / "run.txt", columns_of(swaying_log(), habits), habits, tail=tail)
    return propose(path, small_robot(), dead_band=0.0)


def mapped(folder, proposal: Proposal) -> Log:
    text = mapping_text(proposal, small_robot(), file=folder / "run.txt")
    log = Log.read(folder / "run.txt", mapping=parse_mapping(text, source="proposed"))
    return with_odometry(log, small_robot())


@pytest.fixture(scope="module")
def case(tmp_path_factory) -> Callable[[str], tuple[Proposal, Path]]:
    """Return a function that gives the proposal of a case and the folder of its file, made once."""

    @cache
    def made(name: str) -> tuple[Proposal, Path]:
        folder = tmp_path_factory.mktemp("foreign")
        return proposed(folder, CASES[name]), folder

    return made


@pytest.mark.parametrize("name", CASES)
def test_the_mapping_brings_the_truth_back(case, name):
    habits, truth = CASES[name], swaying_log()
    proposal, folder = case(name)
    log = mapped(folder, proposal)
    assert proposal.lean_test is not None
    assert proposal.lean_test.margin > 1.5
    assert proposal.timing.worth_it

    def true(column: str) -> np.ndarray:
        return np.interp(log.t, truth.t, truth[column])

    # a third of a turn of the robot, or the wheels' numbers with it, is a matter of words: as many as wheels
    beta = 2.0 * np.pi / 3.0
    lean = log["theta"] + 1j * log["phi"]
    wheels = np.column_stack([log[f"wheel{i}_dot"] for i in (1, 2, 3)])
    turned = [
        k
        for k in range(3)
        if np.corrcoef(wheels[:, 0], true(f"wheel{k % 3 + 1}_dot"))[0, 1] > 0.98
        and np.corrcoef(wheels[:, 1], true(f"wheel{(k + 1) % 3 + 1}_dot"))[0, 1] > 0.98
        and np.corrcoef(wheels[:, 2], true(f"wheel{(k + 2) % 3 + 1}_dot"))[0, 1] > 0.98
    ]
    assert len(turned) == 1
    if not habits.yaw:
        return  # the lean turns with a heading that the file does not have
    heading = np.exp(-1j * log["psi"])
    true_lean = (true("theta") + 1j * true("phi")) * np.exp(-1j * true("psi"))
    gain = np.vdot(true_lean, lean * heading) / np.vdot(true_lean, true_lean)
    # 5 degrees: the accuracy required of the phase; 3 %: the IMU's noise
    assert abs(np.angle(gain * np.exp(1j * beta * turned[0]))) < np.radians(5.0)
    assert abs(gain) == pytest.approx(1.0, abs=0.03)
    np.testing.assert_allclose(log["psi"] - log["psi"][0], true("psi") - true("psi")[0], atol=0.03)


@pytest.mark.parametrize("name", ["as the robot's", "other way round", "signs of all"])
def test_delays_and_torques_are_found(case, name):
    (proposal, folder), truth = case(name), swaying_log()
    # half of the messages' interval: the encoders' times are known up to a constant
    assert proposal.lean_test is not None
    assert proposal.lean_test.lag == pytest.approx(SENSOR_DELAY, abs=0.005)
    assert proposal.commands is not None
    # and a held command is seen at the host's times only, half an interval late on average
    assert proposal.commands.delay == pytest.approx(COMMAND_DELAY, abs=0.5 * POLL + 0.003)
    log = mapped(folder, proposal)
    for i, wheel in enumerate(proposal.frame.order, start=1):
        wheel_of_robot = CASES[name].order[wheel - 1]
        torque = np.interp(log.t, truth.t, truth[f"u{wheel_of_robot}"])
        # means over a tenth of a second: the commands' dither changes between the host's rows
        means = [np.convolve(values, np.full(10, 0.1), mode="same") for values in (log[f"u{i}"], torque)]
        assert np.corrcoef(means)[0, 1] > 0.95
        assert np.std(means[0]) == pytest.approx(np.std(means[1]), rel=0.1)


def test_mirrored_frame_is_found_by_the_imu_and_reported(tmp_path):
    proposal = proposed(tmp_path, Habits(pitch_sign=-1))
    assert proposal.lean_test is not None
    assert proposal.lean_test.placements[0].mirrored
    assert any("mirror image" in finding.text for finding in findings_of(proposal))


def test_the_quaternion_of_an_imu_upside_down_is_read(tmp_path):
    """The file's lean as a quaternion of an IMU that hangs upside down gives the log that its angles give."""
    habits = Habits(degrees=False, counts=True)
    columns = columns_of(swaying_log(), habits)
    angles = np.column_stack([columns.pop(f"theta_{axis}") for axis in "zyx"])
    over = Rotation.from_euler("ZYX", angles) * Rotation.from_euler("x", np.pi)
    columns |= {f"orientation_{part}": one for part, one in zip("xyzw", over.as_quat().T, strict=True)}
    proposal = propose(write_foreign(tmp_path / "run.txt", columns, habits), small_robot(), dead_band=0.0)
    text = mapping_text(proposal, small_robot(), file=tmp_path / "run.txt")
    assert 'from = ["orientation_w", "orientation_x", "orientation_y", "orientation_z"]' in text
    assert "upside_down = true" in text
    log, truth = mapped(tmp_path, proposal), swaying_log()
    for name in ("theta", "phi", "psi"):
        true = np.interp(log.t, truth.t, truth[name])
        # the IMU's noise of 0.5 mrad, and what a delay known to 5 ms leaves
        np.testing.assert_allclose(log[name] - log[name][0], true - true[0], atol=0.02)


@pytest.mark.parametrize("times", [4.0, 1.4])
def test_counts_unlike_the_robot_files_are_asked_for(tmp_path, times):
    habits = Habits(counts=True)
    robot = small_robot()
    path = write_foreign(tmp_path / "run.txt", columns_of(swaying_log(), habits), habits)
    sensors = replace(robot.sensors, encoder_counts=round(robot.sensors.encoder_counts / times))
    proposal = propose(path, robot.replace(sensors=sensors), dead_band=0.0)
    (unit,) = (one for one in conclusions_of(proposal) if one.key == "[wheels] angle")
    assert not unit.determined
    offered = [float(one.split()[1]) for one in (unit.value, *unit.alternatives) if one.startswith("counts")]
    true = robot.sensors.encoder_counts * robot.drive.gear_ratio
    assert min(abs(one / true - 1.0) for one in offered) < 0.05


def test_without_heading_a_heading_pulse_is_requested(tmp_path):
    habits = Habits(yaw=False)
    columns = columns_of(swaying_log(heading=0.0), habits)
    turns = sum(columns[f"psi_{k}"] for k in (1, 2, 3)) / 3.0
    for turning, requested in ((True, False), (False, True)):
        still = {f"psi_{k}": columns[f"psi_{k}"] - turns for k in (1, 2, 3)}  # wheels of a heading that stays
        path = write_foreign(tmp_path / "run.txt", columns if turning else columns | still, habits)
        proposal = propose(path, small_robot(), dead_band=0.0)
        assert any(finding.code == "heading" for finding in findings_of(proposal)) == requested


def test_resets_restarts_and_garbage_are_seen(tmp_path):
    habits = Habits()
    columns = columns_of(swaying_log(), habits)
    later = np.arange(len(columns["t_now"])) >= len(columns["t_now"]) // 2
    columns["psi_2"] = columns["psi_2"] - 50.0 * later
    twice = {name: np.concatenate([values[:300], values]) for name, values in columns.items()}
    path = write_foreign(tmp_path / "run.txt", twice, habits, tail="1 2 3\nthe end\n")
    proposal = propose(path, small_robot(), dead_band=0.0)
    kinds = [finding.code for finding in findings_of(proposal)]
    assert {"reset", "time", "file"} <= set(kinds)
    assert proposal.rows == (301, 300 + len(columns["t_now"]))
    log = mapped(tmp_path, proposal)
    assert np.abs(np.diff(log["wheel2"])).max() < 0.5  # a jump of 50 rad is gone


def test_invalid_files_end_in_one_sentence(tmp_path):
    (tmp_path / "words.txt").write_text("this is\nnot a table\n")
    with pytest.raises(InputError, match="contains no table"):
        propose(tmp_path / "words.txt", small_robot(), dead_band=0.0)
    rows = "\n".join(f"{k} {0.01 * k} {np.sin(k)}" for k in range(200))
    (tmp_path / "other.txt").write_text("a b c\n" + rows)
    with pytest.raises(InputError, match="write a mapping file"):
        propose(tmp_path / "other.txt", small_robot(), dead_band=0.0)


def test_the_torque_free_gains_are_those_of_the_linear_model():
    """kappa and gamma against the linearised equations of motion under random torques: an independent way to them."""
    from ballbot import Model

    robot = small_robot()
    kappa, gamma = torque_free_gains(robot)
    linear, model = Model(robot).linearize(), Model(robot)
    x = 1e-4 * np.random.default_rng(0).standard_normal((50, 10))
    x[:, [4, 9]] = 0.0  # no heading: it is of second order
    u = 1e-4 * np.random.default_rng(1).standard_normal((50, 3))
    x_dot = x @ linear.A.T + u @ linear.B.T
    wheel_acceleration = np.array([model.wheel_speed(np.zeros(5), rate) for rate in x_dot[:, 5:]])
    W_dot = wheel_acceleration @ np.exp(1j * np.asarray(robot.wheels.azimuths))
    lean, lean_acceleration = x[:, 2] + 1j * x[:, 3], x_dot[:, 7] + 1j * x_dot[:, 8]
    np.testing.assert_allclose(lean_acceleration, kappa * lean + gamma * W_dot, atol=1e-9)


@pytest.mark.parametrize("about_world", [True, False])
def test_a_lean_about_the_worlds_axes_is_not_taken_for_a_turned_imu(tmp_path, about_world):
    """At a heading near half a turn, a lean about the world's axes looks like that of an IMU turned by half a turn."""
    log = swaying_log(heading=0.0)
    lean = (log["theta"] + 1j * log["phi"]) * (-1.0 if about_world else np.exp(-1j * log["psi"]))
    columns = {"time_s": log.t, "roll": lean.real, "pitch": lean.imag, "yaw": log["psi"] + np.pi}
    columns |= {f"enc_{k}_rad": log[f"wheel{k}"] for k in (1, 2, 3)}
    columns |= {f"torque{k}_Nm": log[f"u{k}"] for k in (1, 2, 3)}
    rows = np.column_stack(list(columns.values()))
    np.savetxt(tmp_path / "run.csv", rows, delimiter=",", header=",".join(columns), comments="")
    proposal = propose(tmp_path / "run.csv", small_robot())
    found = {one.name: one for one in conclusions_of(proposal)}["axes of the lean"]
    assert found.determined != about_world
    assert ("better" in found.evidence) != ("worse" in found.evidence)
    text = mapping_text(proposal, small_robot(), file=tmp_path / "run.csv")
    ready = [line[4:] for line in text.splitlines() if line.startswith("#   theta = ")]
    assert bool(ready) == about_world
    if about_world:
        lines = [
            line[4:] for line in text.splitlines() if line.startswith(("#   theta", "#   phi", "#   psi"))
        ]
        before, _, rest = text.replace("complete = false", "complete = true").partition("\n[attitude]")
        answered = before + "\n".join(lines) + "\n\n[wheels]" + rest.partition("\n[wheels]")[2]
        log = Log.read(tmp_path / "run.csv", mapping=parse_mapping(answered, source="answered"))
        np.testing.assert_allclose(log["phi"], np.interp(log.t, columns["time_s"], lean.imag), atol=1e-9)


@pytest.mark.parametrize("case", ["the IMU hangs upside down", "no wheel turns", "constants alone"])
def test_a_log_without_usable_rows_gives_no_numerical_warning(tmp_path, case):
    columns = columns_of(swaying_log(), Habits())
    if case == "the IMU hangs upside down":
        columns["theta_x"] = (columns["theta_x"] + 360.0) % 360.0 - 180.0
    else:
        columns |= {f"psi_{k}": 0.0 * columns["t_now"] for k in (1, 2, 3)}
    path = write_foreign(tmp_path / "run.txt", columns, Habits())
    if case == "constants alone":
        path = tmp_path / "run.npz"
        np.savez(path, Ts=np.array([0.005]))
    with warnings.catch_warnings(record=True) as given:
        warnings.simplefilter("always")
        with contextlib.suppress(InputError):
            evaluate(propose(path, small_robot()), small_robot(), file=path)
    assert [str(one.message) for one in given] == []


def renamed(folder, names: dict[str, str]) -> Proposal:
    """Return the proposal of a log some of whose columns have other names."""
    columns = columns_of(swaying_log(), Habits())
    path = write_foreign(
        folder / "run.txt", {names.get(name, name): values for name, values in columns.items()}, Habits()
    )
    return propose(path, small_robot(), dead_band=0.0)


def test_roll_and_pitch_whose_names_say_nothing_are_found_beside_wheels_whose_names_do(tmp_path):
    """Without them the log would be taken for one of wheels that turn free."""
    found = renamed(tmp_path, {"theta_x": "Kallistus", "theta_y": "Nousu", "theta_z": "Suunta"})
    assert found.roles.attitude == ("Kallistus", "Nousu", "Suunta")
    assert found.roles.angles == ("psi_1", "psi_2", "psi_3")
    assert found.roles.commands == ("u1", "u2", "u3")
    assert found.by_data


@pytest.mark.parametrize(
    ("name", "factor"), [("wheel{}_rpm", 60.0), ("wheel{}_vel", 60.0), ("wheel{}_vel", 2.0 * np.pi)]
)
def test_logged_speeds_that_agree_are_no_glitches_in_any_unit_of_time_and_speed(tmp_path, name, factor):
    columns = columns_of(swaying_log(), Habits())
    for k in (1, 2, 3):
        turns = columns[f"psi_{k}"] / (2.0 * np.pi)
        columns[name.format(k)] = factor * np.gradient(turns, columns["t_now"])
    columns["t_ms"] = 1e3 * columns.pop("t_now")

    def glitches():
        path = write_foreign(tmp_path / "run.txt", columns, Habits())
        found = propose(path, small_robot(), dead_band=0.0)
        assert found.roles.speeds == tuple(name.format(k) for k in (1, 2, 3))
        return [one for one in findings_of(found) if one.code == "glitch"]

    assert glitches() == []
    columns[name.format(1)][700:720] += 3.0 * factor  # 3 turns a second
    assert "in 20 rows" in glitches()[0].text


def test_columns_that_are_no_angles_by_their_names_are_never_taken_for_the_lean(tmp_path):
    found = renamed(tmp_path, {"theta_x": "acc_x", "theta_y": "acc_y", "theta_z": "acc_z"})
    assert found.roles.attitude == ()


def test_a_log_without_commands_says_so_with_the_columns_that_may_be(tmp_path):
    unused = renamed(tmp_path, {"u1": "foo_A", "u2": "foo_B", "u3": "foo_C"})
    assert unused.roles.commands == ()
    (found,) = [one for one in findings_of(unused) if "No column is recognised as a command" in one.text]
    assert found.severity == "warning"
    assert found.where.columns == ("foo_A", "foo_B", "foo_C")
    by_letters = renamed(tmp_path, {"u1": "pwm_A", "u2": "pwm_B", "u3": "pwm_C"})
    assert by_letters.roles.commands == ("pwm_A", "pwm_B", "pwm_C")


def test_columns_that_stand_still_in_most_rows_are_no_lean(tmp_path):
    """Eleven columns without names, of which two move for a moment: no crash, and no role by chance."""
    random = np.random.default_rng(3)
    rows = np.zeros((600, 11))
    rows[:, 0] = 0.01 * np.arange(600)
    rows[:, 6:9] = np.cumsum(random.standard_normal((600, 3)), axis=0)
    rows[300:310, 1:3] = random.standard_normal((10, 2))
    np.savetxt(tmp_path / "bare.txt", rows)
    with pytest.raises(InputError, match="cannot determine which columns"):
        propose(tmp_path / "bare.txt", small_robot())


@pytest.mark.parametrize(("per_ampere", "one_answer"), [(1.0, True), (0.95, True), (0.87, False)])
def test_kinds_that_make_nearly_the_same_log_are_one_answer(case, per_ampere, one_answer):
    proposal, _ = case("as the robot's")
    assert proposal.drive is not None
    torque, current = Unit("torque", "N m", 1.0), Unit("current", "A", 1.0)
    drive = replace(
        proposal.drive,
        units={torque: 0.6, current: 0.4},
        standstill={torque: 1.0, current: per_ampere},
    )
    found = {one.name: one for one in conclusions_of(replace(proposal, drive=drive))}
    asked = found["kind of the command"]
    assert asked.determined == one_answer
    assert (f"gives {per_ampere:.2f} times the torques" in asked.evidence) == one_answer


def test_a_time_of_seconds_and_nanoseconds_is_joined(tmp_path):
    columns = columns_of(swaying_log(), Habits())
    t = 1.7e9 + columns.pop("t_now")
    whole = np.floor(t)
    stamped = {"header.stamp.sec": whole, "header.stamp.nanosec": np.round(1e9 * (t - whole)), **columns}
    path = write_foreign(tmp_path / "run.txt", stamped, Habits())
    found = propose(path, small_robot(), dead_band=0.0)
    assert found.roles.time_parts == ("header.stamp.sec", "header.stamp.nanosec")
    assert (found.time.unit, found.rows) == ("s", None)
    log = mapped(tmp_path, found)
    assert t[0] <= log.t[0] < log.t[-1] <= t[-1]
    assert np.ptp(log.t) > 0.9 * np.ptp(t)


def test_rows_that_repeat_the_row_before_are_one(tmp_path):
    columns = columns_of(swaying_log(), Habits())
    once = propose(write_foreign(tmp_path / "run.txt", columns, Habits()), small_robot(), dead_band=0.0)
    log = mapped(tmp_path, once)
    twice = {name: np.repeat(values, 2) for name, values in columns.items()}
    found = propose(write_foreign(tmp_path / "run.txt", twice, Habits()), small_robot(), dead_band=0.0)
    assert found.rows is None
    assert any(
        "rows with the time and all values of the row before" in one.text for one in findings_of(found)
    )
    repeated = mapped(tmp_path, found)
    assert all(np.array_equal(log[name], repeated[name]) for name in log.names)


@pytest.mark.parametrize(
    ("name", "made", "sentence"),
    [
        ("dt_ms", lambda t: 1e3 * np.diff(t, prepend=t[0] - 0.01), "dt_ms seems to have the intervals"),
        ("ticks", lambda t: np.round(32768 * t), "ticks rises by "),
        ("sample", lambda t: np.arange(len(t)), "sample rises by 1 a row"),
    ],
)
def test_a_log_without_a_time_says_what_is_known_and_how_to_give_the_time(tmp_path, name, made, sentence):
    columns = columns_of(swaying_log(), Habits())
    names = {"theta_x": "roll", "theta_y": "pitch", "theta_z": "yaw"}
    table = {name: made(columns.pop("t_now"))}
    table |= {names.get(one, one): values for one, values in columns.items() if one != "i"}
    with pytest.raises(InputError, match="roll, pitch, yaw as the lean and psi_1") as refused:
        propose(write_foreign(tmp_path / "run.txt", table, Habits()), small_robot())
    assert sentence in str(refused.value)


def test_questions_without_alternatives_name_the_value_to_confirm():
    turn = Conclusion(
        name="turn of the IMU", value="3.0 deg", confidence=0.5, evidence="", error=12.0, unit="deg"
    )
    assert turn.question == "turn of the IMU (is it 3.0 deg, standard error 12 deg?)"


def test_a_unit_of_the_motor_and_one_that_the_name_has_are_said_once():
    angles = np.cumsum(np.random.default_rng(1).standard_normal((500, 3)), axis=0)
    found = list(wheel_units(angles, small_robot(), "deg"))
    assert [one.description for one in found if one.scale != 1.0][:1] == ["rad of the motor"]
    assert next(one.reason for one in found if one.unit == "deg") == "the name has the unit deg"


def test_a_log_of_four_wheels_for_a_robot_of_three_says_so(tmp_path):
    columns = columns_of(swaying_log(), Habits())
    columns["psi_4"] = -columns["psi_1"]
    path = write_foreign(tmp_path / "run.txt", columns, Habits())
    with pytest.raises(InputError, match=r"angles of 4 wheels \(psi_1, .*\), but the robot .* has 3"):
        propose(path, small_robot())


def test_two_identical_columns_are_named(tmp_path):
    columns = columns_of(swaying_log(), Habits())
    columns["psi_3"] = columns["psi_2"]
    found = propose(write_foreign(tmp_path / "run.txt", columns, Habits()), small_robot(), dead_band=0.0)
    asked = conclusions_of(found)[0]
    assert not asked.determined
    assert "psi_2 and psi_3, which are identical" in asked.question


def test_one_command_for_all_motors_is_no_copy(tmp_path):
    columns = columns_of(swaying_log(), Habits())
    columns |= {"u2": columns["u1"], "u3": columns["u1"]}
    found = propose(write_foreign(tmp_path / "run.txt", columns, Habits()), small_robot(), dead_band=0.0)
    assert "identical" not in conclusions_of(found)[0].question


@pytest.mark.parametrize(("size", "unit"), [(0.01, "rad"), (0.6, "deg"), (60.0, "mrad cdeg")])
def test_the_size_of_the_lean_shows_its_unit(size, unit):
    lean = size * np.random.default_rng(2).standard_normal((500, 2))
    found = lean_units(lean, None)
    assert max(found, key=lambda one: found[one]).unit in unit.split()
    named = lean_units(lean, "mrad")
    assert max(named, key=lambda one: named[one]).unit == "mrad"


@pytest.mark.parametrize("per", ["row", "second"])
def test_wheel_angles_that_are_increments_or_speeds_are_named_as_such(tmp_path, per):
    columns = columns_of(swaying_log(), Habits(counts=True))
    t = columns["t_now"]
    for k in (1, 2, 3):
        angle = columns[f"psi_{k}"]
        columns[f"psi_{k}"] = np.diff(angle, prepend=angle[0]) if per == "row" else np.gradient(angle, t)
    with pytest.raises(InputError, match="psi_1, psi_2, psi_3 are called wheel angles"):
        propose(write_foreign(tmp_path / "run.txt", columns, Habits()), small_robot())
