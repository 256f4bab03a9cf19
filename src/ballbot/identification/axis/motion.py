"""Speed and acceleration of an axis from its position, and the inverse model, which starts the output-error fit.

    F = M a + b v + c sgn(v) + offset + G(q)

A Butterworth filter, run forwards and backwards and so without delay, smooths the position, which is differentiated by
central differences. The same filter at a lower frequency smooths every column of the regression (M. Gautier, Dynamic
identification of robots with power model, ICRA 1997). Rows at rest, where friction balances any force, are left out.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy

from ballbot.arrays import Bools, Floats, Ints
from ballbot.errors import InputError
from ballbot.fitting.least_squares import LinearFit, fit_linear
from ballbot.identification.axis.model import PARAMETERS, AxisModel, unit_for
from ballbot.identification.axis.record import LEAST_PART, AxisRecord

_ORDER = 4
#: cut-off frequencies of the position and of the regression's columns, over the bandwidth of the motion
_POSITION_FILTER, _COLUMN_FILTER = 5.0, 2.0
#: largest bandwidth of a motion; faster axes are rare [Hz]
LARGEST_BANDWIDTH = 20.0
_START_ROWS = 15
#: an axis is at rest below this share of its usual speed
REST = 0.02
#: residuals within a block may depend on each other [s]
BLOCK = 1.0
#: largest share of position noise in the mean square of the acceleration
_NOISE_SHARE = 0.02
#: factor by which the bandwidth is lowered for that, and least number of its periods in the record
_LOWERED, _LEAST_MOTIONS = 1.25, 10.0
#: an effect is clear beyond so many standard errors: by chance in one case of 1,000
CLEAR = 3.3
#: largest condition number of columns of length one: errors are then 1e4 times those of the force
LARGEST_CONDITION = 1e4
#: and largest one with which a further force or a delay is separated from the others
DISTINGUISHED = 300.0


@dataclass(frozen=True, kw_only=True, eq=False)
class AxisMotion:
    """A record's motion, filtered."""

    record: AxisRecord
    bandwidth: float  #: [Hz]
    position: Floats  #: (N,) [m]
    speed: Floats  #: (N,) [m/s]
    acceleration: Floats  #: (N,) [m/s^2]

    @cached_property
    def noise(self) -> float:
        """Standard deviation [m] of white noise in the position, from the part that the filter removes."""
        removed = self.record.position - self.position
        share = 1.0 - 2.0 * _POSITION_FILTER * self.bandwidth * self.record.sample_time
        return float(np.sqrt(np.mean(removed**2) / max(share, 0.1)))

    @cached_property
    def usual_speed(self) -> float:
        """Root mean square [m/s]."""
        return float(np.sqrt(np.mean(self.speed**2)))

    @cached_property
    def moving(self) -> Bools:
        """Which rows (N,) are not near an end of a part nor at rest; those at rest count if 90 % are."""
        inside = np.zeros(len(self.speed), dtype=bool)
        for first, end in self.record.long_parts:
            near = min(round(1.0 / (self.bandwidth * self.record.sample_time)), (end - first) // 5)
            inside[first + near : end - near] = True
        moving = inside & (np.abs(self.speed) >= REST * self.usual_speed)
        return moving if moving.mean() > 0.1 else inside

    def force(self, *, interpolated: bool) -> Floats:
        """Return the force (N,) at the time of each row, the mean of those held before and after it."""
        force = self.record.force
        return force if interpolated else 0.5 * (force + np.append(force[0], force[:-1]))

    def lowpassed(self, values: Floats) -> Floats:
        """Return values (N,) with the filter of the regression's columns."""
        return _filtered(self.record, values, _COLUMN_FILTER * self.bandwidth)

    def block_of(self, number: int) -> Ints:
        """Return the block of time of each row (N,); records of other numbers have others."""
        return (self.record.t // BLOCK).astype(np.int64) + number * 10**6


def motion_of(record: AxisRecord) -> AxisMotion:
    """Return the motion up to 20 Hz, or less if slow or noisy; InputError if no part is long enough."""
    if not record.long_parts:
        raise InputError(f"{record.name} has no part of {LEAST_PART} rows on end; log without gaps.")
    rate = 1.0 / record.sample_time
    band = min(LARGEST_BANDWIDTH, 0.04 * rate)
    least = min(band, _LEAST_MOTIONS / record.duration)
    motion = _motion(record, band)
    density = 2.0 * motion.noise**2 / rate
    while band > least:
        noise = (2.0 * np.pi) ** 4 * density * (_COLUMN_FILTER * band) ** 5 / 5.0
        slow = _motion(record, max(least, band / _POSITION_FILTER))
        if noise <= _NOISE_SHARE * min(np.var(motion.acceleration), np.var(slow.acceleration)):
            break
        band = max(least, band / _LOWERED)
        motion = _motion(record, band)
    return motion


def _motion(record: AxisRecord, band: float) -> AxisMotion:
    position = _filtered(record, record.position, _POSITION_FILTER * band)
    speed, acceleration = np.zeros((2, len(record)))
    for first, end in record.long_parts:
        speed[first:end] = np.gradient(position[first:end], record.sample_time)
        acceleration[first:end] = np.gradient(speed[first:end], record.sample_time)
    return AxisMotion(
        record=record, bandwidth=band, position=position, speed=speed, acceleration=acceleration
    )


def _filtered(record: AxisRecord, values: Floats, cutoff: float) -> Floats:
    """Return values (N,), low-pass filtered at `cutoff` [Hz] in each part that is long enough."""
    b, a = np.asarray(scipy.signal.butter(_ORDER, 2.0 * cutoff * record.sample_time), dtype=float)
    smooth = values.copy()
    for first, end in record.long_parts:
        smooth[first:end] = scipy.signal.filtfilt(b, a, values[first:end], padlen=3 * _ORDER)
    return smooth


def speed_at_start(record: AxisRecord) -> float:
    """Return the speed [m/s] at the first row, from a cubic fitted to the first 15 rows."""
    rows = slice(0, _START_ROWS)
    return float(np.polynomial.Polynomial.fit(record.t[rows], record.position[rows], 3).deriv()(0.0))


@dataclass(frozen=True, kw_only=True, eq=False)
class InverseModel:
    """The inverse model of the moving axis, by least squares."""

    values: dict[str, float]  #: by name, those in which the force is linear; friction may be negative
    errors: dict[str, float]  #: their standard errors
    squares: float  #: sum of the squared force, less its known parts
    explained: float  #: share of it
    condition: float  #: of the columns, each of length one

    def text(self, axis_unit: str) -> str:
        """Return the parameters with their 95 % intervals, of positions in "m" or "rad"."""
        of = ((PARAMETERS[name], value, 1.96 * self.errors[name]) for name, value in self.values.items())
        return ", ".join(
            f"{kind.symbol} = {value:.3g} ± {half:.1g} {unit_for(kind, axis_unit)}"
            for kind, value, half in of
        )


def inverse_model(motions: Sequence[AxisMotion], model: AxisModel) -> InverseModel:
    """Fit the linear part of a model, without load; InputError if the records do not separate the parameters."""
    parts = [_columns(motion, model) for motion in motions]
    names = tuple(name for name in model.names if name in parts[0])
    force = np.concatenate([part["force"] for part in parts])
    X = np.column_stack([np.concatenate([part[name] for part in parts]) for name in names])
    block = np.concatenate([motion.block_of(number)[motion.moving] for number, motion in enumerate(motions)])
    lengths = np.linalg.norm(X, axis=0)
    singular, directions = np.linalg.svd(X / np.maximum(lengths, 1e-300), full_matrices=False)[1:]
    if len(X) <= len(names) or singular[0] > LARGEST_CONDITION * singular[-1]:
        mixed = np.abs(directions[-1])
        which = [name for name, share in zip(names, mixed, strict=True) if share > 0.3 * mixed.max()]
        raise InputError(
            f"{motions[0].record.name} does not separate {' and '.join(which)}: the motion is too short, too even or "
            "in one direction only. Record acceleration, deceleration and both directions at several speeds."
        )
    fit: LinearFit = fit_linear(X, force, block)
    return InverseModel(
        values=dict(zip(names, fit.values.tolist(), strict=True)),
        errors=dict(zip(names, fit.errors.tolist(), strict=True)),
        squares=float(np.sum(force**2)),
        explained=float(1.0 - np.sum(fit.residuals**2) / np.sum(force**2)),
        condition=float(singular[0] / singular[-1]),
    )


def with_gravity(motions: Sequence[AxisMotion], model: AxisModel) -> AxisModel:
    """Return the model with gravity if the axis turns far enough to identify it, otherwise the model itself."""
    if motions[0].record.unit == "m":
        return model
    wider = replace(model, forces=("gravity", *model.forces))
    try:
        return wider if inverse_model(motions, wider).condition < DISTINGUISHED else model
    except InputError:  # it turns so little that gravity is a constant force
        return model


def _columns(motion: AxisMotion, model: AxisModel) -> dict[str, Floats]:
    """Return the force, and its part by a unit of each parameter, in the moving rows (n,)."""
    position, speed = motion.position, motion.speed
    columns = {
        "mass": motion.acceleration,
        "viscous": speed,
        "coulomb": np.sign(speed),
        "offset": np.ones(len(speed)),
        "gravity_sine": np.sin(position),
        "gravity_cosine": np.cos(position),
    }
    force = motion.force(interpolated=model.interpolated)
    known = (value * columns[name] for name, value in model.known.items() if name in columns)
    columns["force"] = force - sum(known, 0.0)
    return {name: motion.lowpassed(column)[motion.moving] for name, column in columns.items()}
