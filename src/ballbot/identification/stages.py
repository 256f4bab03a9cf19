"""The stages of an identification: preparation of windows, search, Gauss-Newton, and errors on held-out windows.

The search finds the basin, on some of the windows: by short descents from a few fixed
starts, or by the thesis's stochastic search.

Whole intervals of each log are held out, 8 s of every 28 s: neighbouring windows share a swing of the limit cycle, and
a validation in closed loop needs seconds in one piece. As 28 s is not a multiple of the 8 s or 32 s with which
references often repeat, the intervals do not always hold the same piece of the path.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from itertools import product
from threading import Lock
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError, suggest
from ballbot.fitting.intervals import MOST_PROFILES
from ballbot.fitting.model_selection import Dependence, unidentifiable
from ballbot.fitting.run import DEFAULT_RUN, Executor, Run, Threads
from ballbot.fitting.search import SearchResult, at_bound, elsewhere, evolve
from ballbot.fitting.uncertainty import without_influence
from ballbot.identification.excitation import Excitation, check_count, check_excitation
from ballbot.identification.initial_states import (
    InitialStatesFit,
    Iterate,
    descend,
    first_iterate,
    fit_with_initial_states,
)
from ballbot.identification.parameters import Coordinates
from ballbot.identification.prediction import Cost, Predictor, Problem, chunks
from ballbot.identification.quantities import BY_NAME
from ballbot.identification.result import Identification, OtherOptimum, WindowErrors
from ballbot.identification.sweep import SweepFriction
from ballbot.identification.windows import Span, Windows, ball_spin, cut_windows, samples_before
from ballbot.log import STATE_NAMES, Log
from ballbot.mechanics.parameters import Formulation
from ballbot.progress import Progress

#: longest inner step of simulations [s]: with 2.5 or 1.25 ms an estimate moves by 0.15 of its standard error at most
INNER_STEP = 5e-3
#: largest rise of the cost when a parameter without influence returns to its nominal value
LARGEST_LOSS = 1e-3
#: quantities that act through another one only: v_s and delta shape how s fades
DEPENDENCES = (Dependence(through="stribeck", dependent=("stribeck_speed", "stribeck_exponent")),)
#: how the basin is found: by descents from a few fixed starts, or by an evolution strategy, as in the thesis
Search = Literal["multistart", "genetic"]
#: the fixed starts of friction, scaled: every amount's, and v_s and delta
_AMOUNTS, _SHAPES = (0.05, 0.2), (0.3, 0.6)
#: from so many of them so many steps, side by side; the best go on
_SEARCH = ((4, 3), (2, 6))


def states_counted(excluded: Sequence[str]) -> NDArray[np.bool_]:
    """Return which states (10,) count if these are excluded from the cost.

    Raises
    ------
    InputError
        If one is not a state, or no state is left.
    """
    for name in excluded:
        if name not in STATE_NAMES:
            hint = suggest(name, STATE_NAMES, otherwise="the states are")
            raise InputError(f"{name!r} is not a state; {hint}")
    counted = np.array([name not in excluded for name in STATE_NAMES])
    if not counted.any():
        raise InputError("Every state is excluded from the cost; at least one must remain.")
    return counted


@dataclass(frozen=True, kw_only=True, eq=False)
class IdentificationOptions:
    """Options of `identify` besides what it estimates; the defaults suit most logs.

    Raises
    ------
    InputError
        If the held-out fraction is not between 0 and 1, a count is too small, or a state that is excluded is not one.
    """

    accept: Collection[str] = ()  #: codes of errors found in the logs to ignore; see `ballbot.findings.CODES`
    formulation: Formulation = "exact"  #: of the equations of motion
    held_out: float = 2 / 7  #: fraction of each log that the fit does not see, to validate it on
    excluded_states: tuple[str, ...] = ()  #: whose errors do not count, as the heading where the ball pivots
    #: b_e of a motor driven by voltage [N m s/rad], if the logs' torques contain its back-EMF
    back_emf: float = 0.0
    #: Gauss-Newton begins from its numbers where they predict better
    warm_start: Identification | None = None
    sweep: SweepFriction | None = None  #: friction from a sweep of the free wheels, to combine with the logs'
    search: Search = "multistart"
    generations: int = 150  #: of the genetic search, at most
    population: int = 24  #: sets of parameters in each generation
    evolution_windows: int = 64  #: windows that the search looks at; Gauss-Newton takes all
    gauss_newton_steps: int = 75  #: Gauss-Newton steps, at most
    #: parameters with doubtful errors whose intervals are profiled, at most
    most_profiles: int = MOST_PROFILES
    step: float = INNER_STEP  #: longest one of simulations [s]

    def __post_init__(self) -> None:
        if not 0.0 < self.held_out < 1.0:
            raise InputError(
                f"held_out is {self.held_out!r}; it must be a fraction between 0 and 1, such as 0.25."
            )
        if self.search not in get_args(Search):
            raise InputError(f"search is {self.search!r}; it must be one of {', '.join(get_args(Search))}.")
        for name, least in (
            ("generations", 1),
            ("population", 4),
            ("evolution_windows", 1),
            ("gauss_newton_steps", 1),
            ("most_profiles", 0),
        ):
            if getattr(self, name) < least:
                raise InputError(f"{name} is {getattr(self, name)!r}; it must be {least} or more.")
        states_counted(self.excluded_states)

    @property
    def counted(self) -> NDArray[np.bool_]:
        """Which states (10,) count in the cost."""
        return states_counted(self.excluded_states)


#: suits most logs
DEFAULT_OPTIONS = IdentificationOptions()


@dataclass(frozen=True, kw_only=True, eq=False)
class Prepared:
    """Windows to fit and to validate on, and the least-squares problems that they make."""

    problem: Problem  #: all windows to fit
    coarse: Problem  #: some of them, for the search
    fit: Windows
    held_out: Windows
    excitation: Excitation


@dataclass(frozen=True, kw_only=True, eq=False)
class PointEstimate:
    """Result of the search, and the parameters that the logs determine there."""

    finished: InitialStatesFit
    values: NDArray[np.float64]  #: (p,), SI units
    no_influence: NDArray[np.bool_]  #: (p,)
    refused: NDArray[np.bool_]  #: (p,), those that the logs do not excite
    estimated: NDArray[np.bool_]  #: (p,), those with a standard error
    other: OtherOptimum | None  #: where another descent ended

    @property
    def unknown(self) -> NDArray[np.bool_]:
        """Which parameters (p,) get no number."""
        return self.no_influence | self.refused


def windows_for(
    predictor: Predictor, upper: NDArray[np.float64], logs: Sequence[Log], *, duration: float
) -> Windows:
    """Cut logs into windows with what the predictor's parameters, up to `upper` (p,), need besides the states."""
    layout = predictor.layout
    pivots = "pivoting" in layout.extra
    return cut_windows(
        logs,
        wheel_count=layout.wheel_count,
        duration=duration,
        before=lambda sample_time: samples_before(layout, upper, sample_time),
        spins=[ball_spin(log, predictor.robot) for log in logs] if pivots else None,
    )


