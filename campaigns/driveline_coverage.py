"""Count how often the driveline stage's 95 % intervals contain the truth, on sweeps of the twin.

.venv/bin/python -m campaigns.evidence driveline_coverage

Each seed is a sweep of the nominal twin's free wheels, its three wheels three drivelines. Finished seeds are kept in
build/driveline_coverage and are not repeated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.stats import binomtest

from ballbot.identification.driveline import NAMES, DrivelineFit, fit_driveline, sweeps_of
from ballbot.robot import Robot
from ballbot.twin.bench import run_bench, sweep_torques
from ballbot.twin.scenario import Scenario
from campaigns.section import Section, finished

#: not those that the method was developed on, which began at 0
SEEDS = range(100, 108)
DURATION = 62.83  # [s], once around the thesis's sine

Numbers = dict[str, list[float]]


def truth_of(scenario: Scenario, wheel: int) -> list[float]:
    """Return the true b, c, s and v_s of a wheel (0 for the first); the twin's delta is 1.1."""
    friction = scenario.friction
    own = [friction.viscous[wheel], friction.coulomb[wheel], friction.stribeck[wheel]]
    return [*own, friction.stribeck_speed]


def fits_of(seed: int) -> list[DrivelineFit]:
    """Record a sweep of the nominal twin with that seed and fit its wheels."""
    robot = Robot.load("alten")
    scenario = Scenario.nominal(robot)
    torques = sweep_torques(robot, scenario, duration=DURATION)
    log = run_bench(robot, scenario, torques, bench="stand", seed=seed).log
    return [fit_driveline(sweep) for sweep in sweeps_of(robot, log)]


def numbers_of(fit: DrivelineFit) -> Numbers:
    """Return estimate, standard error and limits of each of the four; NaN for a parameter without interval."""
    return {
        "values": fit.values.tolist(),
        "errors": fit.standard_errors.tolist(),
        "lower": fit.intervals[:, 0].tolist(),
        "upper": fit.intervals[:, 1].tolist(),
    }


def _numbers_of_seed(seed: int) -> list[Numbers]:
    return [numbers_of(fit) for fit in fits_of(seed)]


def covered(done: Sequence[Numbers], truths: Sequence[Sequence[float]], place: int) -> tuple[int, int]:
    """Return how many intervals contain the truth, and how many there are."""
    given = [
        one["lower"][place] <= truth[place] <= one["upper"][place]
        for one, truth in zip(done, truths, strict=True)
        if not math.isnan(one["lower"][place])
    ]
    return sum(given), len(given)


def campaign() -> Section:
    """Run what is not yet done and return the section of docs/generated/evidence.md."""
    packages = ("fitting", "identification", "mechanics", "simulation", "robot", "log", "twin")
    known = finished(
        "driveline_coverage", _numbers_of_seed, {str(seed): seed for seed in SEEDS}, packages=packages
    )
    scenario = Scenario.nominal(Robot.load("alten"))
    done = [one for of_seed in known.values() for one in of_seed]
    truths = [truth_of(scenario, wheel) for _ in SEEDS for wheel in range(3)]
    rows = [_row(done, truths, place) for place in range(len(NAMES))]
    return Section(
        title="Coverage of the driveline stage's intervals",
        before=f"Sweeps of the nominal twin's free wheels (a sine of 1 N m and {DURATION:g} s; noise of the torque, "
        f"play and encoder counts on), {len(SEEDS)} seeds with three wheels each. The bias is the mean of the estimate "
        "less the truth over its standard error, with the standard error of that mean; next to it the standard "
        "deviation of the same ratio, 1 if the standard errors are right. Then how many 95 % intervals contain the "
        "truth, with the 95 % interval of that share (Clopper and Pearson), and the median half width.",
        columns=["", "bias", "deviation", "truth within", "share", "half width"],
        rows=rows,
    )


def _row(done: Sequence[Numbers], truths: Sequence[Sequence[float]], place: int) -> list[str]:
    off = np.array(
        [
            (one["values"][place] - truth[place]) / one["errors"][place]
            for one, truth in zip(done, truths, strict=True)
        ]
    )
    off = off[np.isfinite(off)]
    inside, count = covered(done, truths, place)
    share = binomtest(inside, count).proportion_ci()
    widths = np.array([one["upper"][place] - one["lower"][place] for one in done])
    half = 0.5 * float(np.median(widths[np.isfinite(widths)]))
    return [
        NAMES[place].replace("_", r"\_"),
        f"{off.mean():+.2f} ± {off.std(ddof=1) / math.sqrt(len(off)):.2f}",
        f"{off.std(ddof=1):.2f}",
        f"{inside} of {count}",
        f"{100.0 * inside / count:.0f} % ({100.0 * share.low:.0f} to {100.0 * share.high:.0f})",
        f"{half:.2g}",
    ]
