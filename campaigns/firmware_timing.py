"""Measure what the firmware takes on a Cortex-M4F: instructions, cycles, flash, RAM and stack.

.venv/bin/python -m campaigns.evidence firmware_timing

The code is compiled by Clang (the `ziglang` wheel, -O2) and run by the emulator; instructions are exact, cycles an
upper estimate (`ballbot.firmware.emulator.CYCLES`).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from ballbot import Controller, Robot
from ballbot.control.controller import Compensation
from ballbot.control.law import LAW, MEMORY
from ballbot.control.presets import nominal_controller, precise_controller
from ballbot.control.records import converted
from ballbot.estimation.interface import EstimatorName
from ballbot.firmware.build import source_files
from ballbot.firmware.emulator import CLOCK, CYCLES, Board, EmulatedCall, Image, compile_image
from ballbot.firmware.estimators import reading_record
from ballbot.firmware.export import export_controller
from ballbot.firmware.processor_load import SAMPLES, Update, readings, rehearse
from ballbot.firmware.records import PARAMETERS, STATE
from ballbot.twin import Scenario
from campaigns.firmware_numbers import controllers, updates
from campaigns.section import Section
from tests.support.compiled_estimators import Compiled
from tests.support.compiled_firmware import Firmware, library_of, weights_of
from tests.support.control_examples import with_policy

_SAMPLES = 400  # of each estimator
_UPDATES = 40  # of each of ten lanes of a controller
_PERIOD = 1e-3  # [s]
_BYTES = 4  # of a weight


@dataclass(frozen=True, kw_only=True)
class Timing:
    """The calls of one function."""

    name: str
    runs: tuple[EmulatedCall, ...]
    flash: int  #: of the function, all that it calls and a policy's weights [bytes]
    ram: int  #: of its record and its memory [bytes]
    stack: int  #: at most [bytes]

    def cells(self) -> list[str]:
        """Return the row of the table."""
        instructions = [run.instructions for run in self.runs]
        worst = round(CYCLES * max(instructions))
        return [
            self.name,
            f"{np.median(instructions):,.0f}",
            f"{max(instructions):,}",
            f"{worst:,}",
            f"{100 * worst / (CLOCK * _PERIOD):.1f} %",
            f"{CLOCK / worst:,.0f}",
            f"{self.flash:,}",
            f"{self.ram:,}",
            f"{self.stack:,}",
        ]


@cache
def image(weights: str = "") -> Image:
    """Return the firmware's library, compiled for the processor with a header of a policy's weights."""
    return compile_image(source_files(), weights=weights)


def image_of(controller: Controller) -> Image:
    """Return the library with the weights of a controller's policy."""
    return image(weights_of(controller))


def reachable(image: Image, name: str) -> set[str]:
    """Return the names of a function and of all that it calls, directly or through others."""
    names, left = {name}, [name]
    while left:
        new = image.calls(left.pop()) - names
        names |= new
        left += new
    return names


def timing(
    name: str, function: str, runs: list[EmulatedCall], ram: int, controller: Controller | None = None
) -> Timing:
    """Return the timing of calls of a function, in the library of a controller."""
    whole = image_of(controller) if controller else image()
    policy = controller.parts.policy if controller else None
    return Timing(
        name=name,
        runs=tuple(runs),
        flash=sum(len(whole.functions[callee]) for callee in reachable(whole, function))
        + (_BYTES * policy.weights.size if policy else 0),
        ram=ram,
        stack=whole.stack_bound(function),
    )


