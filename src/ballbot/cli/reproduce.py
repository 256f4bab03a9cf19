"""`ballbot reproduce`: every figure and table of the thesis, remade."""

from __future__ import annotations

from pathlib import Path

from ballbot.cli.output import progress_bar, standard_output, table
from ballbot.fitting.run import check_seed
from ballbot.printable import shell_line
from ballbot.progress import part_of
from ballbot.report.page import provenance
from ballbot.result_folder import result_folder

#: share of the work that is done when drawing begins
_MEASURED = 0.9


def reproduce(*, out: Path, seed: int = 0) -> None:
    """Reproduce every figure and table of the thesis from the twin and the models, and show its mistakes.

    Writes index.html, results.json, reproduce.md and figures/*.svg, and keeps its recordings in runs/. Give the
    command again to continue an interrupted run. The same seed gives the same result.

    Example: ballbot reproduce --out thesis

    Parameters
    ----------
    out
        The folder to write into.
    seed
        Random seed. The same seed gives the same result.
    """
    check_seed(seed)
    # imported late: the twin and the vision are extras
    from ballbot.thesis.reproduce.campaign import reproduce as remake
    from ballbot.thesis.reproduce.page import REPRODUCTION_FILES, write_reproduction

    console = standard_output()
    words = ["ballbot", "reproduce", "--out", str(out), "--seed", str(seed)]
    made = provenance(command=shell_line(words), files=[], seed=seed)
    with (
        result_folder(out, command="reproduce", names=REPRODUCTION_FILES) as folder,
        progress_bar(console, "the thesis remade") as bar,
    ):
        found = remake(
            folder.path / "runs",
            seed=seed,
            progress=part_of(bar.report, 0.0, _MEASURED),
        )
        with folder.replaced() as new:
            write_reproduction(
                found,
                new,
                provenance=made,
                progress=part_of(bar.report, _MEASURED, 1.0),
            )
    rows = [[item.name, item.title, item.verdict] for item in found.items]
    console.print(table("The thesis remade", ("", "shows", "ours"), rows, framed=console.is_terminal))
    proven = sum(mistake.proven for mistake in found.mistakes)
    console.print(f"{proven} of {len(found.mistakes)} misprints and mistakes are confirmed by numbers.")
    console.print(str(folder.path / "index.html"), soft_wrap=True)
