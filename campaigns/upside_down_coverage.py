"""Count how often the 95 % intervals of `ballbot identify-upside-down` contain the truth, on twins of many robots.

.venv/bin/python -m campaigns.evidence upside_down

Each seed is a robot of its own: friction, play and roller grip are drawn, and a minute of the ball on its wheels is
recorded. Finished seeds are kept in build/upside_down and are not repeated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import binomtest

from ballbot.identification.upside_down import WIDENED, identify_upside_down
from ballbot.log import Log
from ballbot.robot import Friction, Robot
from ballbot.twin.bench import multisine_torques, run_bench
from ballbot.twin.scenario import Scenario
from campaigns.section import Section, finished

#: not those that `WIDENED` was chosen on
SEEDS = range(201, 213)
DURATION = 60.0  # [s]
ROBOT = Robot.load("alten")
#: the quantities and how many numbers of each there are; s and v_s, for delta = 1, have no truth on a robot of another
QUANTITIES = {"b": 3, "c": 3}

Numbers = dict[str, list[float]]


def scenario_of(seed: int) -> Scenario:
    """Return the twin of a robot drawn with that seed, whose wheels differ by up to 15 %."""
    random = np.random.default_rng([seed, 47])
    b, c = random.uniform(0.005, 0.03), random.uniform(0.03, 0.2)  # U: sizes of small to heavy drivelines
    s = c * random.uniform(0.2, 0.6)  # U: break-away above Coulomb friction
    wheels = random.uniform(0.85, 1.15, (3, 3))  # U: wheel from wheel
    friction = Friction(
        viscous=tuple((b * wheels[0]).tolist()),
        coulomb=tuple((c * wheels[1]).tolist()),
        stribeck=tuple((s * wheels[2]).tolist()),
        stribeck_speed=float(random.uniform(0.3, 1.2)),  # U
        stribeck_exponent=float(random.uniform(0.8, 2.0)),  # U
        rolling=0.007,
    )
    return replace(
        Scenario.nominal(ROBOT),
        friction=friction,
        backlash=math.radians(random.uniform(0.0, 2.0)),  # U: play
        roller_grip=float(random.uniform(0.6, 1.0)),  # U: dusty to clean
    )


def recorded(scenario: Scenario, seed: int, *, duration: float = DURATION) -> Log:
    """Record the ball on the wheels of the robot held upside down."""
    torques = multisine_torques(ROBOT, scenario, duration=duration, seed=seed)
    return run_bench(ROBOT, scenario, torques, bench="upside_down", seed=seed).log


def numbers_of(log: Log, truth: Friction) -> Numbers:
    """Return truth, estimate and limits of each number, and whether the verdict is that it is usable."""
    found = identify_upside_down(ROBOT, log)
    labels = [f"{name}{i + 1}" for name, count in QUANTITIES.items() for i in range(count)]
    ends = [found.intervals.get(label, (math.nan, math.nan)) for label in labels]
    return {
        "truth": [*truth.viscous, *truth.coulomb],
        "values": np.concatenate([np.atleast_1d(found.parameters[name]) for name in QUANTITIES]).tolist(),
        "lower": [low for low, _ in ends],
        "upper": [high for _, high in ends],
        "usable": [float(found.verdict.usable)],
    }


def _numbers_of_seed(seed: int) -> Numbers:
    scenario = scenario_of(seed)
    return numbers_of(recorded(scenario, seed), scenario.friction)


def covered(done: Sequence[Numbers], places: Sequence[int]) -> tuple[int, int]:
    """Return how many intervals of the numbers at some places contain the truth, and how many there are."""
    given = [
        one["lower"][place] <= one["truth"][place] <= one["upper"][place]
        for one in done
        for place in places
        if not math.isnan(one["lower"][place])
    ]
    return sum(given), len(given)


def places_of(name: str) -> list[int]:
    """Return the places of a quantity's numbers."""
    before = list(QUANTITIES)[: list(QUANTITIES).index(name)]
    first = sum(QUANTITIES[one] for one in before)
    return list(range(first, first + QUANTITIES[name]))


def campaign() -> Section:
    """Run what is not yet done and return the section of docs/generated/evidence.md."""
    packages = ("fitting", "identification", "mechanics", "simulation", "robot", "log", "twin")
    runs = {str(seed): seed for seed in SEEDS}
    done = list(finished("upside_down", _numbers_of_seed, runs, packages=packages).values())
    usable = sum(one["usable"] == [1.0] for one in done)
    return Section(
        title="Coverage of the intervals of friction upside down",
        before=f"Twins of {len(SEEDS)} robots with friction, play and grip of the rollers drawn, {DURATION:g} s each "
        "of the ball on the wheels, with torque noise, encoder counts and the camera's noise. Intervals are those "
        f"clustered by window, times {WIDENED:g}, a factor chosen on 10 other robots. The truth is the drivelines' "
        "friction; the contacts' own, a few per cent of b, counts as an error. How many 95 % intervals contain it, "
        "with the 95 % interval of that share (Clopper and Pearson), and the median of half their width over the "
        "truth, of intervals that end on both sides.",
        columns=["", "truth within", "share", "half width"],
        rows=[_row(done, name) for name in QUANTITIES],
        after=f"Called usable: {usable} of {len(SEEDS)}.",
    )


def _row(done: Sequence[Numbers], name: str) -> list[str]:
    places = places_of(name)
    inside, count = covered(done, places)
    share = binomtest(inside, count).proportion_ci() if count else None
    halves = np.array(
        [0.5 * (one["upper"][k] - one["lower"][k]) / one["truth"][k] for one in done for k in places]
    )
    halves = halves[np.isfinite(halves)]
    return [
        name.replace("_", r"\_"),
        f"{inside} of {count}",
        f"{100.0 * inside / count:.0f} % ({100.0 * share.low:.0f} to {100.0 * share.high:.0f})"
        if share
        else "-",
        f"{100.0 * float(np.median(halves)):.2g} %" if halves.size else "-",
    ]
