"""Tables of numbers as Parquet, read and written by pyarrow."""

import io
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ballbot.arrays import Floats, check_table
from ballbot.errors import InputError
from ballbot.files import write_bytes
from ballbot.log.columns import Columns, unit_of


def read_parquet_table(path: Path) -> Columns:
    """Read the columns (N,) of a Parquet file; a null is NaN. InputError if a column is not one of numbers."""
    from pyarrow import parquet, types

    file = parquet.ParquetFile(path)
    names = file.schema_arrow.names
    check_table(file.metadata.num_rows, len(names), source=str(path))  # before the rows are unpacked
    for field in file.schema_arrow:
        if not (types.is_floating(field.type) or types.is_integer(field.type)):
            raise InputError(
                f"{path}: the column {field.name} contains {field.type}; it must contain numbers."
            )
    table = file.read()
    return {name: table.column(name).to_numpy(zero_copy_only=False).astype(np.float64) for name in names}


def write_parquet_table(path: Path, columns: Mapping[str, Floats]) -> None:
    """Write columns (N,) to a Parquet file, whole or not at all; the metadata of Ballbot's columns have their unit."""
    import pyarrow
    from pyarrow import parquet

    stream = io.BytesIO()
    units = {name: {"unit": unit} if (unit := unit_of(name)) else None for name in columns}
    fields = [pyarrow.field(name, pyarrow.float64(), metadata=unit) for name, unit in units.items()]
    parquet.write_table(pyarrow.table(dict(columns), schema=pyarrow.schema(fields)), stream)
    write_bytes(path, stream.getvalue())
