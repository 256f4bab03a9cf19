"""How clear a comparison is, judged by blocks of a log: neighbouring rows are not independent, blocks nearly are."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Number = TypeVar("Number", np.float64, np.complex128)


def block_sums(values: NDArray[np.float64], block: NDArray[np.intp]) -> NDArray[np.float64]:
    """Return the sums (B,) over blocks of values (N,)."""
    return np.asarray(np.bincount(block, weights=values), dtype=np.float64)


def clarity(advantage: NDArray[np.float64]) -> float:
    """Return the mean over its standard error of what one explanation gains on another in each block (B,)."""
    spread = float(advantage.std(ddof=1)) if len(advantage) > 1 else 0.0
    mean = float(advantage.mean())
    if spread == 0.0:
        return float(np.copysign(np.inf, mean)) if mean else 0.0
    return mean / (spread / np.sqrt(len(advantage)))


def without(columns: NDArray[Number], values: NDArray[Number]) -> NDArray[Number]:
    """Return values (N,) or (N, c) less their least-squares fit by columns (N, m)."""
    fit = columns @ np.linalg.lstsq(columns, values, rcond=None)[0]
    return (values - fit).astype(values.dtype)
