"""When a row's encoders were really read, from the encoders themselves.

A host that logs the latest message writes its own clock beside angles that were read up to one message earlier. Every
wheel of a row then lies off its smooth course by (wheel speed) x (one and the same time), so that the time is

    e = sum_i w_i r_i / (sum_i w_i^2 + (s / a)^2)

with w_i the smooth speeds, r_i angles minus smooth angles, s the angles' own noise, and a the usual size of e: least
squares with the prior that e is of size a, under which slow wheels leave the time alone. A few rounds of fit and
correction settle it. (Fixed intervals between messages need not be known, and messages that come early or late are
repaired as well.)
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.log.signals import local_fit

#: a, the usual error of a row's time [s]: messages come every 5 ms, or 10
SPREAD = 2e-3
#: s, the angles' noise [rad]: encoders of some thousand counts a turn, and what a smooth course leaves
ANGLE_NOISE = 6e-4
#: the smooth course looks this far to each side [s]
REACH = 0.06
#: the shortest usual interval between rows [s]: 10 kHz
SHORTEST = 1e-4
ROUNDS = 6
#: wheels must turn this fast [rad/s], root of the sum of squares, for their noise to be judged
FAST = 3.0
#: and at so many rows
FEWEST_FAST = 50
#: rows closer together than this part of the median interval are one message logged twice
REPEATED = 0.2


def sampling_times(t: NDArray[np.float64], angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the times at which the rows' angles were read, up to a constant.

    Parameters
    ----------
    t : ndarray (N,)
        The rows' own times [s], rising.
    angles : ndarray (N, n)
        Wheel angles [rad], finite, two wheels or more.

    Returns
    -------
    ndarray (N,)
        Not falling; equal for rows that hold the same message.
    """
    rows = _rows(t)
    times = t.copy()
    for _ in range(ROUNDS):
        smooth, speeds = local_fit(times, angles, rows=rows)
        size = (speeds**2).sum(axis=1) + (ANGLE_NOISE / SPREAD) ** 2
        times = times + (speeds * (angles - smooth)).sum(axis=1) / size
        times = np.maximum.accumulate(times)
    return times


def new_messages(times: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which rows (N,) hold a message that the row before did not."""
    least = REPEATED * float(np.median(np.diff(times)))
    kept = np.ones(len(times), dtype=np.bool_)
    last = times[0]
    for row in range(1, len(times)):
        kept[row] = times[row] - last > least
        last = times[row] if kept[row] else last
    return kept


def speed_noise(
    t: NDArray[np.float64], angles: NDArray[np.float64], times: NDArray[np.float64] | None = None
) -> float | None:
    """Return the noise [rad/s] of speeds from one row to the next, while the wheels turn fast.

    Parameters
    ----------
    t, angles : ndarray (N,), (N, n)
        As for `sampling_times`.
    times : ndarray (N,), optional
        In place of t: what `sampling_times` gave.

    Returns
    -------
    float or None
        Root mean square, over rows and wheels, of speeds minus smooth speeds; None where too few rows are fast.
    """
    noise = _noise(t if times is None else times, angles, rows=_rows(t))
    return None if noise is None else float(np.sqrt((noise**2).mean()))


def repaired_noise(t: NDArray[np.float64], angles: NDArray[np.float64]) -> float | None:
    """Return `speed_noise` after the repair, each wheel judged by the times that the other wheels gave.

    A wheel that helps to find the times is flattered by them; this one is not.
    """
    squares = []
    for wheel in range(angles.shape[1]):
        times = sampling_times(t, np.delete(angles, wheel, axis=1))
        noise = _noise(times, angles, rows=_rows(t))
        if noise is None:
            return None
        squares.append((noise[:, wheel] ** 2).mean())
    return float(np.sqrt(np.mean(squares)))


def _noise(
    times: NDArray[np.float64], angles: NDArray[np.float64], *, rows: int
) -> NDArray[np.float64] | None:
    """Return speeds between rows minus smooth speeds (K, n) where the wheels turn fast."""
    kept = new_messages(times)
    times, angles = times[kept], angles[kept]
    _, speeds = local_fit(times, angles, rows=rows)
    between = 0.5 * (speeds[1:] + speeds[:-1])
    noise = np.diff(angles, axis=0) / np.diff(times)[:, None] - between
    judged = np.sqrt((between**2).sum(axis=1)) > FAST
    judged[:rows] = judged[-rows:] = False  # the fit has one side only there
    return noise[judged] if judged.sum() >= FEWEST_FAST else None


def _rows(t: NDArray[np.float64]) -> int:
    """Return how many rows the smooth course takes on each side; refuse intervals that no encoder has."""
    usual = float(np.median(np.diff(t))) if len(t) > 1 else REACH
    if usual < SHORTEST:
        raise InputError(
            f"Rows come every {usual:.3g} s, and repair needs at least {SHORTEST:g} "
            "s between rows; correct the unit of t, which must be in seconds."
        )
    return max(4, round(REACH / usual))
