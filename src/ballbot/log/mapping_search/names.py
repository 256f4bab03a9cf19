"""What the name of a foreign column says: its kind, axis or wheel, unit, and of a motor command what it commands.

A name is cut into words at separators, brackets, digits and capital letters, so that `GyroX_dps`, `gyro_x (deg/s)` and
`GYRO-X [dps]` have one reading. Words in brackets, or at the end, that are a unit are the unit. The rest decides the
kind:

A letter is the number of a wheel if the file has the same name with its neighbours: `cur_A` beside `cur_B` and `cur_C`
(`read_names`, by `ballbot.log.mapping_search.name_series`); alone, `cur_A` is a current in amperes.

1. A word for a set point (`ref`, `target`, `des`, `goal`, `cmd_vel`) or an error, a gain, a battery: never a
measurement.
2. Words for time, roll, pitch and yaw, gyro and accelerometer.
3. Words with the number of a wheel: a command, an angle or a speed.
4. The ball's position and velocity.

A name that says nothing is of the kind "other". No name is an error. How plainly a name says what it says is its
weight, from 0 to 1: `enc1_counts` says more than `m1`.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from ballbot.log.mapping_search.name_series import in_whole_words, numbered
from ballbot.log.mapping_search.name_words import (
    ACCELEROMETER,
    ANGLE,
    ANGLE_WORDS,
    ATTITUDE,
    COUNTER,
    DERIVATIVE,
    DUTCH_ANGLES,
    EMPTY,
    FIRST_PART,
    GYRO,
    INPUT,
    INPUT_OF_UNIT,
    LAST_PART,
    OTHER,
    RATE,
    RATES,
    REFERENCE,
    SPLIT_UNITS,
    TIME,
    TRANSLATED,
    UNIT_OF,
    UNITS,
    UNITS_OF_KIND,
    WHEEL,
    WHEEL_ANGLE,
    InputKind,
)

Kind = Literal[
    "time",
    "counter",
    "attitude",
    "gyro",
    "accelerometer",
    "wheel angle",
    "wheel speed",
    "command",
    "body command",
    "ball position",
    "ball velocity",
    "reference",
    "other",
]


@dataclass(frozen=True, kw_only=True)
class Reading:
    """What the name of a column says."""

    name: str  #: as the file has it
    kind: Kind
    axis: str | None = None  #: x, y or z; roll, pitch and yaw are x, y and z
    index: int | None = None  #: number of a wheel or motor, as the file counts
    unit: str | None = None  #: one of `UNITS`; None if the name has none that fits the kind
    input_kind: InputKind | None = None  #: of a command; of another column, what its unit would make it
    stem: str = ""  #: the words without number, axis and unit: columns of one group have one stem
    weight: float = 0.0  #: how plainly the name says it, from 0 to 1


def read_names(names: Sequence[str], units: Mapping[str, str] | None = None) -> list[Reading]:
    """Return what the names of a file's columns say; letters that number a series are read as its numbers.

    Parameters
    ----------
    names : sequence of str
    units : mapping of str to str, optional
        By name, as a row below the header has them; a unit in the name itself comes first.
    """
    found, whole = [], in_whole_words(names)
    dutch = any(word in DUTCH_ANGLES for name in names for word in re.findall("[a-z]+", name.lower()))
    for name in names:
        spelled, unit = (
            whole.get(name) or numbered(name, names),
            (units or {}).get(name, "").strip("[](){}<> "),
        )
        if dutch:
            spelled = re.sub(r"(?<![A-Za-z])stamp(?![A-Za-z])", "pitch", spelled, flags=re.IGNORECASE)
        with_unit = f"{spelled} [{unit}]" if unit and _words_and_unit(spelled)[1] is None else spelled
        found.append(replace(read_name(with_unit), name=name))
    return found


def efforts(names: Collection[str]) -> dict[str, str]:
    """Return N m by the names of the efforts that have a position and a velocity beside them, as in messages of ROS."""
    beside = {name: {name.replace("effort", one) for one in ("position", "velocity")} for name in names}
    return {name: "Nm" for name in names if "effort" in name and beside[name] <= set(names)}


def read_name(name: str) -> Reading:
    """Return what a column's name says; any text has a reading."""
    words, unit = _words_and_unit(name)
    axis, index, bare = _axis_and_index(words)
    stem = "".join(bare)
    present = set(bare)
    if present & REFERENCE or _is_set_point(words):
        return Reading(name=name, kind="reference", axis=axis, index=index, stem=stem, weight=0.9)
    # e_x is an error and p_roll a controller's part, but e1, e2 and e3 are encoders as often
    numbered_letter = bare in (["e"], ["p"]) and index is not None and axis is None
    letter = (bare[:1] in (["e"], ["p"]) and not numbered_letter) or (bare in (["i"], ["d"]) and axis)
    if present & OTHER or letter:
        return Reading(name=name, kind="other", axis=axis, index=index, stem=stem, weight=0.9)
    if unit is None and len(words) == 1:
        unit = next((one for one in ("s", "ms", "us", "ns") if words[0] in UNITS[one]), None)
    for find in (_time, _inertial, _wheel, _ball):
        found = find(_Cut(words=words, bare=bare, axis=axis, index=index, unit=unit))
        if found is None:
            continue
        kind, weight, found_axis, input_kind = found
        if kind == "wheel speed" and unit is None and "rpm" in present:
            unit = "rpm"
        fits = unit if unit in UNITS_OF_KIND.get(kind, ()) else None
        return Reading(
            name=name,
            kind=kind,
            axis=found_axis,
            index=index,
            unit=fits,
            input_kind=input_kind,
            stem=stem,
            weight=min(weight + (0.15 if fits else 0.0), 0.99),
        )
    of_unit = INPUT_OF_UNIT.get(unit or "")
    return Reading(
        name=name,
        kind="other",
        axis=axis,
        index=index,
        unit=unit if of_unit else None,
        input_kind=of_unit,
        stem=stem,
    )


