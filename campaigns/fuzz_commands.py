"""Command lines to fuzz: complete ones with words changed, removed, doubled or added, run in this process.

Computations are replaced by the end of the command, which counts as accepted.
"""

from __future__ import annotations

import io
import os
import shutil
import sys
from contextlib import redirect_stderr, redirect_stdout
from importlib import import_module
from pathlib import Path
from random import Random

from ballbot.cli.main import main
from ballbot.control.file import controller_text
from ballbot.control.presets import nominal_controller
from ballbot.errors import InputError
from ballbot.robot.file import robot_text
from campaigns.fuzz import NUMBERS, WORDS, mutated
from campaigns.fuzz_targets import ALTEN, MAKERS, MAPPING

#: command lines that are accepted, or refused by what their log lacks
LINES = (
    "check robot.toml",
    "check alten --controller controller.toml",
    "check alten --swing log.csv --pivot-distance 0.3 --out out",
    "check-log log.csv --robot alten",
    "check-log raw.txt --mapping mapping.toml --out out",
    "check-log raw.txt --robot rob311 --out out",
    "new mine --from kugle --out new.toml",
    "simulate alten --reference circle --duration 0.05 --controller controller.toml --out out",
    "simulate alten --reference reference.csv --duration 0.02 --compensation full --format parquet --out out",
    "record ideal --robot alten --reference square --duration 0.02 --seed 3 --out out",
    "record scenario.toml --experiment upside_down --duration 0.02 --seeds 1-2 --out out",
    "twin export alten --scenario scenario.toml --mounting stand --out twin.xml",
    "twin scenario nominal --robot alten --out scenario2.toml --force",
    "excite alten --duration 8 --lean 6 --floor 1 --out out",
    "identify alten log.csv --estimate friction --bounds bounds.toml --window 0.25 --seed 1 --out out",
    "identify alten log.csv --sweep sweep.json --out out",
    "identify-axis axis.csv --law viscous --unit rad --gravity --out out",
    "identify-axis axis.mat --force-scale kp --added-force reference --out out",
    "identify-driveline alten log.csv --speed-limit 20 --seed 1 --out out",
    "identify-upside-down alten log.csv --window 1.0 --out out",
    "identify-geometry alten --balancing log.csv --motion-capture film.csv --out out",
    "validate rezero log.csv --seed 1 --out out",
    "validate alten log.csv --controller controller.toml --out out",
    "align log.csv film.csv --out out",
    "spin none.avi --seam thesis --out out",
    "design alten --q 1,1,10,10,1,1,1,1,1,1 --r 2 --sample-time 0.005 --notch 60 --delay 0.01 --out out",
    "design alten --robust --robots 10 --generations 1 --population 4 --fresh 10 --perturb mass=0.2 --out out",
    "limits alten none --grip 0.8 --seed 1 --out out",
    "compare alten none full --scenarios hold,square --seeds 1-2 --plant model --processes 1 --out out",
    "study alten log.csv --bounds bounds.toml --seed 1 --out out",
    "reproduce --out out",
)
#: files of the folder that commands are run in, and the loader whose sample each is
FILES = {
    "log.csv": "log, CSV",
    "raw.txt": "mapped table",
    "scenario.toml": "scenario",
    "bounds.toml": "bounds",
    "reference.csv": "reference",
    "sweep.json": "sweep's results",
    "axis.csv": "axis record, CSV",
    "axis.mat": "axis record, MATLAB",
    "film.csv": "motion capture",
    "courses.toml": "courses",
}
_VALUES = """
robot.toml controller.toml mapping.toml none.csv pipe.csv folder folder.csv empty.csv /dev/zero /dev/full out missing
--out --resume --seed --seeds --mapping --help --accept --cluster --robot --bounds --window --duration
localhost tcp://localhost:0 1-3 3-1 1-999999999 1,1 alten nominal none twin moon friction torque 1e9 0.01
"""
#: what words are replaced by, besides numbers and marks
VALUES = (*FILES, *_VALUES.split())
#: computations, by the module that calls them
WORK = (
    ("ballbot.cli.excite", "find"),
    ("ballbot.cli.identify", "identify_by_law"),
    ("ballbot.cli.identify_axis", "identify_record"),
    ("ballbot.cli.identify_driveline", "fit_drivelines"),
    ("ballbot.cli.identify_upside_down", "find_friction"),
    ("ballbot.cli.identify_geometry", "survey_geometry"),
    ("ballbot.cli.validate", "validate_logs"),
    ("ballbot.cli.align", "align_log"),
    ("ballbot.cli.design", "robust_design"),
    ("ballbot.cli.limits", "find_limits"),
    ("ballbot.cli.compare", "run_league"),
    ("ballbot.cli.study", "run_study"),
    ("ballbot.cli.simulate", "run"),
    ("ballbot.cli.record", "record_run"),
    ("ballbot.thesis.reproduce.campaign", "reproduce"),
)


