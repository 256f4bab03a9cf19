"""Worker processes that end with this one: on Ctrl-C at once and without a traceback each, and when it is killed."""

import ctypes
import signal
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager, suppress
from multiprocessing import get_context, parent_process
from multiprocessing.connection import wait
from os import _exit  # the user's controller may replace the module's own

_PR_SET_PDEATHSIG = 1  # of <sys/prctl.h>


def worker_pool(workers: int | None) -> ProcessPoolExecutor:
    """Return a pool of processes that end with this one, even if it is killed.

    Submit to it within `uninterrupted`: processes that begin there do not hear Ctrl-C while they import.
    """
    # spawned: a fork of a process with threads may hang
    return ProcessPoolExecutor(workers, mp_context=get_context("spawn"), initializer=begin_as_worker)


def begin_as_worker() -> None:
    """Let Ctrl-C and the end of its parent end this process at once."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    end_with_parent()


def end_with_parent() -> None:
    """Let this process, begun by `multiprocessing`, end when its parent ends, however it does.

    A thread waits for the parent everywhere; on Linux the system sends a signal too, which needs no turn of this
    process's interpreter.
    """
    parent = parent_process()
    if parent is None:
        return
    if sys.platform == "linux":
        with suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(signal.SIGKILL), 0, 0, 0)
    sentinel = parent.sentinel

    def watch() -> None:
        wait([sentinel])
        _exit(1)

    threading.Thread(target=watch, name="end with parent", daemon=True).start()


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Let nobody stop the block with Ctrl-C: for what takes no time and must not be half done."""
    if threading.current_thread() is not threading.main_thread():
        yield  # which signals are heard is for the main thread to say
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
