"""Tables of numbers as text: CSV, the separated files that other people's robots write, and tables of unknown layout.

A well-formed file is read by NumPy's compiled parser. If that fails, the rows are read one at a time, which allows
missing values and dates with times, leaves columns of words out, and gives messages the line. `inference` finds the
layout of tables that do not have Ballbot's own.

Ballbot's own CSV has commas between its cells and a decimal point, or semicolons and a decimal comma, as spreadsheets
write it in many countries. The header shows which: it has the column t.
"""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import check_table
from ballbot.errors import InputError
from ballbot.files import check_regular, decode_text, read_text, write_text
from ballbot.log.columns import check_column_names, mark_missing
from ballbot.log.formats.serial import plain
from ballbot.printable import shell_line


@dataclass(frozen=True, kw_only=True)
class TextLayout:
    """How a text file lays out its table. The defaults are Ballbot's own CSV."""

    separator: str | None = ","  #: between cells; None is any run of blanks
    decimal_comma: bool = (
        False  #: whether 0,5 is a half; if the separator is a comma, the cells are in quotes
    )
    missing: tuple[str, ...] = ()  #: marks of a missing value, beside an empty cell and "nan"
    header_lines: int = 1  #: lines before the first row, the last of them with the columns' names
    names: tuple[str, ...] | None = None  #: the columns' names if the header has none or wrong ones
    drop_damaged: bool = False  #: skip rows of another width or with words instead of refusing them
    rows: tuple[int, int] | None = None  #: first and last row to use, from 1, damaged ones not counted


#: Ballbot's own CSV, as it is written unless the other one is asked for
OWN_LAYOUT = TextLayout()
SEMICOLON_LAYOUT = TextLayout(separator=";", decimal_comma=True)
_OWN_LAYOUTS = (OWN_LAYOUT, SEMICOLON_LAYOUT, TextLayout(separator="\t", decimal_comma=True))
#: bytes of a header that are read
_LONGEST_HEADER = 100_000


def read_text_header(path: str | Path) -> list[str]:
    """Return the names in the first line of a file as Ballbot's own CSV has them; none if the line is empty.

    Raises
    ------
    InputError
        If the file cannot be read or is not text.
    """
    header = _header(path)
    return _header_names(header, _own_layout(header).separator) if header.strip() else []


def own_layout(path: str | Path) -> TextLayout:
    """Return the layout of a table in Ballbot's own CSV, by its header; InputError as `read_text_header`."""
    return _own_layout(_header(path))


def _header(path: str | Path) -> str:
    return text_start(path).split("\n", 1)[0]


def text_start(path: str | Path) -> str:
    """Return the first `_LONGEST_HEADER` bytes of a file."""
    check_regular(path)
    try:
        with open(path, "rb") as stream:
            start = stream.read(_LONGEST_HEADER)
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}.") from None
    return decode_text(start, source=str(path), errors="replace")


def _own_layout(header: str) -> TextLayout:
    return next((one for one in _OWN_LAYOUTS if "t" in split_cells(header, one.separator)), OWN_LAYOUT)


def read_text_table(
    path: str | Path,
    layout: TextLayout = OWN_LAYOUT,
    *,
    mapped: bool = True,
    used: Collection[str] | None = None,
    notes: list[str] | None = None,
) -> dict[str, NDArray[np.float64]]:
    """Read a table of numbers.

    Parameters
    ----------
    path : str or Path
        The file, UTF-8.
    layout : TextLayout
        How it is laid out.
    mapped : bool
        Whether the command takes a mapping file, which messages then name as a remedy.
    used : collection of str, optional
        The columns that must consist of numbers. Others are left out if they do not; if not given, so are those of
        which most cells are words.
    notes : list of str, optional
        Sentences on what is left out are added to it.

    Returns
    -------
    dict of str to (N,) array
        The columns by name, in the file's order; a cell without a value, or with one beyond `LARGEST_CELL`, is NaN.

    Raises
    ------
    InputError
        If the file cannot be read or is not such a table; the message names the line.
    """
    lines = _read_lines(path)
    names = _names(path, lines, layout, mapped=mapped)
    check_table(len(lines), len(names), source=str(path))
    body = _without_last_separators(lines[layout.header_lines :], len(names), layout.separator)
    body = _with_points(path, body, layout, inferred=not mapped)
    table = _parse_fast(body, names, layout)
    if table is None:
        names, table = _Rows(
            path=path, names=names, layout=layout, mapped=mapped, used=used, notes=notes
        ).parsed(body)
    if layout.rows is not None:
        table = table[layout.rows[0] - 1 : layout.rows[1]]
    if not len(table):
        raise InputError(
            f"{path} has a header and no rows{('' if layout.rows is None else ' of those to take')}."
        )
    table = mark_missing(table)
    return {name: np.ascontiguousarray(table[:, i]) for i, name in enumerate(names)}


