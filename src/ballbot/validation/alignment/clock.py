"""The cameras' clock against the log's, estimated from how fast the body turns, which needs no frame.

    t_camera = offset + (1 + rate) t_log

The turning of a body is kept as running totals in its own frame:

    from a gyro              integral of w dt
    from orientations        sum of log(R_k^T R_k+1)

Both are the same curve but for a constant rotation (how the one body frame stands in the other), the clocks, a constant
and the gyro's bias. Noise of an orientation is not summed up by it: it cancels between neighbours.

The speeds of turning, on a grid of both clocks, are correlated over every shift and over rates up to 1 %, each overlap
normalised by the samples that both have (D. Padfield, IEEE Trans. Image Processing 21 (2012) 2706-2718). A
repeated motion gives several peaks: all of them are returned, and the fit of all three axes chooses.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.spatial.transform import Rotation

from ballbot.errors import InputError
from ballbot.log import Log
from ballbot.log.pose import Poses

GYRO_NAMES = ("gyro_x", "gyro_y", "gyro_z")
ANGLE_NAMES = ("theta", "phi", "psi")
#: shorter intervals between rows, and those of two lost rows, are no gap [s]
_LONGEST_BRIDGE = 0.06
#: faster than any gyro's range, 2000 degrees a second: a jump of the frame, not a turning [rad/s]
_FASTEST = 40.0
#: smaller turns may be noise; larger ones are a jump over any time, as a quarter turn is [rad]
_LEAST_JUMP, _SURE_JUMP = 0.35, 1.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Turning:
    """Running totals of a body's turning, in its own frame."""

    t: NDArray[np.float64]  #: (N,) [s], on its own clock
    total: NDArray[np.float64]  #: (N, 3) [rad]
    rate: NDArray[np.float64]  #: (N, 3) [rad/s]
    missing: NDArray[np.float64]  #: (N,), running number of intervals over which the turning is not known

    def at(self, t: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the totals (k, 3) at times (k,)."""
        return _interpolated(t, self.t, self.total)

    def rate_at(self, t: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the rates (k, 3) at times (k,)."""
        return _interpolated(t, self.t, self.rate)

    def covers(self, start: NDArray[np.float64], end: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return over which of the times (k,) from start to end the turning is known throughout."""
        after = self.missing[np.clip(np.searchsorted(self.t, end), 0, len(self.t) - 1)]
        before = self.missing[np.clip(np.searchsorted(self.t, start, side="right") - 1, 0, len(self.t) - 1)]
        return (start >= self.t[0]) & (end <= self.t[-1]) & (before == after)


def log_turning(log: Log) -> Turning:
    """Return the turning of a log: its gyro's, or, without one, that of its angles.

    Raises
    ------
    InputError
        If it has neither, or hardly any values of them.
    """
    if has_gyro(log):
        rate = np.column_stack([log[name] for name in GYRO_NAMES])
        known = whole_rows(rate)
        _check_known(known, "gyro_x, gyro_y, gyro_z")
        rate = _filled(rate, known)
        steps = 0.5 * (rate[1:] + rate[:-1]) * np.diff(log.t)[:, None]
    elif all(name in log for name in ANGLE_NAMES):
        rotations, known = log_rotations(log)
        steps = (rotations[:-1].inv() * rotations[1:]).as_rotvec()
        rate = np.gradient(_summed(steps), log.t, axis=0)
    else:
        raise InputError("Alignment needs the log's gyro_x, gyro_y, gyro_z, or its theta, phi, psi.")
    whole = known[1:] & known[:-1] & ~_gaps(log.t)
    steps = np.where(whole[:, None], steps, 0.0)
    return Turning(t=log.t, total=_summed(steps), rate=rate, missing=_counted(~whole))


def has_gyro(log: Log) -> bool:
    """Return whether a log's turning is its gyro's."""
    return all(name in log for name in GYRO_NAMES)


def poses_turning(poses: Poses) -> Turning:
    """Return the turning of poses all seen; steps over gaps and jumps of the frame are left out and counted."""
    steps = (poses.rotations[:-1].inv() * poses.rotations[1:]).as_rotvec()
    whole = ~broken(poses)
    steps = np.where(whole[:, None], steps, 0.0)
    total = _summed(steps)
    return Turning(t=poses.t, total=total, rate=np.gradient(total, poses.t, axis=0), missing=_counted(~whole))


def broken(poses: Poses) -> NDArray[np.bool_]:
    """Return which steps (M - 1,) from pose to pose, all seen, are over a gap, or a jump that no body makes."""
    angles = (poses.rotations[:-1].inv() * poses.rotations[1:]).magnitude()
    jumps = angles > np.clip(_FASTEST * np.diff(poses.t), _LEAST_JUMP, _SURE_JUMP)
    return jumps | _gaps(poses.t)


def log_rotations(log: Log) -> tuple[Rotation, NDArray[np.bool_]]:
    """Return the log's orientations, body to world, and where (N,) they are known; elsewhere the one before."""
    angles = np.column_stack([log[name] for name in ANGLE_NAMES])
    known = whole_rows(angles)
    _check_known(known, "theta, phi, psi")
    return Rotation.from_euler("XYZ", _filled(angles, known)), known


def whole_rows(values: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which rows (N,) of a table (N, n) are finite throughout."""
    return np.asarray(np.isfinite(values).all(axis=1))


def longest_bridge(t: NDArray[np.float64]) -> float:
    """Return the longest interval between times (N,) over which values may be interpolated [s]."""
    return max(_LONGEST_BRIDGE, 2.5 * float(np.median(np.diff(t))))


def _check_known(known: NDArray[np.bool_], names: str) -> None:
    if known.sum() < 10:
        raise InputError(f"The log's {names} have values in only {known.sum()} of {len(known)} rows.")


def _filled(values: NDArray[np.float64], known: NDArray[np.bool_]) -> NDArray[np.float64]:
    return values[np.maximum.accumulate(np.where(known, np.arange(len(known)), np.argmax(known)))]


def _gaps(t: NDArray[np.float64]) -> NDArray[np.bool_]:
    return np.diff(t) > longest_bridge(t)


def _summed(steps: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])


def _counted(events: NDArray[np.bool_]) -> NDArray[np.float64]:
    return np.concatenate([[0.0], np.cumsum(events)])


def _interpolated(
    t: NDArray[np.float64], times: NDArray[np.float64], values: NDArray[np.float64]
) -> NDArray[np.float64]:
    return np.column_stack([np.interp(t, times, column) for column in values.T])


#: of the grid [s]; far below the span, so that a peak is not missed
_STEP = 0.02
#: over which the speed of turning is a mean [s]: it calms the cameras' noise and forgives a clock a little wrong
_SPAN = 0.2
#: largest rate searched [s/s]
LARGEST_RATE = 0.01
#: most of the log that is searched for [s]: more would need a finer grid of rates and gain nothing
_LONGEST_SEARCHED = 240.0
#: and the least that must overlap [s]
_LEAST_OVERLAP = 4.0
#: peaks handed on, and how far apart they are [s]
_PEAKS = 4
_APART = 0.3


@dataclass(frozen=True, kw_only=True)
class Clock:
    """t_camera = offset + (1 + rate) t_log."""

    offset: float  #: the cameras' time at the log's zero [s]
    rate: float  #: how much faster the cameras' clock runs [s/s]

    def to_log(self, t: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return times of the cameras' clock as times of the log's."""
        return (t - self.offset) / (1.0 + self.rate)

    def to_cameras(self, t: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return times of the log's clock as times of the cameras'."""
        return self.offset + (1.0 + self.rate) * t


def candidate_clocks(log: Turning, cameras: Turning) -> list[Clock]:
    """Return up to four clocks under which log and cameras turn alike, the likeliest first.

    Raises
    ------
    InputError
        If the two have too little in common to be compared.
    """
    start, end = _liveliest(log)
    speeds, known = _speeds(log, np.arange(start, end, _STEP))
    half = 0.5 * (end - start)
    # a rate wrong by half a step dephases the ends by a quarter of the span
    count = int(np.ceil(LARGEST_RATE * half / (0.5 * _SPAN)))
    peaks: list[tuple[float, float, Clock]] = []
    for rate in np.linspace(-LARGEST_RATE, LARGEST_RATE, 2 * count + 1):
        begin = cameras.t[0] / (1.0 + rate)
        grid = np.arange(begin, cameras.t[-1] / (1.0 + rate), _STEP)
        score = _scores(speeds, known, *_speeds(cameras, (1.0 + rate) * grid))
        for _ in range(_PEAKS):
            best = int(np.argmax(score))
            if not score[best] > 0.0:
                break
            shift = begin - start + (best - len(speeds) + 1) * _STEP
            clock = Clock(offset=float((1.0 + rate) * shift), rate=float(rate))
            peaks.append((float(score[best]), float(clock.to_cameras(np.array(start + half))), clock))
            score[max(0, best - int(_APART / _STEP)) : best + int(_APART / _STEP) + 1] = -np.inf
    if not peaks:
        raise InputError(
            "Log and motion capture do not match: with no shift of "
            f"their clocks do they turn alike for {_LEAST_OVERLAP:g} s."
        )
    return _separate_clocks(sorted(peaks, key=lambda peak: -peak[0]))


def _separate_clocks(peaks: list[tuple[float, float, Clock]]) -> list[Clock]:
    """Return the clocks of the best peaks whose times at the stretch's middle differ."""
    kept: list[tuple[float, Clock]] = []
    for _, middle, clock in peaks:
        if all(abs(middle - other) > _APART for other, _ in kept):
            kept.append((middle, clock))
        if len(kept) == _PEAKS:
            break
    return [clock for _, clock in kept]


def _liveliest(log: Turning) -> tuple[float, float]:
    """Return start and end of the stretch of the log to search for: where it turns most, if it is long."""
    start, end = float(log.t[0]), float(log.t[-1])
    if end - start <= _LONGEST_SEARCHED:
        return start, end
    speed = np.linalg.norm(log.rate, axis=1)
    walked = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(log.t))])
    starts = np.arange(start, end - _LONGEST_SEARCHED, 10.0)
    turned = np.interp(starts + _LONGEST_SEARCHED, log.t, walked) - np.interp(starts, log.t, walked)
    best = float(starts[int(np.argmax(turned))])
    return best, best + _LONGEST_SEARCHED


def _speeds(turning: Turning, t: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the mean speeds of turning (k,) [rad/s] about times (k,), and 1 where they are known, else 0."""
    span = turning.at(t + 0.5 * _SPAN) - turning.at(t - 0.5 * _SPAN)
    known = turning.covers(t - 0.5 * _SPAN, t + 0.5 * _SPAN)
    return np.where(known, np.linalg.norm(span, axis=1) / _SPAN, 0.0), known.astype(np.float64)


def _scores(
    a: NDArray[np.float64], a_known: NDArray[np.float64], b: NDArray[np.float64], b_known: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return how sure (len(a) + len(b) - 1,) each shift of `a` along `b` is: z-scored correlation, -inf where short."""
    size = fft.next_fast_len(len(a) + len(b) - 1, real=True)

    def spectrum(values: NDArray[np.float64]) -> NDArray[np.complex128]:
        return np.asarray(fft.rfft(values, size))

    def shifted(left: NDArray[np.complex128], right: NDArray[np.complex128]) -> NDArray[np.float64]:
        return np.asarray(fft.irfft(left * right, size))[: len(a) + len(b) - 1]

    A, A1, A2 = (spectrum(values[::-1]) for values in (a, a_known, a * a))
    B, B1, B2 = (spectrum(values) for values in (b, b_known, b * b))
    n = np.round(shifted(A1, B1))
    with np.errstate(divide="ignore", invalid="ignore"):
        sum_a, sum_b = shifted(A, B1), shifted(A1, B)
        covariance = shifted(A, B) - sum_a * sum_b / n
        spread_a = shifted(A2, B1) - sum_a**2 / n
        spread_b = shifted(A1, B2) - sum_b**2 / n
        correlation = covariance / np.sqrt(spread_a * spread_b)
    useful = (n * _STEP >= _LEAST_OVERLAP) & (spread_a > 1e-9) & (spread_b > 1e-9) & np.isfinite(correlation)
    # Fisher's z over its standard error: a long overlap counts for more than a short accidental match
    z = np.arctanh(np.clip(np.where(useful, correlation, 0.0), -0.9999, 0.9999)) * np.sqrt(np.maximum(n, 1.0))
    return np.where(useful, z, -np.inf)
