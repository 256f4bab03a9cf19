"""Statistics of residuals over time, which depend on each other: correlation, whiteness and spectrum.

A series is made of segments, none of which may be joined to the next.

Correlation (the matrix of Figure 4.3). Two series that remember their past have larger accidental correlations than
white ones. For independent ones (M. Bartlett, Journal of the Royal Statistical Society 98 (1935) 536-543),

    var r = (1 + 2 sum_k rho_1(k) rho_2(k)) / n

so a cell counts as many samples as n over that sum, at most n, and is tested by Student's t. Over all cells, Holm's
correction keeps the chance of any false mark at 5 %.

Whiteness. The test is Ljung and Box's (Biometrika 65 (1978) 297-303) on autocorrelations studentised as by I. Lobato,
J. Nankervis and N. Savin (Journal of Econometrics 100 (2001) 23-38), so that residuals which grow and shrink with the
motion do not look coloured:

    Q = n (n + 2) sum_(j=1..m) r_j^2 / (n - j),      r_j^2 = c_j^2 / mean(e_k^2 e_(k-j)^2)     chi^2 with m if white

A long log rejects whiteness for a memory that does not matter. So the share of a residual's variance that the m
residuals before it predict (Yule and Walker's equations) stands beside the test. One cause lies outside the model:
the noise of a measured state enters two residuals, with opposite signs, which alone makes a correlation of down to
-1/2 from one sample to the next and none beyond.

Spectrum. Hann windows that overlap by half, as P. Welch's (IEEE Transactions on Audio and Electroacoustics 15 (1967)
70-73); of their periodograms the logarithms are averaged, so that a window with more motion has no more weight in the
search for peaks. Of noise, a periodogram's logarithm is the density's less 0.5772, with a variance of pi^2/6 whatever
the density (M. Bartlett and D. Kendall, Supplement to the Journal of the Royal Statistical Society 8 (1946) 128-138); K
windows that overlap count as K / 1.056. So a bin is a peak where it stands above its surroundings by more than chance
does once in a hundred logs, over all bins and states. Its surroundings are the larger of the medians on either side: on
a slope, one of them is above any bin between.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy import linalg, special
from scipy.signal import spectrogram

from ballbot.log.columns import Bools, Floats


def slices(lengths: Sequence[int]) -> Iterator[slice]:
    """Return where each segment lies, given their lengths."""
    end = 0
    for length in lengths:
        yield slice(end, end + length)
        end += length


def autocovariance(values: Floats, segments: Sequence[int], *, lags: int) -> Floats:
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


def lagged(values: Floats, segments: Sequence[int], *, lag: int) -> Floats:
    """Return each row's value `lag` rows before (n, k), NaN if that lies before its segment."""
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


def holm(p_values: Floats, *, level: float) -> Bools:
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


def indicators(places: NDArray[np.int64], count: int) -> Floats:
    """Return columns (n, count) of ones where a row's place (n,) is the column's, else zeros."""
    return (places[:, None] == np.arange(count)).astype(np.float64)


#: chance of any false mark in a matrix without correlation
CORRELATION_LEVEL = 0.05
#: memory is summed up to this share of the series
_REACH = 0.2
#: fewer samples that count than this do not make a cell
_LEAST_COUNT = 10.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Correlations:
    """The correlation matrix of residuals and torques, (m, m), m = 10 + n; 13 by 13 for three wheels."""

    labels: tuple[str, ...]
    matrix: Floats
    counts: Floats  #: samples that each cell counts, for its memory
    significant: Bools  #: off the diagonal

    def between(self, first: str, second: str) -> tuple[float, bool]:
        """Return the correlation of two labels and whether it is significant."""
        cell = self.labels.index(first), self.labels.index(second)
        return float(self.matrix[cell]), bool(self.significant[cell])


def correlations(columns: Floats, labels: tuple[str, ...], segments: Sequence[int]) -> Correlations:
    """Return the correlations of columns (n, m) made of `segments`, each pair of them tested."""
    matrix, counts = correlation_of(columns), effective_counts(columns, segments)
    pairs = np.triu_indices(len(matrix), 1)
    r, count = matrix[pairs], counts[pairs]
    t = r * np.sqrt(np.maximum(count - 2.0, 0.0) / np.maximum(1.0 - r**2, 1e-15))
    p = 2.0 * special.stdtr(np.maximum(count - 2.0, 1.0), -np.abs(t))
    p[count < _LEAST_COUNT] = np.nan
    significant = np.zeros(matrix.shape, dtype=np.bool_)
    significant[pairs] = holm(p, level=CORRELATION_LEVEL)
    return Correlations(labels=labels, matrix=matrix, counts=counts, significant=significant | significant.T)


def correlation_of(columns: Floats) -> Floats:
    """Return the correlation matrix of the columns; a constant column has none with others, and one with itself."""
    deviation = columns - columns.mean(axis=0)
    size = np.linalg.norm(deviation, axis=0)
    scaled = deviation / np.where(size > 0.0, size, 1.0)
    correlation = scaled.T @ scaled
    np.fill_diagonal(correlation, 1.0)
    return correlation


def effective_counts(columns: Floats, segments: Sequence[int]) -> Floats:
    """Return how many independent samples each pair of columns counts (m, m), if the two are independent."""
    count = len(columns)
    lags = int(min(max(segments) - 1, _REACH * count))
    covariances = autocovariance(columns, segments, lags=lags)
    memory = covariances / np.where(covariances[0] > 0.0, covariances[0], 1.0)
    return count / np.maximum(1.0 + 2.0 * memory[1:].T @ memory[1:], 1.0)


