"""Reproduce the thesis and write docs/generated/reproduce.md.

python -m campaigns.reproduce

`git diff` then names the lines that a fresh run writes otherwise.
"""

from pathlib import Path

from ballbot.progress import ignore_progress
from ballbot.report.words import with_symbols
from ballbot.robot import Friction
from ballbot.thesis.reproduce.campaign import Reproduction, reproduce
from ballbot.thesis.reproduce.item import VERDICTS, Item, Mistake
from ballbot.thesis.reproduce.page import CHECK_HEADINGS
from campaigns.section import markdown_table

PAGE = Path(__file__).parents[1] / "docs" / "generated" / "reproduce.md"


_HEAD = """\
# The thesis reproduced

    ballbot reproduce --out thesis

reproduces the figures and tables of the thesis from the nominal twin and the models, and shows its misprints and
mistakes by numbers. It takes about ten minutes on two cores.

| file | what is in it |
| :-- | :-- |
| `thesis/report.html` | one self-contained page: each figure beside what the thesis shows and the numbers that decide |
| `thesis/results.json` | all numbers, with their bounds and intervals |

`python -m campaigns.reproduce` makes this page. Each figure is a function of its name: Figure 5.6 is
`figure_5_6` in `ballbot.thesis.reproduce.figures`.

## What it can show

Friction is identified from two of the twin's logs. Models and compensation know that friction and nothing else of the
twin, and the twin's scenario was frozen before. Whether our result agrees is decided by numeric criteria, which
`report.html` and `results.json` list.

- The loop is chaotic: a rolling friction larger by one part in 10^12 moves a peak by centimetres. So no verdict
depends on one run. A random quantity is given as the median of several runs with
  the 95 % interval of the median: 0.34 (0.31 to 0.38). It agrees if the whole interval is within the bounds, and is
  undecided if only part of it is.
- Runs are simulated on a grid: at every sample the state is rounded (speeds to 1e-5, places to 1e-7), which is far
  below the noise and far above the differences between processors. So equal seeds (`--seed`) give this page, to the
  digits shown, on every machine; numbers below 1e-9 are rounding and are shown as 0.
- "Without friction" stands for two models: the exact equations, and the thesis's own, which are its basic model with
  its mistakes in it.
- The twin is not a measurement. Its heading drifts by 16 degrees in 3 minutes because the thesis's did (Figure IV.2),
  and the body that swings is simulated with the thesis's inertia (Figure III.1): such figures show that the method
  finds what is there.
- The thesis prints neither its gain nor its friction, so shapes and ratios must agree, and sizes such as those of
  Figure 5.8 only roughly.
- Not reproduced are photographs and drawings (Figures 1.1, 1.2, 2.1, 3.3, 5.2, I.1 and I.2; the numbers of Appendix I
  are in mistakes 11 and 12), and figures that another one or another command shows better: 5.3 (see 5.6), 5.7 (5.8),
  IV.1 (IV.2), IV.3 (IV.4), and V.1 and V.2, which `ballbot spin` draws of your own video.
"""


def reproduction_markdown(made: Reproduction) -> str:
    """Return the page as Markdown."""
    counts = ", ".join(f"{count} {VERDICTS[verdict]}" for verdict, count in made.counts.items())
    proven = sum(mistake.proven for mistake in made.mistakes)
    parts = [
        _HEAD,
        "## Figures and tables",
        f"`ballbot reproduce --seed {made.bench.seed}`: of {len(made.items)}, {counts}.",
        *([friction_line(made.friction)] if made.friction else []),
        *(item_markdown(name, item) for name, item in made.items.items()),
    ]
    if made.mistakes:
        parts += [
            "## Misprints and mistakes",
            f"Of {len(made.mistakes)}, {proven} are confirmed by numbers that would differ if the thesis were right.",
            *(mistake_markdown(*numbered) for numbered in enumerate(made.mistakes, 1)),
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


def item_markdown(name: str, item: Item) -> str:
    """Return a figure's or table's paragraph."""
    words = f"**{name}. {item.title}.** *The thesis:* {item.thesis} *Ours:* {item.ours} **{item.sentence}**"
    if item.table is None:
        return with_symbols(words)
    rows = [[str(cell) for cell in row] for row in item.table.rows]
    return with_symbols(f"{words}\n\n{markdown_table(item.table.headings, rows)}")


def mistake_markdown(number: int, mistake: Mistake) -> str:
    """Return a mistake's paragraph and the table of its numbers."""
    rows = tuple(check.cells for check in mistake.shown_by)
    words = f"**{number}. {mistake.where}.** *Printed:* {mistake.thesis} *Right:* {mistake.right}"
    return with_symbols(f"{words}\n\n{markdown_table(CHECK_HEADINGS, rows)}")


if __name__ == "__main__":
    PAGE.write_text(reproduction_markdown(reproduce(seed=0, progress=ignore_progress)), encoding="utf-8")
