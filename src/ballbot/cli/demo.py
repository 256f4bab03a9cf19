"""`ballbot demo`: two recorded runs in the browser, and the friction identified from the log of the first."""

from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ballbot.cli.output import emit, open_page, print_parts, progress_bar, show_written, standard_output
from ballbot.files import check_folder, write_text
from ballbot.fitting.run import Run
from ballbot.log import Log
from ballbot.report.blocks import PAGE
from ballbot.report.demo import PRECISE, SOFT, friction_report, read_runs, robot_of_runs
from ballbot.report.page import render
from ballbot.viewer.page import replay_page
from ballbot.workflows.metrics import SETTLE, position_error, settled

_NEXT = (
    "Next: describe your own robot, `ballbot new mine --from alten`, or push this one, `ballbot view alten "
    "--controller none --controller precise`"
)


def demo(
    *, out: Path | None = None, browser: Annotated[bool, Parameter(negative="--no-browser")] = True
) -> None:
    """Show a robot that wanders beside the same robot under a precise controller, and identify its friction.

    A page with two recorded runs opens at once. Meanwhile the friction is identified from the log of the first one;
    its report opens when it is found.

    Example: `ballbot demo --out look`

    Parameters
    ----------
    out
        The folder for demo.html, report.html and results.json; ballbot-demo if not given.
    browser
        Whether to open the pages.
    """
    folder, console, runs = check_folder(out or "ballbot-demo"), standard_output(), read_runs()
    shown, report = folder / "demo.html", folder / PAGE
    title = "One robot, two controllers, the same square"
    write_text(shown, replay_page(runs, robot_of_runs(), title=title, lead=_lead(runs)))
    show_written(shown, "Two recorded runs, with the soft gain and with the precise controller.")
    if browser:
        open_page(shown.resolve().as_uri())
    with progress_bar(console, "identifying the friction") as progress:
        result = friction_report(runs[SOFT], Run(progress=progress))
    render(result, folder)
    emit(result.to_dict())
    needs = "" if find_spec("websockets") else " (needs: pip install 'ballbot[view]')"
    print_parts([*result.parts(brief=True), str(report), f"{_NEXT}{needs}"], console)
    if browser:
        open_page(report.resolve().as_uri())


def _lead(runs: dict[str, Log]) -> str:
    """Return the text above the replay, with the errors of both runs."""
    errors = [position_error(runs[name])[settled(runs[name], SETTLE)].max() for name in (SOFT, PRECISE)]
    soft, precise = (f"{1000.0 * error:.{0 if error > 0.01 else 1}f} mm" for error in errors)
    return (
        f"Every 8 s the reference, a ring on the floor, jumps to the next corner. {SETTLE:g} s later the soft gain "
        f"is still up to {soft} off, the precise controller {precise}."
    )
