"""Read the names of a foreign table: the kind, axis or wheel, and unit of each column, and its role in the log.

A name is cut into words at separators, brackets, digits and capital letters, so that `GyroX_dps`, `gyro_x (deg/s)` and
`GYRO-X [dps]` have one reading. Words in brackets, or at the end, that are a unit are the unit. Letters, corners and
sides that number a series are its numbers: `cur_A` beside `cur_B` and `cur_C` (`read_names`); alone, `cur_A` is a
current in amperes. The rest decides the kind:

1. A word for a set point, an error, a gain or a battery: never a measurement.
2. Words for time, roll, pitch and yaw, and gyro.
3. Words with the number of a wheel: a command, an angle or a speed.

A name without a known word is of the kind "other". The weight, from 0 to 1, is how clearly a name states its kind.

A series is as many columns of one kind and stem as the robot has wheels, numbered from 1 or 0. Of several the plainest
name is taken.
"""

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from ballbot.arrays import Floats
from ballbot.errors import InputError
from ballbot.log.columns import FACTORS, UNIT_OF, UNITS, unit_at_the_end, unit_spelled
from ballbot.log.formats.text import ForeignTable
from ballbot.log.imu_angles import QUATERNION_ANGLES, quaternion_angles, within_half_a_turn

InputKind = Literal["torque", "current", "voltage", "duty"]
Kind = Literal["time", "attitude", "gyro", "wheel angle", "wheel speed", "command", "other"]

_ANGLES = ("rad", "deg", "turn", "counts")
_RATES = ("rad/s", "deg/s", "mdeg/s", "mrad/s", "rpm", "turn/s", "rps", "counts/s")
#: the unit of a command by its kind, and its kind by all units that convert to it
UNIT_OF_INPUT: dict[InputKind, str] = {"torque": "N m", "current": "A", "voltage": "V"}
INPUT_OF_UNIT: dict[str, InputKind] = {"%": "duty"}
INPUT_OF_UNIT |= {name: kind for kind, unit in UNIT_OF_INPUT.items() for name in FACTORS[unit]}
#: units that a kind can have
_UNITS_OF_KIND: dict[Kind, tuple[str, ...]] = {
    "time": ("s", "ms", "us", "ns"),
    "attitude": ("rad", "deg", "mrad", "cdeg"),
    "gyro": ("rad/s", "deg/s", "mdeg/s", "mrad/s"),
    "wheel angle": (*_ANGLES, "mm"),  # of path
    "wheel speed": _RATES,
    "command": tuple(INPUT_OF_UNIT),
    "other": (),
}

#: the words of names, English and German, by meaning
_WORDS = {
    group: frozenset(words.split())
    for group, words in {
        "other": "ref reference target tgt setpoint sp des desired goal wanted traj err error kp ki kd gain gains bat "
        "batt battery vbat supply temp bus temperature mag magnetometer status state mode abort flag cost cpu bias std "
        "var cov integral est dt period latency load checksum crc joy joystick loop exec cycle acc accel accelerometer "
        "acceleration linacc akku batterie temperatur fehler zustand beschleunigung",
        "time": "time tv timestamp stamp clock elapsed utime tsec tnow ts seconds millis micros zeit zeitstempel "
        "uhrzeit",
        "x": "roll rollwinkel",
        "y": "pitch nick nickwinkel",
        "z": "yaw heading gier gierwinkel",
        "attitude": "theta imu lean rpy angle ang tilt euler att attitude th orientation neigung",
        "gyro": "gyro gyr gyroscope gyroskop drehrate",
        "rate": "omega w rate angvel av",
        "changing": "d dot rate vel velocity speed rpm omega w spd angvel drehzahl geschwindigkeit",
        "no inertial": "ball wheel enc encoder motor odom rad",
        "wheel": "wheel wheels enc encoder encoders motors joints motor mot m joint vesc whl w rad drehgeber",
        "wheel angle": "winkel radwinkel psi pos position weg q angle ang ticks tick count counts th theta phi tacho "
        "tachometer inkremente",
        "command": "torque torques currents tau trq effort moment drehmoment current cur curr amps iq strom motorstrom "
        "i duty pwm throttle servo esc dutycycle voltage volt volts spannung u t cmd command out output stellwert "
        "stellgroesse",
        # commands of no kind
        "plain command": "u t cmd command out output stellwert stellgroesse",
        "speed": "speed vel velocity rpm dot d spd drehzahl",
        "counter": "enc encoder encoders ticks tick counts count inkremente",
        # a command to the robot, if these stand beside a word for one
        "asked": "cmd command set soll",
        "of the body": "vel velocity x y z lin ang linear angular pose pos position speed",
        "empty": "now raw val value data meas measured actual act filtered filt body states field ist soll left right "
        "control ctrl req",
    }.items()
}
_EULER = {"theta": "x", "phi": "y", "psi": "z"}
_LEAN = {word for axis in "xyz" for word in _WORDS[axis]} | set(_EULER)
_KNOWN = frozenset().union(*_WORDS.values())
_LONG = "|".join(sorted((word for word in _KNOWN if len(word) > 2), key=len, reverse=True))
#: words that are written as one: imuroll, gyrox, dpsi, motorstrom
_GLUED = re.compile(rf"(d)?((?:{_LONG})+|q|th)([xyz])?")
#: series that number a robot's wheels without digits: letters, corners and sides
_SERIES = ("abcdef", ("fl", "fr", "rl", "rr"), ("lf", "rf", "lr", "rr"), ("fl", "fr", "bl", "br"),
           ("front", "rear", "back", "left", "right"))  # fmt: skip
