"""The files that a study leaves: report.html, results.json, robot.toml, and controller.toml if one is recommended.

The controller that was there before stays beside the new one, as previous_controller.toml.
"""

from __future__ import annotations

from pathlib import Path

from ballbot.control.controller import Controller
from ballbot.control.file import controller_text, write_controller
from ballbot.errors import InputError
from ballbot.experiments.study import Study
from ballbot.files import write_text
from ballbot.inputs import LARGEST_SETTINGS, read_text
from ballbot.report.json_text import as_json
from ballbot.report.provenance import Provenance
from ballbot.report.results import study_results
from ballbot.report.study_page import study_report
from ballbot.robot.file import write_robot

STUDY_FILES = ("report.html", "results.json", "robot.toml", "controller.toml", "previous_controller.toml")

_BASELINE = """\
# The controller without friction compensation: to go back to if the new one does not do what was predicted. This
# folder held no other controller before.
"""


def write_study(study: Study, out: str | Path, *, made: Provenance, before: Path | None = None) -> Path:
    """Write a study into a folder, each file whole or not at all, and return the report's path.

    Parameters
    ----------
    study : Study
    out : str or Path
    made : Provenance
    before : Path, optional
        The folder that holds the files of an earlier study; `out` if not given.
    """
    folder = Path(out)
    chosen = study.choice.controller
    previous = previous_controller_text(
        folder if before is None else before, new=chosen, baseline=study.choice.trials["none"].controller
    )
    write_robot(study.found.robot, folder / "robot.toml")
    write_text(folder / "previous_controller.toml", previous)
    if chosen is not None:
        write_controller(chosen, folder / "controller.toml")
    write_text(folder / "results.json", as_json(study_results(study, made)))
    report = folder / "report.html"
    write_text(report, study_report(study, made))
    return report


def previous_controller_text(folder: Path, *, new: Controller | None, baseline: Controller) -> str:
    """Return the text of the previous_controller.toml that a study writes.

    It is the controller.toml that an earlier study left in the folder. If the folder has no such file, or its file is
    the new controller itself, the folder's previous_controller.toml is kept; without either it is the baseline.

    Parameters
    ----------
    folder : Path
        Of the study, with the files of the earlier one.
    new : Controller, optional
        None if the study recommends none.
    baseline : Controller
        Without compensation.
    """
    held = _text(folder / "controller.toml")
    if held is not None and (new is None or held != controller_text(new)):
        return held
    before = _text(folder / "previous_controller.toml")
    return _BASELINE + controller_text(baseline) if before is None else before


def _text(path: Path) -> str | None:
    try:
        return read_text(path, largest=LARGEST_SETTINGS)
    except InputError:  # not there, or no file of ours
        return None
