"""How a foreign table becomes a log, as values; `ballbot.log.apply_mapping` applies them.

Each of Ballbot's columns comes from one of the file's, times a factor (unit, scale, sign) plus an offset, or is the
derivative of another of Ballbot's columns, or comes with others from an IMU's roll, pitch and yaw. The motors' columns
become wheel torques [N m].

Symbols: n gear ratio, k_t torque constant [N m/A], k_e back-EMF constant [V s/rad], R winding resistance [ohm], all of
the motor's side; i current [A], V supply voltage [V], d duty (-1..1), w wheel speed seen by the encoder [rad/s].
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.log.formats.text import TextLayout


@dataclass(frozen=True, kw_only=True)
class TorqueInput:
    """The log holds wheel torques."""

    def acting(self, value: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the torque that the driver made of the torque logged: the same."""
        return value

    def torque(self, value: NDArray[np.float64], _wheel_speed: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return u [N m] = the value itself."""
        return value


@dataclass(frozen=True, kw_only=True)
class CurrentInput:
    """The log holds motor currents."""

    torque_constant: float  #: k_t [N m/A]
    gear_ratio: float  #: n [-]
    efficiency: float  #: of the gear, 0..1

    def acting(self, value: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the current that the driver made of the current logged: the same."""
        return value

    def torque(self, value: NDArray[np.float64], _wheel_speed: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return u [N m] = n k_t efficiency i."""
        return self.gear_ratio * self.torque_constant * self.efficiency * value


@dataclass(frozen=True, kw_only=True)
class DutyInput:
    """The log holds PWM duties of a brushed or field-oriented motor on a stiff supply, inductance neglected."""

    supply_voltage: float  #: V [V]
    torque_constant: float  #: k_t [N m/A]
    back_emf_constant: float  #: k_e [V s/rad]
    resistance: float  #: R [ohm]
    gear_ratio: float  #: n [-]
    dead_band: float = 0.0  #: duty that the firmware adds, in the duty's direction, to overcome friction
    duty_limit: float = 1.0  #: the largest duty that reaches the motor

    def acting(self, value: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the duty at the motor: d + dead_band sgn(d), within the limit."""
        return np.clip(value + self.dead_band * np.sign(value), -self.duty_limit, self.duty_limit)

    def torque(self, value: NDArray[np.float64], wheel_speed: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return u [N m] = n k_t (d V - k_e n w) / R of the duty d at the motor."""
        back_emf = self.back_emf_constant * self.gear_ratio * wheel_speed
        current = (value * self.supply_voltage - back_emf) / self.resistance
        return self.gear_ratio * self.torque_constant * current


DriveInput = TorqueInput | CurrentInput | DutyInput


@dataclass(frozen=True, kw_only=True)
class Source:
    """A column of the file: value = factor * cell + offset, in Ballbot's unit."""

    column: str  #: its name in the file
    factor: float = 1.0  #: unit, scale and sign in one
    offset: float = 0.0  #: in Ballbot's unit
    delay: float = 0.0  #: [s]


@dataclass(frozen=True, kw_only=True)
class MotorInput:
    """The motors' columns of the file, one for each wheel in Ballbot's order, and what they mean."""

    sources: tuple[Source, ...]
    drive: DriveInput


@dataclass(frozen=True, kw_only=True)
class Attitude:
    """Roll, pitch and, where the file has it, yaw of an IMU; see `ballbot.log.apply_mapping`."""

    sources: tuple[Source, ...]
    turn: float = 0.0  #: angle of the IMU's x axis from the robot's, towards the left [rad]


@dataclass(frozen=True, kw_only=True)
class Timing:
    """Which moments the log's rows are of."""

    repair: bool = False  #: whether the encoders say when a row was sampled; see `ballbot.log.sampling_times`
    sample_time: float | None = None  #: of rows at even intervals [s]; the file's own rows where it is None
    keep: tuple[tuple[float, float], ...] | None = (
        None  #: spans of the file's clock to keep [s]; None keeps all
    )


@dataclass(frozen=True, kw_only=True)
class LogMapping:
    """How a foreign file becomes a log; see `ballbot.log.mapping_file` for its TOML form."""

    layout: TextLayout
    columns: Mapping[str, Source]  #: by Ballbot's name, t among them
    derivatives: Mapping[str, str]  #: by Ballbot's name, which of Ballbot's columns to differentiate
    motors: MotorInput | None
    attitude: Attitude | None = None
    timing: Timing = Timing()
    largest_speed: float | None = (
        None  #: [rad/s]; a wheel angle that moves faster was reset and is carried on
    )
