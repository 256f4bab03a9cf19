"""What the errors within logs do not contain: variation between logs of one robot, and between its wheels.

Between logs. This module supplies the statistics of `ballbot.fitting.between_logs` with the sizes and the prior of that
variation, fitted to simulated robots with all faults of the twin and two logs each (`between_logs.toml`, written by
`python -m campaigns.between_logs prior`). The sizes are relative. For c and s they are fractions of the mean c + s of
the wheels; for b, of their mean friction at `SPEED` divided by that speed, because errors of b and c compensate each
other; for C_rr, of C_rr; v_s and delta vary by a factor. Other quantities are taken not to vary.

Between wheels. Short or uniform logs show the friction of all wheels together, and a fit distributes it by chance. With
the clustered covariance of all free parameters, including those at a bound,

    t_i = c_i + s_i E        dry friction of wheel i, E the mean of exp(-|w/v_s|^delta) over the logs' speeds
    d_i = t_i - mean(t)      standard error sigma_i

the wheels get one common dry friction if 2 sigma_i > mean(t) for any wheel: its 95 % interval then includes zero and
twice the mean. The same holds for the viscous friction b_i mean|w|, compared with the whole friction. A common value
estimates the mean of the wheels. A single wheel differs from it by `WHEELS_APART` (standard deviation), which is added
to its error, independently for each wheel.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import cast

import numpy as np

from ballbot.arrays import Bools, Floats
from ballbot.errors import every
from ballbot.files import read_toml
from ballbot.findings import Finding, warning
from ballbot.fitting.between_logs import LogEstimates, spread
from ballbot.fitting.intervals import Interval, Uncertainty
from ballbot.fitting.uncertainty import Discrepancy, WindowEquations, covariance, leverage_corrected
from ballbot.identification.quantities import BY_NAME, Coordinates
from ballbot.mechanics.friction import stribeck_curve
from ballbot.results import key

PRIOR_FILE = Path(__file__).parent / "between_logs.toml"
#: speed at which the friction curve gives the unit of b [rad/s]
SPEED = 10.0
#: least unit, as a share of the bounds' width, for a robot without friction of that kind
_LEAST_UNIT = 0.02
#: logs differ if the p-value is smaller
_UNLIKELY = 0.05


@dataclass(frozen=True, kw_only=True)
class Priors:
    """Variation between logs of one robot, from simulated robots."""

    sizes: Mapping[str, float]  #: by quantity, as fractions of `scaled_units`
    degrees: float  #: of tau^2
    robots: int  #: how many simulated robots they are fitted to


@cache
def shipped_priors() -> Priors:
    """Return the priors that ship with Ballbot."""
    table = read_toml(PRIOR_FILE)
    sizes = cast("Mapping[str, float]", table["sizes"])
    return Priors(sizes=sizes, degrees=cast("float", table["degrees"]), robots=cast("int", table["robots"]))


@dataclass(frozen=True, kw_only=True, eq=False)
class Variation:
    """Variation of the parameters between logs of one robot."""

    logs: int
    prior_robots: int = field(metadata=key("robots_of_the_prior"))  #: simulated robots that the prior is from
    differ: bool = field(metadata=key("logs_differ"))  #: whether the logs differ by more than their errors
    factor: float  #: variation, relative to that of the simulated robots
    #: between logs, SI units, by label; only of quantities that vary
    deviations: Mapping[str, float] = field(metadata=key("standard_deviations"))
    predictions: Mapping[str, Interval] = field(metadata=key("next_log_intervals_95"))  #: by label


def scaled_units(coordinates: Coordinates, values: Floats) -> Floats:
    """Return the scaled units (p,) of the priors' sizes at estimates (p,), SI units; NaN without a prior or held."""
    names = np.array(coordinates.names)
    kinds = ("viscous", "coulomb", "stribeck", "rolling")
    mean = {name: float(np.mean(values[names == name])) for name in kinds}
    dry = mean["coulomb"] + mean["stribeck"]
    of = mean | {"viscous": mean["viscous"] + dry / SPEED, "coulomb": dry, "stribeck": dry}
    units = np.where(np.isin(names, ("stribeck_speed", "stribeck_exponent")), values, np.nan)
    for name, unit in of.items():
        width = float((coordinates.upper - coordinates.lower)[names == name].max())
        units[names == name] = max(unit, _LEAST_UNIT * width)
    slopes = coordinates.slopes(coordinates.scaled(values))
    return np.where(coordinates.free, units / np.where(slopes > 0.0, slopes, 1.0), np.nan)


def widened(
    coordinates: Coordinates, within: Uncertainty, by_log: LogEstimates, *, priors: Priors
) -> tuple[Uncertainty, Variation]:
    """Return the uncertainty `within` logs including the variation between logs, and that variation."""
    shares = np.array([priors.sizes.get(name, 0.0) for name in coordinates.names])
    sizes = np.nan_to_num(shares * scaled_units(coordinates, coordinates.physical(within.point)))
    columns, logs = np.flatnonzero(np.isfinite(by_log.covariances[0].diagonal())), len(by_log.points)
    posterior = spread(
        by_log.points[:, columns],
        by_log.covariances[:, columns[:, None], columns],
        sizes[columns],
        degrees=priors.degrees,
    )
    between_logs = (posterior.factor * sizes) ** 2
    # a parameter at a bound has no covariance with the others
    added = np.diag(between_logs / logs)
    added[np.ix_(columns, columns)] = posterior.added
    ahead = by_log.covariances.diagonal(axis1=1, axis2=2).mean(axis=0)
    deviations = (np.sqrt(between_logs) * coordinates.slopes(within.point))[coordinates.first]
    known = zip(coordinates.labels, deviations.tolist(), sizes[coordinates.first], strict=True)
    return within.with_variation(added), Variation(
        logs=logs,
        prior_robots=priors.robots,
        differ=posterior.p_value < _UNLIKELY,
        factor=posterior.factor,
        deviations={label: deviation for label, deviation, size in known if size > 0.0},
        predictions=within.widened(added.diagonal() + between_logs + np.nan_to_num(ahead)),
    )


