"""How the file's wheels and IMU sit on the robot: order, signs, the IMU's turn and reversed axes.

The sign in which the wheels count comes from the heading, which turns all wheels alike:

    sum_i w_i = n (r_b / r_w) sin(alpha) (spin of the ball - psi_dot)

seen from the body. A ball spins less than the body that turns on it, or the other way, so that the sum goes against
psi_dot. Nothing else separates a log whose wheels all count backwards from one whose IMU is turned by half a turn.

A gyro beside the angles shows the handedness, too (`ballbot.log.mapping_inference.file_signals`).

The wheels' order and the turn of the IMU come from the test of their placement. A log follows
Theta_ddot = g e^(j phase) sum_i s_i w_i e^(j beta). Turned by -phase, the IMU's lean is the robot's. People mount IMUs
at usual angles, so that a measured turn is taken for a usual one where that is likelier. If lean and yaw
have opposite handedness, one axis of the IMU is reversed: pitch, if the wheels are then in the robot's order, else yaw.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ballbot.log.mapping_inference.evidence import MOST, TINY, advantage_confidence
from ballbot.log.mapping_inference.file_signals import GyroTest
from ballbot.log.mapping_inference.placement import LeanTest
from ballbot.log.signals import INTERVAL, Smooth
from ballbot.robot import Robot

#: a correlation r of n independent seconds is believed from this many of its standard errors, sqrt((1 - r^2) / n)
LEAST_CORRELATION = 2.5
#: lean and yaw are taken to be of the same handedness with this probability before the log is seen; chosen
SAME_HANDEDNESS, SAME_IF_MIRRORED = 0.85, 0.6
#: a heading that turns by less than this [rad] around its mean hardly shows the handedness: so much of the standard
#: errors is then believed. Of 142 logs of the development halves, 2 are wrong by two standard errors, both of such a
#: heading; of 603 logs whose heading turns more and whose placement is certain, none is wrong by one
STILL_HEADING, BELIEVED_IF_STILL = 0.02, 0.1
#: error of the handedness by the gyro beyond its jackknife, since noise of the angles makes it too small, and the
#: largest logarithm of its odds. Of 51 logs of the development halves, 3 give odds for the wrong one, of up to 2.3
HANDEDNESS_ERROR, MOST_BY_GYRO = 0.35, 6.0


@dataclass(frozen=True, kw_only=True)
class HeadingTest:
    """How the sum of the wheels' speeds follows the heading's rate."""

    correlation: float  #: negative if the wheels count as the robot's do
    gain: float  #: sum of the speeds over psi_dot, over that of a ball that does not pivot
    significant: bool  #: whether the log turns enough for a verdict
    confidence: float  #: in the sign of the correlation


def heading_test(robot: Robot, wheels: Smooth, heading: Smooth, tested: LeanTest) -> HeadingTest:
    """Compare the sum of the wheels' speeds with the heading's rate.

    Parameters
    ----------
    robot : Robot
    wheels : Smooth (N, n)
    heading : Smooth (N, 1)
    tested : LeanTest
        Says which wheels are reversed, and which rows are balancing.
    """
    rows = tested.balancing
    total = (wheels.rate @ np.asarray(tested.placements[0].signs, dtype=np.float64))[rows]
    rate = heading.rate[rows, 0]
    total, rate = total - total.mean(), rate - rate.mean()
    size = float(np.sqrt((total @ total) * (rate @ rate)))
    correlation = float(total @ rate) / size if size > 0.0 else 0.0
    wheel = robot.wheels
    without_pivoting = robot.wheel_count * robot.ball.radius / wheel.radius * np.sin(wheel.tilt)
    seconds = max(float(rows.sum()) * INTERVAL, 1.0)
    z = abs(correlation) * math.sqrt(seconds) / math.sqrt(max(1.0 - correlation**2, 0.01))
    return HeadingTest(
        correlation=correlation,
        gain=float(total @ rate / max(float(rate @ rate), TINY) / without_pivoting),
        significant=bool(z > LEAST_CORRELATION),
        confidence=advantage_confidence(z),
    )


#: turns of an IMU's x axis from the robot's [rad], and how usual they are: chosen, not measured; the rest is for others
USUAL_TURNS = {
    math.radians(turn): 0.3 if turn == 0 else 0.08 if turn % 90 == 0 else 0.02
    for turn in (-150, -135, -120, -90, -60, -45, -30, 0, 30, 45, 60, 90, 120, 135, 150, 180)
}
#: error of the turn that is harmless [rad]: a fifth of a lean appears in the other axis
TURN = math.radians(12.0)
#: error of a turn over the logarithm of the gain [rad]. Of 33 logs of the development halves whose gain is off by more
#: than a tenth, the root mean square is 0.095
TURN_PER_GAIN = 0.15
#: the turn's error over its jackknife: of 176 logs of the development halves, the turn of 2 is off by more than `TURN`
#: with a confidence above 0.9 at 1.5, and of none at 1.8
TURN_JACKKNIFE = 1.8


@dataclass(frozen=True, kw_only=True)
class Frame:
    """How the file's wheels and IMU sit on the robot."""

    order: tuple[int, ...]  #: for the robot's wheels in turn, the file's wheel (from 1)
    signs: tuple[int, ...]  #: of the file's wheels, in the file's order
    turn: float  #: of the IMU's x axis from the robot's [rad]: a usual one if that is likelier than the measured one
    measured_turn: float  #: [rad], as the log has it
    turn_confidence: float = 0.5  #: that the turn's error is harmless
    axis_signs: tuple[int, int, int] = (1, 1, 1)  #: of roll, pitch and yaw
    #: whether heading shows in which direction all wheels count, or it is assumed
    signs_by_heading: bool = False
    handedness: float = 1.0  #: confidence that no other axis of the IMU is reversed


