"""What commands that may run for hours share: a checkpoint, a cluster, and a way back after Ctrl-C."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path

from ballbot.errors import InputError
from ballbot.fitting.checkpoint import CheckpointError, Memoize, open_checkpoint
from ballbot.fitting.run import Executor, ExecutorError, Threads
from ballbot.printable import shell_line

CHECKPOINT = "checkpoint.jsonl"


@dataclass(frozen=True, kw_only=True)
class LongRun:
    """What the work is given."""

    recall: Memoize
    spread: Executor


@contextmanager
def long_run(
    folder: Path,
    *,
    words: Sequence[str],
    belongs_to: Mapping[str, str],
    resume: bool,
    cluster: str | None,
) -> Iterator[LongRun]:
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

    Raises
    ------
    InputError
        Where the folder's checkpoint is another run's or not to be resumed, or there is no such cluster.
    KeyboardInterrupt
        With a sentence that says how to go on.
    """
    checkpoint = open_checkpoint(folder / CHECKPOINT, belongs_to=belongs_to, resume=resume)
    try:
        with _spread(cluster) as spread:
            yield LongRun(recall=checkpoint.recall, spread=spread)
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


def _spread(cluster: str | None) -> AbstractContextManager[Executor]:
    if cluster is None:
        return nullcontext(Threads())
    from ballbot.fitting.cluster import Cluster

    return Cluster(cluster)
