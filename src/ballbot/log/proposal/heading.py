"""Which way round the wheels count: by heading, which turns all wheels alike.

    sum_i w_i = n (r_b / r_w) sin(alpha) (spin of the ball - psi_dot)

seen from the body. A ball spins less than the body that turns on it, or the other way, so that the sum goes against
psi_dot. Nothing else tells a log whose wheels all count backwards from one whose IMU is turned by half a turn.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ballbot.log.proposal.lean_test import LeanTest, wheel_signs
from ballbot.log.proposal.signals import INTERVAL, Smooth
from ballbot.robot import Robot

#: a correlation of n independent seconds is believed from this many of its standard deviations, 1 / sqrt(n)
BELIEVED = 2.5


@dataclass(frozen=True, kw_only=True)
class HeadingTest:
    """How the sum of the wheels' speeds goes with the heading's rate."""

    correlation: float  #: negative where the wheels count as the robot's do
    gain: float  #: sum of the speeds over psi_dot, over that of a ball that does not pivot
    believed: bool  #: whether the log turns enough for a verdict

    @property
    def backwards(self) -> bool:
        """Whether all wheels count backwards."""
        return self.believed and self.correlation > 0.0


def heading_test(robot: Robot, wheels: Smooth, heading: Smooth, tested: LeanTest) -> HeadingTest:
    """Compare the sum of the wheels' speeds with the heading's rate.

    Parameters
    ----------
    robot : Robot
    wheels : Smooth (N, n)
    heading : Smooth (N, 1)
    tested : LeanTest
        Says which wheel is reversed, and which rows are balancing.
    """
    rows = tested.balancing
    total = (wheels.rate @ wheel_signs(robot.wheel_count, tested.placements[0].flipped))[rows]
    rate = heading.rate[rows, 0]
    total, rate = total - total.mean(), rate - rate.mean()
    size = float(np.sqrt((total @ total) * (rate @ rate)))
    correlation = float(total @ rate) / size if size > 0.0 else 0.0
    wheel = robot.wheels
    without_pivoting = robot.wheel_count * robot.ball.radius / wheel.radius * np.sin(wheel.tilt)
    seconds = float(rows.sum()) * INTERVAL
    return HeadingTest(
        correlation=correlation,
        gain=float(total @ rate / max(float(rate @ rate), 1e-300) / without_pivoting),
        believed=bool(abs(correlation) > BELIEVED / np.sqrt(max(seconds, 1.0))),
    )
