"""Which column of a foreign log is which quantity, by its name.

By names (`ballbot.log.mapping_inference.names`): a triple is as many columns of one kind and stem as the robot has
wheels, numbered from 1 or 0. Of several the plainest name is taken, a command before a measured current.

A name of one letter and a number, or of unknown words and a number, leaves open what its column is: m1 may be a motor's
command or its angle, w1 a wheel's angle or its speed, e1 an encoder or an error. Unless other names say plainly which
columns are the angles, such series are settled by their values (`ballbot.log.mapping_inference.open_names`).
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ballbot.log.imu_angles import less_half_a_turn
from ballbot.log.mapping_inference.command_signs import CommandZero
from ballbot.log.mapping_inference.name_words import ANGLE_WORDS
from ballbot.log.mapping_inference.names import Kind, Reading, efforts, read_name, read_names


@dataclass(frozen=True, kw_only=True)
class Roles:
    """The file's names of what the log is made of; empty or None if there is none."""

    time: str | None
    attitude: tuple[str, ...]  #: roll, pitch and, if there is one, yaw
    angles: tuple[str, ...]  #: a wheel each; or its speed, if they are `of_speeds`
    speeds: tuple[str, ...]
    commands: tuple[str, ...]
    #: Tx, Ty, Tz: commands about the body's axes, before they go to the wheels
    body_commands: tuple[str, ...]
    gyro: tuple[str, ...] = ()  #: about x, y and z
    quaternion: tuple[str, ...] = ()  #: w, x, y and z, of which the attitude is made
    half_turn: float | None = None  #: in the file's unit, if the roll shows that the IMU hangs upside down
    confidence: float = 1.0  #: that these are the columns
    alternatives: tuple[str, ...] = ()  #: other roles that the columns may have, in words
    #: complete series whose names do not say which quantity they are
    open_series: tuple[tuple[str, ...], ...] = ()
    set_points: bool = (
        False  #: whether the commands are set points of torque, the only commands that there are
    )
    zero: CommandZero | None = None  #: of commands that have no sign; None if their zero is zero
    directions: tuple[str, ...] = ()  #: of each command's direction, if the commands are magnitudes
    wrap: float | None = (
        None  #: period of the wheel angles in the file's numbers, if they begin again after it
    )
    of_speeds: bool = False  #: whether the file has wheel speeds alone, whose integrals are the angles
    time_parts: tuple[str, ...] = ()  #: the columns of seconds and nanoseconds of which the time is made
    units: Mapping[str, str] = field(default_factory=dict)  #: of columns, as a row below the header has them

    def reading(self, names: tuple[str, ...]) -> Reading | None:
        """Return what the name of the first of these columns says; None without columns."""
        if names and self.set_points and names == self.commands:
            return read_set_points(names, self.units)[0]
        return read_names(names, self.units)[0] if names else None

    @property
    def measured(self) -> Literal["angle", "speed"]:
        """What the file has of the wheels."""
        return "speed" if self.of_speeds else "angle"

    def unused(self, columns: Iterable[str]) -> list[Reading]:
        """Return what the names of the columns without a role say, of all but the wheels' speeds."""
        used = {self.time, *self.time_parts, *self.attitude, *self.quaternion, *self.gyro}
        used |= {*self.angles, *self.commands, *self.directions}
        return [one for one in read_names(list(columns), self.units) if one.name not in used]


#: norms of a unit quaternion [1 +-], in this share of the rows; some programs write zeros before the first message
UNIT_NORM, UNIT_ROWS = 0.02, 0.99
#: squares of a quaternion's x and y over those of another pair
CLEARLY_LESS = 0.25
_QUATERNION_MARKS = {"w": "wxyz", "W": "WXYZ", "0": "0123", "1": "1234"}
#: beside i, j and k, the scalar part is called so, in small letters
_REAL = ("real", "r", "re", "w", "s", "scalar")


#: a name says plainly that its column is an angle with at least this weight
PLAIN = 0.6


