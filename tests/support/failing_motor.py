"""A plant one of whose motors fails, and the faults of motors that a log's checks name."""

from dataclasses import dataclass

from numpy.typing import ArrayLike

from ballbot.arrays import Floats
from ballbot.robot import Robot
from ballbot.simulation.plant import Measurement, Plant

COLUMNS = ("opposite sign", "exchanged", "exchanged with the wheels")


@dataclass(frozen=True, kw_only=True)
class Fault:
    """What is wrong in a log."""

    kind: str
    motors: tuple[int, ...]  #: one, or the two that are exchanged (from 0)
    start: float  #: [s]
    length: float  #: [s]

    @property
    def codes(self) -> tuple[str, ...]:
        """The codes that name it."""
        if self.kind in COLUMNS:
            return ("torque-sign",) if len(self.motors) == 1 else ("torque-order",)
        weak = ("torque-scale",) if float(self.kind) > 0.0 else ()
        return (*weak, "dead-motor") if float(self.kind) < 0.5 else weak


class FailingMotor:
    """A plant one of whose motors gives a part of its torque for a while."""

    def __init__(self, plant: Plant, fault: Fault) -> None:
        self.plant, self.fault, self.t = plant, fault, 0.0

    @property
    def robot(self) -> Robot:
        """The plant's."""
        return self.plant.robot

    def reset(self, initial_state: ArrayLike | None, *, seed: int) -> Measurement:
        """Start again."""
        self.t = 0.0
        return self.plant.reset(initial_state, seed=seed)

    def step(self, torques: Floats, duration: float) -> Measurement:
        """Hold what the motors give of these torques."""
        if self.fault.start <= self.t < self.fault.start + self.fault.length:
            torques = torques.copy()
            torques[self.fault.motors[0]] *= float(self.fault.kind)
        measured = self.plant.step(torques, duration)
        self.t = measured.t
        return measured
