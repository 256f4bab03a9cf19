"""The precise controller: stiff, with integral action, smooth references, compensation and a disturbance observer.

The nominal gain wanders by the friction divided by its position gain. This one is twenty times as stiff in position.
Such a gain needs quiet speeds: with the thesis's on-board state (`ballbot.estimation.OnboardState`) the motors rattle
through their play. It is made for the state of the Kalman filter (`ballbot.estimation.kalman`), which uses the same
sensors.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ballbot.control.controller import (
    Compensation,
    Controller,
    catching_torque_limit,
    default_speed_band,
    grip_torque_limit,
    torque_of_lean,
    wheel_turns,
)
from ballbot.control.lqr import LqrDesign, StateSpace, frictionless_model, lqr
from ballbot.control.parts import Parts
from ballbot.control.parts.disturbance_observer import DisturbanceObserver
from ballbot.control.parts.feed_forward import FeedForward
from ballbot.control.parts.integral import IntegralAction
from ballbot.control.parts.lean_limit import LeanLimit
from ballbot.control.parts.part import LawSettings
from ballbot.control.parts.planner import MOTION_TORQUE, Planner
from ballbot.control.presets.kind import ControllerKind
from ballbot.errors import InputError
from ballbot.robot import Friction, Robot, RobotLike, as_robot

#: weights of x y theta phi psi [1/m^2, 1/rad^2] and of their rates
PRECISE_STATE_WEIGHTS = (2000.0, 2000.0, 500.0, 500.0, 50.0, 300.0, 300.0, 20.0, 20.0, 5.0)
#: weights of the integrals of x, y [1/(m s)^2] and psi [1/(rad s)^2]
PRECISE_INTEGRAL_WEIGHTS = (2000.0, 2000.0, 20.0)
#: weight of each wheel's torque [1/(N m)^2]
PRECISE_TORQUE_WEIGHT = 30.0

#: speed band over the default one, which is made for speeds counted from sample to sample
PRECISE_SPEED_BAND = 1.0 / 3.0

#: the largest lean that a motion or an error commands [rad], whatever the motors have: beyond it gains that are
#: designed about upright recover from smaller pushes
COMMANDED_LEAN = 0.3
#: what errors may command of the lean from which the torque limit brings the robot back at rest
ERROR_LEAN = 0.5
#: the largest torque that turning takes, over the torque limit
TURNING_TORQUE = 0.07
#: the largest acceleration of the heading [rad/s^2]
YAW_ACCELERATION = 3.0
#: the least acceleration over that by `COMMANDED_LEAN`, for motors that friction leaves nothing
MOTION_LEAST = 0.05
#: the largest speed for the safety of people nearby [m/s]; the controller file may have another
PEOPLE_SPEED = 2.0
#: the largest speed of a motion over the largest at which motors have the torque for friction and for this lean [rad]
MOTION_MOTOR_SPEED, SPEED_LEAN = 0.9, math.radians(1.0)

#: the largest lost torque that is added, over the torque limit: on the presets' robots about three times the friction
#: of the nominal scenario
OBSERVED_TORQUE = 0.23

#: where x, y and psi stand in the state
_POSE_PLACES = (0, 1, 4)


def design_integral_gain(
    robot: RobotLike,
    *,
    state_weights: Sequence[float] = PRECISE_STATE_WEIGHTS,
    integral_weights: Sequence[float] = PRECISE_INTEGRAL_WEIGHTS,
    torque_weight: float | None = None,
    sample_time: float | None = None,
) -> LqrDesign:
    """Return the sampled LQR of the exact model without friction and of the integrals of x, y and psi.

    Ten and three weights are the diagonal of Q, the torque weight is that of R for every wheel, `PRECISE_TORQUE_WEIGHT`
    if not given; the sample time [s] is the robot's own if not given. InputError as `ballbot.lqr`.
    """
    robot = as_robot(robot)
    time = robot.sensors.sample_time if sample_time is None else sample_time
    weights = (*state_weights, *integral_weights)
    torques = (PRECISE_TORQUE_WEIGHT if torque_weight is None else torque_weight,) * robot.wheel_count
    design = lqr(_with_integrals(robot), weights, torques, sample_time=time)
    return replace(design, gain=design.gain[:, :10].copy(), integral_gain=design.gain[:, 10:].copy())


def _with_integrals(robot: Robot) -> StateSpace:
    """Return the model without friction (13, 13), the integrals of x, y and psi last."""
    linear = frictionless_model(robot).linearize()
    A, B = np.zeros((13, 13)), np.zeros((13, robot.wheel_count))
    A[:10, :10], B[:10] = linear.A, linear.B
    A[[10, 11, 12], _POSE_PLACES] = 1.0
    return replace(linear, A=A, B=B)


def precise_controller(
    robot: RobotLike,
    *,
    compensation: Compensation = "full",
    design: LqrDesign | None = None,
    compensated: Friction | None = None,
) -> Controller:
    """Return the controller with every part that earned its place; see docs/generated/evidence.md.

    The design has an integral gain; it is `design_integral_gain(robot)` if not given. The friction that is compensated
    is the robot's own if not given, and the certain part of it for the torque limit.
    """
    robot = as_robot(robot)
    known = robot if compensated is None else robot.replace(friction=compensated)
    chosen = design if design is not None else design_integral_gain(robot)
    time, integral_gain = chosen.sample_time, chosen.integral_gain
    if time is None or integral_gain is None:
        raise InputError("The precise controller needs a sampled gain with integral action.")
    limit = catching_torque_limit(robot, known.friction)
    lean = min(COMMANDED_LEAN, ERROR_LEAN * (limit - max(robot.friction.breakaway)) / torque_of_lean(robot))
    settings = LawSettings(
        robot=known,
        gain=chosen.gain,
        sample_time=time,
        compensation=compensation,
        speed_band=PRECISE_SPEED_BAND * default_speed_band(robot, time),
        delay=0.0,
    )
    return Controller(
        known,
        chosen.gain,
        sample_time=time,
        compensation=compensation,
        torque_limit=limit,
        speed_band=settings.speed_band,
        parts=Parts(
            planner=fastest_planner(settings, limit),
            feed_forward=FeedForward(),
            integral=IntegralAction(gain=integral_gain),
            disturbance_observer=DisturbanceObserver(limit=_rounded(OBSERVED_TORQUE * limit)),
            lean_limit=LeanLimit(lean=_rounded(lean)),
        ),
        estimator="kalman",
    )


def fastest_planner(settings: LawSettings, torque_limit: float) -> Planner:
    """Return the planner of the fastest motions that torque, lean and motors allow, its numbers rounded.

    InputError if the robot cannot have feed-forward.
    """
    robot, needed = settings.robot, FeedForward().numbers(settings)
    largest = float(np.linalg.norm(needed.by_second, axis=1).max())
    by_lean = COMMANDED_LEAN * float(np.linalg.norm(needed.pull, 2)) * largest / MOTION_TORQUE
    torque = min(torque_limit, grip_torque_limit(robot), by_lean)
    torque = max(torque, max(robot.friction.breakaway) + MOTION_LEAST * by_lean)
    turning = TURNING_TORQUE * torque / float(np.abs(needed.by_turning).max())
    return Planner(
        torque_limit=_rounded(torque),
        speed_limit=_rounded(MOTION_MOTOR_SPEED * largest_speed(robot)),
        speed_cap=PEOPLE_SPEED,
        yaw_acceleration_limit=_rounded(min(turning, YAW_ACCELERATION)),
    )


def largest_speed(robot: Robot) -> float:
    """Return the largest steady speed [m/s] at which motors have the torque for friction and a lean of `SPEED_LEAN`.

    In the motors' worst direction, along a wheel's rolling, by their torque over speed and by the grip.
    """
    drive, viscous = robot.drive, max(robot.friction.viscous)
    at_rest = max(robot.friction.breakaway) + SPEED_LEAN * torque_of_lean(robot)
    by_curve = (1.0 - drive.falling_rate * at_rest) / (1.0 / drive.top_speed + drive.falling_rate * viscous)
    left = catching_torque_limit(robot, robot.friction) - at_rest
    by_torque = left / viscous if viscous > 0.0 else math.inf
    return max(min(by_curve, by_torque), MOTION_LEAST * drive.top_speed) / wheel_turns(robot)


def _rounded(value: float) -> float:
    """Return a number with three digits, as a person would set it."""
    return float(f"{value:.3g}")


KIND = ControllerKind(
    name="precise",
    text="a stiff one that holds its position",
    compensation="full",
    state_weights=PRECISE_STATE_WEIGHTS,
    design=design_integral_gain,
    controller=lambda robot, compensated, design, compensation: precise_controller(
        robot, compensation=compensation, design=design, compensated=compensated
    ),
    candidates={"precise": "full", "precise_without_compensation": "none"},
)
