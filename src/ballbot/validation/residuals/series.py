"""Sums over a series that is made of segments, none of which may be joined to the next."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray


def slices(lengths: Sequence[int]) -> Iterator[slice]:
    """Return where each segment lies, given their lengths."""
    end = 0
    for length in lengths:
        yield slice(end, end + length)
        end += length


def autocovariance(values: NDArray[np.float64], segments: Sequence[int], *, lags: int) -> NDArray[np.float64]:
    """Return the autocovariances (lags + 1, k) of columns (n, k) about their means, divided by n at every lag."""
    deviation = values - values.mean(axis=0)
    total = np.zeros((lags + 1, values.shape[1]))
    for where in slices(segments):
        part = deviation[where]
        size = 1 << int(2 * len(part) - 1).bit_length()
        spectrum = np.fft.rfft(part, size, axis=0)
        products = np.fft.irfft(np.abs(spectrum) ** 2, size, axis=0)
        reach = min(lags + 1, len(part))
        total[:reach] += products[:reach]
    return total / len(values)


def lagged(values: NDArray[np.float64], segments: Sequence[int], *, lag: int) -> NDArray[np.float64]:
    """Return each row's value `lag` rows before (n, k), NaN where that lies before its segment."""
    before = np.full_like(values, np.nan)
    for where in slices(segments):
        part = values[where]
        if len(part) > lag:
            before[where.start + lag : where.stop] = part[: len(part) - lag]
    return before


def blocks_of(segments: Sequence[int], *, length: int) -> NDArray[np.int64]:
    """Return which block (n,) of about `length` neighbouring rows each row is in; none is of two segments."""
    numbers, first = [], 0
    for count in segments:
        blocks = max(1, round(count / length))
        numbers.append(first + np.arange(count) * blocks // max(count, 1))
        first += blocks
    return np.concatenate([*numbers, np.empty(0, dtype=np.int64)]).astype(np.int64)


def holm(p_values: NDArray[np.float64], *, level: float) -> NDArray[np.bool_]:
    """Return which of many tests are significant where the chance of any false one is to be `level`; NaN never is.

    S. Holm, Scandinavian Journal of Statistics 6 (1979) 65-70.
    """
    flat = np.ravel(p_values)
    order = np.argsort(flat, kind="stable")  # NaN last
    tested = int(np.isfinite(flat).sum())
    ranked = flat[order][:tested] * np.arange(tested, 0, -1)
    first_kept = int(np.argmax(ranked > level)) if np.any(ranked > level) else tested
    significant = np.zeros(flat.shape, dtype=np.bool_)
    significant[order[:first_kept]] = True
    return significant.reshape(np.shape(p_values))
