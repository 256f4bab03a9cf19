"""Runs cases in a working folder of their own, each once, and keeps goldens."""

import io
import json
import shutil
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import chdir, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path

from ballbot.cli.main import main

from .cases import CASES, Case
from .compare import differences
from .freeze import Json, freeze_folder, machine

FOLDER = Path(__file__).parent
RESULTS = FOLDER / "results"
_MACHINE = FOLDER / "machine.json"
_BY_NAME = {case.name: case for case in CASES}


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What a case gave."""

    case: Case
    result: Json
    code: int  #: the exit code
    refusal: str  #: the message of a command that failed
    seconds: float  #: of computing, on all cores


def chosen(names: Sequence[str]) -> list[Case]:
    """Return the frozen cases of these names, all if no name is given.

    Raises
    ------
    KeyError
        If there is no such case.
    """
    return [case for case in CASES if case.frozen] if not names else [_BY_NAME[name] for name in names]


def run(cases: Iterable[Case], folder: Path) -> Iterator[Outcome]:
    """Run cases, what they need before them, in an empty folder; yield each one's outcome."""
    shutil.copytree(FOLDER / "files", folder / "files")
    done: set[str] = set()
    for case in cases:
        for one in [*_needed(case), case]:
            if one.name not in done:
                done.add(one.name)
                outcome = _run_one(one, folder)
                if one.frozen:
                    yield outcome


def compare(outcome: Outcome, *, same_machine: bool) -> list[str]:
    """Return where an outcome differs from its golden."""
    golden = json.loads((RESULTS / f"{outcome.case.name}.json").read_text(encoding="utf-8"))
    return differences(outcome.case.name, golden, outcome.result, same_machine=same_machine)


def update(outcome: Outcome) -> None:
    """Make an outcome the golden: JSON, objects indented and lists in one line, to be compared line by line."""

    def lines(value: Json, indent: str) -> str:
        if not isinstance(value, dict) or not value:
            return json.dumps(value, ensure_ascii=False)
        entries = [f"{indent} {json.dumps(key)}: {lines(one, indent + ' ')}" for key, one in value.items()]
        return "{\n" + ",\n".join(entries) + f"\n{indent}}}"

    text = lines(outcome.result, "") + "\n"
    (RESULTS / f"{outcome.case.name}.json").write_text(text, encoding="utf-8")


def is_same_machine() -> bool:
    """Return whether this is a machine like the one that made the goldens."""
    return json.loads(_MACHINE.read_text(encoding="utf-8")) == machine()


def update_machine() -> None:
    """Make this the machine of the goldens."""
    _MACHINE.write_text(json.dumps(machine(), indent=1) + "\n", encoding="utf-8")


def _needed(case: Case) -> list[Case]:
    """Return what a case needs, in the order in which it can be run."""
    needs = [_BY_NAME[name] for name in case.needs]
    return [one for need in needs for one in (*_needed(need), need)]


def _run_one(case: Case, folder: Path) -> Outcome:
    out, begun = folder / case.name, time.process_time()
    out.mkdir()
    code, said = 0, io.StringIO()
    with chdir(folder), redirect_stdout(io.StringIO()), redirect_stderr(said):
        if case.make is not None:
            case.make(out)
        elif case.alone:
            _main_alone(case.words, said)  # compiles; code read from disk rounds differently in places
            shutil.rmtree(out)
            out.mkdir()
            code = _main_alone(case.words, said)
        else:
            code = main(case.words)
    return Outcome(
        case=case,
        result=freeze_folder(out, code=code),
        code=code,
        refusal=said.getvalue() if code else "",
        seconds=time.process_time() - begun,
    )


def _main_alone(words: Sequence[str], said: io.StringIO) -> int:
    command = [sys.executable, "-m", "ballbot", *words]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    said.seek(0)
    said.write(done.stderr)
    return done.returncode
