"""Try damaged inputs on every loader and on the command line; docs/generated/evidence.md has the counts.

.venv/bin/python -m campaigns.fuzz                      the campaign; it continues where it was stopped
.venv/bin/python -m campaigns.fuzz robot 812            one input: its content and its outcome

A worker process tries one input after another and writes a line of JSON for each, so that a crash of the interpreter
is assigned to its input. The worker has 2 GB beside its own memory, and 10 s for an input. An input is accepted, or
refused in one sentence (`InputError`). Everything else is a failure: another exception, a warning, a violated property
(`campaigns.fuzz_targets`), too much memory or time, the end of the process.
"""

from __future__ import annotations

import json
import os
import re
import resource
import selectors
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from random import Random

from ballbot.errors import InputError
from ballbot.files import write_text
from ballbot.fitting.sweep import digest
from campaigns.fuzz_mutations import mutated
from campaigns.section import Section

SEED = 13
#: inputs of each target, the quick ones first
COUNTS = {
    "bounds": 9000,
    "reference": 7000,
    "sweep's results": 5000,
    "axis record, CSV": 5000,
    "axis record, MATLAB": 8000,
    "motion capture": 4000,
    "foreign table": 15000,
    "mapped table": 8000,
    "mapping": 8000,
    "robot": 7000,
    "video": 1000,
    "log, Parquet": 5000,
    "log, CSV": 6000,
    "command line": 3000,
    "scenario": 4000,
    "controller": 3000,
    "courses": 2000,
}
_KEPT = Path(__file__).parent / ".fuzz.json"
#: inputs between two savings of what was counted
_BATCH = 2500
#: what a process may take to start [s]
_START = 120.0


@dataclass(kw_only=True)
class Tally:
    """What became of the inputs of a target."""

    done: int = 0
    accepted: int = 0
    refused: int = 0
    failures: list[str] = field(default_factory=list)  #: the input's number and what happened
    slowest: float = 0.0  #: [s]


