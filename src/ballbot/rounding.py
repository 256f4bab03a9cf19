"""Quantities as people read them: significant digits, a value no finer than its error, a name with its unit."""

import math
from collections.abc import Callable

#: in place of what is no number
DASH = "–"


def unit_heading(name: str, unit: str) -> str:
    """Return the heading of a quantity, such as `lean [deg]`: the one form of axes, columns and rows with a unit.

    A quantity without a unit ("" or "1") has its name alone.
    """
    return name if unit in ("", "1") else f"{name} [{unit}]"


def digits(value: float, count: int = 3, *, beside: float = 0.0) -> str:
    """Return a number with that many significant digits and no exponent; a dash if it is not finite.

    Parameters
    ----------
    value : float
    count : int
    beside : float
        A number that it is compared with: the value is rounded where that one has its last significant digit, if that
        is earlier. So nearly nothing beside 0.009 is 0, not 0.000000000054.
    """
    if not math.isfinite(value):
        return DASH
    if value == 0.0:
        return "0"
    leading = math.floor(math.log10(abs(value)))
    if beside:
        last = math.floor(math.log10(abs(beside))) - count + 1
        if abs(value) < 0.5 * 10.0**last:
            return "0"
        count = min(count, leading - last + 1) or 1
    places = max(0, count - 1 - leading)
    return f"{round(value, count - 1 - leading):.{places}f}"


def percent(share: float) -> str:
    """Return a share as a percentage: whole, or below one to its first digit, so that little is not none."""
    hundredths = 100.0 * share
    return f"{digits(hundredths, 1) if 0.0 < abs(hundredths) < 0.95 else f'{hundredths:.0f}'} %"


def value_and_error(value: float, error: float) -> tuple[str, str]:
    """Return a value and its error, both to the error's second digit; without an error three digits and a dash."""
    if not (math.isfinite(value) and math.isfinite(error) and error > 0.0):
        return digits(value), DASH
    last = 1 - math.floor(math.log10(error))
    places = max(0, last)
    # adding zero keeps a minus sign off what prints as nothing
    return f"{round(value, last) + 0.0:.{places}f}", f"{round(error, last):.{places}f}"


def plus_minus(value: float, error: float) -> str:
    """Return a value with its error as "0.133 ± 0.0085", or that one of them is not known."""
    if not math.isfinite(value):
        return "not identified"
    shown, of_error = value_and_error(value, error)
    return f"{shown} (no standard error)" if of_error == DASH else f"{shown} ± {of_error}"


def signed(text: str) -> str:
    """Return a number in words with its sign."""
    return f"+{text}" if text[:1].isdigit() else text


def interval(lower: float, upper: float, shown: Callable[[float], str] = digits) -> str:
    """Return an interval as "0.6 to 4.0"; "open" for a side without an end, a dash if it is not known."""
    if math.isnan(lower) or math.isnan(upper):
        return DASH
    return " to ".join("open" if math.isinf(end) else shown(end) for end in (lower, upper))
