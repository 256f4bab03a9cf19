"""Tables of numbers as text: CSV, and the separated files that other people's robots write.

A well-formed file is read by NumPy's compiled parser. Where that refuses, the rows are read one at a time,
which allows missing values and finds the line that a sentence can point to.
"""

from __future__ import annotations

import io
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.files import write_text
from ballbot.inputs import read_text
from ballbot.log.columns import check_column_names, measured
from ballbot.sizes import check_table


@dataclass(frozen=True, kw_only=True)
class TextLayout:
    """How a text file lays out its table. The defaults are Ballbot's own CSV."""

    separator: str | None = ","  #: between cells; None is any run of blanks
    missing: tuple[str, ...] = ()  #: what marks a missing value, beside an empty cell and "nan"
    header_lines: int = 1  #: lines before the first row, the last of them with the columns' names
    names: tuple[str, ...] | None = None  #: the columns' names where the header has none or wrong ones
    drop_damaged: bool = False  #: leave out rows of another width or with words, where they would be refused
    rows: tuple[int, int] | None = (
        None  #: first and last of the rows to take, from 1, damaged ones not counted
    )


def read_text_table(path: str | Path, layout: TextLayout) -> dict[str, NDArray[np.float64]]:
    """Read a table of numbers.

    Parameters
    ----------
    path : str or Path
        The file, UTF-8.
    layout : TextLayout
        How it is laid out.

    Returns
    -------
    dict of str to (N,) array
        The columns by name, in the file's order; a cell without a value, or with one beyond all measure, is NaN.

    Raises
    ------
    InputError
        Where the file cannot be read or is not such a table, with the line.
    """
    lines = _read_lines(path)
    names = _names(path, lines, layout)
    check_table(len(lines), len(names), source=str(path))
    body = lines[layout.header_lines :]
    table = _parse_fast(body, names, layout)
    if table is None:
        table = _parse_by_line(path, body, names, layout)
    if layout.rows is not None:
        table = table[layout.rows[0] - 1 : layout.rows[1]]
    if not len(table):
        raise InputError(
            f"{path} has a header and no rows{('' if layout.rows is None else ' of those to take')}."
        )
    table = measured(table)
    return {name: np.ascontiguousarray(table[:, i]) for i, name in enumerate(names)}


def write_text_table(path: str | Path, columns: Mapping[str, NDArray[np.float64]]) -> None:
    """Write columns (N,) as CSV, in the fewest digits that read back to the same bits; NaN becomes `nan`.

    Raises
    ------
    InputError
        Where a column's name would not survive, or the file cannot be written.
    """
    for name in columns:
        if not name or name != name.strip() or any(mark in name for mark in ',"\n\r'):
            raise InputError(
                f"The column name {name!r} cannot be written to CSV; use letters, digits and underscores."
            )
    rows = np.column_stack(list(columns.values())).tolist()
    text = io.StringIO()
    text.write(",".join(columns) + "\n")
    text.writelines(",".join(map(repr, row)) + "\n" for row in rows)
    write_text(path, text.getvalue())


def _read_lines(path: str | Path) -> list[str]:
    text = read_text(path)
    if not text.strip():
        raise InputError(f"{path} is empty; a log needs a line of column names and rows of numbers.")
    return text.split("\n")


def _names(path: str | Path, lines: list[str], layout: TextLayout) -> list[str]:
    if layout.names is not None:
        return list(layout.names)
    number = layout.header_lines
    header = lines[number - 1] if 0 < number <= len(lines) else ""
    names = _cells(header, layout.separator)
    check_table(0, len(names), source=str(path))
    check_column_names(names, source=f"{path}, line {number}")
    if all(_is_number(name) for name in names):
        raise InputError(
            f"{path}, line {number}: this line has numbers; it must be the header with the column names."
        )
    if "" in names:
        raise InputError(f"{path}, line {number}: column {names.index('') + 1} of the header has no name.")
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(f"{path}, line {number}: the column name {twice[0]} appears twice.")
    if len(names) == 1 and len(header.replace(";", "\t").split()) > 1:
        raise InputError(
            f"{path}, line {number}: the header is not separated by "
            f"{_word(layout.separator)}; name another separator in a mapping file."
        )
    return names


def _parse_fast(body: list[str], names: list[str], layout: TextLayout) -> NDArray[np.float64] | None:
    """Return the table where NumPy's parser takes it as it is, else None."""
    first = next((line for line in body if line.strip()), None)
    # a row of another width may be millions of cells wide
    if layout.missing or first is None or len(_cells(first, layout.separator)) != len(names):
        return None
    try:
        table = np.loadtxt(body, delimiter=layout.separator, comments=None, quotechar='"', ndmin=2)
    except ValueError:
        return None
    return table if table.shape[1] == len(names) else None


def _parse_by_line(
    path: str | Path, body: list[str], names: list[str], layout: TextLayout
) -> NDArray[np.float64]:
    missing = {"", *layout.missing}
    rows = []
    for number, line in enumerate(body, start=layout.header_lines + 1):
        if not line.strip():
            continue
        cells = _cells(line, layout.separator)
        if layout.drop_damaged and not _is_row(cells, len(names), missing):
            continue
        if len(cells) != len(names):
            raise InputError(
                f"{path}, line {number}: the row has {len(cells)} cells, but the header has {len(names)}."
            )
        rows.append([_number(path, number, names[i], cell, missing) for i, cell in enumerate(cells)])
    return np.array(rows, dtype=np.float64).reshape(len(rows), len(names))


def _is_row(cells: list[str], width: int, missing: set[str]) -> bool:
    return len(cells) == width and all(cell in missing or _is_number(cell) for cell in cells)


def _cells(line: str, separator: str | None) -> list[str]:
    return [cell.strip().strip('"').strip() for cell in line.split(separator)]


def _number(path: str | Path, line: int, name: str, cell: str, missing: set[str]) -> float:
    if cell in missing:
        return math.nan
    if _is_number(cell):
        return float(cell)
    raise InputError(
        f"{path}, line {line}: {cell!r} in column {name} is not a "
        "number; name a marker of missing values in a mapping file."
    )


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return "_" not in cell  # Python's float takes 1_000, which no table means as a number


def _word(separator: str | None) -> str:
    return {",": "commas", ";": "semicolons", "\t": "tabs", None: "blanks"}.get(separator, repr(separator))