_UMLAUTS = str.maketrans({"ä": "ae", "ö": "oe", "ü": "ue", "ß": "ss"})
_ONE_LETTER = ("A", "m", "s", "V")


@dataclass(frozen=True, kw_only=True)
class NameReading:
    """The meaning of a column's name."""

    name: str  #: as the file has it
    kind: Kind
    axis: str | None = None  #: x, y or z; roll, pitch and yaw are x, y and z
    index: int | None = None  #: number of a wheel or motor, as the file counts
    unit: str | None = None  #: one of `columns.UNITS`; None if the name has none that fits the kind
    stem: str = ""  #: the words without number, axis and unit: columns of one group have one stem
    weight: float = 0.0  #: how clearly the name states its kind, from 0 to 1


def read_names(names: Sequence[str], units: Mapping[str, str]) -> list[NameReading]:
    """Return the readings of a file's column names; `units`, by name, are those of a row below the header."""
    numbered, readings = _numbered(names), []
    for name in names:
        spelled, unit = numbered.get(name, name), units.get(name, "").strip("[](){}<> ")
        with_unit = f"{spelled} [{unit}]" if unit and _words_and_unit(spelled)[1] is None else spelled
        readings.append(replace(read_name(with_unit), name=name))
    return readings


def _numbered(names: Sequence[str]) -> dict[str, str]:
    """Return, by name, names with a number in place of a letter, corner or side that numbers a series of three or more.

    Letters count in their order, the others in that of the file.
    """
    series: dict[tuple[str, str, int], list[tuple[str, str]]] = {}
    for name in names:
        for part in re.finditer(r"[A-Z]?[a-z]+|[A-Z]+", name) if not re.search(r"\d", name) else ():
            for k, members in enumerate(_SERIES):
                if part.group().lower() in tuple(members):
                    before, after = name[: part.start()], name[part.end() :]
                    series.setdefault((before, after, k), []).append((name, part.group().lower()))
    numbered: dict[str, str] = {}
    for (before, after, k), members in series.items():
        if k == 0:
            members.sort(key=lambda member: member[1])
        if len(members) < 3 or (k == 0 and not "abcdef".startswith("".join(letter for _, letter in members))):
            continue
        for index, (name, _) in enumerate(members, start=1):
            numbered.setdefault(name, f"{before}{index}{after}")
    return numbered


