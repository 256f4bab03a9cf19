"""How the file's wheels and IMU sit on the robot: order, signs, the IMU's turn and reversed axes.

The sign in which the wheels count comes from the heading, which turns all wheels alike:

    sum_i w_i = n (r_b / r_w) sin(alpha) (spin of the ball - psi_dot)

seen from the body. A ball spins less than the body that turns on it, or the other way, so that the sum goes against
psi_dot. Without a heading, the frame in which the lean turns shows it (`placement`). Nothing else separates a log whose
wheels all count backwards from one whose IMU is turned by half a turn.

The wheels' order and the turn of the IMU come from the test of their placement. A log follows
Theta_ddot = g e^(j phase) sum_i s_i w_i e^(j beta). Turned by -phase, the IMU's lean is the robot's. If lean and yaw
have opposite handedness, one axis of the IMU is reversed: pitch, if the wheels are then in the robot's order, else yaw.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ballbot.log.mapping_search.evidence import CONFIDENT, MOST, TINY, advantage_confidence
from ballbot.log.mapping_search.placement import LeanTest
from ballbot.log.signals import INTERVAL, Smooth
from ballbot.robot import Robot

#: lean and yaw are taken to be of the same handedness with this probability before the log is seen
SAME_HANDEDNESS, SAME_IF_MIRRORED = 0.95, 0.6
#: weight of the standard errors of the handedness, and of a heading that turns by less than this [rad]
HANDEDNESS_WEIGHT, STILL_HEADING, STILL_WEIGHT = 0.8, 0.02, 0.3
#: correlation of the wheels' sum and the heading's rate at which their ratio is the wheels' unit
FOLLOWS = 0.9
#: a heading by the wheels that turns by less than this [rad]: both directions in which all wheels may count make nearly
#: the same log, and this is the confidence in either
TURNING_BY_WHEELS, EQUAL_DIRECTIONS = 0.1, 0.95
#: people mount IMUs at multiples of this [rad]; a turn this near to one, within its errors, is taken for it
GRID, ROUNDED, ROUNDED_ERRORS = np.pi / 6.0, np.deg2rad(6.0), 2.5


@dataclass(frozen=True, kw_only=True)
class HeadingTest:
    """How the sum of the wheels' speeds follows the heading's rate."""

    correlation: float  #: negative if the wheels count as the robot's do
    gain: float  #: size of the sum of the speeds over psi_dot, over that of a ball that does not pivot
    confidence: float  #: in the sign of the correlation

    @property
    def turning(self) -> float | None:
        """The gain; None if the wheels do not plainly follow the heading."""
        return self.gain if abs(self.correlation) > FOLLOWS and self.confidence >= CONFIDENT else None


def heading_test(robot: Robot, wheels: Smooth, heading: Smooth, tested: LeanTest) -> HeadingTest:
    """Compare the sum of the wheels' speeds (N, n) with the heading's rate (N, 1), in the rows of balancing."""
    rows = tested.balancing
    total = (wheels.rate @ np.asarray(tested.placements[0].signs, dtype=np.float64))[rows]
    rate = heading.rate[rows, 0]
    total, rate = total - total.mean(), rate - rate.mean()
    size = float(np.sqrt((total @ total) * (rate @ rate)))
    correlation = float(total @ rate) / size if size > 0.0 else 0.0
    wheel = robot.wheels
    without_pivoting = robot.wheel_count * robot.ball.radius / wheel.radius * np.sin(wheel.tilt)
    seconds = max(float(rows.sum()) * INTERVAL, 1.0)
    # over the standard error sqrt((1 - r^2) / n) of a correlation r of n independent seconds
    z = abs(correlation) * math.sqrt(seconds) / math.sqrt(max(1.0 - correlation**2, 0.01))
    return HeadingTest(
        correlation=correlation,
        gain=abs(float(total @ rate)) / max(float(rate @ rate), TINY) / without_pivoting,
        confidence=advantage_confidence(z),
    )


@dataclass(frozen=True, kw_only=True)
class SensorFrame:
    """How the file's wheels and IMU sit on the robot."""

    order: tuple[int, ...]  #: for the robot's wheels in turn, the file's wheel (from 1)
    signs: tuple[int, ...]  #: of the file's wheels, in the file's order
    turn: float  #: of the IMU's x axis from the robot's [rad], rounded to `GRID` if it is near
    measured_turn: float  #: [rad], as the log has it
    axis_signs: tuple[int, int, int] = (1, 1, 1)  #: of roll, pitch and yaw
    direction: float = 0.5  #: confidence in the direction in which all wheels count
    handedness: float = 1.0  #: confidence that no other axis of the IMU is reversed


def frame_of(robot: Robot, tested: LeanTest | None, heading: HeadingTest | None) -> SensorFrame:
    """Return the frame that the tests speak for; the robot's own if there is no lean to test."""
    count = robot.wheel_count
    own = tuple(range(1, count + 1))
    if tested is None:
        return SensorFrame(order=own, signs=(1,) * count, turn=0.0, measured_turn=0.0)
    best, beta = tested.placements[0], robot.wheels.azimuths
    same = 0.0 if heading is None else tested.handedness
    prior = SAME_IF_MIRRORED if best.mirrored else SAME_HANDEDNESS
    weight = STILL_WEIGHT if tested.headings < STILL_HEADING else HANDEDNESS_WEIGHT
    shown = max(advantage_confidence(same, weight=weight), 1.0 - MOST)
    odds = prior / (1.0 - prior) * shown / (1.0 - shown)
    same = odds / (1.0 + odds)
    positions, phase, axes = best.positions, best.phase, (1, 1, 1)
    if same < 0.5:
        reflected = tuple((1 - place) % count + 1 for place in positions)
        if best.positions == own or reflected != own:
            axes = (1, 1, -1)
        else:
            positions, phase, axes = reflected, -phase - 2.0 * beta[0], (1, -1, 1)
    known = heading is not None and heading.confidence >= CONFIDENT
    seen = advantage_confidence(abs(tested.handedness)) if heading is None else 0.5
    if heading is not None and known:
        backwards = axes[2] * heading.correlation > 0.0
    else:  # without a heading, the smaller turn is the likelier
        backwards = tested.handedness < 0.0 if seen >= CONFIDENT else np.cos(phase) < 0.0
    signs = np.asarray(best.signs) * (-1 if backwards else 1)
    turn = -_within_half_a_turn(phase + (np.pi if backwards else 0.0))
    near = GRID * round(turn / GRID)
    error = tested.phase_error if tested.phase_error is not None else ROUNDED
    rounded = abs(turn - near) <= min(ROUNDED, ROUNDED_ERRORS * error + np.deg2rad(1.0))
    by_wheels = seen if tested.headings > TURNING_BY_WHEELS else max(seen, EQUAL_DIRECTIONS)
    return SensorFrame(
        order=tuple(positions.index(place) + 1 for place in own),
        signs=tuple(int(sign) for sign in signs),
        turn=float(near if rounded else turn),
        measured_turn=float(turn),
        axis_signs=axes,
        direction=by_wheels if heading is None else heading.confidence,
        # without a heading that turns, the other handedness gives the same log
        handedness=max(same, 1.0 - same) if known else 0.97,
    )


def _within_half_a_turn(angle: float) -> float:
    return float((angle + np.pi) % (2.0 * np.pi) - np.pi)
