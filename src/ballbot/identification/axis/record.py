"""Records of one axis, and their reading from files.

The axis is   M a = F - offset - G(q) - friction(v)   with F held over a row. For an axis that turns, M is an inertia
[kg m^2], forces are torques [N m] and positions angles [rad]. Rows are even; uneven ones are interpolated. Gaps
divide the record into parts, and no prediction runs across one. Rows with a missing value are left out, which leaves a
gap. A unit in a file is converted unless an option gives the factor, a position that wraps is unwrapped, and a velocity
without a position is integrated.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np

from ballbot.arrays import Bools, Floats, positive_number, real_array
from ballbot.errors import InputError, about, check_known, either
from ballbot.findings import Finding, error, note, warning
from ballbot.log.columns import FACTORS, LARGEST_CELL, UNITS, Columns, given_names
from ballbot.log.formats import read_variables
from ballbot.log.mapping_search.names import unit_in_name
from ballbot.log.row_order import check_time, rows_with_times
from ballbot.log.signals import unwrapped
from ballbot.log.units import change_agreement, integrated, unit_of_ratio
from ballbot.log.wrapping import COUNTERS, TURNS, wrap_period

#: least rows of a record
LEAST_ROWS = 200
#: largest deviation of an interval from the usual one, as a share of it, in even rows
EVEN = 0.05
#: shortest gap, over the usual interval
GAP = 4.0
#: least rows of a part between gaps that is used
LEAST_PART = 30
#: largest share of rows that lack a value
MOST_MISSING = 0.2


@dataclass(frozen=True, kw_only=True, eq=False)
class AxisRecord:
    """A record of one axis with even rows; `record_of_rows` makes one from rows at any times.

    InputError if lengths differ, values are missing, the axis never moves, or there are too few rows.

    >>> t = 0.01 * np.arange(300)
    >>> record = AxisRecord(name="slide", sample_time=0.01, force=np.cos(t), position=np.sin(t))
    >>> len(record), record.duration, record.force_unit
    (300, 3.0, 'N')
    """

    name: str
    sample_time: float  #: h [s]
    force: Floats  #: (N,) F [N], held from each row to the next
    position: Floats  #: (N,) [m]
    unit: Literal["m", "rad"] = "m"
    times: Floats | None = None  #: (N,) [s] if there are gaps
    even: bool = True  #: whether the original rows were evenly spaced
    findings: tuple[Finding, ...] = ()  #: on how the file was read

    def __post_init__(self) -> None:
        positive_number(self.sample_time, f"{self.name}: the sample time")
        for name in ("force", "position", *(() if self.times is None else ("times",))):
            # contiguous and writable, as compiled code takes it
            values = real_array(getattr(self, name), (np.size(self.force),), f"{self.name}: {name}")
            object.__setattr__(self, name, values)
        if len(self) < LEAST_ROWS:
            raise InputError(f"{self.name} has {len(self)} rows; at least {LEAST_ROWS} are needed.")
        if np.ptp(self.position) == 0.0:
            raise InputError(
                f"{self.name}: the position never changes, so friction cannot be identified; check its column."
            )

    def __len__(self) -> int:
        return len(self.force)

    @cached_property
    def t(self) -> Floats:
        """Time from the record's start (N,) [s]."""
        if self.times is not None:
            return self.times - self.times[0]
        return self.sample_time * np.arange(len(self), dtype=np.float64)

    @cached_property
    def parts(self) -> tuple[tuple[int, int], ...]:
        """First row and row after the last of each part between gaps."""
        ends = np.flatnonzero(np.diff(self.t) > GAP * self.sample_time) + 1
        return tuple(pairwise((0, *ends.tolist(), len(self))))

    @property
    def long_parts(self) -> list[tuple[int, int]]:
        """The parts that are long enough to be used."""
        return [(first, end) for first, end in self.parts if end - first >= LEAST_PART]

    @property
    def duration(self) -> float:
        """From the first row to the end of the last one [s]."""
        return float(self.t[-1] + self.sample_time)

    @property
    def force_unit(self) -> str:
        """[N], or [N m] for an axis that turns."""
        return "N" if self.unit == "m" else "N m"


