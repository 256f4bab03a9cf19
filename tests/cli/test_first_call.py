"""The first call: what `ballbot check` compiles where nothing is compiled yet."""

import subprocess
import sys

import pytest

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
def test_check_compiles_nothing() -> None:
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == []
