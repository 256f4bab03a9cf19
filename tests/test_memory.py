"""No index of compiled code leaves its array: tests of the compiled functions once more, under Numba's bounds check.

They run in a process of their own with an empty cache, because code that was compiled without the check stays so.
"""

import os
import subprocess
import sys

import pytest

from tests.support.paths import ROOT

#: what calls compiled code with arrays: plants, batches, the loop, the law, estimators, identification
CALLERS = (
    *("tests/test_arrays.py", "tests/mechanics/test_lanes.py", "tests/mechanics/test_stick_slip.py"),
    *("tests/simulation/test_batch.py", "tests/simulation/test_driveline.py", "tests/simulation/test_run.py"),
    *("tests/simulation/test_held_robot.py", "tests/control/test_law.py", "tests/estimation/test_kalman.py"),
    *("tests/identification/test_axis.py", "tests/identification/test_swing.py"),
)
OVERRUN = "import numba, numpy\nnumba.njit(lambda a: a[3])(numpy.zeros(3))"


@pytest.mark.sample  # compiles everything anew, with bounds checks
def test_no_index_is_out_of_bounds(tmp_path):
    environment = os.environ | {
        "NUMBA_BOUNDSCHECK": "1",
        "NUMBA_CACHE_DIR": str(tmp_path),
        "NUMBA_OPT": "0",  # a third of the time to compile; the checks are the same
        "PYTHONPATH": os.pathsep.join([str(ROOT / "src"), str(ROOT), os.environ.get("PYTHONPATH", "")]),
    }
    overrun = subprocess.run([sys.executable, "-c", OVERRUN], env=environment, capture_output=True, text=True)
    assert "IndexError: index is out of bounds" in overrun.stderr  # the check is on
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-o", "addopts=", "-p", "no:cacheprovider"]
    command += ["-m", "not sample and not slow", *CALLERS]
    done = subprocess.run(command, env=environment, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-3000:]
