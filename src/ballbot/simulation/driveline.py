"""One driveline, the wheel free: (j_w + j_r) w_dot = T(u, w) - tau(w) (thesis 3.1 to 3.4).

Torques are held over a sample. The supply's speed limit is a torque-speed curve.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.arrays import positive_number, real_array, real_number
from ballbot.errors import InputError
from ballbot.mechanics.driveline import UNLIMITED, Inertia, move
from ballbot.mechanics.engine.compiled import compiled
from ballbot.mechanics.friction import steady_friction
from ballbot.mechanics.parameters import wheels_of
from ballbot.robot import Friction, Robot


@compiled
def run_driveline(wheel, inertia, speed, torques, sample_time, steps, out):
    """Turn one driveline from a speed [rad/s] by torques (samples,); `out` (2, samples) takes speed and angle."""
    h, angle = sample_time / steps, 0.0
    for sample in range(len(torques)):
        for _ in range(steps):
            speed, travel = move(wheel, inertia, torques[sample], speed, h)
            angle += travel
        out[0, sample] = speed
        out[1, sample] = angle


_LARGEST_RATE_STEP = 0.5  # explicit steps are at most this part of the driveline's fastest time constant
_MAX_STEPS = 100_000  # a sample
#: at which the friction's slope is taken [rad/s]; the start of a law with delta below 1 is infinitely steep
_SPEEDS = np.geomspace(1e-3, 1e3, 400)


@dataclass(frozen=True, kw_only=True)
class TorqueSpeedCurve:
    """The torques that a supply lets through: T from -T_stall (1 + w/w_0) to T_stall (1 - w/w_0)."""

    no_load_speed: float  #: w_0 [rad/s]
    stall_torque: float  #: T_stall [N m] at full supply, whatever the driver's own limit


@dataclass(frozen=True, kw_only=True)
class Driveline:
    """Motor, gearbox and wheel, free to turn."""

    inertia: float  #: j_w + j_r [kg m^2]
    friction: Friction  #: of one wheel
    speed_limit: TorqueSpeedCurve | None = None

    @staticmethod
    def of_wheel(robot: Robot, wheel: int, *, speed_limit: TorqueSpeedCurve | None = None) -> Driveline:
        """Return the driveline of a robot's wheel (0 for the first) with the robot's friction."""
        inertia = robot.wheels.inertia + robot.drive.reflected_inertia
        return Driveline(inertia=inertia, friction=robot.friction.of_wheel(wheel), speed_limit=speed_limit)

    def fastest_rate(self) -> float:
        """Return the fastest rate [1/s] that an explicit step has to resolve."""
        slope = float(np.abs(np.diff(steady_friction(_SPEEDS, self.friction)) / np.diff(_SPEEDS)).max())
        if self.speed_limit:
            slope += self.speed_limit.stall_torque / self.speed_limit.no_load_speed
        return slope / self.inertia

    def numbers(self) -> Inertia:
        """Return inertia and speed limit as compiled code reads them."""
        curve = self.speed_limit
        return Inertia(
            inv_J=1.0 / self.inertia,
            stall=curve.stall_torque if curve else UNLIMITED,
            inv_no_load=1.0 / curve.no_load_speed if curve else 0.0,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class DrivelineMotion:
    """The result of `simulate_driveline` after every sample."""

    t: NDArray[np.float64]  #: (samples,) [s]
    speeds: NDArray[np.float64]  #: (samples,) [rad/s]
    angles: NDArray[np.float64]  #: (samples,) [rad], 0 at the start


def simulate_driveline(
    line: Driveline, torques: ArrayLike, *, sample_time: float, step: float = 1e-3, initial_speed: float = 0.0
) -> DrivelineMotion:
    """Turn a driveline by torques u (samples,) [N m] held over each sample [s].

    An inner step lasts at most `step` [s], and less where the driveline's fastest rate asks for that.

    InputError if the torques are no row of finite numbers, a time is not allowed, or the inertia is too small for its
    friction.
    """
    inputs = real_array(torques, ("samples",), "The array of torques")
    speed = real_number(initial_speed, "The initial speed")
    sample_time, step = positive_number(sample_time, "The sample time"), positive_number(step, "The step")
    wanted = max(sample_time / step, sample_time * line.fastest_rate() / _LARGEST_RATE_STEP)
    if wanted > _MAX_STEPS:
        raise InputError(
            f"A sample of {sample_time:g} s takes {wanted:.0f} inner steps, because the fastest rate of the "
            f"driveline is {line.fastest_rate():.3g}/s: its inertia of {line.inertia:g} kg m^2 is too small "
            f"for its friction, or the step of {step:g} s is too short."
        )
    steps = math.ceil(wanted * (1.0 - 1e-9))
    out = np.empty((2, len(inputs)))
    (wheel,) = wheels_of(line.friction)
    run_driveline(wheel, line.numbers(), speed, inputs, sample_time, steps, out)
    t = np.arange(1.0, len(inputs) + 1.0) * sample_time
    return DrivelineMotion(t=t, speeds=out[0], angles=out[1])
