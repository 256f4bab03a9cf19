"""Ready-made controllers: nominal and precise.

The nominal controller has the "soft" gain of the nominal scenario, the thesis's kind. The thesis prints no gain. This
one wanders without compensation as the thesis's figures do. It is frozen, so that results made with it can be
compared.

The nominal gain wanders by the friction divided by its position gain. The precise controller is twenty times as stiff
in position and adds integral action, smooth references, compensation and a disturbance observer. Such a gain needs
quiet speeds: with the thesis's on-board state (`ballbot.estimation.OnboardState`) the motors rattle through their
play. It is made for the state of the Kalman filter (`ballbot.estimation.kalman`), which uses the same sensors.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import checked_sample_time
from ballbot.control.controller import Compensation, Controller, default_speed_band, grip_torque_limit
from ballbot.control.file import read_controller, warn_if_unsuited
from ballbot.control.interface import Feedback
from ballbot.control.lqr import LqrDesign, StateSpace, frictionless_model, lqr
from ballbot.control.parts import Parts
from ballbot.control.parts.disturbance_observer import DisturbanceObserver
from ballbot.control.parts.feed_forward import FeedForward
from ballbot.control.parts.integral import IntegralAction
from ballbot.control.parts.lean_limit import LeanLimit
from ballbot.control.parts.reference_shaping import ReferenceShaping
from ballbot.errors import InputError, either, suggest
from ballbot.robot import Robot, RobotLike, as_robot

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

    Parameters
    ----------
    robot : Robot, preset or robot file
    state_weights : sequence of 10 numbers
        Diagonal of Q.
    torque_weight : float
        Diagonal of R, the same for every wheel.
    sample_time : float, optional
        [s]; the robot's own if not given.
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


#: weights of x y theta phi psi [1/m^2, 1/rad^2] and of their rates
PRECISE_STATE_WEIGHTS = (2000.0, 2000.0, 500.0, 500.0, 50.0, 300.0, 300.0, 20.0, 20.0, 5.0)
#: weights of the integrals of x, y [1/(m s)^2] and psi [1/(rad s)^2]
PRECISE_INTEGRAL_WEIGHTS = (2000.0, 2000.0, 20.0)
#: weight of each wheel's torque [1/(N m)^2]
PRECISE_TORQUE_WEIGHT = 30.0

#: speed band over the default one, which is made for speeds counted from sample to sample
PRECISE_SPEED_BAND = 1.0 / 3.0

#: where x, y and psi stand in the state
_POSE_PLACES = (0, 1, 4)


def design_integral_gain(
    robot: RobotLike,
    *,
    state_weights: Sequence[float] = PRECISE_STATE_WEIGHTS,
    integral_weights: Sequence[float] = PRECISE_INTEGRAL_WEIGHTS,
    torque_weight: float = PRECISE_TORQUE_WEIGHT,
    sample_time: float | None = None,
) -> LqrDesign:
    """Return the sampled LQR of the exact model without friction and of the integrals of x, y and psi.

    Parameters
    ----------
    robot : Robot, preset or robot file
    state_weights, integral_weights : sequences of 10 and 3 numbers
        Diagonal of Q.
    torque_weight : float
        Diagonal of R, the same for every wheel.
    sample_time : float, optional
        [s]; the robot's own if not given.

    Raises
    ------
    InputError
        As `ballbot.lqr` does.
    """
    robot = as_robot(robot)
    time = robot.sensors.sample_time if sample_time is None else sample_time
    weights = (*state_weights, *integral_weights)
    found = lqr(_with_integrals(robot), weights, (torque_weight,) * robot.wheel_count, sample_time=time)
    return replace(found, gain=found.gain[:, :10].copy(), integral_gain=found.gain[:, 10:].copy())


def _with_integrals(robot: Robot) -> StateSpace:
    """Return the model without friction (13, 13), the integrals of x, y and psi last."""
    linear = frictionless_model(robot).linearize()
    A, B = np.zeros((13, 13)), np.zeros((13, robot.wheel_count))
    A[:10, :10], B[:10] = linear.A, linear.B
    A[[10, 11, 12], _POSE_PLACES] = 1.0
    return replace(linear, A=A, B=B)


def precise_controller(
    robot: RobotLike, *, compensation: Compensation = "full", design: LqrDesign | None = None
) -> Controller:
    """Return the controller with this gain and every part that earned its place; see docs/generated/evidence.md.

    Parameters
    ----------
    robot : Robot, preset or robot file
        Its friction is what is compensated.
    compensation : {"none", "full", "partial"}
    design : LqrDesign, optional
        With an integral gain; `design_integral_gain(robot)` if not given.
    """
    robot = as_robot(robot)
    chosen = design if design is not None else design_integral_gain(robot)
    time, integral_gain = chosen.sample_time, chosen.integral_gain
    if time is None or integral_gain is None:
        raise InputError("The precise controller needs a sampled gain with integral action.")
    return Controller(
        robot,
        chosen.gain,
        sample_time=time,
        compensation=compensation,
        torque_limit=grip_torque_limit(robot),
        speed_band=PRECISE_SPEED_BAND * default_speed_band(robot, time),
        parts=Parts(
            shaping=ReferenceShaping(),
            feed_forward=FeedForward(),
            integral=IntegralAction(gain=integral_gain),
            disturbance_observer=DisturbanceObserver(),
            lean_limit=LeanLimit(),
        ),
        estimator="kalman",
    )


#: ready-made controllers by name
PRESETS: Mapping[str, Callable[[RobotLike], Controller]] = {
    "nominal": nominal_controller,
    "precise": precise_controller,
}
#: u = f(t, x, r): wheel torques (n,) [N m] from the time [s], the state (10,) and the reference (10,)
Law = Callable[[float, NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]
#: a controller, a function, the name of a ready-made one, or the path of a controller file
ControllerLike = Feedback | Law | str | Path


@dataclass(frozen=True, kw_only=True)
class FunctionController:
    """A controller that is a function without memory."""

    law: Law
    sample_time: float  #: [s]

    def reset(self) -> None:
        """Do nothing: there is nothing to forget."""

    def update(
        self, t: float, state: NDArray[np.float64], reference: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the wheel torques (n,) [N m]; see `Feedback`."""
        return self.law(t, state, reference)


