"""Measure the precise controller's accuracy over many seeds.

.venv/bin/python -m campaigns.evidence control_targets

The friction is identified from two logs of the nominal twin without compensation (`campaigns.compensation`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import scipy
from numpy.typing import NDArray

from ballbot import Log, Robot
from ballbot.control.presets import nominal_controller, precise_controller
from ballbot.control.references import Reference, change_pose, hold, square
from ballbot.estimation import named_estimator
from ballbot.estimation.interface import EstimatorName
from ballbot.robot.components import scaled_body, scaled_friction
from ballbot.twin import Scenario, Twin
from ballbot.workflows.comparison import ComparedRun, RunResult, run_comparison
from campaigns.compensation import identified_robot
from campaigns.section import Section

ALTEN = Robot.load("alten")
SAMPLE_TIME = 0.005
OFF = 0.2  # by how much mass, height and friction are off


@dataclass(frozen=True, kw_only=True)
class Task:
    """A course, over many seeds."""

    reference: Reference
    duration: float  #: [s]
    seeds: range
    #: whether the twin's mass, height and friction are each 20 % above or below the robot file's
    off: bool = False
    precise: bool = True  #: or the nominal gain, uncompensated, with the thesis's state


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """One run in numbers."""

    peak: float  #: position error once settled [m]
    cycle: float  #: amplitude of the strongest periodic motion [m]
    heading: float  #: error at the end, by the robot's own sensors [rad]
    fell: bool


SQUARE, SPOT, CHANGE = square(side=0.5, period=32.0), hold(), change_pose(ramp=0.0)
TASKS = {
    "square, nominal gain, no compensation": Task(
        reference=SQUARE, duration=32.0, seeds=range(300, 320), precise=False
    ),
    "square": Task(reference=SQUARE, duration=32.0, seeds=range(300, 500)),
    "hold": Task(reference=SPOT, duration=60.0, seeds=range(300, 320)),
    "step to [1 -1 pi]": Task(reference=CHANGE, duration=20.0, seeds=range(300, 400)),
    "square, robot 20 % off": Task(reference=SQUARE, duration=32.0, seeds=range(300, 500), off=True),
}


def another(seed: int) -> tuple[Robot, Scenario]:
    """Return a robot whose mass, height and friction are each drawn 20 % above or below the nominal values."""
    mass, height, friction = 1.0 + OFF * np.random.default_rng([seed, 20]).choice([-1.0, 1.0], 3)
    robot = ALTEN.replace(body=scaled_body(ALTEN.body, mass=mass, height=height))
    nominal = Scenario.nominal(robot)
    return robot, replace(nominal, friction=scaled_friction(nominal.friction, friction))


def task_run(known: Robot, name: str, seed: int) -> ComparedRun:
    """Return a run of a task with a seed; `known` has the friction that was identified."""
    task = TASKS[name]
    return ComparedRun(
        candidate=name,
        controller=precise_controller(known) if task.precise else nominal_controller(known),
        plant=partial(_task_twin, name, seed),
        reference=partial(_task_reference, name),
        duration=task.duration,
        seed=seed,
        measure=_task_measure,
    )


def _task_twin(name: str, seed: int, estimator: EstimatorName) -> Twin:
    robot, scenario = another(seed) if TASKS[name].off else (ALTEN, Scenario.nominal(ALTEN))
    return Twin(robot, scenario, estimator=named_estimator(estimator, ALTEN, sample_time=SAMPLE_TIME))


def _task_reference(name: str) -> Reference:
    return TASKS[name].reference


def _task_measure(log: Log) -> NDArray[np.float64]:
    cycle = cycle_amplitude(log) if log.ended is None else np.nan
    return np.array([cycle, abs(log["psi"][-1] - log["ref_psi"][-1])])


#: slower than this is drift [Hz]
_MIN_CYCLE_FREQUENCY = 0.5


def cycle_amplitude(log: Log, *, settle: float = 6.0) -> float:
    """Return the amplitude of the strongest periodic motion along x or y [m], faster than 0.5 Hz.

    The true position counts where the log has it. A line's amplitude comes from the spectrum of the whole run from
    `settle` on under a Hann window, and so is that of a cycle which lasts.

    """
    place = log.truth() if "true_x" in log else log
    late = log.t - log.t[0] >= settle
    high = scipy.signal.butter(2, _MIN_CYCLE_FREQUENCY, "high", fs=1.0 / log.sample_time, output="sos")
    window = np.hanning(np.count_nonzero(late))
    lines = [np.abs(np.fft.rfft(scipy.signal.sosfiltfilt(high, place[name][late]) * window)) for name in "xy"]
    return float(2.0 * np.max(lines) / window.sum())


def outcome(result: RunResult) -> Outcome:
    """Return a run's numbers."""
    cycle, heading = result.measured.tolist()
    return Outcome(
        peak=result.score.peak_position_error,
        cycle=cycle,
        heading=heading,
        fell=result.score.ended is not None,
    )


def targets() -> Section:
    """Run every task with every seed and return the table."""
    known = identified_robot(ALTEN)
    found = run_comparison(
        [task_run(known, name, seed) for name, task in TASKS.items() for seed in task.seeds]
    )
    by_name = {name: [outcome(one) for one in found.of(name)] for name in TASKS}
    return Section(
        title="The precise controller: accuracy over hundreds of seeds",
        before="The precise controller on the nominal twin, friction identified from two of its logs, on-board sensors "
        "only (Kalman filter), 200 Hz. Errors of the true position once settled (6 s after the start and every jump) "
        "[mm]. The cycle of a hold is its strongest periodic motion faster than 0.5 Hz, its amplitude [mm].",
        columns=["task", "runs", "falls", "mean peak", "95 % below", "worst peak", "worst cycle"],
        rows=[_task_row(name, found) for name, found in by_name.items()],
    )


def _task_row(name: str, found: Sequence[Outcome]) -> list[str]:
    peaks = 1e3 * np.array([one.peak for one in found if not one.fell])
    cycle = max((1e3 * one.cycle for one in found if not one.fell), default=np.nan)
    numbers = [peaks.mean(), np.quantile(peaks, 0.95), peaks.max()] if len(peaks) else [np.nan] * 3
    return [
        name,
        f"{len(found)}",
        f"{len(found) - len(peaks)}",
        *(f"{number:.1f}" for number in numbers),
        f"{cycle:.2f}" if name == "hold" else "",
    ]
