"""The page of the thesis remade, one self-contained file, the figures as files of their own, and results.json."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import asdict
from functools import partial
from pathlib import Path

from ballbot.experiments.reproduce import VERDICTS, Check, Item, Mistake, Reproduction
from ballbot.experiments.reproduce.seeds import RUNS
from ballbot.files import write_text
from ballbot.report.page import Provenance, as_json, figure_markup, render
from ballbot.report.reproduce.drawings import DRAWINGS
from ballbot.report.reproduce.markdown import reproduction_markdown
from ballbot.report.style import drawn
from ballbot.report.tables import with_symbols

REPRODUCTION_FILES = (
    "index.html",
    "reproduce.md",
    "results.json",
    *(f"figures/{key}.svg" for key in DRAWINGS),
)


def write_reproduction(
    made: Reproduction, folder: Path, *, provenance: Provenance, progress: Callable[[float, str], None]
) -> Path:
    """Write figures/*.svg, results.json, reproduce.md and index.html into a folder and return the index's path.

    Parameters
    ----------
    made : Reproduction
    folder : Path
    provenance : Provenance
    progress : callable
        Called with the share of the figures that is drawn, and which is next.
    """
    shown = [item for item in made.items if item.key in DRAWINGS]
    figures: dict[str, str] = {}
    for done, item in enumerate(shown):
        progress(done / len(shown), f"drawing {item.name}")
        svg = drawn(partial(DRAWINGS[item.key], made.bench), name=item.key.replace("_", "-"))
        figures[item.key] = svg
        # a file of its own is as wide as an attribute says; a style counts within a page only
        own = re.sub(r' style="width:(\d+pt)"', r' width="\1"', svg, count=1)
        write_text(folder / "figures" / f"{item.key}.svg", own)
    results = reproduction_results(made) | {"provenance": provenance.to_dict()}
    write_text(folder / "results.json", as_json(results))
    write_text(folder / "reproduce.md", reproduction_markdown(made))
    index = folder / "index.html"
    write_text(index, reproduction_page(made, provenance, figures))
    return index


def reproduction_page(made: Reproduction, provenance: Provenance, figures: Mapping[str, str]) -> str:
    """Return the page with its figures in it, SVG by `Item.key`."""
    values: dict[str, object] = {
        "title": "The thesis remade",
        "counts": [(VERDICTS[verdict], count) for verdict, count in made.counts.items()],
        "items": made.items,
        "figures": {key: figure_markup(svg) for key, svg in figures.items()},
        "mistakes": made.mistakes,
        "proven": sum(mistake.proven for mistake in made.mistakes),
        "words": with_symbols,
        "made": provenance,
    }
    return render("reproduce", values)


def reproduction_results(made: Reproduction) -> dict[str, object]:
    """Return what results.json holds."""
    return {
        "seed": made.bench.seed,
        "friction_identified": asdict(made.bench.identified.friction),
        "runs": RUNS,
        "items": [_item(item) for item in made.items],
        "mistakes": [_mistake(mistake) for mistake in made.mistakes],
    }


def _item(item: Item) -> dict[str, object]:
    return {
        "name": item.name,
        "title": item.title,
        "thesis": item.thesis,
        "ours": item.ours,
        "verdict": item.verdict,
        "checks": [_check(check) for check in item.checks],
        "table": None if item.table is None else [item.table.headings, *item.table.rows],
        "figure": f"figures/{item.key}.svg" if item.key in DRAWINGS else None,
    }


def _mistake(mistake: Mistake) -> dict[str, object]:
    return {
        "number": mistake.number,
        "where": mistake.where,
        "thesis": mistake.thesis,
        "right": mistake.right,
        "proven": mistake.proven,
        "shown_by": [_check(check) for check in mistake.shown_by],
    }


def _check(check: Check) -> dict[str, object]:
    return {**asdict(check), "agrees": check.agrees, "undecided": check.undecided}
