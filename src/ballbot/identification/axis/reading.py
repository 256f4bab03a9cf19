"""Records of one axis from files: which column or variable is what, and what has to be done to the rows.

A file of any format of logs holds a record, as columns or named variables (docs/logs.md). Rows at uneven times are kept
with their times. Rows with a missing value are left out, so that a gap remains. A position that wraps is unwrapped. An
axis whose velocity is recorded and not its position has the position that the velocity gives by integration.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError, either, suggest
from ballbot.identification.axis.record import (
    EVEN,
    NO_WRAPS,
    AxisRecord,
    KnownLoad,
    PositionVelocityLoop,
    Wraps,
)
from ballbot.identification.axis.spikes import without_spikes
from ballbot.identification.axis.units import QUANTITIES, unit_at_end, unit_of
from ballbot.identification.axis.wrapping import without_wraps, wrapping_period
from ballbot.log.columns import LARGEST_CELL, Columns
from ballbot.log.formats import read_units, read_variables

#: a record in which more rows than this share lack a value is refused
MOST_MISSING = 0.2
_GRAVITY = 9.81
#: a force beyond so many times its limit exceeds it by more than noise
_BEYOND_LIMIT = 1.02


@dataclass(frozen=True, kw_only=True)
class AxisColumns:
    """The variables of a file. A number is written out, or is the name of a variable or of a constant column."""

    time: str = "t"
    """The variable with the time, in seconds; or the time between rows: a number, or a variable of one."""

    time_scale: str = "1"
    """Factor from that variable to seconds, such as 0.001 for milliseconds: a number, or a variable of the file."""

    position: str | None = None
    """The variable with the position, in metres or radians; "position" if neither it nor the velocity is given."""

    velocity: str | None = None
    """The variable with the velocity, in metres or radians per second, for a file without a position."""

    position_scale: str = "1"
    """Factor from the position, the velocity and the reference to metres or radians: a number, or a variable."""

    force: str = "force"
    """The variable with the force, torque, current or voltage that drives the axis, or a number such as 0."""

    force_scale: str = "1"
    """Factor from that variable to newtons or newton metres: a number, or a variable of the file."""

    added_force: str | None = None
    """The variable with an additional force on the axis, such as a measured disturbance, in newtons (newton metres)."""

    added_force_scale: str = "1"
    """Factor from that variable to newtons or newton metres, -1 if it acts the other way: a number, or a variable."""

    reference: str | None = None
    """The variable with the reference of the position; with both gains, the closed loop is simulated as well, in
    the example with: --reference qg --position-gain kp --velocity-gain kv."""

    position_gain: str | None = None
    """Position gain of the loop, in 1/s: a number, or a variable of the file."""

    velocity_gain: str | None = None
    """Velocity gain of the loop, from velocity to the force variable: a number, or a variable of the file."""

    limit: str | None = None
    """Limit of the force variable, beyond which the force does not act: a number, or a variable of the file."""

    unit: Literal["m", "rad"] = "m"
    """Unit of positions: m for a sliding mass, rad for a rotating inertia."""

    temperature: str | None = None
    """The variable with a temperature, which residuals are tested against."""

    load: str | None = None
    """The variable with what loads the bearings, which residuals are tested against."""

    load_mass: str = "0"
    """Known mass of a load, in kg: a number or a variable; one for each record, separated by commas, if they differ."""

    load_arm: str = "0"
    """Distance of the load from an axis that turns, in metres: a number or a variable, or one for each record."""

    hanging: str = "0"
    """The angle at which that load hangs straight down, in radians: a number or a variable."""


def read_axis_records(paths: Sequence[str | Path], columns: AxisColumns) -> list[AxisRecord]:
    """Read records that have the same columns; numbers given for each are taken in the records' order.

    Raises
    ------
    InputError
        If a file cannot be read, a variable is missing or is of the wrong shape, or the rows make no record.
    """
    return [
        read_axis_record(path, _columns_of(columns, place, len(paths))) for place, path in enumerate(paths)
    ]


def _columns_of(columns: AxisColumns, place: int, count: int) -> AxisColumns:
    """Return the columns of the record at `place`."""

    def own(text: str, option: str) -> str:
        parts = [part.strip() for part in text.split(",")]
        if len(parts) == 1:
            return text
        if len(parts) != count:
            records = f"{count} record{'s' if count > 1 else ''}"
            raise InputError(
                f"{option} has {len(parts)} values for {records}; give one for all, or one for each."
            )
        return parts[place]

    return replace(
        columns,
        load_mass=own(columns.load_mass, "--load-mass"),
        load_arm=own(columns.load_arm, "--load-arm"),
    )


@dataclass(frozen=True, kw_only=True)
class _File:
    """A file's variables and which of them the user named, each by its field of `AxisColumns`."""

    name: str
    variables: Columns
    columns: AxisColumns

    def column(self, field: str, *, default: str = "") -> NDArray[np.float64]:
        """Return the variable that an option names, or `default` if the option is not given (N,)."""
        return self._variable(getattr(self.columns, field) or default, option_of(field))

    def optional(self, field: str) -> NDArray[np.float64] | None:
        """Return the variable that an option names (N,), None if the option is not given."""
        return None if getattr(self.columns, field) is None else self.column(field)

    def number(self, field: str) -> float:
        """Return an option's number, written out or that of a constant variable."""
        text, option = getattr(self.columns, field), option_of(field)
        try:
            value = float(text)
        except ValueError:
            values = self._variable(text, option)
            if values.size == 0 or np.ptp(values) != 0.0:
                fault = f"has {values.size} different values" if values.size else "is empty"
                raise InputError(f"{self.name}, {option}: {text!r} {fault}; it must be one number.") from None
            value = float(values[0])
        if not abs(value) <= LARGEST_CELL:
            raise InputError(f"{self.name}: {option} is {value:g}; it must be a finite number.")
        return value

    def factor(self, field: str, *, negative: bool = True) -> float:
        """Return an option's number, which must not be zero, nor below zero unless it may be negative."""
        value = self.number(field)
        if value == 0.0 or (value < 0.0 and not negative):
            wanted = "must not be zero" if negative else "must be above zero"
            raise InputError(f"{self.name}: {option_of(field)} is {value:g}; it {wanted}.")
        return value

    def _variable(self, wanted: str, option: str) -> NDArray[np.float64]:
        if wanted not in self.variables:
            hint = suggest(wanted, self.variables, otherwise="it has")
            raise InputError(f"{self.name} has no variable {wanted!r} for {option}; {hint}")
        return self.variables[wanted]