@dataclass(frozen=True, kw_only=True)
class _Cut:
    """A name cut into words."""

    words: list[str]  #: without the unit
    bare: list[str]  #: without axis and number, too
    axis: str | None
    index: int | None
    unit: str | None


Found = tuple[Kind, float, str | None, InputKind | None]


def _words_and_unit(name: str) -> tuple[list[str], str | None]:
    """Return the words of a name in lower case without its unit, and the unit."""
    unit = None
    name = _without_accents(name)
    for content in re.findall(r"[\(\[\{]([^\)\]\}]*)[\)\]\}]", name):
        spelled = re.sub(r"[\s_·*\.]", "", content.lower())
        if spelled in UNIT_OF:
            unit = UNIT_OF[spelled]
            name = name.replace(content, " ")
    parts = [one for part in re.split(r"[^0-9A-Za-zµμ%°/^²]+", name) for one in _without_path(part) if one]
    if unit is None and len(parts) > 1:
        parts, unit = _unit_at_the_end(parts)
    if unit is None and len(parts) > 2 and (parts[-1].isdigit() or parts[-1].lower() in "xyz"):
        # before a number or an axis: torque_Nm_1
        rest, unit = _unit_at_the_end(parts[:-1])
        if unit in _ONE_LETTER and not {part.lower() for part in rest} & set(INPUT):
            unit = None
        parts = [*rest, parts[-1]] if unit else parts
    words = [one for part in parts for word in _split_part(part) for one in _in_english(word.lower())]
    if unit is None and len(words) > 1:
        # camel case: timeMs, angleDeg; one letter alone is an axis or a number
        last = words[-1]
        if (
            len(last) > 1
            and last in UNIT_OF
            and last not in {"rev", "tick", "ticks", "count", "counts", "volts"}
        ):
            unit, words = UNIT_OF[last], words[:-1]
    return words, unit


#: units with a slash, which no path has
_WITH_SLASH = tuple(spelling for spelling in UNIT_OF if "/" in spelling)


def _without_path(part: str) -> list[str]:
    """Return the parts between slashes of a path, such as the name of a ROS topic; a unit such as rad/s stays whole."""
    return [part] if part.lower().endswith(_WITH_SLASH) else part.split("/")


def _without_accents(name: str) -> str:
    """Return a name with plain letters for those with accents; signs such as µ and ° stay."""
    parted = unicodedata.normalize("NFD", name.replace("ł", "l").replace("Ł", "L").replace("ß", "ss"))
    return "".join(mark for mark in parted if not unicodedata.combining(mark))


def _in_english(word: str) -> list[str]:
    """Return a word in English, or the two that a word of another language is put together of, or the word itself."""
    if word in TRANSLATED:
        return [TRANSLATED[word]]
    cuts = ((word[:place], word[place:]) for place in range(3, len(word) - 2))
    parts = next((one for one in cuts if one[0] in FIRST_PART and one[1] in LAST_PART), None)
    return [FIRST_PART[parts[0]], LAST_PART[parts[1]]] if parts else [word]


_ONE_LETTER = ("A", "g", "m", "s", "V")


