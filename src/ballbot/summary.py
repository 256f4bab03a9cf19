"""A result on one screen: its title, rows of names and values, and sentences, as text and as HTML for notebooks.

A result is `Summarized`: its method `summary` returns a `Summary`, from which come its `repr` and what a
notebook shows of it. A result that is `Plotted` has the figure that is registered for its class (`ballbot.registry`),
and of one that is `Reported` the summary is that of its page, too.

Names in a summary may be others', as of robots, files and columns: nothing in them is obeyed, by a terminal or a page.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from html import escape
from itertools import zip_longest
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.printable import printable_line
from ballbot.progress import as_clock
from ballbot.registry import FIGURES, PAGES, registered
from ballbot.results import to_results

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: one screen, in characters
WIDTH, HEIGHT = 80, 24
#: longest name that the values of other rows are set apart by
_LONGEST_NAME = 22


@dataclass(frozen=True, kw_only=True, repr=False)
class Summary:
    """What a result says first.

    `str` is all of it, `repr` what fits on a screen of 80 x 24 characters.
    """

    title: str
    #: name and value, or name and the cells of a table's row, which stand below those of the rows before
    rows: tuple[tuple[str, str | tuple[str, ...]], ...] = ()
    sentences: tuple[str, ...] = ()  #: findings and verdicts

    def __str__(self) -> str:
        """Return all of it as lines of at most 80 characters."""
        return "\n".join(self._lines())

    def __repr__(self) -> str:
        """Return the lines that fit on a screen, and how many do not."""
        lines = self._lines()
        if len(lines) > HEIGHT:
            more = len(lines) - HEIGHT + 1
            lines = [*lines[: HEIGHT - 1], f"... {more} more lines: print(_.summary())"]
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        """Return all of it as HTML: the rows as a table, the sentences as a list."""
        columns = max((len(value) for _, value in self.rows if isinstance(value, tuple)), default=1)
        rows = "".join(
            f'<tr><th style="text-align:left">{_escaped(name)}</th>{_html_cells(value, columns)}</tr>'
            for name, value in self.rows
        )
        sentences = "".join(f"<li>{_escaped(one)}</li>" for one in self.sentences)
        return f"<b>{_escaped(self.title)}</b><table>{rows}</table><ul>{sentences}</ul>"

    def _lines(self) -> list[str]:
        lines = _wrapped(self.title, "")
        names = [len(printable_line(name)) for name, _ in self.rows]
        column = 4 + min(max(names, default=0), _LONGEST_NAME)
        table = zip_longest(*(value for _, value in self.rows if isinstance(value, tuple)), fillvalue="")
        widths = [max(map(len, cells)) for cells in table]
        for name, value in self.rows:
            shown = f"  {printable_line(name)}"
            if len(shown) > column - 2:
                lines += _wrapped(name, "  ", indent=2)
                shown = ""
            lines += _wrapped(_in_columns(value, widths), f"{shown:<{column}}", indent=column)
        for one in self.sentences:
            lines += _wrapped(one, "- ", indent=2)
        return lines


def _escaped(text: str) -> str:
    return escape(printable_line(text))


def _html_cells(value: str | tuple[str, ...], columns: int) -> str:
    if isinstance(value, str):
        return f'<td colspan="{columns}" style="text-align:left">{_escaped(value)}</td>'
    return "".join(f"<td>{_escaped(cell)}</td>" for cell in value)


def _in_columns(value: str | tuple[str, ...], widths: Sequence[int]) -> str:
    """Return a value as text; cells are set to the right of columns of these widths."""
    if isinstance(value, str):
        return value
    return "  ".join(f"{one:>{width}}" for one, width in zip(value, widths, strict=False))


def _wrapped(text: str, begin: str, *, indent: int = 0) -> list[str]:
    """Return a text as lines of at most `WIDTH` characters, the first after `begin`."""
    return textwrap.wrap(
        printable_line(text),
        WIDTH,
        initial_indent=begin,
        subsequent_indent=" " * indent,
        break_on_hyphens=False,
        drop_whitespace=True,
    ) or [begin.rstrip()]


class Summarized:
    """Base of results: their `repr`, what a notebook shows of them, and what results.json holds, by their fields."""

    def summary(self) -> Summary:
        """Return the result on one screen."""
        raise NotImplementedError

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        return to_results(self)  # pyright: ignore[reportArgumentType] (a dataclass)

    def __repr__(self) -> str:
        return repr(self.summary())

    def _repr_html_(self) -> str:
        return self.summary()._repr_html_()


class Plotted(Summarized):
    """Base of results with a figure, which a notebook shows below the summary."""

    def plot(self) -> Figure:
        """Return the figure that shows the result best; a notebook shows it.

        Returns
        -------
        matplotlib.figure.Figure
            `savefig` writes it.

        Raises
        ------
        InputError
            If there is nothing to draw.
        """
        return registered(FIGURES, self)

    def _repr_html_(self) -> str:
        svg = ""
        with suppress(InputError):  # a log that has nothing to draw
            svg = self.plot()._repr_svg_()  # pyright: ignore[reportAttributeAccessIssue]
        return super()._repr_html_() + svg[svg.find("<svg") :]


class Reported(Plotted):
    """Base of results whose page has their summary, their figure and what results.json holds of them."""

    def summary(self) -> Summary:
        """Return the verdict on one screen."""
        return registered(PAGES, self).summary()

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        return to_results(registered(PAGES, self).to_dict())


def listed(values: Sequence[float] | NDArray[np.float64], unit: str = "", *, digits: int = 3) -> str:
    """Return numbers with that many significant digits, and their unit: 0.014, 0.016, 0.013 N m."""
    numbers = ", ".join(f"{value + 0.0:.{digits}g}" for value in np.atleast_1d(values).tolist())
    return f"{numbers} {unit}".rstrip()


def counted(number: int, what: str) -> str:
    """Return a number of things: 1 log, 2 logs."""
    return f"{number} {what}{'' if number == 1 else 's'}"


def duration_words(seconds: float) -> str:
    """Return a duration, in hours and minutes too if it is long: 12.5 s, 5025 s (1:23:45)."""
    return f"{seconds:.4g} s" if seconds < 1000.0 else f"{seconds:.0f} s ({as_clock(seconds)})"


def range_words(values: NDArray[np.float64], unit: str = "") -> str:
    """Return the least and the greatest finite value: -0.1 to 0.5 m; "no value" without one."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return "no value"
    return f"{finite.min():.3g} to {finite.max():.3g} {unit}".rstrip()


def pole_words(poles: NDArray[np.complex128]) -> str:
    """Return poles with three digits, equal and conjugate ones once: -0.7, -1.2 +- 0.5j."""
    shown = dict.fromkeys(
        f"{pole.real + 0.0:.3g}" + (f" +- {abs(pole.imag):.3g}j" if abs(pole.imag) > 1e-9 * abs(pole) else "")
        for pole in poles
    )
    return ", ".join(shown)
