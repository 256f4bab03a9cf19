"""Which residuals and torques go together: the correlation matrix of Figure 4.3, its significant cells marked.

Two series that remember their past agree by chance more than white ones do. For independent ones (M. Bartlett, Journal
of the Royal Statistical Society 98 (1935) 536-543),

    var r = (1 + 2 sum_k rho_1(k) rho_2(k)) / n

so a cell counts as many samples as n over that sum, at most n, and is tested by Student's t. Over all cells, Holm's
correction keeps the chance of any false mark at 5 %.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from ballbot.validation.residuals.series import autocovariance, holm

#: chance of any false mark in a matrix without correlation
LEVEL = 0.05
#: memory is summed up to this share of the series
_REACH = 0.2
#: fewer samples that count than this do not make a cell
_LEAST_COUNT = 10.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Correlations:
    """The correlation matrix of residuals and torques, (m, m), m = 10 + n; 13 by 13 for three wheels."""

    labels: tuple[str, ...]
    matrix: NDArray[np.float64]
    counts: NDArray[np.float64]  #: samples that each cell counts, for its memory
    significant: NDArray[np.bool_]  #: off the diagonal

    def between(self, first: str, second: str) -> tuple[float, bool]:
        """Return the correlation of two labels and whether it is significant."""
        cell = self.labels.index(first), self.labels.index(second)
        return float(self.matrix[cell]), bool(self.significant[cell])


def correlations(
    columns: NDArray[np.float64], labels: tuple[str, ...], segments: Sequence[int]
) -> Correlations:
    """Return the correlations of columns (n, m) made of `segments`, each pair of them tested."""
    matrix, counts = correlation_of(columns), effective_counts(columns, segments)
    pairs = np.triu_indices(len(matrix), 1)
    r, count = matrix[pairs], counts[pairs]
    t = r * np.sqrt(np.maximum(count - 2.0, 0.0) / np.maximum(1.0 - r**2, 1e-15))
    p = 2.0 * stats.t.sf(np.abs(t), np.maximum(count - 2.0, 1.0))
    p[count < _LEAST_COUNT] = np.nan
    significant = np.zeros(matrix.shape, dtype=np.bool_)
    significant[pairs] = holm(p, level=LEVEL)
    return Correlations(labels=labels, matrix=matrix, counts=counts, significant=significant | significant.T)


def correlation_of(columns: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the correlation matrix of the columns; a constant column has none with others, and one with itself."""
    deviation = columns - columns.mean(axis=0)
    size = np.linalg.norm(deviation, axis=0)
    scaled = deviation / np.where(size > 0.0, size, 1.0)
    correlation = scaled.T @ scaled
    np.fill_diagonal(correlation, 1.0)
    return correlation


def effective_counts(columns: NDArray[np.float64], segments: Sequence[int]) -> NDArray[np.float64]:
    """Return how many independent samples each pair of columns counts (m, m), if the two are independent."""
    count = len(columns)
    lags = int(min(max(segments) - 1, _REACH * count))
    covariances = autocovariance(columns, segments, lags=lags)
    memory = covariances / np.where(covariances[0] > 0.0, covariances[0], 1.0)
    return count / np.maximum(1.0 + 2.0 * memory[1:].T @ memory[1:], 1.0)
