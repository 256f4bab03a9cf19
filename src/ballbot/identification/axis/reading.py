"""Records of one axis from files: which column or variable is what, and what has to be done to the rows.

A file of any format of logs holds a record, as columns or named variables (docs/logs.md). The user names variables, or
writes numbers out; without a name, a variable has that of its quantity. A file gives a unit in a row below the header,
in brackets behind a column's name, or at the end of the name; it is converted unless an option gives the factor.

Rows with a missing value are left out, so that a gap remains. A position that wraps is unwrapped. If the velocity is
recorded and not the position, it is integrated.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError, either, suggest
from ballbot.findings import Finding, note, warning
from ballbot.identification.axis.record import AxisRecord, record_of_rows
from ballbot.log.columns import FACTORS, LARGEST_CELL, UNIT_OF, Columns
from ballbot.log.formats import read_variables
from ballbot.log.signals import unwrapped

#: by the unit of positions, what each quantity may be in, with the factor to its unit
_UNITS: Mapping[str, Mapping[str, Mapping[str, float]]] = {
    "m": {"position": FACTORS["m"], "velocity": FACTORS["m/s"], "force": {"N": 1.0, "kN": 1e3, "mN": 1e-3}},
    "rad": {"position": FACTORS["rad"], "velocity": FACTORS["rad/s"], "force": FACTORS["N m"]},
}
#: after what a position begins again, before its scale: a turn in either unit, and encoders' counters of 8 to 32 bits
_TURN, _DEGREES = 2.0 * np.pi, 360.0
_COUNTERS = tuple(2.0**bits for bits in range(8, 33))
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
    """The variable with the time; or the time between rows [s]: a number, or a variable of one."""

    time_scale: str | None = None
    """Factor from that variable to seconds, such as 0.001 for milliseconds: a number, or a variable of the file. If not
    given, that of the file's unit."""

    position: str | None = None
    """The variable with the position; "position" if neither it nor the velocity is given."""

    velocity: str | None = None
    """The variable with the velocity, for a file without a position."""

    position_scale: str | None = None
    """Factor from the position or the velocity to metres or radians: a number, or a variable. If not given, that of the
    file's unit."""

    force: str = "force"
    """The variable with the force, torque, current or voltage that drives the axis."""

    force_scale: str | None = None
    """Factor from that variable to newtons or newton metres, below zero if it acts the other way: a number, or a
    variable of the file. If not given, that of the file's unit."""

    added_force: str | None = None
    """The variable with an additional force on the axis, such as a measured disturbance, in newtons (newton metres)."""

    unit: Literal["m", "rad"] = "m"
    """Unit of positions: m for a sliding mass, rad for a rotating inertia."""


@dataclass(frozen=True, kw_only=True)
class _File:
    """A file's variables and their units, and the unit of positions that the user gave."""

    name: str
    variables: Columns
    units: Mapping[str, str]
    unit: str

    def column(self, name: str, option: str) -> NDArray[np.float64]:
        """Return the variable of that name (N,), which an option gives."""
        if name not in self.variables:
            hint = suggest(name, self.variables, otherwise="it has")
            raise InputError(f"{self.name} has no variable {name!r} for {option}; {hint}")
        return self.variables[name]

    def number(self, text: str, option: str, *, negative: bool) -> float:
        """Return a factor, written out or that of a constant variable."""
        try:
            value = float(text)
        except ValueError:
            values = np.unique(self.column(text, option))
            if len(values) != 1:
                raise InputError(
                    f"{self.name}, {option}: {text!r} has {len(values)} different values; it must be one number."
                ) from None
            value = float(values[0])
        if not (abs(value) <= LARGEST_CELL and (value > 0.0 or (value and negative))):
            wanted = "must not be zero" if negative else "must be above zero"
            raise InputError(f"{self.name}: {option} is {value:g}; it {wanted}.")
        return value

    def factor(self, quantity: str, name: str, scale: str | None) -> float:
        """Return the factor of a variable: the option's, or that of the file's unit."""
        if scale is not None:
            option = "position" if quantity == "velocity" else quantity
            return self.number(scale, f"--{option}-scale", negative=quantity != "time")
        other = "rad" if self.unit == "m" else "m"
        own, others = (_UNITS[unit].get(quantity, FACTORS["s"]) for unit in (self.unit, other))
        given = self.unit_of(name)
        if given in others and given not in own:
            raise InputError(
                f"{self.name} gives the unit of {name.partition('[')[0].strip()} as {given}, and --unit is "
                f"{self.unit}; give --unit {other}, or correct the unit in the file."
            )
        return own.get(given, 1.0)

    def unit_of(self, name: str) -> str:
        """Return the unit of a variable as `FACTORS` spells it; empty if the file does not give one.

        At the end of a name, as "deg" of "position_deg", single letters are no units: "position_m" may be the motor's.
        """
        text = self.units.get(name, "")
        bracketed = re.search(r"[\[(<]([^\])>]*)[\])>]$", text or name)
        unit = (bracketed.group(1) if bracketed else text).strip()
        if unit:
            return UNIT_OF.get(re.sub(r"[ ·*]", "", unit).lower(), unit)
        parts = name.lower().split("_")
        ends = ("/".join(parts[-2:]), parts[-1]) if len(parts) > 2 else parts[1:]
        return next((UNIT_OF[one] for one in ends if len(one) > 1 and one in UNIT_OF), "")


