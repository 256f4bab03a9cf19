"""Machine code that comes with a wheel: used where it fits, ignored where it does not."""

import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from numba import config

from ballbot.errors import CompiledCodeNotKept
from ballbot.mechanics.engine import shipped
from ballbot.mechanics.engine.compiled import compiled_alone, warn_that_code_is_not_kept
from ballbot.mechanics.engine.shipped import Baseline, ShippedCode


def halve(x):
    """Compiled anew by each test."""
    return 0.5 * x


@pytest.fixture(autouse=True)
def wheel(tmp_path: Path, monkeypatch) -> Iterator[Path]:
    """Let a wheel have the machine code of `halve`, and Numba an empty cache."""
    folder = tmp_path / "machine_code"
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path / "first"))
    monkeypatch.setattr(shipped, "FOLDER", folder)
    monkeypatch.setattr(shipped, "baseline", lambda: Baseline("this one", frozenset()))
    shipped.runs_here.cache_clear()
    halving: Any = compiled_alone(halve)
    assert halving(3.0) == 1.5
    for signature, code in halving.overloads.items():
        halving._cache.shipped.save(folder, signature, code)
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path / "second"))
    yield folder
    shipped.runs_here.cache_clear()
    warn_that_code_is_not_kept.cache_clear()


def compilations_of_a_call() -> int:
    """Return how many times a new process's first call of `halve` compiles it."""
    halving: Any = compiled_alone(halve)
    assert halving(3.0) == 1.5
    return sum(halving.stats.cache_misses.values())


def test_shipped_code_is_not_compiled_again() -> None:
    assert compilations_of_a_call() == 0


def test_shipped_code_needs_no_folder_to_write_to(tmp_path: Path, monkeypatch) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setattr(config, "CACHE_LOCATOR_CLASSES", "UserProvidedCacheLocator")
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path / "file" / "folder"))  # cannot be made
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert compilations_of_a_call() == 0


def test_other_types_are_compiled() -> None:
    halving: Any = compiled_alone(halve)
    assert halving(3) == 1.5
    assert sum(halving.stats.cache_misses.values()) == 1


def test_code_for_a_better_processor_is_ignored(monkeypatch) -> None:
    monkeypatch.setattr(shipped, "baseline", lambda: Baseline("this one", frozenset({"a feature of 2040"})))
    shipped.runs_here.cache_clear()
    assert compilations_of_a_call() == 1


def test_code_for_another_kind_of_processor_is_ignored(monkeypatch) -> None:
    monkeypatch.setattr(shipped, "baseline", lambda: Baseline("another", frozenset()))
    assert compilations_of_a_call() == 1


def test_code_from_other_sources_is_ignored(wheel: Path) -> None:
    target = compiled_alone(halve)._cache  # pyright: ignore[reportFunctionMemberAccess]
    older = ShippedCode(halve, "another stamp")
    assert target.shipped._file(wheel)._load_index()
    assert older._file(wheel)._load_index() == {}


@pytest.mark.parametrize("damaged", ["*.nbi", "*.nbc"])
def test_damaged_code_is_compiled_instead(wheel: Path, damaged: str) -> None:
    for file in wheel.rglob(damaged):
        file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    assert compilations_of_a_call() == 1


def test_a_warning_comes_only_where_something_is_compiled(tmp_path: Path, monkeypatch) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setattr(config, "CACHE_LOCATOR_CLASSES", "UserProvidedCacheLocator")
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path / "file" / "folder"))
    with pytest.warns(CompiledCodeNotKept):
        assert compiled_alone(halve)(3) == 1.5
