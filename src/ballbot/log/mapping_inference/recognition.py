"""Which columns of a foreign table have which role, and the unit of the time; InputError if that cannot be found.

Names come first (`ballbot.log.mapping_inference.roles`), then values (`ballbot.log.mapping_inference.column_values`).
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.log.formats.inference import ForeignTable
from ballbot.log.imu_angles import QUATERNION_ANGLES, quaternion_angles
from ballbot.log.mapping_inference.column_values import roles_by_data
from ballbot.log.mapping_inference.command_signs import directions_of, far_from_zero, never_negative, zero_of
from ballbot.log.mapping_inference.counted_time import seconds_of_a_count
from ballbot.log.mapping_inference.gyro_columns import with_gyro
from ballbot.log.mapping_inference.names import read_name, read_names
from ballbot.log.mapping_inference.open_names import settled, with_heading_behind, with_rates_of
from ballbot.log.mapping_inference.roles import (
    PLAIN,
    Roles,
    half_turn,
    quaternion_of,
    roles_by_name,
    upright,
)
from ballbot.log.mapping_inference.time_units import time_scale
from ballbot.log.mapping_inference.units import Scale
from ballbot.log.mapping_inference.wheel_speeds import (
    check_has_angles,
    check_named_wheels,
    integrals_of,
    of_speeds,
)
from ballbot.log.mapping_inference.wrapped_encoders import wrapped_encoders
from ballbot.log.row_order import increasing_rows, longest_run, repeated_rows
from ballbot.log.signals import unwrapped
from ballbot.log.wrapping import clock_note, continuous_clock
from ballbot.robot import Robot
from ballbot.summary import counted


@dataclass(frozen=True, kw_only=True, eq=False)
class Recognised:
    """The columns of a foreign table with their roles."""

    table: ForeignTable  #: with the angles of a quaternion
    roles: Roles
    by_data: bool  #: whether the columns were recognised by their values
    time: Scale
    rows: tuple[int, int]  #: first and end of the longest run
    unordered: bool  #: whether some of these rows are out of order


def recognise(path: str | Path, table: ForeignTable, robot: Robot) -> Recognised:
    """Return the roles of a table's columns.

    Raises
    ------
    InputError
        If neither names nor numbers show the time and the wheels' angles; it begins with the path.
    """
    table, stamp = _with_stamp(table)
    table, quaternion = _with_quaternion(table)
    encoders = wrapped_encoders(
        table.columns, table.units, robot.wheel_count, encoder_counts=robot.sensors.encoder_counts
    )
    wrapped, period = encoders or ((), 0)
    raw = {name: table.columns[name] for name in wrapped}
    continued = {name: unwrapped(values, period=period) for name, values in raw.items()}
    table = replace(table, columns={**table.columns, **continued})
    roles, by_data = _roles(path, table, robot, quaternion, stamp, wrapped)
    if wrapped and roles.angles == wrapped:
        roles = replace(roles, wrap=float(period))
    table = replace(table, columns=table.columns if roles.wrap else {**table.columns, **raw})
    roles, notes = _with_gyro_and_notes(table, roles)
    table = replace(table, notes=(*table.notes, *notes))
    roles = replace(roles, half_turn=half_turn(table.columns, roles))
    if stamp and roles.time == _STAMP:
        roles = replace(roles, time_parts=stamp)
    if not by_data:
        check_named_wheels(path, table, roles, robot)
    copies = _copies(table, roles)
    if copies:
        roles = replace(roles, confidence=min(roles.confidence, 0.6), alternatives=copies)
    clock = roles.time or ""
    continued_clock, again = continuous_clock(table.columns[clock])
    if again.size:
        notes = (*table.notes, clock_note(clock, again))
        table = replace(table, columns={**table.columns, clock: continued_clock}, notes=notes)
    time = _time(path, table, roles)
    repeated = repeated_rows(table.columns, clock)
    t = time.factor * table.columns[roles.time or ""]
    rows = longest_run(t, repeated)
    if roles.attitude:
        _check_motion(path, table, roles, slice(*rows), float(np.ptp(t[slice(*rows)])))
        table, roles = _without_still_heading(table, roles, slice(*rows))
    if roles.attitude and roles.commands:
        table, roles = _with_signs(table, roles, t, slice(*rows))
    if repeated.any():
        note = (
            f"Not used: {counted(int(repeated.sum()), 'row')} with the time and all values of the row before."
        )
        table = replace(table, notes=(*table.notes, note))
    kept = increasing_rows(t[slice(*rows)][~repeated[slice(*rows)]])
    unordered = int((~kept).sum())
    if unordered:
        note = (
            f"{unordered} of {len(kept)} rows are out of order, as stamps of a late host or of whole milliseconds are: "
            "the longest series of rows in which time increases is kept."
        )
        table = replace(table, notes=(*table.notes, note))
    return Recognised(
        table=table, roles=roles, by_data=by_data, time=time, rows=rows, unordered=unordered > 0
    )


def _with_signs(
    table: ForeignTable, roles: Roles, t: NDArray[np.float64], rows: slice
) -> tuple[ForeignTable, Roles]:
    """Return the roles with the zero, or the directions, of commands that are never negative, and a note."""
    commands = np.column_stack([table.columns[name][rows] for name in roles.commands])
    if not never_negative(commands):
        return table, roles
    if far_from_zero(commands):
        return table, replace(roles, zero=zero_of(commands, t[rows]))
    columns = {name: values[rows] for name, values in table.columns.items()}
    directions = directions_of(read_names(list(columns), table.units), columns, roles.commands)
    if not directions:
        return table, roles
    note = (
        f"{', '.join(roles.commands)} are magnitudes, forward where {', '.join(directions)} are above zero, and "
        "backward elsewhere."
    )
    return replace(table, notes=(*table.notes, note)), replace(roles, directions=directions)


def _with_gyro_and_notes(table: ForeignTable, roles: Roles) -> tuple[Roles, list[str]]:
    """Return the roles with the gyro, and sentences on what the columns are taken for."""
    notes = []
    if roles.of_speeds:
        notes.append(f"{', '.join(roles.angles)} are wheel speeds, whose integrals are taken as the angles.")
    if roles.wrap:
        notes.append(
            f"{', '.join(roles.angles)} begin again after {roles.wrap:g} counts: the angles are continued there."
        )
    if roles.set_points:
        notes.append(
            f"{', '.join(roles.commands)} are set points, and the only commands of the motors: the mapping assumes "
            "that the motors follow them."
        )
    roles, of_neither = with_rates_of(roles, table.columns)
    roles, looks_like = with_gyro(roles, upright(table.columns, roles))
    return roles, [*notes, *(one for one in (of_neither, looks_like) if one)]


#: the name of a time that two columns hold
_STAMP = "time [s] of the stamp"
#: ends of the names of a time's nanoseconds, and of its seconds, as in a stamp of ROS
_NANOSECONDS, _SECONDS = ("nanoseconds", "nanosec", "nsecs", "nsec"), ("seconds", "secs", "sec", "s")


def _with_stamp(table: ForeignTable) -> tuple[ForeignTable, tuple[str, ...]]:
    """Return a table with a column of the time that two others hold as seconds and nanoseconds, and their names."""
    for name, values in table.columns.items():
        ending = next((one for one in _NANOSECONDS if name.lower().endswith(one)), None)
        known = values[np.isfinite(values)]
        if ending is None or not len(known) or known.min() < 0.0 or known.max() >= 1e9:
            continue
        whole = name[: -len(ending)]
        seconds = next(
            (one for one in table.columns if one.lower() in {whole.lower() + s for s in _SECONDS}), None
        )
        if seconds is not None:
            time = table.columns[seconds] + 1e-9 * values
            return replace(table, columns={_STAMP: time, **table.columns}), (seconds, name)
    return table, ()


def _with_quaternion(table: ForeignTable) -> tuple[ForeignTable, tuple[str, ...]]:
    """Return a table with the angles of its quaternion, and the names of w, x, y and z; none without one."""
    quaternion = quaternion_of(table.columns)
    if not quaternion:
        return table, ()
    angles = quaternion_angles(np.column_stack([table.columns[name] for name in quaternion]))
    return replace(table, columns={**table.columns, **angles}), quaternion


def _roles(
    path: str | Path,
    table: ForeignTable,
    robot: Robot,
    quaternion: tuple[str, ...],
    stamp: tuple[str, ...],
    wrapped: tuple[str, ...],
) -> tuple[Roles, bool]:
    names = [name for name in table.columns if name not in {*quaternion, *QUATERNION_ANGLES, *stamp}]
    named = roles_by_name(names, wheel_count=robot.wheel_count, units=table.units)
    if quaternion and not named.attitude:
        named = replace(named, attitude=QUATERNION_ANGLES, quaternion=quaternion)
    _check_wheel_count(path, names, named, robot)
    if wrapped and not named.angles:
        named = replace(named, angles=wrapped, open_series=(wrapped,))
    named = with_heading_behind(named, table.columns, robot)
    doubted = named.alternatives
    named = settled(named, upright(table.columns, named), robot)
    if doubted:
        named = replace(named, confidence=0.6, alternatives=(*doubted, *named.alternatives))
    integrals: dict[str, NDArray[np.float64]] = {}
    if table.named and (by_speeds := of_speeds(table, named, robot)):
        named, integrals = by_speeds, integrals_of(table, by_speeds)
    known = table.named and named.time is not None and named.angles
    if known and (named.attitude or len(table.columns) < len(named.angles) + len(named.commands) + 3):
        return named, False
    found = (
        roles_by_data(_perhaps_lean(table.columns) | integrals, robot)
        if known
        else _by_data(table, robot, named, {*quaternion, *stamp})
    )
    if found is not None and quaternion and found.attitude[:2] == QUATERNION_ANGLES[:2]:
        found = replace(found, attitude=QUATERNION_ANGLES, quaternion=quaternion)
    if known:
        if found is None or found.angles != named.angles:
            return named, False
        # roll and pitch in words of another language
        return replace(named, attitude=found.attitude, confidence=found.confidence), True
    by_values = (found.time or "") if found else ""
    counts = read_name(by_values).kind == "counter" or bool(_words(by_values) & _CLOCK_COUNTS)
    counts = counts or (named.time is None and _counts_rows(table, by_values))
    if table.named and named.time is None and named.angles and named.attitude and (found is None or counts):
        raise _no_time(path, table, named)
    if found is None:
        if table.named and named.time is not None and not named.angles:
            check_has_angles(path, named)
            if named.attitude:
                raise InputError(
                    f"{path} has the time ({named.time}) and the lean ({', '.join(named.attitude)}), but no wheel "
                    "angles: it shows no friction. With a mapping file it is usable for `ballbot align`, a comparison "
                    "with motion capture; for everything else, log the encoders too."
                )
        raise InputError(
            f"{path}: cannot determine which columns are the time, the lean and the wheel angles, neither by "
            f"names nor by numbers (the columns are {', '.join(table.columns)}). Name them in the file's order, "
            f"--columns t,roll,pitch,.. (_ for a column that is not needed), "
            f"or write a mapping file."
        )
    return found, True


#: kinds of columns that are neither angles nor commands, if their names say so plainly: "other" are magnetometers, ..
_NEVER_WHEELS = ("gyro", "accelerometer", "wheel speed", "reference", "other")


def _by_data(table: ForeignTable, robot: Robot, named: Roles, parts: Collection[str]) -> Roles | None:
    """Return the roles by values, with the heading and the commands that names say plainly.

    Columns whose names say plainly that they are something else are left out, unless nothing is found without them;
    `parts`, of which others are made, always.
    """
    columns = {name: values for name, values in table.columns.items() if name not in parts}
    plain = [one for one in read_names(list(table.columns), table.units) if one.weight >= PLAIN]
    yaw = next((one.name for one in plain if (one.kind, one.axis) == ("attitude", "z")), None)
    motors = named.commands if {*named.commands} <= {one.name for one in plain} else ()
    others = {one.name for one in plain if one.kind in _NEVER_WHEELS}
    rest = {name: values for name, values in columns.items() if name not in others}
    found = roles_by_data(rest, robot, yaw=yaw, motors=motors)
    if found is None and others:
        found = roles_by_data(columns, robot, yaw=yaw, motors=motors)
    return None if found is None else replace(found, units=named.units)


def _check_wheel_count(path: str | Path, names: list[str], named: Roles, robot: Robot) -> None:
    """Raise InputError if names number more or fewer wheels than the robot has.

    Either the names say plainly that they are wheel angles, or two series have as many columns, as encoders and motors.
    """
    if named.angles:
        return
    series: dict[str, list[str]] = {}
    plain = set[str]()
    for one in read_names(names, named.units):
        if one.index is not None:
            series.setdefault(one.stem, []).append(one.name)
        if one.kind == "wheel angle" and one.weight >= PLAIN:
            plain.add(one.stem)
    others = {stem: one for stem, one in series.items() if len(one) > 2 and len(one) != robot.wheel_count}
    clear = [one for stem, one in others.items() if stem in plain]
    if clear:
        raise InputError(
            f"{path} has the angles of {len(clear[0])} wheels ({', '.join(clear[0])}), but the robot {robot.name} "
            f"has {robot.wheel_count}: give the robot file of the robot that wrote the log."
        )
    if len(others) == len(series) > 1 and len({len(one) for one in others.values()}) == 1:
        columns = " and ".join(f"{one[0]} to {one[-1]}" for one in others.values())
        raise InputError(
            f"{path} has {len(next(iter(others.values())))} columns each of {columns}, but the robot {robot.name} has "
            f"{robot.wheel_count} wheels: give the robot file of the robot that wrote the log."
        )


def _copies(table: ForeignTable, roles: Roles) -> tuple[str, ...]:
    """Return, in words, the pairs of a quantity's columns that are identical in every row."""
    # one command for all motors, as in a sweep, is no copy
    alike = all(_identical(table, roles.commands[0], one) for one in roles.commands)
    return tuple(
        f"{one} and {other}, which are identical in every row, are one column twice"
        for names in (roles.angles, () if alike else roles.commands)
        for place, one in enumerate(names)
        for other in names[place + 1 :]
        if np.ptp(table.columns[one]) > 0.0 and _identical(table, one, other)
    )


