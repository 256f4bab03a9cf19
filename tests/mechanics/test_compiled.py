"""Compiled code on disk: said where it is made, read where it is whole."""

import os
import subprocess
import sys

#: a function that is soon compiled, and another one that it calls
SMALL = """
import sys
sys.stderr.isatty = lambda: True
import numpy as np
from ballbot.identification.swing import follow_pendulum
t, angles, rates = np.arange(3.0), np.empty(3), np.empty(3)
follow_pendulum(1.0, 0.1, 0.01, 0.2, 0.0, t, 0.05, angles, rates)
print(angles)
"""


def test_a_damaged_cache_is_compiled_again_and_compilation_is_said_once(tmp_path):
    def run() -> tuple[str, int]:
        done = subprocess.run(
            [sys.executable, "-c", SMALL],
            env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)},
            capture_output=True,
            text=True,
            check=True,
        )
        return done.stdout, done.stderr.count("compiles")

    first = run()
    assert first[1] == 1
    assert run() == (first[0], 0)
    for ending, size in (("nbi", -20), ("nbc", 0)):
        for file in tmp_path.rglob(f"*.{ending}"):
            file.write_bytes(file.read_bytes()[:size])
        assert run() == first
