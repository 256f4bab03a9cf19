"""The handedness of roll, pitch and yaw, and how late roll and pitch are, by a gyro.

Where the heading turns, a gyro shows whether roll, pitch and yaw have one handedness: of angles of the aerospace order
with sigma = 1 if they have it and -1 if one of them is reversed, a gyro measures to first order of the lean

    gyro_x = roll_dot - sigma yaw_dot pitch,      gyro_y = pitch_dot + sigma yaw_dot roll

The law is integrated over time, since derivatives would make the white noise of roll and pitch large beside the slow
part of the yaw's rate,

    roll - int gyro_x = sigma int yaw_dot pitch,      pitch - int gyro_y = -sigma int yaw_dot roll

each up to an offset of each span of rows, and a gyro's offset. What is left is white noise and a random walk, the
gyro's noise integrated, in a proportion that the likelihood chooses (`WHITENING`).

Angles that are d later than the gyro leave -d gyro besides. The noise of the angles is not in the gyro's of the same
row, even if the robot's motors respond to it later. Correlations of the gyro with rates of filtered angles, whose noise
is spread over the rows before, are largest up to 35 ms beside the true delay.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from ballbot.log.mapping_inference.evidence import TINY
from ballbot.log.signals import LONGEST_HOLE

#: fewest rows of usable motion
LEAST_ROWS = 200
#: rows of usable motion that are compared are at least so long [s]; no interval between them is longer than
#: `LONGEST_HOLE`
LEAST_SPAN = 1.0
#: gains of the filters that are tried, of which the likeliest whitens what is left: none, for noise of the angles
#: alone, and more the more the gyro's noise adds up, or the angles are drawn to the accelerometer's
WHITENING = (0.0, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0)
#: blocks of rows [s] within which what is left may be correlated
CORRELATED = 0.5


def handedness_by_gyro(
    t: NDArray[np.float64],
    angles: NDArray[np.float64],
    rates: NDArray[np.float64],
    turning: NDArray[np.float64],
    usable: NDArray[np.bool_],
) -> tuple[float, float]:
    """Return sigma of the module's text and its standard error.

    The standard error is the larger of that of white noise, and of noise that is correlated within blocks. With too few
    rows the estimate is nan, and its error infinite.

    Parameters
    ----------
    t : ndarray (N,)
        [s]
    angles : ndarray (N, 3)
        Roll, pitch and yaw [rad].
    rates : ndarray (N, 2)
        The gyro's about roll and pitch, with their signs and at the angles' time [rad/s].
    turning : ndarray (N,)
        The yaw's rate [rad/s].
    usable : ndarray (N,)
    """

    def table(rows: slice, axis: int, gain: float) -> NDArray[np.float64]:
        turned = (1.0, -1.0)[axis] * turning[rows] * angles[rows, 1 - axis]
        return _integrated(t[rows], angles[rows, axis], turned, rates[rows, axis], gain)

    return _likeliest_factor(t, _spans(t, usable), table)


def angles_after_gyro(
    t: NDArray[np.float64],
    angles: NDArray[np.float64],
    rates: NDArray[np.float64],
    turning: NDArray[np.float64],
    usable: NDArray[np.bool_],
) -> tuple[float, float]:
    """Return by how much roll and pitch are later than the gyro [s], and its standard error; as `handedness_by_gyro`.

    The rates are as logged, at times of their own.
    """

    def table(rows: slice, axis: int, gain: float) -> NDArray[np.float64]:
        turned, rate = turning[rows] * angles[rows, 1 - axis], rates[rows, axis]
        later = _whitened(-rate[:, None], gain)
        return np.hstack([later, _integrated(t[rows], angles[rows, axis], turned, rate, gain)])

    return _likeliest_factor(t, _spans(t, usable), table)


def _likeliest_factor(
    t: NDArray[np.float64], spans: list[slice], table: Callable[[slice, int, float], NDArray[np.float64]]
) -> tuple[float, float]:
    """Return the first factor of both axes' tables and its standard error, with the likeliest of `WHITENING`.

    `table` gives the columns of a span, an axis (0 or 1) and a gain. With too few rows the factor is nan, and its
    error infinite.
    """
    if sum(len(t[one]) for one in spans) < LEAST_ROWS:
        return math.nan, math.inf
    whole = np.concatenate([t[one] for one in spans])
    found = []
    for gain in WHITENING:
        likelihood, estimates = 0.0, []
        for axis in (0, 1):
            factor, variance, rest = _first_factor([table(one, axis, gain) for one in spans], whole)
            likelihood -= 0.5 * len(whole) * math.log(max(rest, TINY))
            estimates.append((factor, max(variance, TINY)))
        weights = np.array([1.0 / variance for _, variance in estimates])
        factor = float(weights @ [one for one, _ in estimates] / weights.sum())
        found.append((likelihood, factor, float(weights.sum() ** -0.5)))
    _, factor, error = max(found)
    return factor, error


def _spans(t: NDArray[np.float64], usable: NDArray[np.bool_]) -> list[slice]:
    """Return the spans of usable rows, without holes."""
    breaks = np.flatnonzero((np.diff(t) > LONGEST_HOLE) | (np.diff(usable.astype(np.int8)) != 0)) + 1
    edges = [0, *breaks.tolist(), len(t)]
    return [
        slice(first, last)
        for first, last in pairwise(edges)
        if usable[first] and t[last - 1] - t[first] >= LEAST_SPAN
    ]


def _integrated(
    t: NDArray[np.float64],
    angle: NDArray[np.float64],
    turned: NDArray[np.float64],
    rate: NDArray[np.float64],
    gain: float,
) -> NDArray[np.float64]:
    """Return columns (N, 4) of a span, whitened: the yaw's part, time, an offset, and what the gyro leaves."""
    table = np.column_stack([turned, np.ones(len(t)), rate])
    steps = 0.5 * (table[1:] + table[:-1]) * np.diff(t)[:, None]
    summed = np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
    columns = np.column_stack([summed[:, :2], np.ones(len(t)), angle - summed[:, 2]])
    return _whitened(columns, gain)


