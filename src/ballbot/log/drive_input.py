"""What a foreign log says of its motors, turned into wheel torques [N m].

Symbols: n gear ratio, k_t torque constant [N m/A], k_e back-EMF constant [V s/rad], R winding resistance
[ohm], all of the motor's side; i current [A], V supply voltage [V], d duty (-1..1), w wheel speed seen by
the encoder [rad/s].
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


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
