"""How `ballbot.mechanics.compiled` compiles what only compiled code calls: simplified, without machine code of its own.

Numba would optimise and assemble every function on its own, and again as a part of each caller, of their callers and
so on up to the function that Python calls; only the last is ever run. Here inner functions are inlined where that is
asked for and tidied, so that their callers stay small, and the rest is left to the outermost. This halves
the time of compilation.

Numba documents that a function may have a compiler of its own (`pipeline_class`); what is overridden below is not
documented. With a Numba that has it no more, inner functions are compiled as Numba does, which takes twice as long.
"""

import warnings
from collections.abc import Callable
from functools import cache

import llvmlite.binding as llvm
from llvmlite.binding import newpassmanagers
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.codegen import CPUCodegen, JITCodeLibrary
from numba.core.compiler import Compiler, CompileResult
from numba.core.cpu import CPUContext
from numba.core.typing.context import Context

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
_NUMBA_IS_AS_EXPECTED = all(hasattr(owner, name) for owner, name in _OVERRIDDEN_OR_CALLED)


def compiler_of_inner_code() -> type[Compiler]:
    """Return the compiler to give to `numba.njit` as `pipeline_class`."""
    return InnerCompiler if _NUMBA_IS_AS_EXPECTED else Compiler


def cache_of_inner_code(function: Callable) -> FunctionCache:
    """Return what keeps an inner function's code on disk."""
    return InnerCache(function) if _NUMBA_IS_AS_EXPECTED else ForgivingCache(function)


class ForgivingCache(FunctionCache):
    """Numba's code on disk; without it the work goes on, if its folder is full, read-only or damaged."""

    def load_overload(self, sig: object, target_context: CPUContext) -> CompileResult | None:
        """Return the code kept for a signature; None if there is none or it cannot be read."""
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


@cache
def warn_that_code_is_not_kept() -> None:
    """Warn, once."""
    warnings.warn(
        "Compiled code cannot be cached on disk, so every start compiles it again. Set NUMBA_CACHE_DIR "
        "to a writable folder without damaged files.",
        CompiledCodeNotKept,
        stacklevel=2,
    )


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
        """Inline what asks for it, and tidy up; the vectoriser and the rest wait for the caller that Python calls."""
        passes = newpassmanagers.create_new_module_pass_manager()
        passes.add_always_inliner_pass()
        passes.add_sroa_pass()
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
        """What Numba tells where a function's environment is, which only its entry from Python reads."""
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