def variation_findings(varied: Variation) -> list[Finding]:
    """Return a warning if the variation between logs is assumed, or is larger than their errors."""
    assumed = (
        "One log: the variation between logs of this robot is not measured. All errors include the variation "
        f"between logs of {varied.prior_robots} simulated robots; a second log of this robot would measure its own."
    )
    larger = (
        f"The {varied.logs} logs differ by more than the errors within each log: something that the model lacks "
        "changes from log to log (path, floor, rollers, temperature). All errors include that variation."
    )
    text = assumed if varied.logs == 1 else larger if varied.differ else ""
    return [warning("between-logs", text)] if text else []


def discrepancy_finding(discrepancy: Discrepancy) -> list[Finding]:
    """Return a warning if windows of different speed disagree on the parameters."""
    if not discrepancy.significant:
        return []
    text = (
        "Slow and fast windows of these logs need different parameters (chance gives that in "
        f"{100.0 * discrepancy.p_value:.1g} % of cases): the model lacks an effect that depends on the speed, such as "
        f"slip, play or another friction law. All standard errors are multiplied by {discrepancy.factor:.2g} for it."
    )
    return [warning("discrepancy", text)]


#: largest standard error of a difference, over the mean: beyond it the difference may be as large as the mean
INSEPARABLE = 0.5
#: standard deviation of a wheel's friction about the mean, as a share of it: that of the nominal twin's wheels, and
#: about that of the three motors of the robot in docs/real_robots.md
WHEELS_APART = 0.15


def inseparable(
    coordinates: Coordinates, equations: WindowEquations, values: Floats, *, unknown: Bools, speeds: Floats
) -> tuple[str, ...]:
    """Return the quantities whose values on single wheels the logs cannot separate.

    `equations` and `values` (p,) are of a fit of each wheel by itself; `unknown` (p,) marks parameters that the logs do
    not excite or that have no influence; `speeds` (..., n) [rad/s] are those of the wheels in the logs.
    """
    layout, free, n = coordinates.layout, coordinates.free, coordinates.layout.wheel_count
    gains = layout.columns("torque_gain")
    if gains is not None and free[gains].any():  # the user asked for differences between motors
        return ()
    speeds = np.abs(speeds.reshape(-1, n))
    v_s, delta = (float(layout.number(name, values)) for name in ("stribeck_speed", "stribeck_exponent"))
    decay = stribeck_curve(0.0, 1.0, speeds / v_s, delta).mean(axis=0)
    weights = {"viscous": speeds.mean(axis=0), "coulomb": np.ones(n), "stribeck": decay}
    gradients = {name: np.zeros((n, len(values))) for name in weights}
    for name, weight in weights.items():
        gradients[name][:, layout.columns(name)] = np.diag(weight)
    known = free & ~unknown & (equations.matrix.diagonal() > 0.0)
    C = covariance(leverage_corrected(equations, known), known)
    slopes = coordinates.slopes(coordinates.scaled(values))
    C = np.nan_to_num(C) * np.outer(slopes, slopes)
    from_mean = np.eye(n) - 1.0 / n
    total = np.sum(list(gradients.values()), axis=0) @ values
    names: list[str] = []
    # quantities that get common values together, and whether these are compared with the whole friction
    for kinds, of_all in ((("coulomb", "stribeck"), False), (("viscous",), True)):
        mine = [name for name in kinds if free[layout.columns(name)].any()]
        if not mine:
            continue
        G = np.sum([gradients[name] for name in mine], axis=0)
        errors = np.sqrt(np.maximum(np.diag(from_mean @ G @ C @ G.T @ from_mean.T), 0.0))
        size = float(np.mean(total if of_all else G @ values))
        blind = any(unknown[layout.columns(name)].any() for name in mine)
        if blind or np.any(errors > INSEPARABLE * size):
            names += mine
    return tuple(names)


def wheels_mean(coordinates: Coordinates, values: Floats, names: Collection[str]) -> Floats:
    """Return values (p,) with the numbers of these quantities replaced by their mean over the wheels."""
    result = values.copy()
    for name in names:
        columns = coordinates.layout.columns(name)
        result[columns] = result[columns].mean()
    return result


def uncertainty_of_each(coordinates: Coordinates, uncertainty: Uncertainty) -> Uncertainty:
    """Return the uncertainty of each wheel's values (p,), from that of the common values."""
    first, slopes = coordinates.first, coordinates.slopes(uncertainty.point)
    apart = WHEELS_APART * coordinates.physical(uncertainty.point) / np.where(slopes > 0.0, slopes, np.inf)
    each = replace(uncertainty, covariance=uncertainty.covariance[np.ix_(first, first)])
    return each.with_variation(
        np.diag(np.where(np.isin(coordinates.names, coordinates.alike), apart, 0.0) ** 2)
    )


def alike_finding(coordinates: Coordinates) -> list[Finding]:
    """Return a warning if motors have common values."""
    if not coordinates.alike:
        return []
    symbols = every([BY_NAME[name].symbol for name in coordinates.alike])
    text = (
        f"Motors alike: these logs cannot separate the {coordinates.layout.wheel_count} motors by {symbols}, so "
        "all motors get common values. Errors allow for wheels that differ by "
        f"{100.0 * WHEELS_APART:.0f} %. Longer logs with motion in all directions and about the vertical separate them."
    )
    return [warning("motors-alike", text)]
