"""The firmware beside Python in a closed loop: both see the same readings.

.venv/bin/python -m campaigns.evidence firmware_beside

Only the firmware's torques act: how far Python's go from them is rounding, and what becomes of it in memories that
nothing sets right.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot import Controller, Model, Robot, simulate
from ballbot.control.presets import nominal_controller, precise_controller
from ballbot.control.references import circle
from ballbot.control.safety import SafetyLimits
from ballbot.estimation import named_estimator
from ballbot.estimation.interface import Estimator, Reading
from ballbot.firmware.estimators import reading_record
from ballbot.firmware.records import parameter_record
from ballbot.simulation.imperfections import Imperfections
from ballbot.simulation.sensed_plant import SensedPlant
from ballbot.twin import Scenario
from campaigns.firmware_estimators import Rounded
from campaigns.section import Section
from tests.support.compiled_firmware import Firmware

#: what Python's law takes from the firmware beside it
Taken = Literal["nothing", "state", "memory"]
#: a difference of torques over the limit that only another branch makes
_OTHER_BRANCH = 1e-3

#: of the circle [s]
_LENGTH = 30.0


class ReadingTap:
    """An estimator that also keeps the last reading, for the firmware beside it."""

    def __init__(self, estimator: Estimator) -> None:
        self.reading: Reading | None = None
        self._estimator = estimator

    def reset(self, *, position: tuple[float, float] = (0.0, 0.0)) -> None:
        """Reset the estimator."""
        self.reading = None
        self._estimator.reset(position=position)

    def update(self, reading: Reading) -> NDArray[np.float64]:
        """Keep the reading and return the estimator's state (10,)."""
        self.reading = reading
        return self._estimator.update(reading)


class Beside:
    """The firmware as the controller of a plant; Python's estimator and law see the same readings, and drive nothing.

    Parameters
    ----------
    controller : Controller
    readings : ReadingTap
        The plant's estimator, Python's.
    taken : {"nothing", "state", "memory"}
        What Python's law takes from the firmware in each sample in place of its own.
    """

    def __init__(self, controller: Controller, readings: ReadingTap, *, taken: Taken = "nothing") -> None:
        self.controller, self.sample_time = controller, controller.sample_time
        self.estimator = controller.estimator
        limits = SafetyLimits.on_robot(controller.robot, sample_time=controller.sample_time)
        self.firmware = Firmware(parameter_record(controller, limits))
        self.firmware.skip_self_test()
        self._readings = readings
        self._rounded = Rounded(controller.robot, sample_time=controller.sample_time)
        self._taken: Taken = taken
        self._torques: list[NDArray[np.float64]] = []
        self._states: list[NDArray[np.float64]] = []

    def reset(self) -> None:
        """Arm the firmware, and let Python forget."""
        self.controller.reset()
        self._rounded.reset()
        self.firmware.arm()

    def update(self, t: float, state: ArrayLike, reference: ArrayLike) -> NDArray[np.float64]:
        """Return the firmware's torques (n,) [N m], and keep Python's."""
        reading, exact = self._readings.reading, np.asarray(state)
        wanted = np.asarray(reference, dtype=np.float32).astype(np.float64)  # the shaping differentiates it
        assert reading is not None
        memory = self.firmware.state["memory"].copy()
        record = reading_record(reading, robot=self.controller.robot)
        torques = self.firmware.update(record, round(1e6 * t), wanted).astype(np.float64)
        if self._taken == "memory":
            self.controller.memory[:] = memory
        given = self.firmware.estimate.astype(np.float64) if self._taken == "state" else exact
        self._torques.append(torques - self.controller.update(t, given, wanted))
        self._states.append(np.stack([self.firmware.estimate - exact, self._rounded.update(reading) - exact]))
        return torques

    @property
    def torques(self) -> NDArray[np.float64]:
        """Largest difference of a torque by sample (N,), over the limit."""
        return np.abs(self._torques).max(axis=1) / self.controller.torque_limit

    @property
    def states(self) -> NDArray[np.float64]:
        """Largest differences (2, 10) from Python's state: of the firmware's, and of the Kalman filter `Rounded`."""
        return np.abs(self._states).max(axis=0)


def beside(controller: Controller, *, duration: float, taken: Taken = "nothing", seed: int = 1) -> Beside:
    """Return the firmware and Python after a circle, with noise, encoder counts and play.

    Raises
    ------
    RuntimeError
        If the robot does not stay upright.
    """
    imperfections = Imperfections(sensors=controller.robot.sensors, backlash=0.017)
    readings = ReadingTap(
        named_estimator(controller.estimator, controller.robot, sample_time=imperfections.sensors.sample_time)
    )
    plant = SensedPlant(Model(controller.robot), imperfections, estimator=readings)
    loop = Beside(controller, readings, taken=taken)
    log = simulate(plant, loop, circle(radius=0.5, period=8.0), duration=duration, seed=seed)
    if log.ended or loop.firmware.stop:
        raise RuntimeError(f"The robot has fallen: {log.ended or loop.firmware.stop}.")
    return loop


def without_sums(controller: Controller) -> Controller:
    """Return a controller without the parts that sum up an error for ever."""
    return controller.with_parts(replace(controller.parts, disturbance_observer=None, integral=None))


def campaign() -> Section:
    """Return how far Python goes from the firmware beside it, and what takes it there."""
    robot = Robot.load("alten").replace(friction=Scenario.nominal(Robot.load("alten")).friction)
    precise = precise_controller(robot, compensation="partial")
    cases: list[tuple[str, Controller, Taken]] = [
        ("nominal, partial", nominal_controller(robot, compensation="partial"), "nothing"),
        ("precise, partial", precise, "nothing"),
        ("precise, partial", precise, "state"),
        ("precise, partial", precise, "memory"),
        ("precise, full", precise_controller(robot), "nothing"),
        ("precise, partial, without observer and integral", without_sums(precise), "nothing"),
    ]
    rows = []
    for name, controller, taken in cases:
        found = beside(controller, duration=_LENGTH, taken=taken)
        torques, (error, bound) = found.torques, found.states
        rows.append(
            [
                name,
                taken,
                f"{np.median(torques):.1e}",
                f"{np.quantile(torques, 0.999):.1e}",
                f"{torques.max():.1e}",
                f"{(np.diff(torques, prepend=0.0) > _OTHER_BRANCH).sum()} of {len(torques):,}",
                f"{(error / bound).max():.2f}" if controller.estimator == "kalman" else "",
            ]
        )
    return Section(
        title="The firmware beside Python in one loop",
        before=f"The firmware drives a robot around a circle for {_LENGTH:g} s, with noise, encoder counts and play. "
        "Python's estimator and law in float64 see the same readings and drive nothing; the law takes its own state "
        "and memory, or one of them from the firmware. Differences of a torque over the torque limit; samples in "
        f"which it grows by more than {_OTHER_BRANCH:g} at once; and the largest difference of a number of the Kalman "
        "filter's state over that of a filter in float64 with as many roundings "
        "(`campaigns.firmware_estimators.Rounded`).",
        columns=[
            "controller", "taken from the firmware", "median", "99.9 %", "largest", "other branch",
            "estimate over its bound",
        ],
        rows=rows,
        after="Observer and integral sum up an error until it is gone. Here Python's torques do not act, so that "
        "nothing takes back what its estimate, a few micrometres and microradians from the firmware's, has "
        "put into these sums. Partial compensation jumps with the sign of a wheel's torque.",
    )  # fmt: skip
