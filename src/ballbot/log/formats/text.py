"""Tables of numbers as text: CSV, the separated files that other people's robots write, and tables of unknown layout.

A well-formed file is read by NumPy's compiled parser. If that fails, the rows are read one at a time, which allows
missing values and gives messages the line. `infer_text_table` infers separator, header, widths and damaged rows.

Ballbot's own CSV has commas between its cells and a decimal point, or semicolons and a decimal comma, as spreadsheets
write it in many countries. The header shows which: it has the column t.
"""

from __future__ import annotations

import io
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import check_table
from ballbot.errors import InputError
from ballbot.files import check_regular, decode_text, read_bytes, read_text, write_text
from ballbot.log.columns import check_column_names, mark_missing


@dataclass(frozen=True, kw_only=True)
class TextLayout:
    """How a text file lays out its table. The defaults are Ballbot's own CSV."""

    separator: str | None = ","  #: between cells; None is any run of blanks
    decimal_comma: bool = False  #: whether 0,5 is a half; the separator is then no comma
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
    return _cells(header, _own_layout(header).separator) if header.strip() else []


def own_layout(path: str | Path) -> TextLayout:
    """Return the layout of a table in Ballbot's own CSV, by its header; InputError as `read_text_header`."""
    return _own_layout(_header(path))


def _header(path: str | Path) -> str:
    check_regular(path)
    try:
        with open(path, "rb") as stream:
            start = stream.readline(_LONGEST_HEADER)
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}.") from None
    return decode_text(start, source=str(path), errors="replace")


def _own_layout(header: str) -> TextLayout:
    return next((one for one in _OWN_LAYOUTS if "t" in _cells(header, one.separator)), OWN_LAYOUT)


def read_text_table(path: str | Path, layout: TextLayout = OWN_LAYOUT) -> dict[str, NDArray[np.float64]]:
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
        The columns by name, in the file's order; a cell without a value, or with one beyond `LARGEST_CELL`, is NaN.

    Raises
    ------
    InputError
        If the file cannot be read or is not such a table; the message names the line.
    """
    lines = _read_lines(path)
    names = _names(path, lines, layout)
    check_table(len(lines), len(names), source=str(path))
    body = _with_points(path, lines[layout.header_lines :], layout)
    table = _parse_fast(body, names, layout)
    if table is None:
        table = _parse_by_line(path, body, names, layout)
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


def _with_points(path: str | Path, lines: list[str], layout: TextLayout) -> list[str]:
    """Return lines with decimal points; of a layout with decimal commas that its header shows, all or none may be."""
    if not layout.decimal_comma:
        return lines
    commas = next((k for k, line in enumerate(lines) if "," in line), None)
    if commas is not None and layout in _OWN_LAYOUTS:
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
    return "_" not in cell  # Python's float accepts 1_000, which is no number in a table


def _word(separator: str | None) -> str:
    return {",": "commas", ";": "semicolons", "\t": "tabs", None: "blanks"}.get(separator, repr(separator))


_SEPARATORS: dict[str, str | None] = {"comma": ",", "semicolon": ";", "tab": "\t", "blanks": None}
#: lines examined to find the separator and the header
_EXAMINED = 200
#: largest file of unknown layout [bytes], because every cell is examined
_LARGEST = 100_000_000
_NOT_A_NUMBER = frozenset({"", "na", "n/a", "none", "null", "-", "--"})


@dataclass(frozen=True, kw_only=True, eq=False)
class ForeignTable:
    """The columns of a foreign file, and the layout that was inferred."""

    layout: TextLayout
    separator: str  #: its name in a mapping file
    columns: dict[str, NDArray[np.float64]]
    named: bool  #: whether the file has a header
    notes: tuple[str, ...]  #: sentences on anomalies of the file


def infer_text_table(path: str | Path, *, given_names: Sequence[str] | None = None) -> ForeignTable:
    """Read a table of text, whatever its layout.

    Raises
    ------
    InputError
        If the file cannot be read or has no table of numbers.
    """
    lines = _foreign_lines(path)
    separator, decimal_comma = _likely_separator(lines)
    mark = _SEPARATORS[separator]
    if decimal_comma:
        # the header's commas stay: its names are no numbers
        pointed = [line.replace(",", ".") for line in lines]
        lines = [
            p if all(_number_like(cell) for cell in _ragged_cells(p, mark)) else line
            for p, line in zip(pointed, lines, strict=True)
        ]
    cells = [_ragged_cells(line, mark) for line in lines]
    numeric = [bool(row) and all(_number_like(cell) for cell in row) for row in cells]
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
    guessed = _guessed_names(cells[:first], width, quoted=quoted) if given_names is None else None
    names, notes = guessed or (list(given_names or ()), [])
    if len(names) != width:
        raise InputError(
            f"{path} has {width} columns, but {len(names)} names were given: {', '.join(names)}."
        )
    marks = sorted({cell for row in cells for cell in row if cell.lower() in _NOT_A_NUMBER and cell})
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
        decimal_comma=decimal_comma,
        missing=tuple(marks),
        header_lines=first,
        names=tuple(names),
        drop_damaged=damaged > 0,
    )
    return ForeignTable(
        layout=layout,
        separator=separator,
        columns=read_text_table(path, layout),
        named=given_names is not None or any(cells[:first]),
        notes=tuple(notes),
    )


def _foreign_lines(path: str | Path) -> list[str]:
    text = decode_text(read_bytes(path, largest=_LARGEST), source=str(path), errors="replace")
    if not text.strip():
        raise InputError(f"{path} is empty; a log needs rows of numbers.")
    return text.split("\n")


def _likely_separator(lines: list[str]) -> tuple[str, bool]:
    """Return the separator under which most lines are rows of two or more numbers, and whether decimals have commas."""
    looked_at = [line for line in lines if line.strip()][: 2 * _EXAMINED][-_EXAMINED:]

    def rows(mark: str | None, decimal_comma: bool) -> int:
        pointed = [line.replace(",", ".") for line in looked_at] if decimal_comma else looked_at
        found = [_ragged_cells(line, mark) for line in pointed]
        return sum(len(row) > 1 and all(_number_like(cell) for cell in row) for row in found)

    choices = [(word, False) for word in _SEPARATORS]
    choices += [(word, True) for word in _SEPARATORS if word != "comma"]
    return max(choices, key=lambda choice: rows(_SEPARATORS[choice[0]], choice[1]))


def _ragged_cells(line: str, mark: str | None) -> list[str]:
    if not line.strip():
        return []
    # a tab that separates is no blank: a line may begin with an empty cell
    cells = [cell.strip().strip('"').strip() for cell in line.strip("" if mark == "\t" else None).split(mark)]
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
    given = [cell.lstrip("#%").strip() for cell in named[-1]]
    filled = [cell for cell in given if cell]
    if len(given) != width and (len(filled) == width or (named[-1][0] and not given[0])):
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