def option_of(field: str) -> str:
    """Return the option of the command line that a field is: "--time-scale" of "time_scale"."""
    return f"--{field.replace('_', '-')}"


def read_axis_record(path: str | Path, columns: AxisColumns) -> AxisRecord:
    """Read a record.

    Raises
    ------
    InputError
        If the file cannot be read, a variable is missing or is of the wrong shape, or the rows make no record.
    """
    file = _File(name=Path(path).name, variables=read_variables(path), columns=columns)
    _check_names(file)
    _check_units(file, read_units(path))
    t = file.factor("time_scale", negative=False) * _times(file)
    scale = file.factor("force_scale")
    driving = _driving_force(file, len(t))
    limit = np.inf if columns.limit is None else file.factor("limit", negative=False)
    # a force beyond the limit was demanded and does not act
    force = scale * np.clip(driving, -limit, limit)
    beyond = float(np.mean(np.abs(driving) > _BEYOND_LIMIT * limit))
    added = file.optional("added_force")
    if added is not None:
        added = file.factor("added_force_scale") * added
        force = force + added if added.shape == force.shape else force
    position, reference, wraps = _measured_motion(file, t)
    rows = {
        "time": t,
        "force": force,
        "position": position,
        "reference": reference,
        "the added force": added,
        "temperature": file.optional("temperature"),
        "load": file.optional("load"),
    }
    kept = _complete(file.name, {key: values for key, values in rows.items() if values is not None})
    t, force, position, reference, added, temperature, load = (
        None if values is None else values[kept] for values in rows.values()
    )
    assert t is not None and force is not None and position is not None  # noqa: PT018 (for types)
    sample_time, times = sampling(file.name, t)
    record = AxisRecord(
        name=file.name,
        sample_time=sample_time,
        force=force,
        position=position,
        reference=reference,
        unit=columns.unit,
        added=added,
        times=times,
        temperature=temperature,
        load=load,
        known_load=_known_load(file),
        beyond_limit=beyond,
        wraps=wraps,
    )
    record = without_spikes(record)
    loop = _loop(file, scale, limit)
    if loop is None:
        return record
    if reference is None:
        raise InputError(
            f"{file.name}: the gains of the loop need the column of the reference as well; give --reference."
        )
    if not record.even:
        raise InputError(
            f"{file.name}: rows come at uneven times, and the closed loop is simulated at even ones; "
            "leave out the gains."
        )
    return replace(record, loop=_with_span(record, reference, loop))


#: words of names that such a variable often has, the plainest first
_USUAL_NAMES = {
    "time": ("time", "t", "timestamp", "stamp", "seconds", "sec"),
    "position": ("position", "pos", "angle", "q", "qm", "theta", "phi", "x"),
    "force": ("force", "torque", "tau", "effort", "f", "current", "voltage", "u", "i"),
}


