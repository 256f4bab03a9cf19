"""Least squares on a series whose errors go together over time: errors and tests clustered by blocks of time.

The sandwich of K.-Y. Liang and S. Zeger, Biometrika 73 (1986) 13-22: within a block, anything may go together. Of q
parameters, W = p^T V^-1 p is judged as Hotelling's T^2 of G blocks, W (G - q) / (q (G - 1)) ~ F(q, G - q), with G the
blocks in which the least frequent of the q columns is not zero: a rare event is known from few blocks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

#: blocks beyond the parameters tested, below which nothing is told
_LEAST_FREEDOM = 5


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """Parameters (p,) of a straight-line model."""

    values: NDArray[np.float64]
    covariance: NDArray[np.float64]  #: (p, p)
    blocks: NDArray[np.int64]  #: (p,) in which each parameter's column is not zero

    @property
    def half_widths(self) -> NDArray[np.float64]:
        """Of the 95 % intervals (p,)."""
        errors = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        return stats.t.ppf(0.975, np.maximum(self.blocks - 1, 1)) * errors

    def p_value(self, places: Sequence[int]) -> float:
        """Return how likely the parameters at `places` are to be so far from zero by chance, if all are zero.

        NaN where too few blocks are left to tell.
        """
        blocks = int(self.blocks[list(places)].min())
        count, freedom = len(places), blocks - len(places)
        if freedom < _LEAST_FREEDOM:
            return float("nan")
        part, covariance = self.values[list(places)], self.covariance[np.ix_(places, places)]
        wald = float(part @ np.linalg.pinv(covariance, hermitian=True) @ part)
        return float(stats.f.sf(wald * freedom / (count * (blocks - 1)), count, freedom))


def fit(design: NDArray[np.float64], values: NDArray[np.float64], blocks: NDArray[np.int64]) -> Fit:
    """Fit values (n,) by columns (n, p), their errors clustered by `blocks` (n,)."""
    inverse = np.linalg.pinv(design.T @ design, hermitian=True)
    found = inverse @ (design.T @ values)
    _, block = np.unique(blocks, return_inverse=True)
    count = int(block.max()) + 1
    pulls = design * (values - design @ found)[:, None]
    sums = np.array([np.bincount(block, weights=column, minlength=count) for column in pulls.T])
    present = [np.bincount(block, weights=column != 0.0, minlength=count) for column in design.T]
    covariance = inverse @ (sums @ sums.T) @ inverse * count / max(count - 1, 1)
    return Fit(values=found, covariance=covariance, blocks=np.count_nonzero(present, axis=1))


def indicators(places: NDArray[np.int64], count: int) -> NDArray[np.float64]:
    """Return columns (n, count) of ones where a row's place (n,) is the column's, else zeros."""
    return (places[:, None] == np.arange(count)).astype(np.float64)