def record_of_rows(
    name: str,
    t: Floats,
    force: Floats,
    position: Floats,
    *,
    unit: Literal["m", "rad"] = "m",
    findings: tuple[Finding, ...] = (),
) -> AxisRecord:
    """Return the record of rows at times t (N,) [s]; uneven rows are interpolated in each part between gaps.

    InputError if time does not increase from row to row, or the rows do not make a record.

    >>> t = np.sort(np.random.default_rng(0).uniform(0.0, 5.0, 500))
    >>> record_of_rows("slide", t, np.cos(t), np.sin(t)).even
    False
    """
    if len(t) < 2:
        raise InputError(f"{name}: the time has fewer than two rows.")
    with about(name):
        check_time(t)
    steps = np.diff(t)
    usual = float(np.median(steps))
    gaps = steps > GAP * usual
    mean = float(np.mean(steps[~gaps]))
    even = bool(np.abs(steps[~gaps] - mean).max() <= EVEN * mean)
    h = mean if even else usual
    times = []
    for first, end in pairwise((0, *(np.flatnonzero(gaps) + 1).tolist(), len(t))):
        count = end - first if even else int((t[end - 1] - t[first]) / h + 1e-9) + 1
        times.append(t[first] + h * np.arange(count))
    rows = np.concatenate(times)
    return AxisRecord(
        name=name,
        sample_time=h,
        force=force if even else np.interp(rows, t, force),
        position=position if even else np.interp(rows, t, position),
        unit=unit,
        times=rows if gaps.any() else None,
        even=even,
        findings=findings,
    )


@dataclass(frozen=True, kw_only=True)
class AxisColumns:
    """The variables of a file. A number is written out, or is the name of a constant variable.

    >>> AxisColumns(time="0.001", position="angle", force="torque", unit="rad").force
    'torque'
    """

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

    columns: str | None = None
    """The names of a text's columns in its order, with commas between, for a file without a header: t,position,force.
    Write _ for a column that is not needed."""


#: by the unit of positions: the units of each quantity, with the factor to SI units
_UNITS: Mapping[str, Mapping[str, Mapping[str, float]]] = {
    "m": {"position": FACTORS["m"], "velocity": FACTORS["m/s"], "force": {"N": 1.0, "kN": 1e3, "mN": 1e-3}},
    "rad": {"position": FACTORS["rad"], "velocity": FACTORS["rad/s"], "force": FACTORS["N m"]},
}


