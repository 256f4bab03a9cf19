"""Candidates of `study`: the accuracy of the precise controller, and where compensation helps.

.venv/bin/python -m campaigns.evidence choice friction_share

The friction is identified from two logs of the nominal twin, as in the demo. The controllers are the study's
candidates (`ballbot.workflows.controller_choice.candidates`), run on the nominal twin with other seeds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray

from ballbot.control.controller import Controller
from ballbot.control.references import Reference, circle, figure_eight, hold, square
from ballbot.estimation import named_estimator
from ballbot.estimation.interface import EstimatorName
from ballbot.log import Log
from ballbot.robot import Robot
from ballbot.twin import Scenario, Twin
from ballbot.twin.faults import Timing
from ballbot.workflows.comparison import (
    ComparedRun,
    Comparison,
    MedianEstimate,
    Paired,
    RunResult,
    median_with_interval,
    run_comparison,
)
from ballbot.workflows.controller_choice import candidates
from ballbot.workflows.metrics import SETTLE, position_error, rms, score
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


def run_cases(tried: Mapping[str, Controller], cases: Iterable[str], seeds: Sequence[int]) -> Comparison:
    """Run controllers on the nominal twin, on all cores; each case is a course."""
    return run_comparison(
        [
            ComparedRun(
                candidate=name,
                controller=controller,
                plant=partial(_twin, case),
                reference=partial(_reference, case),
                duration=CASES[case].duration,
                seed=seed,
                course=case,
                measure=partial(_measure, case),
            )
            for case in cases
            for name, controller in tried.items()
            for seed in seeds
        ]
    )


def _twin(case: str, estimator: EstimatorName) -> Twin:
    scenario = Scenario.nominal(ALTEN)
    if CASES[case].delay:
        scenario = replace(scenario, timing=Timing(delay=CASES[case].delay))
    return Twin(ALTEN, scenario, estimator=named_estimator(estimator, ALTEN, sample_time=SAMPLE_TIME))


def _reference(case: str) -> Reference:
    return CASES[case].reference


def _measure(case: str, log: Log) -> NDArray[np.float64]:
    return np.array([CASES[case].measure(log) if log.ended is None else np.nan])


def measured(runs: Sequence[RunResult]) -> NDArray[np.float64]:
    """Return what their case measures, of each run [m]; NaN of one that fell."""
    return np.array([one.measured[0] for one in runs])


def falls(runs: Sequence[RunResult]) -> int:
    """Return the number of runs that ended early."""
    return sum(one.score.ended is not None for one in runs)


def choice() -> Section:
    """Run none and precise on three courses, 20 seeds each."""
    known = controllers()
    found = run_cases({name: known[name] for name in ("none", "precise")}, COURSES, SEEDS)
    rows = []
    for course in COURSES:
        none, precise = (found.of(name, course) for name in ("none", "precise"))
        ratio = Paired(measured(none), measured(precise)).median_ratio
        rows.append(
            [
                course,
                _millimetres(median_with_interval(measured(none))),
                _millimetres(median_with_interval(measured(precise))),
                f"{1e3 * max(measured(precise)):.1f}",
                f"{ratio.median:.1f} ({ratio.low:.1f} to {ratio.high:.1f})",
                f"{falls(none)} and {falls(precise)} of {len(SEEDS)}",
            ]
        )
    return Section(
        title="The precise controller and the soft gain on three courses",
        before="The precise controller and the nominal gain without compensation on the nominal twin, "
        f"{len(SEEDS)} seeds, friction identified from two of its logs, on-board sensors only. Peak error of the true "
        "position once settled [mm]: median over the seeds with its 95 % interval, and the ratio seed by seed.",
        columns=["course", "none", "precise", "precise, worst", "none / precise", "falls"],
        rows=rows,
    )


def friction_share() -> Section:
    """Compare with and without compensation of the identified friction, in cases where it may pay."""
    known = controllers()
    precise = known["precise"]
    no_observer = precise.with_parts(replace(precise.parts, disturbance_observer=None))
    nominal = known["full"].with_estimator("kalman")
    families = {
        "precise": precise,
        "precise, no observer": no_observer,
        "nominal gain, Kalman filter": nominal,
    }
    tried = {
        f"{family}, {compensation}": controller.with_compensation(compensation)
        for family, controller in families.items()
        for compensation in ("none", "full")
    }
    found = run_cases(tried, REWARDING, FEWER_SEEDS)
    rows = []
    for case in REWARDING:
        for family in families:
            without, with_it = (found.of(f"{family}, {kind}", case) for kind in ("none", "full"))
            ratio = Paired(measured(without), measured(with_it)).median_ratio
            rough = [np.median([one.score.rms_torque_change for one in runs]) for runs in (without, with_it)]
            rows.append(
                [
                    case,
                    family,
                    _millimetres(median_with_interval(measured(without))),
                    _millimetres(median_with_interval(measured(with_it))),
                    f"{ratio.median:.2f} ({ratio.low:.2f} to {ratio.high:.2f})",
                    f"{rough[0]:.3f} and {rough[1]:.3f}",
                    f"{falls(without)} and {falls(with_it)}",
                ]
            )
    return Section(
        title="Where compensation of the identified friction helps",
        before=f"Without and with full compensation on the nominal twin, the same {len(FEWER_SEEDS)} seeds: median "
        "error [mm] with its 95 % interval, the ratio of the two seed by seed, roughness (median RMS change of the "
        "torques from sample to sample, N m) and falls.",
        columns=["case", "controller", "without", "with", "without / with", "roughness", "falls"],
        rows=rows,
    )


def _millimetres(estimate: MedianEstimate) -> str:
    return f"{1e3 * estimate.median:.1f} ({1e3 * estimate.low:.1f} to {1e3 * estimate.high:.1f})"
