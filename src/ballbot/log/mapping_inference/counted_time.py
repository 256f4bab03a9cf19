"""How many seconds a count of the rows is, by the gyro: for a log whose only clock counts loops."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from ballbot.log.columns import FACTORS
from ballbot.log.mapping_inference.roles import Roles
from ballbot.log.mapping_inference.units import lean_units

#: rows over which angles and gyro are averaged before they are compared
_ROWS = 21
#: the least correlation of a gyro with the rate of an angle
_LEAST = 0.8
#: intervals of control loops [s]; one that is this near [log] to the estimate is meant
_USUAL, _NEAR = (0.001, 0.002, 0.0025, 0.004, 0.005, 0.008, 0.01, 0.02, 0.025, 0.04, 0.05, 0.1), 0.04


def seconds_of_a_count(
    counter: NDArray[np.float64], roles: Roles, columns: Mapping[str, NDArray[np.float64]]
) -> float | None:
    """Return the seconds of one count, by the rates of roll, pitch and yaw beside a gyro whose name has a unit.

    Parameters
    ----------
    counter : ndarray (N,)
        Rises by whole numbers.
    roles : Roles
    columns : mapping of str to (N,) array

    Returns
    -------
    float or None
        None if the log does not show it.
    """
    gyro, lean = roles.reading(roles.gyro), roles.reading(roles.attitude)
    if gyro is None or lean is None or gyro.unit not in FACTORS["rad/s"]:
        return None
    values = np.column_stack([columns[name] for name in (*roles.attitude, *roles.gyro)])
    whole = np.isfinite(values).all(axis=1) & np.isfinite(counter)
    values, counter = values[whole], counter[whole]
    count = len(roles.attitude)
    if len(values) < 10 * _ROWS or not np.all(np.diff(counter) > 0.0):
        return None
    weights = lean_units(values[:, :2], lean.unit)
    angles = values[:, :count] * max(weights, key=lambda one: weights[one]).factor
    angles[:, 2:] = np.unwrap(angles[:, 2:], axis=0)
    turned = np.gradient(_averaged(angles), _averaged(counter[:, None])[:, 0], axis=0)
    rates = _averaged(values[:, count:]) * FACTORS["rad/s"][gyro.unit]
    R = np.abs(np.corrcoef(rates.T, turned.T)[: rates.shape[1], rates.shape[1] :])
    order = max(
        permutations(range(3), count), key=lambda one: sum(R[place, axis] for axis, place in enumerate(one))
    )
    ratios = [
        float(np.std(turned[:, axis]) / np.std(rates[:, place]))
        for axis, place in enumerate(order)
        if R[place, axis] > _LEAST
    ]
    if not ratios:
        return None
    seconds = float(np.median(ratios))
    near = min(_USUAL, key=lambda one: abs(math.log(one / seconds)))
    return near if abs(math.log(near / seconds)) < _NEAR else float(f"{seconds:.3g}")


def _averaged(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return smooth columns (N - _ROWS + 1, k)."""
    window = np.hanning(_ROWS + 2)[1:-1]
    return np.column_stack([np.convolve(column, window / window.sum(), mode="valid") for column in values.T])
