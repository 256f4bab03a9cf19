"""The nominal controller: the "soft" gain of the nominal scenario, the thesis's kind.

The thesis prints no gain. This one wanders without compensation as the thesis's figures do. It is frozen, so that
results made with it can be compared; three properties of a robot change it:

- Motors so strong for the robot's weight that the loop's fastest pole is beyond `FASTEST` times the rate at which the
  robot falls. Such a loop reverses the torques faster than wheels with a degree of play cross it, and the robot falls.
  Torque then costs more.

- Viscous friction, as the back-EMF of motors that are driven by a duty, takes so much torque that the loop is lost with
  `TORQUE_LEFT` of it. The gain is then designed with that friction.
- An encoder is so coarse, or read so often, that a single count changes a torque by more than `COUNT_TORQUE` of the
  motors' limit, or the loop's fastest pole is beyond `SMOOTH` times the rate at which the robot falls. The state is
  then that of the Kalman filter.
"""

from collections.abc import Sequence

import numpy as np

from ballbot.control.controller import Compensation, Controller
from ballbot.control.lqr import LqrDesign, frictionless_model, held, lqr
from ballbot.control.presets.kind import ControllerKind
from ballbot.estimation.kalman_model import FilterNoise
from ballbot.mechanics.model import LinearModel, Model
from ballbot.robot import Friction, Robot, RobotLike, as_robot

#: weights of x y theta phi psi [1/m^2, 1/rad^2] and of their rates
NOMINAL_STATE_WEIGHTS = (20.0, 20.0, 500.0, 500.0, 5.0, 30.0, 30.0, 20.0, 20.0, 2.0)
#: weight of each wheel's torque [1/(N m)^2]; doubled until the loop is slow enough
NOMINAL_TORQUE_WEIGHT = 30.0
#: pole of the loop over the rate at which the robot falls. Four presets have 1.07 to 1.34 without being held to it.
#: Robots such as rob311 had 3.3 to 4.5: with 1 to 2 degrees of play their lean rates swung by 0.2 rad/s, and some fell;
#: with 2 none of 18 did. With 1.5 they swing less, but rob311 fell in 6 of 6 runs with the nominal scenario's friction
FASTEST = 2.0
#: the same, up to which the wheels' play does not shake the on-board state. With 2, the studies of three of seven
#: robots found no friction in logs of that state, and of all seven in those of the filter's
SMOOTH = 1.4
#: part of the torque that must do for balance. A design without friction does with half (0.50 at most on the presets,
#: with the nominal scenario's friction); robots whose loop is lost with more fell, of dry friction
TORQUE_LEFT = 0.6
#: over the motors' torque limit. Presets have 0.008 at most; with 4 a robot fell, and with 2 it balanced
COUNT_TORQUE = 0.1


def design_gain(
    robot: RobotLike,
    *,
    state_weights: Sequence[float] = NOMINAL_STATE_WEIGHTS,
    torque_weight: float | None = None,
    sample_time: float | None = None,
) -> LqrDesign:
    """Return the sampled LQR of the exact model; viscous friction counts where it must, other friction never does.

    Ten weights are the diagonal of Q. The torque weight is that of R for every wheel; if not given, it is
    `NOMINAL_TORQUE_WEIGHT`, doubled until the fastest pole is at most `FASTEST` times the rate at which the robot
    falls. The sample time [s] is the robot's own if not given.
    """
    robot = as_robot(robot)
    time = robot.sensors.sample_time if sample_time is None else sample_time
    plain, viscous = frictionless_model(robot).linearize(), Model(robot).linearize()
    fastest = FASTEST * _falling(plain)
    weights = np.full(robot.wheel_count, NOMINAL_TORQUE_WEIGHT if torque_weight is None else torque_weight)
    design = lqr(plain, state_weights, weights, sample_time=time)
    while torque_weight is None and np.abs(design.poles).max() > fastest:
        weights *= 2.0
        design = lqr(plain, state_weights, weights, sample_time=time)
    F, G = held(viscous.A, viscous.B, time)
    if np.abs(np.linalg.eigvals(F - TORQUE_LEFT * G @ design.gain)).max() < 1.0:
        return design
    return lqr(viscous, state_weights, weights, sample_time=time)


def nominal_controller(robot: RobotLike, *, compensation: Compensation = "none") -> Controller:
    """Return the controller with the nominal gain at the robot's sample time; its friction is what is compensated."""
    robot = as_robot(robot)
    return _with_gain(robot, robot.friction, design_gain(robot), compensation)


def _with_gain(
    robot: Robot, compensated: Friction, design: LqrDesign, compensation: Compensation
) -> Controller:
    known, time = robot.replace(friction=compensated), design.sample_time
    moved = np.array(FilterNoise.of(robot).counts[:2]) / (robot.sensors.sample_time if time is None else time)
    flicker = float(np.abs(design.gain[:, 5:7] * moved).max())
    coarse = flicker > COUNT_TORQUE * robot.drive.torque_limit
    fast = np.abs(design.poles).max() > SMOOTH * _falling(frictionless_model(robot).linearize())
    estimator = "kalman" if coarse or fast else "onboard"
    return Controller(known, design.gain, sample_time=time, compensation=compensation, estimator=estimator)


def _falling(upright: LinearModel) -> float:
    """Return the rate at which a robot falls [rad/s]."""
    return float(upright.poles().real.max())


KIND = ControllerKind(
    name="nominal",
    text="a soft gain",
    compensation="none",
    state_weights=NOMINAL_STATE_WEIGHTS,
    design=design_gain,
    controller=_with_gain,
    candidates={"none": "none", "full": "full", "partial": "partial"},
)
