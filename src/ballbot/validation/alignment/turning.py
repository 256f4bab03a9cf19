"""The turning of a body as running totals in its own frame, which no frame of reference enters.

    from a gyro              integral of w dt
    from orientations        sum of log(R_k^T R_k+1)

Both are the same curve but for a constant rotation (how the one body frame stands in the other), the clocks, a constant
and the gyro's bias. Noise of an orientation is not summed up by it: it cancels between neighbours.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ballbot.errors import InputError
from ballbot.log import Log
from ballbot.log.poses import Poses

GYRO_NAMES = ("gyro_x", "gyro_y", "gyro_z")
ANGLE_NAMES = ("theta", "phi", "psi")
#: shorter intervals between rows, and those of two lost rows, are no gap [s]
_LONGEST_BRIDGE = 0.06
#: faster than any gyro's range, 2000 degrees a second: a jump of the frame, not a turning [rad/s]
_FASTEST = 40.0
#: from noise to what is a jump over however long, for a quarter turn is one [rad]
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
    """Return the turning that a log tells: its gyro's, or, without one, that of its angles.

    Raises
    ------
    InputError
        Where it has neither, or hardly any values of them.
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
    """Return the longest interval between times (N,) over which what lies between may be interpolated [s]."""
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
