"""Tables of numbers as text: CSV, and the separated files that other people's robots write.

pandas reads the rows that have the table's width; cells that it takes for words are then dates with times, missing
values, numbers with a blank behind, or words. `inference` finds the layout of a file that no mapping describes.
"""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from pydantic import NonNegativeInt, PositiveInt

from ballbot.arrays import check_table
from ballbot.errors import InputError
from ballbot.files import LARGEST_TABLE, read_text, write_text
from ballbot.log.columns import Columns, Floats, mark_missing
from ballbot.summary import counted

if TYPE_CHECKING:
    from pandas import DataFrame

#: by its name, what separates the cells of a line; None is any run of blanks
SEPARATORS: dict[str, str | None] = {"comma": ",", "semicolon": ";", "tab": "\t", "blanks": None}


@dataclass(frozen=True, kw_only=True)
class TextLayout:
    """How a text file lays out its table: [file] of a mapping. The defaults are the CSV that Ballbot writes."""

    separator: Literal["comma", "semicolon", "tab", "blanks"] = "comma"
    decimal: Literal["point", "comma"] = "point"  #: beside commas, numbers with a decimal comma are in quotes
    missing: tuple[str, ...] = ()  #: marks of a missing value, beside `MISSING` and "nan"
    header_lines: NonNegativeInt = 1  #: lines before the first row, the last of them with the columns' names
    names: tuple[str, ...] | None = None  #: the columns' names if the header has none or wrong ones
    damaged_rows: Literal["refuse", "drop"] = "refuse"  #: those of another width or with words
    #: those whose time decreases; `ballbot.log.row_order`
    unordered_rows: Literal["refuse", "drop"] = "refuse"
    #: first and last row to use, damaged ones not counted
    rows: tuple[PositiveInt, PositiveInt] | None = None


#: cells without a value, in small letters
MISSING = frozenset({"", "na", "n/a", "none", "null", "-", "--"})
_TOO_LONG = f"a cell has more than {csv.field_size_limit()} characters."
OWN_LAYOUT = TextLayout()
#: the beginning of a number that is no number
_BEGUN = re.compile(r"[+-]?(\d+\.?\d*)?([eE][+-]?)?", re.ASCII)


def read_text_table(
    path: str | Path,
    layout: TextLayout = OWN_LAYOUT,
    *,
    used: Collection[str] | None = None,
    notes: list[str] | None = None,
) -> Columns:
    """Read a table of numbers: the columns (N,) by name, in the file's order; cells without a value are NaN.

    `used` are the columns that must consist of numbers; others that do not are omitted. Without `used`, columns are
    omitted in which most cells are words. `notes` gets a sentence for each omission. InputError, with the line, if the
    file is not such a table.
    """
    notes = [] if notes is None else notes
    text = read_text(path, largest=LARGEST_TABLE)
    if not text.strip():
        raise InputError(f"{path} is empty; a log needs a line of column names and rows of numbers.")
    lines = text.split("\n")
    names = list(layout.names) if layout.names is not None else _header_names(path, lines, layout)
    check_table(len(lines), len(names), source=str(path))
    rows, cut, damaged = _whole_rows(path, lines, layout, len(names))
    frame = _frame(path, list(rows.values()), layout, len(names))
    table, words = np.empty(frame.shape), np.zeros(frame.shape, dtype=np.bool_)
    for i in range(len(names)):
        column = frame[i]
        if column.dtype.kind in "iuf":
            table[:, i] = column
        else:
            values = [_value(str(cell), layout) for cell in column]
            table[:, i] = [math.nan if value is None else value for value in values]
            words[:, i] = [value is None for value in values]
    # of words, by what the table is used for, or by most cells with something in them
    most = 2 * words.sum(axis=0) > (words | ~np.isnan(table)).sum(axis=0)
    unused = most if used is None else np.array([name not in used for name in names], dtype=np.bool_)
    omitted = words.any(axis=0) & unused
    for i in np.flatnonzero(omitted):
        example = str(frame.iloc[int(np.argmax(words[:, i])), i])
        notes.append(f"The column {names[i]} is left out: it has words, such as {example[:40]!r}.")
    places = np.argwhere(words & ~omitted)
    spoilt = np.isin(np.arange(len(rows)), places[:, 0])
    if len(places):
        numbers, (row, column) = list(rows), places[0]
        cell = str(frame.iloc[row, column])
        if len(places) == 1 and (row, column) == (len(rows) - 1, len(names) - 1) and _BEGUN.fullmatch(cell):
            cut = numbers[-1]
        elif layout.damaged_rows == "refuse":
            raise InputError(
                f"{path}, line {numbers[row]}: {cell[:40]!r} in column {names[column]} is not a number; correct it, or "
                "leave the cell empty if the value is missing."
            )
        else:
            damaged += int(spoilt.sum())
    if cut:
        notes.append(f"The last row, line {cut}, is cut short and left out.")
    if damaged:
        notes.append(
            f"Skipped: {counted(damaged, 'row')} without {len(names)} cells, or with words among the numbers."
        )
    table = mark_missing(
        table[~spoilt][slice(None) if layout.rows is None else slice(layout.rows[0] - 1, layout.rows[1])]
    )
    if not len(table):
        raise InputError(f"{path} has a header and no rows{' of those to take' if layout.rows else ''}.")
    return {
        name: np.ascontiguousarray(table[:, i])
        for i, (name, out) in enumerate(zip(names, omitted, strict=True))
        if not out
    }


