"""Friction from balancing logs: evolution to find the basin, Gauss-Newton to finish, held-out windows to judge.

The method is the thesis's (section 3.4: twelve parameters at once, a stochastic search within bounds, short windows
because the plant is unstable), with a polish, standard errors and held-out windows added.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.identification.bounds import Bounds
from ballbot.identification.coordinates import (
    SYMBOLS,
    Coordinates,
    by_symbol,
    from_friction,
    scale_between,
    to_friction,
)
from ballbot.identification.evolution import Evolved, evolve
from ballbot.identification.excitation import check_count, check_excitation
from ballbot.identification.polish import Polished, Problem, at_bound, polish
from ballbot.identification.prediction import Cost, Predictor, frictionless
from ballbot.identification.progress import Progress, Report
from ballbot.identification.remarks import (
    bound_remarks,
    correlation_remarks,
    error_remarks,
    influence_remarks,
    prediction_remarks,
)
from ballbot.identification.result import Identification, WindowErrors
from ballbot.identification.uncertainty import correlation, covariance, without_influence
from ballbot.identification.windows import Windows, cut_windows, split
from ballbot.log import Log
from ballbot.mechanics.parameters import Formulation
from ballbot.robot import Robot

#: inner step of the evolution's simulations [s]; only the basin is asked of them, and the cost differs by 1e-4
EVOLUTION_STEP = 2.5e-3
#: what the cost may rise by when a parameter without influence goes back to its value before
LARGEST_LOSS = 1e-3


def identify(
    robot: Robot,
    logs: Log | Sequence[Log],
    *,
    bounds: Bounds | None = None,
    window: float = 0.25,
    formulation: Formulation = "exact",
    held_out: float = 0.25,
    seed: int = 0,
    generations: int = 150,
    population: int = 24,
    evolution_windows: int = 64,
    polish_steps: int = 25,
    step: float = 1e-3,
    threads: int | None = None,
    progress: Report | None = None,
) -> Identification:
    """Find b, c, s of each wheel, v_s, delta and C_rr from balancing logs.

    Parameters
    ----------
    robot : Robot
        Its own friction is not used, but for parameters that the logs say nothing of.
    logs : Log or sequence of Log
        With the ten state columns and the torques u1 .. un, of one sample time. Windows with missing values, gaps
        or a fallen robot are left out.
    bounds : Bounds, optional
        Within which the parameters are sought.
    window : float
        Length of the windows predicted [s].
    formulation : {"exact", "thesis"}
    held_out : float
        Share of the windows kept from the fit, to judge it by.
    seed : int
        The result is the same to the bit for the same seed, whatever the number of threads.
    generations, population : int
        Most generations of the evolution, and sets of parameters in each.
    evolution_windows : int
        How many of the windows to fit the evolution looks at; the polish takes all.
    polish_steps : int
        Most steps of the polish.
    step : float
        Longest inner step of the polish's and the verdict's simulations [s].
    threads : int, optional
        All cores by default.
    progress : callable, optional
        Told a `Progress` after each generation and each step of the polish.

    Returns
    -------
    Identification

    Raises
    ------
    InputError
        Where the logs cannot give the parameters (a column missing, too few windows, no motion), or an option makes
        no sense.
    """
    _check_share(held_out)
    _check_least("population", population, 4)
    for name, count in (
        ("generations", generations),
        ("evolution_windows", evolution_windows),
        ("polish_steps", polish_steps),
    ):
        _check_least(name, count, 1)
    logs = [logs] if isinstance(logs, Log) else list(logs)
    coordinates = scale_between(bounds or Bounds(), robot.wheel_count)
    windows = cut_windows(logs, wheel_count=robot.wheel_count, duration=window)
    fit_rows, held_rows = split(len(windows), held_out=held_out, seed=seed)
    check_count(windows, fitted=len(fit_rows), parameters=int(coordinates.free.sum()))
    remarks = check_excitation(windows.take(fit_rows), robot)

    predictor = Predictor(robot=robot, formulation=formulation, step=step, threads=threads)
    fit_windows = windows.take(fit_rows)
    drawn = np.sort(np.random.default_rng(seed).permutation(len(fit_windows))[:evolution_windows])
    told = _Teller(progress=progress, generations=generations, polish_steps=polish_steps)
    evolved = _evolve(
        _problem(replace(predictor, step=max(step, EVOLUTION_STEP)), fit_windows.take(drawn), coordinates),
        generations=generations,
        population=population,
        seed=seed,
        told=told,
    )
    estimate = _polish(_problem(predictor, fit_windows, coordinates), evolved.best, told)
    return _result(
        robot,
        estimate,
        coordinates,
        evolved=evolved,
        fit=_errors(predictor, fit_windows, estimate.friction),
        held_out=_errors(predictor, windows.take(held_rows), estimate.friction),
        windows=(fit_windows, windows.take(held_rows)),
        remarks=remarks,
        log_count=len(logs),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Estimate:
    """Where the search ended and what could be told there."""

    polished: Polished
    friction: NDArray[np.float64]  #: (p,), SI units
    no_influence: NDArray[np.bool_]  #: (p,)
    estimated: NDArray[np.bool_]  #: (p,), those with a standard error


@dataclass(frozen=True, kw_only=True)
class _Teller:
    """Turns the steps of both stages into one count."""

    progress: Report | None
    generations: int
    polish_steps: int

    def evolution(self, generation: int, cost: float) -> None:
        self._tell(generation, cost)

    def polish(self, step: int, cost: float) -> None:
        self._tell(self.generations + step, cost)

    def _tell(self, done: int, cost: float) -> None:
        if self.progress:
            self.progress(Progress(generation=done, of=self.generations + self.polish_steps, cost=cost))


def _check_share(held_out: float) -> None:
    if not 0.0 < held_out < 1.0:
        raise InputError(f"held_out is {held_out!r}; it must be a share between 0 and 1, such as 0.25.")


def _check_least(name: str, value: int, least: int) -> None:
    if value < least:
        raise InputError(f"{name} is {value!r}; it must be {least} or more.")


def _problem(predictor: Predictor, windows: Windows, coordinates: Coordinates) -> Problem:
    none = frictionless(predictor.robot.wheel_count)
    reference = predictor.square_sums(none, windows, every=windows.comparison_interval)[0]
    return Problem(
        predictor=predictor, windows=windows, coordinates=coordinates, cost=Cost(reference=reference)
    )


def _evolve(problem: Problem, *, generations: int, population: int, seed: int, told: _Teller) -> Evolved:
    coordinates = problem.coordinates
    evolved = evolve(
        lambda population: problem.costs(coordinates.from_search(population)),
        size=len(coordinates.labels),
        generations=generations,
        population=population,
        seed=seed,
        report=told.evolution,
    )
    return Evolved(best=coordinates.from_search(evolved.best), history=evolved.history)


def _polish(problem: Problem, start: NDArray[np.float64], told: _Teller) -> _Estimate:
    """Polish; then hold what turned out to be without influence, and polish the rest."""
    coordinates, free = problem.coordinates, problem.coordinates.free
    polished = polish(problem, start, free=free, most_steps=told.polish_steps, report=told.polish)
    no_influence = free & without_influence(polished.equations)
    if no_influence.any():
        start = _as_before(problem, polished.point, no_influence)
        rest = free & ~no_influence
        polished = polish(problem, start, free=rest, most_steps=told.polish_steps, report=told.polish)
    return _Estimate(
        polished=polished,
        friction=coordinates.physical(polished.point),
        no_influence=no_influence,
        estimated=free & ~no_influence & ~at_bound(polished.point),
    )


def _as_before(
    problem: Problem, point: NDArray[np.float64], no_influence: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Return `point` (p,) with the robot's own values where there is no influence, if that predicts as well.

    It need not: a wheel that friction holds throughout is held by any friction above some size, and not by none.
    """
    own = problem.coordinates.scaled(from_friction(problem.predictor.robot.friction))
    before = np.where(no_influence, own, point)
    costs = problem.costs(np.stack([point, before]))
    return before if costs[1] < costs[0] + LARGEST_LOSS else point


