"""One uncertainty of an identification: what its logs show within themselves, and how logs of one robot vary.

The errors of `ballbot.fitting.uncertainty` hold under the conditions of the logs at hand. Another log of the same robot
leads elsewhere: another way over the floor, other places of the rollers, another drift of the sensors act on what the
model lacks. To the statistics of `ballbot.fitting.between_logs` this module gives sizes and prior of the variation,
fitted to simulated robots with all faults of the twin, each with two logs (`between_logs.toml`, written by
`python -m campaigns.between_logs prior`). With one log nothing else is known of the variation, and a finding says so;
with every further log it counts less.

The covariance that comes of it (`widened`) is the one that an identification states: its standard errors, intervals and
correlations, the deviations in the robot's file, and what is certain enough to be compensated follow from it.

An amount varies in proportion to the robot's size: the sizes of c and s are fractions of the wheels' mean c + s; of b
of their mean friction at `SPEED` over that speed, because errors of b and c compensate each other; of C_rr of itself;
v_s and delta vary by a factor. Other quantities are not known to vary.
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
#: speed at which the unit of b is read off the friction curve [rad/s]
SPEED = 10.0
#: a unit is at least this share of the bounds' width, so that a robot without friction of a kind has one
_LEAST_UNIT = 0.02
#: logs differ if chance gives that in fewer cases
_UNLIKELY = 0.05


@dataclass(frozen=True, kw_only=True)
class Priors:
    """How logs of one robot vary, by simulated robots."""

    sizes: Mapping[str, float]  #: by quantity, as fractions of `scaled_units`
    degrees: float  #: of tau^2
    robots: int  #: the simulated robots that they are fitted to


@cache
def shipped_priors() -> Priors:
    """Return the priors that ship with Ballbot."""
    table = read_toml(PRIOR_FILE)
    sizes = cast("Mapping[str, float]", table["sizes"])
    return Priors(sizes=sizes, degrees=cast("float", table["degrees"]), robots=cast("int", table["robots"]))


@dataclass(frozen=True, kw_only=True, eq=False)
class Variation:
    """How parameters vary between logs of one robot."""

    logs: int
    #: the simulated robots of the prior
    prior_robots: int = field(metadata=key("robots_of_the_prior"))
    #: whether the logs differ by more than their errors explain
    differ: bool = field(metadata=key("logs_differ"))
    factor: float  #: the variation over that of the simulated robots
    #: between logs, SI units, by label, as far as they are known
    deviations: Mapping[str, float] = field(metadata=key("standard_deviations"))
    #: 95 %, for the estimate from another log as long as these, by label
    predictions: Mapping[str, Interval] = field(metadata=key("next_log_intervals_95"))


def scaled_units(coordinates: Coordinates, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the units (p,) that the priors' sizes are shares of, at estimates (p,), SI; scaled.

    NaN without a prior, or for a parameter that is held.
    """
    names = np.array(coordinates.names)
    mean = {
        name: float(np.mean(values[names == name])) for name in ("viscous", "coulomb", "stribeck", "rolling")
    }
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
    """Return the uncertainty with the variation between logs, and that variation.

    `within` is the uncertainty of the estimate from all logs under their conditions.
    """
    shares = np.array([priors.sizes.get(name, 0.0) for name in coordinates.names])
    sizes = np.nan_to_num(shares * scaled_units(coordinates, coordinates.physical(within.point)))
    places, logs = np.flatnonzero(np.isfinite(by_log.covariances[0].diagonal())), len(by_log.points)
    found = spread(
        by_log.points[:, places],
        by_log.covariances[:, places[:, None], places],
        sizes[places],
        degrees=priors.degrees,
    )
    between_logs = (found.factor * sizes) ** 2
    # a parameter at a bound has no covariance with the others
    added = np.diag(between_logs / logs)
    added[np.ix_(places, places)] = found.added
    ahead = by_log.covariances.diagonal(axis1=1, axis2=2).mean(axis=0)
    deviations = (np.sqrt(between_logs) * coordinates.slopes(within.point))[coordinates.first]
    known = zip(coordinates.labels, deviations.tolist(), sizes[coordinates.first], strict=True)
    return within.with_variation(added), Variation(
        logs=logs,
        prior_robots=priors.robots,
        differ=found.p_value < _UNLIKELY,
        factor=found.factor,
        deviations={label: deviation for label, deviation, size in known if size > 0.0},
        predictions=within.widened(added.diagonal() + between_logs + np.nan_to_num(ahead)),
    )


def with_torque_scale(
    coordinates: Coordinates, uncertainty: Uncertainty, scale_errors: NDArray[np.float64]
) -> Uncertainty:
    """Return the uncertainty with that of the torques' scale: a motor's friction is as wrong as its torque.

    `uncertainty` holds for torques of the right scale; `scale_errors` (n,) are the relative standard errors of each
    one's, of `ballbot.log.checks.physics.torque_scale_errors`.
    """
    layout, values = coordinates.layout, coordinates.physical(uncertainty.point)
    of_wheel = np.zeros((layout.wheel_count, len(values)))
    for name in ("viscous", "coulomb", "stribeck"):
        of_wheel[:, layout.columns(name)] = np.diag(values[layout.columns(name)])
    slopes = np.where(coordinates.free, coordinates.slopes(uncertainty.point), np.inf)
    by_scale = scale_errors[:, None] * of_wheel / slopes
    return uncertainty.with_variation(by_scale.T @ by_scale)


def variation_findings(varied: Variation) -> list[Finding]:
    """Return what is assumed of the variation between logs, or that it is more than their errors explain."""
    if varied.logs == 1:
        text = (
            "One log: how far another log of this robot would lead elsewhere is not measured. All errors contain the "
            f"variation between logs of {varied.prior_robots} simulated robots; a second log of this robot would "
            "measure its own."
        )
        return [warning("between-logs", text)]
    if not varied.differ:
        return []
    text = (
        f"The {varied.logs} logs differ by more than the errors within each log: something that the model lacks "
        "changes from log to log (the way driven, floor, rollers, temperature). All errors contain that variation."
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