def roles_by_name(names: Iterable[str], *, wheel_count: int, units: Mapping[str, str] | None = None) -> Roles:
    """Return what the names, and the units in a row below them, say; see the module's text."""
    names = list(names)
    # one name alone does not say what its neighbours' names say of it
    units = efforts(names) | dict(units or {})
    readings = read_names(names, units)
    angles = _numbered(readings, "wheel angle", wheel_count)
    speeds = _numbered(readings, "wheel speed", wheel_count)
    plainly = {one.name for one in readings if one.weight >= PLAIN}
    commands = _numbered(readings, "command", wheel_count)
    if not commands and len(_triples(readings, "wheel angle", wheel_count)) > 1:
        # m1, m2, m3 beside enc1, enc2, enc3
        commands = _triples(readings, "wheel angle", wheel_count)[1]
    set_points = () if commands else _set_points(names, units, wheel_count)
    times = [one for one in readings if one.kind == "time"]
    attitude, gyro = axes_of(readings, "attitude"), axes_of(readings, "gyro")
    return Roles(
        time=max(times, key=lambda one: one.weight).name if times else None,
        attitude=tuple(attitude[axis] for axis in "xyz" if axis in attitude)
        if {"x", "y"} <= set(attitude)
        else (),
        angles=angles,
        speeds=speeds,
        commands=commands or set_points,
        set_points=bool(set_points),
        body_commands=tuple(one.name for one in readings if one.kind == "body command"),
        gyro=tuple(gyro[axis] for axis in "xyz") if len(gyro) == 3 else (),
        open_series=() if set(angles) & plainly else _open_series(readings, wheel_count, plainly),
        units=units,
    )


#: words of a set point
_ASKED = re.compile(
    r"(?<![A-Za-z])(set_?point|set|soll|ref|reference|target|tgt|des|desired|goal|sp|wanted)(?![A-Za-z])|Set|Soll|Ref",
    re.IGNORECASE,
)


def _set_points(names: Sequence[str], units: Mapping[str, str], count: int) -> tuple[str, ...]:
    """Return set points of the motors' torques, currents, duties or voltages: torque_set1, tau_ref_2."""
    asked = [name for name in names if _ASKED.search(name)]
    readings = [one for one in read_set_points(asked, units) if one.input_kind is not None]
    return _numbered(readings, "command", count)


def read_set_points(names: Sequence[str], units: Mapping[str, str]) -> list[Reading]:
    """Return what the names of set points say of what is set."""
    whole = {_ASKED.sub("", name): name for name in names}
    given = {short: units[name] for short, name in whole.items() if name in units}
    return [replace(one, name=whole[one.name]) for one in read_names(list(whole), given)]


def _open_series(readings: list[Reading], count: int, plainly: set[str]) -> tuple[tuple[str, ...], ...]:
    """Return the complete series of which no name says plainly what they are, in the file's order."""
    kinds: tuple[Kind, ...] = ("wheel angle", "wheel speed", "other")
    found = [
        series for kind in kinds for series in _triples(readings, kind, count) if not set(series) & plainly
    ]
    places = [one.name for one in readings]
    return tuple(sorted(found, key=lambda series: places.index(series[0])))


def quaternion_of(columns: Mapping[str, NDArray[np.float64]]) -> tuple[str, ...]:
    """Return the names of the w, x, y and z of an IMU's quaternion; empty if the columns hold none.

    Names say so by the letters w, x, y and z in one place, by i, j, k and real, or by four numbers from 0 or 1, as q0
    to q3; the values by a sum of squares that is one. Of numbered columns the two that stay small are x and y. Of
    several, one of the odometry comes last.
    """
    found = []
    for name in columns:
        if read_name(name).kind == "reference":
            continue
        found += [series for series in _with_real(name, columns) if _is_quaternion(_rows_of(series, columns))]
        for place, mark in enumerate(name):
            marks = _QUATERNION_MARKS.get(mark, "")
            series = tuple(name[:place] + one + name[place + 1 :] for one in marks)
            if series and all(one in columns for one in series):
                values = _rows_of(series, columns)
                if _is_quaternion(values):
                    found += [series] if mark.isalpha() else _in_order(series, values)
    return min(found, key=lambda series: "odom" in series[0].lower(), default=())


