"""Within which values each friction parameter is sought; a user may set them, in Python or in a TOML file.

    viscous = [0.0, 0.1]             # b [N m s/rad], every wheel's
    coulomb = [0.0, 0.5]             # c [N m]
    stribeck = [0.0, 0.5]            # s [N m]
    stribeck_speed = [0.1, 3.0]      # v_s [rad/s]
    stribeck_exponent = [0.3, 10.0]  # delta
    rolling = [0.0, 0.05]            # C_rr

Keys left out keep these defaults, which are wide for a robot of 5 to 50 kg with motors of some N m. Equal bounds
hold a parameter at that value. A v_s far below the speeds of the log with a large s is friction that hardly ever
acts, and traps a search: hence the bound at 0.1 rad/s.
"""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass, fields
from difflib import get_close_matches
from pathlib import Path

from ballbot.errors import InputError

Interval = tuple[float, float]

#: sought on a logarithmic scale, so that their lower bound must be above zero
LOGARITHMIC = ("stribeck_speed", "stribeck_exponent")


@dataclass(frozen=True, kw_only=True)
class Bounds:
    """The least and the greatest value of each parameter; the names are those of `ballbot.robot.Friction`.

    Raises
    ------
    InputError
        Where a pair is not two finite numbers in rising order, or reaches below what is physical.
    """

    viscous: Interval = (0.0, 0.1)  #: b [N m s/rad], every wheel's
    coulomb: Interval = (0.0, 0.5)  #: c [N m], every wheel's
    stribeck: Interval = (0.0, 0.5)  #: s [N m], every wheel's
    stribeck_speed: Interval = (0.1, 3.0)  #: v_s [rad/s]
    stribeck_exponent: Interval = (0.3, 10.0)  #: delta [-]
    rolling: Interval = (0.0, 0.05)  #: C_rr [-]

    def __post_init__(self) -> None:
        for field in fields(self):
            lower, upper = self.interval(field.name)
            if not (math.isfinite(lower) and math.isfinite(upper) and lower <= upper):
                raise InputError(
                    f"The bounds of {field.name} are [{lower}, {upper}]; write the lower one first."
                )
            if lower < 0.0 or (lower == 0.0 and field.name in LOGARITHMIC):
                least = "above zero" if field.name in LOGARITHMIC else "zero or above"
                raise InputError(f"The lower bound of {field.name} is {lower:g}; it must be {least}.")

    def interval(self, name: str) -> Interval:
        """Return the bounds of the parameter of that name."""
        return getattr(self, name)


def read_bounds(path: str | Path) -> Bounds:
    """Read bounds from a TOML file; the module's text shows one.

    Raises
    ------
    InputError
        Where the file cannot be read, is no TOML, or has a key or a value that makes no bounds.
    """
    try:
        entries = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}.") from None
    except UnicodeDecodeError:
        raise InputError(f"{path} is not a text file in UTF-8.") from None
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path} is not valid TOML: {error}.") from None
    names = [field.name for field in fields(Bounds)]
    unknown = [key for key in entries if key not in names]
    if unknown:
        near = get_close_matches(unknown[0], names, n=1)
        hint = f"did you mean {near[0]!r}?" if near else f"the keys are {', '.join(names)}."
        raise InputError(f"{path}: {unknown[0]!r} is not a friction parameter; {hint}")
    try:
        return Bounds(**{key: _interval(key, value) for key, value in entries.items()})
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _interval(key: str, value: object) -> Interval:
    match value:
        case [int() | float() as lower, int() | float() as upper]:
            return float(lower), float(upper)
    raise InputError(f"{key} is {value!r}; write two numbers, as in {key} = [0.1, 0.5].")
