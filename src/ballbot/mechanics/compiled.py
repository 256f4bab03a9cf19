"""How the mechanics are compiled: one place for Numba's options.

Everything from a sine to a whole Runge-Kutta step is written once, on plain numbers and tuples of
them, and inlined into the loops of `ballbot.mechanics.engine`; LLVM turns a loop over robots into
vector instructions. Reassociation and fused multiply-add are allowed. "No NaNs" and "no infinities"
are not assumed, so that a NaN stays visible.
"""

from collections.abc import Callable
from functools import cache
from hashlib import sha256
from pathlib import Path

from numba import njit
from numba.core.caching import FunctionCache
from numba.extending import overload

from ballbot.mechanics.inner_code import (
    ForgivingCache,
    cache_of_inner_code,
    compiler_of_inner_code,
    warn_that_code_is_not_kept,
)

FAST = {"reassoc", "contract", "arcp", "nsz", "afn"}

#: what only compiled code calls needs no entry from outside, nor machine code of its own
_INSIDE = {
    "error_model": "numpy",
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
    "pipeline_class": compiler_of_inner_code(),
}
_INLINED = {**_INSIDE, "forceinline": True}

#: a function of its own that only compiled code calls
called = njit(fastmath=FAST, **_INSIDE)

#: a function that is inlined where it is used
inlined = njit(fastmath=FAST, **_INLINED)

#: the same, in the order written: for range reductions, which reassociation would undo
inlined_in_order = njit(fastmath={"contract"}, **_INLINED)


def by_types_of(stub: Callable) -> Callable:
    """Return a decorator: the function it is given chooses `stub`'s compiled form from its arguments' types."""
    return overload(stub, jit_options={"fastmath": FAST, **_INLINED})  # pyright: ignore[reportArgumentType]


def by_types_of_in_order(stub: Callable) -> Callable:
    """Return the decorator of `by_types_of`, for operations in the order written."""
    return overload(stub, jit_options={"fastmath": {"contract"}, **_INLINED})  # pyright: ignore[reportArgumentType]


#: packages with compiled sources, each using those before it
_PACKAGES = ("mechanics", "control", "estimation", "simulation", "identification")


def compiled(function: Callable) -> Callable:
    """Return a function that Python calls: brought to machine code, kept on disk, and run without Python's lock."""
    dispatcher = njit(error_model="numpy", fastmath=FAST, nogil=True)(function)
    return _kept(dispatcher, function, ForgivingCache)


def compiled_alone(function: Callable) -> Callable:
    """Return a function that Python calls and that inlines nothing of another file, in the order written."""
    dispatcher = njit(error_model="numpy")(function)
    return _kept(dispatcher, function, ForgivingCache)


def shared(function: Callable) -> Callable:
    """Return a function that only compiled code calls, kept on disk for the next that Python calls."""
    dispatcher = njit(fastmath=FAST, **_INSIDE)(function)
    return _kept(dispatcher, function, cache_of_inner_code)


def _kept(
    dispatcher: Callable, function: Callable, make_cache: Callable[[Callable], FunctionCache]
) -> Callable:
    """Return the dispatcher, its code kept on disk if there is a folder for it, and stale if any source has changed.

    Numba's cache looks at the function's own file only, yet what is inlined comes from many: here a change
    in any compiled source of its package, or of one it may use, counts.
    """
    package = function.__module__.partition(".")[2].partition(".")[0]
    try:
        kept = make_cache(function)
    except RuntimeError:  # Numba finds no folder that it may write to
        warn_that_code_is_not_kept()
        return dispatcher
    kept._cache_file._source_stamp = _sources_stamp(package)  # pyright: ignore[reportAttributeAccessIssue]
    dispatcher._cache = kept  # pyright: ignore[reportFunctionMemberAccess]
    return dispatcher


@cache
def _sources_stamp(package: str) -> str:
    folders = _PACKAGES[: _PACKAGES.index(package) + 1] if package in _PACKAGES else _PACKAGES
    files = [
        file for folder in folders for file in sorted((Path(__file__).parents[1] / folder).rglob("*.py"))
    ]
    sources = (file.read_bytes() for file in files)
    return sha256(b"".join(text for text in sources if b"ballbot.mechanics.compiled" in text)).hexdigest()
