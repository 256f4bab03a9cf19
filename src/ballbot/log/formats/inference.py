"""Layouts of tables of text that are not Ballbot's own: separator, decimal sign, header, units, damaged rows.

`infer_text_table` reads any table that has rows of numbers, and notes what it skipped; a mapping file then states the
layout. `read_text_variables` finds separator, decimal sign and header in the same way, but every row must be whole.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import check_table
from ballbot.errors import InputError
from ballbot.files import decode_text, read_bytes
from ballbot.log.columns import has_native_names
from ballbot.log.formats.serial import plain
from ballbot.log.formats.text import (
    TextLayout,
    check_names,
    is_number,
    read_text_table,
    seconds_of,
    split_cells,
    text_start,
)
from ballbot.summary import counted

_SEPARATORS: dict[str, str | None] = {"comma": ",", "semicolon": ";", "tab": "\t", "blanks": None}
#: lines examined to find the separator and the header
_EXAMINED = 200
#: largest file of unknown layout [bytes], because every cell is examined
_LARGEST = 100_000_000
_NOT_A_NUMBER = frozenset({"", "na", "n/a", "none", "null", "-", "--"})
_MARKS_OF_MISSING = tuple(
    sorted({mark for one in _NOT_A_NUMBER if one for mark in (one, one.upper(), one.title())})
)
#: units, of which a row below the header consists: alone, in products, quotients and powers, or in brackets
_UNIT_WORDS = (
    "s ms us µs μs ns min h m cm mm um µm μm km rad mrad deg ° turn turns rev rpm U count counts cnt inc "
    "g kg N mN kN Nm mNm Ncm kNm A mA V mV W kW Hz kHz K C °C Pa bar %"
)
_UNITS = frozenset(_UNIT_WORDS.split())


@dataclass(frozen=True, kw_only=True, eq=False)
class ForeignTable:
    """The columns of a foreign file, and the layout that was inferred."""

    layout: TextLayout
    separator: str  #: its name in a mapping file
    columns: dict[str, NDArray[np.float64]]
    named: bool  #: whether the file has a header
    notes: tuple[str, ...]  #: sentences on anomalies of the file
    units: Mapping[str, str] = field(default_factory=dict)  #: by column, as a row below the header has them


def infer_text_table(path: str | Path, *, given_names: Sequence[str] | None = None) -> ForeignTable:
    """Read a table of text, whatever its layout.

    Raises
    ------
    InputError
        If the file cannot be read or has no table of numbers.
    """
    text = plain(_foreign_lines(path))
    lines = text.lines
    separator, decimal_comma = _likely_separator(lines)
    mark = _SEPARATORS[separator]
    cells, numeric, words = _rows_of_numbers(lines, mark, decimal_comma)
    if not any(numeric):
        raise InputError(f"{path} contains no table: none of its lines consists only of numbers.")
    if sum(numeric) == 1:
        only = numeric.index(True) + 1
        raise InputError(f"{path} has one row of numbers (line {only}); a log needs at least two.")
    first = _first_row(cells, numeric)
    widths = Counter(len(row) for row, good in zip(cells, numeric, strict=True) if good)
    width = max(widths, key=lambda count: widths[count])
    check_table(len(lines), width, source=str(path))
    quoted = lines[first].lstrip().startswith('"')
    head = [list(text.labels)] if len(text.labels) == width else cells[:first]
    guessed = _guessed_names(head, width, quoted=quoted) if given_names is None else None
    names, notes = guessed or (list(given_names or ()), [])
    if len(names) != width:
        raise InputError(
            f"{path} has {width} columns, but {len(names)} names were given: {', '.join(names)}."
        )
    marks = sorted(
        {c for row in cells for i, c in enumerate(row) if c.lower() in _NOT_A_NUMBER and c and i not in words}
    )
    damaged = sum(
        1
        for row, good in zip(cells[first:], numeric[first:], strict=True)
        if row and not (good and len(row) == width)
    )
    if damaged:
        notes.append(
            f"Skipped: {counted(damaged, 'row')} without {width} cells, or with words among the numbers."
        )
    named = _line_of_names(cells[:first], width, quoted=quoted)
    below = cells[named + 1] if named is not None and named + 1 < first else []
    units = dict(zip(names, below, strict=False)) if _are_units(below) and len(below) == width else {}
    layout = TextLayout(
        separator=mark,
        decimal_comma=decimal_comma,
        missing=tuple(marks),
        header_lines=first,
        names=tuple(names),
        drop_damaged=damaged > 0,
    )
    return ForeignTable(
        layout=layout,
        separator=separator,
        columns=read_text_table(path, layout, notes=notes),
        named=given_names is not None or any(head),
        notes=tuple(notes),
        units=units,
    )


def read_text_variables(path: str | Path) -> dict[str, NDArray[np.float64]]:
    """Read a table of numbers whose separator, decimal sign and header are inferred; InputError as `read_text_table`.

    Unlike those of `infer_text_table`, every row below the header must be whole.
    """
    return read_text_table(path, _head_of(path).layout, mapped=False)


def own_layout_below(path: str | Path) -> TextLayout | None:
    """Return the layout of a table with Ballbot's names whose header is below other lines, or has units; else None."""
    layout = _head_of(path).layout
    return layout if has_native_names(layout.names or ()) else None


