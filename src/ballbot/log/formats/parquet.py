"""Tables of numbers as Parquet, read and written by pyarrow."""

import io
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import check_table, format_bytes
from ballbot.errors import InputError
from ballbot.files import LARGEST_TABLE, read_bytes, write_bytes
from ballbot.log.columns import Columns, unit_of


def read_parquet_table(path: str | Path) -> Columns:
    """Read the columns (N,) of a Parquet file; a null is NaN.

    Raises
    ------
    InputError
        If the file cannot be read, or a column is not one of numbers.
    """
    import pyarrow
    from pyarrow import parquet

    content = read_bytes(path)
    try:
        file = parquet.ParquetFile(io.BytesIO(content))
        _check_size(path, file.metadata, file.schema_arrow)
        table = pyarrow.Table.from_batches(_batches(path, file), schema=file.schema_arrow)
    except (OSError, ValueError, pyarrow.ArrowException, MemoryError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path} cannot be read: it is not a complete Parquet file.") from None
    if not len(table):
        raise InputError(f"{path} is empty; a log needs columns and rows of numbers.")
    return {name: _numbers(table.column(name)) for name in table.column_names}


def _batches(path: str | Path, file) -> Iterator:  # of pyarrow's RecordBatch, from a ParquetFile
    """Yield the rows of a file; refuse it if they are more than its metadata states."""
    left = LARGEST_TABLE
    for batch in file.iter_batches():
        left -= batch.nbytes
        if left < 0:
            raise InputError(
                f"{path} unpacks to more than it states, {format_bytes(LARGEST_TABLE)}; it is damaged."
            )
        yield batch


def _check_size(path: str | Path, metadata, schema) -> None:  # pyarrow's FileMetaData and Schema
    """Refuse a file by its metadata, before its columns are read."""
    import pyarrow

    names = schema.names
    if len(set(names)) < len(names):
        raise InputError(f"{path} has two columns of the same name.")
    if not names or not metadata.num_rows:
        raise InputError(f"{path} is empty; a log needs columns and rows of numbers.")
    check_table(metadata.num_rows, len(names), source=str(path))
    for field in schema:
        if not (pyarrow.types.is_floating(field.type) or pyarrow.types.is_integer(field.type)):
            raise InputError(
                f"{path}: the column {field.name} contains {field.type}; it must contain numbers."
            )
    # not by columns, whose damaged statistics would end the interpreter
    unpacked = sum(metadata.row_group(k).total_byte_size for k in range(metadata.num_row_groups))
    if unpacked > LARGEST_TABLE:
        raise InputError(
            f"{path} unpacks to {format_bytes(unpacked)}; at most {format_bytes(LARGEST_TABLE)} are read."
        )


def write_parquet_table(path: str | Path, columns: Mapping[str, NDArray[np.float64]]) -> None:
    """Write columns (N,) to a Parquet file, whole or not at all; the metadata of Ballbot's columns have their unit.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    import pyarrow
    from pyarrow import parquet

    stream = io.BytesIO()
    fields = [
        pyarrow.field(name, pyarrow.float64(), metadata={"unit": unit} if (unit := unit_of(name)) else None)
        for name in columns
    ]
    parquet.write_table(pyarrow.table(dict(columns), schema=pyarrow.schema(fields)), stream)
    write_bytes(path, stream.getvalue())


def _numbers(column) -> NDArray[np.float64]:  # column: pyarrow.ChunkedArray
    return column.to_numpy(zero_copy_only=False).astype(np.float64)
