"""Tables of numbers as Parquet; needs pyarrow (the extra `formats`)."""

import io
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.files import write_bytes

_NO_PYARROW = "Parquet files need pyarrow: pip install 'ballbot[formats]', or use CSV."


def read_parquet_table(path: str | Path) -> dict[str, NDArray[np.float64]]:
    """Read the columns (N,) of a Parquet file; a null is NaN.

    Raises
    ------
    InputError
        Where pyarrow is missing, the file cannot be read, or a column is not one of numbers.
    """
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        raise InputError(_NO_PYARROW) from None
    try:
        content = Path(path).read_bytes()
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}.") from None
    try:
        table = parquet.ParquetFile(io.BytesIO(content)).read()
    except (OSError, pyarrow.ArrowException):
        raise InputError(f"{path} cannot be read: it is not a whole Parquet file.") from None
    names = table.column_names
    if len(set(names)) < len(names):
        raise InputError(f"{path} has two columns of the same name.")
    if not names or not len(table):
        raise InputError(f"{path} is empty; a log needs columns and rows of numbers.")
    return {name: _numbers(path, name, table.column(name)) for name in names}


def write_parquet_table(path: str | Path, columns: Mapping[str, NDArray[np.float64]]) -> None:
    """Write columns (N,) to a Parquet file, whole or not at all.

    Raises
    ------
    InputError
        Where pyarrow is missing or the file cannot be written.
    """
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        raise InputError(_NO_PYARROW) from None
    stream = io.BytesIO()
    parquet.write_table(pyarrow.table(dict(columns)), stream)
    write_bytes(path, stream.getvalue())


def _numbers(path: str | Path, name: str, column) -> NDArray[np.float64]:  # column: pyarrow.ChunkedArray
    import pyarrow

    kind = column.type
    if not (pyarrow.types.is_floating(kind) or pyarrow.types.is_integer(kind)):
        raise InputError(f"{path}: the column {name} holds {kind}, where numbers belong.")
    return column.to_numpy(zero_copy_only=False).astype(np.float64)
