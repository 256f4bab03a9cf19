"""Which column of a foreign log is which quantity: by its name, and where names leave it open, asked for.

A series is as many columns of one kind and stem as the robot has wheels, numbered from 1 or 0. Of several the plainest
name is taken, a command before a measured current. Two series whose names say nothing (m1 and e1) are told apart only
where one is smooth as an integral is and the other is not.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.log.formats.inference import ForeignTable
from ballbot.log.imu_angles import QUATERNION_ANGLES, quaternion_angles
from ballbot.log.mapping_search.name_words import ANGLE_WORDS
from ballbot.log.mapping_search.names import Kind, Reading, efforts, read_names

#: a name says plainly what its column is with at least this weight
PLAIN = 0.6
#: an angle changes from row to row by less than this part of its range, as often as not, and by so many times less
#: than a command does
SMOOTHER = 5.0
#: norm of a unit quaternion [1 +-], in nearly all rows
UNIT_NORM, UNIT_ROWS = 0.02, 0.99
#: the roll of an IMU that hangs upside down is within this part of a turn of half a turn, in this share of the rows
UPSIDE_DOWN, UPSIDE_DOWN_ROWS = 0.1, 0.9


@dataclass(frozen=True, kw_only=True)
class Roles:
    """The file's names of what the log is made of; empty or None if there is none."""

    time: str
    attitude: tuple[str, ...]  #: roll, pitch and, if there is one, yaw
    angles: tuple[str, ...]  #: a wheel each; or its speed, if they are `of_speeds`
    commands: tuple[str, ...]
    gyro: tuple[str, ...]  #: about x, y and z
    speeds: tuple[str, ...] = ()
    body_commands: tuple[str, ...] = ()  #: about the body's axes, before they go to the wheels
    quaternion: tuple[str, ...] = ()  #: w, x, y and z, of which the attitude is made
    of_speeds: bool = False  #: whether the file has wheel speeds alone, whose integrals are the angles
    half_turn: float | None = None  #: in the file's unit, if the roll shows that the IMU hangs upside down
    time_parts: tuple[str, ...] = ()  #: columns of seconds and nanoseconds of which the time is made
    doubt: str = ""  #: what else the columns may be, in words; empty if the names say it
    units: Mapping[str, str] = field(default_factory=dict)  #: of columns, as a row below the header has them

    def reading(self, names: tuple[str, ...]) -> Reading | None:
        """Return what the name of the first of these columns says; None without columns."""
        return read_names(names, self.units)[0] if names else None

    def unit(self, names: tuple[str, ...]) -> str | None:
        """Return the unit that the name of the first of these columns has."""
        found = self.reading(names)
        return found.unit if found else None


def roles_of(path: object, table: ForeignTable, wheel_count: int) -> tuple[ForeignTable, Roles]:
    """Return the roles of a table's columns, and the table with the columns that are made of others.

    Raises
    ------
    InputError
        If no name says which column is the time, or which are lean or wheels; it says what to give as --columns.
    """
    columns, made = dict(table.columns), set[str]()
    stamp = _stamp(columns)
    if stamp:
        columns = {_STAMP: columns[stamp[0]] + 1e-9 * columns[stamp[1]], **columns}
        made |= {*stamp}
    quaternion = _quaternion(columns)
    if quaternion:
        columns |= quaternion_angles(np.column_stack([columns[name] for name in quaternion]))
        made |= {*quaternion, *QUATERNION_ANGLES}
    names = [name for name in columns if name not in made]
    if not table.named:
        raise InputError(
            f"{path} has no header: name its {len(table.columns)} columns in their order, "
            "--columns t,roll,pitch,yaw,enc1,enc2,enc3,u1,u2,u3 (_ for a column that is not needed)."
        )
    roles = roles_by_name(names, wheel_count=wheel_count, units=table.units, columns=columns)
    if quaternion and not roles.attitude:
        roles = replace(roles, attitude=QUATERNION_ANGLES, quaternion=quaternion)
    if not roles.time:
        raise InputError(
            f"{path}: no column is named as a time (the columns are {', '.join(names)}). Name the columns in the "
            "file's order with --columns t,roll,pitch,.. (_ for a column that is not needed), or write a mapping file."
        )
    if not roles.angles and not roles.attitude:
        raise InputError(
            f"{path}: no columns are named as roll and pitch, and none as the angles of {wheel_count} wheels (the "
            f"columns are {', '.join(names)}). Name them in the file's order with --columns, or write a mapping file."
        )
    if roles.attitude and not roles.quaternion:
        roles = replace(roles, half_turn=_half_turn(columns[roles.attitude[0]], roles.unit(roles.attitude)))
    if stamp and roles.time == _STAMP:
        roles = replace(roles, time_parts=stamp)
    return replace(table, columns=columns), roles


