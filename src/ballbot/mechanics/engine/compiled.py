"""How the mechanics are compiled: one place for Numba's options and its cache on disk.

Straight-line arithmetic is `traced` (`ballbot.mechanics.engine.tracing`), what has loops or branches is compiled by
Numba, and inlined where Python does not call it: Numba optimises and assembles a function, and does so again wherever
it is called by another, so it is small, or called from one place. A call would moreover depend on where the code comes
from: a process that has just compiled would link the copy that was optimised by itself, one that reads from disk the
copy within its caller, and their results would differ by rounding. "No NaNs" and "no infinities" are not assumed, so
that a NaN stays visible.
"""

import os
import sys
import warnings
from collections.abc import Callable
from contextlib import suppress
from functools import cache, partial
from hashlib import sha256
from multiprocessing import parent_process
from pathlib import Path

from numba import cfunc, njit
from numba.core.event import Event, Listener, register

from ballbot.errors import CompiledCodeNotKept
from ballbot.mechanics.engine.tracing import FAST
from ballbot.progress import running_notebook

#: what only compiled code calls needs no entry from outside
_INSIDE = {"error_model": "numpy", "no_cpython_wrapper": True, "no_cfunc_wrapper": True}

#: a function that is inlined where it is used
inlined = njit(fastmath=FAST, forceinline=True, **_INSIDE)
#: the same, before anything is compiled: for a large function, which by itself would take as long as with its caller
spliced = njit(fastmath=FAST, inline="always", **_INSIDE)


#: packages with compiled sources, each using those before it
_PACKAGES = ("mechanics", "control", "estimation", "simulation", "identification")


def compiled(function: Callable) -> Callable:
    """Return a function that Python calls: brought to machine code, kept on disk, and run without Python's lock."""
    return _kept(function, fastmath=FAST, nogil=True)


def compiled_alone(function: Callable) -> Callable:
    """Return a function that Python calls and that inlines nothing of another file, in the order written."""
    return _kept(function)


def c_code(signature: str) -> Callable[[Callable], int]:
    """Return a decorator: the address of a function's machine code, for `tracing.outside`; it is kept on disk.

    `signature` is Numba's. What the function's closure holds is a constant of its code.
    """

    def address_of(function: Callable) -> int:
        return _kept(function, partial(cfunc, signature), fastmath=FAST).address  # pyright: ignore[reportFunctionMemberAccess]

    return address_of


def _kept(function: Callable, compiler: Callable = njit, **options: object) -> Callable:
    """Return the compiled function, its code kept on disk if there is a folder for it.

    Numba keys the code by the function's own file, by its bytes and by what its closure holds, yet what is inlined
    comes from many files. So its name, and with it the file's, has a digest of every compiled source that it may use;
    what other sources have left is not read, since it may name types that are gone.
    """
    digest = _sources_digest(function.__module__.partition(".")[2].partition(".")[0])
    function.__qualname__ += f".{digest}"
    try:
        _tidy(njit(cache=True)(function).stats.cache_path, digest)
        return compiler(error_model="numpy", cache=True, **options)(function)
    except RuntimeError:  # Numba finds no folder that it may write to
        warn_that_code_is_not_kept()
        return compiler(error_model="numpy", **options)(function)


@cache
def _sources_digest(package: str) -> str:
    folders = _PACKAGES[: _PACKAGES.index(package) + 1] if package in _PACKAGES else (*_PACKAGES, package)
    files = [
        file for folder in folders for file in sorted((Path(__file__).parents[2] / folder).rglob("*.py"))
    ]
    sources = (file.read_bytes() for file in files)
    digest = sha256(b"".join(text for text in sources if b"ballbot.mechanics.engine" in text)).hexdigest()
    return f"of_{digest[:16]}"


@cache
def _tidy(folder: str, digest: str) -> None:
    """Remove code of other sources, and files that a full disk or a broken copy has cut short."""
    for file in Path(folder).glob("*.of_*.nb[ic]"):
        with suppress(OSError):  # another process has removed it
            with file.open("rb") as opened:
                opened.seek(max(opened.seek(0, os.SEEK_END) - 1, 0))
                whole = opened.read(1) == b"."  # pickle's last byte
            if not whole or digest not in file.name:
                file.unlink()


class _Notice(Listener):
    """Prints once that Ballbot's code is being compiled; nothing is compiled if all of it is on disk."""

    def on_start(self, event: Event) -> None:
        assert event.data is not None
        if event.data["dispatcher"].py_func.__module__.startswith("ballbot."):
            _say_that_it_compiles()

    def on_end(self, event: Event) -> None:
        pass


@cache
def _say_that_it_compiles() -> None:
    shown = sys.stderr is not None and (sys.stderr.isatty() or running_notebook() is not None)
    if shown and parent_process() is None:
        print("Ballbot compiles its code for this machine, once: up to half a minute.", file=sys.stderr)


register("numba:compile", _Notice())


@cache
def warn_that_code_is_not_kept() -> None:
    """Warn, once."""
    warnings.warn(
        "Compiled code cannot be cached on disk, so every start compiles it again. Set NUMBA_CACHE_DIR "
        "to a writable folder.",
        CompiledCodeNotKept,
        stacklevel=2,
    )