def write_text_table(
    path: str | Path, columns: Mapping[str, NDArray[np.float64]], layout: TextLayout = OWN_LAYOUT
) -> None:
    """Write columns (N,) as CSV, in the fewest digits that read back to the same bits; NaN becomes `nan`.

    Parameters
    ----------
    path : str or Path
    columns : mapping of str to ndarray
    layout : TextLayout
        `OWN_LAYOUT` or `SEMICOLON_LAYOUT`.

    Raises
    ------
    InputError
        If a column's name cannot be written to CSV, or the file cannot be written.
    """
    separator = layout.separator or ","
    for name in columns:
        if not name or name != name.strip() or any(mark in name for mark in f'{separator}"\n\r'):
            raise InputError(
                f"The column name {name!r} cannot be written to CSV; use letters, digits and underscores."
            )
    if layout.decimal_comma and len(columns) == 1:
        raise InputError(
            "A table of one column cannot be written with decimal commas: they would separate cells."
        )
    rows = np.column_stack(list(columns.values())).tolist()
    lines = (separator.join(map(repr, row)) + "\n" for row in rows)
    text = io.StringIO()
    text.write(separator.join(columns) + "\n")
    text.writelines((line.replace(".", ",") for line in lines) if layout.decimal_comma else lines)
    write_text(path, text.getvalue())


def _read_lines(path: str | Path) -> list[str]:
    text = read_text(path)
    if not text.strip():
        raise InputError(f"{path} is empty; a log needs a line of column names and rows of numbers.")
    return plain(text.split("\n")).lines


def _names(path: str | Path, lines: list[str], layout: TextLayout, *, mapped: bool) -> list[str]:
    if layout.names is not None:
        return list(layout.names)
    number = layout.header_lines
    header = lines[number - 1] if 0 < number <= len(lines) else ""
    names = _header_names(header, layout.separator)
    check_names(path, number, names)
    if len(names) == 1 and len(header.replace(";", "\t").split()) > 1:
        proposing = shell_line(["ballbot", "check-log", path, "--robot", "ROBOT", "--out", "checked"])
        remedy = (
            f"a mapping file names another separator: `{proposing}` proposes one"
            if mapped
            else "no row of numbers below shows which separator it has"
        )
        raise InputError(
            f"{path}, line {number}: the header is not separated by {_word(layout.separator)}; {remedy}."
        )
    return names


def _header_names(header: str, separator: str | None) -> list[str]:
    """Return the names in a header, which may end with a separator."""
    names = split_cells(header, separator)
    return names[:-1] if len(names) > 1 and not names[-1] else names


def _without_last_separators(lines: list[str], width: int, separator: str | None) -> list[str]:
    """Return rows without the separator that some programs write behind each cell: one empty cell too many."""
    if separator is None:
        return lines
    ended = [line.rstrip(" \r") for line in lines]
    return [
        cut[: -len(separator)]
        if cut.endswith(separator) and len(split_cells(line, separator)) == width + 1
        else line
        for line, cut in zip(lines, ended, strict=True)
    ]


