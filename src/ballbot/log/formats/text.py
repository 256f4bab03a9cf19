"""Tables of numbers as text: CSV, and the separated files that other people's robots write.

A `TextLayout` describes how a table is laid out. A mapping states it, or it is inferred from the first lines of the
file (`read_head`): every row of a log without a mapping, and of the record of an axis, must then be whole; damaged rows
of a foreign table are skipped and counted. pandas reads the rows that have the table's width. A cell that it reads as
text is a date with a time, a missing value, a number with a blank behind it, or words.
"""

from __future__ import annotations

import csv
import io
import math
import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from pydantic import NonNegativeInt, PositiveInt

from ballbot.arrays import Floats, check_table
from ballbot.errors import InputError
from ballbot.files import LARGEST_TABLE, read_text, write_text
from ballbot.log.columns import KNOWN_NAMES, UNIT_OF, Columns, mark_missing, native_columns
from ballbot.log.formats.dialects import EXACT, seconds_of, unpadded_times, without_labels
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


@dataclass(frozen=True, kw_only=True, eq=False)
class ForeignTable:
    """The columns of a foreign file, and what its first lines show (`read_head`)."""

    columns: Columns = field(default_factory=dict)
    layout: TextLayout = TextLayout()
    rows: int = 0  #: of the first lines that consist of numbers
    named: bool = True  #: whether the file has a header
    #: lines down to the one with the names, or units; None if no line has a name for each column
    above: int | None = None
    notes: tuple[str, ...] = ()  #: sentences on anomalies of the file, such as missing or unusable names
    units: Mapping[str, str] = field(default_factory=dict)  #: by column, as a row below the names gives them

    @property
    def names(self) -> tuple[str, ...]:
        """The columns' names by the layout."""
        return self.layout.names or ()

    def need_names(self, source: object, example: str) -> None:
        """Raise InputError, with an example of what to give as --columns, if the file has no header."""
        if not self.named:
            raise InputError(
                f"{source} has no header: no line above its rows has a name for each of {len(self.columns)} columns. "
                f"Give them in their order, --columns {example} (_ for a column that is not needed)."
            )