#: how many lags are looked at
LAGS = 20
#: chance that any of a white log's states is called coloured
WHITENESS_LEVEL = 0.05
#: fewer steps are too few for the test
LEAST_STEPS = 25 * LAGS
#: a predicted share of the variance below this does not matter
_NEGLIGIBLE = 0.02
#: noise of the start: so much at one sample, so little beyond
_OF_NOISE, _BEYOND = -0.2, 0.1

Colour = Literal["white", "nearly white", "noise of the start", "coloured"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Whiteness:
    """Of each column of residuals (k,)."""

    autocorrelation: Floats  #: (LAGS + 1, k)
    p_value: Floats  #: of the column alone
    rejected: Bools  #: with Holm's correction over the columns
    predicted_share: Floats  #: share of the variance that the residuals before predict

    @property
    def colours(self) -> tuple[Colour, ...]:
        """What each column is."""
        return tuple(self._colour(place) for place in range(len(self.rejected)))

    def _colour(self, place: int) -> Colour:
        memory = self.autocorrelation[1:, place]
        if not self.rejected[place]:
            return "white"
        if self.predicted_share[place] < _NEGLIGIBLE:
            return "nearly white"
        if memory[0] < _OF_NOISE and np.abs(memory[1:]).max() < _BEYOND:
            return "noise of the start"
        return "coloured"


def whiteness(residuals: Floats, segments: Sequence[int]) -> Whiteness | None:
    """Test residuals (n, k) made of `segments`, or return None if there are fewer than `LEAST_STEPS`."""
    count = len(residuals)
    if count < LEAST_STEPS:
        return None
    covariance = autocovariance(residuals, segments, lags=LAGS)
    variance = np.where(covariance[0] > 0.0, covariance[0], 1.0)
    squares = (residuals - residuals.mean(axis=0)) ** 2
    statistic = np.zeros(residuals.shape[1])
    for lag in range(1, LAGS + 1):
        together = np.nanmean(squares * lagged(squares, segments, lag=lag), axis=0)
        scale = np.where(together > 0.0, together, 1.0)
        statistic += (count + 2.0) / (count - lag) * count * covariance[lag] ** 2 / scale
    p_value = special.chdtrc(LAGS, statistic)
    return Whiteness(
        autocorrelation=covariance / variance,
        p_value=p_value,
        rejected=holm(p_value, level=WHITENESS_LEVEL),
        predicted_share=np.array([_predicted_share(column) for column in (covariance / variance).T]),
    )


def _predicted_share(memory: Floats) -> float:
    """Return the share of a series' variance that as many past values as there are lags predict."""
    if memory[0] <= 0.0:
        return 0.0
    past = linalg.solve_toeplitz((memory[:-1] + np.eye(len(memory) - 1)[0] * 1e-9), memory[1:])
    return float(np.clip(past @ memory[1:], 0.0, 1.0))


#: length of a window [s] if the log allows it; its resolution is 1.5 over its length
_WINDOW = 2.56
_LEAST_WINDOWS = 8
#: a window of fewer rows resolves no frequencies
_LEAST_ROWS = 64
#: chance of any false peak in a log
PEAK_LEVEL = 0.01
#: bins of a side's surroundings, and the bins next to the peak that are left out for its own width
_SIDE, _GUARD = 14, 4
#: bins below this are the motion itself
_LOWEST = _GUARD + 2
#: a peak is at least so many times its surroundings
_LEAST_RATIO = 1.5


@dataclass(frozen=True, kw_only=True)
class Peak:
    """A frequency at which a state's residual has more power than around it."""

    state: int
    frequency: float  #: [Hz]
    ratio: float  #: density over that of its surroundings


@dataclass(frozen=True, kw_only=True)
class Spectrum:
    """What stands out of the power spectral densities of residuals."""

    resolution: float  #: [Hz] peaks nearer than this are one
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
    # the mean of a logarithm over noise is that of the density's but for a constant
    logs = np.log(np.concatenate(powers, axis=2) + np.finfo(float).tiny).mean(axis=2)
    frequencies = np.fft.rfftfreq(rows, sample_time).astype(np.float64)
    return Spectrum(resolution=1.5 * rate / rows, peaks=_peaks(frequencies, logs, windows))


def _peaks(frequencies: Floats, logs: Floats, windows: int) -> tuple[Peak, ...]:
    above = logs - _surroundings(logs)
    error = np.pi / np.sqrt(6.0) * np.sqrt(1.056 / windows)
    limit = max(np.log(_LEAST_RATIO), -special.ndtri(PEAK_LEVEL / logs.size) * error)
    found = []
    for state, place in np.argwhere(limit < above.T):
        near = logs[max(0, place - _GUARD) : place + _GUARD + 1, state]
        if logs[place, state] == near.max():
            ratio = float(np.exp(above[place, state]))
            found.append(Peak(state=int(state), frequency=float(frequencies[place]), ratio=ratio))
    return tuple(found)


def _surroundings(logs: Floats) -> Floats:
    """Return each bin's surroundings (f, k); NaN at the lowest frequencies, where the motion itself is."""
    # a spectrum is symmetric about zero and about half the sampling rate, which makes both sides whole
    far = _GUARD + _SIDE
    near = sliding_window_view(np.pad(logs, ((far, far), (0, 0)), mode="reflect"), 2 * far + 1, axis=0)
    around = np.maximum(np.median(near[..., :_SIDE], axis=-1), np.median(near[..., -_SIDE:], axis=-1))
    around[:_LOWEST] = np.nan
    return around
