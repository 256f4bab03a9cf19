"""The page and the figure of each class of results, registered by the packages that make them.

These import the results, which therefore must not import them: a result asks here. The front page of the toolkit, which
may name every package, says what registers them; that is imported when the first page or figure is asked for.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from matplotlib.figure import Figure

T = TypeVar("T")

#: makes the page (`ballbot.report.blocks.Result`), or draws the figure in the reports' style, of a value of a class
PAGES: dict[type, Callable[[Any], Any]] = {}
FIGURES: dict[type, Callable[[Any], Figure]] = {}
#: imports what registers them
LOADERS: list[Callable[[], object]] = []


def registered(table: dict[type, Callable[[Any], T]], value: object) -> T:
    """Return what one of the tables above makes of a value."""
    for load in LOADERS:
        load()
    return table[type(value)](value)