class WorkBegins(BaseException):
    """The command's input was accepted."""


class Commands:
    """Command lines by number, in a folder of their own."""

    def __init__(self, seed: int, folder: Path) -> None:
        """Write the files, and let work end where it begins."""
        self._seed, self._folder = seed, folder
        self._contents = {name: MAKERS[loader]().samples[0] for name, loader in FILES.items()} | {
            "robot.toml": robot_text(ALTEN).encode(),
            "controller.toml": controller_text(nominal_controller(ALTEN)).encode(),
            "mapping.toml": MAPPING.encode(),
        }
        os.chdir(folder)
        for module, name in WORK:
            setattr(import_module(module), name, _begins)

    def attempt(self, number: int) -> None:
        """Run the command line of that number; InputError where it is refused."""
        random = Random(f"{self._seed} command line {number}")
        self._clean()
        if random.random() < 0.3:  # a damaged file instead of a changed word
            name = random.choice([*self._contents])
            (self._folder / name).write_bytes(mutated(self._contents[name], random))
            line = random.choice([one for one in LINES if name in one] or LINES).split()
        else:
            line = _changed(random.choice(LINES).split(), random)
        run_line(line)

    def _clean(self) -> None:
        for path in self._folder.iterdir():
            shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()
        for name, content in self._contents.items():
            (self._folder / name).write_bytes(content)
        (self._folder / "folder").mkdir()
        (self._folder / "folder.csv").mkdir()
        (self._folder / "empty.csv").touch()
        os.mkfifo(self._folder / "pipe.csv")


def _changed(line: list[str], random: Random) -> list[str]:
    """Return a command line with one to three of its words replaced, removed or added."""
    for _ in range(random.randint(1, 3)):
        place = random.randrange(1, len(line) + 1)
        word = random.choice((*VALUES, *VALUES, *NUMBERS, *WORDS))
        match random.randrange(5):
            case 0:
                line.insert(place, word)
            case 1:
                del line[place : place + 1]
            case _:
                line[place : place + 1] = [word]
    # a zero byte is in no command line of an operating system
    return [word.replace("\0", "") for word in line]


def run_line(words: list[str]) -> None:
    """Run a command line; raise InputError with its sentence if it is refused.

    Raises
    ------
    AssertionError
        If it ends neither with success nor with one sentence.
    """
    out, err = io.StringIO(), io.StringIO()
    began = sys.argv
    try:
        with redirect_stdout(out), redirect_stderr(err):
            code = main(words)
    except WorkBegins:
        return
    except SystemExit as ended:
        raise AssertionError(f"{words}: ends the interpreter with {ended.code!r}") from None
    finally:
        sys.argv = began
    said = err.getvalue()
    assert "Traceback" not in said, f"{words}: {said[-500:]}"
    if code == 0:
        assert "nan" not in out.getvalue().lower().split(), f"{words}: prints nan"
        return
    assert code == 2, f"{words}: exit code {code}"
    assert said.startswith("ballbot: "), f"{words}: {said[:300]!r}"
    assert said.count("\n") == 1, f"{words}: {said[:300]!r}"
    assert said.rstrip("\n").isprintable(), f"{words}: {said[:300]!r}"
    raise InputError(said.strip())


def _begins(*_: object, **__: object) -> None:
    raise WorkBegins
