"""Try damaged inputs on every loader and on the command line.

.venv/bin/python -m campaigns.evidence fuzz             the campaign
.venv/bin/python -m campaigns.fuzz robot 812            one input: its content and its outcome

A worker process tries one input after another, so that a crash of the interpreter is assigned to its input. It has
2 GB beside its own memory, and 10 s for an input. An input is accepted, or refused in one sentence (`InputError`).
Everything else is a failure: another exception, a warning, a violated property (`campaigns.fuzz_targets`), too much
memory or time, the end of the process.
"""

from __future__ import annotations

import multiprocessing
import os
import re
import resource
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from random import Random

from ballbot.errors import InputError
from campaigns.section import Section

SEED = 13
#: inputs of each target
COUNT = 5000
#: what an input may take [s], what memory beside the process's own [bytes], and what a process may take to start [s]
SECONDS, BYTES, START = 10.0, 2 * 2**30, 120.0
_LONGEST_SENTENCE = 20_000
COMMANDS = "command line"

Try = Callable[[int], None]


class TooLongError(BaseException):
    """An input has taken `SECONDS`; no loader catches it."""


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What became of an input."""

    kind: str  #: accepted, refused or failed
    words: str = ""
    seconds: float = 0.0


def target_names() -> tuple[str, ...]:
    """Return the names of all targets."""
    from campaigns.fuzz_targets import MAKERS

    return (*MAKERS, COMMANDS)


def attempt(name: str, seed: int, folder: Path) -> Try:
    """Return what tries the input of that number; it returns, or raises `InputError` or what is a failure."""
    if name == COMMANDS:
        from campaigns.fuzz_commands import Commands

        return Commands(seed, folder).attempt
    from campaigns.fuzz_targets import MAKERS

    target = MAKERS[name]()
    for content in target.samples:  # every sample is accepted, and what is compiled once counts for no input
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
    found = re.search(r"VmSize:\s*(\d+)", Path("/proc/self/status").read_text())
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


def outcome(attempted: Try, number: int) -> Outcome:
    """Return what became of an input."""

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
    except BaseException as error:
        kind, words = "failed", f"{type(error).__name__}: {str(error)[:300]} {_place(error)}"
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
    return Outcome(kind=kind, words=words, seconds=round(time.perf_counter() - began, 3))


def _place(error: BaseException) -> str:
    frames = traceback.extract_tb(error.__traceback__)
    ours = [frame for frame in frames if "ballbot" in frame.filename or "campaigns" in frame.filename]
    return " < ".join(f"{Path(frame.filename).name}:{frame.lineno}" for frame in reversed(ours[-3:]))


def work(name: str, seed: int, count: int, parent: Connection) -> None:
    """Be the worker process: try the first `count` inputs of a target."""
    memory = Path("/dev/shm")
    with tempfile.TemporaryDirectory(dir=memory if memory.is_dir() else None) as folder:
        attempted = attempt(name, seed, Path(folder))
        with limits():
            for number in range(count):
                parent.send(outcome(attempted, number))


def outcomes(
    name: str,
    count: int,
    *,
    seed: int = SEED,
    work: Callable[[str, int, int, Connection], None] = work,
    patience: float = START,
) -> Iterator[Outcome]:
    """Yield the outcomes of a target's inputs; where the process ends or hangs, the input under way is a failure.

    Parameters
    ----------
    name : str
        Of the target.
    count, seed : int
    work : callable
        What the process does.
    patience : float
        How long the first outcome is waited for [s].
    """
    processes = multiprocessing.get_context("spawn")
    here, there = processes.Pipe(duplex=False)
    process = processes.Process(target=work, args=(name, seed, count, there))
    process.start()
    there.close()
    try:
        for _ in range(count):
            if not here.poll(patience):
                yield Outcome(kind="failed", words="hangs", seconds=patience)
                return
            yield here.recv()
            patience = 2.0 * SECONDS
    except EOFError:
        process.join()
        yield Outcome(kind="failed", words=f"ends the process ({process.exitcode})")
    finally:
        process.kill()
        process.join()


def campaign() -> Section:
    """Run all targets and return the section of docs/generated/evidence.md."""
    rows, failures = [], []
    for name in target_names():
        found = list(outcomes(name, COUNT))
        failed = [f"{name} {k}: {one.words}" for k, one in enumerate(found) if one.kind == "failed"]
        kinds = [sum(one.kind == kind for one in found) for kind in ("accepted", "refused")]
        slowest = max(one.seconds for one in found)
        rows.append(
            [name, *(f"{number:,}" for number in (len(found), *kinds, len(failed))), f"{slowest:.2g}"]
        )
        print(*rows[-1], *failed, sep="\n  ", file=sys.stderr, flush=True)
        failures += failed
    return Section(
        title="Damaged inputs",
        before=f"{COUNT:,} inputs of each loader, each a whole one with one to four changes (seed {SEED}): numbers, "
        "words, lines, separators, encodings, bytes. Each is accepted or refused in one sentence, within 10 s and "
        "2 GB. In accepted inputs, all values are finite (NaN marks a missing cell of a log) and within the documented "
        "ranges, and a written copy is read back the same. A failure is anything else: a traceback, a warning, an end "
        "of the process. `python -m campaigns.fuzz robot 812` shows one input.",
        columns=("loader", "inputs", "accepted", "refused", "failures", "slowest [s]"),
        rows=rows,
        after="\n".join(f"- {words}" for words in failures),
    )


# --- damage, the same for the same random numbers ---

_NUMBERS = """
0 -0.0 -1 1 2 3.5 1e-3 0.005 5e-9 1e-300 5e-324 1e308 -1e308 1e400 nan -nan inf -inf 1.7e9 1.7e18 1000 1e5 1_000
2147483647 2147483648 -2147483649 9223372036854775808 18446744073709551616 0x7fffffff 0b1
true false [] {} [[]] NaN NA None - １２ 1,5
"""
_WORDS = r"[/x] $\frac$ %s {} # = [ ] [[ t x u1 u9 true_x é 日本 nan base name - --"
#: replacements of a number
NUMBERS = (*_NUMBERS.split(), '""', "''", "9" * 30, "9" * 5000)
#: replacements of a word, or insertions
WORDS = (*_WORDS.split(), "", " ", "\t", "\0", "\x1b[31m", "\\", '"', "'", "\ufeff", "\u202e", "a" * 300)
_NUMBER = re.compile(r"(?<![\w.])[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?(?![\w.])")
_WORD = re.compile(r"[A-Za-z_][A-Za-z_0-9]*")
_SEPARATORS = ((",", ";"), (",", "\t"), ("\n", "\r\n"), ("\n", "\r"), ("=", ":"), (".", ","), ("\n", ""))
#: bytes of a mutated file, at most
_LARGEST = 200_000


def mutated(content: bytes, random: Random) -> bytes:
    """Return a file's content with one to four things changed in it."""
    for _ in range(random.choice((1, 1, 1, 2, 3, 4))):
        try:
            text = content.decode()
        except UnicodeDecodeError:
            text = "\0"
        if "\0" not in text and random.random() < 0.8:
            content = _text_changed(text, random)
        else:
            content = _bytes_changed(content, random)
    return content[:_LARGEST]


