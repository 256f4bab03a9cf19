"""The first call: what `ballbot check` compiles where nothing is compiled yet."""

import subprocess
import sys

import numpy as np
import pytest

from ballbot.mechanics.model import Model
from ballbot.robot import Robot

#: prints the compiled functions that a command called from Python
SCRIPT = """
import contextlib, io, sys
from ballbot.cli.main import main
with contextlib.redirect_stdout(io.StringIO()):
    main(["check", "alten"])
from numba.core.dispatcher import Dispatcher
for name, module in list(sys.modules.items()):
    if name.startswith("ballbot.mechanics"):
        for key, value in vars(module).items():
            if isinstance(value, Dispatcher) and value.signatures and value.__module__ == name:
                print(key, len(value.signatures))
"""


@pytest.mark.slow
def test_check_needs_one_compiled_function() -> None:
    # compiling it takes 2.4 s of processor time, and the general ones for any state and formulation 5 s more
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == ["evaluate_upright 1"]


def test_upright_equals_the_general_equations_there() -> None:
    model, origin = Model(Robot.load("alten")), np.zeros(5)
    linear, M, W = model.linearize(), model.mass_matrix(origin), model.wheel_jacobian(origin)
    # the same operations, which the compiler may order in another way
    np.testing.assert_allclose(linear.B[5:], np.linalg.solve(M, W.T), rtol=1e-13)
