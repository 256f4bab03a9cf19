"""Measure the effect of floor adaptation if the floor changes, and on every course of the league.

.venv/bin/python -m campaigns.evidence adaptation

The friction is identified from two logs of the nominal twin without compensation (`campaigns.compensation`).
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot import Controller, Robot, simulate
from ballbot.control.presets import adaptive, precise_controller
from ballbot.control.references import Reference, circle, square
from ballbot.estimation import named_estimator
from ballbot.processes import worker_pool
from ballbot.simulation.plant import Measurement
from ballbot.twin import Twin
from ballbot.workflows.comparison import Paired, mean_with_interval
from ballbot.workflows.courses import LEAGUE, choose_courses
from ballbot.workflows.league import League, run_league
from ballbot.workflows.metrics import SETTLE, position_error, rms, settled
from campaigns.compensation import identified_robot
from campaigns.section import Section

ALTEN = Robot.load("alten")
SAMPLE_TIME = 0.005
CHANGE_SEEDS = tuple(range(600, 604))
COURSE_SEEDS = tuple(range(600, 605))

AT = 12.0  # when the floor changes [s]
LATE = 20.0  # so long after it the error left is measured [s]
DURATION = 64.0  # [s]; from AT + LATE on a whole round counts
REFERENCES: Mapping[str, Reference] = {"square": square(side=0.5, period=32.0), "circle": circle(period=32.0)}


@dataclass(frozen=True, kw_only=True)
class Floor:
    """A floor by its friction."""

    rolling: float  #: C_rr [-]
    pivoting: float  #: [m]


#: the nominal twin's is C_rr = 0.007 and 0.02 m; carpet is the league's
SAME = "unchanged"
FLOORS: Mapping[str, Floor] = {
    SAME: Floor(rolling=0.007, pivoting=0.02),
    "carpet": Floor(rolling=0.021, pivoting=0.04),
    "polished": Floor(rolling=0.002, pivoting=0.01),
}


class ChangingFloor:
    """The nominal twin, which rolls onto another floor at `AT`."""

    def __init__(self, robot: Robot, floor: Floor) -> None:
        self._twin = Twin(robot, estimator=named_estimator("kalman", robot, sample_time=SAMPLE_TIME))
        self._friction: NDArray[np.float64] = self._twin.engine.model.pair_friction
        self._first = self._friction.copy()
        moment = floor.rolling * robot.ball.radius  # as `ballbot.twin.mjcf` has it
        self._then = (floor.pivoting, moment, moment)
        self.robot = robot

    def reset(self, initial_state: ArrayLike | None, *, seed: int) -> Measurement:
        """Start again on the nominal floor."""
        self._friction[:] = self._first
        return self._twin.reset(initial_state, seed=seed)

    def step(self, torques: NDArray[np.float64], duration: float) -> Measurement:
        """Advance by a sample."""
        measured = self._twin.step(torques, duration)
        if measured.t >= AT - 0.5 * duration:
            self._friction[0, 2:5] = self._then
        return measured


def without_observer(robot: Robot) -> Controller:
    """Return the precise controller without the observer, which does part of what an adaptation does."""
    whole = precise_controller(robot)
    return whole.with_parts(replace(whole.parts, disturbance_observer=None))


#: by the name in the table, with fixed compensation; each also runs with adaptation
CONTROLLERS: Mapping[str, Callable[[Robot], Controller]] = {
    "precise": precise_controller,
    "precise, no observer": without_observer,
}


@dataclass(frozen=True, kw_only=True)
class Run:
    """One run from `LATE` after the change on, where settled: RMS position errors [m], NaN where it fell."""

    true: float  #: of the true position
    seen: float  #: by the robot's own state: without what that drifts, which no controller can know
    drag: float  #: of the floor, found at the end [m s]


Job = tuple[str, bool, str, str, int]  # controller, whether it adapts, reference, floor, seed


def run(known: Robot, job: Job) -> Run:
    """Make one run; `known` has the friction that was identified."""
    name, adapts, reference, floor, seed = job
    controller = CONTROLLERS[name](known)
    if adapts:
        controller = adaptive(controller)
    plant = ChangingFloor(ALTEN, FLOORS[floor])
    return _judged(plant, controller, REFERENCES[reference], seed=seed, duration=DURATION, since=AT + LATE)


def _judged(
    plant: Twin | ChangingFloor,
    controller: Controller,
    reference: Reference,
    *,
    seed: int,
    duration: float,
    since: float,
) -> Run:
    """Return a run in numbers, from that time [s] on."""
    log = simulate(plant, controller, reference, duration=duration, seed=seed)
    drag = controller.drag
    if log.ended is not None:
        return Run(true=np.nan, seen=np.nan, drag=drag)
    late = settled(log, SETTLE) & (log.t >= since)
    true, seen = rms(position_error(log)[late]), rms(position_error(log.without_truth())[late])
    return Run(true=true, seen=seen, drag=drag)


def campaign() -> Section:
    """Change the floor during a run and return the section of docs/generated/evidence.md."""
    known = identified_robot(ALTEN)
    jobs = change_jobs(CHANGE_SEEDS)
    with worker_pool(os.cpu_count()) as pool:
        runs = dict(zip(jobs, pool.map(partial(run, known), jobs), strict=True))
    return Section(
        title="Floor adaptation",
        before=f"The nominal twin, friction identified from two of its logs, on-board sensors only (Kalman filter), "
        f"{len(CHANGE_SEEDS)} seeds. At {AT:g} s the floor becomes carpet (three times the rolling friction, twice "
        f"the pivoting) or polished (less than a third, half). RMS position error from {LATE:g} s later on, settled, "
        "mean over the seeds [mm], beside that of the same runs on the unchanged floor, and the error that the change "
        "adds: mean and 95 % interval of the differences seed by seed, by the robot's own state, which excludes its "
        "drift. Adaptive is the controller with `ballbot.control.presets.adaptive`.",
        columns=[
            "controller, reference, floor",
            "unchanged: fixed",
            "adaptive",
            "changed: fixed",
            "adaptive",
            "added: fixed",
            "adaptive",
            "falls",
        ],
        rows=change_rows(runs, CHANGE_SEEDS),
    )


def change_jobs(seeds: Sequence[int]) -> list[Job]:
    """Return every run over a change of the floor."""
    return [
        (name, adapts, reference, floor, seed)
        for seed in seeds
        for name in CONTROLLERS
        for reference in REFERENCES
        for floor in FLOORS
        for adapts in (False, True)
    ]


def change_rows(runs: Mapping[Job, Run], seeds: Sequence[int]) -> list[list[str]]:
    """Return the first table: a row for each controller, reference and floor that comes."""
    return [
        [f"{name}: {reference}, {floor}", *_change_cells(runs, name, reference, floor, seeds)]
        for name in CONTROLLERS
        for reference in REFERENCES
        for floor in FLOORS
        if floor != SAME
    ]


def _change_cells(
    runs: Mapping[Job, Run], name: str, reference: str, floor: str, seeds: Sequence[int]
) -> list[str]:
    found = {
        (adapts, on): [runs[name, adapts, reference, on, seed] for seed in seeds]
        for on in (SAME, floor)
        for adapts in (False, True)
    }
    errors = [f"{1e3 * np.nanmean([one.true for one in those]):.1f}" for those in found.values()]
    added = []
    for adapts in (False, True):
        pairs = zip(found[adapts, floor], found[adapts, SAME], strict=True)
        mean = mean_with_interval([1e3 * (after.seen - before.seen) for after, before in pairs])
        added.append(f"{mean.mean:+.1f} ({mean.low:+.1f} to {mean.high:+.1f})")
    falls = sum(bool(np.isnan(one.true)) for those in found.values() for one in those)
    return [*errors, *added, f"{falls} of {4 * len(seeds)}"]


def ratio(values: Sequence[float], others: Sequence[float]) -> str:
    """Return the geometric mean of values over others, seed by seed, with its 95 % interval from three on."""
    found = Paired.of(values, others).ratio
    if len(values) < 3:
        return f"{found.mean:.2f}"  # an interval of two is useless
    return f"{found.mean:.2f} ({found.low:.2f} to {found.high:.2f})"


def run_courses(known: Robot, *, seeds: Sequence[int], courses: str = LEAGUE) -> League:
    """Run the precise controller on courses, fixed and adaptive."""
    fixed = precise_controller(known)
    controllers = {"fixed": fixed, "adaptive": adaptive(fixed)}
    return run_league(
        known,
        controllers,
        choose_courses(courses, known, "twin"),
        seeds=seeds,
    )


def course_rows(league: League) -> list[list[str]]:
    """Return for each course the errors of the fixed and the adaptive controller and their ratios."""
    rows = []
    for course in league.courses:
        pair = [league.scores[course.name, name] for name in ("fixed", "adaptive")]
        found = [course.name]
        for key in ("rms_position_error", "peak_position_error"):
            fixed, adapted = ([getattr(one, key) for one in scores] for scores in pair)
            found += [
                f"{1e3 * np.nanmean(fixed):.1f}",
                f"{1e3 * np.nanmean(adapted):.1f}",
                ratio(adapted, fixed),
            ]
        falls = " and ".join(str(sum(one.ended is not None for one in scores)) for scores in pair)
        rows.append([*found, falls])
    return rows


def courses() -> Section:
    """Run the league's courses and return the section of docs/generated/evidence.md."""
    league = run_courses(identified_robot(ALTEN), seeds=COURSE_SEEDS)
    return Section(
        title="Floor adaptation on the league's courses",
        before=f"The precise controller, fixed and adaptive, {len(league.seeds)} seeds. Errors of the true position "
        "once settled [mm], and their ratio, adaptive over fixed: geometric mean over the seeds and 95 % interval.",
        columns=["course", "RMS: fixed", "adaptive", "ratio", "peak: fixed", "adaptive", "ratio", "falls"],
        rows=course_rows(league),
    )
