"""Machine code that comes with an installed wheel, so that the first call on a new machine compiles nothing.

Numba keeps compiled code for the exact processor that compiled it. A wheel's code is compiled for a processor that most
others contain (`BASELINES`), and is used wherever the processor has what it needs, under the same versions of Python
and Numba and the same sources; elsewhere it is ignored and functions are compiled as usual. `build_backend` makes it.
"""

import platform
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import llvmlite.binding as llvm
from numba.core.caching import IndexDataCacheFile
from numba.core.compiler import CompileResult
from numba.core.cpu import CPUContext

#: where a wheel has its code; a clone has none
FOLDER = Path(__file__).parents[2] / "machine_code"


@dataclass(frozen=True)
class Baseline:
    """A processor to compile for, as LLVM names it, and what a processor needs in order to run that code."""

    cpu: str
    features: frozenset[str]


#: by the names of machines that Python's `platform` uses; on others everything is compiled on the machine itself
BASELINES = {
    "x86_64": Baseline(
        "x86-64-v3",
        frozenset({"avx", "avx2", "bmi", "bmi2", "cx16", "f16c", "fma", "lzcnt", "movbe", "popcnt"}),
    ),
}


def baseline() -> Baseline | None:
    """Return the processor that a wheel built on this kind of machine is compiled for; None if no code is shipped."""
    return BASELINES.get(platform.machine())


@cache
def runs_here() -> bool:
    """Return whether this machine's processor can run a wheel's code."""
    needed = baseline()
    try:
        own = llvm.get_host_cpu_features()
    except RuntimeError:  # LLVM does not know this processor
        return False
    return needed is not None and all(own.get(feature, False) for feature in needed.features)


def is_used() -> bool:
    """Return whether functions have a wheel's code here."""
    return FOLDER.is_dir() and runs_here()


@dataclass(frozen=True)
class ShippedCode:
    """The code in the wheel of one function that Python calls."""

    function: Callable
    source_stamp: str  #: of all sources that the code is made from

    def load(self, signature: tuple, target: CPUContext) -> CompileResult | None:
        """Return the code for arguments of these types; None if it is missing or does not run here."""
        if not is_used():
            return None
        target.refresh()
        try:
            kept = self._file(FOLDER).load(_key(signature))
            return None if kept is None else CompileResult._rebuild(target, *kept)
        except Exception:  # a damaged pickle raises anything; the function is compiled instead
            return None

    def save(self, folder: Path, signature: tuple, code: CompileResult) -> None:
        """Add the code for arguments of these types to a folder that a wheel will have as `FOLDER`."""
        file = self._file(folder)
        Path(file._cache_path).mkdir(parents=True, exist_ok=True)
        file.save(_key(signature), code._reduce())

    def _file(self, folder: Path) -> IndexDataCacheFile:
        version = f"{sys.version_info.major}{sys.version_info.minor}"
        name = f"{self.function.__qualname__}.py{version}"
        return IndexDataCacheFile(str(folder / self.function.__module__), name, self.source_stamp)


def _key(signature: tuple) -> tuple:
    """Return what distinguishes code in a function's file."""
    chosen = baseline()
    return signature, sys.platform, platform.machine(), None if chosen is None else chosen.cpu