def _with_real(name: str, columns: Iterable[str]) -> list[tuple[str, ...]]:
    """Return the real part, i, j and k of the quaternions of which a column is the i by its name: quatI, rot_i."""
    spelled, found = {one.lower(): one for one in columns}, []
    for place in (place for place, mark in enumerate(name.lower()) if mark == "i"):
        before, after = name[:place].lower(), name[place + 1 :].lower()
        parts = [spelled.get(before + mark + after) for mark in "ijk"]
        real = next((spelled[key] for word in _REAL if (key := before + word + after) in spelled), None)
        vector = [one for one in parts if one is not None]
        if real is not None and len(vector) == len(parts):
            found.append((real, *vector))
    return found


def _rows_of(series: tuple[str, ...], columns: Mapping[str, NDArray[np.float64]]) -> NDArray[np.float64]:
    """Return columns (k, N) without the rows in which one has no value."""
    values = np.array([columns[one] for one in series])
    return values[:, np.isfinite(values).all(axis=0)]


def _is_quaternion(values: NDArray[np.float64]) -> bool:
    """Return whether columns (4, N) have norm one, or are zero before the first message, and do not stand still."""
    norm = np.linalg.norm(values, axis=0)
    unit = np.abs(norm - 1.0) < UNIT_NORM
    if not len(norm) or unit.mean() < 0.5 or np.mean(unit | (norm == 0.0)) < UNIT_ROWS:
        return False
    return bool(np.ptp(values, axis=1).any())


def _in_order(series: tuple[str, ...], values: NDArray[np.float64]) -> list[tuple[str, ...]]:
    """Return numbered columns (4, N) as w, x, y and z; none if it is not clear whether w is the first or the last."""
    size = (values**2).mean(axis=1)
    w_first, w_last = size[1] + size[2], size[0] + size[1]  # squares of what x and y then are
    if w_first < CLEARLY_LESS * w_last:
        return [series]
    return [(series[3], *series[:3])] if w_last < CLEARLY_LESS * w_first else []


#: the roll of an IMU that hangs upside down is within this of half a turn, in this share of the rows [turn]
UPSIDE_DOWN, UPSIDE_DOWN_ROWS = 0.1, 0.9
#: and has both signs in this share: an angle near 3 that keeps its sign may be in degrees
BOTH_SIGNS = 0.01


def half_turn_of(roll: NDArray[np.float64], unit: str | None) -> float | None:
    """Return half a turn in the unit of a roll (N,) that shows an IMU upside down; None if it shows none.

    Parameters
    ----------
    roll : ndarray (N,)
        As the file has it.
    unit : str, optional
        "rad" or "deg" if its name says so.
    """
    known = roll[np.isfinite(roll)]
    for one, half in (("deg", 180.0), ("rad", np.pi)):
        near = np.abs(np.abs(known) - half) < UPSIDE_DOWN * 2.0 * half
        if unit not in (None, one) or not len(known) or near.mean() < UPSIDE_DOWN_ROWS:
            continue
        if unit == one or one == "deg" or min(np.mean(known > 0.0), np.mean(known < 0.0)) > BOTH_SIGNS:
            return half
    return None


def half_turn(columns: Mapping[str, NDArray[np.float64]], roles: Roles) -> float | None:
    """Return half a turn in the unit of the roll, if that shows an IMU that hangs upside down."""
    named = roles.reading(roles.attitude)
    return half_turn_of(columns[roles.attitude[0]], named.unit if named else None) if roles.attitude else None


def upright(columns: Mapping[str, NDArray[np.float64]], roles: Roles) -> dict[str, NDArray[np.float64]]:
    """Return columns in which the roll of an IMU that hangs upside down is near zero."""
    half = half_turn(columns, roles)
    if half is None:
        return dict(columns)
    return {**columns, roles.attitude[0]: less_half_a_turn(columns[roles.attitude[0]], half)}


def _triples(readings: list[Reading], kind: Kind, count: int) -> list[tuple[str, ...]]:
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


def _numbered(readings: list[Reading], kind: Kind, count: int) -> tuple[str, ...]:
    return next(iter(_triples(readings, kind, count)), ())


def axes_of(readings: list[Reading], kind: Kind) -> dict[str, str]:
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
