"""Where the fit of friction ends: its cost beside those from random starts.

.venv/bin/python -m campaigns.evidence optima     writes the section, with BALLBOT_DATA=DIR

The logs are three of the twin, those of another twin in DIR/bbr and the public ones of DIR/rob311 (see
campaigns/course_robot.py); all twelve parameters of friction are estimated from each log by itself.
"""

import os
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import repeat
from pathlib import Path
from time import process_time

import numpy as np
from numpy.typing import NDArray

from ballbot.fitting.fit import descend, search
from ballbot.fitting.run import Run, Threads
from ballbot.identification.identify import (
    IdentificationOptions,
    Prepared,
    estimated_parameters,
    fixed_starts,
    prepare,
)
from ballbot.identification.quantities import Bounds
from ballbot.log import Log
from ballbot.processes import worker_pool
from ballbot.robot import Robot
from campaigns.course_robot import SOURCES, mapped
from campaigns.section import Section, data_folder
from campaigns.twin_logs import twin_log

STARTS = 20
DURATION = 48.0  # [s], of a twin's log
_RUN = Run(seed=0, executor=Threads(count=1))


@dataclass(frozen=True, kw_only=True, eq=False)
class Task:
    """A log whose friction is estimated."""

    robot: str
    log: Log
    options: IdentificationOptions


def prepared_for(task: Task) -> Prepared:
    """Return the problem of one log."""
    robot = Robot.load(task.robot)
    coordinates = estimated_parameters(robot, free=("friction",), law="stribeck", bounds=Bounds())
    return prepare(robot, coordinates, [task.log], window=0.25, options=task.options, run=_RUN)


@dataclass(frozen=True, kw_only=True)
class End:
    """Where a descent ended."""

    cost: float
    point: NDArray[np.float64]  #: (p,), scaled
    errors: NDArray[np.float64]  #: standard errors (p,) there
    seconds: float  #: of processor time


def fitted(task: Task, start: int | None) -> End:
    """Fit from where the search ends, both places if so many, or from that random point."""
    prepared = prepared_for(task)
    free = prepared.experiment.coordinates.free
    begun, steps = process_time(), task.options.most_steps
    point = prepared.experiment.coordinates.scaled(prepared.experiment.coordinates.nominal)
    if start is None:
        part = prepared.experiment.part(prepared.drawn)
        best, other = search(part, fixed_starts(part.coordinates), most_steps=steps, run=_RUN)
        points = [best] if other is None else [best, other]
    else:  # scaled parameters: U(0, 1)
        point[free] = np.random.default_rng([start, 48]).uniform(size=int(free.sum()))
        points = [point]
    fits = [descend(prepared.experiment, guess, free=free, most_steps=steps, run=_RUN) for guess in points]
    seconds, best = process_time() - begun, min(fits, key=lambda fit: fit.cost)
    return End(cost=best.cost, point=best.point, errors=best.errors, seconds=seconds)


def tasks() -> dict[str, Task]:
    """Return the logs by name."""
    by_name: dict[str, Task] = {}
    options = IdentificationOptions()
    for seed, reference in enumerate(("square", "hold", "figure_eight"), start=1):
        log = twin_log(reference, duration=DURATION, seed=seed)
        by_name[f"twin, {reference}"] = Task(robot="alten", log=log, options=options)
    folder = data_folder()
    for name in ("square_soft", "hold_soft", "thesis_step_soft"):
        log = Log.read(folder / "bbr" / f"{name}.csv")
        by_name[f"bbr, {name}"] = Task(robot="alten", log=log, options=options)
    with tempfile.TemporaryDirectory() as made:
        for name in SOURCES:
            log, back_emf = mapped(name, Path(made))
            excluding = IdentificationOptions(excluded_states=("psi", "psi_dot"), back_emf=back_emf)
            by_name[f"rob311, {name}"] = Task(robot="rob311", log=log, options=excluding)
    return by_name


@dataclass(frozen=True, kw_only=True)
class Ends:
    """Where the descents on one log ended."""

    searched: End  #: from the fixed starts
    drawn: Sequence[End]  #: from random starts


def ends_of(task: Task, *, starts: int, processes: int) -> Ends:
    """Fit from the search, and from random points."""
    with worker_pool(processes) as pool:
        searched, *drawn = pool.map(fitted, repeat(task), (None, *range(starts)))
        return Ends(searched=searched, drawn=drawn)


COLUMNS = (
    *("log", "cost", "s", "lowest of the random starts - cost"),
    *("random starts within 1e-6 of the lowest", "1e-5", "1e-4", "1e-3"),
    "largest distance of those within 1e-4, in standard errors",
)


def row(name: str, ends: Ends) -> list[str]:
    """Return a row of the table."""
    costs = np.array([fit.cost for fit in ends.drawn])
    ours, best = ends.searched, min((ends.searched, *ends.drawn), key=lambda end: end.cost)
    near = [end.point - best.point for end in ends.drawn if end.cost < best.cost + 1e-4]
    with np.errstate(invalid="ignore"):
        apart = np.nanmax(np.abs([np.zeros(len(best.point)), *near]) / best.errors)
    return [
        name,
        f"{ours.cost:.6f}",
        f"{ours.seconds:.1f}",
        f"{costs.min() - ours.cost:.1e}",
        *(str(int((costs - best.cost < within).sum())) for within in (1e-6, 1e-5, 1e-4, 1e-3)),
        f"{apart:.2f}",
    ]


def campaign() -> Section:
    """Fit every log from all starts and return the section of docs/generated/evidence.md."""
    processes = os.cpu_count() or 1
    return Section(
        title="The optimum of the fit",
        before="All twelve parameters of friction from one log each. The cost is the mean over the ten states of the "
        f"logarithm of the error over that without friction; s is processor time. {STARTS} random starts are points "
        "anywhere between the bounds, each descended from by itself, without a search; of these the columns on the "
        "right count those that end near the lowest cost of all.",
        columns=COLUMNS,
        rows=[row(name, ends_of(task, starts=STARTS, processes=processes)) for name, task in tasks().items()],
        after="Where the parameters agree, costs differ by windows that have several minima over their start. From "
        "some logs delta also ends at its upper bound: another optimum, which the result of such a log shows beside "
        "its own. A negative value in the column of the lowest says that the fit has not found the best one.",
    )
