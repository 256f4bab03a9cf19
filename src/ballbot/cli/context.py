"""The command context: what every command needs around its own work.

    with open_result(out, command="align", writes=_WRITTEN, inputs=[log, mocap, mapping]) as result:
        with result.progress("aligning") as bar:
            found = align_log(run, film)
        with result.replaced() as new:
            result.write_json(found.to_dict(), new, findings=findings)
    result.show_file("report.html")

The provenance of a result is the command line itself (`main` records it), without the options that do not change the
result. A long run (`open_long_result`) has a checkpoint in the folder, an executor and a way back after Ctrl-C. Logs
and lists of seeds are read here, too.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter, Token
from rich.console import Console, RenderableType

from ballbot.cli import ARGV, OUTPUT
from ballbot.cli.app import OUTPUT_OPTIONS
from ballbot.cli.output import Bar, print_parts, progress_bar, standard_output
from ballbot.errors import InputError, either
from ballbot.file_formats import results_text
from ballbot.files import write_text
from ballbot.findings import Finding, finding_results
from ballbot.fitting.run import Executor, ExecutorError, Run, Threads
from ballbot.log.collection import named_files
from ballbot.log.formats import WRITTEN_FORMATS
from ballbot.log.formats.bag import is_bag_folder
from ballbot.printable import shell_line
from ballbot.progress import ProgressCallback
from ballbot.report.provenance import Provenance, provenance
from ballbot.result_folder import ResultFolder, result_folder
from ballbot.robot import Robot

if TYPE_CHECKING:
    from ballbot.log import Log
    from ballbot.report.blocks import Report

CHECKPOINT = "checkpoint.jsonl"
#: the robot file beside a log
ROBOT_BESIDE = "robot.toml"
#: the page that every result has
PAGE = "report.html"

_MAX_SEEDS = 100_000
#: options that do not change a result, with the number of tokens that follow each
_WITHOUT_EFFECT = {"--resume": 0, "--cluster": 1} | dict.fromkeys(OUTPUT_OPTIONS, 0)


def _whole_number(_: type, tokens: Sequence[Token]) -> int:
    """Return the whole number that is given; 1.5 is refused, where cyclopts would round it."""
    given = tokens[0].value
    if not re.fullmatch(r"[+-]?\d+", given):
        raise ValueError(f"{given!r} is not a whole number.")
    return int(given)


def _positive_number(_: type, tokens: Sequence[Token]) -> float:
    """Return the number that is given, if it is finite and above 0."""
    given = tokens[0].value
    try:
        number = float(given)
    except ValueError:
        number = math.nan
    if not 0.0 < number < math.inf:
        raise ValueError(f"{given!r} is not a number above 0.")
    return number


#: the length of a live run
Seconds = Annotated[float, Parameter(converter=_positive_number)]

#: every integer option
WholeNumber = Annotated[int, Parameter(converter=_whole_number)]

#: each log of a command that needs one or more
LogPath = Annotated[Path, Parameter(required=True)]

#: the option --format of the commands that write logs, checked by `ballbot.log.formats.check_format`
LogFormatName = Annotated[
    str, Parameter(help=f"File format of the log and other time series: {either(WRITTEN_FORMATS)}.")
]


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """Options of a long run."""

    resume: Annotated[bool, Parameter(negative="")] = False
    """Continue an interrupted run in the same folder."""

    cluster: str | None = None
    """The address of a Dask scheduler on which the work runs, such as tcp://10.0.0.5:8786."""


#: no --resume and no --cluster
RUN_HERE = RunOptions()


def argv() -> list[str]:
    """Return the command line that makes the running command's result: without options that do not change it."""
    tokens: list[str] = []
    skip = 0
    for word in ARGV.get():
        name, has_value, _ = word.partition("=")
        if skip:
            skip -= 1
        elif name in _WITHOUT_EFFECT:
            skip = 0 if has_value else _WITHOUT_EFFECT[name]
        else:
            tokens.append(word)
    return ["ballbot", *tokens]


def input_files(*given: str | Path | Sequence[str | Path] | None) -> list[Path]:
    """Return the files among what a command line names, each once: a preset's name is not a file."""
    paths: dict[Path, None] = {}
    for one in given:
        for name in [one] if isinstance(one, str | Path) else one or ():
            is_there = Path(name).is_file() or is_bag_folder(name)
            if isinstance(name, Path) or (name not in Robot.presets() and is_there):
                paths[Path(name)] = None
    return list(paths)


