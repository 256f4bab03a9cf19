"""MATLAB files of version 4 to 7: their real numeric variables, read by SciPy; everything else is skipped.

The fields of a structure are variables, too: `log.roll` is roll if no other structure of the file has series, else
log.roll. A long matrix, such as the angles of three wheels or a whole log, is also split into its columns: `wheel` of
N rows and three columns is wheel_1, wheel_2, wheel_3.
"""

import io
import re
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from ballbot.arrays import Floats
from ballbot.errors import InputError
from ballbot.files import write_bytes
from ballbot.log.columns import Columns

#: a matrix has a log's columns if it has so many rows, and so many times more than columns
_LONG, _LONGER = 50, 5
#: what MATLAB takes as the name of a variable
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,62}")


def read_mat(path: Path) -> Columns:
    """Return the variables of a file, each as one row of numbers by its rows, and the columns of long matrices."""
    from scipy.io import loadmat  # scipy.io takes longer to import than a file to read

    try:
        content = loadmat(path, simplify_cells=True)
    except NotImplementedError:
        raise InputError(
            f"{path} is a MATLAB file of version 7.3; save it with -v7, which Ballbot reads."
        ) from None
    vectors: Columns = {}
    parts: Columns = {}
    for name, values in _short_names(dict(_variables(content))).items():
        vectors[name] = values.ravel()
        for index, numbers in enumerate(_columns_of(values), start=1):
            parts.setdefault(f"{name}_{index}", numbers)
    return parts | vectors


def write_mat(path: Path, columns: Mapping[str, Floats]) -> None:
    """Write columns (N,) as compressed column vectors; InputError if MATLAB has no variable of such a name."""
    from scipy.io import savemat

    for name in columns:
        if not _NAME.fullmatch(name):
            raise InputError(
                f"The column name {name!r} cannot be written to a MATLAB file; use up to 63 letters, digits and "
                "underscores, a letter first."
            )
    stream = io.BytesIO()
    vectors = {name: np.asarray(values)[:, None] for name, values in columns.items()}
    savemat(stream, vectors, do_compression=True, long_field_names=True)
    write_bytes(path, stream.getvalue())


def _variables(content: Mapping[str, object], before: str = "") -> Iterator[tuple[str, Floats]]:
    """Yield the real numeric arrays of a file, those of structures by the names of both."""
    for name, value in content.items():
        if isinstance(value, Mapping):
            yield from _variables(value, f"{before}{name}.")
        elif np.asarray(value).dtype.kind in "biuf" and not name.startswith("__"):
            yield f"{before}{name}", np.asarray(value, dtype=np.float64)


def _short_names(variables: Columns) -> Columns:
    """Return variables with the fields of the file's only structure by their own names, if these are no others'.

    Structures of single numbers, such as a robot's parameters beside its log, do not count if one has series.
    """
    structures = {name.partition(".")[0] for name in variables if "." in name}
    series = {name.partition(".")[0] for name, values in variables.items() if "." in name and values.size > 1}
    chosen = series if len(series) == 1 else structures
    if len(chosen) != 1:
        return variables
    (structure,) = chosen
    short = {name.removeprefix(f"{structure}."): values for name, values in variables.items()}
    return short if len(short) == len(variables) else variables


def _columns_of(values: Floats) -> list[Floats]:
    """Return the columns of a long matrix, or its rows if these are long; none of other arrays."""
    if values.ndim != 2 or min(values.shape) < 2:
        return []
    tall = values if values.shape[0] > values.shape[1] else values.T
    rows, columns = tall.shape
    return list(tall.T) if rows >= max(_LONG, _LONGER * columns) else []
