"""Compiled code on disk: said where it is made, read where it is whole."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.paths import ROOT

#: a module of one function that is soon compiled, and a call of it
SMALL = """
from ballbot.mechanics.engine.compiled import compiled

@compiled
def doubled(x):
    return 2.0 * x
"""
CALL = """
import sys
sys.stderr.isatty = lambda: True
from importlib.util import module_from_spec, spec_from_file_location
spec = spec_from_file_location("ballbot.small", "small.py")
small = sys.modules["ballbot.small"] = module_from_spec(spec)
spec.loader.exec_module(small)
print(small.doubled(1.5))
"""

#: batches of the law and the mechanics: functions that others call, in vector lanes and alone
BATCH = """
import sys
sys.stderr.isatty = lambda: True
import hashlib, numpy as np
from ballbot import Model, Robot, simulate_batch
from tests.support.control_examples import FRICTION, alten
starts = np.full((3, 10), 0.001)  # upright and at rest, nothing would move
found = simulate_batch(Model(alten(FRICTION)), "precise", "hold", duration=2.0, initial_states=starts)
print(hashlib.sha256(found.states.tobytes()).hexdigest())
"""


def run(program: str, cache: Path, folder: Path = ROOT) -> tuple[str, int]:
    """Return what a program prints with compiled code in `cache`, and how often it says that it compiles."""
    done = subprocess.run(
        [sys.executable, "-c", program],
        env=os.environ | {"NUMBA_CACHE_DIR": str(cache)},
        cwd=folder,
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout, done.stderr.count("compiles")


@pytest.mark.sample  # compiles the closed loop anew
def test_code_just_compiled_and_code_read_from_disk_give_the_same_bits(tmp_path):
    first = run(BATCH, tmp_path)
    assert first[1] == 1
    assert run(BATCH, tmp_path) == (first[0], 0)


def test_a_damaged_cache_is_compiled_again_and_compilation_is_said_once(tmp_path):
    (tmp_path / "small.py").write_text(SMALL)
    cache = tmp_path / "cache"
    first = run(CALL, cache, tmp_path)
    assert first == ("3.0\n", 1)
    assert run(CALL, cache, tmp_path) == (first[0], 0)
    for ending, size in (("nbi", -20), ("nbc", 0)):
        for file in cache.rglob(f"*.{ending}"):
            file.write_bytes(file.read_bytes()[:size])
        assert run(CALL, cache, tmp_path) == first
