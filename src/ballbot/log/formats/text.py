"""Tables of numbers as text: CSV, and the separated files that other people's robots write.

A well-formed file is read by NumPy's compiled parser. If that fails, the rows are read one at a time, which allows
missing values and dates with times, leaves columns of words out, and gives messages the line. `inference` finds the
layout of a file that no mapping describes.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import NonNegativeInt, PositiveInt

from ballbot.arrays import check_table
from ballbot.errors import InputError
from ballbot.files import LARGEST_TABLE, read_text, write_text
from ballbot.log.columns import Columns, Floats, check_column_names, mark_missing
from ballbot.summary import counted

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
    unordered_rows: Literal["refuse", "drop"] = (
        "refuse"  #: those whose time decreases; `ballbot.log.row_order`
    )
    rows: tuple[PositiveInt, PositiveInt] | None = (
        None  #: first and last row to use, damaged ones not counted
    )


#: cells without a value, in small letters
MISSING = frozenset({"", "na", "n/a", "none", "null", "-", "--"})
_TOO_LONG = f"a cell has more than {csv.field_size_limit()} characters."
OWN_LAYOUT = TextLayout()


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
    text = read_text(path, largest=LARGEST_TABLE)
    if not text.strip():
        raise InputError(f"{path} is empty; a log needs a line of column names and rows of numbers.")
    lines = text.split("\n")
    names = list(layout.names) if layout.names is not None else _header_names(path, lines, layout)
    check_table(len(lines), len(names), source=str(path))
    body = lines[layout.header_lines :]
    if layout.decimal == "comma" and layout.separator != "comma":
        body = [line.replace(",", ".") for line in body]
    table = _parse_fast(body, names, layout)
    if table is None:
        names, table, remarks = _parse_rows(path, body, names, layout, used)
        if notes is not None:
            notes += remarks
    if layout.rows is not None:
        table = table[layout.rows[0] - 1 : layout.rows[1]]
    if not len(table):
        raise InputError(
            f"{path} has a header and no rows{('' if layout.rows is None else ' of those to take')}."
        )
    table = mark_missing(table)
    return {name: np.ascontiguousarray(table[:, i]) for i, name in enumerate(names)}


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
    names = split_cells(lines[number - 1], SEPARATORS[layout.separator]) if 0 < number <= len(lines) else []
    names = names[:-1] if len(names) > 1 and not names[-1] else names
    where = f"{path}, line {number}"
    check_table(0, len(names), source=str(path))
    if not names:
        raise InputError(f"{where}: {_TOO_LONG}")
    check_column_names(names, source=where)
    if all(is_number(name) for name in names):
        raise InputError(f"{where}: this line has numbers; it must be the header with the column names.")
    if "" in names:
        raise InputError(f"{where}: column {names.index('') + 1} of the header has no name.")
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise InputError(f"{where}: the column name {twice[0]} appears twice.")
    return names


def _parse_fast(body: list[str], names: list[str], layout: TextLayout) -> Floats | None:
    """Return the table if NumPy's parser can read it, else None."""
    first = next((line for line in body if line.strip()), None)
    # a row of another width may be millions of cells wide
    mark = SEPARATORS[layout.separator]
    if first is None or len(split_cells(first, mark)) != len(names):
        return None
    if any(map(is_number, layout.missing)) or (layout.decimal == "comma" and layout.separator == "comma"):
        return None
    try:
        table = np.loadtxt(body, delimiter=mark, comments=None, quotechar='"', ndmin=2)
    except ValueError:
        return None
    return table if table.shape[1] == len(names) else None


#: the beginning of a number that is no number
_BEGUN = re.compile(r"[+-]?(\d+\.?\d*)?([eE][+-]?)?", re.ASCII)