def prepare(
    predictor: Predictor,
    coordinates: Coordinates,
    logs: Sequence[Log],
    *,
    window: float,
    options: IdentificationOptions = DEFAULT_OPTIONS,
    run: Run = DEFAULT_RUN,
) -> Prepared:
    """Cut the logs, hold windows out and check that the others excite the parameters.

    Parameters
    ----------
    window : float
        Length of a window [s].
    options : IdentificationOptions, optional
    run : Run, optional
        Its seed draws the windows that the evolution looks at; its executor works on evolution and Gauss-Newton.

    Raises
    ------
    InputError
        If the logs do not excite the parameters.
    """
    windows = windows_for(predictor, coordinates.upper, logs, duration=window)
    held = [holdout_intervals(log, fraction=options.held_out) for log in logs]
    fit_rows, held_rows = split_in_time(windows.spans, held)
    check_count(windows, fitted=len(fit_rows), parameters=int(coordinates.free.sum()))
    fit = windows.take(fit_rows)
    excitation = check_excitation(fit, predictor.robot, coordinates)
    drawn = np.sort(np.random.default_rng(run.seed).permutation(len(fit))[: options.evolution_windows])
    return Prepared(
        problem=_problem(predictor, fit, coordinates, options.counted, run.executor),
        coarse=_problem(predictor, fit.take(drawn), coordinates, options.counted, run.executor),
        fit=fit,
        held_out=windows.take(held_rows),
        excitation=excitation,
    )


#: from one interval that is held out to the next, and what of that comes before it [s]
_HOLDOUT_CYCLE, _HOLDOUT_OFFSET = 28.0, 12.0


def holdout_intervals(
    log: Log, *, fraction: float = IdentificationOptions.held_out
) -> tuple[tuple[float, float], ...]:
    """Return the (start, end) [s] that a fit does not see; a log shorter than a cycle has one, in proportion."""
    first, duration = float(log.t[0]), float(log.t[-1] - log.t[0])
    cycle = min(_HOLDOUT_CYCLE, duration)
    length = fraction * cycle
    offset = min(_HOLDOUT_OFFSET * cycle / _HOLDOUT_CYCLE, cycle - length)
    starts = np.arange(offset, max(duration - 0.5 * length, np.nextafter(offset, np.inf)), cycle)
    ends = np.minimum(starts + length, duration)
    return tuple((first + float(start), first + float(end)) for start, end in zip(starts, ends, strict=True))


