"""How Ballbot's wheel is built: by setuptools, with the machine code of first calls in it.

The build runs the commands below and keeps what they compile, for its own versions of Python and Numba
(`ballbot.mechanics.engine.shipped`). The wheel installs anywhere; where its code does not fit, it is ignored. The build
needs what Ballbot needs at run time. An editable installation needs setuptools alone and has no such code;
BALLBOT_WITHOUT_MACHINE_CODE=1 leaves it out of a wheel.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

from setuptools import build_meta
from setuptools.build_meta import *  # noqa: F403 (the hooks that stay as they are)
from setuptools.command.build_py import build_py

ROOT = Path(__file__).parents[1]
#: what new users run first; each function that these commands compile is shipped
FIRST_CALLS = (
    "simulate alten --reference square --duration 12 --out {folder}/run",
    "simulate alten --scenario nominal --duration 1 --out {folder}/sensed",
    "check alten",
    "check-log {folder}/run/log.csv --robot alten",
    "demo --no-browser --out {folder}/demo",
    "identify alten {folder}/run/log.csv --law coulomb --out {folder}/found",
    "design alten --kind precise --out {folder}/precise",
    "simulate {folder}/found/robot.toml --controller {folder}/precise/controller.toml --duration 1 --out {folder}/held",
    "validate {folder}/found/robot.toml {folder}/run/log.csv --out {folder}/checked",
)


def _without_code() -> bool:
    return os.environ.get("BALLBOT_WITHOUT_MACHINE_CODE") == "1"


def get_requires_for_build_wheel(config_settings: dict | None = None) -> list[str]:
    """Return what the wheel's build needs: what Ballbot needs, since it runs."""
    own = build_meta.get_requires_for_build_wheel(config_settings)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return own if _without_code() else [*own, *project["dependencies"]]


class BuildPy(build_py):
    """Collect the package's files, and the machine code of a first call."""

    def run(self) -> None:
        """Collect them; for an editable installation there is nothing to do."""
        super().run()
        if self.editable_mode:
            return
        package = Path(self.build_lib).resolve()
        code = package / "ballbot" / "machine_code"
        shutil.rmtree(code, ignore_errors=True)  # an earlier build's
        if _without_code():
            return
        with tempfile.TemporaryDirectory(prefix="ballbot-build-") as folder:
            # the package as built, its metadata, and pip's isolated environment
            parts = (str(package), str(ROOT / "src"), os.environ.get("PYTHONPATH", ""))
            path = os.pathsep.join(filter(None, parts))
            own = os.environ | {"PYTHONPATH": path, "NUMBA_CACHE_DIR": folder}
            done = subprocess.run([sys.executable, __file__, code, folder], env=own, cwd=folder, check=False)
        if done.returncode:
            print(
                "warning: the wheel has no machine code; first calls will compile what they need.", flush=True
            )


def main(code: Path, folder: Path) -> None:
    """Run the first calls for the baseline's processor, and write what they compiled to `code`."""
    from ballbot.mechanics.engine.shipped import baseline

    chosen = baseline()
    if chosen is None:
        print("No machine code is made for this kind of processor.")
        return
    from numba import config

    config.CPU_NAME, config.CPU_FEATURES = (
        chosen.cpu,
        "",
    )  # before Numba chooses, which it does when it first compiles
    from numba.core.registry import cpu_target

    from ballbot.cli.main import main as ballbot

    for line in FIRST_CALLS:
        if ballbot(line.format(folder=folder).split()):
            sys.exit(f"failed: ballbot {line}")
    assert chosen.cpu in cpu_target.target_context.codegen().magic_tuple()
    for shipped, signature, compiled in _compiled():
        shipped.save(code, signature, compiled)


def _compiled() -> list[tuple]:
    """Return each function that was compiled for Python to call, with the types of its arguments and its code."""
    from numba.core.dispatcher import Dispatcher

    modules = [module for name, module in sys.modules.items() if name.startswith("ballbot.")]
    found = {
        id(value): value
        for module in modules
        for value in vars(module).values()
        if isinstance(value, Dispatcher)
    }
    return [
        (dispatcher._cache.shipped, signature, code)
        for dispatcher in found.values()
        if getattr(dispatcher._cache, "shipped", None) is not None
        for signature, code in dispatcher.overloads.items()
    ]


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
