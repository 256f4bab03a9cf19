"""`ballbot study`: the main job, from a robot and its logs to a report and a controller."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ballbot.arguments import names_listed
from ballbot.cli import options
from ballbot.cli.context import changed_robot, open_result, read_balancing_logs
from ballbot.cli.findings import check_input
from ballbot.fitting.run import Run
from ballbot.identification import read_bounds
from ballbot.identification.windows import back_emf_of
from ballbot.log.checks import CheckedLogs
from ballbot.report.study import STUDY_FILES, next_step, study_report, study_texts
from ballbot.twin.scenario_file import load_scenario
from ballbot.workflows.study import StudyOptions
from ballbot.workflows.study import study as run_study


def study(
    robot: options.Robot,
    /,
    *logs: options.Log,
    change: options.Changes = None,
    out: options.Out,
    scenario: options.Scenario = "nominal",
    draws: options.WholeNumber = StudyOptions.draws,
    confirm: Annotated[bool, Parameter(negative="--no-confirm")] = True,
    exclude_states: str = "",
    mapping: options.Mapping = None,
    bounds: Path | None = None,
    seed: options.Seed = 0,
    accept: options.Accept = None,
) -> None:
    """Identify a robot's friction from its logs, validate the model, and choose the best controller for it.

    Writes report.html, results.json, robot.toml (with the identified friction), controller.toml, and
    previous_controller.toml to revert to; compensated_controller.toml is the best that compensates friction, if the
    chosen one does not. The candidates (nominal gain with no, full and partial compensation, and the precise controller
    with full compensation and without) run on 100 simulated robots drawn from the identified uncertainty, and the
    chosen one on the physics-engine twin if MuJoCo is installed. With 6 robots or more results.json also predicts the
    next run with the chosen controller; `ballbot validate --prediction` compares a log with it.

    Example: ballbot study alten square.csv hold.csv --out found

    Parameters
    ----------
    logs
        One or more logs of the robot balancing, with torques and states.
    draws
        Number of simulated robots, 6 or more: fewer have no 95 % interval.
    confirm
        Whether the chosen controller and the soft gain run on the physics-engine twin as well.
    exclude_states
        States whose errors do not count in the fit, separated by commas, such as psi,psi_dot if the ball pivots on the
        floor. They are still validated.
    bounds
        A TOML file with lower and upper bounds of the friction parameters.
    """
    described = changed_robot(robot, change)
    named = read_balancing_logs(logs, mapping, described)
    within = read_bounds(bounds) if bounds else None
    findings = check_input(described, logs, named.values(), accept=accept)
    back_emf, excluded = back_emf_of([mapping] if mapping else [], described), names_listed(exclude_states)
    truth = load_scenario(scenario, described)
    with open_result(out, doing="reading", writes=STUDY_FILES, seed=seed) as result:
        assert result.folder is not None
        studied = run_study(
            described,
            CheckedLogs(logs=named, findings=findings),
            scenario=truth,
            options=StudyOptions(
                bounds=within,
                excluded_states=excluded,
                back_emf=back_emf,
                draws=draws,
                confirm=confirm,
            ),
            run=Run(seed=seed, progress=result.report),
        )
        result.write(
            study_report(studied),
            files=study_texts(studied, result.folder.path),
            next_step=next_step(studied, result.path),
        )
