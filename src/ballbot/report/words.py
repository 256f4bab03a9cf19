"""Numbers and names as people read them: digits, intervals, values with their errors, the symbols of states."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ballbot.fitting.intervals import Interval

_STATE_NAME = re.compile(r"\b(?P<residual>e_)?(?P<state>(?:theta|phi|psi|x|y)(?:_dot)?)\b")

STATE_MARKS = {
    "x": "x",
    "y": "y",
    "theta": "θ",
    "phi": "φ",
    "psi": "ψ",
}


def interval_text(interval: Interval | None) -> str:
    """Return an interval's ends; "open" for a side that the logs do not limit, empty without an interval."""
    if interval is None:
        return ""
    lower, upper = (digits(end) if math.isfinite(end) else "open" for end in (interval.lower, interval.upper))
    return f"{lower} .. {upper}"


def millimetres(metres: float) -> str:
    """Return a length in millimetres with three digits; a dash if it is not a number."""
    return digits(1e3 * metres)


def digits(value: float, count: int = 3) -> str:
    """Return a number with that many significant digits and no exponent; a dash where it is none."""
    if not np.isfinite(value):
        return "–"
    if value == 0.0:
        return "0"
    leading = int(np.floor(np.log10(abs(value))))
    places = max(0, count - 1 - leading)
    return f"{round(value, count - 1 - leading):.{places}f}"


def value_and_error(value: float, error: float) -> tuple[str, str]:
    """Return a value and its standard error, both to the error's second digit; a dash for what is no number."""
    if not (np.isfinite(value) and np.isfinite(error) and error > 0.0):
        return digits(value), "–"
    places = max(0, 1 - int(np.floor(np.log10(error))))
    return f"{value:.{places}f}", f"{error:.{places}f}"


def with_error(value: float, error: float) -> str:
    """Return a value and its standard error in words; see `value_and_error`."""
    if not np.isfinite(value):
        return "not identified by these logs"
    shown, of_error = value_and_error(value, error)
    return f"{shown} (no standard error)" if of_error == "–" else f"{shown} ± {of_error}"


def signed_with_error(value: float, error: float) -> str:
    """Return a value with its sign and its error, both to the second digit of the error."""
    text = with_error(value, error)
    return text if text.startswith("-") or not np.isfinite(value) else f"+{text}"


def with_symbols(words: str) -> str:
    """Return a sentence with the log's names of states (theta_dot, e_x) as the thesis's symbols."""
    return _STATE_NAME.sub(_symbol, words)


def _symbol(match: re.Match[str]) -> str:
    mark = state_mark(match["state"])
    return f"ε({mark})" if match["residual"] else mark


def state_mark(name: str) -> str:
    """Return a state as the thesis prints it, in Unicode: a rate has a dot above."""
    base = name.removesuffix("_dot")
    return STATE_MARKS[base] + ("\u0307" if name.endswith("_dot") else "")
