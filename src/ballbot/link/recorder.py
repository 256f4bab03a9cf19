"""A log that is written while it is recorded, so that a pulled plug or a killed process costs its last 100 ms at most.

The file is a log in CSV, whose last column `whole` is 1: a row that was cut off lacks it, and is left out when the log
is read. A thread of its own writes the rows of the last `INTERVAL` and waits until they are on the disk (fsync), so
that a slow disk never delays the robot's loop.

When a run ends, its rows become log.csv and the recording is deleted; a recording that is still there is one that was
cut off.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from threading import Event, Thread

from ballbot.errors import InputError
from ballbot.files import check_file

#: between two writes [s]. A row waits for the write before its own as well, so that rows are on the disk within 100 ms
#: if a write takes up to 40 ms
INTERVAL = 0.02
#: the suffix of a recording that has not become a log yet
SUFFIX = ".recording.csv"
#: for a disk to answer when a recording is closed [s]
_PATIENCE = 30.0


class Recorder:
    """A recording that grows while the robot runs; a context manager that closes it.

    InputError if the file exists or cannot be written.
    """

    def __init__(
        self,
        path: Path,  # A new file; missing folders are made
        columns: Sequence[str],  # names of the columns, t first
    ) -> None:
        self.path = path
        #: why rows are no longer written, in one sentence; None as long as they are
        self.failure: str | None = None
        self._descriptor = _new_file(path)
        self._rows: deque[Sequence[float]] = deque()
        self._end = Event()
        self._write(",".join((*columns, "whole")) + "\n")
        self._thread = Thread(target=self._write_rows, name="recorder", daemon=True)
        self._thread.start()

    def __enter__(self) -> Recorder:
        return self

    def __exit__(self, *_: object) -> None:
        """Write the remaining rows and close the file; give up on a disk that does not answer in time."""
        self._end.set()
        self._thread.join(_PATIENCE)
        if self._thread.is_alive():
            self.failure = f"{self.path} could not be written: the disk has not answered for {_PATIENCE:g} s."
        else:
            os.close(self._descriptor)

    def append(self, row: Sequence[float]) -> None:
        """Take a row, in the order of the columns; it is written within the interval. Never waits for the disk."""
        self._rows.append(row)

    def _write_rows(self) -> None:
        """Write the rows that have come, again and again until the end."""
        ended = False
        while not ended and self.failure is None:
            ended = self._end.wait(INTERVAL)
            if rows := [self._rows.popleft() for _ in range(len(self._rows))]:
                self._write("".join(",".join(map(repr, map(float, row))) + ",1\n" for row in rows))

    def _write(self, text: str) -> None:
        """Write a text and wait until it is on the disk."""
        left = memoryview(text.encode())
        try:
            while left:
                left = left[os.write(self._descriptor, left) :]
            os.fsync(self._descriptor)
        except OSError as error:
            self.failure = f"{self.path} can no longer be written: {error.strerror or error}."


def check_no_recording(path: Path) -> None:
    """Raise InputError if there is a recording, which must not be overwritten."""
    if os.path.lexists(path):
        raise InputError(
            f"{path} is the log of a run that was cut off. Give it another name to use it as any log, or delete it."
        )


def _new_file(path: Path) -> int:
    """Return the descriptor of a new file; on POSIX systems its folder entry is on the disk, too."""
    check_file(path)
    check_no_recording(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND, 0o644)
        if os.name == "posix":
            folder = os.open(path.parent, os.O_RDONLY)
            os.fsync(folder)
            os.close(folder)
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror or error}.") from None
    return descriptor
