"""The firmware on an emulated processor beside this computer: every update has the same bits."""

from collections.abc import Iterator
from functools import cache

import numpy as np

from ballbot import Controller, Robot
from ballbot.control.controller import Compensation
from ballbot.control.law import LAW, MEMORY
from ballbot.control.presets import nominal_controller, precise_controller
from ballbot.estimation.interface import EstimatorName
from ballbot.firmware.build import source_files
from ballbot.firmware.emulator import Board, EmulatedCall, Image, compile_image
from ballbot.firmware.export import export_controller
from ballbot.firmware.processor_load import Update, rehearse
from ballbot.records import converted
from ballbot.twin import Scenario
from tests.support.compiled_firmware import Firmware, library_of, weights_of
from tests.support.control_examples import with_policy
from tests.support.law_comparison import updates


@cache
def image(weights: str = "") -> Image:
    """Return the firmware's library, compiled for the processor with a header of a policy's weights."""
    return compile_image(source_files(), weights=weights)


def image_of(controller: Controller) -> Image:
    """Return the library with the weights of a controller's policy."""
    return image(weights_of(controller))


def law_runs(
    controller: Controller, *, lanes: int, count: int, board: Board | None = None
) -> Iterator[tuple[EmulatedCall, bool]]:
    """Return each call of a control law, and whether its torques are those of this computer bit for bit.

    A new board is taken if none is given.
    """
    board = board or Board(image_of(controller))
    law = board.place(converted(controller.record, LAW))
    memory = board.place(np.zeros(1, MEMORY.dtype("single")))
    state, reference = (board.place(np.zeros(10, np.float32)) for _ in range(2))
    wheels = len(controller.gain)
    answer = board.place(np.zeros(wheels, np.float32))
    for update, torques in updates(controller, library_of(controller), lanes=lanes, count=count, seed=1):
        for lane, expected in enumerate(torques):
            board.write(memory, update.memory[lane : lane + 1])
            board.write(state, update.state[lane])
            board.write(reference, update.reference[lane])
            run = board.call("ballbot_control_law", law, memory, state, reference, answer, wheels)
            yield run, board.read(answer, expected).tobytes() == expected.tobytes()


def firmware_runs(controller: Controller, *, samples: int) -> Iterator[tuple[Update, bool]]:
    """Return each update of a rehearsal, and whether torques and state are those of this computer bit for bit."""
    exported = export_controller(controller)
    host = Firmware(exported.parameters, weights=weights_of(controller))
    host.skip_self_test()
    host.arm()
    for update in rehearse(controller, exported, Board(image_of(controller)), samples=samples):
        expected = host.update(update.reading, update.time, update.reference.astype(np.float64))
        same = (
            update.torques.tobytes() == expected.tobytes() and update.state.tobytes() == host.state.tobytes()
        )
        yield update, same


def presets() -> dict[str, Controller]:
    """Return the thesis's robot's preset controllers, with each estimator that they are made for, and a policy."""
    robot = Robot.load("alten").replace(friction=Scenario.nominal(Robot.load("alten")).friction)
    compensations: tuple[Compensation, ...] = ("none", "full", "partial")
    estimators: tuple[EstimatorName, ...] = ("onboard", "kalman")
    by_name = {
        f"nominal {compensation}, {estimator}": nominal_controller(
            robot, compensation=compensation
        ).with_estimator(estimator)
        for compensation in compensations
        for estimator in estimators
    }
    precise = precise_controller(robot)
    return by_name | {"precise, kalman": precise, "policy of two layers of 64, kalman": with_policy(precise)}
