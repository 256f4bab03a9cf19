"""Wrong but plausible logs are stopped, each with a sentence that names its likely cause; correct ones are not."""

import numpy as np
import pytest

from ballbot.log import STATE_NAMES
from ballbot.log.checks import check_logs
from tests.support.wrong_log_examples import (
    DEGREES,
    GYRO,
    LEAN,
    LEAN_RATES,
    PLACE,
    SPEEDS,
    TORQUES,
    WHEELS,
    CorrectLogs,
    clipped,
    constant,
    everything,
    exchanged,
    frozen,
    held,
    late,
    motor_counts,
    random_torques,
    record,
    renamed,
    reversed_rows,
    rounded,
    scaled,
    shifted,
    spliced,
    turned_imu,
    with_time,
)


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
    ("coarse", "theta comes in steps", lambda log: rounded(log, np.radians(2.0), *LEAN)),
    ("constant", "theta is 0 throughout", lambda log: constant(log, 0.0, "theta")),
    ("sign", "psi and psi_dot have opposite signs", lambda log: scaled(log, -1.0, "psi")),
    ("sign", "gyro_x", lambda log: scaled(log, -1.0, *GYRO)),
    ("swapped", "gyro_x and gyro_y are swapped", lambda log: exchanged(log, ("gyro_x", "gyro_y"))),
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


@pytest.fixture(scope="module")
def correct() -> CorrectLogs:
    return record()


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
    counts = scaled(correct.log, motor_counts(correct.robot), *WHEELS, *SPEEDS)
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
