"""The page of the reproduction: one self-contained file, Markdown, and results.json."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path

from markupsafe import Markup

from ballbot.file_formats import results_text
from ballbot.files import write_text
from ballbot.report.blocks import Paragraph, Report, Section, Sheet, section
from ballbot.report.page import page_of
from ballbot.report.provenance import Provenance
from ballbot.report.style import drawn_picture
from ballbot.report.words import with_powers, with_symbols
from ballbot.results import to_results
from ballbot.robot import Friction
from ballbot.thesis.reproduce.campaign import Reproduction
from ballbot.thesis.reproduce.item import RUNS, VERDICTS, Check, Item, Mistake

REPRODUCTION_FILES = ("report.html", "reproduce.md", "results.json")
_HEADINGS = ("claim", "quantity", "value", "criterion", "agrees")

_HEAD = """\
# The thesis reproduced

    ballbot reproduce --out thesis

reproduces the figures and tables of the thesis from the nominal twin and the models, and shows its misprints and
mistakes by numbers. It takes about ten minutes on two cores. Run the command again to continue an interrupted run.

| file | what is in it |
| :-- | :-- |
| `thesis/report.html` | one self-contained page: each figure beside what the thesis shows and the numbers that decide |
| `thesis/results.json` | all numbers, with their bounds and intervals |
| `thesis/reproduce.md` | this page |
| `thesis/runs/` | the recordings, kept for the next run |

Each figure is a function of its name: Figure 5.6 is `figure_5_6` in `ballbot.thesis.reproduce.figures`.

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
        *(item_markdown(item) for item in made.items),
    ]
    if made.mistakes:
        parts += [
            "## Misprints and mistakes",
            f"Of {len(made.mistakes)}, {proven} are confirmed by numbers that would differ if the thesis were right.",
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


def markdown_table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table; the columns after the first are set flush right."""
    marks = [":--", *("--:" for _ in headings[1:])]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in [list(headings), marks, *rows])


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
    rows = tuple(check.cells for check in mistake.shown_by)
    words = f"**{mistake.number}. {mistake.where}.** *Printed:* {mistake.thesis} *Right:* {mistake.right}"
    return with_symbols(f"{words}\n\n{markdown_table(_HEADINGS, rows)}")


def write_reproduction(made: Reproduction, folder: Path, *, provenance: Provenance) -> Path:
    """Write results.json, reproduce.md and report.html into a folder and return the page's path."""
    results = reproduction_results(made) | {"provenance": to_results(provenance)}
    write_text(folder / "results.json", results_text(results))
    write_text(folder / "reproduce.md", reproduction_markdown(made))
    page = folder / "report.html"
    write_text(page, page_of(reproduction_report(made, provenance)))
    return page


def reproduction_report(made: Reproduction, provenance: Provenance) -> Report:
    """Return what the page shows."""
    counts = ", ".join(f"{count} {VERDICTS[verdict]}" for verdict, count in made.counts.items())
    proven = sum(mistake.proven for mistake in made.mistakes)
    whole = f"All {proven}" if proven == len(made.mistakes) > 1 else f"Of {len(made.mistakes)}, {proven}"
    return Report(
        title="The thesis reproduced",
        lead="The figures and tables of the thesis on ALTEN's ball-balancing robot, from the twin and the models.",
        verdict=(
            ("Figures and tables", f"Of {len(made.items)}, {counts}."),
            *([("Misprints and mistakes", f"{whole} are confirmed by numbers.")] if made.mistakes else []),
        ),
        sections=(
            *(_item_section(item) for item in made.items),
            *([_mistake_section(made.mistakes)] if made.mistakes else []),
        ),
        undecided=(
            "Whether a robot behaves so. The robot here is the nominal twin: rollers, play, friction, noise and drift, "
            "frozen before any of these figures was made. Friction is identified from two of its logs; models and "
            "compensation know that friction and nothing else of the twin.",
            "More than the intervals show. The loop is chaotic: a random quantity is the median of several runs with "
            "the 95 % interval of the median, as in 0.34 (0.31 to 0.38). It agrees if the whole interval is within the "
            "criterion, and is undecided if only part of it is.",
            "Sizes that depend on the thesis's gain and friction, which it does not print: shapes and ratios must "
            "agree, and such sizes only roughly.",
        ),
        made=provenance,
    )


def _caption(item: Item) -> str:
    return f"{item.name} of the thesis, reproduced."


def _item_section(item: Item) -> Section:
    """Return the section of a figure or table; its number in the thesis stands in the caption."""
    table, name = item.table, item.name.lower().replace(" ", "-").replace(".", "-")
    return section(
        item.title,
        _labelled("The thesis", item.thesis),
        _labelled("Ours", item.ours),
        _labelled("Verdict", item.sentence),
        None
        if table is None
        else Sheet(
            headings=table.headings,
            rows=[[with_symbols(cell) for cell in row] for row in table.rows],
            caption=_caption(item),
        ),
        drawn_picture(name, item.figure, _caption(item)) if item.figure else None,
        replace(item.series(), caption=_caption(item)) if item.series else None,
        _checks_sheet(
            "What the thesis claims, and the numbers that decide whether it is reproduced.", item.checks
        ),
    )


def _labelled(label: str, text: str) -> Paragraph:
    return Paragraph(text=Markup("<strong>{}:</strong> {}").format(label, with_symbols(text)))


def _checks_sheet(caption: str, checks: Sequence[Check]) -> Sheet:
    return Sheet(
        headings=_HEADINGS,
        rows=[[with_powers(with_symbols(cell)) for cell in check.cells] for check in checks],
        caption=with_symbols(caption),
        shaded=frozenset(place for place, check in enumerate(checks) if not check.agrees),
    )


def _mistake_section(mistakes: Sequence[Mistake]) -> Section:
    return section(
        "The thesis's misprints and mistakes",
        Paragraph(text="Each with computed numbers that would differ if the thesis were right."),
        *(
            _checks_sheet(
                f"{one.number}. {one.where}. The thesis prints: {one.thesis} Right: {one.right}", one.shown_by
            )
            for one in mistakes
        ),
    )


def reproduction_results(made: Reproduction) -> dict[str, object]:
    """Return what results.json holds."""
    return {
        "seed": made.bench.seed,
        "friction_identified": {name: value for name, value in asdict(made.friction).items() if value != ()}
        if made.friction
        else None,
        "runs": RUNS,
        "items": [_item_results(item) for item in made.items],
        "mistakes": made.mistakes,
    }


def _item_results(item: Item) -> dict[str, object]:
    return {
        "name": item.name,
        "title": item.title,
        "thesis": item.thesis,
        "ours": item.ours,
        "verdict": item.verdict,
        "checks": item.checks,
        "table": None if item.table is None else [item.table.headings, *item.table.rows],
    }
