"""The load of a controller on its processor: instructions of an update, flash, RAM and stack.

The library is compiled for a Cortex-M4F and takes a rehearsal of some hundred samples on the emulator
(`ballbot.firmware.emulator`): a robot that sways, turns and rolls, a reference that stands, moves and jumps, and now
and then a sample without encoders, gyro or attitude, or with a fix. Such a rehearsal goes through every branch that
random states and references find in the parts of the controller (`tests/firmware/test_processor_load.py`).
"""

import importlib.util
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot.control.controller import Controller
from ballbot.errors import InputError
from ballbot.estimation.interface import Fix, Reading
from ballbot.firmware.build import source_files
from ballbot.firmware.emulator import CLOCK, CYCLES, Board, EmulatedCall, compile_image
from ballbot.firmware.estimators import reading_record
from ballbot.firmware.export import PROJECT, Export
from ballbot.firmware.header import SOURCES
from ballbot.firmware.records import STATE
from ballbot.mechanics.geometry import body_rates_matrix, rotation, transforms
from ballbot.records import MAX_WHEELS
from ballbot.results import reported
from ballbot.robot import Robot
from ballbot.robot.derived import encoder_step

_NO_HARDWARE = Path(__file__).parent / "no_hardware.c"
#: of a rehearsal
SAMPLES = 240
#: wheels of pip that a measurement needs
_NEEDED = ("ziglang", "unicorn")
#: chance that a sensor is missing in a sample, and that of a fix
_MISSING, _FIXES = 0.02, 0.035
#: samples of a phase of the reference
_PHASE = 20
#: offsets of the reference from the estimated x [m], y [m] and psi [rad], phase by phase: at rest, near, beyond what
#: the torques of any law can do, turned
_OFFSETS = ((0.0, 0.0, 0.0), (0.02, -0.01, 0.05), (10.0, 5.0, 0.0), (0.0, 0.0, 1.0), (-0.3, 0.3, -0.5))
#: speed by which a wheel slips, or the ball pivots, for four samples of sixty [rad/s]
_SLIP = 15.0
#: change of the reference in a sample of a phase, over the largest that the planner follows as a motion
_SLOW = 0.001
#: the row of a plan in the last of these phases: lean [rad], speed [m/s], and the change of its rate [rad/s]
_LEAN, _SPEED, _LEAN_RATE = 0.02, 0.3, 0.1
#: headings [rad] of it at the end of a phase: one that begins again after a turn, and one beyond a turn
_HEADINGS = (3.1, -3.1, 7.0)


@dataclass(frozen=True, kw_only=True)
class ProcessorLoad:
    """What the firmware takes on a Cortex-M4F; cycles are upper estimates."""

    clock: float  #: [Hz]
    period: float  #: sample time [s]
    samples: int  #: of the rehearsal
    compiler: str  #: and its version
    typical_instructions: int  #: median over the samples without a fix
    worst_instructions: int  #: largest over the samples without a fix
    fix_instructions: (
        int | None
    )  #: largest over the samples with a fix of the pose; None if the estimator takes none
    flash: (
        int  #: the whole library with a policy's weights, robot.c and the numbers of the controller [bytes]
    )
    ram: int  #: a `struct robot`: state, link, and the parameters that a host may write [bytes]
    stack: (
        int  #: of `robot_step`, along the deepest chain of calls, without the board's own functions [bytes]
    )

    @reported
    def worst_cycles(self) -> int:
        """Cycles of an update without a fix, at most."""
        return round(CYCLES * self.worst_instructions)

    @reported
    def worst_share(self) -> float:
        """Largest share of the period that an update without a fix takes [1]."""
        return self.worst_cycles / (self.clock * self.period)

    @reported
    def highest_rate(self) -> float:
        """Rate at which the worst update would take the whole period [Hz]."""
        return self.clock / (CYCLES * max(self.worst_instructions, self.fix_instructions or 0))


