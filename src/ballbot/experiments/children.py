"""Processes that Ctrl-C ends at once and without a traceback each; the one that waits for them says what happened."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def deaf_children() -> Iterator[None]:
    """Let processes begin that do not hear Ctrl-C while they import."""
    if threading.current_thread() is not threading.main_thread():
        yield  # which signals are heard is for the main thread to say
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def die_quietly() -> None:
    """Let Ctrl-C end this process at once; for a pool's initializer."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
