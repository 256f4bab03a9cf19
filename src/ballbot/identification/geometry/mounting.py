"""How the IMU sits on the body, from the gyro against the body's turning as cameras saw it.

    integral of gyro dt = R_imu_body turning + bias T

The cameras' clock is matched first: the correlation of both rates' magnitudes finds its offset without knowing how
the IMU sits; then offset and rate are found with the rotation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import correlate, correlation_lags
from scipy.spatial.transform import Rotation

from ballbot.errors import InputError
from ballbot.identification.geometry.increments import cut, integral, mean_about
from ballbot.identification.geometry.least_squares import Fit, fit_clustered
from ballbot.identification.geometry.motion_capture import Film
from ballbot.log import Log

GYRO_NAMES = ("gyro_x", "gyro_y", "gyro_z")
#: length of a window [s]
WINDOW = 0.25
#: rates are means over this long [s] where magnitudes are compared, against the noise of cameras
SMOOTHING = 0.15
#: magnitudes that correlate less than this are not of one and the same run
LEAST_CORRELATION = 0.5
#: both totals are means over this long [s], some samples of either, where the offset is sought
MEAN = 0.05
#: magnitudes above so many medians, as in a fall, count as this many
_HIGHEST = 5.0
_GRID = 0.005


@dataclass(frozen=True, kw_only=True, eq=False)
class Mounting:
    """Where the IMU points and what the cameras' clock says, both for one run."""

    #: [rotation vector.. from the body's frame to the IMU's [rad], bias.. [rad/s], offset [s], rate [s/s]] (8,)
    fit: Fit
    middle: float  #: the log's t [s] at which the offset holds

    @property
    def R_imu_body(self) -> Rotation:
        """The rotation that takes vectors of the body's frame to the IMU's."""
        return Rotation.from_rotvec(self.fit.values[:3])

    def camera_time(self, t: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the cameras' time of times of the log."""
        return t + self.fit.values[6] + self.fit.values[7] * (t - self.middle)

    def body_turning(self, log: Log) -> NDArray[np.float64]:
        """Return the body's turning (N, 3) [rad] by the gyro, in the body's frame and without bias."""
        rates = np.column_stack([log[name] for name in GYRO_NAMES]) - self.fit.values[3:6]
        return self.R_imu_body.inv().apply(integral(log.t, rates))


def imu_mounting(log: Log, film: Film) -> Mounting:
    """Find the IMU's rotation and the cameras' clock.

    Raises
    ------
    InputError
        Where the gyro's columns are missing, or log and cameras are not of one run.
    """
    rates = np.column_stack([log[name] for name in GYRO_NAMES])
    total, offset = integral(log.t, rates), _offset(log.t, rates, film)
    cuts = cut(log, rates, window=WINDOW)
    start, end = log.t[cuts.first], log.t[cuts.last]
    # a little to spare, for the offset moves while it is found
    cuts = cuts.chosen(film.covers(start + offset - 0.1, end + offset + 0.1))
    if not len(cuts):
        raise InputError("The cameras saw no quarter of a second of this log without a gap.")
    start, end = log.t[cuts.first], log.t[cuts.last]
    middle = float(0.5 * (start[0] + end[-1]))

    def seen(t: NDArray[np.float64]) -> NDArray[np.float64]:
        return mean_about(t, film.t, film.turning, width=MEAN)

    gyro = mean_about(end, log.t, total, width=MEAN) - mean_about(start, log.t, total, width=MEAN)
    turned = seen(end + offset) - seen(start + offset)
    guess = Rotation.align_vectors(gyro - gyro.mean(axis=0), turned - turned.mean(axis=0))[0]

    def residuals(p: NDArray[np.float64]) -> NDArray[np.float64]:
        later, earlier = (t + p[6] + p[7] * (t - middle) for t in (end, start))
        turning = seen(later) - seen(earlier)
        return gyro - Rotation.from_rotvec(p[:3]).apply(turning) - p[3:6] * (end - start)[:, None]

    p = np.concatenate([guess.as_rotvec(), np.zeros(3), [offset, 0.0]])
    scales = np.array([0.1, 0.1, 0.1, 0.01, 0.01, 0.01, 0.1, 1e-3])
    return Mounting(fit=fit_clustered(residuals, p, scales=scales, clusters=cuts.clusters), middle=middle)


def _offset(t: NDArray[np.float64], rates: NDArray[np.float64], film: Film) -> float:
    """Return the cameras' time at the log's zero [s], to a grid of 5 ms."""
    ours = _magnitude(np.arange(t[0], t[-1], _GRID), t, integral(t, rates))
    theirs = _magnitude(np.arange(film.t[0], film.t[-1], _GRID), film.t, film.turning)
    if min(len(ours), len(theirs)) < 100:
        raise InputError("Log and motion capture must each last half a second at least.")
    likeness = correlate(theirs, ours)
    best = int(np.argmax(likeness))
    if likeness[best] < LEAST_CORRELATION * np.linalg.norm(ours) * np.linalg.norm(theirs):
        raise InputError(
            "The gyro and the motion capture are not of the same run: the body rates correlate "
            f"by only {likeness[best] / (np.linalg.norm(ours) * np.linalg.norm(theirs)):.2f}."
        )
    return float(film.t[0] - t[0] + _GRID * correlation_lags(len(theirs), len(ours))[best])


def _magnitude(
    grid: NDArray[np.float64], t: NDArray[np.float64], total: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return |rate| on a grid of times, less its mean, from a running total (N, 3) and means over `SMOOTHING`."""
    half = 0.5 * SMOOTHING
    steps = [np.interp(grid + half, t, one) - np.interp(grid - half, t, one) for one in total.T]
    size = np.linalg.norm(steps, axis=0)
    size = np.minimum(size, _HIGHEST * np.median(size))
    return size - size.mean()
