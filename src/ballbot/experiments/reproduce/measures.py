"""How runs and curves are measured where several figures ask the same."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt
from scipy.spatial import KDTree

from ballbot.experiments.metrics import position_error, rms, true_place
from ballbot.experiments.reproduce.recordings import ARRIVED
from ballbot.log import STATE_NAMES, Log


def peak_after_arrival(log: Log) -> float:
    """Return the largest distance from the reference once it has been reached [m]."""
    return float(position_error(log)[log.t >= ARRIVED].max())


def distance_at(log: Log, t: float) -> float:
    """Return the distance from the reference at a time [s], in metres."""
    return float(position_error(log)[np.searchsorted(log.t, t - 1e-6)])


def steady_error(log: Log, *, seconds: float = 5.0) -> float:
    """Return the mean distance from the reference over a run's last seconds [m]."""
    return float(position_error(log)[log.t >= log.t[-1] - seconds].mean())


def apart(first: Log, second: Log, name: str) -> float:
    """Return the RMS difference of a state between two runs over the first one's range of it."""
    count = min(len(first), len(second))
    return rms(first[name][:count] - second[name][:count]) / float(np.ptp(first[name]))


def largest_apart(first: Log, second: Log, names: Sequence[str] = STATE_NAMES) -> float:
    """Return the largest of those states' `apart`."""
    return max(apart(first, second, name) for name in names)


def largest_lean(log: Log) -> float:
    """Return the largest of theta and phi [rad]."""
    return float(np.abs(log.states[:, 2:4]).max())


def way_apart(first: Log, second: Log) -> float:
    """Return the largest distance of the second run's place, on its way, from the first run's path [m]."""
    paths = [true_place(log) for log in (first, second)]
    along, places = (np.column_stack([one["x"], one["y"]])[one.t < ARRIVED] for one in paths)
    # a path's points lie millimetres apart, so that the nearest of them is as good as the path
    distances, _ = KDTree(along).query(places)
    return float(np.max(distances))


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
