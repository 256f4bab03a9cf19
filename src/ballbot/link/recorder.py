"""A log that is written while it is recorded, so that a pulled plug or a killed process costs its last 100 ms at most.

    {"format": "ballbot recording 1", "columns": ["t", "u1", ..], "about": {..}}
    0.005,0.1,..
    0.010,0.2,..

The first line is JSON: the columns, and what the recording is of. Each further line is a row in the fewest digits that
read back to the same bits. A thread of its own writes the rows of the last `INTERVAL` and waits until they are on the
disk (fsync), so that a slow disk never delays the robot's loop. `Recorder.longest_unsaved` is the longest time for
which a row was not on the disk yet.

`read_recording` reads the rows up to the first line that is not a whole row. After a crash the end of a file may be a
part of a line, or zeros where a block was never written. When a run ends, its rows become a normal log
(`Log.write`) and the recording is deleted; a recording that is still there is one that was cut off.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from threading import Event, Lock, Thread
from time import monotonic

import numpy as np

from ballbot.errors import InputError
from ballbot.file_formats import format_name, take_format
from ballbot.files import check_file, read_bytes
from ballbot.log import Log
from ballbot.log.columns import check_column_names

#: between two writes [s]. A row waits for the write before its own as well, so that rows are on the disk within 100 ms
#: if a write takes up to 40 ms
INTERVAL = 0.02
#: the suffix of a recording that has not become a log yet
SUFFIX = ".recording"
#: for a disk to answer when a recording is closed [s]
_PATIENCE = 30.0


class Recorder:
    """A recording that grows while the robot runs; a context manager that closes it.

    Parameters
    ----------
    path : Path
        A new file; missing folders are made.
    columns : sequence of str
        Names of the columns, t first.
    about : mapping of str to object
        What the recording is of, as JSON has it: robot, controller, session.
    interval : float
        Between two writes [s].

    Raises
    ------
    InputError
        If the file exists or cannot be written.
    """

    def __init__(
        self, path: Path, columns: Sequence[str], *, about: Mapping[str, object], interval: float = INTERVAL
    ) -> None:
        self.path, self.columns = path, tuple(columns)
        self._descriptor = _new_file(path)
        header = {"format": format_name("recording"), "columns": self.columns, "about": about}
        self._rows: list[Sequence[float]] = []
        self._oldest = math.inf  # when the first of these rows came
        self._writing = math.inf  # when the first of the rows came that are being written
        self._lock, self._end = Lock(), Event()
        self._longest = 0.0
        self._failure: str | None = None
        self._interval = interval
        self._write(json.dumps(header) + "\n")
        _sync_folder(path.parent)
        self._thread = Thread(target=self._write_rows, name="recorder", daemon=True)
        self._thread.start()

    def __enter__(self) -> Recorder:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def longest_unsaved(self) -> float:
        """The longest time between a row and its arrival on the disk [s], that of the rows on their way included."""
        with self._lock:
            oldest = min(self._oldest, self._writing)
            return max(self._longest, monotonic() - oldest if oldest < math.inf else 0.0)

    @property
    def failure(self) -> str | None:
        """Why rows are no longer written, in one sentence; None as long as they are."""
        return self._failure

    def append(self, row: Sequence[float]) -> None:
        """Take a row, in the order of the columns; it is written within the interval. Never waits for the disk."""
        assert len(row) == len(self.columns)
        with self._lock:
            if not self._rows:
                self._oldest = monotonic()
            self._rows.append(row)

    def close(self) -> None:
        """Write what is left and close the file. A disk that does not answer is not waited for without end."""
        self._end.set()
        self._thread.join(_PATIENCE)
        if self._thread.is_alive():
            self._failure = (
                f"{self.path} could not be written: the disk has not answered for {_PATIENCE:g} s."
            )
            return
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1

    def _write_rows(self) -> None:
        """Write the rows that have come, again and again until the end."""
        ended = False
        while not ended and self._failure is None:
            ended = self._end.wait(self._interval)
            with self._lock:
                rows, self._writing = self._rows, self._oldest
                self._rows, self._oldest = [], math.inf
            if rows:
                self._write("".join(",".join(map(repr, map(float, row))) + "\n" for row in rows))
                with self._lock:
                    self._longest = max(self._longest, monotonic() - self._writing)
                    self._writing = math.inf

    def _write(self, text: str) -> None:
        """Write a text and wait until it is on the disk."""
        left = memoryview(text.encode())
        try:
            while left:
                left = left[os.write(self._descriptor, left) :]
            os.fsync(self._descriptor)
        except OSError as error:
            self._failure = f"{self.path} can no longer be written: {error.strerror or error}."


@dataclass(frozen=True, kw_only=True, eq=False)
class Recording:
    """A recording read back."""

    log: Log
    about: Mapping[str, object]  #: what it is of
    damaged_bytes: int  #: bytes after the last whole row: a part of a line, or a block that was never written


def read_recording(path: str | Path) -> Recording:
    """Read the whole rows of a recording, also of one that was cut off.

    Raises
    ------
    InputError
        If the file cannot be read, is not a recording, or has no whole row.
    """
    content = read_bytes(path)
    first, _, body = content.partition(b"\n")
    columns, about = _header(first, path)
    rows: list[list[float]] = []
    used = 0
    for line in body.split(b"\n")[:-1]:  # after the last line end stands nothing, or a part of a line
        row = _row(line, len(columns))
        if row is None or (rows and not row[0] > rows[-1][0]):
            break
        rows.append(row)
        used += len(line) + 1
    if not rows:
        raise InputError(f"{path} is a recording without a whole row; nothing was recorded.")
    table = np.array(rows)
    try:
        log = Log(dict(zip(columns, table.T, strict=True)))
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    return Recording(log=log, about=about, damaged_bytes=len(body) - used)


def check_no_recording(path: Path) -> None:
    """Raise InputError if there is a recording, which must not be overwritten."""
    if os.path.lexists(path):
        raise InputError(
            f"{path} is a recording that was cut off. Make a log of it with `ballbot run recover {path} --out "
            "recovered`, and delete it."
        )


def _header(line: bytes, path: str | Path) -> tuple[list[str], dict[str, object]]:
    """Return the columns and what the recording is of."""
    other = InputError(f"{path} is not a recording of `ballbot run`.")
    try:
        header = json.loads(line)
    except (ValueError, RecursionError):
        raise other from None
    if not isinstance(header, dict) or not str(header.get("format")).startswith("ballbot "):
        raise other
    try:
        rest = take_format(header, "recording")
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    columns, about = rest.get("columns"), rest.get("about")
    if not isinstance(about, dict) or not isinstance(columns, list) or columns[:1] != ["t"]:
        raise other
    if not all(isinstance(one, str) for one in columns):
        raise other
    check_column_names(columns, source=str(path))
    return columns, about


def _row(line: bytes, width: int) -> list[float] | None:
    """Return the numbers of a line; None if it is not a whole row."""
    cells = line.split(b",")
    if len(cells) != width:
        return None
    try:
        row = [float(cell) for cell in cells]
    except ValueError:
        return None
    return row if math.isfinite(row[0]) else None


def _new_file(path: Path) -> int:
    """Return the descriptor of a new file."""
    check_file(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        return os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND, 0o644)
    except FileExistsError:
        check_no_recording(path)
        raise
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror or error}.") from None


def _sync_folder(folder: Path) -> None:
    """Wait until the name of a new file is on the disk, where the system can."""
    if os.name != "posix":
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError:  # file systems that know no such thing
        pass
    finally:
        os.close(descriptor)
