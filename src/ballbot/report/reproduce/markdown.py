"""The thesis remade as a page of the documentation: every verdict, and every mistake with its numbers."""

from __future__ import annotations

from ballbot.experiments.published.entry import markdown_table
from ballbot.experiments.reproduce import VERDICTS, Check, Item, Mistake, Reproduction
from ballbot.report.tables import with_symbols

_HEADINGS = ("shown is that", "measured is", "number", "bound", "")

_HEAD = """\
# The thesis remade

    ballbot reproduce --out thesis

makes every figure and table of the thesis again, from the nominal twin and the models, and proves its misprints and
mistakes by numbers. It takes some minutes on two cores. A command that was stopped goes on where it was when it is
given again.

| file | what is in it |
| :-- | :-- |
| `thesis/index.html` | each figure beside what the thesis shows, what ours shows, and the numbers that decide |
| `thesis/figures/*.svg` | the figures, as vectors |
| `thesis/results.json` | all numbers, with their bounds |
| `thesis/reproduce.md` | this page |
| `thesis/runs/` | the recordings, the friction found and the film; of use to the next run only |

Equal seeds (`--seed`) give equal results with equal versions of Ballbot and of what it stands on. Each figure is a
function of its name: Figure 5.6 is `figure_5_6` in `ballbot.experiments.reproduce.chapter5`, and its drawing in
`ballbot.report.reproduce.chapter5`.

## What it can show

Friction is identified from two of the twin's logs. Models and compensation know that friction and nothing else of the
twin, and the twin's scenario was frozen before. Whether ours agrees is decided by numbers within bounds, which stand
beside them in `index.html` and `results.json`.

- The twin is no measurement. Its heading drifts by 16 degrees in 3 minutes because the thesis's did (Figure IV.2), and
  the body that swings has the thesis's inertia (Figure III.1): such figures show that the method finds what is there.
- The thesis prints neither its gain nor its friction, so that shapes and ratios can be asked to agree, and sizes such
  as those of Figure 5.8 only roughly.
- Photographs and drawings of parts (Figures 1.1, 1.2, 3.3 and I.2) are not made again.
"""


def reproduction_markdown(made: Reproduction) -> str:
    """Return the page as Markdown."""
    counts = ", ".join(f"{count} {VERDICTS[verdict]}" for verdict, count in made.counts.items())
    proven = sum(mistake.proven for mistake in made.mistakes)
    parts = [
        _HEAD,
        "## Figures and tables",
        f"`ballbot reproduce --seed {made.bench.seed}`: of {len(made.items)}, {counts}.",
        *(_item(item) for item in made.items),
        "## Misprints and mistakes",
        f"Of {len(made.mistakes)}, {proven} are shown by numbers that would be others were the thesis right.",
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