def split_in_time(
    spans: Sequence[Span], held_out: Sequence[Sequence[tuple[float, float]]]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the numbers of the windows to fit and of those held out, which overlap an interval of their log.

    At least one is held out.

    Parameters
    ----------
    spans : sequence of Span
    held_out : sequence of sequence of (float, float)
        The intervals (start, end) [s] of each log.
    """
    held = np.array(
        [any(one.start < end and start < one.end for start, end in held_out[one.log]) for one in spans],
        dtype=bool,
    )
    if len(held) and not held.any():
        held[len(held) // 2] = True
    return np.flatnonzero(~held), np.flatnonzero(held)


def _problem(
    predictor: Predictor,
    windows: Windows,
    coordinates: Coordinates,
    counted: NDArray[np.bool_],
    executor: Executor,
) -> Problem:
    before = np.clip(coordinates.nominal, coordinates.lower, coordinates.upper)
    none = predictor.layout.without_friction(before)
    reference = predictor.square_sums(none[None], windows, every=windows.comparison_interval)[0]
    cost = Cost(reference=reference, counted=counted)
    return Problem(
        predictor=predictor, windows=windows, coordinates=coordinates, cost=cost, executor=executor
    )


def search(problem: Problem, *, options: IdentificationOptions, run: Run) -> SearchResult:
    """Find the basin in the parameters that are free, the others where they are held."""
    return (_multistart if options.search == "multistart" else _genetic)(problem, options=options, run=run)


def _multistart(problem: Problem, *, options: IdentificationOptions, run: Run) -> SearchResult:
    """Descend from each of the fixed starts, from the best ones farther, and return the best end."""
    rounds = _rounds(options)
    total, done, least = sum(count * steps for count, steps in rounds), 0, np.inf
    reporting = Lock()  # descents go side by side

    def report(step: Progress) -> None:
        nonlocal done, least
        with reporting:
            done, least = done + 1, min(least, step.cost)
            run.progress(Progress(stage="search", done=min(done, total), total=total, cost=least))

    def descent(steps: int, begin: NDArray[np.float64] | Iterate) -> Iterate:
        reported = replace(run, progress=report)
        return descend(problem, begin, free=problem.coordinates.free, most_steps=steps, run=reported).end

    # a cluster works on the pieces of each descent
    threads = run.executor if isinstance(run.executor, Threads) else Threads()
    begins: Sequence[NDArray[np.float64] | Iterate] = _fixed_starts(problem.coordinates)
    found: list[Iterate] = []
    for count, steps in rounds:
        found = sorted(threads(descent, steps, begins[:count]), key=lambda one: one.cost)
        begins = found
    best = found[0].point
    others = (one.point for one in found[1:] if elsewhere(best, one.point))
    return SearchResult(best=best, history=(), other=next(others, None))


def _rounds(options: IdentificationOptions) -> list[tuple[int, int]]:
    """Return how many descents go on in each round of the search, and with how many steps."""
    return [(count, min(steps, options.gauss_newton_steps)) for count, steps in _SEARCH]


def _fixed_starts(coordinates: Coordinates) -> list[NDArray[np.float64]]:
    """Return the scaled points (p,) that the search begins from: quantities besides friction as they were."""
    names, own = np.array(coordinates.names), coordinates.scaled(coordinates.nominal)
    points = []
    for amount, shape in product(_AMOUNTS, _SHAPES):
        point = own.copy()
        for name, value in {
            **dict.fromkeys(("viscous", "coulomb", "stribeck", "rolling"), amount),
            "stribeck_speed": shape,
            "stribeck_exponent": shape,
            **{name: shape if BY_NAME[name].scale == "ratio" else amount for name in coordinates.layout.own},
        }.items():
            point[(names == name) & coordinates.free] = value
        if not any(np.array_equal(point, one) for one in points):
            points.append(point)
    return points


def _genetic(problem: Problem, *, options: IdentificationOptions, run: Run) -> SearchResult:
    """Search within the bounds by an evolution."""
    coordinates = problem.coordinates
    free = coordinates.free
    fixed = coordinates.scaled(coordinates.nominal)

    def points(drawn: NDArray[np.float64]) -> NDArray[np.float64]:
        all_of_them = np.tile(fixed, (len(drawn), 1))
        all_of_them[:, free] = drawn
        return np.where(free, coordinates.from_search(all_of_them), all_of_them)

    evolved = evolve(
        lambda population: problem.costs(points(population)),
        size=int(free.sum()),
        generations=options.generations,
        population=options.population,
        run=run,
    )
    return SearchResult(best=points(evolved.best[None])[0], history=evolved.history)


def refine(
    prepared: Prepared,
    start: NDArray[np.float64],
    *,
    options: IdentificationOptions,
    run: Run,
    also: NDArray[np.float64] | None = None,
) -> PointEstimate:
    """Fit by Gauss-Newton, from a second point also, fix what has no influence, and fit the rest again from there."""
    problem = prepared.problem
    free, steps = problem.coordinates.free, options.gauss_newton_steps
    finished = fit_with_initial_states(problem, start, free=free, most_steps=steps, run=run)
    other = None if also is None else _elsewhere_too(finished, also, free=free, most_steps=steps, run=run)
    if other is not None and other.cost < finished.cost:
        finished, other = other, finished
    rise = 0.0 if other is None else other.cost - finished.cost
    without_effect = unidentifiable(finished, DEPENDENCES, most_steps=steps, run=run)
    no_influence = free & (without_effect.dependent | without_influence(finished.equations.normal))
    if no_influence.any():
        again = _as_before(problem, finished.point, no_influence & ~without_effect.dependent)
        own = problem.coordinates.scaled(problem.coordinates.nominal)
        again = np.where(without_effect.through, 0.0, np.where(without_effect.dependent, own, again))
        rest = free & ~no_influence
        begin = first_iterate(problem, again, finished.end.starts)
        finished = fit_with_initial_states(problem, begin, free=rest, most_steps=steps, run=run)
    refused = prepared.excitation.refused & ~no_influence
    return PointEstimate(
        finished=finished,
        values=problem.coordinates.physical(finished.point),
        no_influence=no_influence,
        refused=refused,
        estimated=free & ~no_influence & ~refused & ~at_bound(finished.point),
        other=other and OtherOptimum(values=problem.coordinates.physical(other.point), rise=rise),
    )


#: a second optimum that costs more than the first by this, 30 in 2 ln(likelihood) of a log of 48 s, is no alternative
_NEAR = 1e-3


def _elsewhere_too(
    finished: InitialStatesFit,
    point: NDArray[np.float64],
    *,
    free: NDArray[np.bool_],
    most_steps: int,
    run: Run,
) -> InitialStatesFit | None:
    """Return where a descent from a point (p,) ends; None if at the same optimum or far above it."""
    other = fit_with_initial_states(
        finished.problem,
        point,
        free=free,
        most_steps=most_steps,
        most_renewals=0,
        target=finished.cost + _NEAR,
        run=run,
    )
    if not elsewhere(finished.point, other.point) or other.cost > finished.cost + _NEAR:
        return None
    other = fit_with_initial_states(finished.problem, other.end, free=free, most_steps=most_steps, run=run)
    return other if elsewhere(finished.point, other.point) else None


def better_start(
    problem: Problem, evolved: NDArray[np.float64], start: Identification
) -> NDArray[np.float64]:
    """Return the parameters that predict better: the evolution's (p,), or an earlier identification's.

    Parameters that the earlier one lacks keep their nominal values.
    """
    coordinates = problem.coordinates
    values = coordinates.nominal.copy()
    for name in coordinates.layout.names:
        mine = coordinates.layout.part(name, values)
        theirs = start.layout.part(name, start.values)
        if mine is not None and theirs is not None:
            mine[...] = theirs
    points = np.stack([evolved, coordinates.scaled(values)])
    return points[problem.costs(points).argmin()]


def _as_before(
    problem: Problem, point: NDArray[np.float64], no_influence: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Return `point` (p,) with the robot's own values where there is no influence, if that predicts as well.

    It need not: a wheel that friction holds throughout is held by any friction above some size, and not by none.
    """
    own = problem.coordinates.scaled(problem.coordinates.nominal)
    before = np.where(no_influence, own, point)
    costs = problem.costs(np.stack([point, before]))
    return before if costs[1] < costs[0] + LARGEST_LOSS else point


def errors(predictor: Predictor, windows: Windows, values: NDArray[np.float64]) -> WindowErrors:
    """Return the errors of predictions by parameters (p,), with their friction and without."""
    both = np.stack([values, predictor.layout.without_friction(values)])
    squares = [(predictor.residuals(both, chunk, every=1) ** 2).sum(axis=2) for chunk in chunks(windows)]
    with_friction, without = (
        np.concatenate(squares, axis=1) if squares else np.zeros((2, 0, len(STATE_NAMES)))
    )
    return WindowErrors(window_samples=windows.samples, squares_with=with_friction, squares_without=without)