def write_text_table(path: str | Path, columns: Mapping[str, Floats]) -> None:
    """Write columns (N,) as CSV, in the fewest digits that read back to the same bits; NaN becomes `nan`."""
    for name in columns:
        if not name or name != name.strip() or any(mark in name for mark in ',"\n\r'):
            raise InputError(
                f"The column name {name!r} cannot be written to CSV; use letters, digits and underscores."
            )
    rows = np.column_stack(list(columns.values())).tolist()
    write_text(path, "".join([",".join(columns), "\n", *(",".join(map(repr, row)) + "\n" for row in rows)]))


def _header_names(path: str | Path, lines: list[str], layout: TextLayout) -> list[str]:
    """Return the names in the last line of a header, which may end with a separator; InputError if it has none."""
    number = layout.header_lines
    cells = split_cells(lines[number - 1], SEPARATORS[layout.separator]) if 0 < number <= len(lines) else []
    cells = cells[:-1] if len(cells) > 1 and not cells[-1] else cells
    check_table(0, len(cells), source=str(path))
    if not cells:
        raise InputError(f"{path}, line {number}: {_TOO_LONG}")
    _, problems = names_of(cells, len(cells))
    if all(map(is_number, cells)):
        problems = ["This line has numbers; it must be the header with the column names."]
    if problems:
        raise InputError(f"{path}, line {number}: {problems[0][0].lower()}{problems[0][1:]}")
    return cells


def names_of(cells: list[str], width: int) -> tuple[list[str], list[str]]:
    """Return a name for each of `width` columns by the cells of a header, and sentences on what these lack."""
    if not cells:
        problem = f"The file has no header; its columns are called column_1 to column_{width}."
        return [f"column_{place}" for place in range(1, width + 1)], [problem]
    given, filled = [cell.lstrip("#%").strip() for cell in cells], filled_cells(cells)
    if len(given) != width and (len(filled) == width or (cells[0] and not given[0])):
        # blanks or tabs that align the names, or a mark of a comment before them
        given = filled if len(filled) == width else given[1:]
    unnamed = [
        str(place) for place, name in enumerate(given[:width], start=1) if not name.isprintable() or not name
    ]
    problems = []
    if unnamed:
        problems.append(f"The header has no name for column{'s' * (len(unnamed) > 1)} {', '.join(unnamed)}.")
    if len(given) != width:
        problems.append(f"The header names {len(given)} columns and the rows have {width}.")
    names: list[str] = []
    for place, name in enumerate([*given, *[""] * width][:width], start=1):
        known = name if name and name.isprintable() else f"column_{place}"
        if known in names:
            problems.append(f"The column name {known} appears twice.")
        names.append(f"{known}_{place}" if known in names else known)
    return names, problems