def read_name(name: str) -> NameReading:
    """Return the reading of a column's name; every text has one."""
    words, unit = _words_and_unit(name)
    axis, index, bare = None, None, list[str]()
    for word in words:
        if word.isascii() and word.isdigit():
            index = int(word[:9])
        elif word in ("x", "y", "z") and len(words) > 1:
            axis = word
        else:
            bare.append(word)
    if unit is None and "effort" in bare:
        unit = "N m"  # as messages of ROS define it
    if unit is None and bare == words and len(words) == 1 and UNIT_OF.get(words[0]) in _UNITS_OF_KIND["time"]:
        unit = UNIT_OF[words[0]]
    kind, weight, axis = _kind(words, bare, axis, index, unit)
    if kind == "wheel speed" and unit is None and "rpm" in bare:
        unit = "rpm"
    fits = unit if unit in _UNITS_OF_KIND[kind] else None
    weight = min(weight + (0.15 if fits else 0.0), 0.99)
    stem = "".join(word for word in bare if kind not in ("attitude", "gyro") or word not in _LEAN)
    return NameReading(name=name, kind=kind, axis=axis, index=index, unit=fits, stem=stem, weight=weight)


def _kind(
    words: list[str], bare: list[str], axis: str | None, index: int | None, unit: str | None
) -> tuple[Kind, float, str | None]:
    """Return the kind, the weight and the axis of words, and of these without axis and number (`bare`)."""
    present = set(bare) - ({"cycle"} if "duty" in bare else set())
    says = {group for group, spelled in _WORDS.items() if present & spelled}
    after_lean = "d" in words[1:] and bool(set(words[: words.index("d", 1)]) & (_LEAN | {"theta"}))
    asked = "asked" in says and bool(set(words) & (_WORDS["of the body"] | _LEAN))
    if "other" in says or after_lean or asked or bare[:1] in (["e"], ["p"]):
        return "other", 0.0, axis
    plain = index is None and axis is None
    times = _UNITS_OF_KIND["time"]
    of_time = bool(words) and all(UNIT_OF.get(word) in times and word != "s" for word in words)
    if plain and ("time" in says or present - _WORDS["empty"] == {"t"} or of_time):
        return "time", 0.8 if "time" in says else 0.7, None
    if "no inertial" not in says:
        named = next((axis for axis in "xyz" if axis in says), None)
        changing = "changing" in says or unit in _RATES
        euler = present & set(_EULER)
        if "gyro" in says and (axis or named):
            return "gyro", 0.85, axis or named
        if named:
            return ("gyro", 0.8, named) if changing else ("attitude", 0.85, named)
        if axis and index is None and not present & {"phi", "psi", "pos"}:
            if "rate" in says or ("attitude" in says and changing):
                return "gyro", 0.6, axis
            if "attitude" in says:
                return "attitude", 0.7, axis
        if len(euler) == 1 and plain and present <= euler | _WORDS["changing"]:
            return "gyro" if changing else "attitude", 0.6, _EULER[euler.pop()]
    if index is not None and axis is None:
        return *_of_wheel(present - _WORDS["empty"], unit), None
    return "other", 0.0, axis


def _of_wheel(present: set[str], unit: str | None) -> tuple[Kind, float]:
    """Return whether words with a number are a motor's command, or a wheel's angle or speed, and the weight."""
    topics = "wheel", "wheel angle", "changing", "command"
    wheel, angle, changing, command = (_WORDS[topic] for topic in topics)
    of_unit = INPUT_OF_UNIT.get(unit or "")
    if not present <= wheel | angle | changing | command:
        # words of any language
        return ("command", 0.4) if of_unit in ("torque", "current") else ("other", 0.0)
    # the w of theta_w1 is the wheel
    rates = present & changing - ({"w"} if present & angle else set())
    moving = unit in _RATES or (bool(rates) and unit not in _ANGLES and not of_unit)
    if present & command and not (moving and present & _WORDS["speed"]):
        # i1 is a current as often as it is anything else
        says_kind = of_unit or (present & command - _WORDS["plain command"] and present != {"i"})
        return "command", 0.75 if says_kind else 0.6
    if of_unit and unit != "%":
        return "command", 0.7
    if moving:
        return "wheel speed", 0.75 if present & _WORDS["speed"] or unit in _RATES else 0.5
    if present & _WORDS["counter"] or unit in _ANGLES:
        return "wheel angle", 0.8
    return ("wheel angle", 0.65) if present & (angle | {"wheel", "wheels", "whl"}) else ("other", 0.0)


