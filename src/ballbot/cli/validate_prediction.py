"""`ballbot validate --prediction`: a log made with a study's controller against what the study predicted."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.text import Text

from ballbot.cli.findings import Accept, accept_words, check_input, show_findings
from ballbot.cli.output import standard_output, table
from ballbot.cli.study import read_balancing_log
from ballbot.control.controller import Controller
from ballbot.control.file import read_controller
from ballbot.errors import InputError
from ballbot.experiments.controller_causes import EXPLAINED_CODES
from ballbot.experiments.controller_prediction import Prediction, read_prediction
from ballbot.experiments.controller_verdict import Verdict, check_controller, judge
from ballbot.files import write_text
from ballbot.findings import Finding, finding_results
from ballbot.printable import shell_line
from ballbot.report.json_text import as_json
from ballbot.report.prediction_page import (
    StudyFolder,
    cause_lines,
    headline,
    next_steps,
    prediction_report,
    prediction_results,
    quantity_rows,
)
from ballbot.report.provenance import provenance
from ballbot.result_folder import result_folder
from ballbot.robot import Robot

_WRITTEN = ("report.html", "results.json")
#: endings of a log's name, by which a second log is known from a robot's file
_LOG_SUFFIXES = (".csv", ".parquet", ".txt", ".tsv", ".dat", ".log")
_HEADINGS = ("quantity", "measured", "predicted", "95 % interval", "", "without compensation")


def validate_prediction(
    results: Path,
    inputs: Sequence[str],
    *,
    out: Path | None,
    controller: Path | None,
    mapping: Path | None,
    accept: Accept,
) -> None:
    """Judge one log by a study's prediction, print the verdict and write it if a folder is given.

    Parameters
    ----------
    results : Path
        The study's results.json.
    inputs : sequence of str
        The log; or a robot's preset or file, and the log.
    out : Path, optional
    controller : Path, optional
        The controller's file; that beside the results if not given.
    mapping : Path, optional
        Of the log.
    accept : list of str, optional
        Codes of errors of the log to go on in spite of.

    Raises
    ------
    InputError
        If a file cannot be read or does not belong to the prediction, or the log is not one of the course.
    """
    prediction = read_prediction(results)
    source, log_path = _robot_and_log(results, inputs)
    robot = Robot.load(source)
    files = StudyFolder(
        results=results, robot=Path(source), controller=controller or results.with_name("controller.toml")
    )
    driver = _controller(files.controller, prediction, robot)
    log = read_balancing_log(log_path, mapping, robot)
    # what the robot does wrong, the verdict is about
    accepted = [*(accept or ()), *sorted(EXPLAINED_CODES)]
    found = check_input(
        robot, {log_path: log}, accept=accepted, source=source, mappings={log_path: mapping}, show=False
    )
    codes = [finding.code for finding in found if finding.severity == "error"]
    try:
        verdict = judge(prediction, log, robot, driver, codes=codes)
    except InputError as error:
        raise InputError(f"{log_path}: {error}") from None
    steps = next_steps(verdict, prediction, files)
    _show(verdict, steps)
    show_findings(found)
    if out is not None:
        words = ["ballbot", "validate", *inputs, "--prediction", str(results), "--out", str(out)]
        words += ["--controller", str(controller)] if controller else []
        words += ["--mapping", str(mapping)] if mapping else []
        words += accept_words(accept)
        used = [results, files.controller, log_path, *([mapping] if mapping else [])]
        _write(out, verdict, prediction, steps, found, command=shell_line(words), files=used)


def _robot_and_log(results: Path, inputs: Sequence[str]) -> tuple[str, Path]:
    beside = results.with_name("robot.toml")
    if len(inputs) == 1:
        if not beside.exists():
            raise InputError(
                f"{beside} is missing; keep a study's files in one folder, or give the robot before the log."
            )
        return str(beside), Path(inputs[0])
    if len(inputs) == 2 and Path(inputs[0]).suffix.lower() not in _LOG_SUFFIXES:
        return inputs[0], Path(inputs[1])
    raise InputError("--prediction judges one log: give the log, or the robot and the log.")


def _controller(path: Path, prediction: Prediction, robot: Robot) -> Controller:
    """Return the controller in a file, if it is the one that was predicted."""
    if not path.exists():
        raise InputError(
            f"{path} is missing; keep a study's files in one folder, or name the controller's file with --controller."
        )
    controller = read_controller(path, robot)
    try:
        check_controller(prediction, controller)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    return controller


def _show(verdict: Verdict, steps: Sequence[str]) -> None:
    console = standard_output()
    console.print(Text(headline(verdict), style="bold"), soft_wrap=True)
    for remark in verdict.remarks:
        console.print(remark, markup=False, soft_wrap=True)
    rows = quantity_rows(verdict)
    console.print(table("Predicted and measured", _HEADINGS, rows, framed=console.is_terminal))
    lines = cause_lines(verdict)
    if lines:
        console.print(Text("Likely causes", style="bold"))
    for line in (*lines, *steps):
        console.print(line, markup=False, soft_wrap=True)


def _write(
    out: Path,
    verdict: Verdict,
    prediction: Prediction,
    steps: Sequence[str],
    found: Sequence[Finding],
    *,
    command: str,
    files: Sequence[Path],
) -> None:
    made = provenance(command=command, files=files, seed=0)
    whole = {
        "prediction": prediction_results(verdict, prediction, steps),
        "findings": finding_results(found),
        "provenance": made.to_dict(),
    }
    title = f"{files[2]}: the controller against its prediction"
    with result_folder(out, command="validate", names=_WRITTEN, inputs=files) as folder:
        page = prediction_report(verdict, prediction, title=title, steps=steps, findings=found, made=made)
        with folder.replaced() as new:
            write_text(new / "results.json", as_json(whole))
            write_text(new / "report.html", page)
        report = folder.path / "report.html"
    standard_output().print(str(report), markup=False, soft_wrap=True)
