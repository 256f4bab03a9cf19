"""What the estimates from other logs of the same robot will be: identification's prediction intervals.

The intervals of `ballbot.fitting.intervals` hold under the conditions of the logs at hand. From another log of the
same robot the estimate differs by more: another way over the floor, other places of the rollers, another drift of the
sensors act on what the model lacks. `ballbot.fitting.between_logs` has the statistics. This module gives it

- the estimate from each log by itself: one Gauss-Newton step from the estimate from all logs, by that log's windows;
- the prior of the variance between logs, fitted to simulated robots with all faults of the twin, each with two logs
  (`between_logs.toml`, written by `python -m campaigns.between_logs prior`). With one log nothing else is known of
  that variance, and a finding says so; with every further log it counts less.

An amount varies in proportion to the robot's size: the prior's deviations of b are fractions of the wheels' mean b, of
c and s of their mean c + s, of C_rr of itself; v_s and delta vary by a factor.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Protocol

import numpy as np
import scipy
from numpy.typing import NDArray

from ballbot.errors import InputError, every
from ballbot.files import read_toml
from ballbot.findings import Finding, warning
from ballbot.fitting.between_logs import LogVariation, VariancePrior, vary
from ballbot.fitting.intervals import Interval, Uncertainty
from ballbot.fitting.uncertainty import (
    Discrepancy,
    WindowEquations,
    bootstrap,
    covariance,
    leverage_corrected,
)
from ballbot.identification.parameters import Coordinates
from ballbot.identification.windows import Span

PRIOR_FILE = Path(__file__).parent / "between_logs.toml"
#: a unit is at least this share of the bounds' width, so that a robot without friction of a kind has one
_LEAST_UNIT = 0.02
#: logs differ if chance gives that in fewer cases, for any of the parameters
_UNLIKELY = 0.05
#: half the width of a 95 % interval of a normal variable, in its deviations
_HALF = 1.96


@dataclass(frozen=True, kw_only=True)
class Priors:
    """Priors of the variance between logs, by quantity, as fractions of the unit of `units_of`."""

    by_name: Mapping[str, VariancePrior]
    robots: int  #: the simulated robots that they are fitted to


@cache
def shipped_priors() -> Priors:
    """Return the priors that ship with Ballbot."""
    table = read_toml(PRIOR_FILE)
    robots = table.pop("robots")
    try:
        assert isinstance(robots, int)
        priors = {
            name: VariancePrior(**{key: float(value) for key, value in one.items()})
            for name, one in table.items()
            if isinstance(one, dict)
        }
    except (AssertionError, KeyError, TypeError, ValueError):
        raise InputError(f"{PRIOR_FILE} is no table of priors; install Ballbot again.") from None
    return Priors(by_name=priors, robots=robots)


@dataclass(frozen=True, kw_only=True, eq=False)
class LogEstimates:
    """The estimates of each of k logs, scaled, and their standard errors."""

    points: NDArray[np.float64]  #: (k, p)
    errors: NDArray[np.float64]  #: (k, p); NaN for parameters that were not estimated


@dataclass(frozen=True, kw_only=True, eq=False)
class Variation:
    """How parameters vary between logs of one robot, by label."""

    logs: int
    apart: tuple[str, ...]  #: parameters by which the logs differ by more than their errors explain
    predictions: Mapping[str, Interval]  #: 95 %, for the estimate from another log as long as these
    robots: Mapping[str, Interval]  #: 95 %, for what all logs of the robot have in common
    deviations: NDArray[np.float64]  #: (p,), of what they have in common, SI units; NaN if not estimated
    between: Mapping[str, LogVariation]  #: in units of `units_of`, or of the logarithm
    within: Mapping[str, float]  #: median of the standard errors within each log, in the same units
    units: NDArray[np.float64]  #: (p,)
    prior_robots: int

    def open_predictions(self, bounds: Mapping[str, Sequence[float]]) -> dict[str, Interval]:
        """Return the predictions as confidence intervals have them: an end at a bound of the search is infinite.

        The zero of an amount stays a limit. `bounds` are the least and the greatest value, by label.
        """
        return {
            label: replace(
                one,
                lower=one.lower if one.lower > bounds[label][0] or one.lower == 0.0 else -np.inf,
                upper=one.upper if one.upper < bounds[label][1] else np.inf,
            )
            for label, one in self.predictions.items()
        }

    def to_dict(self, parameters: Mapping[str, float]) -> dict[str, object]:
        """Return what results.json holds; `parameters` are the estimates by label."""
        return {
            label: {
                "standard_deviation_between_logs": one.between * self._size(label, parameters),
                "interval_95_of_it": [
                    end * self._size(label, parameters)
                    for end in (one.between_limits.lower, one.between_limits.upper)
                ],
                "robot_interval_95": _ends(self.robots[label]),
                "next_log_interval_95": _ends(self.predictions[label]),
            }
            for label, one in self.between.items()
        }

    def _size(self, label: str, parameters: Mapping[str, float]) -> float:
        """Return what a deviation of one is in SI units."""
        unit = float(self.units[list(parameters).index(label)])
        return unit if np.isfinite(unit) else parameters[label]


class Fitted(Protocol):
    """Where a fit to windows ended."""

    @property
    def point(self) -> NDArray[np.float64]:
        """The parameters (p,), scaled."""
        ...

    @property
    def equations(self) -> WindowEquations:
        """The normal equations of each window there."""
        ...


def log_estimates(
    coordinates: Coordinates,
    fit: Fitted,
    spans: Sequence[Span],
    *,
    values: NDArray[np.float64],
    uncertainty: Uncertainty,
    widen: float,
    seed: int,
) -> LogEstimates:
    """Return what each log by itself leads to, to first order about the estimate from all of them.

    One log leads to the estimate itself, with its errors. A parameter at a bound stays there in every log; its error
    is what its interval reaches from the bound.

    Parameters
    ----------
    coordinates : Coordinates
    fit : Fitted
    spans : sequence of Span (w,)
        Of its windows.
    values : ndarray (p,)
        The estimate from all logs, SI units; that of the fit, or one that a sweep has moved.
    uncertainty : Uncertainty
        Of the estimate.
    widen : float
        What errors within a log are multiplied by, as those of `uncertainty` are.
    seed : int
        Of the bootstrap within each log.
    """
    scaled, slopes = coordinates.scaled(values), coordinates.slopes(coordinates.scaled(values))
    with np.errstate(divide="ignore", invalid="ignore"):
        whole = np.fmax(uncertainty.standard_errors, uncertainty.bootstrap_errors) / slopes
    estimated = np.isfinite(whole)
    of_log = np.array([span.log for span in spans])
    logs, places = np.unique(of_log), np.flatnonzero(estimated)
    points, errors = np.tile(scaled, (len(logs), 1)), np.tile(whole, (len(logs), 1))
    if len(logs) > 1 and len(places):
        common = _step(fit.equations, places)
        for k, log in enumerate(logs):
            rows = of_log == log
            mine = WindowEquations(matrices=fit.equations.matrices[rows], scores=fit.equations.scores[rows])
            step = _step(mine, places)
            points[k, places] += step - common
            # about the log's own estimate, or what it differs from the others by would count as noise within it
            moved = np.einsum("wij,j->wi", mine.matrices[:, :, places], step, optimize=False)
            own = WindowEquations(matrices=mine.matrices, scores=mine.scores + moved)
            corrected = leverage_corrected(own.matrices, own.scores, estimated)
            variances = covariance(corrected, estimated).diagonal()
            clustered = np.sqrt(np.where(variances > 0.0, variances, np.nan))
            errors[k] = widen * np.fmax(clustered, bootstrap(own, estimated, seed=seed).errors)
    for i in np.flatnonzero(~estimated):
        one = uncertainty.intervals.get(coordinates.labels[i])
        if one is not None:
            ends = coordinates.scaled_one(int(i), np.array([one.lower, one.upper]))
            reach = np.abs(ends - scaled[i])[np.isfinite([one.lower, one.upper])].max(initial=0.0)
            errors[:, i] = reach / _HALF if reach > 0.0 else np.nan
    return LogEstimates(points=points, errors=errors)


def _step(equations: WindowEquations, places: NDArray[np.intp]) -> NDArray[np.float64]:
    """Return the Gauss-Newton step of the parameters at `places`."""
    H = equations.matrices[:, places[:, None], places].sum(axis=0)
    scale = 1.0 / np.sqrt(np.maximum(H.diagonal(), np.finfo(float).tiny))
    g = equations.scores[:, places].sum(axis=0) * scale
    # a log may lack every window that determines a parameter: a small ridge keeps its equations soluble
    return -scale * np.linalg.solve(H * np.outer(scale, scale) + 1e-12 * np.eye(len(places)), g)


def units_of(coordinates: Coordinates, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the units (p,) in which the priors' deviations are, SI; infinite for logarithms, NaN without a prior.

    Parameters
    ----------
    coordinates : Coordinates
    values : ndarray (p,)
        The estimates, SI units.
    """
    names, layout = np.array(coordinates.names), coordinates.layout
    mean = {name: float(np.mean(values[names == name])) for name in layout.names}
    dry = mean["coulomb"] + mean["stribeck"]
    of = {"viscous": mean["viscous"], "coulomb": dry, "stribeck": dry, "rolling": mean["rolling"]}
    units = np.full(len(names), np.nan)
    for name, unit in of.items():
        width = float((coordinates.upper - coordinates.lower)[names == name].max())
        units[names == name] = max(unit, _LEAST_UNIT * width)
    units[np.isin(names, ("stribeck_speed", "stribeck_exponent"))] = np.inf
    return units


