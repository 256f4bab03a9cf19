"""What is wrong with the log's angles and position by the cameras: errors, drifts, delays, and what explains them.

    error = logged - seen,     error(t) = constant + drift t + wander

A log that is late by d has, over half a second, changes of its error of -d times the changes of its rate. Position
that is integrated in a frame turned by a heading wrong by d has the error  integral of (Rz(d) - 1) dp; the share of
the error seen that this explains is 1 - |seen - explained|^2 / |seen|^2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.log import Log
from ballbot.validation.alignment.frame import PREFIX
from ballbot.validation.alignment.motion import SPAN, fit_linear

ANGLES = ("theta", "phi", "psi")
POSITIONS = ("x", "y")
#: beyond this angle from upright a robot is falling or in hands [rad]
LARGEST_LEAN = 0.35
#: rates are slopes over this, to either side [s]
_SLOPE = 0.04
_LEAST_ROWS = 60
#: scale and turn of the path are told by stretches so long, in which a robot's rocking averages out [s]
_STRETCH = 5.0
#: and of those, one in so many
_EVERY = 10


@dataclass(frozen=True, kw_only=True, eq=False)
class SensorError:
    """Of one angle [rad] or coordinate [m], logged less seen, while the robot stands."""

    name: str
    rms: float
    largest: float
    drift: float  #: slope of the straight line through the error [1/s]
    drift_half_width: float  #: 95 %, by blocks of time
    wander: float  #: rms about that line
    delay: float | None  #: of what is logged behind the clock's signal [s]; None for a coordinate
    delay_half_width: float | None


@dataclass(frozen=True, kw_only=True)
class PathScale:
    """How the log's path compares with the cameras', but for the heading's error; half widths of 95 %."""

    scale: float  #: the log's distances over the cameras'
    scale_half_width: float
    turn: float  #: from the cameras' path to the log's [rad]
    turn_half_width: float


@dataclass(frozen=True, kw_only=True, eq=False)
class PositionError:
    """What explains the error of position."""

    largest: float  #: its length [m]
    path: float  #: length of the path that the cameras saw [m], over half a second at a time
    by_heading: (
        float  #: share of the error's square that the heading's error explains; below 0, it makes it worse
    )
    predicted: NDArray[np.float64]  #: (N, 2) [m] the error that the heading's makes; NaN if not seen
    scale: PathScale | None  #: None if the path is too short to tell


@dataclass(frozen=True, kw_only=True, eq=False)
class SensorErrors:
    """Errors of all that the log and the cameras both have."""

    of: dict[str, SensorError]
    errors: dict[str, NDArray[np.float64]]  #: by name, (N,) on the log's rows
    position: PositionError | None
    duration: float  #: from the first to the last row compared [s]


def sensor_errors(log: Log, columns: dict[str, NDArray[np.float64]]) -> SensorErrors | None:
    """Return the errors, or None if log and cameras have hardly a row together.

    Parameters
    ----------
    log : Log
    columns : dict
        From `aligned_columns`.
    """
    names = [name for name in (*ANGLES, *POSITIONS) if name in log and f"{PREFIX}{name}" in columns]
    standing = np.hypot(columns[f"{PREFIX}theta"], columns[f"{PREFIX}phi"]) < LARGEST_LEAN
    errors = {name: np.where(standing, log[name] - columns[f"{PREFIX}{name}"], np.nan) for name in names}
    if np.isfinite(errors["psi"]).sum() < _LEAST_ROWS:
        return None
    compared = log.t[np.isfinite(errors["psi"])]
    position = None
    if all(name in errors for name in POSITIONS):
        position = _position_error(log.t, columns, errors)
    return SensorErrors(
        of={name: _sensor_error(name, log, error) for name, error in errors.items()},
        errors=errors,
        position=position,
        duration=float(compared[-1] - compared[0]),
    )


def _sensor_error(name: str, log: Log, error: NDArray[np.float64]) -> SensorError:
    known = np.isfinite(error)
    t, e = log.t[known], error[known]
    J = np.column_stack([np.ones(len(t)), t - t.mean()])[:, None, :]
    (constant, drift), half = fit_linear(J, e[:, None], t)
    wander = e - constant - drift * (t - t.mean())
    delay = _delay(log, name, error) if name in ANGLES else None
    return SensorError(
        name=name,
        rms=float(np.sqrt(np.mean(e**2))),
        largest=float(np.abs(e).max()),
        drift=float(drift),
        drift_half_width=float(half[1]),
        wander=float(np.sqrt(np.mean(wander**2))),
        delay=delay[0] if delay else None,
        delay_half_width=delay[1] if delay else None,
    )


