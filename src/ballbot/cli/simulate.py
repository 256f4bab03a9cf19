"""`ballbot simulate`: a closed-loop run of the model, as a log."""

from ballbot.cli import options
from ballbot.cli.context import Content, open_result
from ballbot.cli.controllers import Chosen, warn_of_idle_compensation
from ballbot.cli.findings import checked_robot
from ballbot.cli.output import notice
from ballbot.control.references import as_reference
from ballbot.control.source import read_source
from ballbot.log.formats import WRITTEN_SUFFIXES
from ballbot.mechanics.model import Model
from ballbot.mechanics.parameters import Formulation
from ballbot.progress import in_stage
from ballbot.report.run import simulation_report
from ballbot.robot.file import robot_text
from ballbot.twin.imperfections import left_out
from ballbot.twin.run import simulate as run
from ballbot.twin.scenario_file import load_scenario

_WRITTEN = (*(f"log{suffix}" for suffix in WRITTEN_SUFFIXES), "robot.toml")


def simulate(
    robot: options.Robot,
    /,
    *,
    reference: options.Reference = "square",
    duration: options.Duration = 32.0,
    controller: Chosen = "nominal",
    formulation: Formulation = "exact",
    scenario: options.Scenario | None = None,
    seed: options.Seed = 1,
    format: options.LogFormat = "csv",
    accept: options.Accept = None,
    change: options.Changes = None,
    out: options.Out,
) -> None:
    """Simulate a robot in closed loop on its equations of motion, with stick-slip friction.

    Writes report.html, log.csv, results.json (position errors, torque, how the run ended) and robot.toml, the robot of
    the log. A scenario is added to the equations of motion and friction of the robot's file; the controller then uses
    the estimator that its own file names. Without a scenario, sensors are perfect.

    Example: ballbot simulate alten --reference square --duration 32 --out run1

    Example: ballbot simulate alten --controller mine.toml --scenario nominal --seed 3 --out run2

    Parameters
    ----------
    formulation
        exact, or thesis (approximate equations of a published ballbot model).
    """
    described, findings = checked_robot(robot, change, accept=accept)
    path = as_reference(reference)
    driver = read_source(controller, described)
    warn_of_idle_compensation(controller, driver)
    truth = None if scenario is None else load_scenario(scenario, described)
    if truth is not None:
        notice(f"Left out: {', '.join(left_out(truth, identified=not described.friction.roller_softness))}.")
    with open_result(out, doing=f"simulating {duration:g} s", writes=_WRITTEN, seed=seed) as result:
        log = run(
            Model(described, formulation),
            driver,
            path,
            duration=duration,
            seed=seed,
            scenario=truth,
            progress=in_stage(result.report, f"simulating {duration:g} s"),
        )
        page = simulation_report(
            log,
            described,
            reference=reference,
            formulation=formulation,
            scenario=scenario,
            findings=findings,
        )
        files: dict[str, Content] = {f"log.{format}": log.write, "robot.toml": robot_text(described)}
        name = f"log.{format}"
        step = f"`ballbot view {result.path(name)}`"
        result.write(page, files=files, named=[name], next_step=step)
