"""NumPy archives (.npz): an array for each column, as `numpy.savez` writes them.

Arrays without real numbers are skipped. NumPy's own reader trusts the sizes in an array's header. This one compares
them with the content first, and reads no more than `ballbot.files` allows, packed or unpacked. Objects (pickles) are
never loaded.
"""

from __future__ import annotations

import io
import math
import tokenize
import warnings
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import format_bytes
from ballbot.errors import InputError
from ballbot.files import LARGEST_TABLE, read_bytes, write_bytes
from ballbot.log.columns import Columns

_SUFFIX = ".npy"
#: kinds of NumPy's types that are real numbers
_REAL = "biuf"
#: what zipfile and NumPy raise on damaged content
_DAMAGED = (
    zipfile.BadZipFile, zlib.error, tokenize.TokenError, EOFError, LookupError, MemoryError, NotImplementedError,
    OSError, OverflowError, RuntimeError, SyntaxError, TypeError, ValueError,
)  # fmt: skip


def read_npz(path: str | Path) -> Columns:
    """Return the arrays of an archive by name, each as one row of numbers (N,) in the order of its rows.

    Raises
    ------
    InputError
        If the file cannot be read, is damaged or too large.
    """
    content = read_bytes(path)
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            _check_archive(path, archive)
            found = dict(_arrays(archive))
            if not found and any(one.endswith(_SUFFIX) for one in archive.namelist()):
                raise InputError(
                    f"{path} has no array of real numbers, and arrays of objects are not read; save each column as an "
                    "array of numbers: numpy.savez(file, t=t, theta=theta)."
                )
            return found
    except InputError:
        raise
    except _DAMAGED:
        raise InputError(f"{path} cannot be read: it is not a complete NumPy archive (.npz).") from None


def write_npz(path: str | Path, columns: Mapping[str, NDArray[np.float64]]) -> None:
    """Write columns (N,) to an archive, whole or not at all; the same columns give the same bytes.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    stream = io.BytesIO()
    # not numpy.savez, whose own arguments' names no column could have
    with zipfile.ZipFile(stream, "w") as archive:
        for name, values in columns.items():
            array = io.BytesIO()
            np.lib.format.write_array(array, np.asarray(values), allow_pickle=False)
            archive.writestr(zipfile.ZipInfo(name + _SUFFIX), array.getvalue(), zipfile.ZIP_DEFLATED)
    write_bytes(path, stream.getvalue())


def _check_archive(path: str | Path, archive: zipfile.ZipFile) -> None:
    """Refuse an archive by its table of contents, before its arrays are unpacked."""
    names = archive.namelist()
    if len(set(names)) < len(names):
        raise InputError(f"{path} has two columns of the same name.")
    unpacked = sum(one.file_size for one in archive.infolist())
    if unpacked > LARGEST_TABLE:
        raise InputError(
            f"{path} unpacks to {format_bytes(unpacked)}; at most {format_bytes(LARGEST_TABLE)} are read."
        )


def _arrays(archive: zipfile.ZipFile) -> Iterator[tuple[str, NDArray[np.float64]]]:
    """Yield the name and the numbers of each array of real numbers."""
    for one in archive.infolist():
        if not one.filename.endswith(_SUFFIX):
            continue
        stream = io.BytesIO(archive.read(one))
        old = np.lib.format.read_magic(stream) == (1, 0)
        read_header = np.lib.format.read_array_header_1_0 if old else np.lib.format.read_array_header_2_0
        with warnings.catch_warnings(action="ignore"):  # of Python 2's files
            shape, by_columns, stored = read_header(stream)
        if stored.kind not in _REAL:
            continue
        numbers = stream.getbuffer()[stream.tell() :]
        if min(shape, default=0) < 0 or math.prod(shape) * stored.itemsize != len(numbers):
            raise ValueError(f"{one.filename} has {len(numbers)} bytes for the shape {shape[:4]}")
        with np.errstate(over="ignore", invalid="ignore"):  # wider floats, signalling NaN
            values = np.frombuffer(numbers, stored).astype(np.float64)
        values = values.reshape(shape, order="F" if by_columns else "C").ravel()
        yield one.filename.removesuffix(_SUFFIX), values
