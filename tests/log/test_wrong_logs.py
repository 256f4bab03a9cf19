"""Wrong but plausible logs are stopped, each with a sentence that names its likely cause; correct ones are not."""

from collections.abc import Callable, Sequence

import numpy as np
import pytest

from ballbot.control.presets import nominal_controller
from ballbot.control.references import circle, square
from ballbot.log import STATE_NAMES, Log
from ballbot.log.checks import check_logs
from ballbot.log.columns import POSITION_NAMES
from ballbot.robot import Robot
from ballbot.simulation.run import simulate
from ballbot.twin import Twin

TORQUES, WHEELS = ("u1", "u2", "u3"), ("wheel1", "wheel2", "wheel3")
SPEEDS, GYRO = tuple(f"{name}_dot" for name in WHEELS), ("gyro_x", "gyro_y", "gyro_z")
LEAN, LEAN_RATES = ("theta", "phi"), ("theta_dot", "phi_dot")
PLACE = ("x", "y", "x_dot", "y_dot")
DEGREES = 180.0 / np.pi
ROBOT = Robot.load("alten")
COUNTS = ROBOT.sensors.encoder_counts * ROBOT.drive.gear_ratio / (2.0 * np.pi)  # of a radian

Spoil = Callable[[Log], Log]


def everything(log: Log) -> tuple[str, ...]:
    return tuple(name for name in log if name != "t" and not name.startswith("ref_"))


def each(change: Callable[[Log, np.ndarray], np.ndarray], *names: str) -> Spoil:
    """Return the mistake that changes each of these columns; all but references without names."""
    return lambda log: log.with_columns({name: change(log, log[name]) for name in names or everything(log)})


def scaled(factor: float, *names: str) -> Spoil:
    return each(lambda _, values: factor * values, *names)


def constant(value: float, *names: str) -> Spoil:
    return each(lambda log, _: np.full(len(log), value), *names)


def frozen(start: float, end: float, *names: str) -> Spoil:
    """Return the mistake of columns that keep their value from one time to another [s]."""

    def stop(log: Log, values: np.ndarray) -> np.ndarray:
        rows = (log.t >= start) & (log.t < end)
        return np.where(rows, values[rows][0], values)

    return each(stop, *names)