def check_names(path: str | Path, number: int, names: list[str]) -> None:
    """Raise InputError if the cells of a line cannot be the columns' names."""
    check_table(0, len(names), source=str(path))
    if not names:
        raise InputError(f"{path}, line {number}: a cell has more than {csv.field_size_limit()} characters.")
    check_column_names(names, source=f"{path}, line {number}")
    if all(is_number(name) for name in names):
        raise InputError(
            f"{path}, line {number}: this line has numbers; it must be the header with the column names."
        )
    if "" in names:
        by_pandas = names[0] == "" and names.count("") == 1 and len(names) > 1
        hint = (
            " If pandas wrote it with its index, write it with to_csv(..., index=False)." if by_pandas else ""
        )
        raise InputError(
            f"{path}, line {number}: column {names.index('') + 1} of the header has no name.{hint}"
        )
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(f"{path}, line {number}: the column name {twice[0]} appears twice.")


def _with_points(path: str | Path, lines: list[str], layout: TextLayout, *, inferred: bool) -> list[str]:
    """Return lines with decimal points; of a layout with decimal commas that the file shows, all or none may be."""
    if not layout.decimal_comma or layout.separator == ",":
        return lines
    commas = next((k for k, line in enumerate(lines) if "," in line), None)
    if commas is not None and (inferred or layout in _OWN_LAYOUTS):
        points = next((k for k, line in enumerate(lines) if "." in line), None)
        if points is not None:
            raise InputError(
                f"{path} has a decimal comma in line {layout.header_lines + 1 + commas} and a decimal point in line "
                f"{layout.header_lines + 1 + points}; use one of them throughout."
            )
    return lines if commas is None else [line.replace(",", ".") for line in lines]


def _parse_fast(body: list[str], names: list[str], layout: TextLayout) -> NDArray[np.float64] | None:
    """Return the table if NumPy's parser can read it, else None."""
    first = next((line for line in body if line.strip()), None)
    # a row of another width may be millions of cells wide
    if first is None or len(split_cells(first, layout.separator)) != len(names):
        return None
    if any(is_number(mark) for mark in layout.missing) or (layout.decimal_comma and layout.separator == ","):
        return None
    try:
        table = np.loadtxt(body, delimiter=layout.separator, comments=None, quotechar='"', ndmin=2)
    except ValueError:
        return None
    return table if table.shape[1] == len(names) else None


#: the beginning of a number that is no number
_BEGUN = re.compile(r"[+-]?(\d+\.?\d*)?([eE][+-]?)?", re.ASCII)


@dataclass(frozen=True, kw_only=True)
class _Rows:
    """A parser of rows, one at a time."""

    path: str | Path
    names: list[str]
    layout: TextLayout
    mapped: bool
    used: Collection[str] | None
    notes: list[str] | None

    def parsed(self, body: list[str]) -> tuple[list[str], NDArray[np.float64]]:
        """Return the columns of numbers, their names and a table (N, len(names)); InputError as `read_text_table`."""
        rows = self._whole(body)
        missing = {"", *self.layout.missing}
        columns = [
            [math.nan if cells[i] in missing else number_in(cells[i]) for _, cells in rows]
            for i in range(len(self.names))
        ]
        words = [[k for k, value in enumerate(column) if value is None] for column in columns]
        kept = [i for i, column in enumerate(columns) if not self._left_out(i, column, words[i], rows)]
        wrong = [(i, k) for i in kept for k in words[i]]
        if wrong == [(len(self.names) - 1, len(rows) - 1)] and _BEGUN.fullmatch(rows[-1][1][-1]):
            self._note(f"The last row, line {rows[-1][0]}, is cut short and left out.")
        elif wrong and not self.layout.drop_damaged:
            self._refuse_words(wrong[0], rows)
        spoilt = {k for _, k in wrong}
        table = [
            [column[k] for i, column in enumerate(columns) if i in kept]
            for k in range(len(rows))
            if k not in spoilt
        ]
        return [self.names[i] for i in kept], np.array(table, dtype=np.float64).reshape(len(table), len(kept))

    def _whole(self, body: list[str]) -> list[tuple[int, list[str]]]:
        """Return the rows with a cell for each name, and their lines' numbers."""
        rows = []
        lines = [(k, line) for k, line in enumerate(body, start=self.layout.header_lines + 1) if line.strip()]
        for number, line in lines:
            cells = split_cells(line, self.layout.separator)
            if not cells:
                raise InputError(
                    f"{self.path}, line {number}: a cell has more than {csv.field_size_limit()} characters."
                )
            if self.layout.decimal_comma:
                cells = [cell.replace(",", ".") for cell in cells]
            if len(cells) == len(self.names):
                rows.append((number, cells))
            elif number == lines[-1][0] and len(cells) < len(self.names):
                self._note(f"The last row, line {number}, is cut short and left out.")
            elif not self.layout.drop_damaged:
                raise InputError(
                    f"{self.path}, line {number}: the row has {len(cells)} cells, but the header has {len(self.names)}."
                )
        return rows

    def _left_out(
        self, i: int, column: list[float | None], words: list[int], rows: list[tuple[int, list[str]]]
    ) -> bool:
        """Return whether a column, of which some cells are words, is left out."""
        name = self.names[i]
        known = [value for value in column if value is None or not math.isnan(value)]
        if not words or (len(words) <= 0.5 * len(known) if self.used is None else name in self.used):
            return False
        self._note(f"The column {name} is left out: it has words, such as {rows[words[0]][1][i]!r}.")
        return True

    def _refuse_words(self, cell: tuple[int, int], rows: list[tuple[int, list[str]]]) -> None:
        i, k = cell
        remedy = (
            "correct it, leave the cell empty if the value is missing, or name a marker of missing values in a mapping "
            "file"
            if self.mapped
            else "correct it, or leave the cell empty if the value is missing"
        )
        raise InputError(
            f"{self.path}, line {rows[k][0]}: {rows[k][1][i]!r} in column {self.names[i]} is not a number; {remedy}."
        )

    def _note(self, sentence: str) -> None:
        if self.notes is not None:
            self.notes.append(sentence)


