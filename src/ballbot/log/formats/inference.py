"""The layout that the lines of a table of text show: separator, decimal sign, header, units.

A log without a mapping, and the record of an axis, are read by it, with every row whole (`read_inferred`). For a
stranger's table damaged rows are skipped and counted, and a mapping file then states the layout (`infer_text_table`).
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from ballbot.errors import InputError
from ballbot.files import check_regular, decode_text
from ballbot.log.columns import KNOWN_NAMES, UNIT_OF, Columns, native_columns
from ballbot.log.formats.text import (
    MISSING,
    SEPARATORS,
    TextLayout,
    filled_cells,
    is_number,
    names_of,
    read_text_table,
    seconds_of,
    split_cells,
)

#: lines examined to find the separator, and bytes of a file in which its layout must show
_EXAMINED, _HEAD = 200, 100_000
#: units, of which a row below the header consists: alone, in products, quotients and powers, or in brackets
_OTHER_UNITS = "n mn kn knm cm um µm km kg g w mw hz khz k c °c pa bar min h u inc"
_UNITS = {*UNIT_OF, *_OTHER_UNITS.split()}


@dataclass(frozen=True, kw_only=True, eq=False)
class ForeignTable:
    """The columns of a foreign file, and the layout that was inferred."""

    layout: TextLayout
    columns: Columns
    named: bool  #: whether the file has a header
    notes: tuple[str, ...]  #: sentences on anomalies of the file
    units: Mapping[str, str] = field(default_factory=dict)  #: by column, as a row below the header has them


def infer_text_table(path: str | Path, *, given_names: Sequence[str] | None = None) -> ForeignTable:
    """Read a table of text, whatever its layout; InputError if the file cannot be read or has no table of numbers."""
    head = read_head(path)
    if not head.rows:
        raise InputError(f"{path} contains no table: none of its lines consists only of numbers.")
    if head.rows == 1:
        raise InputError(
            f"{path} has one row of numbers (line {head.layout.header_lines + 1}); a log needs at least two."
        )
    notes = list(head.notes) if given_names is None else []
    names, width = head.names if given_names is None else tuple(given_names), len(head.names)
    if len(names) != width:
        raise InputError(
            f"{path} has {width} columns, but {len(names)} names were given: {', '.join(names)}."
        )
    layout = replace(head.layout, names=names, damaged_rows="drop")
    columns = read_text_table(path, layout, notes=notes)
    damaged = any(one.startswith("Skipped") for one in notes)
    return ForeignTable(
        layout=layout if damaged else replace(layout, damaged_rows="refuse"),
        columns=columns,
        named=given_names is not None or head.named,
        notes=tuple(notes),
        units=head.units,
    )


def read_inferred(path: str | Path, *, of_a_log: bool = False, notes: list[str] | None = None) -> Columns:
    """Read a table of numbers whose separator, decimal sign and header are inferred; every row must be whole.

    Columns of words are omitted; in a log, only those without one of Ballbot's names. `notes` gets a sentence for each
    omission. Raises InputError as `read_text_table` does.
    """
    head = read_head(path)
    if head.twice:
        raise InputError(f"{path}: the column name {head.twice} appears twice.")
    layout = replace(head.layout, names=None, header_lines=1)
    if head.above is not None:  # a row with a word is one, and no part of the header
        layout = replace(head.layout, header_lines=head.above)
    used = {*KNOWN_NAMES, *native_columns(head.names)} if of_a_log else None
    return read_text_table(path, layout, used=used, notes=notes)


@dataclass(frozen=True, kw_only=True)
class Head:
    """What the lines of a table show."""

    layout: TextLayout
    rows: int = 0  #: that consist of numbers, of the examined ones
    #: lines down to the one with the names, or units; None if no line has a name for each
    above: int | None = None
    named: bool = False
    twice: str = ""  #: a name that two columns have; the second is then called by its place, too
    notes: tuple[str, ...] = ()
    units: Mapping[str, str] = field(default_factory=dict)  #: by column, as a row below the names gives them

    @property
    def names(self) -> tuple[str, ...]:
        """The columns' names."""
        return self.layout.names or ()


def read_head(path: str | Path) -> Head:
    """Return what the first lines of a table show; InputError if the file cannot be read or is empty."""
    check_regular(path)
    try:
        with open(path, "rb") as stream:
            start = stream.read(_HEAD)
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}.") from None
    if not start.strip():
        raise InputError(f"{path} is empty; a log needs a line of column names and rows of numbers.")
    # a character, and the last line, may be cut
    lines = decode_text(start, source=str(path), errors="replace").split("\n")
    return _head_of(lines[:-1] if len(start) == _HEAD and len(lines) > 1 else lines)


