"""Identification of a robot's friction and other quantities from balancing logs.

The problem is that of the thesis (section 3.4: twelve parameters at once, within bounds, on short windows because the
plant is unstable), solved by `ballbot.fitting.fit`; held-out windows validate the result.
"""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np

from ballbot.arrays import Bools, Floats, Ints
from ballbot.errors import InputError, check_known
from ballbot.findings import Finding, warning
from ballbot.fitting.fit import Fit, FitOptions, fit
from ballbot.fitting.intervals import Uncertainty
from ballbot.fitting.model_selection import Gain, gain_between
from ballbot.fitting.run import DEFAULT_RUN, Run
from ballbot.identification.balancing import Balancing, WindowsIterate
from ballbot.identification.coulomb import coulomb_equivalent
from ballbot.identification.excitation import (
    chatter_findings,
    check_count,
    check_excitation,
    heading_findings,
    share_shown,
)
from ballbot.identification.file_values import FileErrors, file_value_findings, from_file
from ballbot.identification.laws import LAWS, bounds_of, law_named, robot_by_law
from ballbot.identification.odometry import WheelFrame
from ballbot.identification.prediction import Predictor, window_errors, windows_for
from ballbot.identification.quantities import (
    BY_NAME,
    FRICTION,
    Bounds,
    Coordinates,
    names_in,
    read_bounds,
    scale_between,
)
from ballbot.identification.result import Identification, LawCandidate, LawSelection, window_blocks
from ballbot.identification.result_findings import parameter_findings, prediction_findings
from ballbot.identification.rollers import on_points
from ballbot.identification.rolling import FoundRolling
from ballbot.identification.stated_uncertainty import StageEstimate, file_findings, found_robot
from ballbot.identification.variation import (
    Variation,
    alike_finding,
    discrepancy_finding,
    inseparable,
    shipped_priors,
    uncertainty_of_each,
    variation_findings,
    wheels_mean,
    widened,
)
from ballbot.identification.windows import (
    HELD_OUT,
    Windows,
    holdout_intervals,
    split_in_time,
    standstill_torques,
)
from ballbot.log import STATE_NAMES, Log, LogsLike
from ballbot.log.checks import CheckedLogs, checked_logs
from ballbot.log.checks.values import spiked_rows
from ballbot.log.columns import torque_names
from ballbot.log.fingerprints import fingerprint
from ballbot.log.pose import without_encoder_lag
from ballbot.mechanics.model import Model
from ballbot.progress import Progress
from ballbot.robot import Robot, RobotLike, as_robot

#: longest integration step [s]: with 2.5 or 1.25 ms an estimate changes by 0.15 of its standard error at most
INNER_STEP = 5e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class IdentificationOptions(FitOptions):
    """Options of `identify` besides what it estimates; InputError if one is not possible."""

    most_steps: int = 75  #: of each descent by Gauss-Newton
    search_windows: int = 64  #: windows that the search uses; Gauss-Newton uses all
    accept: Collection[str] = ()  #: codes of errors in the logs to ignore; see `ballbot.findings.CODES`
    held_out: float = HELD_OUT  #: fraction of each log that the fit does not see, to validate it on
    excluded_states: tuple[str, ...] = ()  #: whose errors do not count, as the heading's if the ball pivots
    back_emf: float = 0.0  #: b_e of motors on a voltage [N m s/rad], if the torques contain it
    warm_start: Identification | None = None  #: Gauss-Newton starts there if it predicts better
    step: float = INNER_STEP  #: longest integration step [s]

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0.0 < self.held_out < 1.0:
            raise InputError(
                f"held_out is {self.held_out!r}; it must be a fraction between 0 and 1, such as 0.25."
            )
        if self.search_windows < 1:
            raise InputError(f"search_windows is {self.search_windows!r}; it must be 1 or more.")
        for name in self.excluded_states:
            check_known(name, STATE_NAMES, f"{name!r} is not a state", otherwise="the states are")
        if not self.counted.any():
            raise InputError("Every state is excluded from the cost; at least one must remain.")

    @property
    def counted(self) -> Bools:
        """Which states (10,) count in the cost."""
        return ~np.isin(STATE_NAMES, self.excluded_states)


