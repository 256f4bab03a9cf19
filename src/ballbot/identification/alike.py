"""One common friction for motors that the logs cannot separate.

A robot's motors are of one kind, and each wheel's friction is fitted separately if the logs separate the wheels. Short
or uniform logs do not: they show the friction of all wheels together, and a fit distributes it by chance, from nothing
on one wheel to several times the mean on another. The test uses the differences between wheels and their clustered
covariance, of all free parameters including those at a bound:

    t_i = c_i + s_i E        dry friction of wheel i, E the mean of exp(-|w/v_s|^delta) over the logs' speeds
    d_i = t_i - mean(t)      standard error sigma_i

The wheels get one common dry friction if 2 sigma_i > mean(t) for any wheel: its 95 % interval then includes zero and
twice the mean. The same holds for the viscous friction b_i mean|w|, compared with the whole friction.

A common value estimates the mean of the wheels. A single wheel differs from it by `WHEELS_APART` (standard deviation),
which is added to its error, independently for each wheel.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import every
from ballbot.findings import Finding, warning
from ballbot.fitting.intervals import Uncertainty
from ballbot.fitting.uncertainty import WindowEquations, covariance, leverage_corrected
from ballbot.identification.quantities import BY_NAME, Coordinates
from ballbot.mechanics.friction import stribeck_decay

#: largest standard error of a difference, over the mean: beyond it the difference may be as large as the mean
INSEPARABLE = 0.5
#: standard deviation of a wheel's friction about the mean, as a share of it: that of the nominal twin's wheels, and
#: about that of the three motors of the robot in docs/real_robots.md
WHEELS_APART = 0.15
#: quantities that get common values together
_DRY, _VISCOUS = ("coulomb", "stribeck"), ("viscous",)


def inseparable(
    coordinates: Coordinates,
    equations: WindowEquations,
    values: NDArray[np.float64],
    *,
    unknown: NDArray[np.bool_],
    speeds: NDArray[np.float64],
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
    decay = stribeck_decay(speeds / v_s, delta).mean(axis=0)
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
    for kinds, of_all in ((_DRY, False), (_VISCOUS, True)):
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


def wheels_mean(
    coordinates: Coordinates, values: NDArray[np.float64], names: Collection[str]
) -> NDArray[np.float64]:
    """Return values (p,) with the numbers of these quantities replaced by their mean over the wheels."""
    result = values.copy()
    for name in names:
        part = coordinates.layout.part(name, result)
        assert part is not None
        part[...] = part.mean()
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