def _identical(table: ForeignTable, one: str, other: str) -> bool:
    return np.array_equal(table.columns[one], table.columns[other], equal_nan=True)


def _perhaps_lean(columns: Mapping[str, NDArray[np.float64]]) -> dict[str, NDArray[np.float64]]:
    """Return the columns without those whose names say that they are no angles, such as an accelerometer's."""
    other = ("gyro", "accelerometer", "wheel speed", "reference", "ball position", "ball velocity")
    return {one.name: columns[one.name] for one in read_names(list(columns)) if one.kind not in other}


def _time(path: str | Path, table: ForeignTable, roles: Roles) -> Scale:
    named = roles.reading((roles.time,)) if roles.time else None
    found = time_scale(table.columns[roles.time or ""], named.unit if named else None)
    if found is None:
        raise _no_time(path, table, roles)
    return found


def _no_time(path: str | Path, table: ForeignTable, roles: Roles) -> InputError:
    """Return that only the time is missing, with the columns that may count it and the entry that each needs."""
    lean = f"{', '.join(roles.attitude)} as the lean and " if roles.attitude else ""
    known = f"{lean}{', '.join(roles.angles)} as the wheel angles"
    hints = []
    for one in read_names(list(table.columns), table.units):
        values = table.columns[one.name]
        steps = np.diff(values[np.isfinite(values)])
        words = _words(one.name)
        if one.kind == "time" and not np.isfinite(values).any():
            hints.append(f"{one.name} has no number in any row")
        if one.name in (*roles.attitude, *roles.angles, *roles.commands) or not len(steps):
            continue
        if words & {"dt", "period"} and values[np.isfinite(values)].min() > 0.0:
            hints.append(
                f"{one.name} seems to have the intervals between the rows: write their running sum, in seconds, in a "
                "column t"
            )
        elif np.mean(steps > 0.0) > RISING and (
            one.name == roles.time or one.kind in ("time", "counter", "other")
        ):
            hints.append(_counter_hint(table, roles, one.name, float(np.median(steps))))
    hint = "; ".join(hints) or "add a column t in seconds"
    return InputError(
        f"{path}: cannot determine the time: the names show {known}, but no column is a time in a known unit; {hint}."
    )