DEFAULT_OPTIONS = IdentificationOptions()


def identify(
    robot: RobotLike,
    logs: LogsLike | CheckedLogs,
    *,
    free: Sequence[str] | str = ("friction",),
    law: str = "stribeck",
    bounds: Bounds | str | Path | None = None,
    window: float = 0.25,
    seed: int | None = None,
    options: IdentificationOptions = DEFAULT_OPTIONS,
    run: Run = DEFAULT_RUN,
) -> Identification:
    """Identify b, c, s of each wheel, v_s, delta and C_rr from balancing logs, and any other named quantity.

    Parameters
    ----------
    robot : Robot, preset or robot file
        Its friction is used only for parameters on which the logs have no information, or if friction is not estimated.
    logs : Log or log file, several in a list or a mapping, or CheckedLogs
        With the ten state columns and the torques u1 .. un, at one sample time. Windows with missing values, gaps or a
        fallen robot are skipped. The logs are checked first, unless they are `CheckedLogs`.
    free : sequence of str, or str
        Quantities to estimate: names of `ballbot.identification.quantities.QUANTITIES` or of its groups; in a string
        separated by commas.
    law : str
        The friction law if "friction" is estimated: one of `ballbot.identification.laws.LAWS`, or a registered law
        (`ballbot.register_friction_law`) by its name or as FILE.py:NAME; "best" fits each of `LAWS`, starting from the
        simpler law within it, and selects one by the errors on held-out windows.
    bounds : Bounds or bounds file, optional
        Of the parameters; equal bounds hold a quantity.
    window : float
        Length of the windows [s].
    seed : int, optional
        Replaces the seed of `run`. The same seed gives the same result to the bit, with any executor.
    options : IdentificationOptions, optional
    run : Run, optional
        Executor and progress callback.

    Returns
    -------
    Identification

    Raises
    ------
    InputError
        If the checks of the logs find an error whose code is not accepted; if the logs cannot determine the
        parameters (a column missing, too few windows, no motion); or if an option is invalid.

    Examples
    --------
    >>> import ballbot
    >>> robot = ballbot.Robot.load("alten").replace({"friction.coulomb": 0.1})
    >>> log = ballbot.simulate(robot, "nominal", "square", duration=12.0, seed=1)
    >>> found = ballbot.identify("alten", log, law="coulomb", window=0.1)
    >>> np.round(found.parameters["c"], 3)  # [N m]
    array([0.1, 0.1, 0.1])
    >>> found.verdict.usable
    True
    """
    robot, run = as_robot(robot), run if seed is None else replace(run, seed=seed)
    checked = checked_logs(robot, logs, accept=options.accept)
    within = read_bounds(bounds) if isinstance(bounds, str | Path) else bounds or Bounds()

    prepared, softness = on_points([*checked.logs.values()], robot)
    robot = robot.replace({"friction.roller_softness": softness})

    def fitted(name: str, start: Identification | None) -> Identification:
        own, settings = robot_by_law(robot, name, free=free), replace(options, warm_start=start)
        coordinates = estimated_parameters(own, free=free, law=name, bounds=within)
        return _identified(own, coordinates, checked, prepared, name, window, options=settings, run=run)

    if law != "best":
        return fitted(law, options.warm_start)
    known: dict[str | None, LawCandidate] = {}
    for candidate in LAWS:
        inner = over = known.get(candidate.within)
        by_law = fitted(candidate.name, inner and inner.found)
        while over and not over.accepted:
            over = known.get(over.law.within)
        known[candidate.name] = LawCandidate(
            law=candidate,
            found=by_law,
            gain=_gain(by_law, inner),
            over=over and over.law.name,
            gain_over=_gain(by_law, over),
            error=1.0 - _gain(by_law, None).share,
        )
    selection = LawSelection(candidates=tuple(known.values()))
    return replace(selection.best.found, selection=selection)