def split_cells(line: str, separator: str | None) -> list[str]:
    """Return the cells of a line, without blanks and quotes around them; none if one is too long for a table."""
    cells = line.split(separator)
    if separator is not None and len(separator) == 1 and '"' in line:  # in quotes it separates nothing
        try:
            cells = next(csv.reader([line], delimiter=separator, skipinitialspace=True))
        except csv.Error:  # a cell longer than any number or word
            cells = []
    return [cell.strip().strip('"').strip() for cell in cells]


def number_in(cell: str) -> float | None:
    """Return the number in a cell, or the seconds of a date or time; None of other cells."""
    return float(cell) if is_number(cell) else seconds_of(cell)


def is_number(cell: str) -> bool:
    """Return whether a cell is a number."""
    try:
        float(cell)
    except ValueError:
        return False
    return "_" not in cell  # Python's float accepts 1_000, which is no number in a table


_CLOCK = re.compile(r"([01]?\d|2[0-3]):([0-5]\d):([0-5]\d)(?:[.,](\d+))?", re.ASCII)
_DATE_TIME = re.compile(r"(\d{4}-\d\d-\d\d)[T ](\d\d:\d\d:\d\d)([.,]\d+)?\s*(Z|[+-]\d\d:?\d\d)?", re.ASCII)


def seconds_of(cell: str) -> float | None:
    """Return the seconds since 1970 of a date with a time, or since midnight of a time; None of other cells.

    Dates are as in ISO 8601, UTC without an offset; times are as 14:59:50.005.
    """
    clock = _CLOCK.fullmatch(cell)
    if clock:
        hours, minutes, seconds, fraction = clock.groups()
        return 3600.0 * int(hours) + 60.0 * int(minutes) + float(f"{seconds}.{fraction or 0}")
    found = _DATE_TIME.fullmatch(cell)
    if not found:
        return None
    date, time, fraction, offset = found.groups()
    zone = "+00:00" if offset in (None, "Z") else offset
    try:
        whole = datetime.fromisoformat(f"{date}T{time}{zone}").timestamp()
    except ValueError:  # such as a 13th month
        return None
    return whole + float(f"0.{fraction[1:]}" if fraction else 0.0)


def _word(separator: str | None) -> str:
    return {",": "commas", ";": "semicolons", "\t": "tabs", None: "blanks"}.get(separator, repr(separator))
