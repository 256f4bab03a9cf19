"""How rollers dither the wheels: the fast part of the wheels' speed, beside the speeds at which friction acts.

An omni-wheel's rollers pass the contact one by one and shake the wheel. Where that shaking is as fast as the motion
itself, dry friction changes sign with the shaking and is felt by the slow motion as a smaller, smoother resistance
than the law says. Heading is where this shows first, because turning on the spot moves the wheels least.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.log import Log
from ballbot.log.columns import wheel_speed_names
from ballbot.mechanics.model import Model
from ballbot.robot.derived import encoder_step

#: the fast part begins at so many times the unstable pole, above anything that balancing asks for
_FAST = 6.0
#: a log shorter than this many rows is too short for the filter
_LEAST_ROWS = 200


@dataclass(frozen=True, kw_only=True, eq=False)
class Dither:
    """The wheels' speed, split in motion and dither; root mean squares over the log."""

    corner: float  #: [Hz] where the fast part begins
    motion: NDArray[np.float64]  #: (n,) [rad/s] below the corner
    dither: NDArray[np.float64]  #: (n,) [rad/s] above the corner
    encoder: float  #: [rad/s] what the encoder's counting alone would put above the corner
    heading: NDArray[np.float64]  #: (n,) [rad/s] the part of the motion that turning about the vertical makes
    reversals: NDArray[np.float64]  #: (n,) changes of sign a second
    reversals_of_motion: NDArray[np.float64]  #: (n,) changes of sign a second of the slow part


def find_dither(model: Model, log: Log) -> Dither | None:
    """Return what the wheels' speeds in the log show, or None where the log lacks them or is short."""
    from scipy.signal import butter, sosfiltfilt

    names = wheel_speed_names(model.robot.wheel_count)
    rate = 1.0 / log.sample_time
    corner = _FAST * float(model.linearize().poles()[0].real) / (2.0 * np.pi)
    usable = all(name in log and np.isfinite(log[name]).all() for name in names)
    if not usable or len(log) < _LEAST_ROWS or not 0.0 < corner < 0.4 * rate:
        return None
    speeds = log.wheel_speeds
    slow = sosfiltfilt(butter(4, corner, fs=rate, output="sos"), speeds, axis=0)
    sensors, drive = model.robot.sensors, model.robot.drive
    step = encoder_step(encoder_counts=sensors.encoder_counts, gear_ratio=drive.gear_ratio)
    # the difference of two counts, each rounded evenly: variance 2/12 of a step; above the corner, nearly all of it
    counting = step * rate / np.sqrt(6.0)
    return Dither(
        corner=corner,
        motion=_rms(slow),
        dither=_rms(speeds - slow),
        encoder=float(counting),
        heading=np.abs(model.wheel_jacobian(np.zeros(5))[:, 4]) * _rms(log["psi_dot"][:, None]),
        reversals=_reversals(speeds, log),
        reversals_of_motion=_reversals(slow, log),
    )


def _rms(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.sqrt(np.mean(values**2, axis=0))


def _reversals(speeds: NDArray[np.float64], log: Log) -> NDArray[np.float64]:
    """Return changes of sign a second; a count of zero keeps the sign before it."""
    duration = log.t[-1] - log.t[0]
    changes = []
    for speed in speeds.T:
        moving = speed[speed != 0.0]
        changes.append(np.count_nonzero(np.signbit(moving[1:]) != np.signbit(moving[:-1])) / duration)
    return np.array(changes)
