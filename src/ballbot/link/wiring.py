"""The wiring check: do the IMU's axes and the encoders agree with the robot's, before any motor is driven?

A person holds the robot on its ball, a foot against the ball, and turns it from upright about one axis after the other
(`ballbot.link.operators.MOVEMENTS`), as the firmware's self-test asks. The firmware compares attitude and gyro with
each movement. Here the encoders' turns are compared with those of their places: the wheels turn by -A r with the turn
r (3,) [rad] of the attitude, because the ball stands still.

The firmware's self-test then drives one motor after the other and compares each with its encoder. All together fix all
signs and orders: a motor and an encoder that are exchanged together pass the self-test, and the robot falls.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from ballbot.arrays import Floats
from ballbot.errors import InputError
from ballbot.findings import Finding, by_severity, error
from ballbot.firmware.records import SelfTestOutcome
from ballbot.link.live import LiveRobot
from ballbot.link.messages import State, wrapped
from ballbot.link.operators import MOVEMENTS, Movement, Operator
from ballbot.mechanics.geometry import rotation

#: a wrong scale is another number of counts or gear; a hand and a ball that rolls a little make less
_SCALE = (0.75, 1.33)
#: share of the encoders' turns that a still ball must explain
_EXPLAINED = 0.9
#: turn of a wheel by radian of the body below which an encoder is dead
_LEAST_WHEEL_TURN = 0.05


@dataclass(frozen=True, kw_only=True, eq=False)
class Turn:
    """What the sensors measured of one movement from upright."""

    movement: Movement
    attitude: Floats  #: (3,) rotation vector, body frame [rad]
    wheels: Floats  #: (n,) of the encoders [rad]


@dataclass(frozen=True, kw_only=True, eq=False)
class WiringCheck:
    """The result of a wiring check whose IMU passed."""

    turns: tuple[Turn, ...]
    wheel_scales: tuple[float, ...]  #: each encoder's turn over that of its place; NaN if it is another's
    findings: tuple[Finding, ...]  #: errors

    @property
    def passed(self) -> bool:
        """Whether nothing is wrong."""
        return not self.findings


def measure_turns(
    robot: LiveRobot,  # disarmed, and not checked since it was switched on
    operator: Operator,
    *,
    watch: Callable[[State], None],  # takes every state
) -> tuple[Turn, ...]:
    """Let the firmware check the IMU's axes, and return what the sensors measured of each movement.

    InputError if the robot is not moved within a minute, the IMU's axes are wrong or were checked before, the encoders
    give nothing, or the link is lost.
    """
    movements = list(MOVEMENTS.values())[1:]
    rests: list[State] = []  # the last state in each position that the firmware waited for, in order

    def take(state: State) -> None:
        watch(state)
        if state.self_test in MOVEMENTS:
            if not state.encoders_valid:
                raise InputError("The encoders of the robot give nothing; check the cable and the driver.")
            if rests and rests[-1].self_test == state.self_test:
                rests.pop()
            rests.append(state)

    try:
        outcome = robot.test(operator, motors=False, watch=take)
    except InputError as refusal:
        state = robot.session.state
        if state is None or state.self_test != SelfTestOutcome.IMU_AXES or len(rests) < 2:
            raise
        raise InputError(f"{refusal} It turned {_words_of(_turned(*rests[-2:]))}.") from None
    if outcome is not SelfTestOutcome.IMU_PASSED or len(rests) != 2 * len(movements):
        raise InputError(
            "The IMU's axes were checked before; switch the robot off and on to check the wiring again."
        )
    turns = []
    for movement, before, after in zip(movements, rests[::2], rests[1::2], strict=True):
        counts = wrapped(after.wheel_counts.astype(float) - before.wheel_counts)[: robot.wheel_count]
        wheels = robot.encoder_step * counts.astype(float)
        turns.append(Turn(movement=movement, attitude=_turned(before, after), wheels=wheels))
    return tuple(turns)


def _turned(before: State, after: State) -> Floats:
    """Return the turn of the attitude as a rotation vector (3,) [rad], body frame."""
    turn = rotation(*before.attitude.astype(float)).T @ rotation(*after.attitude.astype(float))
    return Rotation.from_matrix(turn).as_rotvec()


def _words_of(turn: Floats) -> str:
    """Return a turn in words, by the axis that it is mostly about."""
    axis = int(np.argmax(np.abs(turn)))
    ways = (("to the right", "to the left"), ("forward", "backward"), ("to the left", "to the right"))
    return f"{ways[axis][0 if turn[axis] > 0 else 1]} about {'xyz'[axis]}"


def check_turns(
    turns: Sequence[Turn],  # one about each axis
    ball_from_wheels: Floats,  # (3, n) T_obw of the robot
) -> WiringCheck:
    """Compare the encoders with the attitude of each movement."""
    wheels_from_ball = np.asarray(np.linalg.pinv(ball_from_wheels), dtype=np.float64)
    # a row for each movement, by radian, so that a large turn counts no more than a small one
    turned = np.array([turn.attitude / np.linalg.norm(turn.attitude) for turn in turns])
    measured = np.array([turn.wheels / np.linalg.norm(turn.attitude) for turn in turns])
    expected = -turned @ wheels_from_ball.T
    sizes = np.linalg.norm(expected, axis=0)
    products = measured.T @ expected / sizes**2  # encoder by place: its turn over that of the place
    correlations = products * sizes / np.maximum(np.linalg.norm(measured, axis=0), 1e-9)[:, None]
    scales, findings = [], []
    for encoder in range(measured.shape[1]):
        fault = _encoder_fault(encoder, correlations[encoder], products[encoder], measured[:, encoder])
        findings += [error("encoders", f"Encoder {encoder + 1} {fault}")] if fault else []
        scales.append(math.nan if fault else float(products[encoder, encoder]))
    return WiringCheck(turns=tuple(turns), wheel_scales=tuple(scales), findings=by_severity(findings))


def _encoder_fault(encoder: int, correlations: Floats, products: Floats, turned: Floats) -> str:
    """Return what is wrong with one encoder, in words that follow its name; empty if nothing is."""
    wheel = int(np.argmax(np.abs(correlations)))
    if float(np.abs(turned).max()) < _LEAST_WHEEL_TURN:
        return "did not count when the robot was turned; check its cable and supply."
    if abs(correlations[wheel]) < math.sqrt(_EXPLAINED):
        return (
            "did not turn as any wheel must: the ball rolled, or the wheel slipped. Hold the ball with a foot and "
            "repeat the check."
        )
    if wheel != encoder:
        return (
            f"turned as wheel {wheel + 1} must: exchange the cables, of motor and encoder alike, or correct the "
            "azimuths in the robot file."
        )
    if correlations[wheel] < 0.0:
        return (
            "counts backward: reverse it in ballbot_read_encoders. If the self-test then fails, reverse the motor as "
            "well."
        )
    if not _SCALE[0] < products[wheel] < _SCALE[1]:
        return (
            f"turned {products[wheel]:.2g} times as far as wheel {wheel + 1} must: correct encoder_counts or "
            "gear_ratio in the robot file, or count all four edges."
        )
    return ""