def _gain(own: Identification, other: LawCandidate | None) -> Gain:
    """Return the gain over another law, or over no friction."""
    theirs = own.held_out.squares_without if other is None else other.found.held_out.squares_with
    ours, counted = own.held_out.squares_with, own.counted
    return gain_between(ours[:, counted], theirs[:, counted], window_blocks(own.held_out.spans))


def _identified(
    robot: Robot,
    coordinates: Coordinates,
    checked: CheckedLogs,
    logs: Sequence[Log],
    law: str,
    window: float,
    *,
    options: IdentificationOptions,
    run: Run,
) -> Identification:
    """Identify by one law, from the checked logs as of wheels that touch in a point."""

    def report(progress: Progress) -> None:
        error = "" if math.isnan(progress.cost) else f", error x {math.exp(progress.cost):.3f}"
        run.progress(replace(progress, note=f"{law}{error}"))

    reported, rolling = replace(run, progress=report), FoundRolling.of(logs, coordinates, robot)
    coordinates = coordinates if rolling is None else rolling.held()
    prepared = prepare(robot, coordinates, logs, window=window, options=options, run=reported)
    estimate = fit(
        prepared.experiment,
        fixed_starts(coordinates),
        earlier=options.warm_start and _values_of(coordinates, options.warm_start),
        options=options,
        search_blocks=prepared.drawn,
        refused=prepared.refused,
        groups=prepared.groups,
        run=reported,
    )
    prepared, estimate = _alike(prepared, estimate, options=options)
    return _result(prepared, estimate, rolling, checked, law, window, options=options)


def estimated_parameters(robot: Robot, *, free: Sequence[str] | str, law: str, bounds: Bounds) -> Coordinates:
    """Return the parameters that `identify` estimates or holds; InputError if a name is not a quantity or a group."""
    names, chosen = names_in(free), law_named(law)
    if set(FRICTION) <= set(names):
        names = (*chosen.free, *(name for name in names if name not in FRICTION))
        bounds = bounds_of(chosen, bounds)
    return scale_between(robot, free=names, bounds=bounds)


@dataclass(frozen=True, kw_only=True, eq=False)
class Prepared:
    """Windows to fit and to validate on."""

    experiment: Balancing  #: windows to fit
    drawn: Ints  #: rows of those that the search uses
    groups: Ints  #: (w,) of each window, from the slowest by wheel speed to the fastest
    held_out: Windows
    refused: Bools  #: (p,) parameters that the windows to fit do not excite
    findings: tuple[Finding, ...]  #: on these


#: number of groups of windows by speed
_SPEED_GROUPS = 3


def prepare(
    robot: Robot,
    coordinates: Coordinates,
    logs: Sequence[Log],
    *,
    window: float,
    options: IdentificationOptions = DEFAULT_OPTIONS,
    run: Run = DEFAULT_RUN,
) -> Prepared:
    """Cut logs into windows of this length [s], hold some out and check that the others excite the parameters.

    The seed of `run` draws the windows that the search uses. InputError if the logs do not excite the parameters.
    """
    layout, back_emf = coordinates.layout, options.back_emf
    predictor = Predictor(robot=robot, step=options.step, layout=layout, back_emf=back_emf)
    logs = [standstill_torques(without_encoder_lag(log, robot), robot, back_emf) for log in logs]
    windows = windows_for(predictor, coordinates.upper, logs, duration=window)
    held = [holdout_intervals(log, fraction=options.held_out) for log in logs]
    fit_rows, held_rows = split_in_time(windows.spans, held)
    check_count(windows, fitted=len(fit_rows), parameters=int(coordinates.free.sum()))
    fitted = windows.take(fit_rows)
    refused, findings = check_excitation(fitted, robot, coordinates, logs=logs)
    speeds = np.abs(wheel_speeds(predictor, fitted)).mean(axis=(1, 2))
    order = np.argsort(np.argsort(speeds, kind="stable"), kind="stable")
    return Prepared(
        experiment=Balancing(
            predictor=predictor,
            windows=fitted,
            coordinates=coordinates,
            counted=options.counted,
            executor=run.executor,
        ),
        drawn=np.sort(np.random.default_rng(run.seed).permutation(len(fitted))[: options.search_windows]),
        groups=order * _SPEED_GROUPS // len(fitted),
        held_out=windows.take(held_rows),
        refused=refused,
        findings=findings,
    )


