"""Compiled code on disk: said where it is made, read where it is whole."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.paths import ROOT

#: a function that is soon compiled
SMALL = """
import sys
sys.stderr.isatty = lambda: True
import numpy as np
from ballbot.twin.driveline import _stribeck_sizes
numbers, sizes = np.arange(1.0, 4.0), np.empty(3)
_stribeck_sizes(numbers, numbers, numbers, 1.5, 1.1, sizes)
print(sizes)
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


def run(program: str, cache: Path) -> tuple[str, int]:
    """Return what a program prints with compiled code in that folder, and how often it says that it compiles."""
    done = subprocess.run(
        [sys.executable, "-c", program],
        env=os.environ | {"NUMBA_CACHE_DIR": str(cache)},
        cwd=ROOT,
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
    first = run(SMALL, tmp_path)
    assert first[1] == 1
    assert run(SMALL, tmp_path) == (first[0], 0)
    for ending, size in (("nbi", -20), ("nbc", 0)):
        for file in tmp_path.rglob(f"*.{ending}"):
            file.write_bytes(file.read_bytes()[:size])
        assert run(SMALL, tmp_path) == first