def _whitened(columns: NDArray[np.float64], gain: float) -> NDArray[np.float64]:
    """Return columns (N, k) of a span less what a random walk in proportion to a gain adds up to."""
    whitened = lfilter([1.0, -1.0], [1.0, gain - 1.0], columns, axis=0) if gain else columns
    return np.asarray(whitened, dtype=np.float64)


def _first_factor(tables: list[NDArray[np.float64]], t: NDArray[np.float64]) -> tuple[float, float, float]:
    """Return the first factor of columns (M, k) [.., offset, explained] of spans, its variance, and what is left."""
    parts = []
    for place, table in enumerate(tables):
        offsets = np.zeros((len(table), len(tables)))
        offsets[:, place] = table[:, -2]
        parts.append(np.column_stack([table[:, :-2], offsets]))
    X, y = np.vstack(parts), np.concatenate([table[:, -1] for table in tables])
    inverse = np.linalg.pinv(X.T @ X)
    factors = inverse @ (X.T @ y)
    left = y - X @ factors
    rest = float(left @ left) / max(len(y) - X.shape[1], 1)
    influence = (X @ inverse[0]) * left
    blocks = np.unique(np.floor(t / CORRELATED), return_inverse=True)[1]
    clustered = float(np.square(np.bincount(blocks, weights=influence)).sum())
    count = int(blocks.max()) + 1
    clustered *= count / max(count - X.shape[1], 1)
    return float(factors[0]), max(rest * float(inverse[0, 0]), clustered), rest


#: the error over the standard error and beyond it, and the largest logarithm of the odds. Of 169 logs of the
#: development halves, of 5 to 60 s, sigma is off by 1.5 standard errors (root mean square), and of none the wrong sign
#: is believed
GYRO_ERRORS, HANDEDNESS_ERROR, MOST_BY_GYRO = 2.0, 0.15, 6.0


def handedness_odds(sigma: float, error: float) -> float:
    """Return the logarithm of the odds for sigma = 1 against -1, given an estimate with its standard error."""
    if not math.isfinite(sigma):
        return 0.0
    # an estimate beyond 1 or -1 shows no more than they do
    shown = min(max(sigma, -1.0), 1.0)
    odds = 2.0 * shown / ((GYRO_ERRORS * error) ** 2 + HANDEDNESS_ERROR**2)
    return min(max(odds, -MOST_BY_GYRO), MOST_BY_GYRO)
