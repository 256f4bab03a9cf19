"""What `study` hands out: its targets, where the gain comes from, and where identified friction still pays.

.venv/bin/python -m campaigns.evidence choice ablation friction_share

The friction is identified from two logs of the nominal twin, as the demo does; the controllers are the study's
candidates (`ballbot.workflows.controller_choice.candidates`), and they run on the nominal twin itself, whose friction
no identification has seen, with seeds of their own.
"""

from __future__ import annotations

import copy
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from ballbot.control.controller import Controller
from ballbot.control.references import Reference, circle, figure_eight, hold, square
from ballbot.estimation.interface import named_estimator
from ballbot.log import Log
from ballbot.processes import worker_pool
from ballbot.robot import Robot
from ballbot.simulation.run import simulate
from ballbot.twin import Scenario, Twin
from ballbot.twin.scenario import Timing
from ballbot.workflows.comparison import MedianEstimate, initial_state_of, median_with_interval
from ballbot.workflows.controller_choice import ABLATIONS, candidates, without_part
from ballbot.workflows.metrics import SETTLE, Score, position_error, rms, score
from campaigns.compensation import identified
from campaigns.section import Section

ALTEN = Robot.load("alten")
SAMPLE_TIME = 0.005
SEEDS = tuple(range(600, 620))
#: of the comparison with and without compensation, whose cases are many
FEWER_SEEDS = tuple(range(600, 608))
#: about a reversal of the slow line, the time in which errors count [s]
ABOUT_REVERSAL = 1.0
LINE_PERIOD = 16.0


def line(t: float) -> NDArray[np.float64]:
    """Return the reference that goes along x between 0 and 0.4 m and back at 5 cm/s, reversing every 8 s."""
    reference = np.zeros(10)
    phase = t % LINE_PERIOD
    reference[0] = 0.05 * min(phase, LINE_PERIOD - phase)
    return reference


@cache
def controllers() -> dict[str, Controller]:
    """Return the study's candidates for the robot as identified."""
    return candidates(identified(ALTEN), sample_time=SAMPLE_TIME)


@dataclass(frozen=True, kw_only=True)
class Job:
    """One run on the nominal twin."""

    controller: Controller
    case: str
    seed: int


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """One run in numbers."""

    score: Score
    measured: float  #: what the case measures [m]

    @property
    def fell(self) -> bool:
        """Whether it ended early."""
        return self.score.ended is not None


def peak(log: Log) -> float:
    """Return the largest error once settled [m]."""
    return score(log).peak_position_error


def settled_rms(log: Log) -> float:
    """Return the RMS error once settled [m]."""
    return score(log).rms_position_error


def reversal_error(log: Log) -> float:
    """Return the RMS error within a second after each reversal of the line, the start left out [m]."""
    since = log.t % (0.5 * LINE_PERIOD)
    rows = (since < ABOUT_REVERSAL) & (log.t > SETTLE)
    return rms(position_error(log)[rows])


@dataclass(frozen=True, kw_only=True)
class Case:
    """A course, and what is measured on it."""

    reference: Reference
    duration: float  #: [s]
    measure: Callable[[Log], float] = peak
    delay: int = 0  #: samples by which torques come late


#: of the study's targets
COURSES: Mapping[str, Case] = {
    "square": Case(reference=square(), duration=32.0),
    "circle": Case(reference=circle(), duration=40.0),
    "figure eight": Case(reference=figure_eight(), duration=46.0),
}
#: where friction compensation may pay
REWARDING: Mapping[str, Case] = {
    "square: peak error": COURSES["square"],
    "hold, 40 s: RMS error": Case(reference=hold(), duration=40.0, measure=settled_rms),
    "line at 5 cm/s: RMS error within 1 s of a reversal": Case(
        reference=line, duration=40.0, measure=reversal_error
    ),
    "circle at 2.6 cm/s: RMS error": Case(reference=circle(period=120.0), duration=40.0, measure=settled_rms),
    "square, torques 40 ms late: peak error": Case(reference=square(), duration=32.0, delay=8),
}
CASES: Mapping[str, Case] = {**COURSES, **REWARDING}


def run(job: Job) -> Outcome:
    """Make one run."""
    case, scenario = CASES[job.case], Scenario.nominal(ALTEN)
    if case.delay:
        scenario = replace(scenario, timing=Timing(delay=case.delay))
    estimator = named_estimator(job.controller.estimator, ALTEN, sample_time=SAMPLE_TIME)
    log = simulate(
        Twin(ALTEN, scenario, estimator=estimator),
        copy.deepcopy(job.controller),
        case.reference,
        duration=case.duration,
        initial_state=initial_state_of(job.seed),
        seed=job.seed,
    )
    return Outcome(score=score(log), measured=case.measure(log) if log.ended is None else np.nan)


def run_all(jobs: Sequence[Job]) -> list[Outcome]:
    """Run jobs on all cores."""
    with worker_pool(os.cpu_count()) as pool:
        return list(pool.map(run, jobs))


