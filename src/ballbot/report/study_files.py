"""The files that a study leaves: report.html, results.json, robot.toml, and controller.toml if one is recommended.

The controller that was there before stays beside the new one, as previous_controller.toml.
"""

from __future__ import annotations

from pathlib import Path

from ballbot.control.file import write_controller
from ballbot.experiments.previous_controller import previous_controller_text
from ballbot.experiments.study import Study
from ballbot.files import write_text
from ballbot.report.json_text import as_json
from ballbot.report.provenance import Provenance
from ballbot.report.results import study_results
from ballbot.report.study_page import study_report
from ballbot.robot.file import write_robot

STUDY_FILES = ("report.html", "results.json", "robot.toml", "controller.toml", "previous_controller.toml")


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
