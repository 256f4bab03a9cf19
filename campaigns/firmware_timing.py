"""Measure what the firmware takes on a Cortex-M4F: instructions, cycles, flash, RAM and stack.

.venv/bin/python -m campaigns.evidence firmware_timing

The code is compiled by Clang (the `ziglang` wheel, -O2) and run by the emulator; instructions are exact, cycles an
upper estimate (`ballbot.firmware.emulator.CYCLES`).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ballbot import Controller, Robot
from ballbot.control.law import LAW, MEMORY
from ballbot.estimation.interface import EstimatorName
from ballbot.firmware.emulator import CLOCK, CYCLES, Board, EmulatedCall, Image
from ballbot.firmware.estimators import reading_record
from ballbot.firmware.processor_load import SAMPLES, readings
from ballbot.firmware.records import PARAMETERS, STATE
from campaigns.section import Section
from tests.support.compiled_estimators import Compiled
from tests.support.firmware_on_processor import firmware_runs, image, image_of, law_runs, presets
from tests.support.law_comparison import controllers

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
