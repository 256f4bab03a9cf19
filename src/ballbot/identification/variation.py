"""The variation of an identification between logs of one robot, beside the errors within logs.

Another log of the same robot gives other estimates, because another path, other roller contacts and another sensor
drift act on what the model lacks. This module supplies the statistics of `ballbot.fitting.between_logs` with the sizes
and the prior of that variation, fitted to simulated robots with all faults of the twin and two logs each
(`between_logs.toml`, written by `python -m campaigns.between_logs prior`). With one log, only the prior is known, and a
finding says so; with every further log the prior counts less.

The sizes are relative. For c and s they are fractions of the mean c + s of the wheels; for b, of their mean friction at
`SPEED` divided by that speed, because errors of b and c compensate each other; for C_rr, of C_rr; v_s and delta vary by
a factor. Other quantities are taken not to vary.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray

from ballbot.files import read_toml
from ballbot.findings import Finding, warning
from ballbot.fitting.between_logs import LogEstimates, spread
from ballbot.fitting.intervals import Interval, Uncertainty
from ballbot.fitting.uncertainty import Discrepancy
from ballbot.identification.quantities import Coordinates
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
    #: 95 % intervals of the estimate from another log as long as these, by label
    predictions: Mapping[str, Interval] = field(metadata=key("next_log_intervals_95"))


def scaled_units(coordinates: Coordinates, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the units (p,), scaled, of the priors' sizes at estimates (p,), SI units.

    NaN without a prior, or for a parameter that is held.
    """
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
    """Return the uncertainty including the variation between logs, and that variation.

    `within` is the uncertainty from the errors within the logs.
    """
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


def with_torque_scale(
    coordinates: Coordinates, uncertainty: Uncertainty, scale_errors: NDArray[np.float64]
) -> Uncertainty:
    """Return the uncertainty including that of the torque scale, by which a motor's friction is wrong too.

    `scale_errors` (n,) are the relative errors of `ballbot.log.checks.physics.torque_scale_errors`.
    """
    layout, values = coordinates.layout, coordinates.physical(uncertainty.point)
    of_wheel = np.zeros((layout.wheel_count, len(values)))
    for name in ("viscous", "coulomb", "stribeck"):
        of_wheel[:, layout.columns(name)] = np.diag(values[layout.columns(name)])
    slopes = np.where(coordinates.free, coordinates.slopes(uncertainty.point), np.inf)
    by_scale = scale_errors[:, None] * of_wheel / slopes
    return uncertainty.with_variation(by_scale.T @ by_scale)


def variation_findings(varied: Variation) -> list[Finding]:
    """Return a warning if the variation between logs is assumed, or is larger than their errors."""
    if varied.logs == 1:
        text = (
            "One log: the variation between logs of this robot is not measured. All errors include the variation "
            f"between logs of {varied.prior_robots} simulated robots; a second log of this robot would measure its own."
        )
        return [warning("between-logs", text)]
    if not varied.differ:
        return []
    text = (
        f"The {varied.logs} logs differ by more than the errors within each log: something that the model lacks "
        "changes from log to log (path, floor, rollers, temperature). All errors include that variation."
    )
    return [warning("between-logs", text)]


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
