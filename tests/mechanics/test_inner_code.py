"""What only compiled code calls goes into its callers: no machine code of its own, and none that is missing."""

import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import numba
import pytest
from numba import config, types
from numba.core.registry import cpu_target

from ballbot.errors import CompiledCodeNotKept
from ballbot.mechanics.engine.compiled import (
    SUPPORTED_NUMBA,
    InnerCompiler,
    called,
    compiled,
    compiled_alone,
    compiler_of_inner_code,
    inlined,
    shared,
    warn_that_code_is_not_kept,
)
from tests.support.paths import ROOT

PROGRAM = """
import sys
sys.path.insert(0, {folder!r})
import doubling
from numba.core.registry import cpu_target

value, hits = doubling.{entry}(3.0), sum(doubling.twice.stats.cache_hits.values())
machine = cpu_target.target_context.codegen()._engine
assembled = [machine.is_symbol_defined(one.fndesc.mangled_name) for one in doubling.twice.overloads.values()]
print(value, hits, sum(assembled))
"""

SOURCE = """
from ballbot.mechanics.engine.compiled import compiled, shared

@shared
def twice(x):
    return 2.0 * x

@compiled
def six_times(x):
    return 3.0 * twice(x)

@compiled
def ten_times(x):
    return 5.0 * twice(x)
"""


@inlined
def _squared(x):
    return x * x


@called
def _sum_of_squares(numbers):
    total = 0.0
    for number in numbers:
        total += _squared(number)
    return total


def _norm(numbers):
    return _sum_of_squares(numbers) ** 0.5


@pytest.fixture(autouse=True)
def own_cache(tmp_path: Path, monkeypatch) -> None:
    """Let Numba keep code where no earlier run has left any."""
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))


def test_inner_functions_have_no_machine_code_and_no_call_to_what_is_inlined() -> None:
    numbers = types.UniTuple(types.float64, 2)
    norm_kept = shared(_norm)
    norm_kept.compile((numbers,))  # pyright: ignore[reportFunctionMemberAccess]
    inner_functions: list[Any] = [norm_kept, _sum_of_squares, _squared]
    (norm,), (sums,), (square,) = (function.overloads.values() for function in inner_functions)
    machine = cpu_target.target_context.codegen()._engine  # pyright: ignore[reportAttributeAccessIssue]
    for inner in (norm, sums, square):
        assert not machine.is_symbol_defined(inner.fndesc.mangled_name)
    code = norm.library.get_llvm_str()
    assert sums.fndesc.mangled_name in code
    assert square.fndesc.mangled_name not in code


def test_python_gets_the_value_of_inner_functions() -> None:
    norm = shared(_norm)

    @compiled
    def norm_of(x, y):
        return norm((x, y))

    assert norm_of(3.0, 4.0) == 5.0


@pytest.mark.slow
def test_a_shared_function_is_read_from_disk_by_the_next_that_needs_it(tmp_path: Path, monkeypatch) -> None:
    (tmp_path / "doubling.py").write_text(SOURCE)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))

    def run(entry: str) -> list[float]:
        program = PROGRAM.format(folder=str(tmp_path), entry=entry)
        done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
        return [float(number) for number in done.stdout.split()]

    assert run("six_times") == [6.0 * 3.0, 0, 0]
    # read, it must have no machine code either: what its caller holds, and optimises, would not be run
    assert run("ten_times") == [10.0 * 3.0, 1, 0]


def halve(x):
    """Compiled anew by each test."""
    return 0.5 * x


@pytest.fixture
def warned_anew():
    warn_that_code_is_not_kept.cache_clear()
    yield
    warn_that_code_is_not_kept.cache_clear()


@pytest.mark.usefixtures("warned_anew")
def test_code_runs_without_any_folder_to_keep_it(tmp_path: Path, monkeypatch) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setattr(config, "CACHE_LOCATOR_CLASSES", "UserProvidedCacheLocator")
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path / "file" / "folder"))  # cannot be made
    with pytest.warns(CompiledCodeNotKept, match="Set NUMBA_CACHE_DIR to a writable folder"):
        assert compiled_alone(halve)(3.0) == 1.5


@pytest.mark.usefixtures("warned_anew")
@pytest.mark.parametrize("damaged", ["*.nbi", "*.nbc"])
def test_damaged_code_on_disk_is_compiled_anew(tmp_path: Path, damaged: str) -> None:
    assert compiled_alone(halve)(3.0) == 1.5
    for file in tmp_path.rglob(damaged):
        file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    with pytest.warns(CompiledCodeNotKept):
        assert compiled_alone(halve)(3.0) == 1.5


@pytest.mark.usefixtures("warned_anew")
def test_a_full_disk_leaves_code_unkept(tmp_path: Path) -> None:
    halving = compiled_alone(halve)
    for folder in tmp_path.iterdir():
        folder.rmdir()
        folder.touch()  # a file stands where the folder of code should be
    with pytest.warns(CompiledCodeNotKept):
        assert halving(3.0) == 1.5


def test_the_oldest_numba_that_pip_may_install_is_supported():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    assert f"numba>={SUPPORTED_NUMBA[0]}" in project["dependencies"]


def test_supported_numba_versions_compile_inner_code_without_the_fallback():
    version = ".".join(numba.__version__.split(".")[:2])
    if version not in SUPPORTED_NUMBA:
        pytest.skip(f"Numba {version} is not one of {SUPPORTED_NUMBA}; the fallback is allowed")
    assert compiler_of_inner_code() is InnerCompiler