def filled_cells(cells: list[str]) -> list[str]:
    """Return the names in a header's cells, without a comment's mark and without empty ones."""
    return [name for cell in cells if (name := cell.lstrip("#%").strip())]


def _whole_rows(
    path: str | Path, lines: list[str], layout: TextLayout, width: int
) -> tuple[dict[int, str], int, int]:
    """Return the rows of `width` cells by the numbers of their lines, and the line of a last row cut short.

    The third value is the number of other rows; InputError if these are refused.
    """
    mark, rows, cut, damaged = SEPARATORS[layout.separator], dict[int, str](), 0, 0
    last = max((k for k, line in enumerate(lines, start=1) if line.strip()), default=0)
    for number, line in enumerate(lines[layout.header_lines :], start=layout.header_lines + 1):
        if not line.strip():
            continue
        cells = line.count(mark) + 1 if mark and '"' not in line else len(split_cells(line, mark))
        if mark and cells == width + 1 and line.rstrip(" ").endswith(mark):
            line = line.rstrip(" ").removesuffix(mark)
            cells = width
        if cells == width:
            rows[number] = line
        elif not cells:
            raise InputError(f"{path}, line {number}: {_TOO_LONG}")
        elif number == last and cells < width:
            cut = number
        elif layout.damaged_rows == "drop":
            damaged += 1
        else:
            raise InputError(f"{path}, line {number}: the row has {cells} cells, but the header has {width}.")
    return rows, cut, damaged


def _frame(path: str | Path, rows: list[str], layout: TextLayout, width: int) -> DataFrame:
    """Return rows of text as pandas reads them; InputError if a cell goes on in the next line."""
    import pandas  # takes longer to import than most logs to read

    try:
        frame = pandas.read_csv(
            io.StringIO("\n".join(rows) or "\n"),
            sep=SEPARATORS[layout.separator] or r"\s+",
            decimal="," if layout.decimal == "comma" else ".",
            na_values=[*MISSING, *map(str.upper, MISSING), *layout.missing],
            names=range(width),
            header=None,
            index_col=False,
            skipinitialspace=True,
            low_memory=False,
        )
    except pandas.errors.ParserError:
        frame = pandas.DataFrame()
    if len(frame) != len(rows):
        raise InputError(f"{path}: a quotation mark is not closed in its line; close or remove it.")
    return frame


def split_cells(line: str, separator: str | None) -> list[str]:
    """Return the cells of a line, without blanks and quotes around them; none if one is too long for a table."""
    cells = line.split(separator)
    if separator is not None and '"' in line:  # in quotes it separates nothing
        try:
            cells = next(csv.reader([line], delimiter=separator, skipinitialspace=True))
        except csv.Error:  # a cell longer than any number or word
            cells = []
    return [cell.strip().strip('"').strip() for cell in cells]


def _value(cell: str, layout: TextLayout) -> float | None:
    """Return the number in a cell, the seconds of a date or time, or NaN if it has no value; None of words."""
    cell = cell.strip().strip('"').strip()
    if cell in layout.missing or cell.lower() in MISSING:
        return math.nan
    cell = cell.replace(",", ".") if layout.decimal == "comma" else cell
    return float(cell) if is_number(cell) else seconds_of(cell)


def is_number(cell: str) -> bool:
    """Return whether a cell is a number."""
    try:
        float(cell)
    except ValueError:
        return False
    return "_" not in cell  # Python's float accepts 1_000, which is no number in a table


def seconds_of(cell: str) -> float | None:
    """Return the seconds since 1970 of a date with a time, or since midnight of a time; None of other cells.

    Both are as in ISO 8601, UTC without an offset: 2026-05-03 14:59:50.005 and 14:59:50.005.
    """
    if cell.count(":") < 2:
        return None
    try:
        moment = datetime.fromisoformat(cell if "-" in cell else f"1970-01-01T{cell.rjust(8, '0')}")
    except ValueError:  # such as a 13th month
        return None
    return moment.replace(tzinfo=moment.tzinfo or UTC).timestamp()
