"""Motion as increments over windows: encoder angles against integrals of rates and sums of small turns.

Increments need no derivative of an encoder, so that counts, sampling jitter and glitches of logged speeds do not
matter, and the noise of a rate averages out over the window.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.log import Log
from ballbot.log.columns import wheel_angle_names

#: windows on end that count as one cluster together last this long [s]: a roller takes about as long to pass
CLUSTER = 2.0
#: a sampling interval longer than this many usual ones is a gap
LARGEST_GAP = 1.5


@dataclass(frozen=True, kw_only=True, eq=False)
class Cuts:
    """Where a log's windows begin and end: w rows of it, and their clusters."""

    first: NDArray[np.int64]  #: (w,)
    last: NDArray[np.int64]  #: (w,)
    clusters: NDArray[np.int64]  #: (w,)

    def __len__(self) -> int:
        return len(self.first)

    def of(self, total: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the increments (w, k) of a running total (N, k)."""
        return total[self.last] - total[self.first]

    def chosen(self, which: NDArray[np.bool_]) -> Cuts:
        """Return the windows that `which` (w,) marks."""
        return Cuts(first=self.first[which], last=self.last[which], clusters=self.clusters[which])


def cut(log: Log, columns: NDArray[np.float64], *, window: float) -> Cuts:
    """Return the windows, end to end, in which no row of `columns` (N, k) is missing and no row left out.

    Raises
    ------
    InputError
        Where a window is less than two samples.
    """
    samples = round(window / log.sample_time)
    if samples < 2:
        raise InputError(
            f"The log's sample time of {log.sample_time:g} s is too long for windows of {window:g} s."
        )
    first = np.arange(0, len(log.t) - samples, samples)
    whole = np.asarray(np.isfinite(columns).all(axis=1))
    follows = whole[1:] & whole[:-1] & (np.diff(log.t) < LARGEST_GAP * log.sample_time)
    broken = np.concatenate([[0], np.cumsum(~follows)])
    usable = first[broken[first + samples] == broken[first]]
    clusters = np.floor((log.t[usable] - log.t[0]) / CLUSTER).astype(np.int64)
    return Cuts(first=usable, last=usable + samples, clusters=clusters)


def wheel_angles(log: Log, wheel_count: int) -> NDArray[np.float64]:
    """Return the encoders' angles (N, n) [rad].

    Raises
    ------
    InputError
        Where one is not in the log.
    """
    return np.column_stack([log[name] for name in wheel_angle_names(wheel_count)])


def mean_about(
    at: NDArray[np.float64], t: NDArray[np.float64], total: NDArray[np.float64], *, width: float
) -> NDArray[np.float64]:
    """Return the means (k, c) of a total (N, c) with times (N,), over `width` [s] about the times `at` (k,).

    A value between two noisy samples is their mean, and has less noise than either: who seeks a time offset by least
    squares is drawn to such places. Over several samples the noise is the same everywhere.
    """
    twice = integral(t, total)
    ends = [
        np.column_stack([np.interp(at + half, t, column) for column in twice.T])
        for half in (-0.5 * width, 0.5 * width)
    ]
    return (ends[1] - ends[0]) / width


def integral(t: NDArray[np.float64], rates: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the running integral (N, k) of rates (N, k) by the trapezium rule; a missing rate counts as zero."""
    rates = np.nan_to_num(rates)
    steps = 0.5 * (rates[1:] + rates[:-1]) * np.diff(t)[:, None]
    return np.concatenate([np.zeros((1, rates.shape[1])), np.cumsum(steps, axis=0)])
