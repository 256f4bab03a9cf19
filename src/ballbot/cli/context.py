"""The command context: what every command needs around its own work.

    with open_result(out, doing="aligning") as result:
        alignment = align_log(run, mocap)
        result.write(alignment_report(alignment))

The provenance of a result is the command line (`main` records it) and the files that it names. Logs and lists of seeds
are also read here.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

from rich.console import Console, RenderableType

from ballbot.cli import ARGV
from ballbot.cli.output import WRITING, emit, print_parts, progress_bar, standard_output, suggest_page
from ballbot.errors import InputError, about
from ballbot.files import write_bytes, write_text
from ballbot.log import Log
from ballbot.log.collection import named_files
from ballbot.log.formats import is_bag_folder
from ballbot.log.pose import with_position
from ballbot.printable import shell_line
from ballbot.progress import Progress, ProgressCallback, ignore_progress
from ballbot.report.blocks import PAGE, RESULTS, Provenance, provenance
from ballbot.result_folder import ResultFolder, result_folder
from ballbot.robot import Robot, RobotLike, as_robot
from ballbot.robot.file import robot_text

if TYPE_CHECKING:
    from ballbot.identification.result import Verdict
    from ballbot.report.blocks import Result

_MAX_SEEDS = 100_000


def changed_robot(source: RobotLike, changes: Sequence[str] | None) -> Robot:
    """Return a robot, the preset of that name or the robot in that file, with the values of --set.

    Raise InputError if there is no such robot, a change is not NAME=VALUE, or the robot cannot have the value.
    """
    values = {}
    for change in changes or ():
        name, _, text = change.partition("=")
        try:
            values[name.strip()] = tomllib.loads(f"value = {text}")["value"]
        except tomllib.TOMLDecodeError:
            raise InputError(
                f"--set {change}: it must be a name and a value, such as body.mass=9.0 or friction.coulomb=0.1."
            ) from None
    return as_robot(source).replace(values)


def robot_words(source: str, changes: Sequence[str] | None) -> str:
    """Return a robot and its changes as words of a command line."""
    return shell_line([source, *(word for change in changes or () for word in ("--set", change))])


def input_files(words: Sequence[str], beside: Sequence[Path] = ()) -> list[Path]:
    """Return the files that a command line names, each once, then those beside them.

    A file may stand in a list with commas, after NAME= and before @ESTIMATOR or :NAME. A preset's name is not a file.
    """
    parts = [part.strip() for word in words for part in (word, *re.split(r"[=,]|[@:][^@:/]*$", word))]
    named = [part for part in parts if Path(part).is_file() or is_bag_folder(part)]
    return list(dict.fromkeys([*(Path(name) for name in named if name not in Robot.presets()), *beside]))


#: a file's content, or what writes it at a path
Content = str | bytes | Callable[[Path], object]


@dataclass(frozen=True, kw_only=True)
class CommandResult:
    """The context of a command's result: its folder, provenance, console and progress."""

    folder: ResultFolder | None  #: None without --out
    origin: Provenance
    console: Console
    report: ProgressCallback

    def path(self, name: str) -> str:
        """Return the path of a file of the result; its name without a folder."""
        return str(self.folder.path / name) if self.folder else name

    def write(
        self,
        result: Result,
        *,
        files: Mapping[str, Content] = MappingProxyType({}),
        printed: Iterable[RenderableType] | None = None,  # for the terminal, instead of the page's parts
        named: Sequence[str] = (),  # files whose paths are printed before the page's
        next_step: str = "",  # what to do next, with the commands for it
    ) -> None:
        """Write results.json, report.html and other files by their names, all of them or none; then print the page.

        With a folder, the terminal shows `Result.parts` in brief, otherwise all of them.
        """
        despite = [("Despite an accepted error", text) for text in result.accepted_errors]
        verdict = [*despite, *result.verdict]
        result = replace(result, provenance=self.origin, next_step=next_step, verdict=verdict)
        if self.folder is not None:
            self.report(Progress(stage=WRITING))
            # imported late: an error needs no templates and scripts
            from ballbot.report.page import render

            with self.folder.replaced() as new:
                render(result, new)
                for name, content in files.items():
                    _write(new / name, content)
        emit(result.to_dict())
        parts = result.parts(brief=self.folder is not None) if printed is None else printed
        print_parts(parts, self.console)
        if self.folder is not None:
            print_parts(map(self.path, (*named, PAGE)), self.console)
        if next_step:
            print_parts([f"Next: {next_step}"], self.console)

    def write_robot(self, result: Result, robot: Robot, verdict: Verdict, *, next_step: str) -> None:
        """Write and print an identification; write robot.toml if it is usable, else raise InputError."""
        files = {"robot.toml": robot_text(robot)} if verdict.usable else {}
        self.write(result, files=files, named=[*files], next_step=next_step if files else "")
        if not files:
            raise InputError(f"{verdict.sentence} No robot.toml was written.")


