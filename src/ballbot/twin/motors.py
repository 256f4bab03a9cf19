"""Motors, drivers and supply of the twin's wheels: from the torques commanded to those that act."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ballbot.robot.derived import wheel_speed_limit
from ballbot.robot.robot import Robot
from ballbot.twin.engine import Engine
from ballbot.twin.faults import Supply
from ballbot.twin.scenario import Scenario

# Near the supply's speed limit the voltage left over drives less and less current. Without a supply in the
# scenario the torque available falls in a straight line over the last twentieth of the speeds.
_FALLING_PART = 0.05


class Motors:
    """The motors of one twin: torque limit, speed limit or battery, and the drivers' lag.

    Parameters
    ----------
    robot : Robot
        Torque limit, and what follows from the supply.
    scenario : Scenario
    engine : Engine
        Has a motor "wheel 1" to "wheel n".
    """

    def __init__(self, robot: Robot, scenario: Scenario, engine: Engine) -> None:
        self._torques = engine.torques
        self._limit = robot.drive.torque_limit
        self._command = np.zeros(robot.wheel_count)
        self._limited = False
        loop = scenario.current_loop
        self._lags = loop is not None
        #: part of the way to the command that a driver's torque goes in a step
        self._share = 1.0 if loop is None else -math.expm1(-2 * math.pi * loop.bandwidth * engine.timestep)
        self._battery = Battery(robot, scenario.supply) if scenario.supply else None
        self._top = wheel_speed_limit(
            supply_voltage=robot.drive.supply_voltage,
            speed_constant=robot.drive.speed_constant,
            gear_ratio=robot.drive.gear_ratio,
        )
        #: speed above which a step must look at the supply; always where there is a lag or a battery
        plain = loop is None and scenario.supply is None
        self.knee = (1.0 - _FALLING_PART) * self._top if plain else -1.0

    def reset(self) -> None:
        """Let no torque act, and none be on its way."""
        self._command = np.zeros_like(self._command)
        self._torques[:] = 0.0
        self._limited = False

    def command(self, torques: NDArray[np.float64]) -> None:
        """Take the torques (n,) [N m] to hold from now on; clipped to the torque limit."""
        self._command = np.minimum(np.maximum(torques, -self._limit), self._limit)
        if self.knee > 0.0:
            self._torques[:] = self._command

    def prepare_step(self, speeds: NDArray[np.float64], *, fast: bool) -> None:
        """Set the torques for the physics step to come.

        Parameters
        ----------
        speeds : array (n,)
            Of the motors at the wheel, at the step's start [rad/s].
        fast : bool
            Whether one of them is above the knee.
        """
        if not (fast or self._limited):
            return
        self._limited = fast
        asked = self._torques + self._share * (self._command - self._torques) if self._lags else self._command
        supply = self._battery.within if self._battery else self._within_speed_limit
        self._torques[:] = supply(asked, speeds)

    def _within_speed_limit(
        self, torques: NDArray[np.float64], speeds: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        # the limit is one-sided: a motor at its highest speed can still brake with full torque
        forward = speeds * np.sign(torques)
        share = np.clip((self._top - forward) / (_FALLING_PART * self._top), 0.0, 1.0)
        return np.sign(torques) * np.minimum(np.abs(torques), share * self._limit)


class Battery:
    """What a battery with an inner resistance lets through the motors' windings; see `faults.Supply`."""

    def __init__(self, robot: Robot, supply: Supply) -> None:
        drive = robot.drive
        self._full = drive.supply_voltage
        self._inner = supply.internal_resistance
        self._winding = supply.winding_resistance
        self._ampere = drive.gear_ratio * drive.torque_constant  # [N m/A] at the wheel
        self._back = drive.gear_ratio / drive.speed_constant  # [V s/rad] at the wheel
        self.voltage = self._full  #: [V] at the last step

    def within(self, torques: NDArray[np.float64], speeds: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the torques (n,) [N m] that can flow of those asked, at motor speeds (n,) [rad/s]."""
        current = torques / self._ampere
        power = float(torques @ speeds + self._winding * (current @ current))
        # a loaded battery gives V = V_0 - R_i P / V_0; it takes back what braking motors give
        self.voltage = max(self._full - self._inner * power / self._full, 0.0)
        most = self._ampere * self.voltage / self._winding
        lost = self._ampere * self._back / self._winding * speeds
        return np.clip(torques, -most - lost, most - lost)
