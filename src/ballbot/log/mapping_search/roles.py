"""Which column of a foreign log is which quantity, by its name.

A series is as many columns of one kind and stem as the robot has wheels, numbered from 1 or 0. Of several the plainest
name is taken.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.log.formats.inference import ForeignTable
from ballbot.log.imu_angles import QUATERNION_ANGLES, quaternion_angles
from ballbot.log.mapping_search.names import Kind, NameReading, read_names

Floats = NDArray[np.float64]

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
    quaternion: tuple[str, ...] = ()  #: w, x, y and z, of which the attitude is made
    of_speeds: bool = False  #: whether the file has wheel speeds alone, whose integrals are the angles
    half_turn: float | None = None  #: in the file's unit, if the roll shows that the IMU hangs upside down
    units: Mapping[str, str] = field(default_factory=dict)  #: of columns, as their names say

    def unit(self, names: tuple[str, ...]) -> str | None:
        """Return the unit that the name of the first of these columns has."""
        return self.units.get(names[0]) if names else None


def roles_of(path: object, table: ForeignTable, wheel_count: int) -> tuple[ForeignTable, Roles]:
    """Return the roles of a table's columns, and the table with the columns that are made of others.

    Raises
    ------
    InputError
        If no name says which column is the time, or which are lean or wheels; it says what to give as --columns.
    """
    if not table.named:
        raise InputError(
            f"{path} has no header: name its {len(table.columns)} columns in their order, "
            "--columns t,roll,pitch,yaw,enc1,enc2,enc3,u1,u2,u3 (_ for a column that is not needed)."
        )
    columns, quaternion = dict(table.columns), _quaternion(table.columns)
    names = [name for name in columns if name not in quaternion]
    roles = roles_by_name(names, wheel_count=wheel_count, units=table.units)
    if quaternion and not roles.attitude:
        columns |= quaternion_angles(np.column_stack([columns[name] for name in quaternion]))
        roles = replace(roles, attitude=QUATERNION_ANGLES, quaternion=quaternion)
    missing = "column is named as a time" if not roles.time else ""
    if not roles.angles and not roles.attitude:
        missing = f"columns are named as roll and pitch, and none as the angles of {wheel_count} wheels"
    if missing:
        raise InputError(
            f"{path}: no {missing} (the columns are {', '.join(names)}). Name the columns in the file's order with "
            "--columns t,roll,pitch,.. (_ for a column that is not needed), or write a mapping file."
        )
    if roles.attitude and not roles.quaternion:
        roles = replace(roles, half_turn=_half_turn(columns[roles.attitude[0]], roles.unit(roles.attitude)))
    return replace(table, columns=columns), roles


def roles_by_name(names: Sequence[str], *, wheel_count: int, units: Mapping[str, str]) -> Roles:
    """Return what the names, and the units in a row below them, say."""
    readings = read_names(names, units)
    angles, speeds, commands = (
        _series(readings, kind, wheel_count) for kind in ("wheel angle", "wheel speed", "command")
    )
    times = [one for one in readings if one.kind == "time"]
    attitude, gyro = _axes(readings, "attitude"), _axes(readings, "gyro")
    return Roles(
        time=max(times, key=lambda one: one.weight).name if times else "",
        attitude=tuple(attitude[axis] for axis in "xyz" if axis in attitude)
        if {"x", "y"} <= set(attitude)
        else (),
        angles=angles or speeds,
        of_speeds=not angles and bool(speeds),
        commands=commands,
        gyro=tuple(gyro[axis] for axis in "xyz") if len(gyro) == 3 else (),
        units={one.name: one.unit for one in readings if one.unit},
    )


def _series(readings: Iterable[NameReading], kind: Kind, count: int) -> tuple[str, ...]:
    """Return the complete series of columns of a kind with the plainest names; empty without one."""
    series: dict[str, dict[int, NameReading]] = {}
    for one in readings:
        if one.kind == kind and one.index is not None:
            series.setdefault(one.stem, {}).setdefault(one.index, one)
    found = []
    for members in series.values():
        first = min(members)
        if first in (0, 1) and set(members) == set(range(first, first + count)):
            found.append([members[first + k] for k in range(count)])
    plainest = max(found, key=lambda chosen: min(one.weight for one in chosen), default=[])
    return tuple(one.name for one in plainest)


def _axes(readings: Iterable[NameReading], kind: Kind) -> dict[str, str]:
    """Return the columns of a kind by axis, of one family of names: that with the most axes, then the plainest."""
    families: dict[str, dict[str, NameReading]] = {}
    for one in readings:
        if one.kind == kind and one.axis is not None:
            families.setdefault(one.stem, {}).setdefault(one.axis, one)
    if not families:
        return {}
    best = max(families.values(), key=lambda f: (len(f) > 1, min(one.weight for one in f.values()), len(f)))
    # a heading by itself belongs to roll and pitch of another family
    for family in families.values() if len(best) > 1 else ():
        best = family | best
    return {axis: one.name for axis, one in best.items()}


def _quaternion(columns: Mapping[str, Floats]) -> tuple[str, ...]:
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


def _half_turn(roll: Floats, unit: str | None) -> float | None:
    """Return half a turn in the unit of a roll (N,) that shows an IMU upside down; None if it shows none."""
    known = roll[np.isfinite(roll)]
    for one, half in (("deg", 180.0), ("rad", np.pi)):
        near = np.abs(np.abs(known) - half) < UPSIDE_DOWN * 2.0 * half
        if unit in (None, one) and len(known) and near.mean() > UPSIDE_DOWN_ROWS:
            return half
    return None
