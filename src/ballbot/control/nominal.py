"""The nominal gain: the "soft" one of the nominal scenario, the thesis's kind (design section 11).

The thesis prints no gain. This one wanders without compensation as its figures do; it is frozen, so that results
made with it can be compared.
"""

from __future__ import annotations

from collections.abc import Sequence

from ballbot.control.controller import Compensation, Controller
from ballbot.control.lqr import LqrDesign, lqr
from ballbot.mechanics.model import Model
from ballbot.robot import Friction, Robot

#: weights of x y theta phi psi [1/m^2, 1/rad^2] and of their rates
STATE_WEIGHTS = (20.0, 20.0, 500.0, 500.0, 5.0, 30.0, 30.0, 20.0, 20.0, 2.0)
#: weight of each wheel's torque [1/(N m)^2]
TORQUE_WEIGHT = 30.0


def design_gain(
    robot: Robot,
    *,
    state_weights: Sequence[float] = STATE_WEIGHTS,
    torque_weight: float = TORQUE_WEIGHT,
    sample_time: float | None = None,
) -> LqrDesign:
    """Return the sampled LQR of the exact model without friction, which is the compensation's business.

    Parameters
    ----------
    robot : Robot
    state_weights : sequence of 10 numbers
        Diagonal of Q.
    torque_weight : float
        Diagonal of R, the same for every wheel.
    sample_time : float, optional
        [s]; the robot's own where not given.
    """
    frictionless = robot.replace(friction=Friction.none(robot.wheel_count))
    time = robot.sensors.sample_time if sample_time is None else sample_time
    return lqr(Model(frictionless), state_weights, (torque_weight,) * robot.wheel_count, sample_time=time)


def nominal_controller(robot: Robot, *, compensation: Compensation = "none") -> Controller:
    """Return the controller with the nominal gain at the robot's sample time; its friction is what is compensated."""
    return Controller(robot, design_gain(robot).gain, compensation=compensation)
