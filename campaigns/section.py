"""What campaigns share: a section of docs/generated/evidence.md, figures of documents, the folder of public data."""

import hashlib
import json
import os
import pickle
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

from matplotlib.figure import Figure

import ballbot
from ballbot.errors import InputError
from ballbot.files import read_bytes, read_json, write_bytes, write_text
from ballbot.fitting.run import ALL_CORES, Executor, Processes
from ballbot.fitting.sweep import RunFolder, identity
from ballbot.progress import Progress, ignore_progress
from ballbot.report.style import drawn
from ballbot.workflows.grid import GridRun, GridTable
from ballbot.workflows.metrics import Score
from ballbot.workflows.statistics import fraction_with_interval

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
        """Return the section as Markdown."""
        table = markdown_table(self.columns, self.rows)
        parts = [f"## {self.title}", self.before, table, *([self.after] if self.after else [])]
        return "\n\n".join(parts) + "\n"


def markdown_table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table; the columns after the first are set flush right."""
    marks = [":--", *("--:" for _ in headings[1:])]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in [list(headings), marks, *rows])


#: holds what campaigns have finished
BUILD = Path(__file__).parents[1] / "build"


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
    workers: Executor = ALL_CORES,
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
    workers : Executor, optional
    """
    folder: RunFolder[Made, Made] = RunFolder(
        path=BUILD / name,
        made_from=identity({}, {"code": sources_of(*packages)} if packages else {}),
        write=lambda path, made: write_bytes(path, pickle.dumps(made)),
        read=lambda path: cast("Made", pickle.loads(read_bytes(path))) if path.exists() else None,
    )

    def report(now: Progress) -> None:
        print(f"\r{name}: {now.done} of {now.total}", end="", file=sys.stderr, flush=True)

    progress = report if len(runs) > 1 else ignore_progress
    return folder.complete(make, runs, workers=workers, stage=name, progress=progress)


def kept(folder: str, name: str, make: Callable[[], Made]) -> Made:
    """Return what is made here, or read from the file of that name in build/FOLDER."""
    return finished(folder, lambda _: make(), {name: None}, workers=Processes(count=1))[name]


def share_words(count: int, of: int) -> str:
    """Return a share in per cent with its 95 % interval (Clopper and Pearson 1934); a dash of nothing."""
    if not of:
        return "–"
    low, high = fraction_with_interval(count, of)
    return f"{100 * count / of:.3g} % ({100 * low:.3g} to {100 * high:.3g} %)"


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
    scores = kept.complete(_scored, runs, workers=Processes(count=processes), stage=stage)
    return GridTable(runs=tuple(runs.values()), answers=tuple(scores.values()))


def _scored(run: GridRun) -> Score:
    return run.score(run.log())


def _write_score(path: Path, made: Score) -> None:
    write_text(path, json.dumps(asdict(made)))


def _read_score(path: Path) -> Score | None:
    try:
        return Score(**cast("dict[str, Any]", read_json(path)))
    except InputError:  # not there, or not whole
        return None


class DataMissingError(Exception):
    """A campaign needs public data, or packages, that are not part of Ballbot."""


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


def public_file(name: str, *, sha256: str, see: str) -> Path:
    """Return a file within `data_folder`, of which a page says where it is from.

    Raises
    ------
    DataMissingError
        If it is not there, or is another version.
    """
    path = data_folder() / name
    if not path.exists():
        raise DataMissingError(f"it needs the public file {path}; see {see}")
    if hashlib.sha256(path.read_bytes()).hexdigest() != sha256:
        raise DataMissingError(f"{path} is another version than the one that the section is about")
    return path


FOLDER = Path(__file__).parents[1] / "docs" / "images"


def write_picture(name: str, draw: Callable[[], Figure]) -> str:
    """Draw a figure into docs/images/NAME.svg and return its path as seen from docs/generated."""
    path = FOLDER / f"{name}.svg"
    write_text(path, '<?xml version="1.0" encoding="utf-8"?>\n' + drawn(draw, name=name))
    return f"../{FOLDER.name}/{path.name}"
