"""The thesis's Figure 3.4: a ball on clamped wheels under its own LQR, one axis asked to turn at a time.

Without friction the ball goes where it is asked. With friction it stays short of it, and moves about the other axes as
well: friction takes its share of each wheel's torque, so that the torques' ratio, and with it the axis, is another one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.control.lqr import lqr
from ballbot.robot import Friction, Robot
from ballbot.simulation.upside_down import BallRun, ClampedBall, follow

#: weights of the three rotations [1/rad^2] and of their rates, and of each torque [1/(N m)^2]
STATE_WEIGHTS = (50.0, 50.0, 50.0, 2.0, 2.0, 2.0)
TORQUE_WEIGHT = 30.0
#: each axis is asked to turn by so much [rad], one every so many seconds
TURN, PAUSE = 0.5, 4.0


@dataclass(frozen=True, kw_only=True, eq=False)
class BallMovement:
    """The same controller on a ball with friction and on one without."""

    reference: NDArray[np.float64]  #: (N, 3) [rad]
    with_friction: BallRun
    without_friction: BallRun

    @property
    def off_axis(self) -> float:
        """Largest rotation [rad] about an axis that had not been asked to turn yet, with friction."""
        return float(np.abs(np.where(self.reference == 0.0, self.with_friction.rotations, 0.0)).max())

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds: errors at the end [rad] and the movement about axes not asked to turn."""
        last = self.reference[-1]
        return {
            "error_at_end_with_friction": (self.with_friction.rotations[-1] - last).tolist(),
            "error_at_end_without_friction": (self.without_friction.rotations[-1] - last).tolist(),
            "off_axis_with_friction": self.off_axis,
        }


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
