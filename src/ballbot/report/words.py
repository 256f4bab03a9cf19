"""Phrases that pages share: how much is logged, symbols of states and parameters, lengths in millimetres."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING

from ballbot.identification.quantities import FRICTION
from ballbot.rounding import digits

if TYPE_CHECKING:
    from ballbot.log import Log

_STATE_NAME = re.compile(r"\b(?P<residual>e_)?(?P<state>(?:theta|phi|psi|x|y)(?:_dot)?)\b")

#: for a robot without friction if compensation is requested
NO_FRICTION = (
    "The robot file has no friction, so there is none to compensate; `ballbot identify` finds it from logs."
)


def logs_words(logs: Mapping[str, Log]) -> str:
    """Return the length, number and names of logs: "54 s in 2 logs (square, hold)"."""
    seconds = sum(float(log.t[-1] - log.t[0]) for log in logs.values())
    names = ", ".join(name for name in logs if name)  # a single log in memory has no name
    count = "one log" if len(logs) == 1 else f"{len(logs)} logs"
    return f"{seconds:.0f} s in {count}{f' ({names})' if names else ''}"


def driveline_symbols(names: Collection[str] = FRICTION) -> str:
    """Return the meanings of a driveline's parameters, for the caption of a table of these quantities."""
    meanings = ["b: viscous friction."]
    meanings += ["c: Coulomb friction."] if "coulomb" in names else []
    if "stribeck" in names:
        fades = "which fades with speed at a rate set by v_s and delta (the Stribeck effect)"
        meanings.append(f"s: static friction above c, {fades}.")
    return f"{' '.join(meanings)} The number after a symbol is the wheel's."


def millimetres(metres: float) -> str:
    """Return a length in millimetres with three digits; a dash if it is not a number."""
    return digits(1e3 * metres)


RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def with_symbols(words: str) -> str:
    """Return a sentence with the names of states (theta_dot, e_x) replaced by the thesis's symbols."""

    def symbol(match: re.Match[str]) -> str:
        mark = state_mark(match["state"])
        return f"ε({mark})" if match["residual"] else mark

    return _STATE_NAME.sub(symbol, words)


def state_mark(name: str) -> str:
    """Return a state as the thesis prints it, in Unicode: a rate has a dot above."""
    base, dot = name.removesuffix("_dot"), "\u0307" if name.endswith("_dot") else ""
    return {"theta": "θ", "phi": "φ", "psi": "ψ"}.get(base, base) + dot


def capital(sentence: str) -> str:
    """Return a sentence whose first letter is a capital."""
    return f"{sentence[:1].upper()}{sentence[1:]}"
