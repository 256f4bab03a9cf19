"""`ballbot validate`: two models of a robot against its logs; by default with its friction and without any."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
from rich.table import Table

from ballbot.cli.findings import Accept, accept_words, check_input
from ballbot.cli.output import progress_bar, standard_output, table
from ballbot.cli.study import read_balancing_logs
from ballbot.cli.validate_prediction import validate_prediction
from ballbot.control.controller import Controller
from ballbot.control.file import read_controller
from ballbot.errors import InputError
from ballbot.files import write_text
from ballbot.findings import finding_results
from ballbot.fitting.run import check_seed
from ballbot.log import STATE_NAMES, Log
from ballbot.mechanics.formulation import Formulation
from ballbot.mechanics.model import Model
from ballbot.printable import shell_line
from ballbot.report.json_text import as_json
from ballbot.report.provenance import provenance
from ballbot.report.tables import digits
from ballbot.report.validation_page import validation_report
from ballbot.report.validation_results import validation_results
from ballbot.result_folder import result_folder
from ballbot.robot import Robot
from ballbot.validation import (
    ErrorPair,
    ModelPair,
    Validation,
    findings,
    join_validations,
    validate_pair,
)

_WRITTEN = ("report.html", "results.json")


def validate(
    robot: str,
    /,
    *logs: Path,
    out: Path | None = None,
    prediction: Path | None = None,
    against: str | None = None,
    formulation: Formulation = "exact",
    controller: Path | None = None,
    mapping: Path | None = None,
    seed: int = 0,
    accept: Accept = None,
) -> None:
    """Validate a robot's model against logs it was not fitted to: with and without friction, or any two models.

    Writes report.html and results.json: errors in open loop, in closed loop and over the prediction horizon, with
    95 % intervals on their ratio for each state, and an analysis of the one-step residuals.

    Example: ballbot validate found/robot.toml step.csv --out checked

    Example: ballbot validate found/robot.toml step.csv --against viscous/robot.toml --out laws

    Example: ballbot validate found/robot.toml step.csv --against thesis --out formulations

    With --prediction it judges the controller of a study instead, by a log made with it on the course that the study
    names: each predicted quantity inside or outside its 95 % interval, likely causes, and keep, weaken or revert.

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
        The results.json of a study, with what it predicts of its controller.
    against
        The second model: another robot (preset or file), or this robot in the other formulation, thesis or exact. By
        default the same robot without friction.
    formulation
        Equations of motion of both robots: exact, or as the thesis prints them.
    controller
        The controller file that was used when the logs were recorded. Without it, the gain is estimated from each log;
        with --prediction it is controller.toml beside the results.
    mapping
        A TOML file that describes the columns and units of foreign logs, as `ballbot check-log` writes it.
    seed
        Random seed of the noise floors. The same seed gives the same result.
    """
    if prediction is not None:
        _refuse_models(against, formulation, seed)
        inputs = (robot, *map(str, logs))
        validate_prediction(
            prediction, inputs, out=out, controller=controller, mapping=mapping, accept=accept
        )
        return
    if out is None:
        raise InputError("--out is missing; name the folder to write into, such as --out checked.")
    check_seed(seed)
    models = _models(robot, against, formulation)
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
    words = ["ballbot", "validate", robot, *map(str, logs), "--out", str(out)]
    words += ["--against", against] if against else []
    words += ["--formulation", formulation] if formulation != "exact" else []
    words += ["--controller", str(controller)] if controller else []
    words += ["--mapping", str(mapping)] if mapping else []
    words += accept_words(accept)
    files = [*logs, *(path for path in (controller, mapping) if path)]
    made = provenance(command=shell_line(words), files=files, seed=seed)

    with result_folder(out, command="validate", names=_WRITTEN, inputs=files) as folder:
        parts = _validate(models, named, driver, seed)
        validation = replace(join_validations(tuple(parts.values())), log_findings=found)
        results = validation_results(validation)
        results["by_log"] = {name: validation_results(part) for name, part in parts.items()}
        whole = {"validation": results, "findings": finding_results(found), "provenance": made.to_dict()}
        first, second = models.names
        title = f"{described.name}: the model {first} and {second} against its logs"
        page = validation_report(
            validation, title=title, lead=f"On {', '.join(named)}.", example_of=next(iter(named)), made=made
        )
        with folder.replaced() as new:
            write_text(new / "results.json", as_json(whole))
            write_text(new / "report.html", page)
    _show(validation, folder.path / "report.html")


def _refuse_models(against: str | None, formulation: Formulation, seed: int) -> None:
    """Refuse the options that choose models: a prediction is compared with a log, and no model is."""
    given = {"--against": against is not None, "--formulation": formulation != "exact", "--seed": seed != 0}
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
    """Return the validation on each log; an error says which log it is about."""
    console = standard_output()
    parts: dict[str, Validation] = {}
    with progress_bar(console, "validating") as bar:
        for number, (name, log) in enumerate(logs.items()):
            bar.show(number / len(logs), doing=f"validating {name}")
            try:
                parts[name] = validate_pair(models, log, controller=controller, seed=seed)
            except InputError as error:
                raise InputError(f"{name}: {error}") from None
    return parts


def _show(validation: Validation, report: Path) -> None:
    console = standard_output()
    loops = {
        "open loop": validation.open_loop and validation.open_loop.errors,
        "closed loop": validation.closed_loop and validation.closed_loop.restarted,
    }
    for what, errors in loops.items():
        if errors is not None:
            console.print(_error_table(what, errors, validation.models, framed=console.is_terminal))
    for finding in findings(validation):
        console.print(finding, markup=False, soft_wrap=True)
    console.print(str(report), markup=False, soft_wrap=True)


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