def _counter_hint(table: ForeignTable, roles: Roles, name: str, step: float) -> str:
    """Return the entry that a counter of the time needs, with the seconds of a count if the gyro shows them."""
    seconds = seconds_of_a_count(table.columns[name], roles, table.columns)
    rises = f"{name} rises by {step:.6g} a row: in [columns] of a mapping file, write t = "
    if seconds is None:
        return f'{rises}{{ from = "{name}", scale = .. }} with the seconds of one of its counts'
    return (
        f'{rises}{{ from = "{name}", scale = {seconds:g} }} if a count is {1e3 * seconds:g} ms, as the gyro and the '
        "rates of the angles suggest"
    )


def _counts_rows(table: ForeignTable, name: str) -> bool:
    """Return whether a column rises by one in every row: a counter, whose steps may last any time."""
    values = table.columns.get(name)
    return values is not None and bool(np.all(np.diff(values[np.isfinite(values)]) == 1.0))


#: share of the rows in which a time, or a counter of it, rises
RISING = 0.98


#: words of a column that counts a clock whose rate only its maker knows
_CLOCK_COUNTS = {"tick", "ticks", "count", "counts", "cycle", "cycles", "clk"}


def _words(name: str) -> set[str]:
    """Return the words of a name in lower case."""
    return set(re.findall(r"[a-z]+", name.lower()))


