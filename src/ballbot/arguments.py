"""Several names or numbers in one text, as of an option."""

import math

from ballbot.errors import InputError


def names_listed(names: str) -> tuple[str, ...]:
    """Return names that stand with commas between."""
    return tuple(name.strip() for name in names.split(",") if name.strip())


def numbers_listed(text: str, option: str, *, count: int, wanted: str) -> tuple[float, ...]:
    """Return so many numbers that stand with commas between; InputError with what is wanted if they are not."""
    try:
        numbers = tuple(map(float, text.split(",")))
    except ValueError:
        numbers = ()
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        raise InputError(f"{option} is {text!r}; it must be {wanted}.")
    return numbers
