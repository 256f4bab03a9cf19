"""A text table of unknown layout, read as far as it makes sense: separator, header, widths, damage, restarts."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.inputs import decoded, read_bytes
from ballbot.log.parquet_table import read_parquet_table
from ballbot.log.text_table import TextLayout, read_text_table
from ballbot.sizes import check_table

_SEPARATORS: dict[str, str | None] = {"comma": ",", "semicolon": ";", "tab": "\t", "blanks": None}
#: lines looked at to find the separator and the header
_LOOKED_AT = 200
#: bytes; every cell of an unknown layout is looked at
_LARGEST = 100_000_000
_NOT_A_NUMBER = frozenset({"", "na", "n/a", "none", "null", "-", "--"})


@dataclass(frozen=True, kw_only=True, eq=False)
class ForeignTable:
    """The file's columns and what had to be assumed to read them."""

    layout: TextLayout
    separator: str  #: its word in a mapping file
    columns: dict[str, NDArray[np.float64]]
    named: bool  #: whether the file has a header
    notes: tuple[str, ...]  #: sentences on what is odd about the file


def read_foreign_table(path: str | Path) -> ForeignTable:
    """Read a table of text, or Parquet, whatever its layout.

    Raises
    ------
    InputError
        Where the file cannot be read or holds no table of numbers.
    """
    if Path(path).suffix.lower() == ".parquet":
        return ForeignTable(
            layout=TextLayout(),
            separator="comma",
            columns=read_parquet_table(path),
            named=True,
            notes=(),
        )
    lines = _lines(path)
    separator = _separator(lines)
    mark = _SEPARATORS[separator]
    cells = [_cells(line, mark) for line in lines]
    numeric = [bool(row) and all(_number_like(cell) for cell in row) for row in cells]
    if sum(numeric) < 2:
        raise InputError(f"{path} contains no table of numbers: no two of its lines are all numbers.")
    first = _first_row(cells, numeric)
    widths = Counter(len(row) for row, good in zip(cells, numeric, strict=True) if good)
    width = max(widths, key=lambda count: widths[count])
    check_table(len(lines), width, source=str(path))
    names, notes = _names(cells[:first], width)
    words = sorted({cell for row in cells for cell in row if cell.lower() in _NOT_A_NUMBER and cell})
    damaged = sum(
        1
        for row, good in zip(cells[first:], numeric[first:], strict=True)
        if row and not (good and len(row) == width)
    )
    if damaged:
        notes.append(
            f"{damaged} rows that do not have {width} cells, or contain words among the numbers, are skipped."
        )
    layout = TextLayout(
        separator=mark,
        missing=tuple(words),
        header_lines=first,
        names=tuple(names),
        drop_damaged=damaged > 0,
    )
    return ForeignTable(
        layout=layout,
        separator=separator,
        columns=read_text_table(path, layout),
        named=any(cells[:first]),
        notes=tuple(notes),
    )


def _lines(path: str | Path) -> list[str]:
    text = decoded(read_bytes(path, largest=_LARGEST), source=str(path), errors="replace")
    if not text.strip():
        raise InputError(f"{path} is empty; a log needs rows of numbers.")
    return text.split("\n")


def _separator(lines: list[str]) -> str:
    """Return the separator under which the most lines are rows of two numbers or more."""
    looked_at = [line for line in lines if line.strip()][: 2 * _LOOKED_AT][-_LOOKED_AT:]

    def rows(mark: str | None) -> int:
        found = [_cells(line, mark) for line in looked_at]
        return sum(len(row) > 1 and all(_number_like(cell) for cell in row) for row in found)

    return max(_SEPARATORS, key=lambda word: rows(_SEPARATORS[word]))


def _cells(line: str, mark: str | None) -> list[str]:
    if not line.strip():
        return []
    cells = [cell.strip().strip('"').strip() for cell in line.strip().split(mark)]
    return cells[:-1] if mark and cells[-1] == "" else cells  # a separator at the line's end


def _number_like(cell: str) -> bool:
    if cell.lower() in _NOT_A_NUMBER:
        return True
    try:
        float(cell)
    except ValueError:
        return False
    return "_" not in cell


def _first_row(cells: list[list[str]], numeric: list[bool]) -> int:
    """Return the line of the first row: the first of two rows of numbers that are equally wide."""
    for k in range(len(cells) - 1):
        if numeric[k] and numeric[k + 1] and len(cells[k]) == len(cells[k + 1]):
            return k
    return numeric.index(True)


def _names(head: list[list[str]], width: int) -> tuple[list[str], list[str]]:
    """Return a name for each column, and notes, from the lines before the first row."""
    named = [row for row in head if row and not all(_number_like(cell) for cell in row)]
    notes: list[str] = []
    if not named:
        notes.append(f"The file has no header; its columns are called column_1 to column_{width}.")
        return [f"column_{place}" for place in range(1, width + 1)], notes
    given = [cell.lstrip("#%").strip() for cell in named[-1]]
    given = [cell for cell in given if cell]
    if len(given) != width:
        notes.append(
            f"The header names {len(given)} columns and the rows have {width}: "
            + ("the last columns have no name." if len(given) < width else "the last names are unused.")
        )
    names: list[str] = []
    for place in range(width):
        name = given[place] if place < len(given) and given[place].isprintable() else f"column_{place + 1}"
        names.append(f"{name}_{place + 1}" if name in names else name)
    return names, notes
