"""A robot's friction, and what else is asked for, from balancing logs.

Evolution finds the basin, Gauss-Newton finishes, held-out windows judge. The method is the thesis's (section 3.4:
twelve parameters at once, a stochastic search within bounds, short windows because the plant is unstable), with a
polish, standard errors and held-out windows added.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.findings import Finding
from ballbot.fitting.checkpoint import Memoize, no_checkpoint
from ballbot.fitting.run import Executor, ProgressCallback, ProgressReporter, Threads, check_seed
from ballbot.fitting.search import SearchResult
from ballbot.identification.excitation import chatter, chatter_finding, heading_findings, share_shown
from ballbot.identification.gauss_newton import at_bound
from ballbot.identification.identifiability import assess
from ballbot.identification.laws import LawName, bounds_of, law_named
from ballbot.identification.parameters import Bounds, Coordinates, scale_between
from ballbot.identification.prediction import Predictor
from ballbot.identification.quantities import FRICTION, names_in
from ballbot.identification.result import (
    Identification,
    WindowErrors,
    bound_findings,
    correlation_findings,
    error_findings,
    found_robot,
    influence_findings,
    interval_findings,
    prediction_findings,
    ridge_findings,
)
from ballbot.identification.stages import (
    Effort,
    PointEstimate,
    Prepared,
    better_start,
    errors,
    inputs_of,
    prepare,
    refine,
    search,
    stages_of,
    states_counted,
)
from ballbot.identification.sweep import Estimate, SweepFriction, with_sweep
from ballbot.identification.windows import standstill_torques
from ballbot.log import STATE_NAMES, Log
from ballbot.log.checks import CheckedLogs, checked_logs
from ballbot.log.checks.values import spiked_rows
from ballbot.log.columns import torque_names
from ballbot.mechanics.parameters import Formulation
from ballbot.robot import Robot


def identify(
    robot: Robot,
    logs: Log | Sequence[Log] | CheckedLogs,
    *,
    accept: Collection[str] = (),
    free: Sequence[str] = ("friction",),
    law: LawName = "stribeck",
    bounds: Bounds | None = None,
    window: float = 0.25,
    formulation: Formulation = "exact",
    held_out: float = 0.25,
    left_out: Sequence[str] = (),
    back_emf: float = 0.0,
    start: Identification | None = None,
    sweep: SweepFriction | None = None,
    seed: int = 0,
    generations: int = 150,
    population: int = 24,
    evolution_windows: int = 64,
    polish_steps: int = 25,
    step: float = 1e-3,
    spread: Executor | None = None,
    recall: Memoize = no_checkpoint,
    progress: ProgressCallback | None = None,
) -> Identification:
    """Find b, c, s of each wheel, v_s, delta and C_rr from balancing logs, and what else is named.

    Parameters
    ----------
    robot : Robot
        Its own friction is not used, but for parameters that the logs say nothing of, and where friction is not sought.
    logs : Log, sequence of Log, or CheckedLogs
        With the ten state columns and the torques u1 .. un, of one sample time. Windows with missing values, gaps
        or a fallen robot are left out. The logs are checked first, unless they come as `CheckedLogs`.
    accept : collection of str
        Codes of errors found in the logs to go on in spite of; see `ballbot.findings.CODES`.
    free : sequence of str
        What is sought: names of `ballbot.identification.quantities.QUANTITIES`, or of its groups.
    law : str
        The friction law, of `ballbot.identification.laws.LAWS`, where "friction" is sought.
    bounds : Bounds, optional
        Within which the parameters are sought; a quantity with equal bounds is held there.
    window : float
        Length of the windows predicted [s].
    formulation : {"exact", "thesis"}
    held_out : float
        Share of the windows kept from the fit, to judge it by.
    left_out : sequence of str
        States whose errors do not count in the fit, as the heading on a floor on which the ball pivots.
    back_emf : float
        What a motor driven by voltage brakes with [N m s/rad], if the logs' torques contain it; see
        `ballbot.identification.windows`.
    start : Identification, optional
        One whose numbers the polish begins from where they predict better than what the evolution found.
    sweep : SweepFriction, optional
        What a sweep of the free wheels told, to be combined with what the logs tell; see
        `ballbot.identification.sweep`.
    seed : int
        The result is the same to the bit for the same seed, wherever the work is done and however often it was resumed.
    generations, population : int
        Most generations of the evolution, and sets of parameters in each.
    evolution_windows : int
        How many of the windows to fit the evolution looks at; the polish takes all.
    polish_steps : int
        Most steps of the polish.
    step : float
        Longest inner step of the polish's and the verdict's simulations [s].
    spread : Spread, optional
        Where the work is done: `Threads` of a number, a `Cluster`; by default a thread for each core.
    recall : Recall, optional
        A checkpoint's, for a run that can be resumed; see `ballbot.fitting.checkpoint`.
    progress : callable, optional
        Told a `Progress` after each generation and each step of the polish.

    Returns
    -------
    Identification

    Raises
    ------
    InputError
        If the checks of the logs find an error whose code is not accepted.
        Where the logs cannot give the parameters (a column missing, too few windows, no motion), or an option makes
        no sense.
    """
    if not 0.0 < held_out < 1.0:
        raise InputError(f"held_out is {held_out!r}; it must be a fraction between 0 and 1, such as 0.25.")
    check_seed(seed)
    effort = Effort(
        generations=generations,
        population=population,
        evolution_windows=evolution_windows,
        polish_steps=polish_steps,
    )
    checked = checked_logs(robot, logs, accept=accept)
    fitted = list(checked.logs.values())
    coordinates = estimated_parameters(robot, free=free, law=law, bounds=bounds or Bounds())
    predictor = Predictor(
        robot=robot,
        formulation=formulation,
        step=step,
        layout=coordinates.layout,
        back_emf=back_emf,
    )
    prepared = prepare(
        predictor,
        coordinates,
        [standstill_torques(log, robot, back_emf) for log in fitted],
        window=window,
        held_out=held_out,
        seed=seed,
        effort=effort,
        counted=states_counted(left_out),
        spread=spread or Threads(),
    )
    recall("inputs", inputs_of(prepared, effort=effort, seed=seed, start=start), list)
    told = ProgressReporter(progress, stages_of(prepared, effort))
    evolved = search(prepared.coarse, effort=effort, seed=seed, told=told, recall=recall)
    begin = evolved.best if start is None else better_start(prepared.problem, evolved.best, start)
    estimate = refine(prepared, begin, effort=effort, told=told, recall=recall)
    return _result(
        prepared,
        evolved,
        estimate,
        logs=fitted,
        findings=checked.findings,
        left_out=tuple(left_out),
        window=window,
        sweep=sweep,
        seed=seed,
        recall=recall,
    )


def estimated_parameters(robot: Robot, *, free: Sequence[str], law: LawName, bounds: Bounds) -> Coordinates:
    """Return which parameters `identify` deals with, and within which bounds.

    Raises
    ------
    InputError
        Where a name is none.
    """
    names, chosen = names_in(free), law_named(law)
    if set(FRICTION) <= set(names):
        names = (*chosen.sought, *(name for name in names if name not in FRICTION))
        bounds = bounds_of(chosen, bounds)
    return scale_between(robot, free=names, bounds=bounds)


def _result(
    prepared: Prepared,
    evolved: SearchResult,
    estimate: PointEstimate,
    *,
    logs: Sequence[Log],
    findings: tuple[Finding, ...],
    left_out: tuple[str, ...],
    window: float,
    sweep: SweepFriction | None,
    seed: int,
    recall: Memoize,
) -> Identification:
    coordinates, predictor = prepared.problem.coordinates, prepared.problem.predictor
    sure = assess(
        prepared.problem,
        estimate.finished,
        estimated=estimate.estimated,
        at_bound=_at_bounds(coordinates, estimate),
        seed=seed,
        recall=recall,
    )
    layout = predictor.layout
    told = Estimate(values=estimate.values, uncertainty=sure)
    if sweep is not None:
        told = with_sweep(coordinates, told, sweep)
    values, sure = told.values, told.uncertainty
    held_out = errors(predictor, prepared.held_out, values)
    return Identification(
        robot=found_robot(predictor.robot, layout, values, sure.standard_errors, log_count=len(logs)),
        predictor=predictor,
        values=values,
        parameters=layout.by_symbol(np.where(estimate.unknown, np.nan, values)),
        standard_errors=layout.by_symbol(sure.standard_errors),
        bootstrap_errors=layout.by_symbol(sure.bootstrap_errors),
        intervals=sure.intervals,
        correlation=sure.correlation,
        fit=errors(predictor, prepared.fit, values),
        held_out=held_out,
        fit_windows=prepared.fit.spans,
        held_out_windows=prepared.held_out.spans,
        window=window,
        left_out=left_out,
        evolution_cost=evolved.history,
        polish_cost=estimate.polished.history,
        warnings=(
            *_log_findings(predictor, logs, left_out),
            *_findings(prepared, estimate, told, held_out),
            *told.remarks,
        ),
        log_findings=findings,
    )


def _findings(
    prepared: Prepared, estimate: PointEstimate, told: Estimate, held_out: WindowErrors
) -> list[str]:
    """Return what to know of the numbers, in sentences."""
    coordinates, sure = prepared.problem.coordinates, told.uncertainty
    apart = (
        *correlation_findings(coordinates.labels, sure.correlation),
        *ridge_findings(coordinates.labels, sure.correlation),
    )
    return [
        *prepared.excitation.remarks,
        *influence_findings(coordinates, told.values, estimate.no_influence),
        *bound_findings(coordinates, told.values, _at_bounds(coordinates, estimate)),
        *error_findings(coordinates, sure.scaled_errors),
        *interval_findings(sure.intervals),
        *dict.fromkeys(apart),
        *prediction_findings(held_out.ratios),
    ]


def _log_findings(predictor: Predictor, logs: Sequence[Log], left_out: Sequence[str]) -> list[str]:
    """Return what the logs themselves show that the model does not have: spoilt rows, play, and a ball that pivots."""
    robot = predictor.robot
    found = [chatter(log, robot) for log in logs]
    names = ["the log"] if len(logs) == 1 else [f"log {number}" for number in range(1, len(logs) + 1)]
    shares = [share_shown(log, robot) for log, one in zip(logs, found, strict=True) if not one.matters]
    return [
        *filter(None, (_spoilt(log, robot, name) for log, name in zip(logs, names, strict=True))),
        *(chatter_finding(one, robot, name) for one, name in zip(found, names, strict=True) if one.matters),
        *heading_findings(shares, left_out=left_out, sought=predictor.layout.extra),
    ]


def _spoilt(log: Log, robot: Robot, name: str) -> str:
    """Return what to say of a log's spoilt rows; nothing where there is none."""
    rows = np.flatnonzero(spiked_rows(log, (*STATE_NAMES, *torque_names(robot.wheel_count))))
    if not rows.size:
        return ""
    count = "one row is" if rows.size == 1 else f"{rows.size} rows are"
    return (
        f"In {name} {count} corrupted, the first at t = {log.t[rows[0]]:.6g} s. "
        "Windows with them are not used; `ballbot check-log` names the columns."
    )


def _at_bounds(coordinates: Coordinates, estimate: PointEstimate) -> NDArray[np.bool_]:
    return coordinates.free & ~estimate.unknown & at_bound(estimate.finished.point)