def _head_of(lines: list[str]) -> Head:
    layout = _likely_layout(lines)
    cells = [_cells(line, layout) for line in lines]
    rows = [row for row in cells if _is_row(row)]
    if not rows:
        return Head(layout=replace(layout, names=tuple(cells[0])))
    widest = max(map(len, rows))
    if (
        layout.separator != "blanks"
        and widest > 1
        and all(row[-1] == "" for row in rows if len(row) == widest)
    ):
        # a separator at the end of lines
        cells = [row[:-1] if len(row) == widest and row[-1] == "" else row for row in cells]
        rows = [row for row in cells if _is_row(row)]
    width = Counter(map(len, rows)).most_common(1)[0][0]
    wide = [len(row) == width and _is_row(row) for row in cells]
    # the first of two rows, as a line of numbers may be a title's
    first = next((k for k in range(len(wide) - 1) if wide[k] and wide[k + 1]), wide.index(True))
    head = cells[:first]
    # the last line with a name for each column, but for units
    fitting = [
        k
        for k, row in enumerate(head)
        if any(row)
        and width in (len(row), len(filled_cells(row)))
        and not any(is_number(cell.replace(",", ".")) for cell in row)
    ]
    named = max((k for k in fitting if not _are_units(head[k])), default=fitting[-1] if fitting else None)
    words = [row for row in head if not all(_number_like(cell) for cell in row)]
    line = words[-1:] if named is None else [head[named]]
    names, notes = names_of(line[0] if line else [], width)
    below = [] if named is None or named + 1 >= len(head) else head[named + 1]
    units = dict(zip(names, below, strict=False)) if _are_units(below) else {}
    twice = [] if named is None else [one for one in head[named] if one and head[named].count(one) > 1]
    return Head(
        layout=replace(layout, names=tuple(names), header_lines=first),
        rows=len(rows),
        above=None if named is None else named + 1 + bool(units),
        named=named is not None or any(head),
        twice=twice[0] if twice else "",
        notes=tuple(notes),
        units=units,
    )


def _likely_layout(lines: list[str]) -> TextLayout:
    """Return the separator and the decimal sign under which most lines are rows of two or more numbers."""
    looked_at = [line for line in lines if line.strip()][: 2 * _EXAMINED][-_EXAMINED:]
    point = [TextLayout(), *(TextLayout(separator=one) for one in ("semicolon", "tab", "blanks"))]

    def fit(layout: TextLayout) -> tuple[int, int, int]:
        rows = [_cells(line, layout) for line in looked_at]
        numbers = [sum(map(_number_like, row)) for row in rows]
        whole = sum(len(row) == count > 1 for row, count in zip(rows, numbers, strict=True))
        # the others decide where a column of words spoils every row
        return whole, sum(len(row) > 1 and _is_row(row) for row in rows), sum(numbers)

    return max([*point, *(replace(one, decimal="comma") for one in point)], key=fit)


def _cells(line: str, layout: TextLayout) -> list[str]:
    """Return the cells of a line, with decimal points in numbers that have decimal commas."""
    cells = split_cells(line, SEPARATORS[layout.separator]) if line.strip() else []
    if layout.decimal == "comma":
        pointed = [cell.replace(",", ".") for cell in cells]
        cells = [new if _number_like(new) else cell for new, cell in zip(pointed, cells, strict=True)]
    return cells


def _is_row(cells: list[str]) -> bool:
    """Return whether cells are a row of a table of numbers: more of them are numbers than words."""
    known = [cell for cell in cells if cell.lower() not in MISSING]
    return 2 * sum(map(_number_like, known)) > len(known)


def _number_like(cell: str) -> bool:
    return cell.lower() in MISSING or is_number(cell) or seconds_of(cell) is not None


def _are_units(row: list[str]) -> bool:
    """Return whether the cells of a row are units, with marks of none among them."""
    units = [cell for cell in row if cell not in ("", "-", "1")]
    return bool(units) and all(_is_unit(cell) for cell in units)


def _is_unit(cell: str) -> bool:
    if re.fullmatch(r"\[.*\]|\(.*\)|<.*>", cell):
        return True
    parts = [part for part in re.split(r"[\s·*/^²³⁻¹0-9-]+", cell.lower()) if part]
    return bool(parts) and all(part in _UNITS for part in parts)
