"""`ballbot validate`: two models of a robot against its logs, by default with its friction and without any.

With `--prediction`, a log made with a study's controller is compared with what the study predicted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import get_args

import numpy as np
from cyclopts import Parameter
from rich.table import Table
from rich.text import Text

from ballbot.cli.context import WholeNumber, input_files, open_result, read_balancing_log, read_balancing_logs
from ballbot.cli.findings import Accept, check_input, show_findings
from ballbot.cli.output import progress_bar, standard_output, table
from ballbot.control.controller import Controller
from ballbot.control.file import read_controller
from ballbot.errors import InputError
from ballbot.files import write_text
from ballbot.findings import Finding
from ballbot.fitting.run import Run, check_seed
from ballbot.log import STATE_NAMES, Log
from ballbot.log.formats import is_log_file
from ballbot.mechanics.model import Model
from ballbot.mechanics.parameters import Formulation
from ballbot.progress import Progress
from ballbot.report.prediction import (
    StudyFolder,
    cause_lines,
    headline,
    next_steps,
    prediction_report,
    prediction_results,
    quantity_rows,
)
from ballbot.report.tables import digits
from ballbot.report.validation import validation_report, validation_results
from ballbot.robot import Robot
from ballbot.validation import ErrorPair, ModelPair, Validation, findings, join_validations, validate_pair
from ballbot.workflows.controller_causes import EXPLAINED_CODES
from ballbot.workflows.controller_prediction import Prediction, read_prediction
from ballbot.workflows.controller_verdict import Verdict, check_controller, evaluate_log

_WRITTEN = ("report.html", "results.json")
_PREDICTION_HEADINGS = ("quantity", "measured", "predicted", "95 % interval", "", "without compensation")


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
    driver = _predicted_controller(files.controller, prediction, robot)
    log = read_balancing_log(log_path, mapping, robot)
    # what the robot does wrong, the verdict is about
    accepted = [*(accept or ()), *sorted(EXPLAINED_CODES)]
    found = check_input(
        robot, {log_path: log}, accept=accepted, source=source, mappings={log_path: mapping}, show=False
    )
    codes = [finding.code for finding in found if finding.severity == "error"]
    try:
        verdict = evaluate_log(prediction, log, robot, driver, codes=codes)
    except InputError as error:
        raise InputError(f"{log_path}: {error}") from None
    steps = next_steps(verdict, prediction, files)
    _show_verdict(verdict, steps)
    show_findings(found)
    if out is not None:
        used = [results, files.controller, log_path, *([mapping] if mapping else [])]
        _write_verdict(out, verdict, prediction, steps, found, files=used)


def _robot_and_log(results: Path, inputs: Sequence[str]) -> tuple[str, Path]:
    beside = results.with_name("robot.toml")
    if len(inputs) == 1:
        if not beside.exists():
            raise InputError(
                f"{beside} is missing; keep a study's files in one folder, or give the robot before the log."
            )
        return str(beside), Path(inputs[0])
    if len(inputs) == 2 and not is_log_file(inputs[0]):
        return inputs[0], Path(inputs[1])
    raise InputError("--prediction compares one log: give the log, or the robot and the log.")


def _predicted_controller(path: Path, prediction: Prediction, robot: Robot) -> Controller:
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


def _show_verdict(verdict: Verdict, steps: Sequence[str]) -> None:
    console = standard_output()
    console.print(Text(headline(verdict), style="bold"), soft_wrap=True)
    for remark in verdict.remarks:
        console.print(remark.text, markup=False, soft_wrap=True)
    rows = quantity_rows(verdict)
    console.print(table("Predicted and measured", _PREDICTION_HEADINGS, rows, framed=console.is_terminal))
    lines = cause_lines(verdict)
    if lines:
        console.print(Text("Likely causes", style="bold"))
    for line in (*lines, *steps):
        console.print(line, markup=False, soft_wrap=True)


def _write_verdict(
    out: Path,
    verdict: Verdict,
    prediction: Prediction,
    steps: Sequence[str],
    found: Sequence[Finding],
    *,
    files: Sequence[Path],
) -> None:
    title = f"{files[2]}: the controller against its prediction"
    with open_result(out, command="validate", writes=_WRITTEN, inputs=files) as result:
        page = prediction_report(
            verdict, prediction, title=title, steps=steps, findings=found, made=result.origin
        )
        with result.replaced() as new:
            verdict_results = prediction_results(verdict, prediction, steps)
            result.write_json({"prediction": verdict_results}, new, findings=found)
            write_text(new / "report.html", page)
    result.show_file("report.html")


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class ModelOptions:
    """The two models that are compared."""

    against: str | None = None
    """The second model: another robot (preset or file), or this robot in the other formulation, thesis or exact. By
    default the same robot without friction."""

    formulation: Formulation = "exact"
    """Equations of motion of both robots: exact, or as the thesis prints them."""


_PAIR = ModelOptions()


def validate(
    robot: str,
    /,
    *logs: Path,
    out: Path | None = None,
    prediction: Path | None = None,
    pair: ModelOptions = _PAIR,
    controller: Path | None = None,
    mapping: Path | None = None,
    seed: WholeNumber = 0,
    accept: Accept = None,
) -> None:
    """Validate a robot's model against logs it was not fitted to: with and without friction, or any two models.

    Writes report.html and results.json: errors in open loop, in closed loop and over the prediction horizon, with
    95 % intervals on their ratio for each state, and an analysis of the one-step residuals.

    Example: ballbot validate found/robot.toml step.csv --out checked

    Example: ballbot validate found/robot.toml step.csv --against viscous/robot.toml --out laws

    Example: ballbot validate found/robot.toml step.csv --against thesis --out formulations

    With --prediction it compares a log with what a study predicts of its controller on the course that it names:
    each quantity inside or outside its 95 % interval, likely causes, and keep, weaken or revert.

    Example: ballbot validate --prediction found/results.json new.csv

    Parameters
    ----------
    robot
        A preset's name or a robot file, with friction: `ballbot study` and `ballbot identify` write one. May be left
        out with --prediction; it is then robot.toml beside the results.
    logs
        One or more logs of the robot balancing, with torques and states; one with --prediction.
    out
        The folder to write into. May be left out with --prediction; nothing is then written.
    prediction
        The results.json of a study, with the prediction for its controller.
    controller
        The controller file that was used when the logs were recorded. Without it, the gain is estimated from each log;
        with --prediction it is controller.toml beside the results.
    mapping
        A TOML file that describes the columns and units of foreign logs, as `ballbot check-log` writes it.
    seed
        Random seed of the noise floors. The same seed gives the same result.
    """
    if prediction is not None:
        _refuse_models(pair, seed)
        inputs = (robot, *map(str, logs))
        validate_prediction(
            prediction, inputs, out=out, controller=controller, mapping=mapping, accept=accept
        )
        return
    if out is None:
        raise InputError("--out is missing; name the folder to write into, such as --out checked.")
    check_seed(seed)
    models = _models(robot, pair.against, pair.formulation)
    described = models.first.model.robot
    named = read_balancing_logs(logs, mapping, described)
    driver = read_controller(controller, described) if controller else None
    found = check_input(
        described,
        dict(zip(logs, named.values(), strict=True)),
        accept=accept,
        source=robot,
        mappings=dict.fromkeys(logs, mapping),
    )
    inputs = input_files(logs, controller, mapping)
    with open_result(out, command="validate", writes=_WRITTEN, inputs=inputs, seed=seed) as result:
        parts = _validate(models, named, driver, seed)
        validation = replace(join_validations(tuple(parts.values())), log_findings=found)
        results = validation_results(validation)
        results["by_log"] = {name: validation_results(part) for name, part in parts.items()}
        first, second = models.names
        title = f"{described.name}: the model {first} and {second} against its logs"
        page = validation_report(
            validation,
            title=title,
            lead=f"On {', '.join(named)}.",
            example_of=next(iter(named)),
            made=result.origin,
        )
        with result.replaced() as new:
            result.write_json({"validation": results}, new, findings=found)
            write_text(new / "report.html", page)
    _show(validation)
    result.show_file("report.html")


def _refuse_models(pair: ModelOptions, seed: int) -> None:
    """Refuse the options that choose models: a prediction is compared with a log, and no model is."""
    given = {
        "--against": pair.against is not None,
        "--formulation": pair.formulation != "exact",
        "--seed": seed != 0,
    }
    for option, is_given in given.items():
        if is_given:
            raise InputError(
                f"{option} does not go with --prediction, which compares no models; leave it out."
            )


def _models(robot: str, against: str | None, formulation: Formulation) -> ModelPair:
    """Return the two models that the command line names."""
    model = Model(Robot.load(robot), formulation=formulation)
    if against is None:
        return ModelPair.by_friction(model)
    if against in get_args(Formulation):
        if against == formulation:
            raise InputError(
                f"--against {against} compares the {formulation} formulation with "
                "itself. Choose the other one with --formulation or --against."
            )
        return ModelPair.by_formulation(model)
    other = Model(Robot.load(against), formulation=formulation)
    return ModelPair.of_two(model, other, files=(robot, against))


def _validate(
    models: ModelPair, logs: dict[str, Log], controller: Controller | None, seed: int
) -> dict[str, Validation]:
    """Return the validation on each log; an error names the log."""
    console = standard_output()
    parts: dict[str, Validation] = {}
    with progress_bar(console, "validating") as bar:
        for number, (name, log) in enumerate(logs.items()):

            def report(now: Progress, number: int = number, name: str = name) -> None:
                bar.show((number + now.share) / len(logs), doing=f"validating {name}", note=now.stage)

            run = Run(seed=seed, progress=report)
            try:
                parts[name] = validate_pair(models, log, controller=controller, run=run)
            except InputError as error:
                raise InputError(f"{name}: {error}") from None
    return parts


def _show(validation: Validation) -> None:
    console = standard_output()
    loops = {
        "open loop": validation.open_loop and validation.open_loop.errors,
        "closed loop": validation.closed_loop and validation.closed_loop.restarted,
    }
    for what, errors in loops.items():
        if errors is not None:
            console.print(_error_table(what, errors, validation.models, framed=console.is_terminal))
    for finding in findings(validation):
        console.print(finding.text, markup=False, soft_wrap=True)


def _error_table(what: str, pair: ErrorPair, models: ModelPair, *, framed: bool) -> Table:
    lower, upper = pair.ratio_interval()
    verdicts = pair.verdicts()
    rows = [
        (
            name,
            digits(pair.first.error[i]),
            digits(pair.second.error[i]),
            digits(pair.ratio[i]),
            f"{digits(lower[i])} to {digits(upper[i])}" if np.isfinite(lower[i]) else "too few runs",
            verdicts[i] if np.isfinite(lower[i]) else "",
            digits(pair.first.rmse[i]),
            digits(pair.second.rmse[i]),
        )
        for i, name in enumerate(STATE_NAMES)
    ]
    headings = ("state", "(4.1) A", "B", "B/A", "95 %", "A is", "RMSE A", "B")
    title = f"{what}, {pair.runs} runs; A {models.first.name}, B {models.second.name}"
    return table(title, headings, rows, framed=framed)