def _errors(predictor: Predictor, windows: Windows, friction: NDArray[np.float64]) -> WindowErrors:
    both = np.concatenate([friction[None], frictionless(predictor.robot.wheel_count)])
    samples = len(windows) * windows.samples
    rmse = np.sqrt(predictor.square_sums(both, windows, every=1) / max(samples, 1))
    return WindowErrors(windows=len(windows), samples=samples, rmse_with=rmse[0], rmse_without=rmse[1])


def _result(
    robot: Robot,
    estimate: _Estimate,
    coordinates: Coordinates,
    *,
    evolved: Evolved,
    fit: WindowErrors,
    held_out: WindowErrors,
    windows: tuple[Windows, Windows],
    remarks: tuple[str, ...],
    log_count: int,
) -> Identification:
    point = estimate.polished.point
    scaled = covariance(estimate.polished.equations, estimate.estimated)
    scaled_errors = np.sqrt(scaled.diagonal())
    correlations = correlation(scaled)
    errors = scaled_errors * coordinates.slopes(point)
    stands_at_bound = coordinates.free & ~estimate.no_influence & at_bound(point)
    return Identification(
        robot=_identified(robot, estimate.friction, errors, log_count),
        parameters=by_symbol(np.where(estimate.no_influence, np.nan, estimate.friction)),
        standard_errors=by_symbol(errors),
        labels=coordinates.labels,
        correlation=correlations,
        fit=fit,
        held_out=held_out,
        fit_windows=windows[0].spans,
        held_out_windows=windows[1].spans,
        evolution_cost=evolved.history,
        polish_cost=estimate.polished.history,
        warnings=(
            *remarks,
            *influence_remarks(coordinates, estimate.friction, estimate.no_influence),
            *bound_remarks(coordinates, estimate.friction, stands_at_bound),
            *error_remarks(coordinates, scaled_errors),
            *correlation_remarks(coordinates.labels, correlations),
            *prediction_remarks(held_out.ratios),
        ),
    )


def _identified(
    robot: Robot, friction: NDArray[np.float64], errors: NDArray[np.float64], log_count: int
) -> Robot:
    """Return the robot with that friction; its sources tell the standard errors."""
    by_name = dict(zip(SYMBOLS, by_symbol(errors).values(), strict=True))
    logs = "1 log" if log_count == 1 else f"{log_count} logs"
    sources = {
        f"friction.{name}": f"identified: from {logs}, standard error "
        + ", ".join(f"{one:.2g}" if np.isfinite(one) else "none" for one in np.atleast_1d(by_name[name]))
        for name in SYMBOLS
    }
    return robot.replace(friction=to_friction(friction), sources={**robot.sources, **sources})