def stated_unit(name: str, units: Mapping[str, str]) -> str | None:
    """Return the unit, a key of `UNITS`, of a column by the row of units below the names, or by its name; else None.

    The name has it in brackets at its end, or as `UNITS` spells it; a single letter at the end does not count as a
    unit: position_m may be the motor's.

    >>> [stated_unit(name, {}) for name in ("speed [rpm]", "rpm", "angleDeg", "F [kN]", "position_m", "velocity")]
    ['rpm', 'rpm', 'deg', 'kN', None, None]
    """
    bracketed = re.search(r"[\[(<]([^\])>]*)[\])>]$", name)
    if given := units.get(name, "").strip("[](){}<> ") or (bracketed[1].strip() if bracketed else ""):
        unit = unit_spelled(given) or given
        return unit if unit in UNITS else None
    parts = re.split(r"[^\w/%°²]|_", name)
    before, unit = unit_at_the_end(["", *parts])
    if unit is None:
        return _words_and_unit(name)[1]
    return unit if len("".join(parts[len(before) - 1 :])) > 1 else None


def _words_and_unit(name: str) -> tuple[list[str], str | None]:
    """Return the words of a name in lower case without its unit, and the unit."""
    unit, name = None, name.translate(_UMLAUTS)
    for content in re.findall(r"[\(\[\{]([^\)\]\}]*)[\)\]\}]", name):
        if spelled := unit_spelled(content):
            unit, name = spelled, name.replace(content, " ")
    name = re.sub(r"/(?!(?:s|sec|min)\b)", " ", name)  # of a path, not of a unit
    parts = [part for part in re.split(r"[^0-9A-Za-zµμ%°/^²]+", name) if part]
    if unit is None:
        parts, unit = unit_at_the_end(parts)
    if unit is None and len(parts) > 2 and (parts[-1].isdigit() or parts[-1].lower() in "xyz"):
        rest, unit = unit_at_the_end(parts[:-1])  # before a number or an axis: torque_Nm_1
        if unit in _ONE_LETTER and not {part.lower() for part in rest} & _WORDS["command"]:
            unit = None
        parts = [*rest, parts[-1]] if unit else parts
    pieces = [piece.lower() for part in parts for piece in _CAPITALS.findall(part)]
    words = [word for piece in pieces for word in _parted(piece)]
    # camel case: timeMs, angleDeg; one letter alone is an axis or a number
    last = words[-1] if len(words) > 1 and len(words[-1]) > 1 else ""
    if unit is None and last in UNIT_OF and last not in _WORDS["wheel angle"] | _WORDS["command"]:
        unit, words = UNIT_OF[last], words[:-1]
    return words, unit


#: `GyroX` is Gyro, X; `IMURoll` is IMU, Roll
_CAPITALS = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-zµμ]+|[A-Z]+|[0-9]+|[%°/^²]+")


def _parted(word: str) -> list[str]:
    """Return the words that make up a word in lower case; the word itself if they are not known."""
    if word in _KNOWN or word in UNIT_OF:
        return [word]
    if re.fullmatch("[gw][xyz]", word):
        return ["gyro", word[1]]
    match = _GLUED.fullmatch(word)
    if not match:
        return [word]
    d, middle, axis = match.groups(default="")
    return [*d, *(re.findall(_LONG, middle) or [middle]), *axis]


#: norm of a unit quaternion [1 +-], in nearly all rows
UNIT_NORM, UNIT_ROWS = 0.02, 0.99
#: the roll of an IMU that hangs upside down is within this part of a turn of half a turn, in this share of the rows
UPSIDE_DOWN, UPSIDE_DOWN_ROWS = 0.1, 0.9