def what_to_install() -> str:
    """Return one sentence on what is missing for a measurement; empty if nothing is."""
    missing = [name for name in _NEEDED if importlib.util.find_spec(name) is None]
    return (
        f"Not measured: instructions, cycles, flash and stack need `pip install {' '.join(missing)}`."
        if missing
        else ""
    )


def check_clock(clock: float) -> None:
    """Raise InputError unless a processor's clock [Hz] is possible."""
    if not 1e6 <= clock <= 1e9:
        raise InputError(
            f"The clock of the processor must be between 1e6 and 1e9 Hz, not {clock:g}; 72 MHz is 72e6."
        )


def measure_load(
    controller: Controller,
    exported: Export,  # of the controller
    *,
    clock: float = CLOCK,  # of the processor [Hz]
) -> ProcessorLoad:
    """Return the load of an exported controller on its processor, measured on the emulator (`what_to_install`)."""
    sources = [*source_files(), PROJECT / "robot.c", _NO_HARDWARE]
    image = compile_image(sources, include=(SOURCES, PROJECT), weights=exported.weights)
    plain, fixed = [], []
    for update in rehearse(controller, exported, Board(image)):
        (fixed if update.has_fix else plain).append(update.run)
    takes_fixes = controller.estimator == "kalman"
    return ProcessorLoad(
        clock=clock,
        period=controller.sample_time,
        samples=len(plain) + len(fixed),
        compiler=f"ziglang {version('ziglang')}",
        typical_instructions=int(np.median([run.instructions for run in plain])),
        worst_instructions=max(run.instructions for run in plain),
        fix_instructions=max(run.instructions for run in fixed) if takes_fixes else None,
        flash=image.flash + exported.parameter_bytes,
        ram=image.ram,
        stack=image.stack_bound("robot_step"),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Update:
    """An update on the emulated processor: what it was given, what it gave and what it took."""

    reading: NDArray[np.void]  #: (1,) of `READING`
    time: int  #: [us]
    reference: NDArray[np.float32]  #: (10,)
    has_fix: bool
    torques: NDArray[np.float32]  #: (n,) [N m]
    state: NDArray[np.void]  #: (1,) of `STATE` after the update
    run: EmulatedCall


def rehearse(
    controller: Controller, exported: Export, board: Board, *, samples: int = SAMPLES
) -> Iterator[Update]:
    """Yield the updates of a rehearsal, armed, on a new emulated processor with the library in its flash."""
    robot, h = controller.robot, controller.sample_time
    parameters = board.place(exported.parameters)
    blank = np.zeros(1, STATE.dtype("single"))
    state = board.place(blank)
    reference, torques = np.zeros(10, np.float32), np.zeros(MAX_WHEELS, np.float32)
    wanted, answer = board.place(reference), board.place(torques)
    board.call("ballbot_init", state, parameters)
    if not board.read(state, blank)["run"]["known"][0]:
        raise InputError("The firmware refuses these parameters, so that its load cannot be measured.")
    board.call("ballbot_skip_self_test", state)
    board.call("ballbot_arm", state)
    given = 0
    for k, reading in enumerate(readings(robot, samples=samples, h=h, missing=_MISSING, fixes=_FIXES)):
        record = reading_record(reading, robot=robot)
        if not given:
            given = board.place(record)
        board.write(given, record)
        board.write(wanted, reference)
        time = round(1e6 * k * h)
        run = board.call("ballbot_update", state, parameters, given, time, wanted, answer)
        after = board.read(state, blank)
        yield Update(
            reading=record,
            time=time,
            reference=reference.copy(),
            has_fix=reading.fix is not None,
            torques=board.read(answer, torques)[: robot.wheel_count],
            state=after,
            run=run,
        )
        reference = _next_reference(
            reference, after["run"]["estimate"][0], k + 1, plans=controller.follows_plans
        )


def _next_reference(
    before: NDArray[np.float32], estimate: NDArray[np.float32], k: int, *, plans: bool
) -> NDArray[np.float32]:
    """Return the reference (10,) of sample k: it jumps at the start of a phase and moves on slowly within.

    A plan's rows come for two samples and then no more, until it counts as broken off.
    """
    reference = before.copy()
    phase, step = divmod(k, _PHASE)
    kind = phase % len(_OFFSETS)
    if step == 0:
        reference[:] = 0.0
        reference[[0, 1, 4]] = estimate[[0, 1, 4]] + np.array(_OFFSETS[kind], np.float32)
    elif step >= _PHASE - len(_HEADINGS):
        reference[4] = _HEADINGS[step - _PHASE]
    elif phase % 2:
        reference[[0, 1, 4]] += np.float32(_SLOW)
    if plans and kind == len(_OFFSETS) - 1 and step < 2:
        reference[[2, 5, 7]] = _LEAN, _SPEED, _LEAN_RATE * step
    return reference


def readings(
    robot: Robot,
    *,
    samples: int,
    seed: int = 1,
    h: float = 0.005,  # sample time [s]
    missing: float = 0.0,  # chance that encoders, gyro or attitude are missing in a sample
    fixes: float = 0.0,  # chance of a fix in a sample
) -> Iterator[Reading]:
    """Yield what the sensors of a robot show that sways, turns, rolls, pivots and slips with one wheel or another.

    The numbers are of single precision, the counts whole.
    """
    random = np.random.default_rng(seed)
    step, wheels = encoder_step(robot), transforms(robot).T_owb
    bias, drift = random.normal(0.0, 2e-3, 3), 1.5e-3
    angles = counted = np.zeros(robot.wheel_count)
    for k in range(samples):
        t = k * h
        attitude = np.array(
            [0.04 * np.sin(1.3 * t), -0.03 * np.cos(1.7 * t), 0.3 * np.sin(t) - 1.5 * np.cos(0.2 * t)]
        )
        rate = np.array(
            [0.052 * np.cos(1.3 * t), 0.051 * np.sin(1.7 * t), 0.3 * np.cos(t) + 0.3 * np.sin(0.2 * t)]
        )
        gyro = body_rates_matrix(*attitude) @ rate
        v_x, v_y = 0.4 * np.sin(0.5 * t), 0.3 * np.sin(0.3 * t)
        ball = rotation(*attitude).T @ np.array([-v_y, v_x, 0.0]) / robot.ball.radius
        turn = k // 60 % (robot.wheel_count + 1)  # of the wheels, and of the ball, which pivots
        who = (np.arange(robot.wheel_count) == turn) | (turn == robot.wheel_count)
        slip = np.where(who, _SLIP * (k % 60 > 55), 0.0)
        angles = angles + h * (wheels @ (ball - gyro) + slip)
        before, counted = counted, np.floor(angles / step) * step
        gyro = gyro + bias + random.normal(0.0, robot.sensors.gyro_noise, 3)
        shown = attitude + random.normal(0.0, robot.sensors.attitude_noise, 3) + [0.0, 0.0, drift * t]
        speeds, gyro, shown = (
            values.astype(np.float32).astype(np.float64) for values in ((counted - before) / h, gyro, shown)
        )
        lost = random.random(3) < missing
        heading = float(attitude[2]) + 2.0 * np.pi * random.integers(-2, 3)
        position = np.array([0.8 - 0.8 * np.cos(0.5 * t), 1.0 - np.cos(0.3 * t)]) + random.normal(
            0.0, 0.005, 2
        )
        yield Reading(
            wheel_angles=np.full_like(counted, np.nan) if lost[0] else counted,
            wheel_speeds=np.full_like(speeds, np.nan) if lost[0] else speeds,
            gyro=np.array([gyro[0], np.nan, 1e9]) if lost[1] else gyro,
            attitude=np.array([shown[0], np.nan, shown[2]]) if lost[2] else shown,
            fix=Fix(position=position, heading=heading) if random.random() < fixes else None,
        )