def run(
    name: str, count: int, *, seed: int, tally: Tally | None = None, saved: Callable[[], None] = lambda: None
) -> Tally:
    """Return what became of the first `count` inputs of a target.

    Parameters
    ----------
    name : str
        Of the target.
    count, seed : int
    tally : Tally, optional
        To go on with.
    saved : callable
        Called after every batch.
    """
    tally = tally or Tally()
    while tally.done < count:
        end = min(count, tally.done + _BATCH)
        for outcome in outcomes(worker_command(name, seed, tally.done, end), end - tally.done):
            tally.done += 1
            tally.slowest = max(tally.slowest, outcome.seconds)
            if outcome.kind == "accepted":
                tally.accepted += 1
            elif outcome.kind == "refused":
                tally.refused += 1
            else:
                tally.failures.append(f"{name} {tally.done - 1}: {outcome.words}")
        saved()
    return tally


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What became of an input."""

    kind: str  #: accepted, refused or failed
    words: str = ""
    seconds: float = 0.0


def worker_command(name: str, seed: int, first: int, end: int) -> list[str]:
    """Return the command line of the process that tries the inputs `first` to `end` - 1."""
    return [sys.executable, "-m", "campaigns.fuzz", "--worker", name, str(seed), str(first), str(end)]


def outcomes(command: list[str], count: int, *, patience: float = _START) -> Iterator[Outcome]:
    """Yield the outcomes of `count` inputs from a process; where it ends or hangs, the input under way is a failure.

    Parameters
    ----------
    command : list of str
        See `worker_command`.
    count : int
    patience : float
        How long the first outcome is waited for [s].
    """
    worker = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    assert worker.stdout is not None
    try:
        with selectors.DefaultSelector() as selector:
            selector.register(worker.stdout, selectors.EVENT_READ)
            for _ in range(count):
                if not selector.select(patience):
                    yield Outcome(kind="failed", words="hangs", seconds=patience)
                    return
                line = worker.stdout.readline()
                if not line:
                    yield Outcome(kind="failed", words=f"ends the process ({worker.wait()})")
                    return
                yield Outcome(**json.loads(line))
                patience = 2.0 * SECONDS
    finally:
        worker.kill()
        worker.wait()


@dataclass(frozen=True, kw_only=True)
class Fuzzed:
    """What became of the inputs of all targets."""

    tallies: dict[str, Tally]
    seed: int

    def markdown(self) -> str:
        """Return the section of the page."""
        total = sum(one.done for one in self.tallies.values())
        failures = [words for one in self.tallies.values() for words in one.failures]
        rows = [
            [
                name,
                f"{one.done:,}",
                f"{one.accepted:,}",
                f"{one.refused:,}",
                str(len(one.failures)),
                f"{one.slowest:.2g}",
            ]
            for name, one in self.tallies.items()
        ]
        return Section(
            title="Damaged inputs",
            before=(
                f"{total:,} inputs, each a whole one with one to four changes (seed {self.seed}): numbers, "
                "words, lines, separators, encodings, bytes. Each is accepted or refused in one sentence, within 10 s "
                "and 2 GB. In accepted inputs, all values are finite (NaN marks a missing cell of a log) and within "
                "the documented ranges, and a written copy is read back the same. A failure is anything else: a "
                "traceback, a warning, an end of the process. `python -m campaigns.fuzz robot 812` shows one input."
            ),
            columns=("loader", "inputs", "accepted", "refused", "failures", "slowest [s]"),
            rows=rows,
            after="\n".join(f"- {words}" for words in failures),
        ).markdown()


def campaign(counts: dict[str, int] | None = None) -> Fuzzed:
    """Run all targets, from where an earlier call of the same code was stopped."""
    counts = counts or COUNTS
    here = _source()
    kept = json.loads(_KEPT.read_text()) if _KEPT.exists() else {}
    tallies = (
        {name: Tally(**one) for name, one in kept.get("tallies", {}).items()}
        if kept.get("source") == here
        else {}
    )

    def save() -> None:
        write_text(
            _KEPT,
            json.dumps({"source": here, "tallies": {name: asdict(one) for name, one in tallies.items()}}),
        )

    for name, count in counts.items():
        tally = tallies.setdefault(name, Tally())
        run(name, count, seed=SEED, tally=tally, saved=save)
        print(f"{name}: {tally.done:,} inputs, {len(tally.failures)} failures", file=sys.stderr, flush=True)
        for words in tally.failures:
            print(f"  {words}", file=sys.stderr, flush=True)
    return Fuzzed(tallies=tallies, seed=SEED)


def _source() -> str:
    """Return a hash of this code."""
    root = Path(__file__).parents[1]
    files = [*sorted((root / "src").rglob("*.py")), *sorted(Path(__file__).parent.glob("fuzz*.py"))]
    return digest(*(path.read_bytes() for path in files))


#: what an input may take [s], and what memory beside the process's own [bytes]
SECONDS, BYTES = 10.0, 2 * 2**30
_LONGEST_SENTENCE = 20_000

Try = Callable[[int], None]


class TooLongError(BaseException):
    """An input has taken `SECONDS`; no loader catches it."""


def target_names() -> tuple[str, ...]:
    """Return the names of all targets."""
    from campaigns.fuzz_targets import loader_names

    return (*loader_names(), "command line")


def attempt(name: str, seed: int, folder: Path) -> Try:
    """Return what tries the input of that number; it returns, or raises `InputError` or what is a failure."""
    if name == "command line":
        from campaigns.fuzz_commands import Commands

        return Commands(seed, folder).attempt
    from campaigns.fuzz_targets import make_target

    target = make_target(name)
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
    """Return what became of an input, as `Outcome` has it."""

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


def work(name: str, seed: int, first: int, end: int) -> None:
    """Be the worker process: try the inputs `first` to `end` - 1."""
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


def main(words: list[str]) -> None:
    """Run the campaign, or show one input, or work for the campaign."""
    if words[:1] == ["--worker"]:
        work(words[1], *map(int, words[2:5]))
        return
    if words:
        show(words[0], SEED, int(words[1]))
        return
    assert set(COUNTS) == set(target_names())
    print(campaign().markdown())


if __name__ == "__main__":
    main(sys.argv[1:])
