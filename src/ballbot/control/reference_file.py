"""References as files: a table of where the robot is asked to be, for any run that takes a reference by name.

    t,ref_x,ref_y,ref_psi        [s, m, m, rad]

as a log has them, so that a log's own reference can be followed again. A row holds until the next one; the last one
holds from there on.
"""

from __future__ import annotations

from bisect import bisect_right
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot.control.references import Reference, named
from ballbot.errors import InputError
from ballbot.log import Log

#: the columns, and the states that they ask for
_COLUMNS, _STATES = ("ref_x", "ref_y", "ref_psi"), [0, 1, 4]
#: what rounding may put a time before the row that it means, in shares of the first interval
_ROUNDING = 1e-6


def sampled(times: NDArray[np.float64], poses: NDArray[np.float64]) -> Reference:
    """Return the reference that holds each pose until the next.

    Parameters
    ----------
    times : ndarray (N,)
        Rising [s].
    poses : ndarray (N, 3)
        x, y [m] and psi [rad].
    """
    rounding = _ROUNDING * float(times[1] - times[0]) if len(times) > 1 else 0.0
    wanted = np.zeros((len(times), 10))
    wanted[:, _STATES] = poses
    wanted.setflags(write=False)
    begins = times.tolist()

    def reference(t: float) -> NDArray[np.float64]:
        return wanted[max(bisect_right(begins, t + rounding) - 1, 0)]

    return reference


def write_reference(times: NDArray[np.float64], poses: NDArray[np.float64], path: str | Path) -> None:
    """Write a reference, times (N,) and poses (N, 3), as a CSV or Parquet file.

    Raises
    ------
    InputError
        Where the file cannot be written.
    """
    Log({"t": times} | dict(zip(_COLUMNS, poses.T, strict=True))).write(path)


def read_reference(path: str | Path) -> Reference:
    """Return the reference of a file that has t, ref_x, ref_y and ref_psi; a log is one.

    Raises
    ------
    InputError
        Where the file cannot be read, lacks a column or misses a value.
    """
    return sampled(*_read(path))


def reference_text(path: str | Path) -> str:
    """Return a reference file's times and poses as the text of a CSV file, every value to the bit.

    Raises
    ------
    InputError
        As `read_reference`.
    """
    times, poses = _read(path)
    rows = np.column_stack([times, poses]).tolist()
    return "\n".join(["t," + ",".join(_COLUMNS), *(",".join(map(repr, row)) for row in rows)]) + "\n"


def reference_of(source: str) -> Reference:
    """Return the reference of that name, or the one in that file.

    Raises
    ------
    InputError
        Where there is neither.
    """
    return read_reference(source) if is_file(source) else named(source)


def is_file(source: str) -> bool:
    """Return whether a reference is meant to be in a file: its text ends as a table's name does."""
    return Path(source).suffix in (".csv", ".parquet")


def _read(path: str | Path) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return times (N,) and poses (N, 3)."""
    log = Log.read(path)
    missing = [name for name in _COLUMNS if name not in log]
    if missing:
        raise InputError(f"{path} has no column {missing[0]}; a reference file has t, {', '.join(_COLUMNS)}.")
    poses = np.column_stack([log[name] for name in _COLUMNS])
    if not np.isfinite(poses).all():
        row = int(np.flatnonzero(~np.isfinite(poses).all(axis=1))[0])
        raise InputError(
            f"{path} has no value at t = {log.t[row]:g} s; a reference needs a value in every cell."
        )
    return log.t, poses
