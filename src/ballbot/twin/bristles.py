"""Driveline friction of the laws whose force is a function of their own state, in place of the classical one.

LuGre's and Dahl's bristles and Armstrong's spring at rest hold a wheel by a force that is known from the state
and the speed; the physics engine is given that force. The classical law is set-valued at rest and goes to the
engine as a constraint instead (`ballbot.twin.driveline`).
"""

from __future__ import annotations

import numpy as np

from ballbot.mechanics.friction_laws import Armstrong, Dahl, LuGre, Smoothed, advance, friction_at
from ballbot.twin.engine import Engine

BristleLaw = Armstrong | Dahl | LuGre | Smoothed

#: as scenario files call them
LAW_NAMES: dict[str, type[BristleLaw]] = {
    "armstrong": Armstrong,
    "dahl": Dahl,
    "lugre": LuGre,
    "smoothed": Smoothed,
}


class Bristles:
    """The drivelines' friction of one twin, by a law for each wheel.

    Parameters
    ----------
    laws : tuple of law, (n,)
    engine : Engine
        Has a hinge "wheel 1" to "wheel n".
    """

    def __init__(self, laws: tuple[BristleLaw, ...], engine: Engine) -> None:
        wheels = engine.velocities("wheel", len(laws))
        self._laws = laws
        self._step = engine.timestep
        self._speeds = engine.qvel[wheels]
        self._forces = engine.applied[wheels]
        self.reset()

    def reset(self) -> None:
        """Let every law be as after a long rest."""
        self._states = [law.initial_state(self._step) for law in self._laws]

    def prepare_step(self) -> None:
        """Set the friction of the physics step to come, and let the laws' states follow the speed."""
        forces = np.empty(len(self._laws))
        for i, (law, speed) in enumerate(zip(self._laws, self._speeds.tolist(), strict=True)):
            self._states[i] = advance(law, self._states[i], speed=speed, step=self._step)
            forces[i] = -friction_at(law, speed, state=self._states[i])
        self._forces[:] = forces
