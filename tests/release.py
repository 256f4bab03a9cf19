"""`python -m tests.release wheel` and `lowest`: Ballbot installed into empty environments, and tried.

`wheel` builds the source archive and from it the wheel, has twine check both, installs the wheel alone, and runs
commands that need every kind of file in it. `lowest` installs
Ballbot with the lowest versions that pyproject.toml allows of what it depends on (chosen by uv), and runs the same
commands and a selection of fast tests, which use each package. Both need a package index.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
import tomllib
import venv
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).parents[1]
EXTRAS = "twin,formats,view,interop,vision,link,stream"
#: what the tests themselves import, and the options in pyproject.toml need
TOOLS = ("pytest>=8", "pytest-xdist>=3.5", "pytest-timeout>=2.3", "hypothesis>=6.100")
#: tests of each package that Ballbot depends on, without long compilation
TESTS = (
    "tests/cli/test_output_options.py",  # cyclopts, rich
    "tests/mechanics/test_stick_slip.py",  # numba
    "tests/robot/test_file.py",  # pydantic, tomli-w
    "tests/log/test_formats.py",  # pyarrow, pandas
    "tests/log/test_frames.py",  # pandas
    "tests/log/test_message_formats.py",  # mcap, rosbags
    "tests/control/test_lqr.py",  # scipy, control
    "tests/vision/test_parts.py",  # opencv
    "tests/link/test_codec.py",  # cobs, fastcrc
    "tests/link/test_stream.py",  # foxglove-sdk
    "tests/fitting/test_run.py",  # processes
    "tests/viewer/test_server.py",  # websockets
)


def main() -> None:
    """Build, install and try."""
    parser = argparse.ArgumentParser(prog="python -m tests.release", description=__doc__)
    parser.add_argument("what", choices=("wheel", "lowest"))
    what = parser.parse_args().what
    with tempfile.TemporaryDirectory(prefix="ballbot-release-") as folder:
        (try_wheel if what == "wheel" else try_lowest)(Path(folder))


def try_wheel(folder: Path) -> None:
    """Build and check what is published, install the wheel and what it needs alone, and try the commands."""
    wheel = _checked_wheel(folder)
    python = _environment(folder / "environment")
    _run(python, "-m", "pip", "install", "--quiet", wheel)
    # a first simulation with an empty cache
    begun, kept = time.monotonic(), folder / "kept"
    line = "simulate alten --reference circle --duration 20 --out first"
    _run(python, "-m", "ballbot", *line.split(), cwd=folder, NUMBA_CACHE_DIR=str(kept))
    print(f"{time.monotonic() - begun:6.1f} s  ballbot {line}, with compilation", flush=True)
    assert any(kept.rglob("*.nbc")), "no compiled code was kept for the next start"
    try_commands(python, folder)


def _checked_wheel(folder: Path) -> Path:
    """Build the source archive, and from it alone the wheel; stop if twine has anything against either."""
    # by an environment without Ballbot's dependencies, as a user's is: the build must bring its own
    builder = _environment(folder / "builder")
    _run(builder, "-m", "pip", "install", "--quiet", "build", "twine")
    _run(builder, "-m", "build", "--outdir", folder, ROOT)
    (wheel,), (archive,) = folder.glob("ballbot-*.whl"), folder.glob("ballbot-*.tar.gz")
    print(_run(builder, "-m", "twine", "check", "--strict", wheel, archive), end="", flush=True)
    return wheel


def try_lowest(folder: Path) -> None:
    """Install the lowest versions of what Ballbot depends on, and try commands and tests."""
    python = _environment(folder / "environment")
    _run(python, "-m", "pip", "install", "--quiet", "uv")
    uv = [python, "-m", "uv", "pip"]
    chosen = folder / "lowest.txt"
    extras = [word for extra in EXTRAS.split(",") for word in ("--extra", extra)]
    lowest = ("--resolution", "lowest-direct", "--quiet", "--output-file", chosen)
    _run(*uv, "compile", *lowest, *extras, ROOT / "pyproject.toml")
    print(chosen.read_text(encoding="utf-8"))
    _run(*uv, "install", "--quiet", "--python", python, "-r", chosen, *TOOLS)
    _run(*uv, "install", "--quiet", "--python", python, "--no-deps", ROOT)
    try_commands(python, folder)
    # as for users: old packages beside new ones give warnings that Python shows in tests only
    as_users = ("-W", "ignore::DeprecationWarning")
    _run(python, "-m", "pytest", "-q", "-x", *as_users, "-m", "not slow and not sample", *TESTS, cwd=ROOT)


def try_commands(python: Path, folder: Path) -> None:
    """Run commands that need every kind of file in the package, and look at what they give."""
    work = folder / "work"
    work.mkdir()

    def ballbot(line: str) -> str:
        begun = time.monotonic()
        made = _run(python, "-m", "ballbot", *line.split(), cwd=work)
        print(f"{time.monotonic() - begun:6.1f} s  ballbot {line}", flush=True)
        return made

    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert ballbot("-V").strip() == project["version"]
    assert "ballbot study" in ballbot("")
    assert 3.0 < json.loads(ballbot("check alten --json"))["unstable_pole"] < 10.0  # [rad/s]
    ballbot("new mine --from rezero")
    ballbot("completion bash")
    ballbot("demo --no-browser --out demo")
    assert {"demo.html", "report.html"} <= {path.name for path in (work / "demo").iterdir()}
    ballbot("design alten --out designed")
    ballbot("export designed/controller.toml --robot alten --out firmware")
    assert any((work / "firmware").rglob("*.c"))
    ballbot("simulate alten --reference hold --duration 2 --out run")
    ballbot("view run/log.csv --robot alten --save replay.html")
    assert ballbot("check-log run/log.csv --robot alten --json").startswith("{")


def _environment(folder: Path) -> Path:
    """Make an empty environment and return its Python."""
    venv.create(folder, with_pip=True)
    return folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")


def _run(*words: object, cwd: Path | None = None, **variables: str) -> str:
    """Run a command outside this environment and return what it prints; stop with its messages if it fails."""
    own = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
    own |= variables
    line: Sequence[str] = [str(word) for word in words]
    done = subprocess.run(line, cwd=cwd, env=own, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"{' '.join(line)}\n{done.stdout[-4000:]}{done.stderr[-4000:]}\nfailed: {done.returncode}")
    return done.stdout


if __name__ == "__main__":
    main()
