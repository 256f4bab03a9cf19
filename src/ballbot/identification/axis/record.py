"""Records of one axis, and their reading from files.

For an axis that turns, the mass is an inertia [kg m^2], forces are torques [N m] and positions angles [rad]. Rows are
even; uneven ones are interpolated. Gaps divide the record into parts, and no prediction runs across one. Rows with a
missing value are left out, which leaves a gap. A file is read as a log is, by a mapping that the user gives or that the
names of its columns make; a position that wraps is unwrapped, and a velocity without a position is integrated.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np

from ballbot.arrays import Floats, positive_number, real_array
from ballbot.errors import InputError, about, either, suggest
from ballbot.findings import Finding, note, warning
from ballbot.log import Log
from ballbot.log.columns import FACTORS, LARGEST_CELL, Columns, given_names, unit_of
from ballbot.log.formats import read_columns, read_variables
from ballbot.log.formats.text import ForeignTable, is_number
from ballbot.log.imu_angles import integral_of
from ballbot.log.mapping import ColumnTable, LogMapping, Source, apply_mapping, read_mapping, timed_rows
from ballbot.log.mapping_search.names import stated_unit
from ballbot.log.row_order import check_time
from ballbot.log.signals import unwrapped
from ballbot.log.units import change_agreement, looks_like, unit_of_ratio
from ballbot.log.wrapping import COUNTERS, TURNS, wrap_period

#: least rows of a record
LEAST_ROWS = 200
#: largest deviation of an interval from the usual one, as a share of it, in even rows
EVEN = 0.05
#: shortest gap, over the usual interval
GAP = 4.0
#: shortest rows that are identified [s]
FINEST = 1e-3
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

    def thinned(self) -> "AxisRecord":
        """Return it in rows of at most 1 ms, as no axis is faster, each with the mean force of several."""
        count = min(int(FINEST / self.sample_time * (1.0 + 1e-9)), len(self) // LEAST_ROWS)
        if count < 2:
            return self
        rows = np.concatenate([np.arange(first, end - count + 1, count) for first, end in self.parts])
        impulse = np.append(0.0, np.cumsum(self.force))
        times = None if self.times is None else self.times[rows]
        force, h = (impulse[rows + count] - impulse[rows]) / count, count * self.sample_time
        return replace(self, sample_time=h, force=force, position=self.position[rows], times=times)

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

    position: str | None = None
    """The variable with the position; "position" if neither it nor the velocity is given."""

    velocity: str | None = None
    """The variable with the velocity, for a file without a position."""

    force: str = "force"
    """The variable with the force, torque, current or voltage that drives the axis."""

    force_scale: str | None = None
    """Factor from that variable to newtons or newton metres, below zero if it acts the other way: a number, or a
    variable of the file. If not given, that of the file's unit."""

    unit: Literal["m", "rad"] = "m"
    """Unit of positions: m for a sliding mass, rad for a rotating inertia."""

    columns: str | None = None
    """The names of a text's columns in its order, with commas between, for a file without a header: t,position,force.
    Write _ for a column that is not needed."""


_BY_DEFAULT = AxisColumns()
#: by the unit of positions, the columns of a log that the options name
_OWN = {
    "m": {"time": "t", "position": "axis_position", "velocity": "axis_position_dot", "force": "axis_force"},
    "rad": {"time": "t", "position": "axis_angle", "velocity": "axis_angle_dot", "force": "axis_torque"},
}


def read_axis_record(
    path: str | Path, columns: AxisColumns = _BY_DEFAULT, *, mapping: str | Path | LogMapping | None = None
) -> AxisRecord:
    """Read a record from a file, by a mapping (`ballbot.log.mapping`), or by the one that named `columns` make.

    A mapping has t, axis_force and axis_position or axis_position_dot; of an axis that turns, axis_torque and
    axis_angle or axis_angle_dot. A further force is axis_force_added or axis_torque_added. InputError if the file
    cannot be read, a column is missing, or the rows do not make a record.

    >>> t = 0.01 * np.arange(300)
    >>> rows = np.column_stack([t, np.cos(t), 1e3 * np.sin(t)])
    >>> np.savetxt("slide.csv", rows, delimiter=",", header="t,force,position_mm", comments="")
    >>> record = read_axis_record("slide.csv", AxisColumns(position="position_mm"))
    >>> float(np.ptp(record.position).round(1))  # [m]
    1.0
    """
    path, notes, changes, units = Path(path), list[str](), list[Finding](), dict[str, str]()
    if mapping is None:
        table = read_variables(path, names=given_names(columns.columns))
        table.need_names(path, "t,position,force")
        notes, units = [*table.notes], dict(table.units)
        with about(path.name):
            variables, by = _named(table, columns, changes)
    elif columns != _BY_DEFAULT:
        raise InputError("--mapping names columns, units and scales; leave out the options that name them.")
    else:
        by = read_mapping(mapping)
        variables = read_columns(path, by.file, used=by.used_columns, notes=notes)
    unit = "rad" if "axis_torque" in by.columns else "m"
    own = _OWN[unit]
    with about(path.name):
        rows, t = timed_rows(by, variables, notes)
        changes += [note("file", sentence) for sentence in notes]
        log = _complete(Log(apply_mapping(by, rows, changes=changes)))
        force = log[own["force"]] + log.columns.get(f"{own['force']}_added", 0.0)
        moving = own["position" if own["position"] in log else "velocity"]
        position = integral_of(log.t, log[moving]) if moving == own["velocity"] else log[moving]
    source = by.sources.get(moving, Source(column=moving))
    position = _without_wraps(position, abs(source.factor), unit, changes)
    if by.columns[moving].scale == 1.0:
        used = {source.column for source in by.sources.values()}
        others = {name: np.interp(log.t, t, rows[name]) for name in rows if name not in used}
        changes += _contradiction(log.t, position, (moving, source.column), others, units)
    return record_of_rows(path.name, log.t, force, position, unit=unit, findings=tuple(changes))