def choice() -> Section:
    """Run none and precise on three courses, 20 seeds each."""
    known = controllers()
    jobs = [
        Job(controller=known[name], case=course, seed=seed)
        for course in COURSES
        for name in ("none", "precise")
        for seed in SEEDS
    ]
    outcomes = iter(run_all(jobs))
    rows = []
    for course in COURSES:
        none, precise = ([next(outcomes) for _ in SEEDS] for _ in range(2))
        ratio = median_with_interval([a.measured / b.measured for a, b in zip(none, precise, strict=True)])
        rows.append(
            [
                course,
                _millimetres(median_with_interval([one.measured for one in none])),
                _millimetres(median_with_interval([one.measured for one in precise])),
                f"{1e3 * max(one.measured for one in precise):.1f}",
                f"{ratio.median:.1f} ({ratio.low:.1f} to {ratio.high:.1f})",
                f"{sum(one.fell for one in none)} and {sum(one.fell for one in precise)} of {len(SEEDS)}",
            ]
        )
    return Section(
        title="The controller that `study` hands out",
        before="The precise controller and the nominal gain without compensation on the nominal twin, "
        f"{len(SEEDS)} seeds, friction identified from two of its logs, on-board sensors only. Peak error of the true "
        "position once settled [mm]: median over the seeds with its 95 % interval, and the ratio seed by seed.",
        columns=["course", "none", "precise", "precise, worst", "none / precise", "falls"],
        rows=rows,
    )


def ablation() -> Section:
    """Remove each part of the precise controller by turns, 20 seeds on the square."""
    precise = controllers()["precise"]
    variants = {"nothing": precise} | {part: without_part(precise, part) for part in ABLATIONS}
    bare = without_part(precise, "disturbance observer")
    variants["observer and compensation"] = bare.with_compensation("none")
    jobs = [Job(controller=one, case="square", seed=seed) for one in variants.values() for seed in SEEDS]
    outcomes = iter(run_all(jobs))
    found = {name: [next(outcomes) for _ in SEEDS] for name in variants}
    whole = [one.score.peak_position_error for one in found["nothing"]]
    rows = []
    for name, runs in found.items():
        peaks = [np.nan if one.fell else one.score.peak_position_error for one in runs]
        ratio = median_with_interval(np.divide(peaks, whole))
        rough = median_with_interval([one.score.rms_torque_change for one in runs])
        rows.append(
            [
                name,
                _millimetres(median_with_interval(peaks)),
                f"{1e3 * median_with_interval([one.score.rms_position_error for one in runs]).median:.1f}",
                f"{ratio.median:.2f} ({ratio.low:.2f} to {ratio.high:.2f})",
                f"{rough.median:.3f}",
                f"{sum(one.fell for one in runs)} of {len(runs)}",
            ]
        )
    return Section(
        title="Where the precise controller's gain comes from",
        before=f"The 0.5 m square on the nominal twin, the same {len(SEEDS)} seeds for all, one part removed at a "
        "time. Without the estimator it feeds back the thesis's on-board state; without shaping it has no feed-forward "
        "either. "
        "Medians with 95 % intervals; the ratio is to the whole controller, seed by seed.",
        columns=["removed", "peak (mm)", "RMS (mm)", "peak's ratio", "roughness (N m)", "falls"],
        rows=rows,
    )


def friction_share() -> Section:
    """Compare with and without compensation of the identified friction, in cases where it may pay."""
    known = controllers()
    precise = known["precise"]
    no_observer = without_part(precise, "disturbance observer")
    nominal = known["full"].with_estimator("kalman")
    families = {
        "precise": precise,
        "precise, no observer": no_observer,
        "nominal gain, Kalman filter": nominal,
    }
    jobs = [
        Job(controller=controller.with_compensation(compensation), case=case, seed=seed)
        for case in REWARDING
        for controller in families.values()
        for compensation in ("none", "full")
        for seed in FEWER_SEEDS
    ]
    outcomes = iter(run_all(jobs))
    rows = []
    for case in REWARDING:
        for family in families:
            without, with_it = ([next(outcomes) for _ in FEWER_SEEDS] for _ in range(2))
            ratio = median_with_interval(
                [a.measured / b.measured for a, b in zip(without, with_it, strict=True)]
            )
            rough = [np.median([one.score.rms_torque_change for one in runs]) for runs in (without, with_it)]
            rows.append(
                [
                    case,
                    family,
                    _millimetres(median_with_interval([one.measured for one in without])),
                    _millimetres(median_with_interval([one.measured for one in with_it])),
                    f"{ratio.median:.2f} ({ratio.low:.2f} to {ratio.high:.2f})",
                    f"{rough[0]:.3f} and {rough[1]:.3f}",
                    f"{sum(one.fell for one in without)} and {sum(one.fell for one in with_it)}",
                ]
            )
    return Section(
        title="Where compensating the identified friction still pays",
        before=f"Without and with full compensation on the nominal twin, the same {len(FEWER_SEEDS)} seeds: median "
        "error [mm] with its 95 % interval, the ratio of the two seed by seed, roughness (median RMS change of the "
        "torques from sample to sample, N m) and falls.",
        columns=["case", "controller", "without", "with", "without / with", "roughness", "falls"],
        rows=rows,
    )


def _millimetres(estimate: MedianEstimate) -> str:
    return f"{1e3 * estimate.median:.1f} ({1e3 * estimate.low:.1f} to {1e3 * estimate.high:.1f})"