def _unit_at_the_end(parts: list[str]) -> tuple[list[str], str | None]:
    lower = [part.lower() for part in parts]
    for length in (3, 2):
        if len(lower) > length and tuple(lower[-length:]) in SPLIT_UNITS:
            return parts[:-length], SPLIT_UNITS[tuple(lower[-length:])]
    last = lower[-1]
    if last not in UNIT_OF or (last in {"a", "g", "m", "s", "v"} and _is_letter_of_a_series(parts)):
        return parts, None
    # enc_1_ticks is an encoder's angle in counts; enc_ticks without a number keeps its word
    return parts[:-1], UNIT_OF[last]


def _is_letter_of_a_series(parts: list[str]) -> bool:
    """Return whether a last letter names a motor (motor_a) and is no unit: nothing before it has a number."""
    return parts[-1].lower() == "a" and not any(mark.isdigit() for part in parts for mark in part) and (
        len(parts) == 2 and parts[0].lower() in WHEEL
    )  # fmt: skip


def _split_part(part: str) -> list[str]:
    """Return a part cut at digits and capitals: `GyroX` is Gyro, X; `IMURoll` is IMU, Roll."""
    return re.findall(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-zµμ]+|[A-Z]+|[0-9]+|[%°/^²]+", part)


def _axis_and_index(words: list[str]) -> tuple[str | None, int | None, list[str]]:
    """Return axis, number and the words left; `wx`, `gyrox` and `dpsi` are cut, too."""
    axis, index, bare = None, None, []
    for place, word in enumerate(words):
        if word.isascii() and word.isdigit():
            index = int(word[:9])
        elif word in ("x", "y", "z") and len(words) > 1:
            axis = word
        elif word in ("a", "b", "c") and place and words[place - 1] in WHEEL:
            index = "abc".index(word) + 1
        else:
            cut, found = _cut_axis(word)
            axis = found or axis
            bare += cut
    return axis, index, bare


_BEFORE_AXIS = {
    *GYRO,
    *ACCELEROMETER,
    *ATTITUDE,
    "omega",
    "vel",
    "pos",
    "ball",
    "tau",
    "torque",
    "rot",
    "phi",
    "mag",
}
_AFTER_D = {"psi", "theta", "phi", "roll", "pitch", "yaw", "q", "enc", "wheel", "x", "y", "th", "angle"}


def _cut_axis(word: str) -> tuple[list[str], str | None]:
    if word[-1:] in ("x", "y", "z") and word[:-1] in _BEFORE_AXIS:
        return [word[:-1]], word[-1]
    short = {
        "g": "gyro",
        "a": "acc",
        "w": "omega",
        "t": "tau",
        "v": "vel",
        "r": "rpy",
        "m": "mag",
        "u": "tau",
    }
    if len(word) == 2 and word[1] in "xyz" and word[0] in short:
        return [short[word[0]]], word[1]
    if word[:1] == "d" and word[1:] in _AFTER_D:
        return (["d"], word[1:]) if word[1:] in ("x", "y") else (["d", word[1:]], None)
    if word.endswith("dot") and word[:-3] in _AFTER_D:
        return ([word[:-3], "dot"], None) if word[:-3] not in ("x", "y") else (["dot"], word[:-3])
    return [word], None


def _is_set_point(words: list[str]) -> bool:
    """Return whether the words are a command to the robot, not to a motor, or a desired angle (theta_d_x)."""
    asked = {"cmd", "command", "set", "soll"} & set(words)
    to_body = {
        "vel",
        "velocity",
        "x",
        "y",
        "z",
        "lin",
        "ang",
        "linear",
        "angular",
        "pose",
        "pos",
        "position",
        "speed",
    }
    lean = {*ANGLE_WORDS, "theta", "psi", "phi"}
    if asked and set(words) & (to_body | lean):
        return True
    return "d" in words[1:] and bool(set(words[: words.index("d", 1)]) & lean)


def _time(cut: _Cut) -> Found | None:
    words, bare, axis, index = cut.words, cut.bare, cut.axis, cut.index
    present = set(bare) - EMPTY
    if present & {"loop", "exec"} or ("cycle" in present and "duty" not in present):
        return ("other", 0.6, None, None)
    if index is None and axis is None:
        if present & TIME:
            return ("time", 0.8, None, None)
        if words and all(word in _UNITS_OF_TIME for word in words):
            return ("time", 0.7, None, None)
        if present == {"t"}:
            return ("time", 0.75, None, None)
        if present and present <= COUNTER:
            return ("counter", 0.6, None, None)
    return None


_UNITS_OF_TIME = {spelling for unit in ("ms", "us", "ns") for spelling in UNITS[unit]} | {
    "sec",
    "secs",
    "seconds",
}
_EULER = {"theta": "x", "phi": "y", "psi": "z"}
_NUMBERED_AXES = {0: "x", 1: "x", 2: "y", 3: "z"}


