"""File formats of logs: each is one file here and one line in `FORMATS`, and every command reads and writes through it.

text      tables of text: Ballbot's own CSV, and others by a `TextLayout`
parquet   Parquet, by pyarrow
mat       MATLAB files of version 4 to 7, their numeric variables
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError, nearest, suggest
from ballbot.log.columns import KNOWN_NAMES
from ballbot.log.formats.mat import read_mat
from ballbot.log.formats.parquet import read_parquet_table, write_parquet_table
from ballbot.log.formats.text import (
    OWN_LAYOUT,
    ForeignTable,
    TextLayout,
    infer_text_table,
    read_text_header,
    read_text_table,
    write_text_table,
)

#: columns (N,) of a file by name
Columns = dict[str, NDArray[np.float64]]


@dataclass(frozen=True, kw_only=True)
class LogFormat:
    """How files of one kind are read and written."""

    name: str  #: in messages
    suffixes: tuple[str, ...]  #: of the names of its files; written files end in the first
    read: Callable[[Path], Columns]
    write: Callable[[Path, Mapping[str, NDArray[np.float64]]], None] | None = None  #: None: only read
    extra: str = ""  #: the extra of `pip install ballbot[...]` that it needs
    is_text: bool = False  #: whether a mapping file may give its layout

    @property
    def ending(self) -> str:
        """The ending of written files without its dot, as `--format` names it."""
        return self.suffixes[0].removeprefix(".")


#: every format; adding one takes a file beside this one and a line here
FORMATS: tuple[LogFormat, ...] = (
    LogFormat(
        name="CSV",
        suffixes=(".csv", ".txt", ".tsv", ".dat", ".log"),
        read=read_text_table,
        write=write_text_table,
        is_text=True,
    ),
    LogFormat(
        name="Parquet",
        suffixes=(".parquet",),
        read=read_parquet_table,
        write=write_parquet_table,
        extra="formats",
    ),
    LogFormat(name="MATLAB", suffixes=(".mat",), read=read_mat),
)
#: endings of the files that are written, the default first
WRITTEN_ENDINGS = tuple(one.ending for one in FORMATS if one.write)


def is_log_file(path: str | Path) -> bool:
    """Return whether a file's name ends as that of a log."""
    return Path(path).suffix.lower() in _suffixes()


def is_foreign(path: str | Path) -> bool:
    """Return whether a file can be read and is no log with Ballbot's own column names: t, and another of them.

    A file that Ballbot's own reader refuses, but whose header has these names, is a damaged log and not foreign.
    """
    path = Path(path)
    if not path.is_file():
        return False
    one = _format_of(path)
    if one is None or one.is_text:
        header = read_text_header(path)
        return bool(header) and not _own(header)
    return not _own(_read(one, path))


def read_columns(path: str | Path, layout: TextLayout | None = None) -> Columns:
    """Read a log's columns (N,) by name.

    Parameters
    ----------
    path : str or Path
        A file of one of the `FORMATS`.
    layout : TextLayout, optional
        How a table of text is laid out; Ballbot's own CSV if it is not given.

    Returns
    -------
    dict of str to (N,) array
        Equally long: of a file's variables those as long as t, or as most others if there is no t.

    Raises
    ------
    InputError
        If the suffix is none of these, a package that reads the format is missing, or the file is not such a table.
    """
    one = _known_format(path)
    if one.is_text:
        return read_text_table(path, layout or OWN_LAYOUT)
    return _equally_long(_read(one, Path(path)))


def read_variables(path: str | Path) -> Columns:
    """Read all variables of a file by name, of any length; InputError as for `read_columns`."""
    return _read(_known_format(path), Path(path))


def read_foreign_table(path: str | Path) -> ForeignTable:
    """Read a table of any format, and of text in any layout.

    Raises
    ------
    InputError
        If the file cannot be read or has no table of numbers.
    """
    one = _format_of(path)
    if one is None or one.is_text:
        return infer_text_table(path)
    columns = _equally_long(_read(one, Path(path)))
    return ForeignTable(layout=OWN_LAYOUT, separator="comma", columns=columns, named=True, notes=())


def write_columns(path: str | Path, columns: Mapping[str, NDArray[np.float64]]) -> None:
    """Write columns (N,) in the format of the suffix of `path`.

    Raises
    ------
    InputError
        If the suffix is not that of a format which is written, or the file cannot be written.
    """
    for one in FORMATS:
        if one.write and Path(path).suffix.lower() == one.suffixes[0]:
            with _needing(one):
                one.write(Path(path), columns)
            return
    endings = " or ".join(f".{ending}" for ending in WRITTEN_ENDINGS)
    raise InputError(f"{path} cannot be written: the name of a log file must end in {endings}.")


def check_ending(ending: str) -> str:
    """Return the ending of a format that is written, as `--format` names it; InputError if there is none."""
    if ending not in WRITTEN_ENDINGS:
        hint = suggest(ending, WRITTEN_ENDINGS, otherwise="the formats are")
        raise InputError(f"Logs are not written in the format {ending!r}; {hint}")
    return ending


def _suffixes() -> list[str]:
    return [suffix for one in FORMATS for suffix in one.suffixes]


def _format_of(path: str | Path) -> LogFormat | None:
    suffix = Path(path).suffix.lower()
    return next((one for one in FORMATS if suffix in one.suffixes), None)


def _known_format(path: str | Path) -> LogFormat:
    one = _format_of(path)
    if one is not None:
        return one
    if not Path(path).exists():
        raise InputError(f"{path} cannot be read: No such file or directory.")
    near = nearest(Path(path).suffix.lower(), _suffixes())
    hint = f"did you mean {near[0]}? Its name must end" if near else "give a file that ends"
    *others, last = _suffixes()
    raise InputError(f"{path} is not a log that Ballbot reads; {hint} in {', '.join(others)} or {last}.")


def _read(one: LogFormat, path: Path) -> Columns:
    with _needing(one):
        return one.read(path)


@contextmanager
def _needing(one: LogFormat) -> Iterator[None]:
    """Raise InputError if a package is missing that the format needs."""
    try:
        yield
    except ModuleNotFoundError as error:
        raise InputError(
            f"{one.name} files need {error.name}: pip install 'ballbot[{one.extra}]'. Or use CSV."
        ) from None


def _equally_long(variables: Columns) -> Columns:
    """Return the variables of the log's table; the file may also have constants."""
    if not variables:
        return variables
    counts = Counter(len(values) for values in variables.values())
    length = len(variables["t"]) if "t" in variables else max(counts, key=lambda n: (counts[n], n))
    return {name: values for name, values in variables.items() if len(values) == length}


def _own(names: Iterable[str]) -> bool:
    present = set(names)
    return "t" in present and len(present & set(KNOWN_NAMES)) > 1