def _named(table: ForeignTable, given: AxisColumns, changes: list[Finding]) -> tuple[Columns, LogMapping]:
    """Return a file's columns, with the time of each row, and the mapping of those that are named, by their units."""
    columns, own = dict(table.columns), _OWN[given.unit]
    motion = "velocity" if given.velocity and given.position is None else "position"
    named = {"time": given.time, motion: getattr(given, motion) or "position", "force": given.force}
    rows = max(len(columns.get(name, ())) for name in named.values())
    if is_number(given.time) or len(columns.get(given.time, ())) == 1:
        columns[given.time] = _number(columns, given.time, "--time") * np.arange(rows, dtype=np.float64)
    if lacking := {key: name for key, name in named.items() if len(columns.get(name, ())) != rows}:
        raise InputError(
            f"there is no column called {either(lacking.values())}; name what is meant, "
            f"{' '.join(f'--{key} NAME' for key in lacking)}"
            f"{' (or --time 0.001, the time between rows)' if 'time' in lacking else ''}; "
            f"{suggest(next(iter(lacking.values())), columns, otherwise='it has')}"
        )
    units = {name: stated_unit(name, table.units) for name in named.values()}
    entries = {own[key]: ColumnTable(source=name, unit=units[name]) for key, name in named.items()}
    if given.force_scale is not None:
        scale = _number(columns, given.force_scale, "--force-scale")
        entries[own["force"]] = ColumnTable(source=given.force, scale=scale)
    by, other = LogMapping(columns=entries), "rad" if given.unit == "m" else "m"
    try:
        sources = by.sources.items()
    except InputError as error:
        raise InputError(f"{error}; give --unit {other}, --force-scale or a factor in a --mapping") from None
    for name, source in sources:
        if entries[name].unit and source.factor != 1.0:
            text = f"{source.column} is multiplied by {source.factor:.6g}, by its unit in the file."
            changes.append(note("unit", text, source.column))
    return {name: values for name, values in columns.items() if len(values) == rows}, by


def _number(columns: Columns, text: str, option: str) -> float:
    """Return a number, written out or of a constant column; InputError if it is zero, or below for a time."""
    values = np.array([float(text)]) if is_number(text) else np.unique(columns.get(text, ()))
    above = option == "--time"
    if len(values) != 1 or not 0.0 < abs(values[0]) <= LARGEST_CELL or (above and values[0] < 0.0):
        raise InputError(
            f"{option} is {text}: give a number {'above' if above else 'other than'} zero, or a column with one value."
        )
    return float(values[0])


#: correlation of the changes of a column with those of the motion, or the integral of it with them, that shows that it
#: is the same motion, what else moves with an axis having a delay, noise or play; and how far its factor may be off:
#: noise of that correlation makes it 2 % larger, and a gear of 10 is 5 % from the 9.55 of rpm
_SAME_MOTION, _SAME_FACTOR = 0.98, 1.02


def _contradiction(
    t: Floats, position: Floats, moving: tuple[str, str], others: Columns, units: Mapping[str, str]
) -> list[Finding]:
    """Return the error of a position (N,) in another unit than another column of the same motion shows.

    It is made of the log's and the file's column `moving`.
    """
    own, name = moving
    kinds = [_OWN["rad" if "angle" in own else "m"][option] for option in ("position", "velocity")]
    for other, values in others.items():
        for kind, moved in zip(kinds, (values, integral_of(t, values)), strict=True):
            factors, given = FACTORS[unit_of(kind) or ""], stated_unit(other, units) or ""
            beside = given if given in factors else next(iter(factors))
            correlation, ratio = change_agreement(t, position, factors[beside] * moved) or (0.0, 1.0)
            looks = unit_of_ratio(ratio, unit_of(own) or "", within=_SAME_FACTOR)
            if looks and correlation > _SAME_MOTION:
                reason = f"it moves {ratio:.4g} times as far as by {other} [{beside}]"
                return [looks_like(own, name, looks, reason, "--mapping")]
    return []


def _complete(log: Log) -> Log:
    """Return the rows that have all values; InputError if too many lack one."""
    missing = {name: ~np.isfinite(log[name]) for name in log.names}
    lacking, worst = np.any([*missing.values()], axis=0), max(missing, key=lambda name: missing[name].sum())
    if np.mean(lacking) > MOST_MISSING:
        raise InputError(
            f"{worst} is missing or not finite in row {int(np.argmax(missing[worst])) + 1}; {lacking.sum()} of "
            f"{len(log)} rows lack a value, and at most {100.0 * MOST_MISSING:.0f} % may."
        )
    return log.complete(*log.names)


def _without_wraps(position: Floats, scale: float, unit: str, changes: list[Finding]) -> Floats:
    """Return the position (N,), recorded in `scale` of its unit, unwrapped if it wraps, which `changes` then says."""
    turn, degrees = TURNS[1:]
    period = wrap_period(position, (turn, degrees, *(counts * scale for counts in COUNTERS)))
    if period is None:
        return position
    size = {turn: "one turn", degrees: "360"}.get(period, f"{period:.6g} {unit}")
    changes.append(note("wrap", f"The position jumps by {size}; it is unwrapped.", "position"))
    if period == degrees or (period == turn and unit == "m"):
        how = 'unit = "deg" in a mapping' if period == degrees else "--unit rad"
        text = f"A position that jumps by {period:.4g} is an angle: {how}."
        changes.append(warning("unit", text, "position"))
    return unwrapped(position, period=period)
