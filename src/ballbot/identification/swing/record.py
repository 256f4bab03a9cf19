"""The free swing within a recording: which column, from when and until when."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.signal import find_peaks

from ballbot.arrays import real_array
from ballbot.errors import InputError
from ballbot.log import Log
from ballbot.log.columns import unit_of

Kind = Literal["angle", "rate"]

#: a recording's smallest count of whole swings, and of samples in a swing
_LEAST_SWINGS, _LEAST_SAMPLES = 4.0, 8.0
#: swings smaller than this share of the largest are left out: what rubs at a pivot at rest is another matter
_SMALLEST = 0.05
#: the largest swing is the first that reaches this share of the largest
_AS_LARGE = 0.97
#: an angle beyond this is none of a pendulum, or in degrees [rad]
_LARGEST_ANGLE = 3.0
#: a rate over 2 pi / period beyond this is none of a pendulum: let go at 2 rad, it has 2.3
_LARGEST_RATE = 2.5


@dataclass(frozen=True, kw_only=True, eq=False)
class Swing:
    """A free swing: the body let go and touched by nothing until the last row.

    Raises
    ------
    InputError
        If times and values are not two rows of finite numbers of one length.
    """

    t: NDArray[np.float64]  #: (n,) [s]
    values: NDArray[np.float64]  #: (n,) [rad] or [rad/s], about no particular zero
    kind: Kind
    period: float  #: of the swings as they are, roughly [s]
    source: str  #: what it was measured by, in words

    def __post_init__(self) -> None:
        t = real_array(self.t, ("n",), "The time of a swing")
        object.__setattr__(self, "t", t)
        object.__setattr__(self, "values", real_array(self.values, t.shape, "The row of a swing's values"))

    @property
    def swings(self) -> float:
        """How many times the body swung forth and back."""
        return float(self.t[-1] - self.t[0]) / self.period


def swing_in_log(log: Log, *, column: str | None = None) -> Swing:
    """Return the free swing in a log.

    Parameters
    ----------
    log : Log
        Of the hanging body, before, during and after the swing.
    column : str, optional
        An angle [rad], or a rate [rad/s] where the name is a rate's. Without it the gyro about its main axis; or of
        theta, phi and psi the one that swings most.

    Raises
    ------
    InputError
        Where the log has none of these, or no free swing in it.
    """
    if column is not None:
        log.require(column)
        rate = unit_of(column) == "rad/s" or column.endswith("_dot")
        return swing_of(log.t, log[column], kind="rate" if rate else "angle", source=column)
    gyro = [name for name in ("gyro_x", "gyro_y", "gyro_z") if name in log]
    if gyro:
        log.require(*gyro)
        rates = np.column_stack([log[name] for name in gyro])
        rates = rates - np.median(rates, axis=0)
        axis = np.linalg.svd(rates, full_matrices=False)[2][0]
        return swing_of(log.t, rates @ axis, kind="rate", source="the gyro about its main axis")
    angles = [name for name in ("theta", "phi", "psi") if name in log]
    if not angles:
        raise InputError(
            "The log has neither gyro_x nor theta, phi or psi; name the swinging column with --swing-column."
        )
    log.require(*angles)
    most = max(angles, key=lambda name: float(np.std(np.unwrap(log[name]))))
    return swing_of(log.t, log[most], kind="angle", source=most)


def swing_of(t: NDArray[np.float64], values: NDArray[np.float64], *, kind: Kind, source: str) -> Swing:
    """Return the free swing within a recording: from the body's first way through the middle after its largest swing.

    Parameters
    ----------
    t : ndarray (n,)
        [s], increasing.
    values : ndarray (n,)
        [rad] or [rad/s], about any zero.
    kind : "angle" or "rate"
    source : str
        What it was measured by, in words.

    Raises
    ------
    InputError
        Where nothing swings, in too few swings or samples, or the angle is none.
    """
    values = np.unwrap(values) if kind == "angle" else values
    centred = values - np.median(values)
    if len(t) < 32 or float(np.ptp(centred)) == 0.0:
        raise InputError(f"{source} does not swing: it has {len(t)} rows and no motion.")
    period = _period(t, centred)
    if period < _LEAST_SAMPLES * float(np.median(np.diff(t))):
        raise InputError(
            f"{source} has fewer than {_LEAST_SAMPLES:g} samples in a swing of "
            f"{period:.2g} s; record faster, or check that it is the hanging body's motion."
        )
    smooth = _smoothed(t, centred, period)
    peaks, _ = find_peaks(np.abs(smooth), distance=max(1, int(0.35 * period / np.median(np.diff(t)))))
    if not len(peaks):
        raise InputError(f"{source} does not swing.")
    largest = float(np.abs(smooth[peaks]).max())
    if kind == "angle" and largest > _LARGEST_ANGLE:
        raise InputError(
            f"{source} swings to {largest:.3g} rad, more than a pendulum can; "
            "check whether it is in degrees (then multiply it by pi/180)."
        )
    if kind == "rate" and largest * period / (2.0 * np.pi) > _LARGEST_RATE:
        raise InputError(
            f"{source} swings with {largest:.3g} rad/s in {period:.3g} s, more than a pendulum that "
            "turns over; check whether it is in degrees per second (then multiply it by pi/180)."
        )
    top = int(peaks[np.argmax(np.abs(smooth[peaks]) > _AS_LARGE * largest)])
    crossings = np.flatnonzero(smooth[top:-1] * smooth[top + 1 :] <= 0.0)
    start = top + int(crossings[0]) if len(crossings) else top
    small = peaks[(peaks > start) & (np.abs(smooth[peaks]) < _SMALLEST * largest)]
    end = int(small[0]) if len(small) else len(t)
    swing = Swing(t=t[start:end], values=values[start:end], kind=kind, period=period, source=source)
    if end - start < 2 or swing.swings < _LEAST_SWINGS:
        raise InputError(
            f"{source} swings freely {(0.0 if end - start < 2 else swing.swings):.1f} "
            f"times; frequency and damping need at least {_LEAST_SWINGS:g} swings."
        )
    return swing


def _period(t: NDArray[np.float64], centred: NDArray[np.float64]) -> float:
    """Return the period of the largest line in the spectrum [s]."""
    h = float(np.median(np.diff(t)))
    even = np.interp(np.arange(t[0], t[-1], h), t, centred)
    count = 8 * len(even)
    power = np.abs(np.fft.rfft((even - even.mean()) * np.hanning(len(even)), count))
    # a line below two swings in the whole recording is a drift
    lowest = int(np.ceil(2.0 * count / len(even)))
    return count * h / float(lowest + np.argmax(power[lowest:]))


def _smoothed(t: NDArray[np.float64], centred: NDArray[np.float64], period: float) -> NDArray[np.float64]:
    """Return a running mean over an eighth of a swing."""
    width = max(1, int(period / 8.0 / float(np.median(np.diff(t)))) | 1)
    return np.convolve(centred, np.full(width, 1.0 / width), mode="same")
