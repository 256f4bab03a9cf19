"""The files that a study leaves: report.html, results.json, robot.toml, and controller.toml if one is recommended."""

from __future__ import annotations

from pathlib import Path

from ballbot.control.file import write_controller
from ballbot.experiments.study import Study
from ballbot.files import write_text
from ballbot.report.json_text import as_json
from ballbot.report.provenance import Provenance
from ballbot.report.results import study_results
from ballbot.report.study_page import study_report
from ballbot.robot.file import write_robot

STUDY_FILES = ("report.html", "results.json", "robot.toml", "controller.toml")


def write_study(study: Study, out: str | Path, *, made: Provenance) -> Path:
    """Write a study into a folder, each file whole or not at all, and return the report's path."""
    folder = Path(out)
    write_robot(study.found.robot, folder / "robot.toml")
    if study.choice.controller is not None:
        write_controller(study.choice.controller, folder / "controller.toml")
    write_text(folder / "results.json", as_json(study_results(study, made)))
    report = folder / "report.html"
    write_text(report, study_report(study, made))
    return report
