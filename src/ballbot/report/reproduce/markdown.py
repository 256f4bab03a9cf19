"""The thesis remade as a page of the documentation: every verdict, and every mistake with its numbers."""

from __future__ import annotations

from ballbot.experiments.published.entry import markdown_table
from ballbot.experiments.reproduce import Check, Item, Mistake, Reproduction
from ballbot.report.tables import with_symbols

_HEADINGS = ("shown is that", "measured is", "number", "bound", "")

_HEAD = """\
# The thesis remade

    ballbot reproduce --out thesis

makes every figure and table of the thesis again, from the nominal twin and the models: `index.html` with each figure
beside what the thesis shows, `results.json`, `figures/*.svg`, the recordings in `runs/` (a command that was stopped
goes on where it was), and this page, `reproduce.md`. Equal seeds give equal results.

Friction is identified from two of the twin's logs. Models and compensation know that friction and nothing else of the
twin, and the twin's scenario was frozen before. Whether ours agrees is decided by numbers within stated bounds;
`index.html` and `results.json` have all of them. Each figure is a function of its name: Figure 5.6 is `figure_5_6` in
`ballbot.experiments.reproduce.chapter5`, and its drawing in `ballbot.report.reproduce.chapter5`.
"""


def reproduction_markdown(made: Reproduction) -> str:
    """Return the page as Markdown."""
    parts = [
        _HEAD,
        f"Seed {made.bench.seed}.",
        "## Figures and tables",
        *(_item(item) for item in made.items),
    ]
    parts += [
        "## Misprints and mistakes",
        "Numbers that would be others were the thesis right; all are computed.",
        *(_mistake(mistake) for mistake in made.mistakes),
    ]
    return "\n\n".join(part.strip() for part in parts) + "\n"


def _item(item: Item) -> str:
    words = (
        f"**{item.name}. {item.title}.** *The thesis:* {item.thesis} *Ours:* {item.ours} **{item.sentence}**"
    )
    if item.table is None:
        return with_symbols(words)
    return with_symbols(f"{words}\n\n{markdown_table(item.table.headings, item.table.rows)}")


def _mistake(mistake: Mistake) -> str:
    rows = tuple(_check(check) for check in mistake.shown_by)
    words = f"**{mistake.number}. {mistake.where}.** *Printed:* {mistake.thesis} *Right:* {mistake.right}"
    return with_symbols(f"{words}\n\n{markdown_table(_HEADINGS, rows)}")


def _check(check: Check) -> tuple[str, ...]:
    return check.claim, check.quantity, check.measured, check.criterion, "yes" if check.agrees else "no"