def _text_changed(text: str, random: Random) -> bytes:
    match random.choice(("number", "number", "scale", "word", "lines", "separator", "insert", "encoding")):
        case "number":
            text = _replaced(_NUMBER, lambda _: random.choice(NUMBERS), text, random)
        case "scale":
            factor = random.choice((-1.0, 0.5, 2.0, 1e3, 1e-3, 1e6, 57.3, 1.0 + 1e-12))
            text = _replaced(_NUMBER, lambda one: repr(factor * float(one)), text, random)
        case "word":
            text = _replaced(_WORD, lambda _: random.choice((*WORDS, *_WORD.findall(text))), text, random)
        case "lines":
            text = "\n".join(_lines_changed(text.split("\n"), random))
        case "separator":
            text = text.replace(*random.choice(_SEPARATORS), random.choice((1, -1)))
        case "insert":
            place = random.randrange(len(text) + 1)
            text = text[:place] + random.choice((*WORDS, *NUMBERS)) + text[place:]
        case _:
            return text.encode(random.choice(("utf-16", "utf-8-sig", "latin-1", "utf-32")), "replace")
    return text.encode()


def _replaced(pattern: re.Pattern[str], by: Callable[[str], str], text: str, random: Random) -> str:
    found = list(pattern.finditer(text))
    if not found:
        return text
    one = random.choice(found)
    return text[: one.start()] + by(one[0]) + text[one.end() :]


def _lines_changed(lines: list[str], random: Random) -> list[str]:
    first, other = random.randrange(len(lines)), random.randrange(len(lines))
    end = min(len(lines), first + random.choice((1, 1, 1, 2, 10)))
    match random.randrange(3):
        case 0:
            del lines[first:end]
        case 1:
            lines[first:first] = lines[first:end]
        case _:
            lines[first], lines[other] = lines[other], lines[first]
    return lines


def _bytes_changed(content: bytes, random: Random) -> bytes:
    """Cut the content, change some bytes, or copy a piece to another place, once or many times."""
    place = random.randrange(len(content) + 1)
    match random.randrange(3):
        case 0:
            return content[:place]
        case 1:
            first = random.randrange(len(content) + 1)
            piece = content[first : first + random.choice((1, 4, 8, 64, 512))]
            return content[:place] + piece * random.choice((1, 2, 10, 200)) + content[place:]
        case _:
            changed = bytearray(content)
            for _ in range(random.choice((1, 1, 2, 8)) if changed else 0):
                changed[random.randrange(len(changed))] = random.choice((0, 1, 0x7F, 0x80, 0xFF))
            return bytes(changed)


def main(words: Sequence[str]) -> None:
    """Print what becomes of one input, with its traceback; the input stays in a folder that is named."""
    folder = Path(tempfile.mkdtemp())
    try:
        attempt(words[0], SEED, folder)(int(words[1]))
        print("accepted")
    except InputError as error:
        print(f"refused: {error}")
    except Exception:
        traceback.print_exc()
    print(folder)


if __name__ == "__main__":
    main(sys.argv[1:])