def _write(path: Path, content: Content) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    if callable(content):
        content(path)
    else:
        write_bytes(path, content) if isinstance(content, bytes) else write_text(path, content)


@contextmanager
def open_result(
    out: Path | None,  # without it, the results are printed only
    *,
    command: str = "",  # such as "run wiring"; that of the command line if not given
    doing: str = "",  # the label of the progress bar; no bar without it
    # the files that the command may write there besides report.html and results.json
    writes: Collection[str] = (),
    beside: Sequence[Path] = (),  # input files that the command line does not name
    seed: int | str = 0,  # for the provenance
) -> Iterator[CommandResult]:
    """Lock a command's folder while the block runs, and show the progress.

    Raise InputError if the folder cannot be used (see `ballbot.result_folder.result_folder`) or an input cannot be
    read.
    """
    files, console = input_files(ARGV.get()[1:], beside), standard_output()
    origin = provenance(command=shell_line(["ballbot", *ARGV.get()]), files=files, seed=seed)
    names = {PAGE, RESULTS, *writes}
    command = command or next(iter(ARGV.get()), "")
    lock = result_folder(out, command=command, names=names, inputs=files) if out else None
    bar = progress_bar(console, doing) if doing else nullcontext(ignore_progress)
    with lock or nullcontext() as folder, bar as report:
        yield CommandResult(folder=folder, origin=origin, console=console, report=report)
    if folder is None:
        suggest_page()


def parse_seeds(text: str) -> list[int]:
    """Return the seeds that a text lists, each once; raise InputError if it lists none, or too many."""
    seeds: dict[int, None] = {}
    for part in text.split(","):
        match = re.fullmatch(r"\s*(\d{1,9})(?:-(\d{1,9}))?\s*", part)
        first, last = (int(match[1]), int(match[2] or match[1])) if match else (1, 0)
        if last < first or last - first >= _MAX_SEEDS or len(seeds) > _MAX_SEEDS:
            raise InputError(
                f"The seeds are {text!r}; write them as 1-200 or 1,4,7-9, at most {_MAX_SEEDS} seeds."
            )
        seeds.update(dict.fromkeys(range(first, last + 1)))
    return list(seeds)


def read_logs(paths: Sequence[Path], mapping: Path | None, robot: Robot) -> dict[str, Log]:
    """Return the logs by their names, see `named_files`; InputError without logs, or if a log cannot be read."""
    return {name: Log.read(path, mapping=mapping, robot=robot) for name, path in named_files(paths).items()}


def read_balancing_logs(paths: Sequence[Path], mapping: Path | None, robot: Robot) -> dict[str, Log]:
    """Return logs by their names; see `read_logs` and `read_balancing_log`."""
    return {name: read_balancing_log(path, mapping, robot) for name, path in named_files(paths).items()}


def read_balancing_log(path: Path, mapping: Path | None, robot: Robot) -> Log:
    """Return a log with the ball's position: as logged, else from the wheels.

    Raise InputError if it cannot be read, or has neither a position nor the columns to compute it from.
    """
    log = Log.read(path, mapping=mapping, robot=robot)
    with about(path):
        return with_position(log, robot)
