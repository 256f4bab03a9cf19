"""The thesis's Figure 3.4: a ball on clamped wheels under its own LQR, its reference stepping about one axis at a time.

Without friction the ball reaches the reference. With friction it stays short of it and turns about the other axes as
well: friction takes a part of each wheel's torque, which changes the ratio of the torques and thereby the axis.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ballbot.control.lqr import lqr
from ballbot.results import left_out, reported
from ballbot.robot import Friction, Robot
from ballbot.simulation.upside_down import BallRun, ClampedBall, follow

#: weights of the three rotations [1/rad^2] and of their rates, and of each torque [1/(N m)^2]
STATE_WEIGHTS = (50.0, 50.0, 50.0, 2.0, 2.0, 2.0)
TORQUE_WEIGHT = 30.0
#: step of each axis's reference [rad], and the time from one axis to the next [s]
TURN, PAUSE = 0.5, 4.0


@dataclass(frozen=True, kw_only=True, eq=False)
class BallMovement:
    """The same controller on a ball with friction and on one without."""

    reference: NDArray[np.float64] = field(metadata=left_out)  #: (N, 3) [rad]
    with_friction: BallRun = field(metadata=left_out)
    without_friction: BallRun = field(metadata=left_out)

    @reported
    def error_at_end_with_friction(self) -> NDArray[np.float64]:
        """Rotation less the reference (3,) [rad]."""
        return self.with_friction.rotations[-1] - self.reference[-1]

    @reported
    def error_at_end_without_friction(self) -> NDArray[np.float64]:
        """Rotation less the reference (3,) [rad]."""
        return self.without_friction.rotations[-1] - self.reference[-1]

    @reported
    def off_axis_with_friction(self) -> float:
        """Largest rotation about an axis whose reference is still zero [rad]."""
        return float(np.abs(np.where(self.reference == 0.0, self.with_friction.rotations, 0.0)).max())


def ball_movement(robot: Robot) -> BallMovement:
    """Turn the ball of a clamped robot about x, then y, then z, with the robot's friction and without."""
    ball, sample_time = ClampedBall.of_robot(robot), robot.sensors.sample_time
    design = lqr(
        ball.linearize(), STATE_WEIGHTS, (TORQUE_WEIGHT,) * robot.wheel_count, sample_time=sample_time
    )
    duration = 3.0 * PAUSE + 1.0

    def run(friction: Friction) -> BallRun:
        return follow(
            ball,
            friction=friction,
            gain=design.gain,
            reference=_reference,
            duration=duration,
            sample_time=sample_time,
        )

    without = run(Friction.none(robot.wheel_count))
    return BallMovement(
        reference=np.array([_reference(float(t)) for t in without.t]),
        with_friction=run(robot.friction),
        without_friction=without,
    )


def _reference(t: float) -> NDArray[np.float64]:
    return np.where(t >= 1.0 + PAUSE * np.arange(3.0), TURN, 0.0)
