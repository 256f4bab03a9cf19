"""The process that tries inputs: one line of JSON for what became of each (`campaigns.fuzz`)."""

from __future__ import annotations

import json
import os
import re
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable
from contextlib import contextmanager
from pathlib import Path
from random import Random

from ballbot.errors import InputError
from campaigns.fuzz_mutations import mutated

#: what an input may take [s], and what memory beside the process's own [bytes]
SECONDS, BYTES = 10.0, 2 * 2**30
_LONGEST_SENTENCE = 20_000

Try = Callable[[int], None]


class TooLongError(BaseException):
    """An input has taken `SECONDS`; no loader catches it."""


def target_names() -> tuple[str, ...]:
    """Return the names of all targets."""
    from campaigns.fuzz_targets import targets

    return (*targets(), "command line")


def attempt(name: str, seed: int, folder: Path) -> Try:
    """Return what tries the input of that number; it returns, or raises `InputError` or what is a failure."""
    if name == "command line":
        from campaigns.fuzz_commands import Commands

        return Commands(seed, folder).attempt
    from campaigns.fuzz_targets import targets

    target = targets()[name]
    for content in (
        target.samples
    ):  # what is compiled once counts for no input, and every sample is one that is accepted
        path = folder / f"sample{target.suffix}"
        path.write_bytes(content)
        target.judge(path)

    def judge(number: int) -> None:
        random = Random(f"{seed} {name} {number}")
        path = folder / f"input{target.suffix}"
        path.write_bytes(mutated(random.choice(target.samples), random))
        target.judge(path)

    return judge


@contextmanager
def limits():
    """Bound the memory and make warnings errors while the block runs; files need not outlive the machine."""
    status = Path("/proc/self/status").read_text()
    found = re.search(r"VmSize:\s*(\d+)", status)
    before, sync = resource.getrlimit(resource.RLIMIT_AS), os.fsync
    own = 1024 * int(found[1]) if found else 4 * 2**30
    resource.setrlimit(resource.RLIMIT_AS, (own + BYTES, before[1]))
    os.fsync = lambda _: None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.simplefilter("ignore", DeprecationWarning)
            warnings.simplefilter("ignore", ResourceWarning)
            yield
    finally:
        os.fsync = sync
        resource.setrlimit(resource.RLIMIT_AS, before)


def outcome(attempted: Try, number: int) -> dict[str, object]:
    """Return what became of an input, as `campaigns.fuzz.Outcome` has it."""

    def stop(*_: object) -> None:
        raise TooLongError

    signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, SECONDS)
    began = time.perf_counter()
    kind, words = "accepted", ""
    try:
        attempted(number)
    except InputError as error:
        text = str(error)
        whole = text and text.isprintable() and len(text) < _LONGEST_SENTENCE
        kind, words = ("refused", text[:200]) if whole else ("failed", f"no sentence: {text[:200]!r}")
    except (KeyboardInterrupt, TooLongError) as error:
        kind, words = "failed", f"takes more than {SECONDS:g} s: {type(error).__name__} {_place(error)}"
    except BaseException as error:
        kind, words = "failed", f"{type(error).__name__}: {str(error)[:300]} {_place(error)}"
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
    return {"kind": kind, "words": words, "seconds": round(time.perf_counter() - began, 3)}


def _place(error: BaseException) -> str:
    frames = traceback.extract_tb(error.__traceback__)
    ours = [frame for frame in frames if "ballbot" in frame.filename or "campaigns" in frame.filename]
    return " < ".join(f"{Path(frame.filename).name}:{frame.lineno}" for frame in reversed(ours[-3:]))


def show(name: str, seed: int, number: int) -> None:
    """Print what becomes of one input, with its traceback; the input stays in a folder that is named."""
    folder = Path(tempfile.mkdtemp())
    try:
        attempt(name, seed, folder)(number)
        print("accepted")
    except InputError as error:
        print(f"refused: {error}")
    except Exception:
        traceback.print_exc()
    print(folder)


def main(name: str, seed: int, first: int, end: int) -> None:
    """Try the inputs `first` to `end` - 1."""
    channel = os.fdopen(os.dup(1), "w")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # nothing else writes to the parent
    memory = Path("/dev/shm")
    folder = Path(tempfile.mkdtemp(dir=memory if memory.is_dir() else None))
    try:
        attempted = attempt(name, seed, folder)
        with limits():
            for number in range(first, end):
                print(json.dumps(outcome(attempted, number)), file=channel, flush=True)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    main(sys.argv[1], *map(int, sys.argv[2:5]))
