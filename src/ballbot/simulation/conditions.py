"""Disturbances of a closed loop in a batch: late torques, motors that run out of voltage, a floor that slopes.

A floor of slope s = grad h pulls on all that rolls with -(m_b + m_r) g s. A robot at rest on it leans uphill and holds
itself by wheel torques u_0 with A^T u_0 = T,

    T = r_b (m_b + m_r) g (-s_y, s_x, 0)        (theta_0, phi_0) = (T_x, T_y) / (m_r g l)

About that rest the robot moves as it does about upright on level ground, to first order in the slope: so a lane is
stepped on level ground, the lean that is measured is theta_0, phi_0 larger, and of the wheels' torques u - u_0 acts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import whole_number
from ballbot.errors import InputError
from ballbot.mechanics.geometry import transforms
from ballbot.robot import Robot

#: fraction of the speeds up to the highest over which a motor's torque falls from its limit to nothing, as on the twin
FALLING_PART = 0.05
#: the steepest slope for which the first order is taken: 0.1 is 5.7 degrees
MAX_SLOPE = 0.1
#: samples by which torques may be late: 5 s at 200 Hz, in which any ballbot falls; each takes room in a batch
MAX_DELAY = 1000


@dataclass(frozen=True, kw_only=True)
class Conditions:
    """The disturbances of one robot's loop.

    Raises
    ------
    InputError
        If the delay is not a whole number of at most 1,000 samples, the missing samples are not whole numbers, the
        speed is not positive, or the slope is not that of a floor to stand on.
    """

    delay: int = 0  #: samples by which torques come later than they were computed
    #: of a wheel, at which its motor has no torque left to drive it faster [rad/s]
    top_speed: float = math.inf
    slope: tuple[float, float] = (0.0, 0.0)  #: rise of the floor along x and along y [-]
    #: samples without a measurement, in a row from sample `missing_from` on; the law gives no torque in them
    missing: int = 0
    missing_from: int = 0

    def __post_init__(self) -> None:
        for name in ("missing", "missing_from"):
            whole_number(getattr(self, name), f"{name} of the conditions", least=0)
        if not isinstance(self.delay, int) or self.delay < 0:
            raise InputError(f"The delay is {self.delay!r} samples; it must be a whole number, zero or more.")
        if self.delay > MAX_DELAY:
            raise InputError(
                f"The delay is {self.delay} samples; it must be at most {MAX_DELAY}, by when any robot has fallen."
            )
        if not self.top_speed > 0.0:
            raise InputError(f"The largest wheel speed is {self.top_speed:g} rad/s; it must be positive.")
        if not np.hypot(*self.slope) <= MAX_SLOPE:
            raise InputError(
                f"The slope of the floor is {np.hypot(*self.slope):.3g}; it must be at most {MAX_SLOPE:g}."
            )


def rest_on_slope(
    robot: Robot, slope: tuple[float, float]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the lean (theta, phi) [rad] and the wheel torques (n,) [N m] of a robot at rest on a slope, at psi = 0."""
    weight = robot.weight
    torque = robot.ball.radius * weight * np.array([-slope[1], slope[0], 0.0])
    lean = torque[:2] / (robot.body.mass * robot.gravity * robot.body.center_of_mass)
    return lean, np.linalg.pinv(transforms(robot).T_owb.T) @ torque


def pack_conditions(conditions: Sequence[Conditions], robots: Sequence[Robot]) -> NDArray[np.float64]:
    """Return the rows (1 or lanes, 7 + 2 n) that compiled code reads; one condition or one robot may stand for all.

    A row is the delay, theta_0, phi_0, the highest speed of a wheel and its motor's torque limit, for each wheel a and
    b of u_0 = a cos(psi) + b sin(psi), since the wheels turn with the body, and the first sample whose measurement is
    missing and the first after it.
    """
    alike = all(one.slope == (0.0, 0.0) and one.top_speed == math.inf for one in conditions)
    bodies = robots[:1] if alike else robots  # then the robot does not matter
    lanes = max(len(conditions), len(bodies))
    pairs = [(conditions[i % len(conditions)], bodies[i % len(bodies)]) for i in range(lanes)]
    # a pair that is there more than once is worked out once
    made = {
        (id(one), id(robot)): _row(one, robot)
        for one, robot in {(id(a), id(b)): (a, b) for a, b in pairs}.values()
    }
    return np.array([made[id(one), id(robot)] for one, robot in pairs])


def _row(one: Conditions, robot: Robot) -> NDArray[np.float64]:
    s_x, s_y = one.slope
    lean, along = rest_on_slope(robot, (s_x, s_y))
    _, across = rest_on_slope(robot, (s_y, -s_x))
    motor = [one.top_speed, robot.drive.torque_limit]
    gap = [float(one.missing_from), float(one.missing_from + one.missing)]
    return np.concatenate([[float(one.delay)], lean, motor, np.column_stack([along, across]).ravel(), gap])