def _parse_rows(
    path: str | Path, body: list[str], names: list[str], layout: TextLayout, used: Collection[str] | None
) -> tuple[list[str], Floats, list[str]]:
    """Return the names of the columns of numbers, their table, and notes; InputError as `read_text_table`."""
    numbers, rows, damaged, cut, notes = list[int](), list[list[str]](), 0, 0, list[str]()
    lines = [(k, line) for k, line in enumerate(body, start=layout.header_lines + 1) if line.strip()]
    for number, line in lines:
        cells = split_cells(line, SEPARATORS[layout.separator])
        if layout.decimal == "comma":
            cells = [cell.replace(",", ".") for cell in cells]
        if len(cells) == len(names) + 1 and not cells[-1]:  # a separator at the row's end
            cells.pop()
        if len(cells) == len(names):
            numbers.append(number)
            rows.append(cells)
        elif not cells:
            raise InputError(f"{path}, line {number}: {_TOO_LONG}")
        elif number == lines[-1][0] and len(cells) < len(names):
            cut = number
        elif layout.damaged_rows == "drop":
            damaged += 1
        else:
            raise InputError(
                f"{path}, line {number}: the row has {len(cells)} cells, but the header has {len(names)}."
            )
    values = [[_value(cell, layout.missing) for cell in row] for row in rows]
    table = np.array(values, dtype=np.float64).reshape(len(rows), len(names))  # NaN where there is a word
    words = np.array([[value is None for value in row] for row in values], dtype=np.bool_).reshape(
        table.shape
    )
    # of words, by what the table is used for, or by most cells with something in them
    most = 2 * words.sum(axis=0) > (words | ~np.isnan(table)).sum(axis=0)
    unused = most if used is None else np.array([name not in used for name in names], dtype=np.bool_)
    left_out = np.asarray(words.any(axis=0)) & unused
    for i in np.flatnonzero(left_out):
        example = rows[int(np.argmax(words[:, i]))][i]
        notes.append(f"The column {names[i]} is left out: it has words, such as {example!r}.")
    places = np.argwhere(words & ~left_out)
    row, column = places[0] if len(places) else (-1, -1)
    is_last = len(places) == 1 and (row, column) == (len(rows) - 1, len(names) - 1)
    if is_last and _BEGUN.fullmatch(rows[-1][-1]):
        cut = numbers[-1]
    elif len(places) and layout.damaged_rows == "refuse":
        raise InputError(
            f"{path}, line {numbers[row]}: {rows[row][column]!r} in column {names[column]} is not a number; correct "
            "it, or leave the cell empty if the value is missing."
        )
    spoilt = np.isin(np.arange(len(rows)), places[:, 0])
    damaged += 0 if numbers[-1:] == [cut] else int(spoilt.sum())
    if cut:
        notes.append(f"The last row, line {cut}, is cut short and left out.")
    if damaged:
        notes.append(
            f"Skipped: {counted(damaged, 'row')} without {len(names)} cells, or with words among the numbers."
        )
    kept = [name for name, out in zip(names, left_out, strict=True) if not out]
    return kept, table[~spoilt][:, ~left_out], notes


def split_cells(line: str, separator: str | None) -> list[str]:
    """Return the cells of a line, without blanks and quotes around them; none if one is too long for a table."""
    cells = line.split(separator)
    if separator is not None and len(separator) == 1 and '"' in line:  # in quotes it separates nothing
        try:
            cells = next(csv.reader([line], delimiter=separator, skipinitialspace=True))
        except csv.Error:  # a cell longer than any number or word
            cells = []
    return [cell.strip().strip('"').strip() for cell in cells]


def _value(cell: str, missing: Collection[str]) -> float | None:
    """Return the number in a cell, the seconds of a date or time, or NaN if it has no value; None of words."""
    if cell in missing or cell.lower() in MISSING:
        return math.nan
    return float(cell) if is_number(cell) else seconds_of(cell)


def is_number(cell: str) -> bool:
    """Return whether a cell is a number."""
    try:
        float(cell)
    except ValueError:
        return False
    return "_" not in cell  # Python's float accepts 1_000, which is no number in a table


_CLOCK = re.compile(r"([01]?\d|2[0-3]):([0-5]\d):([0-5]\d)(?:[.,](\d+))?", re.ASCII)


def seconds_of(cell: str) -> float | None:
    """Return the seconds since 1970 of a date with a time, or since midnight of a time; None of other cells.

    Dates are as in ISO 8601, UTC without an offset; times are as 14:59:50.005.
    """
    clock = _CLOCK.fullmatch(cell)
    if clock:
        hours, minutes, seconds, fraction = clock.groups()
        return 3600.0 * int(hours) + 60.0 * int(minutes) + float(f"{seconds}.{fraction or 0}")
    try:
        moment = datetime.fromisoformat(cell) if ":" in cell else None
    except ValueError:  # such as a 13th month
        return None
    return None if moment is None else moment.replace(tzinfo=moment.tzinfo or UTC).timestamp()