@dataclass(frozen=True, kw_only=True)
class CommandResult:
    """A command's result while it is made: its folder, where it came from, and the console."""

    folder: ResultFolder
    origin: Provenance
    console: Console

    def progress(self, doing: str, *, writing: float = 0.0) -> AbstractContextManager[Bar]:
        """Show progress while a block runs; see `ballbot.cli.output.progress_bar`."""
        return progress_bar(self.console, doing, writing=writing)

    @contextmanager
    def replaced(self) -> Iterator[Path]:
        """Give a folder to write the new files into; see `ballbot.result_folder.ResultFolder.replaced`.

        The results.json among them is what --json prints.
        """
        with self.folder.replaced() as new:
            yield new
        written = self.folder.path / "results.json"
        if OUTPUT.get().json and written.exists():
            OUTPUT.get().results = written.read_text(encoding="utf-8")

    def write_json(
        self, results: Mapping[str, object], folder: Path, *, findings: Collection[Finding] | None = None
    ) -> None:
        """Write results.json into a folder, with the findings if there are any to show, and the provenance."""
        whole = dict(results)
        if findings is not None:
            whole["findings"] = finding_results(findings)
        write_text(folder / "results.json", results_text(whole | {"provenance": self.origin}))

    def write_page(self, report: Report, folder: Path) -> None:
        """Write report.html into a folder."""
        from ballbot.report.page import page_of  # with templates and scripts, which a refusal does without

        write_text(folder / PAGE, page_of(report))

    def show(self, parts: Iterable[RenderableType]) -> None:
        """Print tables and lines."""
        print_parts(parts, self.console)

    def show_file(self, *names: str) -> None:
        """Print where files of the result are."""
        for name in names:
            self.console.print(str(self.folder.path / name), markup=False, soft_wrap=True)


@dataclass(frozen=True, kw_only=True)
class LongResult(CommandResult):
    """The result of a run that may take hours."""

    run: Run  #: nobody watches its progress

    def run_with(self, progress: ProgressCallback) -> Run:
        """Return the run context whose progress is watched."""
        return replace(self.run, progress=progress)


@contextmanager
def open_result(
    out: Path,
    *,
    command: str,
    writes: Collection[str],
    inputs: Sequence[Path] = (),
    seed: int | str = 0,
    resumes: bool = False,
) -> Iterator[CommandResult]:
    """Hold a command's folder while the block runs.

    Parameters
    ----------
    out : Path
    command : str
        Whose result it is, as "study".
    writes : collection of str
        The files that the command may write there.
    inputs : sequence of Path
        The files that the result is made from.
    seed : int or str
        For the provenance.
    resumes : bool
        Whether the command goes on with a checkpoint in the folder.

    Raises
    ------
    InputError
        If the folder cannot be used (see `ballbot.result_folder.result_folder`) or an input cannot be read.
    """
    origin = provenance(command=shell_line(argv()), files=inputs, seed=seed)
    with result_folder(out, command=command, names=writes, inputs=inputs, resumes=resumes) as folder:
        yield CommandResult(folder=folder, origin=origin, console=standard_output())


@contextmanager
def open_long_result(
    out: Path,
    *,
    command: str,
    writes: Collection[str],
    inputs: Sequence[Path],
    belongs_to: Mapping[str, str],
    seed: int | str = 0,
    run: RunOptions = RUN_HERE,
) -> Iterator[LongResult]:
    """Hold a command's folder and keep a checkpoint in it, which is deleted when the block ends well or is refused.

    Parameters
    ----------
    out, command, writes, inputs, seed
        As for `open_result`.
    belongs_to : mapping of str to str
        What the run depends on; see `ballbot.fitting.checkpoint.identity`.
    run : RunOptions
        Whether to continue from the folder's checkpoint, and where the work runs: in threads of this process if no
        cluster is given.

    Raises
    ------
    InputError
        As `open_result`; if the checkpoint is another run's or not to be resumed, or there is no such cluster.
    KeyboardInterrupt
        With a sentence that says how to continue.
    """
    work_seed = seed if isinstance(seed, int) else 0
    with (
        open_result(out, command=command, writes=writes, inputs=inputs, seed=seed, resumes=True) as plain,
        long_run(plain.folder.path, belongs_to=belongs_to, options=run, seed=work_seed) as work,
    ):
        yield LongResult(folder=plain.folder, origin=plain.origin, console=plain.console, run=work)


