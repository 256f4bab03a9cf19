"""Motor, supply and friction of the twin's wheels, a physics step at a time.

Each wheel's friction acts on the motor's speed w relative to the body, the speed that its encoder sees:

    tau(w) = b w + (c + s exp(-|w/v_s|^delta)) sgn(w)

The viscous part is the joint's damping. The dry part is the joint's friction loss, which MuJoCo solves as a
constraint that really holds at rest; its size follows the speed and is set before each step.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ballbot.robot.derived import wheel_speed_limit
from ballbot.robot.robot import Robot
from ballbot.twin.engine import Engine
from ballbot.twin.scenario import Scenario

# Near the supply's speed limit the voltage left over drives less and less current. The robot file has no
# motor resistance, so the torque available falls in a straight line over the last twentieth of the speeds.
_FALLING_PART = 0.05


class Driveline:
    """The motors of one twin: torque limit, supply limit, and friction that follows the speed.

    Parameters
    ----------
    robot : Robot
        Torque limit, and the supply's speed limit.
    scenario : Scenario
        The friction that is true.
    engine : Engine
        Has a hinge and a motor "wheel 1" to "wheel n".
    """

    def __init__(self, robot: Robot, scenario: Scenario, engine: Engine) -> None:
        count = robot.wheel_count
        wheels = engine.velocities("wheel", count)
        friction = scenario.friction
        self.speeds = engine.qvel[wheels]  #: (n,) motor speeds at the wheel [rad/s], a view
        self._dry_friction = engine.dry_friction[wheels]
        self._torques = engine.torques
        self._coulomb = np.array(friction.coulomb)
        self._stribeck = np.array(friction.stribeck)
        self._slowness = 1.0 / friction.stribeck_speed
        self._exponent = friction.stribeck_exponent
        self._torque_limit = robot.drive.torque_limit
        self._speed_limit = wheel_speed_limit(
            supply_voltage=robot.drive.supply_voltage,
            speed_constant=robot.drive.speed_constant,
            gear_ratio=robot.drive.gear_ratio,
        )
        self._knee = (1.0 - _FALLING_PART) * self._speed_limit
        self._command = np.zeros(count)
        engine.damping[wheels] = friction.viscous

    def command(self, torques: NDArray[np.float64]) -> None:
        """Take the torques (n,) [N m] to hold from now on; clipped to the torque limit."""
        self._command = np.clip(torques, -self._torque_limit, self._torque_limit)

    def prepare_step(self) -> None:
        """Set torques and dry friction for the physics step to come, from the speeds at its start."""
        ratio = np.abs(self.speeds) * self._slowness
        self._dry_friction[:] = self._coulomb + self._stribeck * np.exp(-(ratio**self._exponent))
        if ratio.max() > self._knee * self._slowness:
            self._torques[:] = self._within_supply(self._command)
        else:
            self._torques[:] = self._command

    def _within_supply(self, torques: NDArray[np.float64]) -> NDArray[np.float64]:
        # the limit is one-sided: a motor at its highest speed can still brake with full torque
        forward = self.speeds * np.sign(torques)
        share = np.clip((self._speed_limit - forward) / (self._speed_limit - self._knee), 0.0, 1.0)
        return np.sign(torques) * np.minimum(np.abs(torques), share * self._torque_limit)
