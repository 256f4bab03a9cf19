"""Statistics of correlated residuals: correlation and spectrum.

A series consists of segments, which must not be joined across their gaps.

Correlation (the matrix of Figure 4.3). Each r is tested by Student's t with its effective sample size
(`ballbot.log.evidence.effective_counts`). Holm's correction over all cells keeps the probability of any false mark at
5 %.

Spectrum. Hann windows that overlap by half, as P. Welch's (IEEE Transactions on Audio and Electroacoustics 15 (1967)
70-73); the logarithms of their periodograms are averaged, so that windows with more motion have no more weight in the
search for peaks. The logarithm of noise's periodogram is that of the density less 0.5772, with a variance of pi^2/6
whatever the density (M. Bartlett and D. Kendall, Supplement to the Journal of the Royal Statistical Society 8 (1946)
128-138); K overlapping windows count as K / 1.056. A bin is a peak if it exceeds its surroundings by more than chance
does in one of a hundred logs, over all bins and states. The surroundings are the larger of the medians on either side:
on a slope one of them exceeds the bins between.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy import special
from scipy.signal import spectrogram

from ballbot.arrays import Bools, Floats, Ints
from ballbot.log.evidence import chance_of, effective_counts, slices


def lagged(values: Floats, segments: Sequence[int], *, lag: int) -> Floats:
    """Return values (n, k) delayed by `lag` rows, NaN if that row is before the segment."""
    before = np.full_like(values, np.nan)
    for where in slices(segments):
        part = values[where]
        if len(part) > lag:
            before[where.start + lag : where.stop] = part[: len(part) - lag]
    return before


def blocks_of(segments: Sequence[int], *, length: int) -> Ints:
    """Return the number (n,) of each row's block of about `length` neighbouring rows within its segment."""
    numbers, first = [], 0
    for count in segments:
        blocks = max(1, round(count / length))
        numbers.append(first + np.arange(count) * blocks // max(count, 1))
        first += blocks
    return np.concatenate([*numbers, np.empty(0, dtype=np.int64)]).astype(np.int64)


def holm(p_values: Floats, *, level: float) -> Bools:
    """Return which of many tests are significant at a familywise error rate of `level`; NaN is never significant.

    S. Holm, Scandinavian Journal of Statistics 6 (1979) 65-70.
    """
    flat = np.ravel(p_values)
    order = np.argsort(flat, kind="stable")  # NaN last
    tested = int(np.isfinite(flat).sum())
    ranked = flat[order][:tested] * np.arange(tested, 0, -1)
    first_kept = int(np.argmax(ranked > level)) if np.any(ranked > level) else tested
    significant = np.zeros(np.shape(p_values), dtype=np.bool_)
    significant.flat[order[:first_kept]] = True
    return significant


#: probability of any false mark in a matrix without correlation
CORRELATION_LEVEL = 0.05
#: a cell with a smaller effective sample size is not tested
_LEAST_COUNT = 10.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Correlations:
    """The correlation matrix of residuals and torques, (m, m), m = 10 + n; 13 by 13 for three wheels."""

    labels: tuple[str, ...]
    matrix: Floats
    counts: Floats  #: effective sample size of each cell
    significant: Bools  #: off the diagonal

    def between(self, first: str, second: str) -> tuple[float, bool]:
        """Return the correlation of two labels and whether it is significant."""
        cell = self.labels.index(first), self.labels.index(second)
        return float(self.matrix[cell]), bool(self.significant[cell])


def correlations(columns: Floats, labels: tuple[str, ...], segments: Sequence[int]) -> Correlations:
    """Return the tested correlations of columns (n, m) made of `segments`; zero of a constant column with others."""
    deviation = columns - columns.mean(axis=0)
    size = np.linalg.norm(deviation, axis=0)
    scaled = deviation / np.where(size > 0.0, size, 1.0)
    matrix = scaled.T @ scaled
    np.fill_diagonal(matrix, 1.0)
    counts = effective_counts(columns, segments)
    pairs = np.triu_indices(len(matrix), 1)
    count = counts[pairs]
    p = 2.0 * chance_of(matrix[pairs], count)
    p[count < _LEAST_COUNT] = np.nan
    significant = np.zeros(matrix.shape, dtype=np.bool_)
    significant[pairs] = holm(p, level=CORRELATION_LEVEL)
    return Correlations(labels=labels, matrix=matrix, counts=counts, significant=significant | significant.T)


#: length of a window [s] if the log is long enough; its resolution is 1.5 over its length
_WINDOW = 2.56
_LEAST_WINDOWS = 8
#: fewest rows of a window
_LEAST_ROWS = 64
#: probability of any false peak in a log
PEAK_LEVEL = 0.01
#: bins of the surroundings on each side, and bins next to the peak that are excluded for its width
_SIDE, _GUARD = 14, 4
#: lower bins contain the motion itself
_LOWEST = _GUARD + 2
#: smallest ratio of a peak to its surroundings
_LEAST_RATIO = 1.5


@dataclass(frozen=True, kw_only=True)
class Peak:
    """A frequency at which a state's residual has more power than around it."""

    state: int
    frequency: float  #: [Hz]
    ratio: float  #: density over that of its surroundings


@dataclass(frozen=True, kw_only=True)
class Spectrum:
    """Peaks of the power spectral densities of residuals."""

    resolution: float  #: [Hz] closer peaks are one
    peaks: tuple[Peak, ...]  #: by state and frequency


def spectrum(residuals: Floats, segments: Sequence[int], *, sample_time: float) -> Spectrum | None:
    """Return the spectrum of columns (n, k) made of `segments`, or None if too few windows fit."""
    rate = 1.0 / sample_time
    rows = min(round(_WINDOW * rate), 2 * sum(segments) // (_LEAST_WINDOWS + 1), max(segments))
    rows -= rows % 2
    fitting = [where for where in slices(segments) if where.stop - where.start >= rows]
    windows = sum(1 + 2 * (where.stop - where.start - rows) // rows for where in fitting)
    if rows < _LEAST_ROWS or windows < _LEAST_WINDOWS:
        return None
    powers = [
        spectrogram(residuals[where], rate, "hann", rows, rows // 2, detrend="linear", axis=0)[2]
        for where in fitting
    ]
    # the mean logarithm over windows is the logarithm of the density, but for a constant
    logs = np.log(np.concatenate(powers, axis=2) + np.finfo(float).tiny).mean(axis=2)
    frequencies = np.fft.rfftfreq(rows, sample_time).astype(np.float64)
    return Spectrum(resolution=1.5 * rate / rows, peaks=_peaks(frequencies, logs, windows))


def _peaks(frequencies: Floats, logs: Floats, windows: int) -> tuple[Peak, ...]:
    # a spectrum is symmetric about zero and about half the sampling rate: reflection completes both sides
    far = _GUARD + _SIDE
    near = sliding_window_view(np.pad(logs, ((far, far), (0, 0)), mode="reflect"), 2 * far + 1, axis=0)
    around = np.maximum(np.median(near[..., :_SIDE], axis=-1), np.median(near[..., -_SIDE:], axis=-1))
    around[:_LOWEST] = np.nan
    above = logs - around
    error = np.pi / np.sqrt(6.0) * np.sqrt(1.056 / windows)
    limit = max(np.log(_LEAST_RATIO), -special.ndtri(PEAK_LEVEL / logs.size) * error)
    peaks = []
    for state, index in np.argwhere(limit < above.T):
        near = logs[max(0, index - _GUARD) : index + _GUARD + 1, state]
        if logs[index, state] == near.max():
            ratio = float(np.exp(above[index, state]))
            peaks.append(Peak(state=int(state), frequency=float(frequencies[index]), ratio=ratio))
    return tuple(peaks)
