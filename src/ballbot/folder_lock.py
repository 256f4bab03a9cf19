"""A lock on a folder: held by one process at a time, and given back by the system when that process ends or dies."""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ballbot.errors import InputError

LOCK = ".ballbot.lock"

#: file systems without locks, as some network drives: work goes on without one
_NO_LOCKS = {errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOLCK, errno.ENOSYS, errno.EBADF, errno.EINVAL}


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold the folder's lock while the block runs.

    Raises
    ------
    InputError
        If another process holds it, or the lock's file cannot be made.
    """
    path = folder / LOCK
    descriptor = _acquire(path, folder)
    try:
        yield
    finally:
        with suppress(OSError):  # the folder may have been deleted meanwhile
            path.unlink()
        os.close(descriptor)


def _acquire(path: Path, folder: Path) -> int:
    while True:
        try:
            # never through a link, and never waiting for the other end of a pipe
            flags = os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
            descriptor = os.open(path, flags, 0o644)
        except OSError as error:
            raise InputError(f"{path} cannot be made: {error.strerror or error}.") from None
        if not _take(descriptor):
            holder = os.read(descriptor, 20).decode(errors="replace").strip()
            os.close(descriptor)
            by = f" (process {holder})" if holder.isdigit() else ""
            raise InputError(
                f"Another ballbot{by} is writing into {folder}; wait until it has finished, or choose another "
                "folder with --out."
            )
        if _is_at(descriptor, path):
            os.ftruncate(descriptor, 0)
            os.write(descriptor, str(os.getpid()).encode())
            return descriptor
        os.close(descriptor)  # its holder deleted it between the opening and the lock


def _is_at(descriptor: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(descriptor), os.stat(path))
    except FileNotFoundError:
        return False


def _take(descriptor: int) -> bool:
    """Lock an open file without waiting; False if another process has it."""
    try:
        if sys.platform == "win32":
            import msvcrt

            os.lseek(descriptor, 1 << 20, os.SEEK_SET)  # beyond what is written, which others may read
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
            os.lseek(descriptor, 0, os.SEEK_SET)
        else:
            import fcntl

            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        return error.errno in _NO_LOCKS
    return True
