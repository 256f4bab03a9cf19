"""How the mechanics are compiled: one place for Numba's options and its cache on disk.

Everything from a sine to a whole Runge-Kutta step is written once, on plain numbers and tuples of them, and inlined
into the loops of `ballbot.mechanics.engine.run`; LLVM turns a loop over robots into vector instructions. Reassociation
and fused multiply-add are allowed. "No NaNs" and "no infinities" are not assumed, so that a NaN stays visible.

Numba would optimise and assemble every function on its own, and again as a part of each caller, of their callers and
so on up to the function that Python calls; only the last is ever run. Here inner functions are inlined where that is
asked for and tidied, so that their callers stay small, and the rest is left to the outermost. This halves the time of
compilation. Numba documents that a function may have a compiler of its own (`pipeline_class`); what is overridden here
is not documented. With a Numba that no longer has it, inner functions are compiled as Numba does, which takes twice as
long.
"""

import gc
import warnings
from collections.abc import Callable
from functools import cache
from hashlib import sha256
from pathlib import Path

import llvmlite.binding as llvm
from llvmlite.binding import newpassmanagers
from numba import njit
from numba.core import event
from numba.core.caching import CompileResultCacheImpl, FunctionCache, NullCache
from numba.core.codegen import CPUCodegen, JITCodeLibrary
from numba.core.compiler import Compiler, CompileResult
from numba.core.cpu import CPUContext
from numba.core.typing.context import Context
from numba.extending import overload

from ballbot.errors import CompiledCodeNotKept

_OVERRIDDEN_OR_CALLED = (
    (JITCodeLibrary, "_optimize_functions"),
    (JITCodeLibrary, "_optimize_final_module"),
    (JITCodeLibrary, "_finalize_final_module"),
    (JITCodeLibrary, "_finalize_dynamic_globals"),
    (JITCodeLibrary, "serialize_using_bitcode"),
    (CPUCodegen, "_pass_builder"),
    (newpassmanagers.ModulePassManager, "add_always_inliner_pass"),
    (CompileResultCacheImpl, "rebuild"),
)
#: versions of Numba with which inner functions are known to be compiled so, by their first two numbers
SUPPORTED_NUMBA = ("0.67", "0.68")

_NUMBA_IS_AS_EXPECTED = all(hasattr(owner, name) for owner, name in _OVERRIDDEN_OR_CALLED)


def compiler_of_inner_code() -> type[Compiler]:
    """Return the compiler to give to `numba.njit` as `pipeline_class`."""
    return InnerCompiler if _NUMBA_IS_AS_EXPECTED else Compiler


def cache_of_inner_code(function: Callable) -> FunctionCache:
    """Return what keeps an inner function's code on disk."""
    return InnerCache(function) if _NUMBA_IS_AS_EXPECTED else ForgivingCache(function)


class ForgivingCache(FunctionCache):
    """Numba's code on disk; without it the work goes on, if its folder is full, read-only or damaged."""

    def load_overload(self, sig: tuple, target_context: CPUContext) -> CompileResult | None:
        """Return the code cached for a signature; None if it is missing or cannot be read."""
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # a damaged pickle raises anything
            self.disable()
            warn_that_code_is_not_kept()
            return None

    def save_overload(self, sig: object, data: CompileResult) -> None:
        """Keep the code of a signature, if that is possible."""
        try:
            super().save_overload(sig, data)
        except OSError:
            self.disable()
            warn_that_code_is_not_kept()


class _NoFolder(NullCache):
    """What stands for a cache where Numba finds no folder that it may write to."""

    def save_overload(self, sig: object, cres: CompileResult) -> None:  # noqa: ARG002 (Numba's)
        """Warn that the next start compiles again."""
        warn_that_code_is_not_kept()


@cache
def warn_that_code_is_not_kept() -> None:
    """Warn, once."""
    warnings.warn(
        "Compiled code cannot be cached on disk, so every start compiles it again. Set NUMBA_CACHE_DIR "
        "to a writable folder without damaged files.",
        CompiledCodeNotKept,
        stacklevel=2,
    )