def _inertial(cut: _Cut) -> Found | None:
    """Return roll, pitch, yaw, gyro or accelerometer."""
    bare, axis, index, unit = cut.bare, cut.axis, cut.index, cut.unit
    present = set(bare)
    if present & {"ball", "wheel", "enc", "encoder", "motor", "odom", "rad"}:
        return None
    if present & GYRO and (axis or present & set(ANGLE_WORDS)):
        return ("gyro", 0.85, axis or _angle_axis(bare), None)
    if present & ACCELEROMETER and axis:
        return ("accelerometer", 0.85, axis, None)
    named = _angle_axis(bare)
    changing = bool(present & DERIVATIVE) or unit in RATE
    if named:
        return ("gyro" if changing else "attitude", 0.8 if changing else 0.85, named, None)
    if axis and index is None and not present & {"phi", "psi", "pos"}:
        if present & RATES or (present & ATTITUDE and changing):
            return ("gyro", 0.6, axis, None)
        if present & ATTITUDE:
            return ("attitude", 0.7, axis, None)
    euler = [word for word in bare if word in _EULER]
    if len(euler) == 1 and index is None and axis is None and present <= {*_EULER, *DERIVATIVE}:
        return ("gyro" if changing else "attitude", 0.6, _EULER[euler[0]], None)
    if bare == ["rpy"] and index is not None:
        return ("attitude", 0.7, _NUMBERED_AXES.get(index), None)
    return None


def _angle_axis(bare: Collection[str]) -> str | None:
    for word in bare:
        for stem, axis in ANGLE_WORDS.items():
            if word == stem or (
                word.endswith(stem) and word[: -len(stem)] in {*ATTITUDE, *GYRO, "d", "droll"}
            ):
                return axis
    return None


def _wheel(cut: _Cut) -> Found | None:
    """Return a motor's command, or a wheel's angle or speed."""
    bare, axis, index, unit = cut.bare, cut.axis, cut.index, cut.unit
    present = set(bare) - EMPTY | ({"cur"} & set(bare))
    inputs = [word for word in bare if word in INPUT]
    if axis and inputs and index is None:
        return ("body command", 0.6, axis, None)
    if index is None or axis:
        return None
    of_unit = INPUT_OF_UNIT.get(unit or "")
    if "duty" in present:
        present -= {"cycle"}
    known = present <= {*WHEEL, *WHEEL_ANGLE, *DERIVATIVE, *INPUT, "left", "right", "control", "ctrl", "req"}
    if present and not known and of_unit in ("torque", "current"):
        return ("command", 0.4, None, of_unit)  # words of any language
    if not known or not present:
        return None
    # the w of theta_w1 is the wheel
    rates = present & DERIVATIVE - ({"w"} if present & WHEEL_ANGLE else set())
    moving = unit in RATE or (bool(rates) and unit not in ANGLE and unit not in ("A", "N m", "V"))
    if inputs and not (moving and not of_unit and present & {"d", "dot", "vel", "speed", "velocity", "rpm"}):
        kinds: list[InputKind] = [kind for word in inputs if (kind := INPUT[word])]
        # i1 is a current as often as it is anything else
        one: InputKind | None = of_unit or (kinds[0] if kinds and present != {"i"} else None)
        return ("command", 0.75 if one else 0.6, None, one)
    if of_unit and unit != "%":
        return ("command", 0.7, None, of_unit)
    if moving:
        plain = present & {"speed", "vel", "velocity", "rpm", "dot", "d", "spd"} or unit in RATE
        return ("wheel speed", 0.75 if plain else 0.5, None, None)
    if present & (WHEEL | WHEEL_ANGLE):
        plain = present & {"enc", "encoder", "encoders", "ticks", "tick", "counts", "count"} or unit in ANGLE
        is_angle = bool(present & (WHEEL_ANGLE | {"wheel", "wheels", "whl"}))
        return ("wheel angle", 0.8 if plain else 0.65 if is_angle else 0.4, None, None)
    return None


def _ball(cut: _Cut) -> Found | None:
    words, bare, axis, index = cut.words, cut.bare, cut.axis, cut.index
    present = set(bare)
    if index is not None:
        return None
    if words in (["x"], ["y"]):
        return ("ball position", 0.5, words[0], None)
    if axis is None or axis == "z":
        return None
    if present & {"vel", "velocity", "dot", "d", "v"} and present <= {
        "ball",
        "vel",
        "velocity",
        "dot",
        "d",
        "v",
        "odom",
    }:
        return ("ball velocity", 0.6, axis, None)
    if present and present <= {"ball", "pos", "position", "odom"}:
        return ("ball position", 0.6, axis, None)
    return None