def _check_names(file: _File) -> None:
    """Raise InputError if a variable that a record must have is missing and not named, with what may be meant."""
    columns = file.columns
    lacking = {
        field: getattr(columns, field) or field
        for field, absent in (
            ("time", columns.time == AxisColumns.time),
            ("position", columns.position is None and columns.velocity is None),
            ("force", columns.force == AxisColumns.force),
        )
        if absent and (getattr(columns, field) or field) not in file.variables
    }
    if lacking:
        options = [
            f"{option_of(field)} {shlex.quote(_usual(field, file.variables) or 'NAME')}" for field in lacking
        ]
        raise InputError(
            f"{file.name} has no variable called {either(lacking.values())}; it has {', '.join(file.variables)}. "
            f"Name what is meant, perhaps with {' '.join(options)}"
            + (" (or --time 0.001, the time between rows)" if "--time NAME" in options else "")
        )


def _usual(field: str, variables: Collection[str]) -> str | None:
    """Return the variable whose name has the plainest of the usual words for a quantity; None if none has any."""
    words = {name: re.split(r"[^a-z]+", name.lower()) for name in variables}
    return next((name for word in _USUAL_NAMES[field] for name in words if word in words[name]), None)


def _check_units(file: _File, units: Mapping[str, str]) -> None:
    """Raise InputError if a unit in the file contradicts `--unit`, or needs a factor and none is given.

    A file gives a unit in a row below the header, in brackets behind a column's name, or at the end of the name.
    """
    for field, kinds in QUANTITIES.items():
        name = getattr(file.columns, field) or ("position" if file.columns.velocity is None else "")
        scale = f"{'position' if field == 'velocity' else field}_scale"
        if name not in file.variables or file.number(scale) != 1.0:
            continue
        given = unit_of(name, units) or unit_at_end(name, {**kinds["m"], **kinds["rad"]})
        unit = file.columns.unit
        other = "rad" if unit == "m" else "m"
        actual = next((one for one in (unit, other) if given in kinds[one]), unit)
        factor = kinds[actual].get(given, 1.0)
        options = [f"--unit {actual}"] if actual != unit else []
        options += [f"{option_of(scale)} {factor:.12g}"] if factor != 1.0 else []
        if options:
            against = f"--unit is {unit}" if actual != unit else f"{option_of(scale)} is 1"
            raise InputError(
                f"{file.name} gives the unit of {name.partition('[')[0].strip()} as {given}, and {against}; "
                f"give {' '.join(options)}, or correct the unit in the file."
            )


def sampling(name: str, t: NDArray[np.float64]) -> tuple[float, NDArray[np.float64] | None]:
    """Return the sample time [s] of rows at times t (N,), and the times themselves if they are uneven.

    Raises
    ------
    InputError
        If time does not increase from row to row.
    """
    if len(t) < 2:
        raise InputError(f"{name}: the time has fewer than two rows.")
    steps = np.diff(t)
    if steps.min() <= 0.0:
        row = int(np.argmin(steps)) + 2
        raise InputError(
            f"{name}, row {row}: time does not increase ({t[row - 1]:.12g} after {t[row - 2]:.12g} s). "
            "Sort the rows, leave out repeated ones, or split the file."
        )
    mean = float(t[-1] - t[0]) / len(steps)
    if np.abs(steps - mean).max() <= EVEN * mean:
        return mean, None
    return float(np.median(steps)), t


def _complete(name: str, columns: Columns) -> NDArray[np.bool_]:
    """Return which rows have all values (N,)."""
    rows = len(columns["time"])
    for key, values in columns.items():
        if len(values) != rows:
            raise InputError(
                f"{name}: {key} has {len(values)} values and the time has {rows}; name a column of the same length."
            )
    kept = np.logical_and.reduce([np.isfinite(values) for values in columns.values()])
    missing = rows - int(kept.sum())
    if missing > MOST_MISSING * rows:
        worst = max(columns, key=lambda key: np.count_nonzero(~np.isfinite(columns[key])))
        row = int(np.flatnonzero(~np.isfinite(columns[worst]))[0]) + 1
        raise InputError(
            f"{name}: {worst} is missing or not finite in row {row}; {missing} of {rows} rows lack a value, "
            f"and at most {100.0 * MOST_MISSING:.0f} % may."
        )
    return kept