@dataclass(frozen=True, kw_only=True)
class Roles:
    """The file's column of each quantity of the log; empty or None for a quantity without a column."""

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

    InputError, with what to give as --columns, if no name says which column is the time, or which are lean or wheels.
    """
    table.need_names(path, "t,roll,pitch,yaw,enc1,enc2,enc3,u1,u2,u3")
    columns, quaternion = dict(table.columns), next(iter(quaternions(table.columns)), ())
    names = [name for name in columns if name not in quaternion]
    roles = roles_by_name(names, wheel_count=wheel_count, units=table.units)
    if quaternion and not roles.attitude:
        columns |= quaternion_angles(np.column_stack([columns[name] for name in quaternion]))
        roles = replace(roles, attitude=QUATERNION_ANGLES, quaternion=quaternion)
    if not roles.attitude:
        roles = replace(roles, attitude=_odometry_angles(columns))
    missing = "column is named as a time" if not roles.time else ""
    if not roles.angles and not roles.attitude:
        missing = f"columns are named as roll and pitch, and none as the angles of {wheel_count} wheels"
    if missing:
        raise InputError(
            f"{path}: no {missing} (the columns are {', '.join(names)}). Name the columns in the file's order with "
            "--columns t,roll,pitch,.. (_ for a column that is not needed), or write a mapping file."
        )
    if roles.attitude and not roles.quaternion:
        unit, lean = roles.unit(roles.attitude), {name: columns[name] for name in roles.attitude[:2]}
        if turn := _turn_near(np.concatenate([*lean.values()]), 1.0, unit):
            columns |= {name: within_half_a_turn(angle, 0.5 * turn) for name, angle in lean.items()}
        half = _turn_near(columns[roles.attitude[0]], 0.5, unit)
        roles = replace(roles, half_turn=half and 0.5 * half)
    return replace(table, columns=columns), roles


def roles_by_name(names: Sequence[str], *, wheel_count: int, units: Mapping[str, str]) -> Roles:
    """Return what the names, and the units in a row below them, say."""
    readings = read_names(names, units)
    kinds: tuple[Kind, ...] = ("wheel angle", "wheel speed", "command")
    angles, speeds, commands = (_series(readings, kind, wheel_count) for kind in kinds)
    times = [reading for reading in readings if reading.kind == "time"]
    attitude, gyro = _axes(readings, "attitude"), _axes(readings, "gyro")
    return Roles(
        time=max(times, key=lambda reading: reading.weight).name if times else "",
        attitude=tuple(attitude[axis] for axis in sorted(attitude)) if {"x", "y"} <= set(attitude) else (),
        gyro=tuple(gyro[axis] for axis in "xyz") if len(gyro) == 3 else (),
        angles=angles or speeds,
        of_speeds=not angles and bool(speeds),
        commands=commands,
        units={reading.name: reading.unit for reading in readings if reading.unit},
    )


def _series(readings: Iterable[NameReading], kind: Kind, count: int) -> tuple[str, ...]:
    """Return the complete series of columns of a kind with the plainest names; empty without one."""
    series: dict[str, dict[int, NameReading]] = {}
    for reading in readings:
        if reading.kind == kind and reading.index is not None:
            series.setdefault(reading.stem, {}).setdefault(reading.index, reading)
    candidates = []
    for members in series.values():
        first = min(members)
        if first in (0, 1) and set(members) == set(range(first, first + count)):
            candidates.append([members[first + k] for k in range(count)])
    plainest = max(candidates, key=lambda chosen: min(reading.weight for reading in chosen), default=[])
    return tuple(reading.name for reading in plainest)


def _axes(readings: Iterable[NameReading], kind: Kind) -> dict[str, str]:
    """Return the columns of a kind by axis, of one family of names: that with the most axes, then the plainest."""
    families: dict[str, dict[str, NameReading]] = {}
    for reading in readings:
        if reading.kind == kind and reading.axis is not None:
            families.setdefault(reading.stem, {}).setdefault(reading.axis, reading)
    if not families:
        return {}
    best = max(families.values(), key=lambda f: (len(f) > 1, min(r.weight for r in f.values()), len(f)))
    # a heading by itself belongs to roll and pitch of another family
    for family in families.values() if len(best) > 1 else ():
        best = family | best
    return {axis: reading.name for axis, reading in best.items()}


#: what the names of a quaternion's columns differ in: w, x, y, z; or the scalar first or last, in the file's order
_QUATERNIONS = ("wxyz", "rijk", "sijk", "sxyz", "0123", "1234", "abcd")
#: roll and pitch of a robot are so many times less by the right order than by the other, mean squares
_UPRIGHT = 4.0


def quaternions(columns: Mapping[str, Floats]) -> list[tuple[str, ...]]:
    """Return the names of the w, x, y and z of each quaternion, those of odometry last: the sum of squares is one.

    Numbers do not show whether the scalar is the first or the last: it is where the robot stands upright.
    """
    found = []
    for marks in _QUATERNIONS:
        for series in marked_series(columns, marks):
            values = np.column_stack([columns[column] for column in series])
            if not is_quaternion(values) or not np.ptp(np.nan_to_num(values), axis=0).any():
                continue
            power = np.nansum(values**2, axis=0)
            first, last = power[1] + power[2], power[0] + power[1]
            if marks[-1] in "zk" or _UPRIGHT * first < last:
                found.append(series)
            elif _UPRIGHT * last < first:
                found.append((series[3], *series[:3]))
    return sorted(found, key=lambda series: "odom" in series[0].lower())


def marked_series(names: Collection[str], marks: str) -> list[tuple[str, ...]]:
    """Return the names that differ in one letter alone, each of the marks in turn, all small or all capitals."""
    series = (
        tuple(name[:position] + mark + name[position + 1 :] for mark in letters)
        for name in names
        for letters in dict.fromkeys((marks, marks.upper()))
        for position, letter in enumerate(name)
        if letter == letters[0]
    )
    return [one for one in series if all(name in names for name in one)]


def is_quaternion(values: Floats) -> bool:
    """Return whether columns (N, 4) are a unit quaternion's, with zeros or nothing where it is unknown."""
    norm = np.linalg.norm(values[np.isfinite(values).all(axis=1)], axis=1)
    unit = np.abs(norm - 1.0) < UNIT_NORM
    return bool(unit.any() and np.mean(unit | (norm == 0.0)) > UNIT_ROWS)