def held(rows: int, *names: str) -> Spoil:
    """Return the mistake of columns that change every so many rows only."""
    return each(lambda log, values: values[np.arange(len(log)) // rows * rows], *names)


def unrelated(*names: str) -> Spoil:
    random = np.random.default_rng(0)
    return each(lambda log, _: 0.5 * random.standard_normal(len(log)), *names)


def exchanged(*pairs: tuple[str, str]) -> Spoil:
    return lambda log: log.with_columns({a: log[b] for pair in pairs for a, b in (pair, pair[::-1])})


def renumbered(order: Sequence[int], *patterns: str) -> Spoil:
    """Return the mistake of columns of wheel i that have what was wheel order[i - 1]'s."""
    names = [(one.format(i), one.format(k)) for one in patterns for i, k in enumerate(order, start=1)]
    return lambda log: log.with_columns({name: log[other] for name, other in names})


def spliced(log: Log) -> Log:
    """Return the log without 5 to 8 s, its time closed up; of what these changed, only x stays."""
    first, second = log.between(-1.0, 5.0), log.between(8.0, 1e9)
    columns = {}
    for name in log:
        after = second[name]
        if name == "t":
            after = after - after[0] + first.t[-1] + log.sample_time
        elif name in POSITION_NAMES and name != "x":
            after = after - after[0] + first[name][-1]
        columns[name] = np.concatenate((first[name], after))
    return Log(columns)


def with_turned_imu(log: Log) -> Log:
    """Return the log of an IMU that is mounted turned by 30 degrees about the vertical; the gyro left out."""
    columns = {}
    for first, second in (LEAN, LEAN_RATES):
        turned = (log[first] + 1j * log[second]) * np.exp(1j * np.radians(30.0))
        columns |= {first: turned.real, second: turned.imag}
    return Log({name: columns.get(name, log[name]) for name in log if name not in GYRO})


#: code of the finding with what names the cause, and the mistake
WRONG_LOGS: list[tuple[str, str, Spoil]] = [
    ("dead-motor", "u2 is 0 N m", constant(0.0, "u2")),
    ("dead-motor", "u1 is 0.3 N m", constant(0.3, *TORQUES)),
    ("torque-sign", "u1, u2 and u3 have", scaled(-1.0, *TORQUES)),
    ("torque-sign", "u1 has", scaled(-1.0, "u1")),
    ("torque-order", "u1 drives wheel 2, u2 drives wheel 1", exchanged(("u1", "u2"))),
    ("torque-order", "u1 drives wheel 2, u2 drives wheel 3", renumbered((2, 3, 1), "u{}")),
    ("torque-scale", "2", scaled(2.0, *TORQUES)),
    ("torque-scale", "clips", each(lambda _, u: u.clip(0.2 * -abs(u).max(), 0.2 * abs(u).max()), *TORQUES)),
    ("torque-scale", "gear ratio", scaled(1.0 / 27.6, *TORQUES)),
    ("torque-delay", "50 ms too late", each(lambda log, u: np.interp(log.t - 0.05, log.t, u), *TORQUES)),
    ("torque-unrelated", "u1, u2 and u3:", unrelated(*TORQUES)),
    ("torque-unrelated", "u2:", unrelated("u2")),
    ("lean-axes", "theta and phi are swapped, with their rates", exchanged(LEAN, LEAN_RATES)),
    ("lean-axes", "theta and phi are swapped", exchanged(LEAN)),
    ("lean-axes", "theta has the opposite sign, with its rate", scaled(-1.0, "theta", "theta_dot")),
    ("lean-axes", "theta and phi have the opposite sign", scaled(-1.0, *LEAN, *LEAN_RATES)),
    ("lean-axes", "theta has the opposite sign.", scaled(-1.0, "theta")),
    ("lean-axes", "degrees to the right", with_turned_imu),
    ("degrees", "theta looks like deg,", scaled(DEGREES, *LEAN)),
    ("degrees", "theta_dot looks like deg/s", scaled(DEGREES, *LEAN_RATES)),
    ("lean-offset", "IMU is mounted at an angle", each(lambda _, values: values + np.radians(5.0), "theta")),
    ("constant", "theta is 0", constant(0.0, "theta")),
    ("sign", "psi and psi_dot", scaled(-1.0, "psi")),
    ("sign", "gyro_x", scaled(-1.0, *GYRO)),
    ("swapped", "gyro_x and gyro_y", exchanged(("gyro_x", "gyro_y"))),
    ("heading-sign", "psi has the opposite sign, with its rate", scaled(-1.0, "psi", "psi_dot", "gyro_z")),
    ("ball-axes", "x and y are swapped, with their rates", exchanged(("x", "y"), ("x_dot", "y_dot"))),
    ("scale", "x looks like mm", scaled(1000.0, "x", "y")),
    ("scale", "its running sum does", each(lambda _, angle: np.diff(angle, prepend=angle[:1]), *WHEELS)),
    ("lean-scale", "wheel radius, ball radius", scaled(1.25, *PLACE)),
    ("lean-scale", "y_dot look like mm", scaled(1000.0, *PLACE)),
    ("wheels", "1.25", scaled(1.25, *WHEELS, *SPEEDS)),
    ("wheels", "in rpm", scaled(60.0 / (2.0 * np.pi), *SPEEDS)),
    ("wheels", "encoder counts", scaled(COUNTS, *WHEELS, *SPEEDS)),
    ("wheels", "order = [1, 3, 2]", renumbered((1, 3, 2), "u{}", "wheel{}", "wheel{}_dot")),
    ("encoders", "1 wheel (1)", scaled(-1.0, "wheel1", "wheel1_dot")),
    ("time-scale", "t is in ms", scaled(1000.0, "t")),
    ("time-scale", "reverse order", each(lambda _, values: values[::-1])),
    ("stuck", "theta, phi", frozen(4.0, 5.5)),
    ("stuck", "phi: one value", frozen(4.0, 5.0, "phi")),
    ("stuck", "u1, u2, u3: one value", frozen(3.0, 5.0, *TORQUES)),
    ("jump", "x jumps", spliced),
    ("held", "every 20 rows", held(20, *STATE_NAMES)),
    ("held", "every 2 rows", held(2)),
]


@pytest.fixture(scope="module")
def logs() -> tuple[Log, Log]:
    """Return two runs of the nominal twin, of 14 s around a square and a circle; in the first the heading turns."""

    def turning(t: float) -> np.ndarray:
        pose = np.array(square(side=0.6, period=12.0)(t))
        pose[4] = 0.8 * np.sin(0.7 * t)
        return pose

    first, second = (
        simulate(Twin(ROBOT), nominal_controller(ROBOT), one, duration=14.0, seed=seed).without_truth()
        for seed, one in ((1, turning), (2, circle(radius=0.4, period=10.0)))
    )
    return first, second


def errors(log: Log) -> list[tuple[str, str, set[str]]]:
    found = check_logs({"run.csv": log}, robot=ROBOT)
    return [(one.code, one.text, {*one.where.columns}) for one in found if one.severity == "error"]


@pytest.mark.parametrize(
    ("code", "words", "spoil"), WRONG_LOGS, ids=[f"{code}: {words}" for code, words, _ in WRONG_LOGS]
)
def test_wrong_log_gets_the_sentence_that_names_its_cause(logs, code, words, spoil):
    found = errors(spoil(logs[0]))
    assert any(one == code and words in text for one, text, _ in found), found


def test_torques_of_another_log_or_of_another_motor_are_named(logs):
    log, other = logs
    of_another = errors(log.with_columns({name: other[name] for name in TORQUES}))
    of_one_motor = errors(scaled(2.0, "u2")(other))
    assert [(code, columns) for code, _, columns in of_another] == [("torque-unrelated", {*TORQUES})]
    assert [(code, columns) for code, _, columns in of_one_motor] == [("torque-scale", {"u2"})]


@pytest.mark.parametrize(
    ("columns", "factor", "code"),
    [
        (PLACE, 0.6, "lean-scale"),
        (PLACE, 1.4, "lean-scale"),
        (("phi",), -1.0, "lean-axes"),
        (("theta_dot",), -1.0, "lean-axes"),
        ((*SPEEDS, *WHEELS), 0.8, "wheels"),
    ],
)
def test_one_cause_gets_one_error(logs, columns, factor, code):
    ((found, _, places),) = errors(scaled(factor, *columns)(logs[0]))
    assert found == code
    assert places >= {name for name in columns if name not in WHEELS}


def test_correct_logs_are_not_stopped(logs):
    assert [errors(log) for log in logs] == [[], []]