@dataclass(frozen=True, kw_only=True)
class _File:
    """The variables of a file with their units, and the unit of positions that the user gave."""

    name: str
    variables: Columns
    units: Mapping[str, str]
    unit: str

    def column(self, name: str, option: str) -> Floats:
        """Return the variable (N,) that an option names."""
        sentence = f"{self.name} has no variable {name!r} for {option}"
        check_known(name, self.variables, sentence, otherwise="it has")
        return self.variables[name]

    def number(self, text: str, option: str) -> float:
        """Return a number, written out or from a constant variable; one of the time must be above zero."""
        try:
            value = float(text)
        except ValueError:
            values = np.unique(self.column(text, option))
            if len(values) != 1:
                raise InputError(
                    f"{self.name}, {option}: {text!r} has {len(values)} different values; it must be one number."
                ) from None
            value = float(values[0])
        wanted = {"--time": "give the variable with the time, or the time between rows, a number above zero"}
        wanted |= {"--time-scale": "it must be above zero"}
        if not 0.0 < abs(value) <= LARGEST_CELL or (option in wanted and value < 0.0):
            text = wanted.get(option, "it must not be zero")
            raise InputError(f"{self.name}: {option} is {value:g}; {text}.")
        return value

    def units_of(self, quantity: str) -> Mapping[str, float]:
        """Return the units that a quantity may have, with their factors; Ballbot's own is the first."""
        return _UNITS[self.unit].get(quantity, FACTORS["s"])

    def factor(self, quantity: str, name: str, scale: str | None) -> float:
        """Return the factor of a variable, from the option or the unit in the file; 1 if neither converts it."""
        if scale is not None:
            return self.number(scale, _option(quantity))
        other, given = "rad" if self.unit == "m" else "m", self.unit_of(name)
        if given not in self.units_of(quantity) and given in _UNITS[other].get(quantity, ()):
            raise InputError(
                f"{self.name} gives the unit of {name.partition('[')[0].strip()} as {given}, and --unit is "
                f"{self.unit}; give --unit {other}, or correct the unit in the file."
            )
        return self.units_of(quantity).get(given, 1.0)

    def unit_of(self, name: str) -> str:
        """Return the unit of a variable by the row of units below it or its name; empty if the file gives none."""
        row = self.units.get(name, "").strip("[](){}<> ")
        return unit_in_name(f"[{row}]" if row else name) or ""

    def unit_finding(self, quantity: str, name: str) -> Iterator[Finding]:
        """Find the unit of a variable without an option's factor: one that is converted, or that cannot be."""
        given, units = self.unit_of(name), self.units_of(quantity)
        if units.get(given, 1.0) != 1.0:
            yield note("unit", f"{name} is multiplied by {units[given]:.6g}, by its unit in the file.", name)
        elif given in UNITS and given not in units:
            text = f"{name} is in {given}: give how many {next(iter(units))} one is by {_option(quantity)}."
            yield error("unit", text, name)


def _option(quantity: str) -> str:
    return f"--{'position' if quantity == 'velocity' else quantity}-scale"


def read_axis_record(path: str | Path, columns: AxisColumns) -> AxisRecord:
    """Read a record from a file.

    InputError if the file cannot be read, a variable is missing or has the wrong shape, or the rows do not make a
    record.

    >>> t = 0.01 * np.arange(300)
    >>> rows = np.column_stack([t, np.cos(t), 1e3 * np.sin(t)])
    >>> np.savetxt("slide.csv", rows, delimiter=",", header="t,force,position_mm", comments="")
    >>> record = read_axis_record("slide.csv", AxisColumns(position="position_mm"))
    >>> float(np.ptp(record.position).round(1))  # [m]
    1.0
    """
    path = Path(path)
    table = read_variables(path, names=given_names(columns.columns))
    table.need_names(path, "t,position,force")
    notes, variables = list(table.notes), {**table.columns}
    if columns.time in variables and len({*map(len, variables.values())}) == 1:
        variables = rows_with_times(variables, columns.time, notes)
    file = _File(name=path.name, variables=variables, units=table.units, unit=columns.unit)
    motion = "velocity" if columns.position is None and columns.velocity else "position"
    moving = getattr(columns, motion) or "position"
    names = {"time": columns.time, motion: moving, "force": columns.force}
    # all missing default variables are named in one message
    defaults = {"time": "t", "position": "position", "force": "force"}.items()
    if lacking := {
        key: name for key, name in defaults if names.get(key) == name and name not in file.variables
    }:
        raise InputError(
            f"{file.name} has no variable called {either(lacking.values())}; it has {', '.join(file.variables)}. "
            f"Name what is meant: {' '.join(f'--{key} NAME' for key in lacking)}"
            + (" (or --time 0.001, the time between rows)" if "time" in lacking else "")
        )
    given = dict(zip(names, (columns.time_scale, columns.position_scale, columns.force_scale), strict=True))
    factors = {key: file.factor(key, name, given[key]) for key, name in names.items()}
    values = factors[motion] * file.column(moving, f"--{motion}")
    force = factors["force"] * file.column(columns.force, "--force")
    added = file.column(columns.added_force, "--added-force") if columns.added_force else np.zeros(len(force))
    t = variables.get(columns.time, np.empty(1))
    if t.size == 1:  # the interval between rows
        t = file.number(columns.time, "--time") * np.arange(len(values), dtype=np.float64)
    t = factors["time"] * t
    rows = _complete_rows(file.name, {"time": t, motion: values, "force": force, "the added force": added})
    t, values, force = t[rows], values[rows], (force + added)[rows]
    if motion == "velocity":
        values = np.append(0.0, np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(t)))
    position, findings = _without_wraps(values, factors[motion], columns.unit)
    findings = [*(note("file", sentence) for sentence in notes), *findings]
    unscaled = {key: name for key, name in names.items() if given[key] is None}
    findings += [finding for key, name in unscaled.items() for finding in file.unit_finding(key, name)]
    if motion in unscaled:
        others = {
            name: values[rows]
            for name, values in variables.items()
            if len(values) == len(rows) and name not in names.values()
        }
        findings += _contradiction(file, motion, moving, position, others, t)
    return record_of_rows(file.name, t, force, position, unit=columns.unit, findings=tuple(findings))


