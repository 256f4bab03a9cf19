"""The thesis remade as a page of the documentation: every verdict, and every mistake with its numbers."""

from __future__ import annotations

from ballbot.experiments.published.entry import markdown_table
from ballbot.experiments.reproduce import VERDICTS, Check, Item, Mistake, Reproduction
from ballbot.report.tables import with_symbols
from ballbot.robot import Friction

_HEADINGS = ("shown is that", "measured is", "number", "bound", "")

_HEAD = """\
# The thesis remade

    ballbot reproduce --out thesis

makes every figure and table of the thesis again, from the nominal twin and the models, and proves its misprints and
mistakes by numbers. It takes some ten minutes of two cores. A command that was stopped goes on where it was when it is
given again.

| file | what is in it |
| :-- | :-- |
| `thesis/index.html` | one self-contained page: each figure beside what the thesis shows and the numbers that decide |
| `thesis/figures/*.svg` | the figures, as vectors |
| `thesis/results.json` | all numbers, with their bounds and intervals |
| `thesis/reproduce.md` | this page |
| `thesis/runs/` | the recordings, the friction found and the film of the ball; of use to the next run only |

Each figure is a function of its name: Figure 5.6 is `figure_5_6` in `ballbot.experiments.reproduce.chapter5`, and its
drawing in `ballbot.report.reproduce.chapter5`.

## What it can show

Friction is identified from two of the twin's logs. Models and compensation know that friction and nothing else of the
twin, and the twin's scenario was frozen before. Whether ours agrees is decided by numbers within bounds, which stand
beside them in `index.html` and `results.json`.

- The loop is chaotic: a rolling friction larger by one part in 10^12 moves a peak by centimetres. So no verdict hangs
  on one run. What has chance in it is given as the median of several runs and the interval that holds the true median
  with 95 %: 0.34 (0.31 to 0.38). It agrees if the whole interval is within the bounds, and is undecided if only part
  of it is.
- Runs are simulated on a grid: at every sample the state is rounded (speeds to 1e-5, places to 1e-7), which is far
  below the noise and far above what processors differ by. So equal seeds (`--seed`) give this page, to the digits
  shown, on every machine; numbers below 1e-9 are rounding and are shown as 0.
- "Without friction" stands for two models: the exact equations, and the thesis's own, which are its basic model with
  its mistakes in it.
- The twin is no measurement. Its heading drifts by 16 degrees in 3 minutes because the thesis's did (Figure IV.2),
  and the body that swings is simulated with the thesis's inertia (Figure III.1): such figures show that the method
  finds what is there.
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
        friction_line(made.bench.identified.friction),
        *(item_markdown(item) for item in made.items),
        "## Misprints and mistakes",
        f"Of {len(made.mistakes)}, {proven} are shown by numbers that would be others were the thesis right.",
        *(mistake_markdown(mistake) for mistake in made.mistakes),
    ]
    return "\n\n".join(part.strip() for part in parts) + "\n"


def friction_line(friction: Friction) -> str:
    """Return the friction that was identified, as a line; to three digits that is all of it."""
    viscous, coulomb, stribeck = (
        ", ".join(f"{value:g}" for value in values)
        for values in (friction.viscous, friction.coulomb, friction.stribeck)
    )
    return (
        f"Friction identified: b = {viscous} N m s/rad; c = {coulomb} N m; s = {stribeck} N m; "
        f"v_s = {friction.stribeck_speed:g} rad/s; delta = {friction.stribeck_exponent:g}; "
        f"C_rr = {friction.rolling:g}."
    )


def item_markdown(item: Item) -> str:
    """Return a figure's or table's paragraph."""
    words = (
        f"**{item.name}. {item.title}.** *The thesis:* {item.thesis} *Ours:* {item.ours} **{item.sentence}**"
    )
    if item.table is None:
        return with_symbols(words)
    return with_symbols(f"{words}\n\n{markdown_table(item.table.headings, item.table.rows)}")


def mistake_markdown(mistake: Mistake) -> str:
    """Return a mistake's paragraph and the table of its numbers."""
    rows = tuple(_check(check) for check in mistake.shown_by)
    words = f"**{mistake.number}. {mistake.where}.** *Printed:* {mistake.thesis} *Right:* {mistake.right}"
    return with_symbols(f"{words}\n\n{markdown_table(_HEADINGS, rows)}")


def _check(check: Check) -> tuple[str, ...]:
    return check.claim, check.quantity, check.measured, check.criterion, check.outcome
