"""The columns of a log: their names, the unit of each, and the units of foreign logs that convert to them.

State  x = [x y theta phi psi, and their rates], SI and radians. A simulated run also carries the true values beside the
measured ones, in columns named `true_` and the state's name.
"""

import math
import re
from collections.abc import Iterable, Sequence
from itertools import count, takewhile

import numpy as np

from ballbot.arrays import Floats
from ballbot.errors import InputError, nearest
from ballbot.state import POSITION_NAMES as POSITION_NAMES
from ballbot.state import STATE_NAMES as STATE_NAMES
from ballbot.state import torque_names as torque_names

#: columns (N,) by name
Columns = dict[str, Floats]

TRUE_PREFIX = "true_"
#: the body's angles about the world's axes
ATTITUDE_NAMES = POSITION_NAMES[2:]
#: largest number of wheels whose columns have a name
MAX_WHEELS = 4

_NAMES = {
    "s": "t",
    "m": "x y ref_x ref_y axis_position",
    "rad": "theta phi psi ref_psi axis_angle",
    "m/s": "x_dot y_dot axis_position_dot",
    "rad/s": "theta_dot phi_dot psi_dot gyro_x gyro_y gyro_z ball_omega_x ball_omega_y ball_omega_z axis_angle_dot",
    "m/s^2": "acc_x acc_y acc_z",
    "N": "axis_force axis_force_added",
    "N m": "axis_torque axis_torque_added",
}
_UNITS = {name: unit for unit, names in _NAMES.items() for name in names.split()}
for _i in range(1, MAX_WHEELS + 1):
    _UNITS |= {f"u{_i}": "N m", f"wheel{_i}": "rad", f"wheel{_i}_dot": "rad/s"}
_UNITS |= {f"{TRUE_PREFIX}{name}": _UNITS[name] for name in STATE_NAMES}

#: largest value of a cell in any unit; a larger one, and an infinity, is a missing value
LARGEST_CELL = 1e30

#: every name that Ballbot gives a meaning
KNOWN_NAMES = tuple(_UNITS)


#: of motion capture beside t, x and y: its height [m] and a body's quaternion; no column of a robot's log
MOCAP_NAMES = ("z", "qw", "qx", "qy", "qz")
_UNITS |= {"z": "m"}


def unit_of(name: str) -> str | None:
    """Return the SI unit of a column by its name; None if it is not one of Ballbot's, or a quaternion's."""
    return _UNITS.get(name)


def mark_missing(values: Floats) -> Floats:
    """Return values with NaN in place of those that are infinite or beyond `LARGEST_CELL`."""
    missing = ~(np.abs(values) <= LARGEST_CELL)
    return np.where(missing, np.nan, values) if missing.any() else values


def check_column_names(names: Iterable[str], *, source: str) -> None:
    """Raise InputError if a name contains a control character or another one that cannot be printed."""
    for number, name in enumerate(names, start=1):
        if not name.isprintable():
            raise InputError(
                f"{source}: the name of column {number}, {name[:40]!r}, "
                "contains characters that cannot be printed."
            )


def given_names(columns: str | None) -> list[str] | None:
    """Return the names that --columns lists; those of columns without a name get a number, so that all differ."""
    if columns is None:
        return None
    names = list[str]()
    for number, word in enumerate(columns.split(","), start=1):
        name = word.strip() if any(map(str.isalnum, word)) else f"unused_{number}"
        if name in names:
            raise InputError(f"--columns has the name {name} twice.")
        names.append(name)
    return names


def wheel_angle_names(count: int) -> tuple[str, ...]:
    """Return wheel1 .. wheel`count`, the wheels' encoder angles [rad]."""
    return tuple(f"wheel{i}" for i in range(1, count + 1))


def wheel_speed_names(count: int) -> tuple[str, ...]:
    """Return wheel1_dot .. wheel`count`_dot, the wheels' encoder speeds [rad/s]."""
    return tuple(f"wheel{i}_dot" for i in range(1, count + 1))


