"""The thesis's Figure 3.4: a ball on clamped wheels under its own LQR, its reference stepping about one axis at a time.

Without friction the ball reaches the reference. With friction it stays short of it and turns about the other axes as
well: friction takes a part of each wheel's torque, which changes the ratio of the torques and thereby the axis.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from ballbot.arrays import Floats
from ballbot.control.lqr import lqr
from ballbot.mechanics.model import LinearModel
from ballbot.report.series import Line, Panel, TimeSeries
from ballbot.robot import Friction, Robot
from ballbot.simulation.upside_down import ClampedBall, simulate_balls

#: weights of the three rotations [1/rad^2] and of their rates, and of each torque [1/(N m)^2]
STATE_WEIGHTS = (50.0, 50.0, 50.0, 2.0, 2.0, 2.0)
TORQUE_WEIGHT = 30.0
#: step of each axis's reference [rad], and the time from one axis to the next [s]
TURN, PAUSE = 0.5, 4.0


@dataclass(frozen=True, kw_only=True, eq=False)
class BallMovement:
    """The same controller on a ball with friction and on one without: rotation vectors (N, 3), robot's frame [rad]."""

    t: Floats  #: (N,) [s]
    reference: Floats
    with_friction: Floats
    without_friction: Floats

    @property
    def off_axis_with_friction(self) -> float:
        """Largest rotation about an axis whose reference is still zero [rad]."""
        return float(np.abs(np.where(self.reference == 0.0, self.with_friction, 0.0)).max())

    def series(self) -> TimeSeries:
        """Return the ball's rotation about each axis along the reference, with friction and without."""
        panels = []
        for axis, name in enumerate("xyz"):
            lines = (
                Line("reference", self.reference[:, axis], "reference"),
                Line("without friction", self.without_friction[:, axis], "second"),
                Line("with friction", self.with_friction[:, axis], "first"),
            )
            panels.append(Panel(f"rotation about {name} [rad]", lines))
        return TimeSeries(self.t, panels, "")


def ball_movement(robot: Robot) -> BallMovement:
    """Turn the ball of a clamped robot about x, then y, then z, with the robot's friction and without."""
    ball, h = ClampedBall.of_robot(robot), robot.sensors.sample_time
    t = h * np.arange(round((3.0 * PAUSE + 1.0) / h), dtype=np.float64)
    reference = np.where(t[:, None] >= 1.0 + PAUSE * np.arange(3.0), TURN, 0.0)
    with_friction, without = (
        _rotations(ball, friction, reference, h)
        for friction in (robot.friction, Friction.none(robot.wheel_count))
    )
    return BallMovement(t=t, reference=reference, with_friction=with_friction, without_friction=without)


def _rotations(ball: ClampedBall, friction: Friction, reference: Floats, h: float) -> Floats:
    """Return the rotations (N, 3) under u = K [rotation that is missing; -Omega]."""
    n = len(ball.A)
    # x_dot = A x + B u, x the rotation and Omega: exact without friction for turning about one axis
    A = np.block([[np.zeros((3, 3)), np.eye(3)], [np.zeros((3, 6))]])
    plant = LinearModel(A=A, B=np.vstack([np.zeros((3, n)), ball.push()]))
    K = lqr(plant, STATE_WEIGHTS, (TORQUE_WEIGHT,) * n, sample_time=h).gain
    omega, turned, rotations = np.zeros(3), Rotation.identity(), []
    for wanted in reference:
        rotations.append(turned.as_rotvec())
        missing = (Rotation.from_rotvec(wanted) * turned.inv()).as_rotvec()
        torques = (K @ np.concatenate([missing, -omega]))[None, None]
        after = simulate_balls(ball, friction=friction, initial=omega[None], torques=torques, sample_time=h)[
            0, 0
        ]
        turned = Rotation.from_rotvec(0.5 * h * (omega + after)) * turned
        omega = after
    return np.array(rotations)
