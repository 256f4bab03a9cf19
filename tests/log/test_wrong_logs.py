"""Wrong but plausible logs are stopped, each with a sentence that names its likely cause; correct ones are not."""

from collections.abc import Sequence

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

TORQUES = ("u1", "u2", "u3")
WHEELS = ("wheel1", "wheel2", "wheel3")
SPEEDS = ("wheel1_dot", "wheel2_dot", "wheel3_dot")
GYRO = ("gyro_x", "gyro_y", "gyro_z")
LEAN = ("theta", "phi")
LEAN_RATES = ("theta_dot", "phi_dot")
PLACE = ("x", "y", "x_dot", "y_dot")
DEGREES = 180.0 / np.pi


def clipped(log: Log, share: float, *names: str) -> Log:
    """Return columns cut off at a share of their largest values."""
    peaks = {name: share * np.abs(log[name]).max() for name in names}
    return log.with_columns({name: np.clip(log[name], -peak, peak) for name, peak in peaks.items()})


def scaled(log: Log, factor: float, *names: str) -> Log:
    return log.with_columns({name: factor * log[name] for name in names})


def exchanged(log: Log, *pairs: tuple[str, str]) -> Log:
    return log.with_columns({a: log[b] for pair in pairs for a, b in (pair, pair[::-1])})


def renamed(log: Log, order: Sequence[int], *prefixes: str, suffix: str = "") -> Log:
    """Return the log whose wheel i has what was wheel order[i - 1]'s."""
    return log.with_columns(
        {f"{p}{i}{suffix}": log[f"{p}{k}{suffix}"] for p in prefixes for i, k in enumerate(order, start=1)}
    )


def late(log: Log, delay: float, *names: str) -> Log:
    return log.with_columns({name: np.interp(log.t - delay, log.t, log[name]) for name in names})


def with_time(log: Log, factor: float) -> Log:
    return log.with_columns({"t": factor * log.t})


def frozen(log: Log, start: float, end: float, *names: str) -> Log:
    """Return the log in which columns keep their value from one time to another [s]."""
    rows = np.flatnonzero((log.t >= start) & (log.t < end))
    columns = {name: log[name].copy() for name in names}
    for values in columns.values():
        values[rows] = values[rows[0]]
    return log.with_columns(columns)


def held(log: Log, rows: int, *names: str) -> Log:
    """Return the log in which columns change every so many rows only."""
    source = np.arange(len(log)) // rows * rows
    return log.with_columns({name: log[name][source] for name in names})


def spliced(log: Log, start: float, end: float, *shifted: str) -> Log:
    """Return the log without a stretch [s], its time closed up; of what the stretch changed, only `shifted` stays."""
    first, second = log.between(-1.0, start), log.between(end, 1e9)
    columns = {}
    for name in log:
        after = second[name]
        if name == "t":
            after = after - after[0] + first.t[-1] + log.sample_time
        elif name in POSITION_NAMES and name not in shifted:
            after = after - after[0] + first[name][-1]
        columns[name] = np.concatenate((first[name], after))
    return Log(columns)


def random_torques(log: Log, *names: str) -> Log:
    random = np.random.default_rng(0)
    return log.with_columns({name: 0.5 * random.standard_normal(len(log)) for name in names or TORQUES})


def everything(log: Log) -> tuple[str, ...]:
    return tuple(name for name in log if name != "t" and not name.startswith("ref_"))


def constant(log: Log, value: float, *names: str) -> Log:
    return log.with_columns({name: np.full(len(log), value) for name in names})


def shifted(log: Log, offset: float, *names: str) -> Log:
    return log.with_columns({name: log[name] + offset for name in names})


def turned_imu(log: Log, angle: float) -> Log:
    """Return the log of an IMU that is mounted turned by an angle [degrees] about the vertical; the gyro left out."""
    turn = np.exp(1j * np.radians(angle))
    columns = {}
    for first, second in (LEAN, LEAN_RATES):
        turned = (log[first] + 1j * log[second]) * turn
        columns |= {first: turned.real, second: turned.imag}
    return Log({name: columns.get(name, log[name]) for name in log if name not in GYRO})


