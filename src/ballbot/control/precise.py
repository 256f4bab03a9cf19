"""The precise controller: stiff, with integral action, smooth references and compensation, for the filter's state.

The nominal gain (`ballbot.control.nominal`) wanders by the friction over its position gain. This one is twenty
times as stiff in position and adds what brings the robot to where it is asked to be. Such a gain needs quiet speeds:
with the thesis's on-board state (`ballbot.estimation.OnboardState`) the motors rattle through their play; it is made
for the state of the Kalman filter (`ballbot.estimation.kalman`), from the same sensors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.control.controller import Compensation, Controller, default_speed_band
from ballbot.control.disturbance_observer import DisturbanceObserver
from ballbot.control.feed_forward import FeedForward
from ballbot.control.integral import IntegralAction
from ballbot.control.lean_bound import LeanBound
from ballbot.control.lqr import lqr
from ballbot.control.parts import Parts
from ballbot.control.reference_shaping import ReferenceShaping
from ballbot.control.standstill import Standstill
from ballbot.control.torque_balance import TorqueBalance
from ballbot.mechanics.geometry import wheel_load
from ballbot.mechanics.model import Model
from ballbot.robot import Friction, Robot

#: weights of x y theta phi psi [1/m^2, 1/rad^2] and of their rates
STATE_WEIGHTS = (2000.0, 2000.0, 500.0, 500.0, 50.0, 300.0, 300.0, 20.0, 20.0, 5.0)
#: weights of the integrals of x, y [1/(m s)^2] and psi [1/(rad s)^2]
INTEGRAL_WEIGHTS = (2000.0, 2000.0, 20.0)
#: weight of each wheel's torque [1/(N m)^2]
TORQUE_WEIGHT = 30.0

#: speed band over the default one, which is made for speeds counted from sample to sample
SPEED_BAND = 1.0 / 3.0
#: share of the break-away torque that a wheel at rest is given
FEED = 0.7
#: share of its load that a wheel pushes the ball with at most: stiff, the controller else spins its wheels in a fall
GRIP_SHARE = 0.4

#: where x, y and psi stand in the state
_POSE = (0, 1, 4)


@dataclass(frozen=True, kw_only=True, eq=False)
class IntegralDesign:
    """A gain for the state and its pose's integral."""

    gain: NDArray[np.float64]  #: K (n, 10)
    integral_gain: NDArray[np.float64]  #: K_I (n, 3)
    poles: NDArray[np.complex128]  #: (13,) of the closed loop [rad/s], the slowest first
    sample_time: float  #: [s]


@dataclass(frozen=True, kw_only=True, eq=False)
class _StateSpace:
    A: NDArray[np.float64]
    B: NDArray[np.float64]


def design_integral_gain(
    robot: Robot,
    *,
    state_weights: Sequence[float] = STATE_WEIGHTS,
    integral_weights: Sequence[float] = INTEGRAL_WEIGHTS,
    torque_weight: float = TORQUE_WEIGHT,
    sample_time: float | None = None,
) -> IntegralDesign:
    """Return the sampled LQR of the exact model without friction and of the integrals of x, y and psi.

    Parameters
    ----------
    robot : Robot
    state_weights, integral_weights : sequences of 10 and 3 numbers
        Diagonal of Q.
    torque_weight : float
        Diagonal of R, the same for every wheel.
    sample_time : float, optional
        [s]; the robot's own where not given.

    Raises
    ------
    InputError
        As `ballbot.lqr` does.
    """
    linear = Model(robot.replace(friction=Friction.none(robot.wheel_count))).linearize()
    A, B = np.zeros((13, 13)), np.zeros((13, robot.wheel_count))
    A[:10, :10], B[:10] = linear.A, linear.B
    A[[10, 11, 12], _POSE] = 1.0
    time = robot.sensors.sample_time if sample_time is None else sample_time
    weights = (*state_weights, *integral_weights)
    found = lqr(_StateSpace(A=A, B=B), weights, (torque_weight,) * robot.wheel_count, sample_time=time)
    return IntegralDesign(
        gain=found.gain[:, :10].copy(),
        integral_gain=found.gain[:, 10:].copy(),
        poles=found.poles,
        sample_time=time,
    )


def precise_controller(
    robot: Robot, *, compensation: Compensation = "full", design: IntegralDesign | None = None
) -> Controller:
    """Return the controller with this gain and every part that earned its place; see docs/evidence.md.

    Parameters
    ----------
    robot : Robot
        Its friction is what is compensated.
    compensation : {"none", "full", "partial"}
    design : IntegralDesign, optional
        `design_integral_gain(robot)` where not given.
    """
    chosen = design if design is not None else design_integral_gain(robot)
    time = chosen.sample_time
    return Controller(
        robot,
        chosen.gain,
        sample_time=time,
        compensation=compensation,
        torque_limit=sure_torque(robot),
        speed_band=SPEED_BAND * default_speed_band(robot, time),
        parts=Parts(
            shaping=ReferenceShaping(),
            feed_forward=FeedForward.of(robot),
            integral=IntegralAction(gain=chosen.integral_gain),
            standstill=Standstill(feed=FEED),
            observer=DisturbanceObserver(balance=TorqueBalance.of(robot)),
            lean_bound=LeanBound(),
        ),
        estimator="kalman",
    )


def sure_torque(robot: Robot) -> float:
    """Return the wheel torque [N m] that leaves the wheels their hold on the ball, never above the motors' own limit.

    `GRIP_SHARE` of the load that presses a wheel, times its radius; and friction, which never reaches the contact.
    """
    friction = max(c + s for c, s in zip(robot.friction.coulomb, robot.friction.stribeck, strict=True))
    return min(robot.drive.torque_limit, GRIP_SHARE * wheel_load(robot) * robot.wheels.radius + friction)