def _delay(log: Log, name: str, error: NDArray[np.float64]) -> tuple[float, float] | None:
    """Return how late an angle is logged [s] and the 95 % half width, or None if too little is known."""
    t = log.t
    known = np.isfinite(log[name])
    times, angle = t[known], np.unwrap(log[name][known])
    rate = (np.interp(t + _SLOPE, times, angle) - np.interp(t - _SLOPE, times, angle)) / (2.0 * _SLOPE)
    ahead = np.interp(t + SPAN, t, rate) - rate, np.interp(t + SPAN, t, error) - error
    usable = np.isfinite(ahead[0]) & np.isfinite(ahead[1]) & (t + SPAN <= t[-1])
    if usable.sum() < _LEAST_ROWS:
        return None
    found, half = fit_linear(-ahead[0][usable][:, None, None], ahead[1][usable][:, None], t[usable])
    return float(found[0]), float(half[0])


def _position_error(
    t: NDArray[np.float64], columns: dict[str, NDArray[np.float64]], errors: dict[str, NDArray[np.float64]]
) -> PositionError | None:
    seen = np.column_stack([columns[f"{PREFIX}{name}"] for name in POSITIONS])
    error = np.column_stack([errors[name] for name in POSITIONS])
    known = np.isfinite(seen).all(axis=1) & np.isfinite(error).all(axis=1)
    if known.sum() < _LEAST_ROWS:
        return None
    times, seen, seen_error, off = t[known], seen[known], error[known], errors["psi"][known]
    turned = _turned(seen, off)
    of_heading = turned - (seen - seen[0])
    predicted = np.full_like(error, np.nan)
    predicted[known] = of_heading
    coarse = np.arange(times[0], times[-1], SPAN)
    path = np.column_stack([np.interp(coarse, times, column) for column in seen.T])
    return PositionError(
        largest=float(np.linalg.norm(seen_error, axis=1).max()),
        path=float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()),
        by_heading=_share(seen_error, of_heading),
        predicted=predicted,
        scale=_fit_scale(times, turned, seen + seen_error),
    )


def _fit_scale(
    t: NDArray[np.float64], turned: NDArray[np.float64], logged: NDArray[np.float64]
) -> PathScale | None:
    """Return how the logged path (k, 2) is scaled and turned against the one seen, its headings made the log's."""
    ends = np.searchsorted(t, t + _STRETCH)
    starts = np.flatnonzero(ends < len(t))[::_EVERY]
    if len(starts) < _LEAST_ROWS:
        return None
    ends = ends[starts]
    (x, y), moved = (turned[ends] - turned[starts]).T, logged[ends] - logged[starts]
    J = np.stack([np.stack([x, -y], axis=1), np.stack([y, x], axis=1)], axis=1)
    (c, s), half = fit_linear(J, moved, t[starts])
    size = float(np.hypot(c, s))
    if not (size > 0.5 and half.max() < 0.5):
        return None
    return PathScale(
        scale=size,
        scale_half_width=float(half[0]),
        turn=float(np.arctan2(s, c)),
        turn_half_width=float(half[1]) / size,
    )


def _turned(path: NDArray[np.float64], turn: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a path (k, 2), from its start, whose every step is turned by an angle (k,)."""
    steps = np.diff(path, axis=0)
    angle = 0.5 * (turn[1:] + turn[:-1])
    c, s = np.cos(angle), np.sin(angle)
    turned = np.column_stack([c * steps[:, 0] - s * steps[:, 1], s * steps[:, 0] + c * steps[:, 1]])
    return np.concatenate([np.zeros((1, 2)), np.cumsum(turned, axis=0)])


def _share(error: NDArray[np.float64], explained: NDArray[np.float64]) -> float:
    """Return the share of an error's square that is explained."""
    total = float(np.sum(error**2))
    return 1.0 - float(np.sum((error - explained) ** 2)) / total if total > 0.0 else 0.0