def reversed_rows(log: Log) -> Log:
    return log.with_columns({name: log[name][::-1] for name in log if name != "t"})


def mirrored(log):
    return renamed(renamed(log, (1, 3, 2), "u", "wheel"), (1, 3, 2), "wheel", suffix="_dot")


#: code and words of the finding, and the mistake of which they are
WRONG_LOGS = [
    ("dead-motor", "u2 is 0 N m", lambda log: scaled(log, 0.0, "u2")),
    ("dead-motor", "not recorded", lambda log: constant(log, 0.3, *TORQUES)),
    ("torque-sign", "all torques have the opposite sign", lambda log: scaled(log, -1.0, *TORQUES)),
    ("torque-sign", "u1 has the opposite sign", lambda log: scaled(log, -1.0, "u1")),
    ("torque-order", "u1 and u2 are swapped", lambda log: exchanged(log, ("u1", "u2"))),
    ("torque-order", "another order", lambda log: renamed(log, (2, 3, 1), "u")),
    ("torque-scale", "scaled", lambda log: scaled(log, 2.0, *TORQUES)),
    ("torque-scale", "the recording clips them", lambda log: clipped(log, 0.3, *TORQUES)),
    ("torque-scale", "gear ratio", lambda log: scaled(log, 1.0 / 27.6, *TORQUES)),
    ("torque-delay", "50 ms too late", lambda log: late(log, 0.05, *TORQUES)),
    ("torque-unrelated", "u1, u2 and u3:", random_torques),
    ("torque-unrelated", "u2:", lambda log: random_torques(log, "u2")),
    (
        "lean-axes",
        "theta and phi are swapped, with their rates",
        lambda log: exchanged(log, LEAN, LEAN_RATES),
    ),
    ("lean-axes", "theta and phi are swapped", lambda log: exchanged(log, LEAN)),
    ("lean-axes", "theta has the opposite sign, with", lambda log: scaled(log, -1.0, "theta", "theta_dot")),
    ("lean-axes", "theta and phi have the opposite", lambda log: scaled(log, -1.0, *LEAN, *LEAN_RATES)),
    ("lean-axes", "theta has the opposite sign.", lambda log: scaled(log, -1.0, "theta")),
    ("lean-axes", "degrees to the right", lambda log: turned_imu(log, 30.0)),
    ("degrees", "theta is in degrees", lambda log: scaled(log, DEGREES, *LEAN)),
    ("degrees", "theta_dot is in degrees", lambda log: scaled(log, DEGREES, *LEAN_RATES)),
    ("lean-offset", "IMU is mounted at an angle", lambda log: shifted(log, np.radians(5.0), "theta")),
    ("constant", "theta is 0 throughout", lambda log: constant(log, 0.0, "theta")),
    ("sign", "psi and psi_dot have opposite signs", lambda log: scaled(log, -1.0, "psi")),
    ("sign", "gyro_x", lambda log: scaled(log, -1.0, *GYRO)),
    ("swapped", "gyro_x and gyro_y are swapped", lambda log: exchanged(log, ("gyro_x", "gyro_y"))),
    (
        "heading-sign",
        "psi has the opposite sign, with its rate",
        lambda log: scaled(log, -1.0, "psi", "psi_dot", "gyro_z"),
    ),
    ("ball-axes", "x and y are swapped, with", lambda log: exchanged(log, ("x", "y"), ("x_dot", "y_dot"))),
    ("scale", "x is in mm, not in m", lambda log: scaled(log, 1000.0, "x", "y")),
    ("lean-scale", "wheel radius, ball radius, gear ratio", lambda log: scaled(log, 1.25, *PLACE)),
    ("wheels", "1.25", lambda log: scaled(log, 1.25, *WHEELS, *SPEEDS)),
    ("wheels", "in rpm, not in rad/s", lambda log: scaled(log, 60.0 / (2.0 * np.pi), *SPEEDS)),
    ("wheels", "order = [1, 3, 2]", mirrored),
    ("encoders", "1 wheel (1) in the opposite", lambda log: scaled(log, -1.0, "wheel1", "wheel1_dot")),
    ("time-scale", "t is in ms, not in seconds", lambda log: with_time(log, 1000.0)),
    ("time-scale", "reverse order of time", reversed_rows),
    ("stuck", "theta, phi", lambda log: frozen(log, 4.0, 5.5, *everything(log))),
    ("stuck", "phi: one value", lambda log: frozen(log, 4.0, 5.0, "phi")),
    ("stuck", "u1, u2, u3: one value", lambda log: frozen(log, 3.0, 5.0, *TORQUES)),
    ("jump", "x jumps", lambda log: spliced(log, 5.0, 8.0, "x")),
    ("held", "every 20 rows", lambda log: held(log, 20, *STATE_NAMES)),
    ("held", "every 2 rows", lambda log: held(log, 2, *everything(log))),
]