def estimator_runs(
    name: EstimatorName, robot: Robot, *, samples: int, missing: float = 0.0, fixes: float = 0.0
) -> Iterator[tuple[EmulatedCall, bool]]:
    """Return each call of an estimator, and whether state and memory are those of this computer bit for bit."""
    board, host = Board(image()), Compiled(name, robot, sample_time=_PERIOD)
    record, memory = board.place(host.record), board.place(host.memory)
    state, given = np.zeros(10, np.float32), 0
    answer = board.place(state)
    for reading in readings(robot, samples=samples, h=_PERIOD, missing=missing, fixes=fixes):
        taken = reading_record(reading, robot=robot)
        if not given:
            given = board.place(taken)
        board.write(given, taken)
        run = board.call(f"ballbot_{name}_update", record, memory, robot.wheel_count, given, answer)
        expected = host.take(taken)[0].astype(np.float32)
        result, kept = board.read(answer, state), board.read(memory, host.memory)
        yield run, result.tobytes() == expected.tobytes() and kept.tobytes() == host.memory.tobytes()


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


def timings(*, samples: int, count: int) -> list[Timing]:
    """Return the timings of estimators and controllers.

    Raises
    ------
    RuntimeError
        If a number is not that of this computer bit for bit.
    """
    robot = Robot.load("alten")
    table = []
    cases: list[tuple[str, EstimatorName, float]] = [
        ("Kalman filter", "kalman", 0.0),
        ("Kalman filter, with fixes", "kalman", 0.05),
        ("on-board state, thesis", "onboard", 0.0),
    ]
    for label, name, fixes in cases:
        rows = list(estimator_runs(name, robot, samples=samples, missing=0.05, fixes=fixes))
        _check(label, rows)
        host = Compiled(name, robot)
        ram = host.record.nbytes + host.memory.nbytes
        table.append(timing(label, f"ballbot_{name}_update", [run for run, _ in rows], ram))
    for label, design in controllers().items():
        if label.startswith("without") or label.endswith("alone"):  # those of the test of each part
            continue
        controller = design()
        rows = list(law_runs(controller, lanes=10, count=count))
        _check(label, rows)
        ram = LAW.dtype("single").itemsize + MEMORY.dtype("single").itemsize
        runs = [run for run, _ in rows]
        table.append(timing(f"law: {label}", "ballbot_control_law", runs, ram, controller))

    ram = PARAMETERS.dtype("single").itemsize + STATE.dtype("single").itemsize
    for label, controller in presets().items():
        updates_of = list(firmware_runs(controller, samples=SAMPLES))
        _check(label, updates_of)
        takes_fixes = controller.estimator == "kalman"
        for suffix, with_fix in (("", False), (", with fixes", True))[: 1 + takes_fixes]:
            runs = [update.run for update, _ in updates_of if update.has_fix == with_fix]
            name = f"whole update: {label}{suffix}"
            table.append(timing(name, "ballbot_update", runs, ram, controller))
    return table


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


def _check(label: str, rows: Sequence[tuple[object, bool]]) -> None:
    wrong = sum(not same for _, same in rows)
    if wrong:
        raise RuntimeError(
            f"{label}: {wrong} of {len(rows)} results differ between this computer and the processor."
        )


def campaign() -> Section:
    """Return the table."""
    whole = image()
    table = timings(samples=_SAMPLES, count=_UPDATES)
    return Section(
        title="The firmware on the processor",
        before="The estimators and controllers of the firmware on an emulated Cortex-M4F, compiled by Clang with -O2: "
        f"instructions of an update, typical (median) and largest, and cycles at most, {CYCLES:g} for each instruction "
        f"(`ballbot.firmware.emulator.CYCLES`). Share of {1e3 * _PERIOD:g} ms and highest rate are for the largest at "
        f"{CLOCK / 1e6:g} MHz. Flash is of the function and all that it calls, RAM of its record and its memory, stack "
        "of the deepest chain of calls by the compiler. A policy's weights count as flash. Every number of these runs "
        "has the bits of this computer.",
        columns=[
            "update", "instructions", "largest", "cycles", "share", "highest rate, Hz",
            "flash, B", "RAM, B", "stack, B",
        ],
        rows=[row.cells() for row in table],
        after=f"The whole library takes {whole.flash:,} bytes of flash and {whole.ram} bytes of variables.",
    )  # fmt: skip