def read_axis_record(path: str | Path, columns: AxisColumns) -> AxisRecord:
    """Read a record.

    InputError if the file cannot be read, a variable is missing or is of the wrong shape, or the rows make no record.
    """
    path = Path(path)
    variables, units = read_variables(path)
    file = _File(name=path.name, variables=variables, units=units, unit=columns.unit)
    field = "velocity" if columns.position is None and columns.velocity else "position"
    name = (columns.velocity if field == "velocity" else columns.position) or "position"
    _check_names(file, {"time": columns.time, field: name, "force": columns.force})
    factors = {
        columns.time: file.factor("time", columns.time, columns.time_scale),
        name: file.factor(field, name, columns.position_scale),
        columns.force: file.factor("force", columns.force, columns.force_scale),
    }
    moved = factors[name] * file.column(name, f"--{field}")
    force = factors[columns.force] * file.column(columns.force, "--force")
    added = file.column(columns.added_force, "--added-force") if columns.added_force else np.zeros(len(force))
    t = factors[columns.time] * _times(file, columns.time, len(moved))
    kept = _complete(file.name, {"time": t, field: moved, "force": force, "the added force": added})
    if field == "velocity":
        speed, moved = moved[kept], np.full(len(t), np.nan)
        moved[kept] = np.append(0.0, np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(t[kept])))
    position, findings = without_wraps(moved, factors[name], columns.unit)
    given = (columns.time_scale, columns.position_scale, columns.force_scale)
    for (variable, factor), scale in zip(factors.items(), given, strict=True):
        if scale is None and factor != 1.0:
            text = f"{variable} is multiplied by {factor:.6g}, by its unit in the file."
            findings.append(note("axis-unit", text, variable))
    return record_of_rows(
        file.name, t[kept], (force + added)[kept], position[kept], unit=columns.unit, findings=tuple(findings)
    )


def _check_names(file: _File, names: Mapping[str, str]) -> None:
    """Raise InputError if variables are missing that the user did not name; it asks for all at once."""
    defaults = {"time": "t", "position": "position", "force": "force"}
    lacking = {
        field: name
        for field, name in names.items()
        if name == defaults.get(field) and name not in file.variables
    }
    if lacking:
        options = " ".join(f"--{field} NAME" for field in lacking)
        raise InputError(
            f"{file.name} has no variable called {either(lacking.values())}; it has {', '.join(file.variables)}. "
            f"Name what is meant: {options}"
            + (" (or --time 0.001, the time between rows)" if "time" in lacking else "")
        )


def _times(file: _File, name: str, rows: int) -> NDArray[np.float64]:
    """Return the time of each row (N,), by a variable or the interval that is given instead."""
    times = file.variables.get(name)
    if times is not None and times.size != 1:
        return times
    try:
        interval = float(name if times is None else times[0])
    except ValueError:
        return file.column(name, "--time")
    if not 0.0 < interval <= LARGEST_CELL:
        raise InputError(
            f"{file.name}: --time is {interval:g}; give the variable with the time, or the time between rows, a number "
            "above zero."
        )
    return interval * np.arange(rows, dtype=np.float64)


def _complete(name: str, columns: Columns) -> NDArray[np.bool_]:
    """Return which rows have all values (N,)."""
    rows = len(columns["time"])
    for key, values in columns.items():
        if len(values) != rows:
            raise InputError(
                f"{name}: {key} has {len(values)} values and the time has {rows}; name a column of the same length."
            )
    missing = {key: ~np.isfinite(values) for key, values in columns.items()}
    lacking = np.logical_or.reduce(list(missing.values()))
    if lacking.sum() > MOST_MISSING * rows:
        worst = max(missing, key=lambda key: missing[key].sum())
        raise InputError(
            f"{name}: {worst} is missing or not finite in row {int(np.argmax(missing[worst])) + 1}; {lacking.sum()} of "
            f"{rows} rows lack a value, and at most {100.0 * MOST_MISSING:.0f} % may."
        )
    return ~lacking


def without_wraps(
    position: NDArray[np.float64], scale: float, unit: str
) -> tuple[NDArray[np.float64], list[Finding]]:
    """Return a position (N,) in `unit` unwrapped, and findings about that; NaN stays NaN.

    `scale` is the factor that was applied to the position as it was recorded.
    """
    known = position[np.isfinite(position)]
    travel, steps = float(np.ptp(known)), np.abs(np.diff(known))
    # of a jump of two periods' size only the right one is within an ordinary step
    for period in (_TURN, _DEGREES, *(counts * abs(scale) for counts in _COUNTERS)):
        jumps = steps > 0.5 * period
        usual = float(steps[~jumps].max(initial=0.0))
        if (
            not (0.5 * period < travel <= (1.0 + _BEYOND) * period and jumps.any())
            or usual > _LARGEST_STEP * period
            # the axis moves on during the step in which it wraps
            or np.abs(steps[jumps] - period).max() > 2.0 * usual + _BEYOND * period
        ):
            continue
        size = {_TURN: "one turn", _DEGREES: "360"}.get(period, f"{period:.6g} {unit}")
        findings = [note("wrap", f"The position jumps by {size}; it is unwrapped.", "position")]
        options = [] if unit == "rad" else ["--unit rad"]
        options += [f"--position-scale {np.radians(1.0):.6g}"] if period == _DEGREES else []
        if options and period in (_TURN, _DEGREES):
            text = f"A position that jumps by {period:.4g} is an angle: {' '.join(options)}."
            findings.append(warning("axis-unit", text, "position"))
        return unwrapped(position, period=period), findings
    return position, []