def wheel_speeds(predictor: Predictor, windows: Windows) -> Floats:
    """Return the wheel speeds (w, 1 + m, n) [rad/s] in windows."""
    states = np.concatenate([windows.initial[:, None], windows.measured], axis=1)
    return Model(predictor.robot).wheel_speed(states[..., :5], states[..., 5:])


#: fixed starts of friction, scaled: of amounts, and of v_s and delta
_AMOUNTS, _SHAPES = (0.05, 0.2), (0.3, 0.6)


def fixed_starts(coordinates: Coordinates) -> Floats:
    """Return the scaled points (s, p) from which the search starts; quantities other than friction are nominal."""
    names, own = np.array(coordinates.names), coordinates.scaled(coordinates.nominal)
    points = list[Floats]()
    for amount, shape in product(_AMOUNTS, _SHAPES):
        point = own.copy()
        for name in (*FRICTION, *coordinates.layout.own):
            value = shape if BY_NAME[name].scale == "ratio" else amount
            point[(names == name) & coordinates.free] = value
        if not any(np.array_equal(point, other) for other in points):
            points.append(point)
    return np.array(points)


def _values_of(coordinates: Coordinates, earlier: Identification) -> Floats:
    """Return the scaled parameters (p,) of an earlier identification; those that it lacks are nominal."""
    known = dict(zip(earlier.labels, earlier.values.tolist(), strict=True))
    numbers = zip(coordinates.labels, coordinates.nominal.tolist(), strict=True)
    return coordinates.scaled(np.array([known.get(label, nominal) for label, nominal in numbers]))


def _alike(
    prepared: Prepared, estimate: Fit[WindowsIterate], *, options: IdentificationOptions
) -> tuple[Prepared, Fit[WindowsIterate]]:
    """Return the estimate, fitted again with common values for all wheels if the logs cannot separate them."""
    experiment = prepared.experiment
    names = inseparable(
        experiment.coordinates,
        estimate.finished.equations,
        estimate.values,
        unknown=estimate.unknown,
        speeds=wheel_speeds(experiment.predictor, experiment.windows),
    )
    if not names:
        return prepared, estimate
    coordinates = replace(experiment.coordinates, alike=names)
    refused = np.array([prepared.refused[coordinates.first == first].all() for first in coordinates.first])
    prepared = replace(prepared, experiment=replace(experiment, coordinates=coordinates))
    again = fit(
        prepared.experiment,
        coordinates.scaled(wheels_mean(coordinates, estimate.values, names)),
        refused=refused,
        groups=estimate.groups,
        options=options,
        run=estimate.run,
    )
    return prepared, replace(again, other=estimate.other)