def roles_by_name(
    names: Iterable[str],
    *,
    wheel_count: int,
    units: Mapping[str, str] | None = None,
    columns: Mapping[str, NDArray[np.float64]] | None = None,
) -> Roles:
    """Return what the names, and the units in a row below them, say; values tell series apart that names leave open."""
    names, count = list(names), wheel_count
    # one name alone does not say what its neighbours' names say of it
    units = efforts(names) | dict(units or {})
    readings = read_names(names, units)
    plain = {one.name for one in readings if one.weight >= PLAIN}
    angles, speeds = _first(readings, "wheel angle", count), _first(readings, "wheel speed", count)
    commands, doubt = _first(readings, "command", count), ""
    open_ones = [
        series
        for kind in ("wheel angle", "wheel speed", "other")
        for series in _series(readings, kind, count)
        if not set(series) & plain
    ]
    if not set(angles) & plain and open_ones and not (commands and len(open_ones) == 1 and angles):
        angles, commands, doubt = _told_apart(open_ones, commands, columns or {})
    times = [one for one in readings if one.kind == "time"]
    attitude, gyro = _axes(readings, "attitude"), _axes(readings, "gyro")
    lean = tuple(attitude[axis] for axis in "xyz" if axis in attitude)
    return Roles(
        time=max(times, key=lambda one: one.weight).name if times else "",
        attitude=lean if {"x", "y"} <= set(attitude) else (),
        angles=angles or speeds,
        of_speeds=not angles and bool(speeds),
        speeds=speeds if angles else (),
        commands=commands,
        body_commands=tuple(one.name for one in readings if one.kind == "body command"),
        gyro=tuple(gyro[axis] for axis in "xyz") if len(gyro) == 3 else (),
        doubt=doubt,
        units=units,
    )


def _told_apart(
    series: list[tuple[str, ...]], commands: tuple[str, ...], columns: Mapping[str, NDArray[np.float64]]
) -> tuple[tuple[str, ...], tuple[str, ...], str]:
    """Return the wheel angles and the commands among series of which no name says it, and what is in doubt."""

    def roughness(names: tuple[str, ...]) -> float:
        values = np.column_stack([columns.get(name, np.zeros(0)) for name in names])
        values = values[np.isfinite(values).all(axis=1)]
        if len(values) < 2 or not np.ptp(values, axis=0).all():
            return float("inf")
        return float(np.median(np.abs(np.diff(values, axis=0)).mean(axis=0) / np.ptp(values, axis=0)))

    ranked = sorted(series, key=roughness)
    wanted = 1 if commands else 2
    rest = ranked[1] if wanted == 2 and len(ranked) > 1 else commands
    clear = len(ranked) == 1 or roughness(ranked[1]) > SMOOTHER * roughness(ranked[0])
    words = " or ".join(", ".join(one) for one in ranked)
    if len(ranked) == 1 and commands:
        return ranked[0], commands, ""
    return ranked[0], rest, "" if clear and len(ranked) <= wanted else f"the wheel angles are {words}"


def _series(readings: list[Reading], kind: Kind, count: int) -> list[tuple[str, ...]]:
    """Return the complete series of columns of a kind, the plainest first."""
    series: dict[str, dict[int, Reading]] = {}
    for one in readings:
        if one.kind == kind and one.index is not None:
            series.setdefault(one.stem, {}).setdefault(one.index, one)
    found = []
    for members in series.values():
        start = next((s for s in (1, 0) if all(s + k in members for k in range(count))), None)
        if start is not None and count + start not in members:
            chosen = [members[start + k] for k in range(count)]
            found.append((min(one.weight for one in chosen), tuple(one.name for one in chosen)))
    return [names for _, names in sorted(found, key=lambda one: -one[0])]


