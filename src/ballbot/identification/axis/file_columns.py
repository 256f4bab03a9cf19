"""Which variables of a file a record of one axis is made of: their names, and the units that the file gives.

The user names variables, or writes numbers out; without a name, a variable has that of its quantity. A file gives a
unit in a row below the header, in brackets behind a column's name, or at the end of the name.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError, either, suggest
from ballbot.log.columns import FACTORS, LARGEST_CELL, Columns

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


@dataclass(frozen=True, kw_only=True)
class AxisFile:
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