#: correlation of the changes of a column with those of the motion, or the integral of it with them, that shows that it
#: is the same motion, what else moves with an axis having a delay, noise or play; and how far its factor may be off:
#: noise of that correlation makes it 2 % larger, and a gear of 10 is 5 % from the 9.55 of rpm
_SAME_MOTION, _SAME_FACTOR = 0.98, 1.02


def _contradiction(
    file: _File, motion: str, own: str, position: Floats, others: Columns, t: Floats
) -> list[Finding]:
    """Return the error of a position (N,), or velocity, in another unit than a column of the same motion shows."""
    unit = next(iter(file.units_of(motion)))
    for name, values in others.items():
        for kind, moved in (("position", values), ("velocity", integrated(t, values))):
            units = file.units_of(kind)
            of_other = file.unit_of(name) if file.unit_of(name) in units else next(iter(units))
            correlation, ratio = change_agreement(t, position, units[of_other] * moved) or (0.0, 1.0)
            looks = unit_of_ratio(ratio, unit, within=_SAME_FACTOR) if correlation > _SAME_MOTION else None
            if looks:
                text = (
                    f"{own} looks like {looks}, not {file.unit_of(own) or unit}: it moves {ratio:.4g} times as far as "
                    f"by {name} [{of_other}]. If so, give {_option(motion)} {file.units_of(motion)[looks]:.6g}."
                )
                return [error("unit", text, own, name)]
    return []


def _complete_rows(name: str, columns: Columns) -> Bools:
    """Return which rows have all values (N,)."""
    count = len(columns["time"])
    for key, values in columns.items():
        if len(values) != count:
            raise InputError(
                f"{name}: {key} has {len(values)} values and the time has {count}; name a column of the same length."
            )
    missing = {key: ~np.isfinite(values) for key, values in columns.items()}
    lacking = np.logical_or.reduce(list(missing.values()))
    if lacking.sum() > MOST_MISSING * count:
        worst = max(missing, key=lambda key: missing[key].sum())
        raise InputError(
            f"{name}: {worst} is missing or not finite in row {int(np.argmax(missing[worst])) + 1}; {lacking.sum()} of "
            f"{count} rows lack a value, and at most {100.0 * MOST_MISSING:.0f} % may."
        )
    return ~lacking


def _without_wraps(position: Floats, scale: float, unit: str) -> tuple[Floats, list[Finding]]:
    """Return the position (N,), recorded in `scale` of its unit, unwrapped if it wraps, and findings on that."""
    turn, degrees = TURNS[1:]
    period = wrap_period(position, (turn, degrees, *(counts * abs(scale) for counts in COUNTERS)))
    if period is None:
        return position, []
    size = {turn: "one turn", degrees: "360"}.get(period, f"{period:.6g} {unit}")
    findings = [note("wrap", f"The position jumps by {size}; it is unwrapped.", "position")]
    options = ["--unit rad"] if unit != "rad" else []
    options += [f"--position-scale {np.radians(1.0):.6g}"] if period == degrees else []
    if options and period in (turn, degrees):
        text = f"A position that jumps by {period:.4g} is an angle: {' '.join(options)}."
        findings.append(warning("unit", text, "position"))
    return unwrapped(position, period=period), findings