def _first(readings: list[Reading], kind: Kind, count: int) -> tuple[str, ...]:
    return next(iter(_series(readings, kind, count)), ())


def _axes(readings: list[Reading], kind: Kind) -> dict[str, str]:
    """Return the columns of a kind by axis, of one family of names: that with the most axes, then the plainest."""
    families: dict[str, dict[str, Reading]] = {}
    for one in readings:
        if one.kind == kind and one.axis is not None:
            family = one.stem
            for word in (*sorted(ANGLE_WORDS, key=len, reverse=True), "theta", "phi", "psi"):
                family = family.replace(word, "")
            families.setdefault(family, {}).setdefault(one.axis, one)
    if not families:
        return {}
    best = max(families.values(), key=lambda f: (len(f) > 1, min(one.weight for one in f.values()), len(f)))
    # a heading by itself belongs to roll and pitch of another family
    others = {
        one.axis: one for family in families.values() for one in family.values() if one.axis not in best
    }
    return {axis: one.name for axis, one in ({**others, **best} if len(best) > 1 else best).items() if axis}


#: the name of a time that two columns hold
_STAMP = "time [s] of the stamp"
_NANOSECONDS = re.compile(r"(nanoseconds|nanosec|nsecs|nsec)$", re.IGNORECASE)
_SECONDS = ("seconds", "secs", "sec", "s")


def _stamp(columns: Mapping[str, NDArray[np.float64]]) -> tuple[str, ...]:
    """Return the columns of a time's seconds and nanoseconds, as in a stamp of ROS; empty without one."""
    for name, values in columns.items():
        ending = _NANOSECONDS.search(name)
        known = values[np.isfinite(values)]
        if ending is None or not len(known) or known.min() < 0.0 or known.max() >= 1e9:
            continue
        wanted = {name[: ending.start()].lower() + one for one in _SECONDS}
        seconds = next((one for one in columns if one.lower() in wanted), None)
        if seconds is not None:
            return seconds, name
    return ()


def _quaternion(columns: Mapping[str, NDArray[np.float64]]) -> tuple[str, ...]:
    """Return the names of the w, x, y and z of an IMU's quaternion, that of the odometry last; empty if none has one.

    They differ in one letter, w, x, y and z, and the sum of their squares is one.
    """
    found = []
    for name in columns:
        for place, mark in enumerate(name):
            if mark not in "wW":
                continue
            marks = "wxyz" if mark == "w" else "WXYZ"
            series = tuple(name[:place] + one + name[place + 1 :] for one in marks)
            if all(one in columns for one in series):
                values = np.column_stack([columns[one] for one in series])
                values = values[np.isfinite(values).all(axis=1)]
                norm = np.linalg.norm(values, axis=1)
                unit = np.abs(norm - 1.0) < UNIT_NORM
                if len(norm) and np.mean(unit | (norm == 0.0)) > UNIT_ROWS and np.ptp(values, axis=0).any():
                    found.append(series)
    return min(found, key=lambda series: "odom" in series[0].lower(), default=())


def _half_turn(roll: NDArray[np.float64], unit: str | None) -> float | None:
    """Return half a turn in the unit of a roll (N,) that shows an IMU upside down; None if it shows none."""
    known = roll[np.isfinite(roll)]
    for one, half in (("deg", 180.0), ("rad", np.pi)):
        near = np.abs(np.abs(known) - half) < UPSIDE_DOWN * 2.0 * half
        if unit in (None, one) and len(known) and near.mean() > UPSIDE_DOWN_ROWS:
            return half
    return None


def unused(columns: Iterable[str], roles: Roles, taken: Collection[str] = ()) -> list[str]:
    """Return the numbered columns without a role of which nothing says that they are no commands."""
    used = {roles.time, *roles.attitude, *roles.angles, *roles.speeds, *roles.commands, *roles.gyro, *taken}
    found = read_names([one for one in columns if one not in used], roles.units)
    return [one.name for one in found if one.kind == "other" and one.index is not None]
