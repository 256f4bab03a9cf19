"""Velocity and acceleration from position alone, without delay, and decimation: the steps of IDIM-LS.

A Butterworth filter run forwards and backwards, central differences twice, and every column of a regression through
the same decimation: A. Janot, M. Gautier and M. Brunot, Data set and reference models of EMPS, Nonlinear System
Identification Benchmarks, Eindhoven 2019, and M. Gautier, Dynamic identification of robots with power model,
ICRA 1997. Filter lengths at the ends and the first row kept are MATLAB's (`filtfilt`, `decimate`), on which the last
digits of the published numbers depend.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from ballbot.errors import InputError
from ballbot.identification.axis.record import AxisRecord

_BUTTERWORTH_ORDER = 4
_DECIMATION_ORDER = 8
_DECIMATION_RIPPLE = 0.05  # [dB]
#: the filter passes so many times the motion's bandwidth, decimation keeps twice it
_FILTER_RATIO, _DECIMATION_RATIO = 5.0, 2.0
#: an axis of that mass that moves faster than this is rare [Hz]
LARGEST_BANDWIDTH = 20.0
_START_ROWS = 15


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """What the axis did, without noise above the filter's frequency."""

    position: NDArray[np.float64]  #: (N,) [m]
    speed: NDArray[np.float64]  #: (N,) [m/s]
    acceleration: NDArray[np.float64]  #: (N,) [m/s^2]


def default_bandwidth(record: AxisRecord) -> float:
    """Return the bandwidth [Hz] of the motion that is assumed: 20 Hz, or less where the sampling is slow."""
    return min(LARGEST_BANDWIDTH, 0.04 / record.sample_time)


def smoothed_motion(record: AxisRecord, *, bandwidth: float) -> Motion:
    """Return position, speed and acceleration, filtered at five times the bandwidth [Hz].

    Raises
    ------
    InputError
        Where that is beyond half the sampling rate.
    """
    rate = 1.0 / record.sample_time
    cutoff = _FILTER_RATIO * bandwidth
    if not 0.0 < cutoff < 0.5 * rate:
        raise InputError(
            f"A bandwidth of {bandwidth:g} Hz needs a filter at {cutoff:g} Hz, and {record.name} is "
            f"sampled at {rate:.4g} Hz; choose a bandwidth above zero and below {0.1 * rate:.3g} Hz."
        )
    b, a = np.asarray(signal.butter(_BUTTERWORTH_ORDER, cutoff / (0.5 * rate)), dtype=float)
    position = signal.filtfilt(b, a, record.position, padlen=3 * _BUTTERWORTH_ORDER)
    speed = np.gradient(position, record.sample_time)
    return Motion(position=position, speed=speed, acceleration=np.gradient(speed, record.sample_time))


def speed_at_start(record: AxisRecord) -> float:
    """Return the speed [m/s] at the record's first row, where a filter has no past to look at.

    It is the slope there of a cubic through the first 15 rows, by least squares.
    """
    rows = slice(0, _START_ROWS)
    return float(np.polynomial.Polynomial.fit(record.t[rows], record.position[rows], 3).deriv()(0.0))


def first_row(record: AxisRecord, *, bandwidth: float) -> int:
    """Return the first row that the filter's start does not spoil: five periods of it."""
    return round(5.0 / (_FILTER_RATIO * bandwidth * record.sample_time)) - 1


def decimation_factor(record: AxisRecord, *, bandwidth: float) -> int:
    """Return how many rows become one, so that twice the bandwidth stays."""
    return max(1, round(0.8 * 0.5 / record.sample_time / (_DECIMATION_RATIO * bandwidth)))


def decimated(values: NDArray[np.float64], factor: int) -> NDArray[np.float64]:
    """Return every `factor`-th of values (N,), the last among them, after a Chebyshev filter without delay."""
    if factor == 1:
        return values
    b, a = np.asarray(signal.cheby1(_DECIMATION_ORDER, _DECIMATION_RIPPLE, 0.8 / factor), dtype=float)
    smooth = signal.filtfilt(b, a, values, padlen=3 * _DECIMATION_ORDER)
    return smooth[(len(values) - 1) % factor :: factor]
