"""`ballbot simulate`: a closed-loop run of the model, as a log."""

from __future__ import annotations

import math
from pathlib import Path

from ballbot.cli.findings import Accept, check_robot, warn_of_idle_compensation, warn_of_overcompensation
from ballbot.cli.output import progress_bar, standard_output
from ballbot.control.controller import Compensation
from ballbot.control.file import read_controller
from ballbot.control.presets import nominal_controller
from ballbot.control.references import reference_from
from ballbot.estimation.interface import EstimatorName
from ballbot.files import write_text
from ballbot.fitting.run import check_seed
from ballbot.log import Log
from ballbot.log.formats import WRITTEN_ENDINGS, check_ending
from ballbot.mechanics.model import Model
from ballbot.mechanics.parameters import Formulation
from ballbot.report.page import as_json
from ballbot.result_folder import result_folder
from ballbot.robot import Robot
from ballbot.simulation.plant import Plant
from ballbot.simulation.run import simulate as run
from ballbot.simulation.sensed_plant import SensedPlant
from ballbot.twin import Scenario
from ballbot.twin.imperfections import imperfections_of
from ballbot.workflows.metrics import SETTLE, score, settled

_WRITTEN = (*(f"log.{ending}" for ending in WRITTEN_ENDINGS), "results.json")


def simulate(
    robot: str,
    /,
    *,
    reference: str = "square",
    duration: float = 32.0,
    controller: Path | None = None,
    compensation: Compensation = "none",
    formulation: Formulation = "exact",
    scenario: str | None = None,
    seed: int = 1,
    format: str = "csv",
    accept: Accept = None,
    out: Path,
) -> None:
    """Simulate a robot in closed loop on its equations of motion, with stick-slip friction.

    Example: ballbot simulate alten --reference square --duration 32 --out run1

    Example: ballbot simulate alten --controller mine.toml --scenario nominal --seed 3 --out run2

    Writes log.csv and results.json (position errors, torque, how the run ended).

    Parameters
    ----------
    robot
        A preset's name or a robot file, with its friction.
    reference
        The motion that the robot is to follow: hold, square, change_pose, circle, figure_eight, or a file with t,
        ref_x, ref_y and ref_psi, as ballbot excite writes it.
    duration
        Length of the run [s].
    controller
        A controller file, instead of the nominal gain and compensation.
    compensation
        Compensation of the robot's friction by the nominal controller: none, full or partial.
    formulation
        exact, or thesis (Appendix II as printed).
    scenario
        Sensors, delay, play, torque noise and floor of this scenario of the twin, a name or a file, on the equations
        of motion; the friction stays the robot's. The controller gets the state of the estimator that its file names.
        Perfect sensors if not given.
    seed
        Random seed of a scenario's noise. The same seed gives the same run.
    format
        File format of the log: csv or parquet.
    out
        The folder to write into.
    """
    described = Robot.load(robot)
    check_robot(described, robot, accept=accept)
    check_seed(seed)
    check_ending(format)
    path = reference_from(reference)
    chosen = (
        read_controller(controller, described)
        if controller
        else nominal_controller(described, compensation=compensation)
    )
    console = standard_output()
    if controller:
        warn_of_overcompensation({str(controller): chosen}, described, console)
    warn_of_idle_compensation({str(controller or "nominal controller"): chosen}, console)
    plant = _plant(Model(described, formulation), scenario, chosen.estimator)
    inputs = [Path(one) for one in (robot, reference, controller, scenario) if one and Path(one).is_file()]
    with result_folder(out, command="simulate", names=_WRITTEN, inputs=inputs) as folder:
        with progress_bar(console, f"simulating {duration:g} s") as bar:
            log = run(
                plant,
                chosen,
                path,
                duration=duration,
                seed=seed,
                progress=lambda now: bar.show(now.share),
            )
        with folder.replaced() as new:
            log.write(new / f"log.{format}")
            write_text(new / "results.json", as_json(_results(log)))
    console.print(str(folder.path / f"log.{format}"), soft_wrap=True)
    if log.ended:
        console.print(f"The run ended early: {log.ended}.", soft_wrap=True)


def _plant(model: Model, scenario: str | None, estimator: EstimatorName) -> Plant | Model:
    """Return the model, behind the sensors of a scenario where there is one."""
    if scenario is None:
        return model
    imperfections = imperfections_of(Scenario.load(scenario, model.robot))
    return SensedPlant(model, imperfections, estimator=estimator)


def _results(log: Log) -> dict[str, object]:
    results: dict[str, object] = {"rows": len(log), "sample_time": log.sample_time, "ended": log.ended}
    if settled(log, SETTLE).any():
        scores = score(log).to_dict()
        del scores["ended"]
        results |= {key: value for key, value in scores.items() if not _is_nan(value)}
    return results


def _is_nan(value: object) -> bool:
    return isinstance(value, float) and math.isnan(value)
