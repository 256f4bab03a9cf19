"""Names that only their neighbours explain: letters and places that number a series, and axes of one letter.

`cur_A` beside `cur_B` and `cur_C` is the first of a series; so is `enc_left` beside `enc_right` and `enc_rear`. `p`
beside `q` and `r` is the angular velocity about x, and `r` beside `p` and `y` the roll.
"""

from __future__ import annotations

import re
from collections.abc import Collection

#: a letter that is a word: cur_A, I_A_mA, encA
_LETTER = re.compile(r"(?<![A-Za-z])[A-Fa-f](?![A-Za-z])|(?<=[a-z])[A-F](?![A-Za-z])")
#: corners of a robot that number its wheels: enc_FL, enc_RL, enc_RR, enc_FR
_CORNERS = ({"fl", "fr", "rl", "rr"}, {"lf", "rf", "lr", "rr"}, {"fl", "fr", "bl", "br"})
_CORNER = re.compile(r"(?<![A-Za-z])[A-Za-z]{2}(?![A-Za-z])|(?<=[a-z])[A-Z]{2}(?![A-Za-z])")
#: sides of a robot that number its wheels, three of them or more: enc_front, enc_left, enc_right
_SIDES = {"front", "rear", "back", "left", "right"}
_SIDE = re.compile(rf"(?<![A-Za-z])({'|'.join(sorted(_SIDES))})(?![A-Za-z])", re.IGNORECASE)
#: angular velocities and angles of one letter, as in flight mechanics, and what they are called in whole words
_ONE_LETTER = (("pqr", ("gyro_x", "gyro_y", "gyro_z")), ("rpy", ("roll", "pitch", "yaw")))

_EULER = {"phi": "roll", "theta": "pitch", "psi": "yaw"}


def numbered(name: str, names: Collection[str]) -> str:
    """Return a name with a number in place of a letter or a place, if the names have its neighbours and no number."""
    if any(mark.isdigit() for mark in name):
        return name
    name = _by_side(_by_corner(name, names), names)
    for found in _LETTER.finditer(name):
        first = "A" if found.group().isupper() else "a"
        series = [name[: found.start()] + chr(ord(first) + k) + name[found.end() :] for k in range(3)]
        if set(series) <= set(names):
            return f"{name[: found.start()]}{ord(found.group()) - ord(first) + 1}{name[found.end() :]}"
    return name


def _by_corner(name: str, names: Collection[str]) -> str:
    """Return a name with a number in place of a corner, in the order of the file, if the names have all corners."""
    for found in _CORNER.finditer(name):
        before, after = name[: found.start()], name[found.end() :]
        beside = [
            one[found.start() : len(one) - len(after)]
            for one in names
            if one.startswith(before) and one.endswith(after) and len(one) == len(name)
        ]
        corners = [one for one in beside if any(one.lower() in four for four in _CORNERS)]
        if {one.lower() for one in corners} in _CORNERS:
            return f"{before}{corners.index(found.group()) + 1}{after}" if found.group() in corners else name
    return name


def _by_side(name: str, names: Collection[str]) -> str:
    """Return a name with a number in place of a side, in the order of the file, if the names have three sides."""
    for found in _SIDE.finditer(name):
        before, after = name[: found.start()], name[found.end() :]
        beside = [
            one[len(before) : len(one) - len(after)]
            for one in names
            if one.startswith(before) and one.endswith(after)
        ]
        sides = [one for one in beside if one.lower() in _SIDES]
        if len({one.lower() for one in sides}) >= 3:
            return f"{before}{sides.index(found.group()) + 1}{after}"
    return name


def in_whole_words(names: Collection[str]) -> dict[str, str]:
    """Return, for angles and angular velocities of one letter, by name what they are called in whole words."""
    known = set(names)
    found: dict[str, str] = {}
    for letters, words in _ONE_LETTER:
        for name in names:
            for place in re.finditer(rf"(?<![A-Za-z]){letters[0]}(?![A-Za-z])", name):
                before, after = name[: place.start()], name[place.end() :]
                series = [f"{before}{letter}{after}" for letter in letters]
                if letters == "rpy" and f"{before}x{after}" in known:
                    continue  # beside x, y is the ball's place
                if set(series) <= known and not set(series) & set(found):
                    found |= {one: f"{before}{word}{after}" for one, word in zip(series, words, strict=True)}
    if any("gyro" in word for word in found.values()):
        # beside p, q and r, phi is the roll
        found |= {name: _EULER[name] for name in names if name in _EULER and set(_EULER) <= known}
    return found
