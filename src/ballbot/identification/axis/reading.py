"""Records of one axis from files: which column or variable is what, and what has to be done to the rows.

A file of any format of logs holds a record, as columns or named variables (docs/logs.md). The user names variables, or
writes numbers out; without a name, a variable has that of its quantity. A file gives a unit in a row below the header,
in brackets behind a column's name, or at the end of the name.

Rows at uneven times are kept with their times. Rows with a missing value are left out, so that a gap remains. A
position that wraps is unwrapped. An axis whose velocity is recorded and not its position has the position that the
velocity gives by integration.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError, either, suggest
from ballbot.identification.axis.record import EVEN, AxisRecord
from ballbot.log.columns import FACTORS, LARGEST_CELL, Columns
from ballbot.log.formats import read_units, read_variables
from ballbot.log.signals import unwrapped

#: by the unit of positions, what each quantity may be in, with the factor to its unit
_FORCES = {"N": 1.0, "kN": 1e3, "mN": 1e-3}
_TORQUES = {**FACTORS["N m"], "kN m": 1e3}
_QUANTITIES = {
    "time": {"m": FACTORS["s"], "rad": FACTORS["s"]},
    "position": {"m": FACTORS["m"], "rad": FACTORS["rad"]},
    "velocity": {"m": FACTORS["m/s"], "rad": FACTORS["rad/s"]},
    "force": {"m": _FORCES, "rad": _TORQUES},
}
#: other spellings of units
_SPELLINGS = {
    "Nm": "N m",
    "mNm": "mN m",
    "Ncm": "N cm",
    "kNm": "kN m",
    "µs": "us",
    "μs": "us",
    "°": "deg",
    "rev": "turn",
}


TURN, DEGREES = 2.0 * np.pi, 360.0
#: bits of encoders' counters
_BITS = (8, 10, 12, 13, 14, 15, 16, 17, 18, 20, 24, 32)
#: an ordinary step is at most this share of the period; a jump differs from the period by no more than such a step
_LARGEST_STEP = 0.25
#: noise and rounding let a position that wraps cover so much more than its period, and a jump that much more, too
_BEYOND = 0.01
#: a record in which more rows than this share lack a value is refused
MOST_MISSING = 0.2


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
    """Factor from the position or the velocity to metres or radians: a number, or a variable."""

    force: str = "force"
    """The variable with the force, torque, current or voltage that drives the axis."""

    force_scale: str = "1"
    """Factor from that variable to newtons or newton metres, below zero if it acts the other way: a number, or a
    variable of the file."""

    added_force: str | None = None
    """The variable with an additional force on the axis, such as a measured disturbance, in newtons (newton metres)."""

    unit: Literal["m", "rad"] = "m"
    """Unit of positions: m for a sliding mass, rad for a rotating inertia."""


@dataclass(frozen=True, kw_only=True)
class AxisFile:
    """A file's variables and which of them the user named, each by its field of `AxisColumns`."""

    name: str
    variables: Columns
    columns: AxisColumns

    def column(self, field: str, *, default: str = "") -> NDArray[np.float64]:
        """Return the variable that an option names, or `default` if the option is not given (N,)."""
        return self._variable(getattr(self.columns, field) or default, option_of(field))

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


#: words of names that such a variable often has, the plainest first
_USUAL_NAMES = {
    "time": ("time", "t", "timestamp", "stamp", "seconds", "sec"),
    "position": ("position", "pos", "angle", "q", "qm", "theta", "phi", "x"),
    "force": ("force", "torque", "tau", "effort", "f", "current", "voltage", "u", "i"),
}


def check_names(file: AxisFile) -> None:
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


def check_units(file: AxisFile, units: Mapping[str, str]) -> None:
    """Raise InputError if a unit in the file contradicts `--unit`, or needs a factor and none is given."""
    for field, kinds in _QUANTITIES.items():
        name = getattr(file.columns, field) or ("position" if file.columns.velocity is None else "")
        scale = f"{'position' if field == 'velocity' else field}_scale"
        if name not in file.variables or file.number(scale) != 1.0:
            continue
        given = _unit_of(name, units) or _unit_at_end(name, {**kinds["m"], **kinds["rad"]})
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


def _unit_of(name: str, units: Mapping[str, str]) -> str:
    """Return the unit of a variable as `FACTORS` spells it; empty if the file does not give it."""
    text = units.get(name, "")
    bracketed = re.search(r"[\[(<]([^\])>]*)[\])>]$", text or name)
    unit = (bracketed.group(1) if bracketed else text).strip().replace("·", " ").replace("*", " ")
    return _SPELLINGS.get(unit, unit)


def _unit_at_end(name: str, known: Collection[str]) -> str:
    """Return the unit among those known that a name ends in, such as "deg" of "position_deg"; empty if in none.

    Single letters are no units: "position_m" may be that of the motor.
    """
    parts = name.split("_")
    ends = ("/".join(parts[-2:]), parts[-1]) if len(parts) > 2 else tuple(parts[1:])
    spelled = {one.replace(" ", "").lower(): one for one in known} | {
        spelling.lower(): unit for spelling, unit in _SPELLINGS.items() if unit in known
    }
    return next((spelled[one.lower()] for one in ends if len(one) > 1 and one.lower() in spelled), "")


def read_axis_record(path: str | Path, columns: AxisColumns) -> AxisRecord:
    """Read a record.

    Raises
    ------
    InputError
        If the file cannot be read, a variable is missing or is of the wrong shape, or the rows make no record.
    """
    file = AxisFile(name=Path(path).name, variables=read_variables(path), columns=columns)
    check_names(file)
    check_units(file, read_units(path))
    t = file.factor("time_scale", negative=False) * _times(file)
    forces = [file.factor("force_scale") * file.column("force")]
    forces += [file.column("added_force")] if columns.added_force else []
    scale = file.factor("position_scale")
    rows = {"time": t, "force": forces[0], "the added force": forces[-1]}
    rows["position"] = scale * _position(file, t)
    kept = _complete(file.name, rows)
    sample_time, times = sampling(file.name, t[kept])
    position, wrap = without_wraps(rows["position"], scale)
    return AxisRecord(
        name=file.name,
        sample_time=sample_time,
        force=np.sum(forces, axis=0)[kept],
        position=position[kept],
        unit=columns.unit,
        times=times,
        wrap=wrap,
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


def _times(file: AxisFile) -> NDArray[np.float64]:
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


def _position(file: AxisFile, t: NDArray[np.float64]) -> NDArray[np.float64]:
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


def without_wraps(position: NDArray[np.float64], scale: float) -> tuple[NDArray[np.float64], float]:
    """Return a position (N,) unwrapped, NaN where it is NaN, and the period after which it begins again, zero if never.

    Parameters
    ----------
    position : ndarray (N,)
        May contain NaN.
    scale : float
        Factor that was applied to the position as it was recorded.
    """
    known = position[np.isfinite(position)]
    travel, steps = float(np.ptp(known)), np.abs(np.diff(known))
    counters = [2.0**bits * abs(scale) for bits in _BITS]
    # of a jump of two periods' size only the right one is within an ordinary step
    for period in (TURN, DEGREES, *counters):
        if not 0.5 * period < travel <= (1.0 + _BEYOND) * period:
            continue
        jumps = steps > 0.5 * period
        usual = float(steps[~jumps].max(initial=0.0))
        if not jumps.any() or usual > _LARGEST_STEP * period:
            continue
        # the axis moves on during the step in which it wraps
        if np.abs(steps[jumps] - period).max() <= 2.0 * usual + _BEYOND * period:
            return unwrapped(position, period=period), period
    return position, 0.0