def variation(
    coordinates: Coordinates,
    values: NDArray[np.float64],
    by_log: LogEstimates,
    *,
    priors: Priors,
) -> Variation:
    """Return how the parameters vary between logs.

    Parameters
    ----------
    coordinates : Coordinates
    values : ndarray (p,)
        The estimates from all logs, SI units.
    by_log : LogEstimates
    priors : Priors
    """
    units = units_of(coordinates, values)
    by_log = LogEstimates(points=by_log.points, errors=_pooled(coordinates.names, by_log.errors))
    slopes = coordinates.slopes(coordinates.scaled(values))
    predictions, robots, between, within, differences = {}, {}, {}, {}, {}
    deviations = np.full(len(values), np.nan)
    for i, (label, name) in enumerate(zip(coordinates.labels, coordinates.names, strict=True)):
        if name not in priors.by_name or not np.isfinite(by_log.errors[:, i]).all():
            continue
        logarithmic = bool(np.isinf(units[i]))
        physical = np.array([coordinates.physical(point)[i] for point in by_log.points])
        size = values[i] if logarithmic else units[i]
        y = np.log(physical) if logarithmic else physical / units[i]
        errors = by_log.errors[:, i] * slopes[i] / size
        within[label] = float(np.median(errors))
        differences[label] = _difference(y, errors)
        found = between[label] = vary(y, errors, prior=priors.by_name[name], next_error=within[label])
        ends = [
            (np.exp(end) if logarithmic else end * units[i])
            for limits in (found.prediction, found.parameter)
            for end in (limits.lower, limits.upper)
        ]
        low, high = coordinates.lower[i], coordinates.upper[i]
        clipped = [float(np.clip(end, low, high)) for end in ends]
        predictions[label] = Interval(lower=clipped[0], upper=clipped[1], method="between logs")
        robots[label] = Interval(lower=clipped[2], upper=clipped[3], method="between logs")
        deviations[i] = (found.parameter.upper - found.parameter.lower) / (2.0 * _HALF) * size
    return Variation(
        logs=len(by_log.points),
        apart=tuple(label for label, p in differences.items() if p < _UNLIKELY / len(differences)),
        predictions=predictions,
        robots=robots,
        deviations=deviations,
        between=between,
        within=within,
        units=units,
        prior_robots=priors.robots,
    )


