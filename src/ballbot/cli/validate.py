"""`ballbot validate`: two models of a robot against its logs, by default with its friction and without any.

With `--prediction`, a log made with a study's controller is compared with the study's prediction.
"""

from dataclasses import replace
from pathlib import Path

from ballbot.cli import options
from ballbot.cli.context import open_result, read_balancing_log, read_balancing_logs
from ballbot.cli.findings import check_input, show_findings
from ballbot.control.source import as_controller, named_controller
from ballbot.errors import InputError, about
from ballbot.findings import by_severity
from ballbot.fitting.run import Run
from ballbot.report.prediction import next_steps, prediction_report
from ballbot.report.run import over_time
from ballbot.report.validation import validation_report
from ballbot.report.words import logs_words
from ballbot.robot import Robot
from ballbot.validation import ModelPair, join_validations, validate_logs
from ballbot.validation.validation import fitted_findings
from ballbot.workflows.controller_prediction import (
    EXPLAINED_CODES,
    check_controller,
    evaluate_log,
    read_prediction,
)


def _validate_prediction(
    results: Path,
    file: Path,
    *,
    out: Path | None,
    controller: Path,
    mapping: Path | None,
    accept: options.Accept,
) -> None:
    """Compare one log with a study's prediction, print the verdict, and write it if a folder is given."""
    prediction, beside = read_prediction(results), results.with_name("robot.toml")
    robot = Robot.load(beside)
    driver = named_controller(controller, robot)
    check_controller(prediction, driver, file=controller)
    log = read_balancing_log(file, mapping, robot)
    # errors that the verdict itself explains do not stop the command
    accepted = [*(accept or ()), *sorted(EXPLAINED_CODES)]
    findings = check_input(robot, [file], [log], accept=accepted, show=False)
    with about(file):
        verdict = evaluate_log(prediction, log, driver, log_findings=findings)
    steps = next_steps(verdict, prediction, results=results, robot=beside, controller=controller)
    page = prediction_report(
        verdict,
        prediction,
        title=f"{file}: the controller against its prediction",
        series=over_time(log, robot),
        findings=findings,
        steps=steps,
    )
    with open_result(out, beside=[controller]) as result:
        result.write(page, next_step=" ".join(steps))
    show_findings(findings)


def validate(
    robot: options.Robot,
    /,
    *logs: Path,
    out: Path | None = None,
    prediction: Path | None = None,
    against: str | None = None,
    controller: str | None = None,
    mapping: options.Mapping = None,
    seed: options.Seed = 0,
    accept: options.Accept = None,
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
    logs
        One or more logs of the robot balancing, with torques and states. With --prediction give the log alone: the
        robot is robot.toml beside the results.
    out
        The folder to write into; without it, which only --prediction allows, nothing is written.
    prediction
        The results.json of a study, with the prediction for its controller.
    against
        The second model: another robot (preset or file), or thesis for this robot with the equations of motion of the
        published thesis. By default the same robot without friction.
    controller
        The controller that was used when the logs were recorded, as of ballbot simulate. Without it, the gain is
        estimated from each log; with --prediction it is controller.toml beside the results.
    """
    if prediction is not None:
        if logs or against is not None:
            raise InputError("--prediction compares one log: give it alone, without a robot and --against.")
        file = Path(controller) if controller else prediction.with_name("controller.toml")
        _validate_prediction(
            prediction, Path(robot), out=out, controller=file, mapping=mapping, accept=accept
        )
        return
    if out is None:
        raise InputError("--out is missing; name the folder to write into, such as --out checked.")
    models = ModelPair.load(robot, against=against)
    described = models.first.model.robot
    named = read_balancing_logs(logs, mapping, described)
    driver = as_controller(controller, described) if controller else None
    findings = check_input(described, logs, named.values(), accept=accept)
    fitted = fitted_findings(models, named)
    show_findings(fitted)
    findings = by_severity([*fitted, *findings])
    with open_result(out, doing="validating", seed=seed) as result:
        run = Run(seed=seed, progress=result.report)
        parts = validate_logs(models, named, controller=driver, run=run)
        validation = replace(join_validations(tuple(parts.values())), log_findings=findings)
        first, second = models.names
        title = f"{described.name}: the models {first} and {second} against its logs"
        page = validation_report(
            validation, title=title, lead=f"Validated on {logs_words(named)}.", by_log=parts
        )
        step = f"`ballbot design {robot} --kind precise --out designed`"
        result.write(page, next_step=step)
