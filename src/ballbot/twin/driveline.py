"""Motors, shafts and friction of the twin's wheels, a physics step at a time.

Motors turn the commanded torques into those that act: torque limit, speed limit or battery, and the drivers' lag.
Each wheel's friction, that of `ballbot.mechanics.friction`, acts on the motor's speed w relative to the body, the speed
that its encoder sees. The viscous part is the joint's damping. The dry part is the joint's friction loss, which MuJoCo
solves as a constraint that sticks exactly at rest; its size depends on the speed and is set before each step. It may
differ forward and backward, and depend on the force between wheel and ball.

Shafts give the angles that encoders see. Wheels with rollers simply turn. A wheel that touches the ball in a single
point has one roller, which must stay under the ball: before each step such a wheel is turned back until its roller
touches, and the angle is added up. All speeds stay; the error of a step shrinks with the step.
"""

import math

import numpy as np
from numba import njit

from ballbot.arrays import Floats
from ballbot.mechanics.engine.compiled import compiled_alone
from ballbot.mechanics.friction import dry_friction_size, stribeck_curve
from ballbot.robot import Robot
from ballbot.robot.components import FALLING_PART
from ballbot.simulation.imperfections import DriveLimits
from ballbot.twin.engine import Engine
from ballbot.twin.scenario import Scenario


class Shafts:
    """The shafts of one twin: hinges "wheel 1" to "wheel n", and "play 1" to "play n" with play or a spring."""

    def __init__(self, robot: Robot, scenario: Scenario, engine: Engine) -> None:
        count = robot.wheel_count
        self._hinges = engine.qpos[engine.positions("wheel", count)]
        self._has_play = scenario.backlash > 0 or scenario.compliance is not None
        self._play = engine.qpos[engine.positions("play", count)] if self._has_play else None
        self._backlash = scenario.backlash
        #: whether the wheels must be turned back before each step
        self.returning = scenario.wheel_contact == "point"
        self._turned = np.zeros(count)

    def reset(self, random: np.random.Generator) -> None:
        """Set each wheel to a random angle, and the motor to a random place within its play."""
        count = len(self._hinges)
        self._hinges[:] = random.uniform(0.0, 2 * np.pi, count)
        if self._backlash > 0 and self._play is not None:
            self._play[:] = self._backlash * random.uniform(-0.5, 0.5, count)
        self._turned[:] = 0.0
        if self.returning:
            self.turn_back()

    def angles(self) -> Floats:
        """Return the motors' angles (n,) at the wheel [rad]."""
        return self._hinges + self._turned if self.returning else self._hinges

    def turn_back(self) -> None:
        """Turn every wheel so that its single roller touches the ball."""
        turn = self._hinges if self._play is None else self._hinges + self._play
        turn = turn.copy()
        self._turned += turn
        self._hinges -= turn


# Speed below which a wheel may turn either way; the sign of its torque is then the direction in which it would start
_AT_REST = 1e-3  # [rad/s]


_curve = njit(error_model="numpy")(stribeck_curve)


@compiled_alone
def _stribeck_sizes(speeds, coulomb, stribeck, slowness, exponent, sizes) -> float:
    """Write the plain dry friction of each wheel into `sizes` and return the largest |w|.

    Compiled, because it runs before every physics step: NumPy took a tenth of MuJoCo's own time.
    """
    largest = 0.0
    for i in range(len(speeds)):
        speed = abs(speeds[i])
        largest = max(largest, speed)
        sizes[i] = _curve(coulomb[i], stribeck[i], speed * slowness, exponent)
    return largest


class TwinDriveline:
    """The motors of one twin, hinges "wheel 1" to "wheel n", and friction that follows the speed."""

    def __init__(self, robot: Robot, scenario: Scenario, engine: Engine) -> None:
        wheels = engine.velocities("wheel", robot.wheel_count)
        self._friction = friction = scenario.friction
        self._directed = not friction.is_plain
        self.speeds = engine.qvel[wheels]  #: (n,) motor speeds at the wheel [rad/s], a view
        self._engine = engine
        self._dry_friction = engine.dry_friction[wheels]
        self._curve = (
            np.array(friction.coulomb),
            np.array(friction.stribeck),
            1.0 / friction.stribeck_speed,
            friction.stribeck_exponent,
        )
        dependence = scenario.load_dependence
        self._load = Load(robot, dependence.fraction, engine) if dependence else None
        self._torques = engine.torques
        self._limits = DriveLimits(robot, scenario.supply)
        self._command = np.zeros(robot.wheel_count)
        self._limited = False
        loop = scenario.current_loop
        self._lags = loop is not None
        # fraction of the difference to the command by which a driver's torque changes in a step
        self._fraction = 1.0 if loop is None else -math.expm1(-2 * math.pi * loop.bandwidth * engine.timestep)
        # speed above which the supply limits a step; below zero, always, with a lag or a battery
        plain = loop is None and scenario.supply is None
        self._knee = (1.0 - FALLING_PART) * self._limits.top_speed if plain else -1.0

    def reset(self) -> None:
        """Set all torques to zero, also those that a lag delays."""
        self._command = np.zeros_like(self._command)
        self._torques[:] = 0.0
        self._limited = False

    def command(self, torques: Floats) -> None:
        """Set the torques (n,) [N m] to hold from now on; clipped to the torque limit."""
        limit = self._limits.torque_limit
        self._command = np.minimum(np.maximum(torques, -limit), limit)
        if self._knee > 0.0:
            self._torques[:] = self._command

    def prepare_step(self) -> None:
        """Set torques and dry friction for the next physics step, from the speeds at its start."""
        fast = _stribeck_sizes(self.speeds, *self._curve, self._dry_friction) > self._knee
        if fast or self._limited:
            self._limited = fast
            lagged = self._torques + self._fraction * (self._command - self._torques)
            self._torques[:] = self._limits.within(lagged if self._lags else self._command, self.speeds)
        if self._directed:
            # in the direction in which each wheel turns, or is about to
            moves = np.abs(self.speeds) > _AT_REST
            towards = np.where(moves, self.speeds, np.copysign(_AT_REST, self._torques))
            self._dry_friction[:] = dry_friction_size(towards, self._friction, torque=self._torques)
        if self._load:
            self._load(self._dry_friction)

    def advance(self, steps: int, shafts: Shafts) -> None:
        """Advance the engine by so many physics steps."""
        prepare, step = self.prepare_step, self._engine.step
        for _ in range(steps):
            if shafts.returning:
                shafts.turn_back()
            prepare()
            step()


class Load:
    """Dry friction that depends on the force between a wheel and the ball in the last step."""

    def __init__(self, robot: Robot, fraction: float, engine: Engine) -> None:
        self._fraction = fraction
        self._engine = engine
        self._count = robot.wheel_count
        # at rest the wheels' forces, tilted by alpha, carry the body
        at_rest = robot.body.mass * robot.gravity / (self._count * math.cos(robot.wheels.tilt))
        self._per_newton = fraction / at_rest
        self._wheel_of = np.full(engine.model.ngeom, -1, dtype=np.intp)
        for i in range(self._count):
            self._wheel_of[engine.geoms_below(f"roller {i + 1}.")] = i

    def __call__(self, sizes: Floats) -> None:
        """Scale the sizes (n,) by each wheel's force."""
        forces = self._engine.pressures(self._wheel_of, self._count)
        sizes *= 1.0 - self._fraction + self._per_newton * forces