class Correct:
    """Two runs of the nominal twin, of 14 s around a square and a circle; in the first the heading turns."""

    def __init__(self) -> None:
        self.robot = Robot.load("alten")

        def turning(t: float) -> np.ndarray:
            pose = np.array(square(side=0.6, period=12.0)(t))
            pose[4] = 0.8 * np.sin(0.7 * t)
            return pose

        self.log, self.other = (
            simulate(
                Twin(self.robot), nominal_controller(self.robot), one, duration=14.0, seed=seed
            ).without_truth()
            for seed, one in ((1, turning), (2, circle(radius=0.4, period=10.0)))
        )


@pytest.fixture(scope="module")
def correct() -> Correct:
    return Correct()


def errors(correct, log):
    return [one for one in check_logs({"run.csv": log}, robot=correct.robot) if one.severity == "error"]


def check_sentence(correct, log, code, words):
    found = errors(correct, log)
    assert any(one.code == code and words in one.text for one in found), found


@pytest.mark.parametrize(
    ("code", "words", "spoil"), WRONG_LOGS, ids=[f"{row[0]}: {row[1]}" for row in WRONG_LOGS]
)
def test_wrong_log_gets_the_sentence_that_names_its_cause(correct, code, words, spoil):
    check_sentence(correct, spoil(correct.log), code, words)


def test_wrong_log_of_two_gets_the_sentence_that_names_its_cause(correct):
    torques = {name: correct.other[name] for name in TORQUES}
    check_sentence(correct, correct.log.with_columns(torques), "torque-unrelated", "another log")
    check_sentence(correct, scaled(correct.other, 2.0, "u2"), "torque-scale", "as large as the other torques")
    a_turn = correct.robot.sensors.encoder_counts * correct.robot.drive.gear_ratio
    counts = scaled(correct.log, a_turn / (2.0 * np.pi), *WHEELS, *SPEEDS)
    check_sentence(correct, counts, "wheels", "encoder counts")


@pytest.mark.parametrize(
    ("columns", "factor", "code"),
    [
        (PLACE, 0.6, "lean-scale"),
        (PLACE, 1.4, "lean-scale"),
        (("theta",), -1.0, "lean-axes"),
        (("phi",), -1.0, "lean-axes"),
        (("theta_dot",), -1.0, "lean-axes"),
        (LEAN, -1.0, "lean-axes"),
        ((*SPEEDS, *WHEELS), 0.8, "wheels"),
    ],
)
def test_one_cause_gets_one_error(correct, columns, factor, code):
    (error,) = errors(correct, scaled(correct.log, factor, *columns))
    assert error.code == code
    assert set(error.where.columns) >= {name for name in columns if name not in WHEELS}


def test_correct_logs_are_not_stopped(correct):
    assert errors(correct, correct.log) == []
    assert errors(correct, correct.other) == []
