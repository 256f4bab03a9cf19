"""Units that a file gives for the quantities of an axis, in a row of units, in brackets, or at the end of a name."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping

from ballbot.log.columns import FACTORS

#: by the unit of positions, what each quantity may be in, with the factor to its unit
_FORCES = {"N": 1.0, "kN": 1e3, "mN": 1e-3}
_TORQUES = {**FACTORS["N m"], "kN m": 1e3}
QUANTITIES = {
    "time": {"m": FACTORS["s"], "rad": FACTORS["s"]},
    "position": {"m": FACTORS["m"], "rad": FACTORS["rad"]},
    "velocity": {"m": FACTORS["m/s"], "rad": FACTORS["rad/s"]},
    "force": {"m": _FORCES, "rad": _TORQUES},
}
#: other spellings of units
_SPELLINGS = {
    "Nm": "N m",
    "mNm": "mN m",
    "Ncm": "N cm",
    "kNm": "kN m",
    "µs": "us",
    "μs": "us",
    "°": "deg",
    "rev": "turn",
}


def unit_of(name: str, units: Mapping[str, str]) -> str:
    """Return the unit of a variable as `FACTORS` spells it; empty if the file does not give it."""
    text = units.get(name, "")
    bracketed = re.search(r"[\[(<]([^\])>]*)[\])>]$", text or name)
    unit = (bracketed.group(1) if bracketed else text).strip().replace("·", " ").replace("*", " ")
    return _SPELLINGS.get(unit, unit)


def unit_at_end(name: str, known: Collection[str]) -> str:
    """Return the unit among those known that a name ends in, such as "deg" of "position_deg"; empty if in none.

    Single letters are no units: "position_m" may be that of the motor.
    """
    parts = name.split("_")
    ends = ("/".join(parts[-2:]), parts[-1]) if len(parts) > 2 else tuple(parts[1:])
    spelled = {one.replace(" ", "").lower(): one for one in known} | {
        spelling.lower(): unit for spelling, unit in _SPELLINGS.items() if unit in known
    }
    return next((spelled[one.lower()] for one in ends if len(one) > 1 and one.lower() in spelled), "")
