"""What campaigns share: a section of docs/generated/evidence.md, figures of documents, the folder of public data."""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import pickle
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import TypeVar, cast

from matplotlib.figure import Figure

import ballbot
from ballbot.errors import InputError
from ballbot.files import read_sealed, write_sealed, write_text
from ballbot.fitting.sweep import ALL_CORES, Processes, RunFolder, Workers, identity
from ballbot.progress import Progress, ignore_progress
from ballbot.report.style import drawn
from ballbot.workflows.grid import GridRun, GridTable
from ballbot.workflows.metrics import Score

Piece = TypeVar("Piece")
Made = TypeVar("Made")


@dataclass(frozen=True, kw_only=True)
class Section:
    """A heading, and a table between two texts."""

    title: str
    before: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    after: str = ""

    def markdown(self) -> str:
        """Return the section as Markdown, numbers to the right."""
        lines = [f"## {self.title}", "", self.before, ""]
        lines += [f"| {' | '.join(self.columns)} |", f"|---|{'---:|' * (len(self.columns) - 1)}"]
        lines += [f"| {' | '.join(row)} |" for row in self.rows]
        return "\n".join([*lines, "", *([self.after, ""] if self.after else [])])


_BEGUN = time.time()
#: files of results that this run reads and an earlier one made
EARLIER: set[Path] = set()


def is_kept(path: Path) -> bool:
    """Return whether a file of results exists; enter it in `EARLIER` if an earlier run made it."""
    if not path.exists():
        return False
    if path.stat().st_mtime < _BEGUN:
        EARLIER.add(path)
    return True


#: holds what campaigns have finished
BUILD = Path(__file__).parents[1] / "build"
#: for a run that is made where it is asked for
HERE = Processes(count=1)


@cache
def sources_of(*packages: str) -> str:
    """Return a digest of the code of some packages, so that what older code made is not taken for theirs."""
    digest = hashlib.sha256()
    for package in packages:
        for path in sorted((Path(ballbot.__file__).parent / package).rglob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()


def finished(
    name: str,
    make: Callable[[Piece], Made],
    runs: Mapping[str, Piece],
    *,
    packages: Sequence[str] = (),
    workers: Workers = ALL_CORES,
) -> dict[str, Made]:
    """Return what each run makes of its piece; those finished are read from the folder build/NAME.

    Parameters
    ----------
    name : str
    make : callable
        What it returns can be pickled.
    runs : mapping
        The piece of each run by the name of its file.
    packages : sequence of str, optional
        Whose code what is finished belongs to; other code refuses the folder.
    workers : Workers, optional
    """
    folder: RunFolder[Made, Made] = RunFolder(
        path=BUILD / name,
        made_from=identity({}, {"code": sources_of(*packages)} if packages else {}),
        write=lambda path, made: write_sealed(path, pickle.dumps(made)),
        read=lambda path: cast("Made", pickle.loads(read_sealed(path))) if path.exists() else None,
    )

    def report(now: Progress) -> None:
        print(f"\r{name}: {now.done} of {now.total}", end="", file=sys.stderr, flush=True)

    progress = report if len(runs) > 1 else ignore_progress
    found, before = folder.complete(make, runs, workers=workers, stage=name, progress=progress)
    EARLIER.update(folder.path / one for one in before)
    return found


def compared(
    folder: Path,
    runs: Mapping[str, GridRun],
    *,
    made_from: Mapping[str, str],
    stage: str,
    processes: int | None = None,
) -> GridTable[Score]:
    """Return scores by the files of their runs; those that the folder lacks are made."""
    kept = RunFolder(path=folder, made_from=made_from, write=_write_score, read=_read_score)
    found, before = kept.complete(_scored, runs, workers=Processes(count=processes), stage=stage)
    EARLIER.update(folder / name for name in before)
    return GridTable(runs=tuple(runs.values()), answers=tuple(found.values()))


def _scored(run: GridRun) -> Score:
    return run.score(run.log())


def _write_score(path: Path, made: Score) -> None:
    write_sealed(path, json.dumps(asdict(made)).encode())


def _read_score(path: Path) -> Score | None:
    try:
        return Score(**json.loads(read_sealed(path)))
    except InputError:  # not there, or not whole
        return None


class DataMissingError(Exception):
    """A campaign needs public data that are not part of Ballbot."""


def data_folder() -> Path:
    """Return the folder of public data that BALLBOT_DATA names.

    Raises
    ------
    DataMissingError
        If BALLBOT_DATA names no folder.
    """
    folder = os.environ.get("BALLBOT_DATA", "")
    if not folder or not Path(folder).is_dir():
        raise DataMissingError("it needs public data; set BALLBOT_DATA to the folder that holds them")
    return Path(folder)


def print_section(campaign: Callable[[], Section], *, description: str, holds: str) -> None:
    """Print the section of a campaign on public data; the option --data names their folder.

    Parameters
    ----------
    campaign : callable
    description : str
        What the campaign does, one sentence.
    holds : str
        The file or folder that the folder of public data must hold.
    """
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--data", required=True, help=f"the folder that holds {holds}")
    os.environ["BALLBOT_DATA"] = parser.parse_args().data
    print(campaign().markdown())


FOLDER = Path(__file__).parents[1] / "docs" / "images"


def write_picture(name: str, draw: Callable[[], Figure]) -> str:
    """Draw a figure into docs/images/NAME.svg and return its path as seen from docs/generated."""
    path = FOLDER / f"{name}.svg"
    write_text(path, '<?xml version="1.0" encoding="utf-8"?>\n' + drawn(draw, name=name))
    return f"../{FOLDER.name}/{path.name}"
