"""`ballbot demo`: two recorded runs in the browser at once, and what the log of the first one shows."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ballbot.cli.output import emit, open_page, print_parts, progress_bar, show_written, standard_output
from ballbot.files import check_folder, write_text
from ballbot.log import Log
from ballbot.progress import Progress
from ballbot.report.demo_runs import PRECISE, SOFT, read_runs, robot_of_runs
from ballbot.viewer.page import ResultState, replay_page, result_text
from ballbot.workflows.metrics import SETTLE, position_error, settled

_PAGE, _RESULT, _REPORT = "demo.html", "demo_result.js", "report.html"
_HEADING = "Meanwhile: the friction in the first run's log"
_DOING = "identifying the friction"
_NEXT = (
    "Next: push the robot yourself, `ballbot view alten --controller none --controller precise` (needs: pip install "
    "'ballbot[view]'), or describe your own: `ballbot new mine --from alten`"
)


def demo(
    *, out: Path | None = None, browser: Annotated[bool, Parameter(negative="--no-browser")] = True
) -> None:
    """Show a robot that wanders beside the same robot under a precise controller, and identify its friction.

    A page with two recorded runs opens at once. Meanwhile the friction is identified from the log of the first one, and
    the page shows it when it is found, with a link to its report.

    Example: `ballbot demo --out look`

    Parameters
    ----------
    out
        The folder for the page, report.html and results.json; ballbot-demo if not given.
    browser
        Whether to open the page.
    """
    folder, console = check_folder(out or "ballbot-demo"), standard_output()
    runs = read_runs()
    title = "One robot, two controllers, the same square"
    write_text(folder / _RESULT, result_text(_state_before(0.0, "preparing the model")))
    page = replay_page(runs, robot_of_runs(), title=title, lead=_lead(runs), result_beside=_RESULT)
    write_text(folder / _PAGE, page)
    show_written(folder / _PAGE)
    if browser:
        open_page((folder / _PAGE).resolve().as_uri())
    shown = ResultState(heading=_HEADING, sentences=("The command was stopped before it was found.",))
    written = -1
    try:
        with progress_bar(console, "preparing the model") as shown_on:

            def report(progress: Progress) -> None:
                nonlocal written
                shown_on(Progress(stage=_DOING, done=progress.share, total=1.0))
                if (percent := int(100.0 * progress.share)) > written:
                    written = percent
                    write_text(folder / _RESULT, result_text(_state_before(progress.share, _DOING)))

            # compiled code, once there is something to look at
            from ballbot.fitting.run import Run
            from ballbot.report.demo import identified, state_found, write_report

            found = identified(runs[SOFT], Run(progress=report))
        shown = state_found(found)
        # the page reads on while the share is a number: the report is yet to come
        write_text(folder / _RESULT, result_text(replace(shown, share=1.0)))
        for sentence in shown.sentences:
            console.print(sentence, soft_wrap=True)
        for row in (shown.columns, *shown.rows):
            console.print("  ".join(f"{cell:>22}" for cell in row), soft_wrap=True)
        write_report(found, runs[SOFT], folder)
        shown = replace(shown, links=((_REPORT, "The whole report on the friction found"),))
    finally:
        write_text(folder / _RESULT, result_text(shown))
    emit({"files": [folder / _PAGE, folder / _REPORT], "friction": found.robot.friction})
    print_parts([str(folder / _REPORT), _NEXT], console)


def _lead(runs: dict[str, Log]) -> str:
    """Return what the reader looks at, with the runs' errors."""
    errors = [position_error(runs[name])[settled(runs[name], SETTLE)].max() for name in (SOFT, PRECISE)]
    soft, precise = (f"{1000.0 * error:.{0 if error > 0.01 else 1}f} mm" for error in errors)
    return (
        f"Every 8 s the reference, a ring on the floor, jumps to the next corner. {SETTLE:g} s later the soft gain "
        f"is still up to {soft} off, the precise controller {precise}."
    )


def _state_before(share: float, doing: str) -> ResultState:
    sentence = f"On this computer, from the log of “{SOFT}” alone: {doing}."
    return ResultState(heading=_HEADING, sentences=(sentence,), share=share)