@contextmanager
def long_run(
    folder: Path, *, belongs_to: Mapping[str, str], options: RunOptions = RUN_HERE, seed: int = 0
) -> Iterator[Run]:
    """Keep a checkpoint in a folder while the block runs; it is deleted when the block ends well or is refused.

    Raises
    ------
    InputError
        If the checkpoint is another run's or not to be resumed, or there is no such cluster.
    KeyboardInterrupt
        With a sentence that says how to continue.
    """
    from ballbot.fitting.checkpoint import (
        open_checkpoint,  # with compiled code, which short commands do without
    )

    checkpoint = open_checkpoint(folder / CHECKPOINT, belongs_to=belongs_to, resume=options.resume)
    try:
        with _executor(options.cluster) as executor:
            yield Run(seed=seed, executor=executor, checkpoint=checkpoint)
    except KeyboardInterrupt:
        on_cluster = ["--cluster", options.cluster] if options.cluster else []
        command = shell_line([*argv(), *on_cluster, "--resume"])
        raise KeyboardInterrupt(f"interrupted; continue with: {command}") from None
    except InputError as refusal:
        if not _can_resume(refusal):
            checkpoint.remove()
        raise
    checkpoint.remove()


def _can_resume(refusal: InputError) -> bool:
    """Return whether the checkpoint is of use after a refusal; an input that is refused would be refused again."""
    from ballbot.fitting.checkpoint import CheckpointError

    of_a_disk = isinstance(refusal.__context__, OSError)  # the inputs have been read, so that a write failed
    return of_a_disk or isinstance(refusal, CheckpointError | ExecutorError)


def _executor(cluster: str | None) -> AbstractContextManager[Executor]:
    if cluster is None:
        return nullcontext(Threads())
    from ballbot.fitting.cluster import Cluster

    return Cluster(cluster)


def parse_seeds(text: str) -> list[int]:
    """Return the seeds that a text lists, each once.

    Raises
    ------
    InputError
        If it lists none, or too many.
    """
    seeds: dict[int, None] = {}
    for part in text.split(","):
        found = re.fullmatch(r"\s*(\d{1,9})(?:-(\d{1,9}))?\s*", part)
        first, last = (int(found[1]), int(found[2] or found[1])) if found else (1, 0)
        if last < first or last - first >= _MAX_SEEDS or len(seeds) > _MAX_SEEDS:
            raise InputError(
                f"The seeds are {text!r}; write them as 1-200 or 1,4,7-9, at most {_MAX_SEEDS} seeds."
            )
        seeds.update(dict.fromkeys(range(first, last + 1)))
    return list(seeds)


def read_logs(paths: Sequence[Path], mapping: Path | None) -> dict[str, Log]:
    """Return the logs by their names; see `ballbot.log.collection.named_files`.

    Raises
    ------
    InputError
        If no log is given, one is named twice or cannot be read.
    """
    from ballbot.log import Log

    return {name: Log.read(path, mapping=mapping) for name, path in named_files(paths).items()}


def read_balancing_logs(paths: Sequence[Path], mapping: Path | None, robot: Robot) -> dict[str, Log]:
    """Return logs by their names, each with the ball's position: its own, else that by its wheels.

    Raises
    ------
    InputError
        As `read_logs`; and if a log has no position and lacks what gives it.
    """
    return {name: read_balancing_log(path, mapping, robot) for name, path in named_files(paths).items()}


def read_balancing_log(path: Path, mapping: Path | None, robot: Robot) -> Log:
    """Return one log with the ball's position; see `read_balancing_logs`."""
    from ballbot.log import Log
    from ballbot.log.pose import with_position

    log = Log.read(path, mapping=mapping)
    try:
        return with_position(log, robot)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def robot_beside(log: Path) -> Robot | None:
    """Return the robot in the file robot.toml beside a log; None if there is no such file."""
    beside = log.parent / ROBOT_BESIDE
    return Robot.load(str(beside)) if beside.is_file() else None
