"""How far the Kalman filter trusts what: the sizes of all that it does not know."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from ballbot.errors import InputError
from ballbot.robot.robot import Robot


@dataclass(frozen=True, kw_only=True)
class FilterNoise:
    """Standard deviations and densities; a density is that of an integral of white noise after one second.

    The defaults are of the size of the thesis's robot with an AHRS of the Xsens MTi 1-series. Those that are not
    a sensor's own were taken from the twin: what its rollers and its play do to A^-1's velocity, averaged over a
    second, and its rolling friction.
    """

    gyro: float  #: of each sample [rad/s]
    attitude: float  #: white part of the AHRS's angles [rad]
    heading_drift: float  #: how fast the AHRS's heading may run away [rad/s]
    heading_drift_walk: float = 1e-5  #: how that changes [rad/s/sqrt(s)]
    heading_walk: float = 1e-4  #: the AHRS's heading besides [rad/sqrt(s)]
    gyro_bias: float = math.radians(0.2)  #: at the start [rad/s]
    gyro_bias_walk: float = 1e-5  #: [rad/s/sqrt(s)]
    lean_error: float = math.radians(0.2)  #: slow part of the AHRS's lean error [rad]
    lean_error_time: float = 10.0  #: over which that forgets itself [s]
    push: float = 0.02  #: of the momentum, by what pushes from outside [m/s/sqrt(s)]
    rolling: float = 1e-3  #: of the way that the wheels tell: rollers, play, slip [m/sqrt(s)]
    pivoting: float = 5e-3  #: of the ball's turning on the spot, as the wheels tell it [rad/sqrt(s)]
    pivoting_time: float = 0.5  #: over which that is averaged to find whether the ball pivots [s]
    pivoting_limit: float = 0.08  #: average from which it does; rollers and play make 0.02 [rad/s]
    start_position: float = 1e-3  #: of the place given at the reset [m]
    start_heading: float = 1e-3  #: of the AHRS's heading at the reset [rad]
    #: the robot stands still at the reset [m/s]; with ten times this doubt the first samples follow the motors through
    #: their play, and a stiff controller falls within a second
    start_speed: float = 0.005

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value >= 0):
                raise InputError(
                    f"{field.name} of the filter's noise is {value}; it must be a finite number, zero or more."
                )
        for name in ("rolling", "pivoting", "pivoting_time", "attitude", "lean_error_time"):
            if getattr(self, name) == 0:
                raise InputError(
                    f"{name} of the filter's noise is zero; it must be above zero, as no measurement is perfect."
                )

    @staticmethod
    def of(robot: Robot) -> FilterNoise:
        """Return what goes with a robot's own sensors; a perfect sensor is taken as a very good one."""
        sensors = robot.sensors
        return FilterNoise(
            gyro=max(sensors.gyro_noise, 1e-5),
            attitude=max(sensors.attitude_noise, 1e-5),
            heading_drift=max(abs(sensors.heading_drift), 1e-5),
        )