def numbered_names(names: Iterable[str], *, prefix: str, suffix: str = "") -> tuple[str, ...]:
    """Return those of `names` that are prefix, number, suffix, from 1 on without a gap."""
    present = set(names)
    return tuple(takewhile(present.__contains__, (f"{prefix}{i}{suffix}" for i in count(1))))


def missing_words(missing: Sequence[str], present: Sequence[str]) -> str:
    """Return "columns theta, phi (it has thta)": those missing, and one present that is perhaps misspelt."""
    words = f"column{'s' * (len(missing) > 1)} {', '.join(missing)}"
    for name in missing:
        # a name that Ballbot knows is not a misspelling of another
        others = [other for other in present if unit_of(name) is None or unit_of(other) is None]
        if near := nearest(name, others):
            return f"{words} (it has {near[0]})"
    return words


#: by Ballbot's unit, the units of the same kind: the factor that turns each into it, and how names write it, in lower
#: case without separators
_KINDS: dict[str, dict[str, tuple[float, str]]] = {
    "s": {
        "s": (1.0, "s sec secs second seconds sek sekunden"),
        "ms": (1e-3, "ms msec millis milliseconds millisec"),
        "us": (1e-6, "us usec micros microseconds µs μs"),
        "ns": (1e-9, "ns nsec nanos nanoseconds nanosec"),
        "min": (60.0, ""),
    },
    "m": {
        "m": (1.0, "m meter meters metre metres"),
        "cm": (1e-2, "cm centimeters centimetres"),
        "mm": (1e-3, "mm"),
    },
    "m/s": {"m/s": (1.0, "m/s mps"), "cm/s": (1e-2, "cm/s"), "mm/s": (1e-3, "mm/s")},
    "m/s^2": {"m/s^2": (1.0, "m/s^2 m/s2 m/s²"), "g": (9.80665, "")},
    "rad": {
        "rad": (1.0, "rad rads radian radians"),
        "deg": (math.pi / 180.0, "deg degs degree degrees ° grad"),
        "turn": (2.0 * math.pi, "turn turns rev revs revolutions umdrehungen"),
        "mrad": (1e-3, "mrad mrads milliradians"),
        "cdeg": (math.pi / 18000.0, "cdeg cdegs centideg centidegrees"),  # as autopilots log angles
    },
    "rad/s": {
        "rad/s": (1.0, "rad/s radps radpers radpersec radpersecond"),
        "deg/s": (math.pi / 180.0, "deg/s dps degps degpers degpersec degreespersecond °/s"),
        "rpm": (2.0 * math.pi / 60.0, "rpm revpermin u/min"),
        "turn/s": (2.0 * math.pi, "turn/s turns/s rev/s revs/s revps revpersec revpers"),
        "mdeg/s": (math.pi / 180000.0, "mdeg/s mdps mdegps"),
        "mrad/s": (1e-3, "mrad/s mradps"),
    },
    "N": {
        "N": (1.0, "newton newtons"),
        "kN": (1e3, "kilonewton kilonewtons"),
        "mN": (1e-3, "millinewton millinewtons"),
    },
    "N m": {
        "N m": (1.0, "nm newtonmeter newtonmeters newtonmetre"),
        "mN m": (1e-3, "mnm"),
        "N cm": (1e-2, "ncm"),
    },
    "A": {"A": (1.0, "a amp amps ampere amperes"), "mA": (1e-3, "ma milliamp milliamps")},
    "V": {"V": (1.0, "v volt volts"), "mV": (1e-3, "mv millivolt millivolts")},
}
#: units that other numbers turn into Ballbot's: an encoder's counts, a motor's constants
_OTHERS = {
    "counts": "count counts cnt cnts tick ticks pulses inkremente",
    "counts/s": "counts/s countspersec countspers ticks/s tickspersec cps",
    "rps": "rps",  # revolutions or radians a second, as teams write it for either: a unit that the name leaves open
    "%": "% pct percent perc",
}
#: by Ballbot's unit, the factors that turn others of the same kind into it
FACTORS = {unit: {name: factor for name, (factor, _) in kind.items()} for unit, kind in _KINDS.items()}
#: by unit, how names write it
UNITS = {name: words for kind in _KINDS.values() for name, (_, words) in kind.items() if words} | _OTHERS
UNIT_OF = {spelling: unit for unit, spellings in UNITS.items() for spelling in spellings.split()}


