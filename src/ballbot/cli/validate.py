"""`ballbot validate`: two models of a robot against its logs, by default with its friction and without any.

With `--prediction`, a log made with a study's controller is compared with what the study predicted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from ballbot.cli.context import (
    MappingFile,
    Seed,
    open_result,
    read_balancing_log,
    read_balancing_logs,
)
from ballbot.cli.findings import Accept, check_input, show_findings
from ballbot.control.controller import Controller
from ballbot.control.file import read_controller
from ballbot.errors import InputError
from ballbot.findings import by_severity
from ballbot.fitting.run import Run, check_seed
from ballbot.log.formats import is_log_file
from ballbot.report.prediction import (
    next_steps,
    prediction_report,
)
from ballbot.report.run import over_time
from ballbot.report.validation import validation_report
from ballbot.report.words import logs_words
from ballbot.robot import Robot
from ballbot.validation import ModelPair, join_validations, validate_logs
from ballbot.validation.validation import fitted_findings
from ballbot.workflows.controller_prediction import (
    EXPLAINED_CODES,
    Prediction,
    check_controller,
    evaluate_log,
    read_prediction,
)


def _validate_prediction(
    results: Path,
    inputs: Sequence[str],
    *,
    out: Path | None,
    controller: Path | None,
    mapping: Path | None,
    accept: Accept,
) -> None:
    """Compare one log with a study's prediction, print the verdict, and write it if a folder is given."""
    prediction = read_prediction(results)
    source, log_path = _robot_and_log(results, inputs)
    robot = Robot.load(source)
    controller = controller or results.with_name("controller.toml")
    driver = _predicted_controller(controller, prediction, robot)
    log = read_balancing_log(log_path, mapping, robot)
    # what the robot does wrong, the verdict is about
    accepted = [*(accept or ()), *sorted(EXPLAINED_CODES)]
    found = check_input(robot, [log_path], [log], accept=accepted, mappings=[mapping], show=False)
    try:
        verdict = evaluate_log(prediction, log, driver, log_findings=found)
    except InputError as error:
        raise InputError(f"{log_path}: {error}") from None
    steps = next_steps(verdict, prediction, results=results, robot=Path(source), controller=controller)
    page = prediction_report(
        verdict,
        prediction,
        title=f"{log_path}: the controller against its prediction",
        series=over_time(log, robot),
        findings=found,
        steps=steps,
    )
    with open_result(out, command="validate", inputs=[results, log_path, controller, mapping]) as result:
        result.write(page, next_step=" ".join(steps))
    show_findings(found)


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


def validate(
    robot: str,
    /,
    *logs: Path,
    out: Path | None = None,
    prediction: Path | None = None,
    against: str | None = None,
    controller: Path | None = None,
    mapping: MappingFile = None,
    seed: Seed = 0,
    accept: Accept = None,
) -> None:
    """Validate a robot's model against logs that it was not fitted to: with and without friction, or any two
    models.

    Writes report.html and results.json: errors in open loop, in closed loop and over the prediction horizon, with
    95 % intervals on their ratio for each state, and an analysis of the one-step residuals.

    Example: ballbot validate found/robot.toml step.csv --out checked

    Example: ballbot validate found/robot.toml step.csv --against viscous/robot.toml --out laws

    With --prediction, compare a log with a study's prediction for its controller on the same course: which
    quantities lie outside their 95 % intervals and by how much, what else differs from the logs, and whether to keep,
    weaken or revert the controller.

    Example: ballbot validate --prediction found/results.json new.csv

    Parameters
    ----------
    robot
        A preset's name or a robot file, with friction: `ballbot study` and `ballbot identify` write one. Optional
        with --prediction: if left out, robot.toml beside the results.
    logs
        One or more logs of the robot balancing, with torques and states; exactly one with --prediction.
    out
        The folder to write into. Optional with --prediction: without it, nothing is written.
    prediction
        The results.json of a study, with the prediction for its controller.
    against
        The second model: another robot (preset or file), or thesis for this robot with the equations of motion of the
        published thesis. By default the same robot without friction.
    controller
        The controller file that was used when the logs were recorded. Without it, the gain is estimated from each log;
        with --prediction it is controller.toml beside the results.
    """
    if prediction is not None:
        for option, is_given in {"--against": against is not None, "--seed": seed != 0}.items():
            if is_given:
                raise InputError(
                    f"{option} does not go with --prediction, which compares no models; leave it out."
                )
        inputs = (robot, *map(str, logs))
        _validate_prediction(
            prediction, inputs, out=out, controller=controller, mapping=mapping, accept=accept
        )
        return
    if out is None:
        raise InputError("--out is missing; name the folder to write into, such as --out checked.")
    check_seed(seed)
    models = ModelPair.load(robot, against=against)
    described = models.first.model.robot
    named = read_balancing_logs(logs, mapping, described)
    driver = read_controller(controller, described) if controller else None
    found = check_input(described, logs, named.values(), accept=accept, mappings=[mapping])
    fitted = fitted_findings(models, named)
    show_findings(fitted)
    found = by_severity([*fitted, *found])
    inputs = [logs, controller, mapping]
    with open_result(out, command="validate", doing="validating", inputs=inputs, seed=seed) as result:
        run = Run(seed=seed, progress=result.report)
        parts = validate_logs(models, named, controller=driver, run=run)
        validation = replace(join_validations(tuple(parts.values())), log_findings=found)
        first, second = models.names
        title = f"{described.name}: the models {first} and {second} against its logs"
        page = validation_report(
            validation,
            title=title,
            lead=f"Validated on {logs_words(named)}.",
            by_log=parts,
        )
        step = f"`ballbot design {robot} --kind precise --out designed`"
        result.write(page, next_step=step)