def _is_still(values: NDArray[np.float64]) -> bool:
    known = values[np.isfinite(values)]
    return not len(known) or float(np.ptp(known)) == 0.0


#: in a shorter log [s], a robot that hardly moves, or along one line, may leave a wheel where it is
SHORT_LOG = 15.0


def _check_motion(path: str | Path, table: ForeignTable, roles: Roles, rows: slice, duration: float) -> None:
    """Raise InputError if the angle of a wheel, or of all, or one motor's command never changes in a duration [s]."""
    still = [name for name in roles.angles if _is_still(table.columns[name][rows])]
    if still and len(still) == len(roles.angles):
        raise InputError(
            f"{path}: no wheel turns ({', '.join(still)} keep their values), so that the log shows nothing of how the "
            "wheels drive the robot. Record the robot while it balances and moves."
        )
    if still:
        value = table.columns[still[0]][rows][0] + 0.0  # not -0
        causes = "a dead encoder, or a column that was not recorded. Record a log with every wheel's angle."
        if duration < SHORT_LOG:
            causes = (
                f"a dead encoder, a column that was not recorded, or, in a log of {duration:.0f} s, a wheel that had "
                f"nothing to do. Record at least {SHORT_LOG:.0f} s in which the robot leans "
                "in all directions."
            )
        raise InputError(f"{path}: {still[0]} is {value:g} in every row while other wheels turn: {causes}")
    dead = [name for name in roles.commands if _is_still(table.columns[name][rows])]
    if dead and len(dead) < len(roles.commands):
        value = table.columns[dead[0]][rows][0] + 0.0  # not -0
        raise InputError(
            f"{path}: {dead[0]} is {value:g} in every row while other motors' commands vary and all wheels turn: a "
            "dead motor, or a command that was not recorded. Record a log with every motor's command."
        )


def _without_still_heading(table: ForeignTable, roles: Roles, rows: slice) -> tuple[ForeignTable, Roles]:
    """Return the roles without a heading that never changes, which no robot on a ball has, and a note that says so."""
    if len(roles.attitude) < 3 or roles.quaternion:
        return table, roles
    heading = roles.attitude[2]
    if not _is_still(table.columns[heading][rows]):
        return table, roles
    note = f"{heading} has one value in all rows and is not used: the wheels give the heading."
    return replace(table, notes=(*table.notes, note)), replace(roles, attitude=roles.attitude[:2])