def _result(
    prepared: Prepared,
    estimate: Fit[WindowsIterate],
    rolling: FoundRolling | None,
    checked: CheckedLogs,
    law: str,
    window: float,
    *,
    options: IdentificationOptions,
) -> Identification:
    experiment, logs = prepared.experiment, list(checked.logs.values())
    predictor, coordinates = experiment.predictor, experiment.coordinates
    robot, layout = predictor.robot, coordinates.layout
    uncertainty, varied, by_file = _uncertainty(experiment, estimate, rolling)
    of_file = file_value_findings(by_file.values)
    wrong = tuple(item.text.removesuffix(".") for item in of_file if item.severity == "error")
    asymmetric = law in ("asymmetric", "directed") and "torque_offset" in layout.extra
    values, errors = coordinates.physical(uncertainty.point), uncertainty.standard_errors
    found = found_robot(
        robot, layout, uncertainty, torque=by_file.torque, log_count=len(logs), asymmetric=asymmetric
    )
    wheels = WheelFrame.of(logs, robot)
    found = found if wheels is None else wheels.corrected(found)
    covariance = uncertainty.correlation * np.outer(errors, errors)
    balancing = StageEstimate("the balancing logs", layout.labels, values, covariance)
    held_out = window_errors(predictor, prepared.held_out, values)
    return Identification(
        robot=found.annotated(identified_from=[row for log in logs for row in fingerprint(log)]),
        predictor=predictor,
        uncertainty=uncertainty,
        unknown=estimate.unknown[coordinates.first],
        variation=varied,
        coulomb=coulomb_equivalent(
            layout,
            values,
            covariance=covariance,
            wheel_speeds=wheel_speeds(predictor, experiment.windows),
            law=found.friction.own_law,
        ),
        fit=window_errors(predictor, experiment.windows, values),
        held_out=held_out,
        file_values=by_file.values,
        file_share=by_file.added.diagonal()[coordinates.first] / uncertainty.covariance.diagonal(),
        contradicted=() if "file-value" in options.accept else wrong,
        window=window,
        excluded_states=tuple(options.excluded_states),
        gauss_newton_cost=estimate.finished.history,
        findings=(
            *_log_findings(predictor, logs, options.excluded_states),
            *prepared.findings,
            *alike_finding(coordinates),
            *parameter_findings(
                coordinates,
                uncertainty,
                no_influence=estimate.no_influence[coordinates.first],
                at_bound=estimate.at_bound[coordinates.first],
                other=estimate.other,
            ),
            *prediction_findings(held_out.with_over_without),
            *discrepancy_finding(estimate.discrepancy),
            *variation_findings(varied),
            *file_findings(robot, balancing),
            *of_file,
            *([] if wheels is None else wheels.findings(found)),
        ),
        wheels=wheels,
        other=estimate.other,
        log_findings=checked.findings,
    )


def _uncertainty(
    experiment: Balancing, estimate: Fit[WindowsIterate], rolling: FoundRolling | None
) -> tuple[Uncertainty, Variation, FileErrors]:
    """Return the uncertainty from windows, between logs, by the robot file and between wheels, and the middle two."""
    coordinates = experiment.coordinates
    within, varied = widened(coordinates, estimate.uncertainty, estimate.by_log, priors=shipped_priors())
    by_file = from_file(experiment, estimate, rolling)
    within = within if rolling is None else rolling.opened(within)
    of_all = within.with_variation(by_file.rolling + by_file.added)
    return uncertainty_of_each(coordinates, of_all), varied, by_file


def _log_findings(predictor: Predictor, logs: Sequence[Log], excluded_states: Sequence[str]) -> list[Finding]:
    """Return findings on effects that the model lacks: corrupted rows, play, and a ball that pivots."""
    robot, corrupted, chatter, shares = predictor.robot, list[Finding](), list[Finding](), []
    for number, log in enumerate(logs, start=1):
        name = "the log" if len(logs) == 1 else f"log {number}"
        rows = np.flatnonzero(spiked_rows(log, (*STATE_NAMES, *torque_names(robot.wheel_count))))
        if rows.size:
            text = (
                f"In {name} {'one row is' if rows.size == 1 else f'{rows.size} rows are'} corrupted, the first at t = "
                f"{log.t[rows[0]]:.6g} s. Windows with them are not used; `ballbot check-log` names the columns."
            )
            corrupted.append(warning("corrupted", text))
        within_play = chatter_findings(log, robot, name)
        chatter += within_play
        shares += [] if within_play else [share_shown(log, robot)]
    pivoting = heading_findings(shares, excluded_states=excluded_states, estimated=predictor.layout.extra)
    return [*corrupted, *chatter, *pivoting]