def _times(file: _File) -> NDArray[np.float64]:
    """Return the time of each row (N,): a variable, or rows at the interval that is given instead."""
    times = file.variables.get(file.columns.time)
    if times is not None and times.size != 1:
        return times
    try:
        interval = float(file.columns.time if times is None else times[0])
    except ValueError:
        return file.column("time")
    if not 0.0 < interval <= LARGEST_CELL:
        raise InputError(
            f"{file.name}: --time is {interval:g}; give the variable with the time, or the time between rows, a number "
            "above zero."
        )
    positions = "position" if file.columns.velocity is None or file.columns.position else "velocity"
    return interval * np.arange(len(file.column(positions, default="position")), dtype=np.float64)


def _driving_force(file: _File, rows: int) -> NDArray[np.float64]:
    if file.columns.force not in file.variables:
        try:
            value = float(file.columns.force)
        except ValueError:
            return file.column("force")
        if abs(value) <= LARGEST_CELL:
            return np.full(rows, value)
    return file.column("force")


def _position(file: _File, t: NDArray[np.float64]) -> NDArray[np.float64]:
    if file.columns.position is not None or file.columns.velocity is None:
        return file.column("position", default="position")
    velocity = file.column("velocity")
    if len(velocity) != len(t):
        raise InputError(
            f"{file.name}: the velocity has {len(velocity)} values and the time has {len(t)}; "
            "name a column of the same length."
        )
    known = np.isfinite(velocity) & np.isfinite(t)
    if known.sum() < 2:
        raise InputError(f"{file.name}: the velocity has fewer than two values.")
    whole = np.interp(np.arange(len(t)), np.flatnonzero(known), velocity[known])
    clock = np.interp(np.arange(len(t)), np.flatnonzero(known), t[known])
    travelled = np.append(0.0, np.cumsum(0.5 * (whole[1:] + whole[:-1]) * np.diff(clock)))
    return np.where(known, travelled, np.nan)


def _measured_motion(
    file: _File, t: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64] | None, Wraps]:
    """Return position and reference (N,) unwrapped, and how often the position wrapped."""
    scale = file.factor("position_scale")
    position, reference = scale * _position(file, t), file.optional("reference")
    reference = None if reference is None else scale * reference
    period = wrapping_period(position, scale)
    if not period:
        return position, reference, NO_WRAPS
    position, count = without_wraps(position, period)
    if reference is not None and wrapping_period(reference, scale) == period:
        reference, _ = without_wraps(reference, period)
        if reference.shape == position.shape:
            # both may begin in different turns
            reference = reference - period * np.round(np.nanmedian(reference - position) / period)
    return position, reference, Wraps(count=count, period=period)


def _known_load(file: _File) -> KnownLoad:
    mass = file.number("load_mass")
    if mass < 0.0:
        raise InputError(f"{file.name}: --load-mass is {mass:g}; it must be zero or more.")
    if mass == 0.0:
        return KnownLoad()
    if file.columns.unit == "m":
        return KnownLoad(inertia=mass)
    arm = file.number("load_arm")
    if not arm > 0.0:
        raise InputError(
            f"{file.name}: a load on an axis that turns needs a distance from it above zero, not {arm:g} m; "
            "give --load-arm."
        )
    return KnownLoad(inertia=mass * arm**2, weight=mass * _GRAVITY * arm, hanging=file.number("hanging"))


def _loop(file: _File, scale: float, limit: float) -> PositionVelocityLoop | None:
    columns = file.columns
    if columns.position_gain is None and columns.velocity_gain is None:
        return None
    if columns.position_gain is None or columns.velocity_gain is None:
        raise InputError("The loop needs both gains; give --position-gain and --velocity-gain.")
    if scale < 0.0:
        raise InputError(
            f"{file.name}: --force-scale is {scale:g}; with the gains of a loop it must be above zero. "
            "Negate the force in the file, or leave out the gains."
        )
    return PositionVelocityLoop(
        position_gain=file.factor("position_gain", negative=False),
        velocity_gain=file.factor("velocity_gain", negative=False),
        force_per_input=scale,
        limit=limit,
    )


def _with_span(
    record: AxisRecord, reference: NDArray[np.float64], loop: PositionVelocityLoop
) -> PositionVelocityLoop:
    """Return the loop with the span, 1 to 4 samples, that reproduces the force recorded best."""

    def error(span: int) -> float:
        velocity = (record.position[span:] - record.position[:-span]) / (span * record.sample_time)
        aim = loop.position_gain * (reference - record.position)[span:]
        u = np.clip(loop.velocity_gain * (aim - velocity), -loop.limit, loop.limit)
        return float(np.std(loop.force_per_input * u - record.loop_force[span:]))

    return replace(loop, span=min(range(1, 5), key=error))
