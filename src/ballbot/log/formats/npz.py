"""NumPy archives (.npz): an array for each column, as `numpy.savez` writes them; what is no real number is skipped."""

import io
import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ballbot.errors import InputError
from ballbot.files import write_bytes
from ballbot.log.columns import Columns, Floats

#: kinds of NumPy's types that are real numbers
_REAL = "biuf"


def read_npz(path: Path) -> Columns:
    """Return the arrays of an archive by name, each as one row of numbers (N,) in the order of its rows."""
    found: Columns = {}
    # zipfile compares checksums of what np.load would read on trust
    with zipfile.ZipFile(path) as archive:
        for name in archive.namelist():
            stream = io.BytesIO(archive.read(name))
            try:
                values = np.load(stream, allow_pickle=False)
            except ValueError as error:
                if "allow_pickle" not in str(error):
                    raise
                continue  # an array of objects
            if values.dtype.kind in _REAL:
                with np.errstate(over="ignore"):  # wider floats
                    found[name.removesuffix(".npy")] = values.astype(np.float64).ravel()
    if not found and archive.namelist():
        raise InputError(
            f"{path} has no array of real numbers, and arrays of objects are not read; save each column as an "
            "array of numbers: numpy.savez(file, t=t, theta=theta)."
        )
    return found


def write_npz(path: Path, columns: Mapping[str, Floats]) -> None:
    """Write columns (N,) to an archive, whole or not at all; the same columns give the same bytes."""
    stream = io.BytesIO()
    # not numpy.savez, whose own arguments' names no column could have
    with zipfile.ZipFile(stream, "w") as archive:
        for name, values in columns.items():
            array = io.BytesIO()
            np.lib.format.write_array(array, np.asarray(values), allow_pickle=False)
            archive.writestr(zipfile.ZipInfo(f"{name}.npy"), array.getvalue(), zipfile.ZIP_DEFLATED)
    write_bytes(path, stream.getvalue())
