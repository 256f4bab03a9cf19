"""The firmware drives a robot; Python's estimator and law see the same readings and drive nothing."""

import numpy as np
from numpy.typing import ArrayLike

from ballbot import Controller, Model, simulate
from ballbot.arrays import Floats
from ballbot.control.references import circle
from ballbot.control.safety import SafetyLimits
from ballbot.estimation import named_estimator
from ballbot.estimation.interface import Reading
from ballbot.firmware.estimators import reading_record
from ballbot.firmware.records import parameter_record
from ballbot.simulation.imperfections import Imperfections
from ballbot.simulation.sensed_plant import SensedPlant
from tests.support.compiled_firmware import Firmware


class _Tap:
    """Python's estimator, which also keeps the last reading."""

    def __init__(self, controller: Controller) -> None:
        self._estimator = named_estimator(
            controller.estimator, controller.robot, sample_time=controller.sample_time
        )

    def reset(self, *, position: tuple[float, float] = (0.0, 0.0)) -> None:
        self._estimator.reset(position=position)

    def update(self, reading: Reading) -> Floats:
        self.reading = reading
        return self._estimator.update(reading)


class _Beside:
    """The firmware as a plant's controller; `torques` are Python's differences from it."""

    def __init__(self, controller: Controller, tap: _Tap) -> None:
        self.controller, self.estimator = controller, controller.estimator
        self.sample_time = controller.sample_time
        limits = SafetyLimits.on_robot(controller.robot, sample_time=controller.sample_time)
        self.firmware = Firmware(parameter_record(controller, limits))
        self.firmware.skip_self_test()
        self.torques: list[Floats] = []
        self._tap = tap

    def reset(self) -> None:
        self.controller.reset()
        self.firmware.arm()

    def update(self, t: float, state: ArrayLike, reference: ArrayLike) -> Floats:
        wanted = np.asarray(reference, dtype=np.float32).astype(np.float64)  # the planner differentiates it
        record = reading_record(self._tap.reading, robot=self.controller.robot)
        torques = self.firmware.update(record, round(1e6 * t), wanted).astype(np.float64)
        self.torques.append(torques - self.controller.update(t, state, wanted))
        return torques


def torques_beside(controller: Controller, *, duration: float) -> Floats:
    """Return by how much Python's torques differ from the firmware's in each sample (N,), over the torque limit.

    On a circle, slow enough to be followed without delay, with noise, encoder counts and play. Python's observer takes
    its own torques for those that act: by how far a fast reference must be followed behind, the difference would grow.
    """
    tap = _Tap(controller)
    imperfections = Imperfections(sensors=controller.robot.sensors, backlash=0.017)
    plant = SensedPlant(Model(controller.robot), imperfections, estimator=tap)
    loop = _Beside(controller, tap)
    log = simulate(plant, loop, circle(radius=0.5, period=12.0), duration=duration, seed=1)
    assert not log.ended
    assert loop.firmware.stop is None
    return np.abs(loop.torques).max(axis=1) / controller.torque_limit
