"""Measure the precise controller: the effect of each part, one change at a time, and its accuracy over many seeds.

.venv/bin/python -m campaigns.evidence control_parts control_targets

The friction is identified from two logs of the nominal twin without compensation (`campaigns.compensation`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ballbot import Controller, Log, Robot
from ballbot.control.controller import Compensation
from ballbot.control.interface import Feedback
from ballbot.control.presets import adaptive, nominal_controller, precise_controller
from ballbot.control.references import Reference, change_pose, hold, square
from ballbot.estimation import named_estimator
from ballbot.estimation.interface import EstimatorName
from ballbot.robot.components import scaled_body, scaled_friction
from ballbot.twin import Scenario, Twin
from ballbot.workflows.comparison import ComparedRun, RunResult, mean_with_interval, run_comparison
from ballbot.workflows.metrics import cycle_amplitude
from campaigns.compensation import identified_robot
from campaigns.section import Section

SEEDS = tuple(range(200, 202))
REFERENCES = {"square": (square(side=0.5, period=32.0), 32.0), "hold": (hold(), 60.0)}
ALTEN = Robot.load("alten")


@dataclass(frozen=True, kw_only=True)
class Part:
    """A controller to run, and whose state it feeds back."""

    make: Callable[[Robot], Feedback]
    estimator: EstimatorName = "kalman"


@dataclass(frozen=True, kw_only=True)
class Run:
    """One run in numbers."""

    peak: float  #: position error once settled [m]
    rms: float  #: [m]
    cycle: float  #: amplitude of the limit cycle, of a hold [m]
    torque: float  #: RMS [N m]
    roughness: float  #: RMS change of torque from sample to sample [N m]
    fell: bool


def precise(robot: Robot, *, compensation: Compensation = "full", **parts: None) -> Controller:
    """Return the precise controller without the parts named."""
    whole = precise_controller(robot, compensation=compensation)
    return whole.with_parts(replace(whole.parts, **parts))


@dataclass
class Dithered:
    """A controller with a square wave added to every torque, the classical cure for sticking."""

    controller: Controller
    amplitude: float  #: [N m]
    samples: int = 4  #: half of them up, half down

    @property
    def sample_time(self) -> float:
        """The controller's."""
        return self.controller.sample_time

    def reset(self) -> None:
        """Forget everything."""
        self.controller.reset()

    def update(
        self, t: float, state: NDArray[np.float64], reference: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the controller's torques and the wave."""
        up = round(t / self.sample_time) % self.samples < self.samples // 2
        return self.controller.update(t, state, reference) + (self.amplitude if up else -self.amplitude)


def dithered(robot: Robot, *, share: float) -> Dithered:
    """Return the precise controller with dither, a fraction of the mean breakaway torque."""
    break_away = np.mean(np.add(robot.friction.coulomb, robot.friction.stribeck))
    return Dithered(controller=precise_controller(robot), amplitude=share * float(break_away))


#: by the name in the table
PARTS: Mapping[str, Part] = {
    "nominal gain, thesis's state, no compensation": Part(make=nominal_controller, estimator="onboard"),
    "nominal gain, thesis's state, full": Part(
        make=partial(nominal_controller, compensation="full"), estimator="onboard"
    ),
    "nominal gain, thesis's state, partial": Part(
        make=partial(nominal_controller, compensation="partial"), estimator="onboard"
    ),
    "nominal gain, full": Part(make=partial(nominal_controller, compensation="full")),
    "precise": Part(make=precise_controller),
    "precise, no compensation": Part(make=partial(precise_controller, compensation="none")),
    "precise, partial": Part(make=partial(precise_controller, compensation="partial")),
    "precise, no integral action": Part(make=partial(precise, integral=None)),
    "precise, no shaping": Part(make=partial(precise, shaping=None, feed_forward=None)),
    "precise, no feed-forward": Part(make=partial(precise, feed_forward=None)),
    "precise, dither of half the breakaway torque": Part(make=partial(dithered, share=0.5)),
    "precise, dither of the breakaway torque": Part(make=partial(dithered, share=1.0)),
    "precise, no lean limit": Part(make=partial(precise, lean_limit=None)),
    "precise, thesis's state": Part(make=precise_controller, estimator="onboard"),
    "precise, no observer": Part(make=partial(precise, disturbance_observer=None)),
    "precise, no observer, no compensation": Part(
        make=partial(precise, compensation="none", disturbance_observer=None)
    ),
    "precise, no observer, partial": Part(
        make=partial(precise, compensation="partial", disturbance_observer=None)
    ),
    "precise, no observer, adaptive": Part(
        make=lambda robot: adaptive(precise(robot, disturbance_observer=None))
    ),
    "precise, adaptive": Part(make=lambda robot: adaptive(precise(robot))),
}


def compared_run(robot: Robot, name: str, reference: str, seed: int) -> ComparedRun:
    """Return a run of a part on the nominal twin; `robot` has the identified friction."""
    return ComparedRun(
        candidate=name,
        controller=PARTS[name].make(robot),
        plant=partial(_twin, name),
        reference=partial(_reference, reference),
        duration=REFERENCES[reference][1],
        seed=seed,
        course=reference,
        measure=_cycle if reference == "hold" else None,
    )


def _twin(name: str, _: EstimatorName) -> Twin:
    part, scenario = PARTS[name], Scenario.nominal(ALTEN)
    return Twin(ALTEN, scenario, estimator=named_estimator(part.estimator, ALTEN, sample_time=0.005))


def _reference(name: str) -> Reference:
    return REFERENCES[name][0]


def _cycle(log: Log) -> NDArray[np.float64]:
    return np.array([cycle_amplitude(log) if log.ended is None else np.nan])


def summarised(result: RunResult) -> Run:
    """Return a run in numbers."""
    found = result.score
    return Run(
        peak=found.peak_position_error,
        rms=found.rms_position_error,
        cycle=float(result.measured[0]) if len(result.measured) else np.nan,
        torque=found.rms_torque,
        roughness=found.rms_torque_change,
        fell=found.ended is not None,
    )


def parts(seeds: Sequence[int] = SEEDS) -> Section:
    """Run every part with every seed and return the table."""
    robot = identified_robot(ALTEN)
    tried = [
        compared_run(robot, name, reference, seed)
        for name in PARTS
        for reference in REFERENCES
        for seed in seeds
    ]
    runs = {
        (run.candidate, run.course, run.seed): summarised(result)
        for run, result in zip(tried, run_comparison(tried).results, strict=True)
    }
    rows = []
    for name in PARTS:
        by_reference = {
            reference: [runs[name, reference, seed] for seed in seeds] for reference in REFERENCES
        }
        rows.append([name, *_numbers(by_reference["square"], by_reference["hold"])])
    return Section(
        title="The precise controller: effect of each part",
        before=f"The nominal twin, friction identified from two of its logs, on-board sensors only, {len(seeds)} "
        "seeds. 32 s of a 0.5 m square and a hold of 60 s; errors of the true position once settled [mm]: mean and "
        "largest peak over the seeds, mean RMS. The cycle is the amplitude of the hold's strongest periodic motion "
        "faster than 0.5 Hz, the largest over the seeds. Roughness: RMS change of torque from sample to sample [N m], "
        "in both runs. The Kalman filter's state is fed back unless the thesis's is named; each row after `precise` "
        "changes one thing; the dither is a square wave of 50 Hz on every torque.",
        columns=[
            "controller",
            "square: peak",
            "worst",
            "RMS",
            "hold: peak",
            "worst",
            "cycle",
            "torque",
            "roughness",
            "falls",
        ],
        rows=rows,
        after=_partial_against_full(runs, seeds),
    )


def _partial_against_full(runs: Mapping[tuple[str, str, int], Run], seeds: Sequence[int]) -> str:
    """Return the thesis's finding, partial against full compensation on the square, with intervals over the seeds."""
    differences = []
    for full, half in (
        ("precise", "precise, partial"),
        ("precise, no observer", "precise, no observer, partial"),
        ("nominal gain, thesis's state, full", "nominal gain, thesis's state, partial"),
    ):
        pairs = [(runs[full, "square", seed], runs[half, "square", seed]) for seed in seeds]
        stood = [(one, other) for one, other in pairs if not (one.fell or other.fell)]
        error = interval([1e3 * (other.rms - one.rms) for one, other in stood])
        rough = interval([other.roughness - one.roughness for one, other in stood])
        differences.append(f"{half}: RMS error {error} mm, roughness {rough} N m")
    return (
        "Partial minus full compensation on the square, seed by seed (mean and 95 % interval): "
        f"{'; '.join(differences)}. The thesis found less steady error and more high-frequency torque with partial."
    )


def interval(values: Sequence[float]) -> str:
    """Return a mean and its 95 % interval by Student's t."""
    if len(values) < 2:
        return "-"
    found = mean_with_interval(values)
    return f"{found.mean:+.3f} ({found.low:+.3f} to {found.high:+.3f})"


def _numbers(squares: Sequence[Run], holds: Sequence[Run]) -> list[str]:
    stood, held = ([one for one in runs if not one.fell] for runs in (squares, holds))
    falls = sum(one.fell for one in (*squares, *holds))
    both = [*stood, *held]
    lengths = [
        _mean([one.peak for one in stood]),
        max((one.peak for one in stood), default=np.nan),
        _mean([one.rms for one in stood]),
        _mean([one.peak for one in held]),
        max((one.peak for one in held), default=np.nan),
        max((one.cycle for one in held), default=np.nan),
    ]
    torques = [_mean([one.torque for one in both]), _mean([one.roughness for one in both])]
    return [
        *("-" if np.isnan(value) else f"{1e3 * value:.1f}" for value in lengths),
        *("-" if np.isnan(value) else f"{value:.3f}" for value in torques),
        f"{falls} of {len(squares) + len(holds)}",
    ]


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values)) if values else float("nan")


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