def frame_of(
    robot: Robot, tested: LeanTest | None, heading: HeadingTest | None, gyro: GyroTest | None = None
) -> Frame:
    """Return the frame that the tests speak for; the robot's own if there is no lean to test."""
    count = robot.wheel_count
    own = tuple(range(1, count + 1))
    if tested is None:
        return Frame(order=own, signs=(1,) * count, turn=0.0, measured_turn=0.0)
    best, beta = tested.placements[0], robot.wheels.azimuths
    same = _same_handedness(tested, gyro, mirrored=best.mirrored)
    positions, phase, axes = best.positions, best.phase, (1, 1, 1)
    if same < 0.5:
        reflected = tuple((1 - place) % count + 1 for place in positions)
        if best.positions == own or reflected != own:
            axes = (1, 1, -1)
        else:
            positions, phase, axes = reflected, -phase - 2.0 * beta[0], (1, -1, 1)
    known = heading is not None and heading.significant
    # without heading, the smaller turn is the likelier
    backwards = axes[2] * heading.correlation > 0.0 if heading is not None and known else np.cos(phase) < 0.0
    signs = np.asarray(best.signs) * (-1 if backwards else 1)
    turn = -_within_half_a_turn(phase + (np.pi if backwards else 0.0))
    likeliest, confidence = likeliest_turn(turn, _turn_error(tested))
    return Frame(
        order=tuple(positions.index(place) + 1 for place in own),
        signs=tuple(int(sign) for sign in signs),
        turn=likeliest,
        measured_turn=turn,
        turn_confidence=confidence,
        axis_signs=axes,
        signs_by_heading=known,
        # without a heading that turns, the other handedness gives the same log
        handedness=max(same, 1.0 - same) if known else 0.97,
    )


def likeliest_turn(measured: float, error: float) -> tuple[float, float]:
    """Return the likeliest turn [rad] and the probability that it is right to `TURN`.

    Parameters
    ----------
    measured : float
        [rad]
    error : float
        Its standard error [rad]; infinite if it is not known.
    """
    if not math.isfinite(error):
        return measured, 0.5
    error = max(error, 1e-3)
    off = {turn: abs(_within_half_a_turn(measured - turn)) for turn in USUAL_TURNS}
    weights = {
        turn: usual * math.exp(-0.5 * min((off[turn] / error) ** 2, 1400.0))
        for turn, usual in USUAL_TURNS.items()
    }
    # any turn, evenly: most of it is beside the measured one
    any_turn = (1.0 - sum(USUAL_TURNS.values())) * error / math.sqrt(2.0 * math.pi)
    best = max(weights, key=lambda turn: weights[turn])
    likeliest = best if weights[best] > any_turn else measured
    away = abs(_within_half_a_turn(measured - likeliest))
    within = 0.5 * sum(math.erf((TURN + side * away) / (math.sqrt(2.0) * error)) for side in (-1.0, 1.0))
    right = any_turn * max(within, 0.0) + sum(
        weight for turn, weight in weights.items() if abs(_within_half_a_turn(turn - likeliest)) <= TURN
    )
    return likeliest, min(right / (any_turn + sum(weights.values())), MOST)


def _turn_error(tested: LeanTest) -> float:
    """Return the standard error of the turn [rad]: a gain that is not the robot's is a sign of another error, too."""
    if tested.phase_error is None:
        return math.inf
    own = TURN_PER_GAIN * abs(math.log(max(tested.placements[0].gain, 1e-3)))
    return math.hypot(TURN_JACKKNIFE * tested.phase_error, own)


def _same_handedness(tested: LeanTest, gyro: GyroTest | None, *, mirrored: bool) -> float:
    """Return the probability that lean and yaw have the same handedness."""
    prior = SAME_IF_MIRRORED if mirrored else SAME_HANDEDNESS
    believed = BELIEVED_IF_STILL if tested.headings < STILL_HEADING else 1.0
    seen = max(advantage_confidence(tested.same_handedness, believed=believed), 1.0 - MOST)
    odds = prior / (1.0 - prior) * seen / (1.0 - seen) * math.exp(_handedness_by_gyro(gyro))
    return odds / (1.0 + odds)


def _handedness_by_gyro(gyro: GyroTest | None) -> float:
    """Return the logarithm of the odds for one handedness that a gyro against the rates of the angles shows."""
    if gyro is None or not math.isfinite(gyro.handedness):
        return 0.0
    # of a normal estimate of 1 or -1
    odds = 2.0 * gyro.handedness / (gyro.handedness_error**2 + HANDEDNESS_ERROR**2)
    return min(max(odds, -MOST_BY_GYRO), MOST_BY_GYRO)


def _within_half_a_turn(angle: float) -> float:
    return float((angle + np.pi) % (2.0 * np.pi) - np.pi)
