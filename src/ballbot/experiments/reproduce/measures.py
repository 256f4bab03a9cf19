"""How runs and curves are measured where several figures ask the same."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from ballbot.experiments.metrics import position_error, rms
from ballbot.experiments.reproduce.recordings import ARRIVED
from ballbot.log import STATE_NAMES, Log


def peak_after_arrival(log: Log) -> float:
    """Return the largest distance from the reference once it has been reached [m]."""
    return float(position_error(log)[log.t >= ARRIVED].max())


def steady_error(log: Log, *, seconds: float = 5.0) -> float:
    """Return the mean distance from the reference over a run's last seconds [m]."""
    return float(position_error(log)[log.t >= log.t[-1] - seconds].mean())


def apart(first: Log, second: Log, name: str) -> float:
    """Return the RMS difference of a state between two runs over the first one's range of it."""
    count = min(len(first), len(second))
    return rms(first[name][:count] - second[name][:count]) / float(np.ptp(first[name]))


def largest_apart(first: Log, second: Log) -> float:
    """Return the largest of all ten states' `apart`."""
    return max(apart(first, second, name) for name in STATE_NAMES)


def above(values: NDArray[np.float64], sample_time: float, frequency: float) -> NDArray[np.float64]:
    """Return what of columns (n, ...) lies above a frequency [Hz], by a Butterworth filter run both ways.

    Parameters
    ----------
    values : ndarray (n, ...)
        A row for each sample.
    sample_time : float
        [s]
    frequency : float
        [Hz]
    """
    sections = butter(2, frequency, btype="highpass", fs=1.0 / sample_time, output="sos")
    return np.asarray(sosfiltfilt(sections, values, axis=0), np.float64)