def as_controller(source: ControllerLike, robot: RobotLike) -> Feedback:
    """Return the controller itself, or for a robot the ready-made one of that name or the one in that file.

    A function f(t, x, r) is called at the sample time of the robot's sensors.

    Raises
    ------
    InputError
        If it is none of these, or the file is not of that robot.
    """
    if isinstance(source, Feedback):
        checked_sample_time(source.sample_time, "The controller's sample time")
        return source
    if callable(source) and not isinstance(source, type):
        return FunctionController(law=source, sample_time=as_robot(robot).sensors.sample_time)
    if not isinstance(source, str | Path):
        raise InputError(
            f"A controller is given as an object of type {type(source).__name__}; give a Controller, an object with "
            f"sample_time, reset() and update(t, state, reference), a function f(t, x, r), "
            f"{either(map(repr, PRESETS))}, or the path of a controller file."
        )
    return named_controller(source, robot)


def named_controller(source: str | Path, robot: RobotLike) -> Controller:
    """Return for a robot the ready-made controller of that name, or the one in that file.

    Raises
    ------
    InputError
        If it is neither, or the file is not of that robot.
    """
    if source in PRESETS:
        made, described = PRESETS[str(source)](robot), as_robot(robot)
        warn_if_unsuited(made, described, name=f"the {source} controller")
        return made
    if not Path(source).exists():
        hint = suggest(str(source), PRESETS, otherwise="the ready-made ones are")
        raise InputError(f"There is no controller file or ready-made controller {str(source)!r}; {hint}")
    return read_controller(source, robot)
