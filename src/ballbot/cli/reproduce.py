"""`ballbot reproduce`: the figures and tables of the thesis."""

from ballbot.cli import options
from ballbot.cli.context import open_result
from ballbot.report.blocks import Sheet, verdict_lines


def reproduce(*, out: options.Out, only: str | None = None, seed: options.Seed = 0) -> None:
    """Reproduce the figures and tables of the thesis from the twin and the models, and show its mistakes.

    Writes report.html and results.json.

    Example: ballbot reproduce --out thesis

    Example: ballbot reproduce --only "Table 4.1" --out thesis

    Parameters
    ----------
    only
        One figure or table by its name in the thesis, such as "Table 4.1". If not given, all, and the mistakes.
    """
    # imported late: the twin is an extra
    from ballbot.thesis.reproduce.campaign import items_named
    from ballbot.thesis.reproduce.campaign import reproduce as remake
    from ballbot.thesis.reproduce.page import reproduction_report

    items_named(only)
    with open_result(out, doing="reproducing the thesis", seed=seed) as result:
        reproduction = remake(seed=seed, only=only, progress=result.report)
        rows = [[name, item.title, item.verdict] for name, item in reproduction.items.items()]
        sheet = Sheet(caption="The thesis reproduced", headings=("", "title", "verdict"), rows=rows)
        page = reproduction_report(reproduction)
        step = "the same for your robot, from its logs: `ballbot study ROBOT LOG --out found`"
        result.write(page, printed=[sheet, *verdict_lines(page.verdict)], next_step=step)
