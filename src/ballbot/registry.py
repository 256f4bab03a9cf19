"""The page and the figure of each class of results, registered by the packages that make them.

These import the results, which therefore must not import them: a result asks here. The front page of the toolkit, which
may name every package, says what registers them; that is imported when the first page or figure is asked for.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure


#: makes the page (`ballbot.report.blocks.Result`), or draws the figure, of a value of a class
PAGES: dict[type, Callable[[Any], Any]] = {}
FIGURES: dict[type, Callable[[Any], Figure]] = {}
#: imports what registers them
LOADERS: list[Callable[[], object]] = []


def page(value: object) -> Any:
    """Return the page of a result."""
    _load()
    return PAGES[type(value)](value)


def figure(value: object) -> Figure:
    """Return the figure of a result, in the reports' style; it belongs to no window, and a notebook shows it."""
    _load()
    return FIGURES[type(value)](value)


def _load() -> None:
    for load in LOADERS:
        load()
