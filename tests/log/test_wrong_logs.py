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
    WrongLog,
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


def wrong(spoil, code, *words):
    """Return a row of the table; `spoil` takes the first correct log."""
    return WrongLog(spoil=lambda correct: spoil(correct.log), code=code, words=words)


WRONG_LOGS = {
    "dead motor": wrong(lambda log: scaled(log, 0.0, "u2"), "dead-motor", "u2 is 0 N m"),
    "all torques constant": wrong(lambda log: constant(log, 0.3, *TORQUES), "dead-motor", "not recorded"),
    "all torques negated": wrong(
        lambda log: scaled(log, -1.0, *TORQUES), "torque-sign", "all torques have the opposite sign"
    ),
    "one torque negated": wrong(
        lambda log: scaled(log, -1.0, "u1"), "torque-sign", "u1 has the opposite sign"
    ),
    "two torques swapped": wrong(
        lambda log: exchanged(log, ("u1", "u2")), "torque-order", "u1 and u2 are swapped"
    ),
    "torques moved on by one wheel": wrong(
        lambda log: renamed(log, (2, 3, 1), "u"), "torque-order", "another order"
    ),
    "torques doubled": wrong(lambda log: scaled(log, 2.0, *TORQUES), "torque-scale", "scaled"),
    "one torque doubled": WrongLog(
        spoil=lambda correct: scaled(correct.other, 2.0, "u2"),
        code="torque-scale",
        words=("times as large as the other torques",),
    ),
    "torques clipped to a third": wrong(
        lambda log: clipped(log, 0.3, *TORQUES), "torque-scale", "the recording clips them"
    ),
    "torques of the motors' side": wrong(
        lambda log: scaled(log, 1.0 / 27.6, *TORQUES), "torque-scale", "gear ratio"
    ),
    "torques 50 ms late": wrong(lambda log: late(log, 0.05, *TORQUES), "torque-delay", "50 ms too late"),
    "random torques": wrong(random_torques, "torque-unrelated", "u1, u2 and u3:"),
    "one random torque": wrong(lambda log: random_torques(log, "u2"), "torque-unrelated", "u2:"),
    "torques of another log": WrongLog(
        spoil=lambda correct: correct.log.with_columns({name: correct.other[name] for name in TORQUES}),
        code="torque-unrelated",
        words=("another log",),
    ),
    "theta and phi swapped": wrong(
        lambda log: exchanged(log, ("theta", "phi"), ("theta_dot", "phi_dot")),
        "lean-axes",
        "theta and phi are swapped, with their rates",
    ),
    "angles swapped, rates not": wrong(
        lambda log: exchanged(log, ("theta", "phi")), "lean-axes", "theta and phi are swapped"
    ),
    "theta negated": wrong(
        lambda log: scaled(log, -1.0, "theta", "theta_dot"), "lean-axes", "theta has the opposite sign"
    ),
    "lean negated": wrong(
        lambda log: scaled(log, -1.0, *LEAN, *LEAN_RATES), "lean-axes", "theta and phi have the opposite sign"
    ),
    "theta negated, its rate not": wrong(
        lambda log: scaled(log, -1.0, "theta"), "lean-axes", "theta has the opposite sign."
    ),
    "IMU turned by 30 degrees": wrong(lambda log: turned_imu(log, 30.0), "lean-axes", "degrees to the right"),
    "lean in degrees": wrong(lambda log: scaled(log, DEGREES, *LEAN), "degrees", "theta is in degrees"),
    "lean rates in degrees a second": wrong(
        lambda log: scaled(log, DEGREES, *LEAN_RATES), "degrees", "theta_dot is in degrees"
    ),
    "lean with a bias of 5 degrees": wrong(
        lambda log: shifted(log, np.radians(5.0), "theta"), "lean-offset", "IMU is mounted at an angle"
    ),
    "lean in steps of 2 degrees": wrong(
        lambda log: rounded(log, np.radians(2.0), *LEAN), "coarse", "theta comes in steps"
    ),
    "dead lean sensor": wrong(lambda log: constant(log, 0.0, "theta"), "constant", "theta is 0 throughout"),
    "psi negated": wrong(lambda log: scaled(log, -1.0, "psi"), "sign", "psi and psi_dot have opposite signs"),
    "gyro negated": wrong(lambda log: scaled(log, -1.0, *GYRO), "sign", "gyro_x"),
    "gyro axes swapped": wrong(
        lambda log: exchanged(log, ("gyro_x", "gyro_y")), "swapped", "gyro_x and gyro_y are swapped"
    ),
    "x and y swapped": wrong(
        lambda log: exchanged(log, ("x", "y"), ("x_dot", "y_dot")),
        "ball-axes",
        "x and y are swapped, with their rates",
    ),
    "place in mm": wrong(lambda log: scaled(log, 1000.0, "x", "y"), "scale", "x is in mm, not in m"),
    "place by wheels of another radius": wrong(
        lambda log: scaled(log, 1.25, *PLACE), "lean-scale", "wheel radius, ball radius, gear ratio"
    ),
    "wheels 20 % smaller": wrong(lambda log: scaled(log, 1.25, *WHEELS, *SPEEDS), "wheels", "1.25"),
    "wheel speeds in rpm": wrong(
        lambda log: scaled(log, 60.0 / (2.0 * np.pi), *SPEEDS), "wheels", "in rpm, not in rad/s"
    ),
    "encoder counts left as they are": WrongLog(
        spoil=lambda correct: scaled(correct.log, motor_counts(correct.robot), *WHEELS, *SPEEDS),
        code="wheels",
        words=("encoder counts",),
    ),
    "one wheel counts backwards": wrong(
        lambda log: scaled(log, -1.0, "wheel1", "wheel1_dot"),
        "encoders",
        "1 wheel (1) in the opposite direction",
    ),
    "wheels and torques in mirrored order": wrong(
        lambda log: renamed(renamed(log, (1, 3, 2), "u", "wheel"), (1, 3, 2), "wheel", suffix="_dot"),
        "wheels",
        "order = [1, 3, 2]",
    ),
    "time in ms": wrong(lambda log: with_time(log, 1000.0), "time-scale", "t is in ms, not in seconds"),
    "rows in reverse": wrong(reversed_rows, "time-scale", "reverse order of time"),
    "frozen for 1.5 s": wrong(lambda log: frozen(log, 4.0, 5.5, *everything(log)), "stuck", "theta, phi"),
    "phi frozen for 1 s": wrong(lambda log: frozen(log, 4.0, 5.0, "phi"), "stuck", "phi: one value"),
    "all torques frozen for 2 s": wrong(
        lambda log: frozen(log, 3.0, 5.0, *TORQUES), "stuck", "u1, u2, u3: one value"
    ),
    "joined with a jump of x": wrong(lambda log: spliced(log, 5.0, 8.0, "x"), "jump", "x jumps"),
    "states at 10 Hz, held": wrong(lambda log: held(log, 20, *STATE_NAMES), "held", "every 20 rows"),
    "every second row repeated": wrong(lambda log: held(log, 2, *everything(log)), "held", "every 2 rows"),
}


@pytest.fixture(scope="module")
def correct() -> CorrectLogs:
    return record()


def errors(correct, log):
    return [one for one in check_logs({"run.csv": log}, robot=correct.robot) if one.severity == "error"]


@pytest.mark.parametrize("name", WRONG_LOGS)
def test_wrong_log_gets_the_sentence_that_names_its_cause(correct, name):
    row = WRONG_LOGS[name]
    found = errors(correct, row.spoil(correct))
    sentences = [one.text for one in found if one.code == row.code]
    assert any(all(word in text for word in row.words) for text in sentences), found


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
