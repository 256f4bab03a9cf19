"""Logs to pandas' tables and back: `Log.to_pandas` and `Log.from_pandas`.

A frame's index is the time t [s], uneven as it was logged, and `frame.attrs["units"]` has each column's unit, as
"rad/s".
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from ballbot.errors import InputError
from ballbot.log.columns import Columns, Floats, unit_of

if TYPE_CHECKING:
    from pandas import DataFrame, Index, Series


def frame_of(columns: Mapping[str, Floats]) -> DataFrame:
    """Return a log's columns, t among them, as a DataFrame; see `Log.to_pandas`."""
    import pandas

    rest = {name: values for name, values in columns.items() if name != "t"}
    frame = pandas.DataFrame(rest, index=pandas.Index(columns["t"], name="t"), copy=True)
    frame.attrs["units"] = {name: unit for name in columns if (unit := unit_of(name)) is not None}
    return frame


def columns_of(frame: DataFrame) -> Columns:
    """Return a frame's columns as float64, its index among them if it is named or counts time."""
    import pandas

    if not isinstance(frame, pandas.DataFrame):
        kind = type(frame).__name__
        raise InputError(f"A log is made of a pandas DataFrame; an object of type {kind} is given.")
    index, names = frame.index, frame.columns.tolist()
    if len(set(names)) < len(names) or not all(isinstance(name, str) for name in names):
        raise InputError("The frame's columns must have a name each, a text that no other has.")
    key = "t" if index.dtype.kind in "mM" and "t" not in names else index.name
    before = [(key, index)] if isinstance(key, str) and key not in names else []
    return {str(name): _numbers(str(name), values) for name, values in [*before, *frame.items()]}


def _numbers(name: str, values: Series | Index) -> Floats:
    """Return values as numbers, dates and durations as seconds; dates count from the first row."""
    import pandas

    kind = values.dtype.kind
    if kind in "mM":
        moments = pandas.Index(values)
        durations = pandas.TimedeltaIndex(moments if kind == "m" else moments - moments[0])
        return durations.total_seconds().to_numpy(dtype=np.float64)
    if kind not in "fiub":
        raise InputError(
            f"The frame's column {name!r} does not contain numbers (its type is {values.dtype}). Convert it, or leave "
            f"it out: frame.drop(columns={name!r})."
        )
    return values.to_numpy(dtype=np.float64, na_value=np.nan)
