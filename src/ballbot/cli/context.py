"""What commands share: reading logs and lists, and long runs with a checkpoint and a cluster."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path

from ballbot.errors import InputError
from ballbot.fitting.checkpoint import CheckpointError, open_checkpoint
from ballbot.fitting.run import Executor, ExecutorError, Run, Threads
from ballbot.log import Log
from ballbot.log.pose import with_position
from ballbot.printable import shell_line
from ballbot.robot import Robot

_MOST = 100_000


def parse_seeds(text: str) -> list[int]:
    """Return the seeds that a text lists, each once.

    Raises
    ------
    InputError
        Where it lists none, or too many.
    """
    seeds: dict[int, None] = {}
    for part in text.split(","):
        found = re.fullmatch(r"\s*(\d{1,9})(?:-(\d{1,9}))?\s*", part)
        first, last = (int(found[1]), int(found[2] or found[1])) if found else (1, 0)
        if last < first or last - first >= _MOST or len(seeds) > _MOST:
            raise InputError(
                f"The seeds are {text!r}; write them as 1-200 or 1,4,7-9, at most {_MOST} seeds."
            )
        seeds.update(dict.fromkeys(range(first, last + 1)))
    return list(seeds)


CHECKPOINT = "checkpoint.jsonl"


@contextmanager
def long_run(
    folder: Path,
    *,
    words: Sequence[str],
    belongs_to: Mapping[str, str],
    resume: bool,
    cluster: str | None = None,
    seed: int = 0,
) -> Iterator[Run]:
    """Keep a checkpoint in the folder while the block runs, and delete it when the block has ended well or refused.

    Parameters
    ----------
    folder : Path
    words : sequence of str
        The command line that makes the run, without --cluster and --resume.
    belongs_to : mapping of str to str
        What the run is of; see `ballbot.fitting.checkpoint.identity`.
    resume : bool
        Go on with the folder's checkpoint.
    cluster : str, optional
        The address of a Dask scheduler; the threads of this process do the work where it is not given.
    seed : int, optional

    Yields
    ------
    Run
        Nobody watches its progress.

    Raises
    ------
    InputError
        Where the folder's checkpoint is another run's or not to be resumed, or there is no such cluster.
    KeyboardInterrupt
        With a sentence that says how to go on.
    """
    checkpoint = open_checkpoint(folder / CHECKPOINT, belongs_to=belongs_to, resume=resume)
    try:
        with _executor(cluster) as executor:
            yield Run(seed=seed, executor=executor, checkpoint=checkpoint)
    except KeyboardInterrupt:
        on_cluster = ["--cluster", cluster] if cluster else []
        command = shell_line([*words, *on_cluster, "--resume"])
        raise KeyboardInterrupt(f"interrupted; continue with: {command}") from None
    except InputError as refusal:
        if not _may_go_on(refusal):
            checkpoint.remove()
        raise
    checkpoint.remove()


def _may_go_on(refusal: InputError) -> bool:
    """Return whether the checkpoint is of use after a refusal; an input that is refused would be refused again."""
    of_a_disk = isinstance(refusal.__context__, OSError)  # the inputs have been read, so that a write failed
    return of_a_disk or isinstance(refusal, CheckpointError | ExecutorError)


def _executor(cluster: str | None) -> AbstractContextManager[Executor]:
    if cluster is None:
        return nullcontext(Threads())
    from ballbot.fitting.cluster import Cluster

    return Cluster(cluster)


def read_logs(paths: Sequence[Path], mapping: Path | None) -> dict[str, Log]:
    """Return the logs by their names; see `named_files`.

    Raises
    ------
    InputError
        Where there is none, one is named twice or cannot be read.
    """
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
    log = Log.read(path, mapping=mapping)
    try:
        return with_position(log, robot)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def named_files(paths: Sequence[Path]) -> dict[str, Path]:
    """Return logs' files by their stems, with their folders before them where stems recur.

    Raises
    ------
    InputError
        Where there is none, or one is named twice.
    """
    if not paths:
        raise InputError("No log is given. Name one or more log files after the robot.")
    stems = [path.stem for path in paths]
    names = stems if len(set(stems)) == len(stems) else [str(path.with_suffix("")) for path in paths]
    for path, name in zip(paths, names, strict=True):
        if names.count(name) > 1:
            raise InputError(f"The log {path} is given twice. Name each file once.")
    return dict(zip(names, paths, strict=True))


def names_listed(names: str) -> tuple[str, ...]:
    """Return names that stand with commas between."""
    return tuple(name.strip() for name in names.split(",") if name.strip())
