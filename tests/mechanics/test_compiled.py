"""Compiled code on disk: said where it is made, read where it is whole."""

import os
import subprocess
import sys

SHAPE = """
import sys
sys.stderr.isatty = lambda: True
from ballbot.mechanics.friction_laws import Classical
from ballbot.simulation.driveline import Driveline, simulate_driveline
law = Classical(viscous=0.01, coulomb=0.1, stribeck=0.05, stribeck_speed=0.6)
print(simulate_driveline(Driveline(inertia=1e-3, friction=law), [0.3], sample_time=0.01).speeds)
"""


def test_a_damaged_cache_is_compiled_again_and_compilation_is_said_once(tmp_path):
    def run() -> tuple[str, int]:
        done = subprocess.run(
            [sys.executable, "-c", SHAPE],
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
        (file,) = tmp_path.rglob(f"*.{ending}")
        file.write_bytes(file.read_bytes()[:size])
        assert run() == first
