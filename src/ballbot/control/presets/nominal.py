"""The nominal controller: the "soft" gain of the nominal scenario, the thesis's kind.

The thesis prints no gain. This one wanders without compensation as the thesis's figures do. It is frozen, so that
results made with it can be compared.
"""

from collections.abc import Sequence

from ballbot.control.controller import Compensation, Controller
from ballbot.control.lqr import LqrDesign, frictionless_model, lqr
from ballbot.control.presets.kind import ControllerKind
from ballbot.robot import Friction, Robot, RobotLike, as_robot

#: weights of x y theta phi psi [1/m^2, 1/rad^2] and of their rates
NOMINAL_STATE_WEIGHTS = (20.0, 20.0, 500.0, 500.0, 5.0, 30.0, 30.0, 20.0, 20.0, 2.0)
#: weight of each wheel's torque [1/(N m)^2]
NOMINAL_TORQUE_WEIGHT = 30.0


def design_gain(
    robot: RobotLike,
    *,
    state_weights: Sequence[float] = NOMINAL_STATE_WEIGHTS,
    torque_weight: float = NOMINAL_TORQUE_WEIGHT,
    sample_time: float | None = None,
) -> LqrDesign:
    """Return the sampled LQR of the exact model without friction, which is the compensation's business.

    Ten weights are the diagonal of Q, the torque weight is that of R for every wheel; the sample time [s] is the
    robot's own if not given.
    """
    robot = as_robot(robot)
    time = robot.sensors.sample_time if sample_time is None else sample_time
    return lqr(
        frictionless_model(robot), state_weights, (torque_weight,) * robot.wheel_count, sample_time=time
    )


def nominal_controller(robot: RobotLike, *, compensation: Compensation = "none") -> Controller:
    """Return the controller with the nominal gain at the robot's sample time; its friction is what is compensated."""
    robot = as_robot(robot)
    return Controller(robot, design_gain(robot).gain, compensation=compensation)


def _with_gain(
    robot: Robot, compensated: Friction, design: LqrDesign, compensation: Compensation
) -> Controller:
    known = robot.replace(friction=compensated)
    return Controller(known, design.gain, sample_time=design.sample_time, compensation=compensation)


KIND = ControllerKind(
    name="nominal",
    text="a soft gain",
    compensation="none",
    state_weights=NOMINAL_STATE_WEIGHTS,
    design=design_gain,
    controller=_with_gain,
)
