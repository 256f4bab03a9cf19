"""Which column is what, by its name.

Names are compared in lower case without separators, so that `psi_1`, `Psi1` and `PSI[1]` are one. A triple is three
columns whose names differ in nothing but a number 1 to 3 (or 0 to 2).
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

TIMES = (
    "tnow",
    "t",
    "time",
    "timestamp",
    "ts",
    "tsec",
    "times",
    "seconds",
    "elapsed",
    "elapsedtime",
    "utime",
)
#: pairs or threes of names for roll, pitch and yaw
ATTITUDES = (
    ("roll", "pitch", "yaw"),
    ("thetax", "thetay", "thetaz"),
    ("thetaroll", "thetapitch", "thetayaw"),
    ("imuroll", "imupitch", "imuyaw"),
    ("imux", "imuy", "imuz"),
    ("leanx", "leany", "leanz"),
    ("rpy0", "rpy1", "rpy2"),
    ("rpy1", "rpy2", "rpy3"),
    ("theta1", "theta2", "theta3"),
    ("thetarollrad", "thetapitchrad", "thetayawrad"),
    ("rx", "ry", "rz"),
    ("anglex", "angley", "anglez"),
)
#: stems of wheel angles, of wheel speeds and of motor commands, the likeliest first
ANGLES = (
    "psi",
    "enc",
    "encpos",
    "encoder",
    "encticks",
    "ticks",
    "wheel",
    "wheelangle",
    "pos",
    "q",
    "m",
    "motor",
    "motorpos",
)
SPEEDS = (
    "dpsi",
    "psidot",
    "psid",
    "wheelspeed",
    "wheeldot",
    "dwheel",
    "encdot",
    "denc",
    "vel",
    "w",
    "omega",
    "speed",
    "dq",
)
COMMANDS = (
    "u",
    "motorduty",
    "duty",
    "pwm",
    "motorpwm",
    "motor",
    "t",
    "tau",
    "torque",
    "cmd",
    "motorcmd",
    "command",
    "m",
    "i",
    "current",
)
BODY_COMMANDS = ("tx", "ty", "tz")


@dataclass(frozen=True, kw_only=True)
class Roles:
    """The file's names of what the log is made of; empty or None where there is none."""

    time: str | None
    attitude: tuple[str, ...]  #: roll, pitch and, where there is one, yaw
    angles: tuple[str, ...]  #: a wheel each
    speeds: tuple[str, ...]
    commands: tuple[str, ...]
    body_commands: tuple[
        str, ...
    ]  #: Tx, Ty, Tz: commands about the body's axes, before they go to the wheels


def roles_by_name(names: Iterable[str], *, wheel_count: int) -> Roles:
    """Return what the names say; see the module's text."""
    plain = {_plain(name): name for name in reversed(list(names))}
    threes = _numbered(plain, wheel_count)
    angles = _first(threes, ANGLES)
    commands = _first({stem: found for stem, found in threes.items() if found != angles}, COMMANDS)
    return Roles(
        time=next((plain[name] for name in TIMES if name in plain), None),
        attitude=_attitude(plain),
        angles=angles,
        speeds=_first(threes, SPEEDS),
        commands=commands,
        body_commands=tuple(plain[name] for name in BODY_COMMANDS if name in plain),
    )


def _plain(name: str) -> str:
    """Return a name without separators, units in brackets, or case."""
    bare = re.sub(r"[\(\[](?!\d)[^\)\]]*[\)\]]", "", name.lower())
    return re.sub(r"[^a-z0-9]", "", bare)


def _numbered(plain: dict[str, str], count: int) -> dict[str, tuple[str, ...]]:
    """Return, by what is left without the number, the names numbered from 1 (or 0)."""
    found: dict[str, tuple[str, ...]] = {}
    for name in plain:
        for digit in re.finditer(r"[01]", name):
            before, after, start = name[: digit.start()], name[digit.end() :], int(digit.group())
            series = [f"{before}{start + k}{after}" for k in range(count)]
            if all(member in plain for member in series):
                found.setdefault(before + after, tuple(plain[member] for member in series))
    return found


def _first(threes: dict[str, tuple[str, ...]], stems: tuple[str, ...]) -> tuple[str, ...]:
    return next((threes[stem] for stem in stems if stem in threes), ())


def _attitude(plain: dict[str, str]) -> tuple[str, ...]:
    for roll, pitch, yaw in ATTITUDES:
        if roll in plain and pitch in plain:
            return tuple(plain[name] for name in (roll, pitch, yaw) if name in plain)
    return ()
