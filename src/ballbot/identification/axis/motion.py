"""Speed and acceleration of an axis from its position.

Without delay: a Butterworth filter run forwards and backwards, central differences twice, and every column of a
regression through the same decimation: A. Janot, M. Gautier and M. Brunot, Data set and reference models of EMPS,
Nonlinear System Identification Benchmarks, Eindhoven 2019, and M. Gautier, Dynamic identification of robots with power
model, ICRA 1997. Filter lengths at the ends and the first row kept are MATLAB's (`filtfilt`, `decimate`), on which the
last digits of the published numbers depend.

Rows at uneven times are interpolated to even ones by a cubic spline in each part between gaps, and the result back.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from ballbot.errors import InputError
from ballbot.identification.axis.record import AxisRecord

_BUTTERWORTH_ORDER = 4
_DECIMATION_ORDER, _DECIMATION_RIPPLE = 8, 0.05  # ripple in dB
#: the filter passes so many times the motion's bandwidth, decimation keeps twice it
_FILTER_RATIO, _DECIMATION_RATIO = 5.0, 2.0
#: largest bandwidth assumed for a motion; faster axes are rare [Hz]
LARGEST_BANDWIDTH = 20.0
_START_ROWS = 15
#: a part between gaps with fewer rows is not used
LEAST_SEGMENT = 30
#: decimated rows next to either end of a part that the filters disturb, but at most this share of it at either end
_DISTURBED, _MOST_DISTURBED = 5, 0.2


@dataclass(frozen=True, eq=False)
class Motion:
    """The motion of the axis, without noise above the filter's frequency."""

    position: NDArray[np.float64]  #: (N,) [m]
    speed: NDArray[np.float64]  #: (N,) [m/s]
    acceleration: NDArray[np.float64]  #: (N,) [m/s^2]


#: noise of the position adds at most this share to the mean square of the acceleration
_NOISE_SHARE = 0.02
#: for that the bandwidth is lowered by this factor at a time, down to so many periods in the record
_LOWERED, _LEAST_MOTIONS = 1.25, 10.0


def default_bandwidth(record: AxisRecord) -> float:
    """Return the bandwidth [Hz] of the motion that is assumed: 20 Hz, or less if sampling is slow or position noisy."""
    rate = 1.0 / record.sample_time
    band = min(LARGEST_BANDWIDTH, 0.04 * rate)
    least = min(band, _LEAST_MOTIONS / record.duration)
    density = 2.0 * position_noise(record, bandwidth=band) ** 2 / rate
    while band > least:
        motion = smoothed_motion(record, bandwidth=band)
        cutoff = _DECIMATION_RATIO * band
        noise = (2.0 * np.pi) ** 4 * density * cutoff**5 / 5.0
        slow = smoothed_motion(record, bandwidth=max(least, band / _FILTER_RATIO))
        if noise <= _NOISE_SHARE * min(np.var(motion.acceleration), np.var(slow.acceleration)):
            break
        band = max(least, band / _LOWERED)
    return band


def position_noise(record: AxisRecord, *, bandwidth: float) -> float:
    """Return the standard deviation [m] of white noise in the position, from the part that the filter removes."""
    removed = record.position - smoothed_motion(record, bandwidth=bandwidth).position
    share = 1.0 - 2.0 * _FILTER_RATIO * bandwidth * record.sample_time
    return float(np.sqrt(np.mean(removed**2) / max(share, 0.1)))


