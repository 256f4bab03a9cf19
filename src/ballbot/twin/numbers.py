"""Numbers as MJCF documents write them."""

from __future__ import annotations

from collections.abc import Iterable


def text(values: float | Iterable[float]) -> str:
    """Return numbers so that reading them gives the same bits."""
    if isinstance(values, float | int):
        return repr(float(values))
    return " ".join(repr(float(value)) for value in values)
