"""Mutated inputs for every loader and for the command line; docs/generated/evidence.md has the counts.

.venv/bin/python -m campaigns.fuzz                      the campaign, going on where it was stopped
.venv/bin/python -m campaigns.fuzz robot 812            one input: what it is and what becomes of it

A worker process does one input after another and says which, so that the end of the interpreter is an input's too. It
has 2 GB beside what it needs itself, and 10 s for an input. An input is accepted, or refused in one sentence
(`InputError`); everything else is a failure: another exception, a warning, a property that does not hold
(`campaigns.fuzz_targets`), a value of memory or time, the end of the process.
"""

from __future__ import annotations

import json
import selectors
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path

from ballbot.files import write_text
from ballbot.fitting.checkpoint import digest
from campaigns.fuzz_worker import SECONDS, target_names
from campaigns.section import Section

SEED = 13
#: inputs of each target, the quick ones first
COUNTS = {
    "bounds": 9000,
    "reference": 7000,
    "sweep's results": 5000,
    "identified errors": 5000,
    "axis record, CSV": 5000,
    "axis record, MATLAB": 8000,
    "motion capture": 4000,
    "foreign table": 10000,
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
    return [sys.executable, "-m", "campaigns.fuzz_worker", name, str(seed), str(first), str(end)]


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
                "and 2 GB. Of what is accepted, all values are finite (NaN marks a missing cell of a log) and within "
                "the documented ranges, and what is written is read back the same. A failure is anything else: a "
                "traceback, a warning, an end of the process. `python -m campaigns.fuzz robot 812` shows one input."
            ),
            columns=("loader", "inputs", "accepted", "refused", "failures", "slowest (s)"),
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
    """Return what tells this code from another."""
    root = Path(__file__).parents[1]
    files = [*sorted((root / "src").rglob("*.py")), *sorted(Path(__file__).parent.glob("fuzz*.py"))]
    return digest(*(path.read_bytes() for path in files)).hex()


def main(words: list[str]) -> None:
    """Run the campaign, or show one input."""
    if words:
        from campaigns.fuzz_worker import show

        show(words[0], SEED, int(words[1]))
        return
    assert set(COUNTS) == set(target_names())
    print(campaign().markdown())


if __name__ == "__main__":
    main(sys.argv[1:])