class _RarerCollections(event.Listener):
    """Fewer searches for garbage while Numba compiles.

    What Numba makes stays, and looking through it took 9 % of a cold start (median of five, benchmarks.paired_trees).
    """

    def __init__(self) -> None:
        self._depth, self._before = 0, gc.get_threshold()

    def on_start(self, event: event.Event) -> None:  # noqa: ARG002 (Numba's)
        """Look rarely from the outermost function on; Numba compiles in one thread at a time."""
        if self._depth == 0:
            self._before = gc.get_threshold()
            gc.set_threshold(50_000, 20, 50)
        self._depth += 1

    def on_end(self, event: event.Event) -> None:  # noqa: ARG002 (Numba's)
        """Look as often as before once the outermost function is compiled."""
        self._depth -= 1
        if self._depth == 0:
            gc.set_threshold(*self._before)


event.register("numba:compile", _RarerCollections())


class InnerCompiler(Compiler):
    """Numba's compiler, whose code goes to an `InnerLibrary`."""

    def define_pipelines(self) -> list:
        """Return Numba's own passes."""
        state = self.state
        state.library = InnerLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        return super().define_pipelines()


class InnerLibrary(JITCodeLibrary):
    """The code of one function and of those in it, for other libraries to take in."""

    def _optimize_functions(self, ll_module: llvm.ModuleRef) -> None:
        """Leave new code as it is, where Numba runs LLVM's passes over each function."""
        ll_module.data_layout = self._codegen._data_layout

    def _optimize_final_module(self) -> None:
        """Inline what asks for it, and tidy up; the vectoriser and the rest wait for the caller that Python calls.

        Counts of references to arrays go while they are easy to see: they were a fifth of the closed loop's time.
        """
        passes = newpassmanagers.create_new_module_pass_manager()
        passes.add_always_inliner_pass()
        passes.add_sroa_pass()
        passes.add_simplify_cfg_pass()
        passes.add_refprune_pass()
        passes.add_instruction_combine_pass()
        passes.add_global_dead_code_eliminate_pass()
        passes.run(self._final_module, self._codegen._pass_builder(opt=0))

    def _finalize_final_module(self) -> None:
        """Note that the code is ready to be taken in; Numba would now bring it to machine code."""
        self._finalize_dynamic_globals()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:  # noqa: ARG002 (Numba's)
        """Return 0: there is no function at any address."""
        self._ensure_finalized()
        return 0

    @property
    def codegen(self) -> "_NoEnvironments":  # pyright: ignore[reportIncompatibleMethodOverride]
        """Where Numba registers a function's environment, which only its entry from Python reads."""
        return _NoEnvironments()

    def serialize_using_object_code(self) -> tuple:
        """Return what is kept on disk: LLVM's code, there being no machine code."""
        return self.serialize_using_bitcode()


class _NoEnvironments:
    def set_env(self, env_name: str, env: object) -> None:
        """Do nothing, there being no machine code that could read it."""


class _ContextOfInnerCode:
    """Numba's target as its cache sees it, with libraries read as what they were; Numba's would assemble them."""

    def __init__(self, context: CPUContext) -> None:
        self._context = context

    @property
    def typing_context(self) -> Context:
        return self._context.typing_context

    def get_executable(self, *arguments: object) -> object:
        return self._context.get_executable(*arguments)

    def codegen(self) -> "_ContextOfInnerCode":
        return self

    def unserialize_library(self, kept: tuple[str, str, bytes]) -> InnerLibrary:
        name, _, code = kept
        library = InnerLibrary(self._context.codegen(), name)
        library._final_module = llvm.parse_bitcode(code)
        library._finalize_final_module()
        return library


class _InnerCacheImpl(CompileResultCacheImpl):
    def rebuild(self, target_context: CPUContext, payload: tuple) -> CompileResult:
        return super().rebuild(_ContextOfInnerCode(target_context), payload)


class InnerCache(ForgivingCache):
    """Inner code kept on disk."""

    _impl_class = _InnerCacheImpl


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
    stamp = _sources_stamp(package)
    try:
        kept = make_cache(function)
        kept._cache_file._source_stamp = stamp  # pyright: ignore[reportAttributeAccessIssue]
    except RuntimeError:  # Numba finds no folder that it may write to
        kept = _NoFolder()
    dispatcher._cache = kept  # pyright: ignore[reportFunctionMemberAccess]
    return dispatcher


@cache
def _sources_stamp(package: str) -> str:
    folders = _PACKAGES[: _PACKAGES.index(package) + 1] if package in _PACKAGES else (*_PACKAGES, package)
    files = [
        file for folder in folders for file in sorted((Path(__file__).parents[2] / folder).rglob("*.py"))
    ]
    sources = (file.read_bytes() for file in files)
    return sha256(
        b"".join(text for text in sources if b"ballbot.mechanics.engine.compiled" in text)
    ).hexdigest()
