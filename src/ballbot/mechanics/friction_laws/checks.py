"""Refusing values that are no friction's, each in one sentence."""

import math
from collections.abc import Sequence

from ballbot.errors import InputError


def check_values(law: object, *, positive: Sequence[str], not_negative: Sequence[str]) -> None:
    """Raise InputError unless these attributes of a law are finite and above zero, or at least zero."""
    for name in (*positive, *not_negative):
        value = getattr(law, name)
        if not math.isfinite(value) or value < 0.0 or (value == 0.0 and name in positive):
            wanted = "above zero" if name in positive else "zero or more"
            raise InputError(
                f"{type(law).__name__}'s {name} is {value:g}; it must be a finite number, {wanted}."
            )
