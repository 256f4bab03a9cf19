"""Moving blocks: drawing again from things that stand side by side in time and are not independent.

Neighbours share what came between them, so blocks of neighbours are drawn, with replacement, until there are as many as
before (H. Kuensch, Annals of Statistics 17 (1989) 1217-1241; taken round the end, D. Politis and J. Romano 1992).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def block_length(count: int) -> int:
    """Return how many of `count` neighbours make a block: the cube root of their number, as a variance wants it.

    P. Hall, J. Horowitz and B.-Y. Jing, Biometrika 82 (1995) 561-574.
    """
    return max(1, round(count ** (1.0 / 3.0)))


def resamples(count: int, *, block: int, repeats: int, seed: int) -> NDArray[np.float64]:
    """Return how often each of `count` neighbours is drawn in each of the repeats, (repeats, count)."""
    starts = np.random.default_rng(seed).integers(count, size=(repeats, -(-count // block)))
    rows = ((starts[:, :, None] + np.arange(block)) % count).reshape(repeats, -1)[:, :count]
    drawn = np.zeros((repeats, count))
    np.add.at(drawn, (np.arange(repeats)[:, None], rows), 1.0)
    return drawn


def resampled_means(
    values: NDArray[np.float64], *, block: int, repeats: int, seed: int
) -> NDArray[np.float64]:
    """Return the column means (repeats, k) of rows drawn anew from `values` (n, k), whole blocks at a time."""
    count, blocks = len(values), -(-len(values) // block)
    ends = np.cumsum(np.vstack([np.zeros_like(values[:1]), values, values[: block - 1]]), axis=0)
    sums = ends[block:] - ends[:-block]
    starts = np.random.default_rng(seed).integers(count, size=(repeats, blocks))
    return np.array([sums[drawn].sum(axis=0) for drawn in starts]) / (blocks * block)