def smoothed_motion(record: AxisRecord, *, bandwidth: float) -> Motion:
    """Return position, speed and acceleration, filtered at five times the bandwidth [Hz].

    Raises
    ------
    InputError
        If that is beyond half the sampling rate.
    """
    rate = 1.0 / record.sample_time
    cutoff = _FILTER_RATIO * bandwidth
    if not 0.0 < cutoff < 0.5 * rate:
        raise InputError(
            f"A bandwidth (--bandwidth) of {bandwidth:g} Hz needs a filter at {cutoff:g} Hz, and {record.name} is "
            f"sampled at {rate:.4g} Hz; choose a bandwidth above zero and below {0.1 * rate:.3g} Hz."
        )
    b, a = np.asarray(scipy.signal.butter(_BUTTERWORTH_ORDER, cutoff / (0.5 * rate)), dtype=float)

    def filtered(position: NDArray[np.float64]) -> NDArray[np.float64]:
        smooth = scipy.signal.filtfilt(b, a, position, padlen=3 * _BUTTERWORTH_ORDER)
        speed = np.gradient(smooth, record.sample_time)
        return np.array([smooth, speed, np.gradient(speed, record.sample_time)])

    if record.even:
        return Motion(*filtered(record.position))
    whole = np.zeros((3, len(record)))
    whole[0] = record.position
    for first, last in record.segments:
        if last - first >= LEAST_SEGMENT:
            whole[:, first:last] = _on_even_rows(record, first, last, filtered)
    return Motion(*whole)


def _on_even_rows(
    record: AxisRecord,
    first: int,
    last: int,
    filtered: Callable[[NDArray[np.float64]], NDArray[np.float64]],
) -> NDArray[np.float64]:
    """Return the filtered motion of rows first to last, (3, rows), at their own times."""
    t = record.t[first:last]
    even = np.linspace(t[0], t[-1], max(LEAST_SEGMENT, round((t[-1] - t[0]) / record.sample_time) + 1))
    return CubicSpline(even, filtered(CubicSpline(t, record.position[first:last])(even)), axis=1)(t)


def speed_at_start(record: AxisRecord) -> float:
    """Return the speed [m/s] at the record's first row, where a filter has no past values.

    It is the slope there of a cubic through the first 15 rows, by least squares.
    """
    rows = slice(0, _START_ROWS)
    return float(np.polynomial.Polynomial.fit(record.t[rows], record.position[rows], 3).deriv()(0.0))


def first_row(record: AxisRecord, *, bandwidth: float) -> int:
    """Return the first row after the filter's start-up, which takes five of its periods."""
    return round(5.0 / (_FILTER_RATIO * bandwidth * record.sample_time)) - 1


def decimation_factor(record: AxisRecord, *, bandwidth: float) -> int:
    """Return the factor of a decimation that keeps twice the bandwidth."""
    return max(1, round(0.8 * 0.5 / record.sample_time / (_DECIMATION_RATIO * bandwidth)))


def decimated(values: NDArray[np.float64], factor: int) -> NDArray[np.float64]:
    """Return every `factor`-th of values (N,), the last among them, after a Chebyshev filter without delay."""
    if factor == 1:
        return values
    b, a = np.asarray(scipy.signal.cheby1(_DECIMATION_ORDER, _DECIMATION_RIPPLE, 0.8 / factor), dtype=float)
    smooth = scipy.signal.filtfilt(b, a, values, padlen=3 * _DECIMATION_ORDER)
    return smooth[(len(values) - 1) % factor :: factor]


class Decimation:
    """The rows of a record that a decimation leaves, of each part between gaps that is long enough, after the start."""

    def __init__(self, record: AxisRecord, *, bandwidth: float) -> None:
        self.factor = decimation_factor(record, bandwidth=bandwidth)
        start = max(0, first_row(record, bandwidth=bandwidth))
        spans = [(max(first, start), last) for first, last in record.segments]
        #: first row and the row after the last of each part
        self.kept = [one for one in spans if one[1] - one[0] >= max(LEAST_SEGMENT, 4 * self.factor)]

    def of(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return decimated values (n,) of values (N,)."""
        return np.concatenate([decimated(values[first:last], self.factor) for first, last in self.kept])

    def picked(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the values (n,) of the rows that are left, of values (N,), without a filter."""
        return np.concatenate(
            [values[np.arange(a, b)[(b - a - 1) % self.factor :: self.factor]] for a, b in self.kept]
        )

    @property
    def disturbed(self) -> NDArray[np.bool_]:
        """Which of the rows (n,) are too near an end of their part."""
        found = []
        for first, last in self.kept:
            count = -(-(last - first) // self.factor)
            near, place = min(_DISTURBED, int(_MOST_DISTURBED * count)), np.arange(count)
            found.append((place < near) | (place >= count - near))
        return np.concatenate(found)
