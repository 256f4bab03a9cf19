"""The pieces that a cost and its derivatives are computed in, over threads or a cluster.

A piece is some sets of parameters on some windows; the problem fixes which, and sums are taken in the pieces' order.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ballbot.identification.prediction import Predictor
from ballbot.identification.spread import Spread
from ballbot.identification.windows import Windows

#: of a piece; derivatives take all sets at once
WINDOWS, SETS = 64, 4


@dataclass(frozen=True, kw_only=True, eq=False)
class Work:
    """What all pieces need."""

    predictor: Predictor
    windows: Windows

    def residuals(self, values: NDArray[np.float64], rows: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the residuals (sets, rows, k, 10) at the k times of comparison, in this thread."""
        alone = replace(self.predictor, threads=1)
        windows = self.windows.take(rows)
        return alone.residuals(values, windows, every=windows.comparison_interval)

    @property
    def rows(self) -> list[NDArray[np.int64]]:
        """The windows' numbers, piece by piece."""
        count = len(self.windows)
        return [np.arange(first, min(first + WINDOWS, count)) for first in range(0, count, WINDOWS)]


def square_sums(work: Work, values: NDArray[np.float64], spread: Spread) -> NDArray[np.float64]:
    """Return the residuals' sums of squares (sets, 10) over windows and times of comparison, from values (sets, p)."""
    groups = [slice(first, first + SETS) for first in range(0, len(values), SETS)]
    pieces = [(group, rows) for group in groups for rows in work.rows]
    found = spread(_squares, work, [(values[group], rows) for group, rows in pieces])
    sums = np.zeros((len(values), 10))
    for (group, _), part in zip(pieces, found, strict=True):
        sums[group] += part
    return sums


@dataclass(frozen=True, kw_only=True, eq=False)
class Differences:
    """Values about a point, and what turns residuals there into a weighted Jacobian."""

    values: NDArray[np.float64]  #: (1 + 2 m, p): the point, m of them forward of it, m backward
    distance: NDArray[np.float64]  #: (m,), from backward to forward, scaled
    weight: NDArray[np.float64]  #: (10,), of each state's residuals


def normal_equations(
    work: Work, differences: Differences, spread: Spread
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return J^T J (m, m) and, for each window, J^T r (w, m)."""
    found = spread(_products, work, [(differences, rows) for rows in work.rows])
    matrix = np.zeros((len(differences.distance),) * 2)
    for part, _ in found:
        matrix += part
    return matrix, np.concatenate([scores for _, scores in found])


def _squares(work: Work, piece: tuple[NDArray[np.float64], NDArray[np.int64]]) -> NDArray[np.float64]:
    return (work.residuals(*piece) ** 2).sum(axis=(1, 2))


def _products(
    work: Work, piece: tuple[Differences, NDArray[np.int64]]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    about, rows = piece
    residuals = work.residuals(about.values, rows) * about.weight
    residuals = residuals.reshape(len(about.values), len(rows), -1)
    m = len(about.distance)
    J = (residuals[1 : 1 + m] - residuals[1 + m :]) / about.distance[:, None, None]
    # einsum and not BLAS, whose order of summation depends on its threads
    matrix = np.einsum("iwk,jwk->ij", J, J, optimize=False)
    return matrix, np.einsum("iwk,wk->wi", J, residuals[0], optimize=False)
