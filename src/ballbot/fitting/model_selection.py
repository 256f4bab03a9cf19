"""The gain of a model over one nested within it, on the same held-out windows.

The gain is the relative reduction of the error: one minus the geometric mean over states of the ratios of root mean
square errors. Its interval is from a paired bootstrap: the same blocks of neighbouring windows are drawn for both
models, so that windows that are hard for both do not widen it (H. R. Kuensch, The jackknife and the bootstrap for
general stationary observations, Annals of Statistics 17 (1989) 1217-1241).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ballbot.arrays import Floats, Ints
from ballbot.fitting.uncertainty import block_length, resamples

#: bootstrap draws, and the confidence of the interval
DRAWS, LEVEL = 4000, 0.95
#: a smaller gain is of no use, however significant
USEFUL_GAIN = 0.01
_SEED = 0


@dataclass(frozen=True, kw_only=True)
class Gain:
    """Relative reduction of the held-out error by a model; negative if its error is larger."""

    share: float
    lower: float  #: of the 95 % interval
    upper: float

    @property
    def significant(self) -> bool:
        """Whether the interval is above zero."""
        return self.lower > 0.0

    def with_interval(self) -> dict[str, object]:
        """Return it for results.json, with its ends as an interval."""
        return {"share": self.share, "interval_95": [self.lower, self.upper]}


def gain_between(squares: Floats, others: Floats, groups: Sequence[Ints]) -> Gain:
    """Return the gain of one model over another.

    `squares` and `others` (w, k) are sums of squared errors of each window and state, of this model and of the other;
    `groups` are the windows of each block.
    """
    counts = resamples(len(groups), repeats=DRAWS, seed=_SEED)
    ours, theirs = (np.stack([table[rows].sum(axis=0) for rows in groups]) for table in (squares, others))
    with np.errstate(invalid="ignore"):  # a prediction without a value has no gain
        draws = 1.0 - _error_ratio(counts @ ours, counts @ theirs)
    tail = 0.5 * (1.0 - LEVEL)
    lower, upper = np.quantile(draws, [tail, 1.0 - tail])
    share = 1.0 - _error_ratio(squares.sum(axis=0), others.sum(axis=0))
    return Gain(share=float(share), lower=float(lower), upper=float(upper))


def neighbours(rows: Sequence[int], *, block: int) -> list[Ints]:
    """Return the rows in blocks of `block` neighbours."""
    return [np.array(rows[first : first + block], dtype=np.int64) for first in range(0, len(rows), block)]


#: number of blocks of time
_BLOCKS = 12


def blocks_of(windows: int) -> list[Ints]:
    """Return the windows of each block of time, neighbours that are held out and drawn together."""
    return neighbours(range(windows), block=max(1, min(block_length(windows), windows // _BLOCKS)))


def _error_ratio(squares: Floats, others: Floats) -> Floats:
    """Return the geometric mean over states (..., k) of the ratios of root mean square errors."""
    tiny = np.finfo(float).tiny
    return np.exp(0.5 * np.log((squares + tiny) / (others + tiny)).mean(axis=-1))