def _pooled(names: Sequence[str], errors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return errors (k, p), none below the root mean square of the quantity's in that log.

    Wheels are alike, and an error from some dozens of windows is itself uncertain: of three wheels the one with the
    least error is rarely known that much better.
    """
    pooled = errors.copy()
    for name in dict.fromkeys(names):
        places = np.flatnonzero(np.array(names) == name)
        mine = errors[:, places]
        count = np.isfinite(mine).sum(axis=1)
        common = np.sqrt(np.nansum(mine**2, axis=1) / np.maximum(count, 1))
        pooled[:, places] = np.where(np.isfinite(mine), np.fmax(mine, common[:, None]), np.nan)
    return pooled


def _difference(y: NDArray[np.float64], errors: NDArray[np.float64]) -> float:
    """Return how likely estimates differ as much by chance alone (Cochran's Q); one for a single log."""
    if len(y) == 1:
        return 1.0
    weights = 1.0 / errors**2
    middle = (weights * y).sum() / weights.sum()
    return float(scipy.stats.chi2.sf((weights * (y - middle) ** 2).sum(), len(y) - 1))


def variation_findings(varied: Variation) -> list[Finding]:
    """Return what is assumed of the variance between logs, or which parameters vary by more than their errors."""
    if not varied.between:
        return []
    if varied.logs == 1:
        text = (
            "One log: its intervals hold under its own conditions. The wider intervals for another log take the "
            f"variation between logs from {varied.prior_robots} simulated robots, not from this one; a second log "
            "of this robot would measure it."
        )
        return [warning("between-logs", text)]
    far = varied.apart
    if not far:
        return []
    text = (
        f"Between the {varied.logs} logs {every(far)} {'varies' if len(far) == 1 else 'vary'} by more than the "
        "errors within each log: something that the model lacks changes from log to log (the way driven, floor, "
        "rollers, temperature). Use the intervals for another log."
    )
    return [warning("between-logs", text)]


def discrepancy_finding(found: Discrepancy) -> list[Finding]:
    """Return the finding of windows that disagree on the parameters."""
    if not found.significant:
        return []
    text = (
        "Slow and fast windows of these logs want different parameters (chance gives that in "
        f"{100.0 * found.p_value:.1g} % of cases): the model lacks an effect that depends on the speed, such as slip, "
        f"play or another friction law. All standard errors are {found.factor:.2g} times as large for it."
    )
    return [warning("discrepancy", text)]


def _ends(interval: Interval) -> list[float]:
    return [interval.lower, interval.upper]