def unit_spelled(text: str) -> str | None:
    """Return the unit, a key of `UNITS`, that a text spells; None if it spells none.

    >>> unit_spelled("N·m"), unit_spelled("Deg/s"), unit_spelled("furlong")
    ('N m', 'deg/s', None)
    """
    return UNIT_OF.get(re.sub(r"[\s_·*.]", "", text.lower()))


def unit_at_the_end(parts: list[str]) -> tuple[list[str], str | None]:
    """Return the parts of a name without the unit at their end, and the unit; its slash may be a part.

    >>> unit_at_the_end(["gyro", "x", "rad", "s"])
    (['gyro', 'x'], 'rad/s')
    """
    for length in (4, 3, 2, 1):
        first, *rest = [part.lower() for part in parts[-length:] if part.lower() != "per"] or [""]
        spelled = f"{first}/{''.join(rest)}".replace("sec", "s") if rest else first
        if first in ("n", "mn"):
            spelled = first + "".join(rest)
        if len(parts) > length and (not rest) == (length == 1) and spelled in UNIT_OF:
            return parts[:-length], UNIT_OF[spelled]
    return parts, None


#: a unit in brackets behind a name, as in theta [deg]
_BRACKETS = re.compile(r"(\w+)\s*[\[(]([^\])]+)[\])]")


def factor_to(unit: str | None, given: str | None, *, counts_per_turn: float | None = None) -> float:
    """Return the factor that turns a value in `given` into one in Ballbot's `unit`, a key of `FACTORS`; 1 without both.

    Angles and rates may be "counts" and "counts/s" of an encoder with so many `counts_per_turn` of the wheel, gear
    included. InputError if the unit is not one of that kind, or counts come without `counts_per_turn`.
    """
    if unit is None or given is None:
        return 1.0
    units = FACTORS[unit]
    if given in units:
        return units[given]
    counted = {"rad": "counts", "rad/s": "counts/s"}.get(unit)
    if given != counted:
        choices = [*units, *([counted] if counted else [])]
        raise InputError(
            f"the unit {given!r} cannot be converted to {unit}; the units that can are {', '.join(choices)}"
        )
    if not counts_per_turn:
        raise InputError(f"the unit {given!r} needs counts_per_turn, the encoder counts in one turn")
    return 2.0 * math.pi / counts_per_turn


def native_columns(names: Iterable[str]) -> dict[str, tuple[str, float, str]]:
    """Return the names that mean one of Ballbot's columns in another spelling: T, and theta [deg].

    Each maps to Ballbot's name, the factor to Ballbot's unit, and the file's unit.
    """
    names = list(names)
    native: dict[str, tuple[str, float, str]] = {}
    for name in names:
        bare, given = match.groups() if (match := _BRACKETS.fullmatch(name)) else (name, None)
        bare = "t" if bare == "T" else bare
        unit = unit_of(bare)
        if unit is None or bare in names or bare in (column for column, _, _ in native.values()):
            continue
        stated = unit if given is None else unit_spelled(given) or given
        if stated in FACTORS[unit]:
            native[name] = bare, FACTORS[unit][stated], stated
    return native


def has_native_names(names: Iterable[str]) -> bool:
    """Return whether these are Ballbot's names: a foreign log may have t and a few others by chance."""
    names = list(names)
    own = {name: bare for name, (bare, _, _) in native_columns(names).items()}
    others = {own.get(name, name) for name in names}
    known = len(others & set(KNOWN_NAMES)) - 1
    return "t" in others and known > len(others) - 1 - known