#: what the values of columns of an attitude look like
ATTITUDE_LOOKS = ("a quaternion", "angles of 0 to 360 degrees")
#: part of its range by which an angle of 0 to 360 degrees comes near both ends
_NEAR_ENDS = 0.05


def unread_columns(columns: Mapping[str, Floats], roles: Roles) -> dict[str, list[str]]:
    """Return the columns without a role by what their values look like, which is empty if they do not show it."""
    used = {roles.time, *roles.attitude, *roles.angles, *roles.commands, *roles.gyro, *roles.quaternion}
    rest = {name: values for name, values in columns.items() if name not in used | {*QUATERNION_ANGLES}}
    looks, names = dict[str, str](), list(rest)
    for name, values in rest.items():
        known = values[np.isfinite(values)]
        low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 0.0)
        in_a_turn = 0.0 <= low < 360.0 * _NEAR_ENDS and 360.0 * (1.0 - _NEAR_ENDS) < high <= 360.0
        alike = (np.diff(known) == np.diff(known[:2])).all() and high > low
        turned = ATTITUDE_LOOKS[1] if in_a_turn else ""
        looks[name] = "constant" if low == high else turned or ("a counter" if alike else "")
    for k in range(len(names) - 3):
        if is_quaternion(np.column_stack([rest[name] for name in names[k : k + 4]])):
            looks |= dict.fromkeys(names[k : k + 4], ATTITUDE_LOOKS[0])
    return {look: [name for name in looks if looks[name] == look] for look in dict.fromkeys(looks.values())}


def _odometry_angles(columns: Mapping[str, Floats]) -> tuple[str, ...]:
    """Return roll, pitch and yaw of a message of odometry whose lean is not always zero; empty if there is none."""
    for name in columns:
        if "odom" in name.lower() and name.endswith("orientation.roll"):
            angles = tuple(name.removesuffix("roll") + angle for angle in ("roll", "pitch", "yaw"))
            if all(angle in columns for angle in angles) and np.nan_to_num(columns[name]).any():
                return angles
    return ()


def _turn_near(angles: Floats, part: float, unit: str | None) -> float | None:
    """Return a turn in the unit of angles (N,) near half a turn, or from zero to one near its ends, as `part` says.

    None if they are not there: an IMU upside down has its roll near half a turn.
    """
    known = angles[np.isfinite(angles)]
    for angle_unit, turn in (("deg", 360.0), ("rad", 2.0 * np.pi)):
        near = np.abs(within_half_a_turn(known - part * turn, 0.5 * turn)) < UPSIDE_DOWN * turn
        inside = part < 1.0 or (known.min(initial=0.0) >= 0.0 and 0.5 * turn < known.max(initial=0.0) <= turn)
        if unit in (None, angle_unit) and known.size and inside and near.mean() > UPSIDE_DOWN_ROWS:
            return turn
    return None