def read_text_units(path: str | Path) -> dict[str, str]:
    """Return the units in a row below the header of a table of text, by column; nothing if it has no such row."""
    return dict(_head_of(path).units)


@dataclass(frozen=True, kw_only=True)
class _Head:
    """What the first lines of a table show."""

    layout: TextLayout
    units: Mapping[str, str]  #: by column, as a row below the names gives them


def _head_of(path: str | Path) -> _Head:
    lines = plain(text_start(path).split("\n")).lines
    separator, decimal_comma = _likely_separator(lines)
    layout = TextLayout(
        separator=_SEPARATORS[separator], decimal_comma=decimal_comma, missing=_MARKS_OF_MISSING
    )
    cells, numeric, _ = _rows_of_numbers(lines, layout.separator, decimal_comma)
    first = _first_row(cells, numeric) if any(numeric) else 0
    width, quoted = len(cells[first]), lines[first].lstrip().startswith('"')
    named = _line_of_names(cells[:first], width, quoted=quoted)
    if named is None:
        return _Head(layout=layout, units={})
    check_names(path, named + 1, _plain(cells[named]))
    names, _ = _guessed_names(cells[: named + 1], width, quoted=quoted)
    below = cells[named + 1]
    units = dict(zip(names, below, strict=False)) if named + 1 < first and _are_units(below) else {}
    return _Head(
        layout=replace(layout, names=tuple(names), header_lines=named + (2 if units else 1)), units=units
    )


def _foreign_lines(path: str | Path) -> list[str]:
    text = decode_text(read_bytes(path, largest=_LARGEST), source=str(path), errors="replace")
    if not text.strip():
        raise InputError(f"{path} is empty; a log needs rows of numbers.")
    return text.split("\n")


def _likely_separator(lines: list[str]) -> tuple[str, bool]:
    """Return the separator under which most lines are rows of two or more numbers, and whether decimals have commas."""
    looked_at = [line for line in lines if line.strip()][: 2 * _EXAMINED][-_EXAMINED:]

    def rows(mark: str | None, decimal_comma: bool) -> tuple[int, int]:
        cells, _, _ = _rows_of_numbers(looked_at, mark, decimal_comma)
        numbers = [[_number_like(cell) for cell in row] for row in cells]
        # the cells decide where a column of words spoils every row
        return sum(len(row) > 1 and all(row) for row in numbers), sum(map(sum, numbers))

    choices = [(word, decimal_comma) for decimal_comma in (False, True) for word in _SEPARATORS]
    return max(choices, key=lambda choice: rows(_SEPARATORS[choice[0]], choice[1]))


#: a column is one of words if fewer of its cells are numbers
_NUMBERS = 0.5


def _rows_of_numbers(
    lines: Sequence[str], mark: str | None, decimal_comma: bool
) -> tuple[list[list[str]], list[bool], set[int]]:
    """Return the cells of lines, which lines are rows of numbers, and the columns of words that such rows may have."""
    cells = [split_cells(line, mark) if line.strip() else [] for line in lines]
    if decimal_comma:
        cells = [[_pointed(cell) for cell in row] for row in cells]
    numbers = [[_number_like(cell) for cell in row] for row in cells]
    numeric = [bool(row) and all(row) for row in numbers]
    words: set[int] = set()
    if mark is not None and sum(numeric) < _NUMBERS * sum(map(bool, cells)):
        widths = Counter(len(row) for row in numbers if sum(row) > 1)
        width = max(widths, key=lambda count: widths[count], default=0)
        wide = [row for row in numbers if len(row) == width and sum(row) > 1]
        words = {i for i in range(width) if sum(row[i] for row in wide) < _NUMBERS * len(wide)}
        numeric = [
            good
            or (len(row) == width and sum(row) > 1 and all(n for i, n in enumerate(row) if i not in words))
            for row, good in zip(numbers, numeric, strict=True)
        ]
    widest = max((len(row) for row, good in zip(cells, numeric, strict=True) if good), default=0)
    rows = [row for row, good in zip(cells, numeric, strict=True) if good and len(row) == widest]
    if mark is not None and widest > 1 and all(row[-1] == "" for row in rows):
        # a separator at the end of lines
        cells = [row[:-1] if len(row) == widest and row[-1] == "" else row for row in cells]
    return cells, numeric, words


