"""No array corrupts memory: every public function that hands arrays to compiled code is walked under a bounds check.

The walk itself is tests/support/memory_walk.py. It runs in a process of its own with NUMBA_BOUNDSCHECK=1 and an empty
cache, because code that was compiled without the check stays so.
"""

import importlib
import inspect
import json
import os
import pkgutil
import subprocess
import sys

import pytest

import ballbot
from tests.support.paths import ROOT

#: names on front pages that take arrays, and the case of the walk that tries them
WALKED = {
    "ballbot.Controller": "Controller.update",
    "ballbot.Log": "Log",
    "ballbot.Model": "Model.advance",
    "ballbot.simulate": "simulate",
    "ballbot.simulate_batch": "simulate_batch",
    "ballbot.estimation.Fix": "Fix",
    "ballbot.estimation.Reading": "KalmanFilter.update",
    "ballbot.identification.axis.AxisRecord": "AxisRecord",
    "ballbot.log.Log": "Log",
    "ballbot.twin.Twin": "Twin",
}
#: names on front pages that take arrays and hand none of them to compiled code
NOT_COMPILED = {
    "a function in NumPy": {
        "ballbot.identification.axis.record_of_rows",
        "ballbot.lqr",
    },
    "a law, whose methods for arrays are in NumPy": {
        "ballbot.mechanics.friction_laws.Classical",
        "ballbot.robot.Friction",
    },
    "made by the package, from a log or a design": {
        *(f"ballbot.workflows.excite.{name}" for name in ("Design", "LoopRuns", "excite", "task")),
        *(f"ballbot.identification.{name}" for name in ("Identification", "WindowErrors")),
        "ballbot.identification.axis.AxisIdentification",
        *(f"ballbot.validation.{name}" for name in ("ErrorPair", "RecoveredGain", "StateErrors")),
    },
}


def takes_arrays(value: object) -> bool:
    """Return whether a function, a class or one of its public methods has an array among its arguments."""
    calls = [value]
    if inspect.isclass(value):
        methods = inspect.getmembers(value, callable)
        calls = [one for name, one in methods if name == "__init__" or not name.startswith("_")]
    for call in calls:
        try:
            parameters = inspect.signature(call).parameters.values()
        except (TypeError, ValueError):  # a value, or a class written in C
            continue
        if any("ArrayLike" in str(one.annotation) or "NDArray" in str(one.annotation) for one in parameters):
            return True
    return False


def test_every_public_name_that_takes_arrays_is_walked():
    """A new one needs a case in tests/support/memory_walk.py and a line in `WALKED`, or one in `NOT_COMPILED`."""
    packages = ["ballbot"]
    packages += [one.name for one in pkgutil.walk_packages(ballbot.__path__, "ballbot.") if one.ispkg]
    known = set(WALKED).union(*NOT_COMPILED.values())
    unknown = []
    for package in packages:
        module = importlib.import_module(package)
        for name in getattr(module, "__all__", ()):
            if f"{package}.{name}" not in known and takes_arrays(getattr(module, name)):
                unknown.append(f"{package}.{name}")
    assert not unknown


@pytest.mark.sample  # compiles everything anew, with bounds checks
def test_no_wrong_array_reaches_compiled_code(tmp_path):
    root = ROOT
    environment = os.environ | {
        "NUMBA_BOUNDSCHECK": "1",
        "NUMBA_CACHE_DIR": str(tmp_path),
        "NUMBA_OPT": "0",  # a third of the time to compile; the checks are the same
        "PYTHONPATH": os.pathsep.join([str(root / "src"), str(root), os.environ.get("PYTHONPATH", "")]),
    }
    command = [sys.executable, "-W", "ignore", "-m", "tests.support.memory_walk"]
    done = subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    found = json.loads(done.stdout[done.stdout.index("{") :])
    assert "out of bounds" in found["overrun"]  # the check is on: what it does not catch does not happen
    assert found["failures"] == []
    assert found["calls"] > 1500
    # a new compiled function that Python calls needs a case in the walk
    assert found["not reached"] == []
    # each was compiled for one kind of array only, so every array was brought to it
    assert found["other arrays"] == {}
    assert set(WALKED.values()) <= set(found["cases"])
