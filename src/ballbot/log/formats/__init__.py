"""File formats by suffix: which reader and which writer a path gets."""

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.files import decode_text
from ballbot.log.columns import KNOWN_NAMES
from ballbot.log.formats.parquet import read_parquet_table, write_parquet_table
from ballbot.log.formats.text import TextLayout, read_text_table, write_text_table

_TEXT_SUFFIXES = (".csv", ".txt", ".tsv", ".dat", ".log")
#: bytes of a header that are looked at
_LONGEST_HEADER = 100_000


def is_foreign(path: str | Path) -> bool:
    """Return whether a file can be read and is no log with Ballbot's own column names: t, and another of them.

    A file that Ballbot's own reader refuses, but whose header has these names, is a damaged log and not foreign.
    """
    path = Path(path)
    if not path.is_file():
        return False
    if path.suffix.lower() == ".parquet":
        return not _own(read_parquet_table(path))
    try:
        with path.open("rb") as stream:
            start = stream.readline(_LONGEST_HEADER)
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}.") from None
    header = decode_text(start, source=str(path), errors="replace")
    return bool(header.strip()) and not _own(cell.strip().strip('"') for cell in header.split(","))


def _own(names: Iterable[str]) -> bool:
    present = set(names)
    return "t" in present and len(present & set(KNOWN_NAMES)) > 1


def read_columns(path: str | Path, layout: TextLayout | None = None) -> dict[str, NDArray[np.float64]]:
    """Read a file's columns (N,) by name.

    Parameters
    ----------
    path : str or Path
        A Parquet file (.parquet) or a table of text (.csv, .txt, .tsv, .dat, .log).
    layout : TextLayout, optional
        How a table of text is laid out; Ballbot's own CSV where it is not given.

    Raises
    ------
    InputError
        Where the suffix is none of these or the file is not such a table.
    """
    suffix = Path(path).suffix.lower()
    if suffix == ".parquet":
        return read_parquet_table(path)
    if suffix in _TEXT_SUFFIXES:
        return read_text_table(path, layout or TextLayout())
    if not Path(path).exists():
        raise InputError(f"{path} cannot be read: No such file or directory.")
    raise InputError(
        f"{path} is not a log that Ballbot reads; give a file that ends in .csv, .parquet or .txt."
    )


def write_columns(path: str | Path, columns: Mapping[str, NDArray[np.float64]]) -> None:
    """Write columns (N,) as CSV or Parquet, by the suffix of `path`.

    Raises
    ------
    InputError
        Where the suffix is another, or the file cannot be written.
    """
    suffix = Path(path).suffix.lower()
    if suffix == ".csv":
        write_text_table(path, columns)
    elif suffix == ".parquet":
        write_parquet_table(path, columns)
    else:
        raise InputError(f"{path} cannot be written: the name of a log file must end in .csv or .parquet.")
