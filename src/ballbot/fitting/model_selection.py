"""By how much a model predicts better than another one within it, on the same windows held out.

The gain is the share by which its error is smaller: one less the geometric mean over states of the ratios of root mean
square errors. Its interval is that of a paired bootstrap: blocks of neighbouring windows are drawn anew, the same for
both models, so that what both find hard does not widen it (H. R. Kuensch, The jackknife and the bootstrap for general
stationary observations, Annals of Statistics 17 (1989) 1217-1241).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.fitting.uncertainty import resamples

#: bootstrap draws of a gain, and the confidence of its interval
DRAWS, LEVEL = 4000, 0.95
#: a gain below this is of no use, whatever its significance
USEFUL_GAIN = 0.01
_SEED = 0


@dataclass(frozen=True, kw_only=True)
class Gain:
    """By which share a model's held-out error is below another's; negative if it is above."""

    share: float
    lower: float  #: of the 95 % interval
    upper: float

    @property
    def significant(self) -> bool:
        """Whether the whole interval is above zero."""
        return self.lower > 0.0

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        return {"share": self.share, "interval_95": [self.lower, self.upper]}


def gain_between(
    squares: NDArray[np.float64], others: NDArray[np.float64], groups: Sequence[NDArray[np.int64]]
) -> Gain:
    """Return the gain of one model over another.

    Parameters
    ----------
    squares, others : ndarray (w, k)
        Sums of squared errors of each window and state, of the one and of the other.
    groups : sequence of ndarray
        Which windows are drawn together.
    """
    counts = resamples(len(groups), block=1, repeats=DRAWS, seed=_SEED)
    ours, theirs = (np.stack([table[rows].sum(axis=0) for rows in groups]) for table in (squares, others))
    with np.errstate(invalid="ignore"):  # predictions without a value have no gain
        draws = 1.0 - _error_ratio(counts @ ours, counts @ theirs)
    tail = 0.5 * (1.0 - LEVEL)
    lower, upper = np.quantile(draws, [tail, 1.0 - tail])
    share = 1.0 - _error_ratio(squares.sum(axis=0), others.sum(axis=0))
    return Gain(share=float(share), lower=float(lower), upper=float(upper))


def neighbours(rows: Sequence[int], *, block: int) -> list[NDArray[np.int64]]:
    """Return the numbers of windows that follow one another, `block` of them at a time."""
    return [np.array(rows[first : first + block], dtype=np.int64) for first in range(0, len(rows), block)]


def _error_ratio(squares: NDArray[np.float64], others: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the geometric mean over states (..., k) of the ratios of root mean square errors."""
    tiny = np.finfo(float).tiny
    return np.exp(0.5 * np.log((squares + tiny) / (others + tiny)).mean(axis=-1))