def _pointed(cell: str) -> str:
    """Return a cell with a decimal point, if it is a number with a decimal comma."""
    pointed = cell.replace(",", ".")
    return pointed if _number_like(pointed) else cell


def _number_like(cell: str) -> bool:
    if cell.lower() in _NOT_A_NUMBER:
        return True
    return is_number(cell) or seconds_of(cell) is not None


def _first_row(cells: list[list[str]], numeric: list[bool]) -> int:
    """Return the line of the first row: the first of two rows of numbers that are equally wide."""
    for k in range(len(cells) - 1):
        if numeric[k] and numeric[k + 1] and len(cells[k]) == len(cells[k + 1]):
            return k
    return numeric.index(True)


def _guessed_names(head: list[list[str]], width: int, *, quoted: bool = False) -> tuple[list[str], list[str]]:
    """Return a name for each column, and notes, from the lines before the first row.

    Parameters
    ----------
    head : list of list of str
        Cells of these lines.
    width : int
        Cells of most rows.
    quoted : bool
        Whether the first row begins with a quoted cell: R writes the rows' names so, and no name for their column.
    """
    named = [row for row in head if row and not all(_number_like(cell) for cell in row)]
    notes: list[str] = []
    if not named:
        notes.append(f"The file has no header; its columns are called column_1 to column_{width}.")
        return [f"column_{place}" for place in range(1, width + 1)], notes
    line = _line_of_names(head, width, quoted=quoted)
    words = named[-1] if line is None else head[line]
    given = [cell.lstrip("#%").strip() for cell in words]
    filled = [cell for cell in given if cell]
    if len(given) != width and (len(filled) == width or (words[0] and not given[0])):
        # blanks or tabs that align the names, or a mark of a comment before them
        given = filled if len(filled) == width else given[1:]
    elif len(given) == width - 1 and quoted:
        given = ["", *given]
    unnamed = [str(place) for place, name in enumerate(given[:width], start=1) if not name]
    if unnamed:
        plural = "columns" if len(unnamed) > 1 else "column"
        notes.append(f"The header has no name for {plural} {', '.join(unnamed)}.")
    if len(given) != width:
        notes.append(
            f"The header names {len(given)} columns and the rows have {width}: "
            + ("the last columns have no name." if len(given) < width else "the last names are unused.")
        )
    names: list[str] = []
    for place in range(width):
        name = given[place] if place < len(given) else ""
        name = name if name and name.isprintable() else f"column_{place + 1}"
        names.append(f"{name}_{place + 1}" if name in names else name)
    return names, notes


def _line_of_names(head: list[list[str]], width: int, *, quoted: bool) -> int | None:
    """Return which line before the first row has the columns' names: the last one of words that are not units."""
    wide = (width, width - 1) if quoted else (width,)
    words = [
        k
        for k, row in enumerate(head)
        if any(row)
        and (len(row) in wide or len(_plain(row)) == width)
        and not any(is_number(cell.replace(",", ".")) for cell in row)
    ]
    named = [k for k in words if not _are_units(head[k])]
    return (named or words or [None])[-1]


def _plain(row: list[str]) -> list[str]:
    """Return the names in a row, without the mark of a comment before them."""
    return [name for name in (cell.lstrip("#%").strip() for cell in row) if name]


def _are_units(row: list[str]) -> bool:
    """Return whether the cells of a row are units, with marks of none among them."""
    units = [cell for cell in row if cell not in ("", "-", "1")]
    return bool(units) and all(_is_unit(cell) for cell in units)


def _is_unit(cell: str) -> bool:
    inner = re.fullmatch(r"\[(.*)\]|\((.*)\)|<(.*)>", cell)
    if inner:
        return True
    parts = [part for part in re.split(r"[\s·*/^²³⁻¹0-9-]+", cell) if part]
    return bool(parts) and all(part in _UNITS for part in parts)
