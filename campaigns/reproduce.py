"""Reproduce the thesis again and compare the result with docs/generated/reproduce.md line by line."""

from __future__ import annotations

from difflib import unified_diff
from pathlib import Path
from tempfile import TemporaryDirectory

from ballbot.progress import ignore_progress
from ballbot.thesis.reproduce.campaign import reproduce
from ballbot.thesis.reproduce.item import VERDICTS
from ballbot.thesis.reproduce.page import reproduction_markdown
from campaigns.section import Section

PAGE = Path(__file__).parents[1] / "docs" / "generated" / "reproduce.md"
#: differing lines that the section shows
_SHOWN = 5


def campaign() -> Section:
    """Remake the thesis in an empty folder and return the section of docs/generated/evidence.md."""
    with TemporaryDirectory() as folder:
        made = reproduce(Path(folder), seed=0, progress=ignore_progress)
    fresh, written = reproduction_markdown(made).splitlines(), PAGE.read_text(encoding="utf-8").splitlines()
    differing = [line for line in unified_diff(written, fresh, n=0, lineterm="") if line[0] == "+"][1:]
    shown = "; ".join(line[1:120] for line in differing[:_SHOWN])
    return Section(
        title="The thesis remade, twice",
        before="`ballbot reproduce --seed 0` into an empty folder, beside docs/generated/reproduce.md.",
        columns=["what", "number"],
        rows=[
            ["lines of the page", f"{len(written)}"],
            ["lines that a fresh run writes otherwise", f"{len(differing)}"],
            *([phrase, f"{made.counts.get(verdict, 0)}"] for verdict, phrase in VERDICTS.items()),
            ["mistakes shown by their numbers", f"{sum(one.proven for one in made.mistakes)}"],
        ],
        after=f"Otherwise: {shown}." if shown else "No line differs.",
    )
