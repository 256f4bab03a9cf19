"""Motors and friction of the twin's wheels, a physics step at a time.

Each wheel's friction acts on the motor's speed w relative to the body, the speed that its encoder sees:

    tau(w) = b w + (c + s exp(-|w/v_s|^delta)) sgn(w)

The viscous part is the joint's damping. The dry part is the joint's friction loss, which MuJoCo solves as a
constraint that really holds at rest; its size follows the speed and is set before each step. It may differ
forward and backward, and follow the force between wheel and ball.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ballbot.mechanics.compiled import compiled_alone
from ballbot.robot.robot import Robot
from ballbot.twin.bristles import Bristles
from ballbot.twin.engine import Engine
from ballbot.twin.motors import Motors
from ballbot.twin.scenario import Scenario

# Speed below which a wheel may turn either way, and its torque says which way it would leave
_AT_REST = 1e-3  # [rad/s]


@compiled_alone
def _stribeck_sizes(speeds, coulomb, stribeck, slowness, exponent, sizes) -> float:
    """Write c + s exp(-|w/v_s|^delta) of each wheel into `sizes` and return the largest |w|.

    Compiled, because it runs before every physics step: NumPy took a tenth of MuJoCo's own time.
    """
    largest = 0.0
    for i in range(len(speeds)):
        speed = abs(speeds[i])
        largest = max(largest, speed)
        sizes[i] = coulomb[i] + stribeck[i] * math.exp(-((speed * slowness) ** exponent))
    return largest


class Driveline:
    """The motors of one twin, and friction that follows the speed.

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
        wheels = engine.velocities("wheel", robot.wheel_count)
        friction = scenario.friction
        self.speeds = engine.qvel[wheels]  #: (n,) motor speeds at the wheel [rad/s], a view
        self._motors = Motors(robot, scenario, engine)
        self._dry_friction = engine.dry_friction[wheels]
        self._curve = (
            np.array(friction.coulomb),
            np.array(friction.stribeck),
            1.0 / friction.stribeck_speed,
            friction.stribeck_exponent,
        )
        self._bristles = Bristles(scenario.driveline_laws, engine) if scenario.driveline_laws else None
        self._scalings: list[Callable[[NDArray[np.float64]], None]] = []
        if scenario.asymmetry:
            self._scalings.append(Asymmetry(scenario.asymmetry, self.speeds, engine.torques))
        if scenario.load_dependence:
            self._scalings.append(Load(robot, scenario.load_dependence.share, engine))

    def reset(self) -> None:
        """Let no torque act, and friction be as after a long rest."""
        self._motors.reset()
        if self._bristles:
            self._bristles.reset()

    def command(self, torques: NDArray[np.float64]) -> None:
        """Take the torques (n,) [N m] to hold from now on; clipped to the torque limit."""
        self._motors.command(torques)

    def prepare_step(self) -> None:
        """Set torques and dry friction for the physics step to come, from the speeds at its start."""
        fastest = _stribeck_sizes(self.speeds, *self._curve, self._dry_friction)
        self._motors.prepare_step(self.speeds, fast=fastest > self._motors.knee)
        for scaling in self._scalings:
            scaling(self._dry_friction)
        if self._bristles:
            self._dry_friction[:] = 0.0
            self._bristles.prepare_step()


class Asymmetry:
    """Dry friction that is larger forward than backward, or the other way."""

    def __init__(self, asymmetry: float, speeds: NDArray[np.float64], torques: NDArray[np.float64]) -> None:
        self._asymmetry = asymmetry
        self._speeds = speeds
        self._torques = torques

    def __call__(self, sizes: NDArray[np.float64]) -> None:
        """Scale the sizes (n,) by the direction in which each wheel turns, or is about to."""
        direction = np.where(np.abs(self._speeds) > _AT_REST, self._speeds, self._torques)
        sizes *= 1.0 + self._asymmetry * np.sign(direction)


class Load:
    """Dry friction that follows the force between a wheel and the ball, as it was in the last step."""

    def __init__(self, robot: Robot, share: float, engine: Engine) -> None:
        self._share = share
        self._engine = engine
        self._count = robot.wheel_count
        # at rest the wheels' forces, tilted by alpha, carry the body
        at_rest = robot.body.mass * robot.gravity / (self._count * math.cos(robot.wheels.tilt))
        self._per_newton = share / at_rest
        self._wheel_of = np.full(engine.model.ngeom, -1, dtype=np.intp)
        for i in range(self._count):
            self._wheel_of[engine.geoms_below(f"roller {i + 1}.")] = i

    def __call__(self, sizes: NDArray[np.float64]) -> None:
        """Scale the sizes (n,) by each wheel's force."""
        forces = self._engine.pressures(self._wheel_of, self._count)
        sizes *= 1.0 - self._share + self._per_newton * forces
