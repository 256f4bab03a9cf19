"""The page of the reproduction, and what results.json holds."""

import re
from collections.abc import Sequence
from dataclasses import asdict, replace

from markupsafe import Markup

from ballbot.report.blocks import Paragraph, Result, Section, Sheet, section
from ballbot.report.style import drawn_picture
from ballbot.report.words import RAISED, with_symbols
from ballbot.results import to_results
from ballbot.thesis.reproduce.campaign import Reproduction
from ballbot.thesis.reproduce.item import RUNS, VERDICTS, ClaimCheck, Item, Mistake

CHECK_HEADINGS = ("claim", "quantity", "value", "criterion", "agrees")


def reproduction_report(made: Reproduction) -> Result:
    """Return what the page shows."""
    counts = ", ".join(f"{count} {VERDICTS[verdict]}" for verdict, count in made.counts.items())
    proven = sum(mistake.proven for mistake in made.mistakes)
    whole = f"All {proven}" if proven == len(made.mistakes) > 1 else f"Of {len(made.mistakes)}, {proven}"
    return Result(
        title="The thesis reproduced",
        lead="The figures and tables of the thesis on ALTEN's ball-balancing robot, from the twin and the models.",
        verdict=(
            ("Figures and tables", f"Of {len(made.items)}, {counts}."),
            *([("Misprints and mistakes", f"{whole} are confirmed by numbers.")] if made.mistakes else []),
        ),
        sections=(
            *(_item_section(name, item) for name, item in made.items.items()),
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
        data={
            "seed": made.bench.seed,
            "friction_identified": made.friction
            and {name: value for name, value in asdict(made.friction).items() if value != ()},
            "runs": RUNS,
            "items": [{"name": name} | _item_results(item) for name, item in made.items.items()],
            "mistakes": [{"number": k} | to_results(mistake) for k, mistake in enumerate(made.mistakes, 1)],
        },
    )


def _item_section(name: str, item: Item) -> Section:
    """Return the section of a figure or table; its number in the thesis stands in the caption."""
    table, caption = item.table, f"{name} of the thesis, reproduced."
    return section(
        item.title,
        _labelled("The thesis", item.thesis),
        _labelled("Ours", item.ours),
        _labelled("Verdict", item.sentence),
        None
        if table is None
        else Sheet(
            table.headings, [[with_symbols(str(cell)) for cell in row] for row in table.rows], caption
        ),
        drawn_picture(re.sub(r"[ .]", "-", name.lower()), caption, item.figure) if item.figure else None,
        replace(item.series(), caption=caption) if item.series else None,
        _checks_sheet(
            "What the thesis claims, and the numbers that decide whether it is reproduced.", item.checks
        ),
    )


def _labelled(label: str, text: str) -> Paragraph:
    return Paragraph(Markup("<strong>{}:</strong> {}").format(label, with_symbols(text)))


def _checks_sheet(caption: str, checks: Sequence[ClaimCheck]) -> Sheet:
    return Sheet(
        CHECK_HEADINGS,
        [[with_powers(with_symbols(cell)) for cell in check.cells] for check in checks],
        with_symbols(caption),
        shaded=frozenset(row for row, check in enumerate(checks) if not check.agrees),
    )


def _mistake_section(mistakes: Sequence[Mistake]) -> Section:
    return section(
        "The thesis's misprints and mistakes",
        Paragraph("Each with computed numbers that would differ if the thesis were right."),
        *(
            _checks_sheet(
                f"{number}. {mistake.where}. The thesis prints: {mistake.thesis} Right: {mistake.right}",
                mistake.shown_by,
            )
            for number, mistake in enumerate(mistakes, 1)
        ),
    )


def _item_results(item: Item) -> dict[str, object]:
    """Return what results.json holds of a figure or table."""
    return {
        "title": item.title,
        "thesis": item.thesis,
        "ours": item.ours,
        "verdict": item.verdict,
        "checks": item.checks,
        "table": None if item.table is None else [item.table.headings, *item.table.rows],
    }


_EXPONENT = re.compile(r"\b(\d[.\d]*)e([-+]?\d+)\b")


def with_powers(words: str) -> str:
    """Return words with the powers of ten of their numbers raised: 8.58·10⁻⁶ for 8.58e-06."""
    return _EXPONENT.sub(lambda match: f"{match[1]}·10{str(int(match[2])).translate(RAISED)}", words)