#: cells without a value, in small letters
MISSING = frozenset({"", "na", "n/a", "none", "null", "-", "--"})
_TOO_LONG = f"a cell has more than {csv.field_size_limit()} characters."
OWN_LAYOUT = TextLayout()
#: beginnings of comments
_COMMENTS = ("%", "#", "//")
#: the beginning of a number that is no number
_BEGUN = re.compile(r"[+-]?(\d+\.?\d*)?([eE][+-]?)?", re.ASCII)
#: lines examined to find the separator, and characters of a file in which its layout must show
_EXAMINED, _HEAD = 200, 100_000
#: units, of which a row below the header consists: alone, in products, quotients and powers, or in brackets
_OTHER_UNITS = "n mn kn knm cm um µm km kg g w mw hz khz k c °c pa bar min h u inc"
_UNITS = {*UNIT_OF, *_OTHER_UNITS.split()}


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
    lines, _ = without_labels(_text_of(path).split("\n"))
    names = list(layout.names) if layout.names is not None else _header_names(path, lines, layout)
    check_table(len(lines), len(names), source=str(path))
    rows, cut, damaged = _whole_rows(path, lines, layout, len(names))
    frame = _frame(path, list(rows.values()), layout, len(names))
    table, words = np.empty(frame.shape), np.zeros(frame.shape, dtype=np.bool_)
    for i in range(len(names)):
        cells = frame[i]
        if cells.dtype.kind not in "iuf":
            cells = [_value(str(cell), layout) for cell in cells]
            words[:, i] = [cell is None for cell in cells]
        table[:, i] = np.array(cells, dtype=np.float64)  # None becomes NaN
        known = table[np.isfinite(table[:, i]), i]
        if (np.diff(known) < 0.0).any() and (np.diff(np.floor(known)) >= 0.0).all():
            mark = SEPARATORS[layout.separator]
            stamps = [split_cells(line, mark)[i].replace(",", ".") for line in rows.values()]
            if (times := unpadded_times(stamps)) is not None:
                table[:, i] = times
                notes.append(
                    f"{names[i]} has seconds and their fraction as two whole numbers, and is read so."
                )
    # of words, by what the table is used for, or by most cells with something in them
    most = 2 * words.sum(axis=0) > (words | ~np.isnan(table)).sum(axis=0)
    omitted = words.any(axis=0) & (most if used is None else ~np.isin(names, list(used)))
    if omitted.any():
        examples = (str(frame.iloc[int(np.argmax(words[:, i])), i])[:40] for i in np.flatnonzero(omitted))
        listed = (f"{names[i]} ({cell!r})" for i, cell in zip(np.flatnonzero(omitted), examples, strict=True))
        notes.append(f"Columns with words are left out: {', '.join(listed)}.")
    words[:, omitted] = False
    spoilt = words.any(axis=1)
    if spoilt.any():
        row, column = np.argwhere(words)[0]
        number, cell = list(rows)[row], str(frame.iloc[row, column])
        if words.sum() == 1 and words[-1, -1] and _BEGUN.fullmatch(cell):
            cut = number
        elif layout.damaged_rows == "refuse":
            raise InputError(
                f"{path}, line {number}: {cell[:40]!r} in column {names[column]} is not a number; correct it, or "
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
    first, last = layout.rows or (1, None)
    table = mark_missing(table[~spoilt][first - 1 : last])
    if not len(table):
        raise InputError(f"{path} has a header and no rows{' of those to take' if layout.rows else ''}.")
    return {names[i]: np.ascontiguousarray(table[:, i]) for i in np.flatnonzero(~omitted)}


def _text_of(path: str | Path) -> str:
    text = read_text(path, largest=LARGEST_TABLE)
    if not text.strip():
        raise InputError(f"{path} is empty; a log needs a line of column names and rows of numbers.")
    return text


def read_own_table(path: str | Path, notes: list[str] | None = None) -> Columns:
    """Read a table with Ballbot's names whose separator, decimal sign and header are inferred; every row must be whole.

    Columns of words are omitted if Ballbot does not know their names. `notes` gets a sentence for each omission. Raises
    InputError as `read_text_table` does.
    """
    head = read_head(path)
    if head.above is None:
        layout = replace(head.layout, names=None, header_lines=1)
    else:  # a row with a word is one, and no part of the header
        layout = replace(head.layout, header_lines=head.above)
        for problem in head.notes:
            if problem.endswith("appears twice."):
                raise InputError(f"{path}: {problem[0].lower()}{problem[1:]}")
    return read_text_table(path, layout, used={*KNOWN_NAMES, *native_columns(head.names)}, notes=notes)


def infer_text_table(path: str | Path, *, given_names: Sequence[str] | None = None) -> ForeignTable:
    """Read a table of text, whatever its layout; InputError if the file cannot be read or has no table of numbers."""
    head = read_head(path)
    if not head.rows:
        raise InputError(
            f"{path} contains no table: no lines consist of numbers, or of numbers with the same labels."
        )
    if head.rows == 1:
        line = head.layout.header_lines + 1
        raise InputError(f"{path} has one row of numbers (line {line}); a log needs at least two.")
    names, width = tuple(given_names or head.names), len(head.names)
    if len(names) != width:
        raise InputError(
            f"{path} has {width} columns, but {len(names)} names were given: {', '.join(names)}."
        )
    notes = [] if given_names else list(head.notes)
    layout = replace(head.layout, names=names, damaged_rows="drop")
    columns = read_text_table(path, layout, notes=notes)
    if not any(text.startswith("Skipped") for text in notes):
        layout = replace(layout, damaged_rows="refuse")
    named = bool(given_names) or head.named
    return replace(head, columns=columns, layout=layout, named=named, notes=tuple(notes))


def read_head(path: str | Path) -> ForeignTable:
    """Return what the first lines of a table show, without columns; InputError if it cannot be read or is empty."""
    text = _text_of(path)
    lines = text[:_HEAD].split("\n")
    lines = lines[:-1] if len(text) > _HEAD and len(lines) > 1 else lines  # the last is cut
    lines, labels = without_labels(lines)
    layout = _likely_layout(lines)
    mark = SEPARATORS[layout.separator]
    cells = [split_cells(line, mark) if line.strip() else [] for line in lines]
    rows = [row for row in cells if _is_row(row, layout)]
    if not rows:
        return ForeignTable(layout=replace(layout, names=tuple(cells[0])))
    width = max(map(len, rows))
    if mark and width > 1 and not any(row[-1] for row in rows if len(row) == width):
        # a separator at the end of lines
        cells = [row[:-1] if len(row) == width and row[-1] == "" else row for row in cells]
        rows = [row for row in cells if _is_row(row, layout)]
    width = Counter(map(len, rows)).most_common(1)[0][0]
    wide = [len(row) == width and _is_row(row, layout) for row in cells]
    # the first of two rows, as a line of numbers may be a title's
    first = next((k for k in range(len(wide) - 1) if wide[k] and wide[k + 1]), wide.index(True))
    # the last line, other than the units', with a name for each column; failing that, the last line with words that is
    # no comment
    head = [] if labels else cells[:first]
    fitting = [
        k
        for k, row in enumerate(head)
        if any(row)
        and width in (len(row), len(filled_cells(row)))
        and not any(is_number(cell.replace(",", ".")) for cell in row)
    ]
    named = max((k for k in fitting if not _are_units(head[k])), default=fitting[-1] if fitting else None)
    said = [row for row in head if any(row) and not row[0].startswith(_COMMENTS)]
    words = [[*labels], *(row for row in said if any(_value(cell, layout) is None for cell in row))]
    names, problems = names_of(words[-1] if named is None else _distinguished(head, named), width)
    below = [] if named is None or named + 1 >= first else head[named + 1]
    units = dict(zip(names, below, strict=False)) if _are_units(below) else {}
    above = first if labels else None if named is None else named + 1 + bool(units)
    return ForeignTable(
        layout=replace(layout, names=tuple(names), header_lines=first),
        rows=len(rows),
        # a greeting is no header
        named=named is not None or abs(len(words[-1]) - width) < 0.5 * width,
        above=above,
        notes=tuple(problems),
        units=units,
    )


def _distinguished(head: list[list[str]], named: int) -> list[str]:
    """Return the cells of a header's line, with what the lines above say of each if not all have names of their own."""
    row = head[named]
    above = [line for line in head[:named] if len(line) == len(row) and len({*line} - {""}) > 1]
    if len({*row} - {""}) == len(row):
        return row
    return [".".join(filter(None, cells)) for cells in zip(*above, row, strict=True)]


def _likely_layout(lines: list[str]) -> TextLayout:
    """Return the separator and the decimal sign under which most lines are rows of two or more numbers."""
    examined = [line for line in lines if line.strip()][: 2 * _EXAMINED][-_EXAMINED:]
    point = [TextLayout(), *(TextLayout(separator=mark) for mark in ("semicolon", "tab", "blanks"))]

    def fit(layout: TextLayout) -> tuple[int, int, int]:
        rows = [split_cells(line, SEPARATORS[layout.separator]) for line in examined]
        numbers = [sum(_value(cell, layout) is not None for cell in row) for row in rows]
        whole = sum(len(row) == count > 1 for row, count in zip(rows, numbers, strict=True))
        # the others decide where a column of words spoils every row
        return whole, sum(len(row) > 1 and _is_row(row, layout) for row in rows), sum(numbers)

    return max([*point, *(replace(layout, decimal="comma") for layout in point)], key=fit)


def _is_row(cells: list[str], layout: TextLayout) -> bool:
    """Return whether cells are a row of a table of numbers: more of them are numbers than words."""
    known = [_value(cell, layout) for cell in cells if cell.lower() not in MISSING]
    return 2 * known.count(None) < len(known)


def _are_units(row: list[str]) -> bool:
    """Return whether the cells of a row are units, some of them marks for no unit."""
    units = [cell for cell in row if cell not in ("", "-", "1")]
    return bool(units) and all(map(_is_unit, units))


def _is_unit(cell: str) -> bool:
    if re.fullmatch(r"\[.*\]|\(.*\)|<.*>", cell):
        return True
    parts = [part for part in re.split(r"[\s·*/^²³⁻¹0-9-]+", cell.lower()) if part]
    return bool(parts) and _UNITS.issuperset(parts)


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
        return [f"column_{number}" for number in range(1, width + 1)], [problem]
    given, filled = [cell.lstrip("#%").strip() for cell in cells], filled_cells(cells)
    if len(given) != width and (len(filled) == width or (cells[0] and not given[0])):
        # blanks or tabs that align the names, or a mark of a comment before them
        given = filled if len(filled) == width else given[1:]
    usable = [bool(name) and name.isprintable() for name in given[:width]]
    unnamed = [str(number) for number, is_usable in enumerate(usable, start=1) if not is_usable]
    problems = []
    if unnamed:
        problems.append(f"The header has no name for column{'s' * (len(unnamed) > 1)} {', '.join(unnamed)}.")
    if len(given) != width:
        problems.append(f"The header names {len(given)} columns and the rows have {width}.")
    names: list[str] = []
    for number, name in enumerate([*given, *[""] * width][:width], start=1):
        known = name if name and name.isprintable() else f"column_{number}"
        if known in names:
            problems.append(f"The column name {known} appears twice.")
        names.append(f"{known}_{number}" if known in names else known)
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
            float_precision=EXACT,
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
