"""How right the remaining time is that long commands print: writes docs/generated/remaining_time.md.

    .venv/bin/python -m benchmarks.remaining_time [--only limits study]

Each command runs as a person runs it whose output goes into a file: its lines on standard error say "about 2:30 left".
Each is compared with the time that was left in fact.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from statistics import median
from time import monotonic

from ballbot.files import write_text
from benchmarks.run import processor

PAGE = Path(__file__).parents[1] / "docs" / "generated" / "remaining_time.md"
#: what the commands read: two recordings of the twin
RECORDED = {
    "square.csv": "record nominal --reference square --duration 48 --seed 1 --out square",
    "figure_eight.csv": "record nominal --reference figure_eight --duration 48 --seed 2 --out figure_eight",
}
#: commands that take about a minute or more
COMMANDS = {
    "identify": "identify alten square.csv figure_eight.csv --law best --out identify",
    "limits": "limits alten none full --twin --out limits",
    "excite": "excite alten --out excite",
    "study": "study alten square.csv figure_eight.csv --plant twin --out study",
}
#: from this share of a run on its estimates count, and right within this factor
FROM, FACTOR = 0.1, 2.0
#: estimates are printed in whole seconds [s]
PRINTED = 1.0

_LEFT = re.compile(r"about (?:(\d+):)?(\d+):(\d\d) left")


@dataclass(frozen=True, kw_only=True)
class Watched:
    """What a command said of the time left."""

    seconds: float  #: that it took
    said: tuple[tuple[float, float], ...]  #: time since its start and the estimate, both in seconds

    def ratios(self) -> tuple[float, ...]:
        """Return the estimates over the time left in fact; 1 where they differ by no more than what is printed."""
        late = [(now, left) for now, left in self.said if now >= FROM * self.seconds]
        return tuple(_ratio(left, self.seconds - now) for now, left in late)


def _ratio(said: float, true: float) -> float:
    return 1.0 if abs(said - true) <= PRINTED else said / true


def seconds_left(line: str) -> float | None:
    """Return the remaining time [s] that a line of progress names; None if it names none."""
    found = _LEFT.search(line)
    if found is None:
        return None
    hours, minutes, seconds = (int(part or 0) for part in found.groups())
    return 3600.0 * hours + 60.0 * minutes + seconds


def watched(words: str, folder: Path) -> Watched:
    """Run a command of Ballbot; stop with what it printed if it fails."""
    begun = monotonic()
    with subprocess.Popen(
        [sys.executable, "-m", "ballbot", *words.split()],
        cwd=folder,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        lines = [(monotonic() - begun, line) for line in process.stderr or ()]
    if process.returncode:
        sys.exit(f"ballbot {words}\n{''.join(line for _, line in lines)}")
    said = tuple((now, left) for now, line in lines if (left := seconds_left(line)) is not None)
    return Watched(seconds=monotonic() - begun, said=said)


def row(words: str, found: Watched) -> str:
    """Return a command's row of the table."""
    ratios = sorted(found.ratios())
    within = sum(1.0 / FACTOR <= ratio <= FACTOR for ratio in ratios)
    spread = f"{ratios[0]:.2f} to {ratios[-1]:.2f} | {median(ratios):.2f}" if ratios else " | "
    silent = max((later - now for (now, _), (later, _) in pairwise(found.said)), default=found.seconds)
    return f"| `{words}` | {found.seconds:.0f} | {within} of {len(ratios)} | {spread} | {silent:.0f} |"


def page(rows: Iterable[str], *, busy: float) -> str:
    """Return the page's text."""
    return f"""# The remaining time

`python -m benchmarks.remaining_time` writes this page: estimates that long commands printed from a tenth of their run
on, over the time that was left in fact. The target is a factor of two. One that differs by a second, as it is printed
in whole ones, counts as 1. One run each; {processor()}, {os.cpu_count()} cores, load average {busy:.0f}.

| `ballbot` .. | took [s] | within a factor of two | estimate over truth | median | longest time between two [s] |
|---|---:|---:|---:|---:|---:|
{chr(10).join(rows)}
"""


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and write the page."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.remaining_time", description=__doc__)
    parser.add_argument("--only", nargs="+", choices=COMMANDS, help="these commands, and no page")
    only = parser.parse_args(arguments).only
    rows = []
    with tempfile.TemporaryDirectory(prefix="ballbot-remaining-time-") as name:
        folder = Path(name)
        for log, words in RECORDED.items():
            watched(words, folder)
            (folder / words.split()[-1] / "log.csv").rename(folder / log)
        for command in only or COMMANDS:
            rows.append(row(COMMANDS[command], watched(COMMANDS[command], folder)))
            print(rows[-1], flush=True)
    if not only:
        write_text(PAGE, page(rows, busy=os.getloadavg()[2]))


if __name__ == "__main__":
    main()
