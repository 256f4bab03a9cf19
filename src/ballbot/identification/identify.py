"""Identification of a robot's friction, and of other quantities, from balancing logs.

A search finds the basin, Gauss-Newton the minimum, and held-out windows validate the result. The problem is the
thesis's (section 3.4: twelve parameters at once, within bounds, on short windows because the plant is unstable), and so
is the genetic search; windows' estimated starts, standard errors and held-out windows are added.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ballbot.findings import Finding, warning
from ballbot.fitting.intervals import assess
from ballbot.fitting.model_selection import ModelSelection
from ballbot.fitting.run import DEFAULT_RUN, Run
from ballbot.fitting.search import SearchResult, at_bound
from ballbot.fitting.uncertainty import Discrepancy, discrepancy
from ballbot.identification.agreement import StageEstimate, file_findings
from ballbot.identification.alike import (
    alike_finding,
    inseparable,
    uncertainty_of_each,
    variation_of_each,
    wheels_mean,
)
from ballbot.identification.coulomb import coulomb_equivalent
from ballbot.identification.excitation import chatter, chatter_finding, heading_findings, share_shown
from ballbot.identification.laws import bounds_of, law_named, robot_by_law, select_law
from ballbot.identification.parameters import Bounds, BoundsLike, Coordinates, as_bounds, scale_between
from ballbot.identification.prediction import Predictor
from ballbot.identification.quantities import FRICTION, names_in
from ballbot.identification.result import Identification, WindowErrors, found_robot
from ballbot.identification.result_findings import (
    bound_findings,
    correlation_findings,
    error_findings,
    influence_findings,
    interval_findings,
    optimum_findings,
    prediction_findings,
    ridge_findings,
)
from ballbot.identification.stages import (
    DEFAULT_OPTIONS,
    IdentificationOptions,
    PointEstimate,
    Prepared,
    better_start,
    errors,
    prepare,
    refine,
    search,
)
from ballbot.identification.stated_uncertainty import ends_without_error
from ballbot.identification.sweep import Estimate, with_sweep
from ballbot.identification.variation import (
    Variation,
    discrepancy_finding,
    log_estimates,
    shipped_priors,
    variation_findings,
    widened,
    with_torque_scale,
)
from ballbot.identification.windows import Windows, standstill_torques
from ballbot.log import STATE_NAMES, Log, LogsLike
from ballbot.log.checks import CheckedLogs, checked_logs
from ballbot.log.checks.physics import torque_scale_errors
from ballbot.log.checks.values import spiked_rows
from ballbot.log.columns import torque_names
from ballbot.log.fingerprints import fingerprint
from ballbot.mechanics.model import Model
from ballbot.progress import Progress
from ballbot.robot import Robot, RobotLike, as_robot


def identify(
    robot: RobotLike,
    logs: LogsLike | CheckedLogs,
    *,
    free: Sequence[str] | str = ("friction",),
    law: str = "stribeck",
    bounds: BoundsLike | None = None,
    window: float = 0.25,
    seed: int | None = None,
    options: IdentificationOptions = DEFAULT_OPTIONS,
    run: Run = DEFAULT_RUN,
) -> Identification:
    """Identify b, c, s of each wheel, v_s, delta and C_rr from balancing logs, and any other named quantity.

    Parameters
    ----------
    robot : Robot, preset or robot file
        Its own friction is used only for parameters on which the logs have no information, and where friction is not
        estimated.
    logs : Log or log file, several in a list or a mapping, or CheckedLogs
        With the ten state columns and the torques u1 .. un, of one sample time. Windows with missing values, gaps
        or a fallen robot are skipped. The logs are checked first, unless they come as `CheckedLogs`.
    free : sequence of str, or str
        Quantities to estimate: names of `ballbot.identification.quantities.QUANTITIES`, or of its groups; in a string
        with commas between.
    law : str
        The friction law if "friction" is estimated: of `ballbot.identification.laws.LAWS`, or a registered one
        (`ballbot.register_friction_law`) by its name or as FILE.py:NAME.
    bounds : Bounds or bounds file, optional
        Within which the parameters are estimated; equal bounds fix a quantity.
    window : float
        Length of the windows predicted [s].
    seed : int, optional
        Replaces the seed of `run`. The result is the same to the bit for the same seed, wherever the work is done.
    options : IdentificationOptions, optional
    run : Run, optional
        Where the work is done, and who watches the progress.

    Returns
    -------
    Identification

    Raises
    ------
    InputError
        If the checks of the logs find an error whose code is not accepted; if the logs cannot determine the
        parameters (a column missing, too few windows, no motion); or if an option is invalid.
    """
    robot, run = as_robot(robot), run if seed is None else replace(run, seed=seed)
    robot = robot_by_law(robot, law, free=free)
    checked = checked_logs(robot, logs, accept=options.accept)
    fitted = list(checked.logs.values())
    coordinates = estimated_parameters(robot, free=free, law=law, bounds=as_bounds(bounds))
    predictor = Predictor(
        robot=robot,
        formulation=options.formulation,
        step=options.step,
        layout=coordinates.layout,
        back_emf=options.back_emf,
    )
    prepared = prepare(
        predictor,
        coordinates,
        [standstill_torques(log, robot, options.back_emf) for log in fitted],
        window=window,
        options=options,
        run=run,
    )
    evolved = search(prepared.coarse, options=options, run=run)
    start = options.warm_start
    begin = evolved.best if start is None else better_start(prepared.problem, evolved.best, start)
    prepared, estimate = _alike(
        prepared,
        refine(prepared, begin, options=options, run=run, also=evolved.other),
        options=options,
        run=run,
    )
    return _result(
        prepared,
        evolved,
        estimate,
        logs=fitted,
        findings=checked.findings,
        window=window,
        law=law,
        options=options,
        run=run,
    )


def identify_by_law(
    robot: Robot,
    logs: CheckedLogs,
    *,
    free: Sequence[str] | str,
    law: str,
    bounds: Bounds,
    window: float,
    options: IdentificationOptions = DEFAULT_OPTIONS,
    run: Run = DEFAULT_RUN,
) -> tuple[Identification, ModelSelection[Identification] | None]:
    """Identify by one law; or by each law in turn, each begun from the law that it contains, and select the best.

    Parameters
    ----------
    robot, logs, free, bounds, window, options, run
        As for `identify`.
    law : str
        The friction law, or "best".

    Returns
    -------
    Identification
        By the given law, or by the selected one.
    ModelSelection, optional
        The laws that were compared; None if one is given.

    Raises
    ------
    InputError
        As `identify`.
    """

    def fit(one: str, start: Identification | None) -> Identification:
        def report(now: Progress) -> None:
            error = "" if math.isnan(now.cost) else f", error x {math.exp(now.cost):.3f}"
            run.progress(replace(now, note=f"{one}{error}"))

        return identify(
            robot,
            logs,
            free=free,
            law=one,
            bounds=bounds,
            window=window,
            options=replace(options, warm_start=start),
            run=replace(run, progress=report),
        )

    if law == "best":
        selection = select_law(fit)
        return selection.best.model, selection
    return fit(law, options.warm_start), None


def estimated_parameters(robot: Robot, *, free: Sequence[str] | str, law: str, bounds: Bounds) -> Coordinates:
    """Return which parameters `identify` deals with, and within which bounds.

    Raises
    ------
    InputError
        If a name is not a quantity or a group.
    """
    names, chosen = names_in(free), law_named(law)
    if set(FRICTION) <= set(names):
        names = (*chosen.free, *(name for name in names if name not in FRICTION))
        bounds = bounds_of(chosen, bounds)
    return scale_between(robot, free=names, bounds=bounds)


def _alike(
    prepared: Prepared, estimate: PointEstimate, *, options: IdentificationOptions, run: Run
) -> tuple[Prepared, PointEstimate]:
    """Return the estimate, fitted again with one number for all wheels where the logs cannot separate them."""
    problem = prepared.problem
    names = (
        ()
        if options.sweep is not None  # it measured each wheel
        else inseparable(
            problem.coordinates,
            estimate.finished,
            estimate.values,
            unknown=estimate.unknown,
            speeds=wheel_speeds(problem.predictor.robot, prepared.fit),
        )
    )
    if not names:
        return prepared, estimate
    coordinates = replace(problem.coordinates, alike=names)
    refused = prepared.excitation.refused
    of_all = np.array([refused[coordinates.first == place].all() for place in coordinates.first])
    prepared = replace(
        prepared,
        problem=replace(problem, coordinates=coordinates),
        excitation=replace(prepared.excitation, refused=of_all),
    )
    start = coordinates.scaled(wheels_mean(coordinates, estimate.values, names))
    return prepared, replace(refine(prepared, start, options=options, run=run), other=estimate.other)


def _result(
    prepared: Prepared,
    evolved: SearchResult,
    estimate: PointEstimate,
    *,
    logs: Sequence[Log],
    findings: tuple[Finding, ...],
    window: float,
    law: str,
    options: IdentificationOptions,
    run: Run,
) -> Identification:
    predictor = prepared.problem.predictor
    layout, first = predictor.layout, prepared.problem.coordinates.first
    final, apart, varied = _with_uncertainty(
        prepared, estimate, torque_scale_errors(logs, predictor.robot), options=options, run=run
    )
    values, uncertainty = final.values, final.uncertainty
    bounds = np.stack([prepared.problem.coordinates.lower, prepared.problem.coordinates.upper], axis=1)
    covariance = uncertainty.correlation * np.outer(uncertainty.standard_errors, uncertainty.standard_errors)
    held_out = errors(predictor, prepared.held_out, values)
    ends = ends_without_error(
        layout.labels, values, uncertainty.standard_errors, bounds=bounds, intervals=uncertainty.intervals
    )
    source = "the balancing logs"
    balancing = StageEstimate(source=source, labels=layout.labels, values=values, covariance=covariance)
    return Identification(
        robot=found_robot(
            predictor.robot,
            layout,
            values,
            uncertainty.standard_errors,
            covariance=covariance,
            ends=ends,
            log_count=len(logs),
            asymmetric=law in ("asymmetric", "directed") and "torque_offset" in layout.extra,
        ).annotated(identified_from=[row for log in logs for row in fingerprint(log)]),
        predictor=predictor,
        values=values,
        bounds=bounds,
        parameters=layout.by_symbol(np.where(estimate.unknown[first], np.nan, values)),
        standard_errors=layout.by_symbol(uncertainty.standard_errors),
        intervals=uncertainty.intervals,
        variation=varied,
        correlation=uncertainty.correlation,
        coulomb=coulomb_equivalent(
            layout,
            values,
            covariance=covariance,
            wheel_speeds=wheel_speeds(predictor.robot, prepared.fit),
            law=predictor.robot.friction.own_law,
        ),
        fit=errors(predictor, prepared.fit, values),
        held_out=held_out,
        fit_windows=prepared.fit.spans,
        held_out_windows=prepared.held_out.spans,
        window=window,
        excluded_states=tuple(options.excluded_states),
        evolution_cost=evolved.history,
        gauss_newton_cost=estimate.finished.history,
        findings=(
            *_log_findings(predictor, logs, options.excluded_states),
            *_findings(prepared, estimate, final, held_out),
            *final.findings,
            *discrepancy_finding(apart),
            *variation_findings(varied),
            *file_findings(predictor.robot, balancing),
        ),
        other=estimate.other,
        log_findings=findings,
    )


def _with_uncertainty(
    prepared: Prepared,
    estimate: PointEstimate,
    scale_errors: NDArray[np.float64],
    *,
    options: IdentificationOptions,
    run: Run,
) -> tuple[Estimate, Discrepancy, Variation]:
    """Return the estimate with its uncertainty, how far slow and fast windows disagree, and how logs vary."""
    coordinates = prepared.problem.coordinates
    groups = speed_groups(prepared.problem.predictor.robot, prepared.fit)
    apart = discrepancy(estimate.finished.equations, groups, estimate.estimated, seed=run.seed)
    uncertainty = assess(
        estimate.finished,
        estimated=estimate.estimated,
        at_bound=_at_bounds(coordinates, estimate),
        most_profiles=options.most_profiles,
        widen=apart.factor,
        run=run,
    )
    values = estimate.values
    by_log = log_estimates(
        coordinates,
        estimate.finished,
        prepared.fit.spans,
        values=values,
        uncertainty=uncertainty,
        widen=apart.factor,
    )
    uncertainty, varied = widened(coordinates, values, uncertainty, by_log, priors=shipped_priors())
    uncertainty = with_torque_scale(coordinates, values, uncertainty, scale_errors)
    final = Estimate(values=values, uncertainty=uncertainty_of_each(coordinates, values, uncertainty))
    if options.sweep is not None:  # which does not vary from log to log
        final = with_sweep(coordinates, final, options.sweep)
    return final, apart, variation_of_each(coordinates, varied)


#: groups of windows by speed, of equal size
_SPEED_GROUPS = 3


def speed_groups(robot: Robot, windows: Windows) -> NDArray[np.int64]:
    """Return the number (w,) of each window's group, from the slowest third of the wheels' speeds to the fastest."""
    speeds = np.abs(wheel_speeds(robot, windows)).mean(axis=(1, 2))
    return np.argsort(np.argsort(speeds, kind="stable"), kind="stable") * _SPEED_GROUPS // len(speeds)


def wheel_speeds(robot: Robot, windows: Windows) -> NDArray[np.float64]:
    """Return the speeds of the wheels (w, 1 + m, n) [rad/s] in windows."""
    states = np.concatenate([windows.initial[:, None], windows.measured], axis=1)
    return Model(robot).wheel_speed(states[..., :5], states[..., 5:])


def _findings(
    prepared: Prepared, estimate: PointEstimate, final: Estimate, held_out: WindowErrors
) -> list[Finding]:
    """Return the findings on the parameters."""
    coordinates, uncertainty = prepared.problem.coordinates, final.uncertainty
    apart = (
        *correlation_findings(coordinates.labels, uncertainty.correlation),
        *ridge_findings(coordinates.labels, uncertainty.correlation),
    )
    return [
        *prepared.excitation.findings,
        *alike_finding(coordinates),
        *influence_findings(coordinates, final.values, estimate.no_influence[coordinates.first]),
        *bound_findings(coordinates, final.values, _at_bounds(coordinates, estimate)[coordinates.first]),
        *error_findings(coordinates, uncertainty.scaled_errors),
        *interval_findings(uncertainty.intervals),
        *dict.fromkeys(apart),
        *optimum_findings(coordinates, estimate.finished.point, estimate.other),
        *prediction_findings(held_out.with_over_without),
    ]


def _log_findings(predictor: Predictor, logs: Sequence[Log], excluded_states: Sequence[str]) -> list[Finding]:
    """Return findings on effects that the model does not have: corrupted rows, play, and a ball that pivots."""
    robot = predictor.robot
    found = [chatter(log, robot) for log in logs]
    names = ["the log"] if len(logs) == 1 else [f"log {number}" for number in range(1, len(logs) + 1)]
    shares = [share_shown(log, robot) for log, one in zip(logs, found, strict=True) if not one.matters]
    return [
        *(one for log, name in zip(logs, names, strict=True) for one in _spoilt(log, robot, name)),
        *(chatter_finding(one, robot, name) for one, name in zip(found, names, strict=True) if one.matters),
        *heading_findings(shares, excluded_states=excluded_states, estimated=predictor.layout.extra),
    ]


def _spoilt(log: Log, robot: Robot, name: str) -> list[Finding]:
    """Return a warning of a log's corrupted rows, if there are any."""
    rows = np.flatnonzero(spiked_rows(log, (*STATE_NAMES, *torque_names(robot.wheel_count))))
    if not rows.size:
        return []
    count = "one row is" if rows.size == 1 else f"{rows.size} rows are"
    text = (
        f"In {name} {count} corrupted, the first at t = {log.t[rows[0]]:.6g} s. "
        "Windows with them are not used; `ballbot check-log` names the columns."
    )
    return [warning("corrupted", text)]


def _at_bounds(coordinates: Coordinates, estimate: PointEstimate) -> NDArray[np.bool_]:
    return coordinates.free & ~estimate.unknown & at_bound(estimate.finished.point)
