"""`ballbot compare`: controllers side by side on one plant."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Literal

from ballbot.cli.output import progress_bar, standard_output, table
from ballbot.control.controller import Controller
from ballbot.control.file import read_controller
from ballbot.control.nominal import nominal_controller
from ballbot.control.precise import precise_controller
from ballbot.control.references import named
from ballbot.errors import InputError
from ballbot.estimation.named import EstimatorName, named_estimator
from ballbot.experiments.compare import SETTLE, Comparison
from ballbot.experiments.compare import compare as run
from ballbot.files import write_text
from ballbot.mechanics.model import Model
from ballbot.robot import Robot
from ballbot.simulation.plant import Plant

PlantName = Literal["model", "twin"]


def compare(
    robot: str,
    controllers: tuple[str, ...] = ("none", "full", "partial"),
    /,
    *,
    plant: PlantName = "model",
    scenario: str = "nominal",
    estimator: EstimatorName = "onboard",
    reference: str = "square",
    duration: float = 32.0,
    settle: float = SETTLE,
    seeds: int = 3,
    out: Path,
) -> None:
    """Compare controllers in closed loop: the same plant, reference and seeds.

    Example: ballbot compare found.toml none full partial --plant twin --seeds 10 --out comparison

    Writes results.json with the means over the seeds and every run's scores.

    Parameters
    ----------
    robot
        A preset's name or a robot file. Its friction is what is compensated, and what the model has.
    controllers
        Controller files, or none, full and partial: the nominal gain with that compensation; or precise.
    plant
        model, or twin: a MuJoCo robot whose faults are the scenario's.
    scenario
        Of the twin.
    estimator
        Whose state is fed back on the twin: onboard, or kalman, which a stiff controller needs.
    reference
        Where the robot is asked to be: hold, square, change_pose, circle or figure_eight.
    duration
        Of a run [s].
    settle
        Errors count from this long after the start and after each jump of the reference [s].
    seeds
        Runs of each controller.
    out
        The folder to write into.
    """
    described = Robot.load(robot)
    chosen = {name: _controller(name, described) for name in controllers}
    console = standard_output()
    with progress_bar(console, f"{len(chosen) * seeds} runs on the {plant}") as bar:
        comparison = run(
            _plant_factory(plant, described, scenario, estimator),
            chosen,
            named(reference),
            duration=duration,
            seeds=range(1, seeds + 1),
            settle=settle,
            threads=os.cpu_count() or 1,
            progress=bar.show,
        )
    write_text(out / "results.json", json.dumps(_results(comparison), indent=2) + "\n")
    headings = ["controller", "peak (m)", "worst (m)", "RMS (m)", "torque (N m)", "change (N m)", "falls"]
    console.print(
        table("Position error once settled", headings, _rows(comparison), framed=console.is_terminal)
    )
    console.print(str(out / "results.json"), soft_wrap=True)


def _controller(name: str, robot: Robot) -> Controller:
    if name == "none" or name == "full" or name == "partial":
        return nominal_controller(robot, compensation=name)
    if name == "precise":
        return precise_controller(robot)
    if not Path(name).exists():
        raise InputError(
            f"There is no controller file {name!r}; it must be a file's path, or none, full, partial or precise."
        )
    return read_controller(name, robot)


def _plant_factory(
    plant: PlantName, robot: Robot, scenario: str, estimator: EstimatorName
) -> Callable[[], Plant | Model]:
    if plant == "model":
        return lambda: Model(robot)
    from ballbot.twin import Scenario, Twin  # MuJoCo is an extra

    faults = Scenario.load(scenario, robot)
    sample_time = faults.sensors.sample_time
    return lambda: Twin(robot, faults, estimator=named_estimator(estimator, robot, sample_time=sample_time))


def _rows(comparison: Comparison) -> list[list[str]]:
    rows = []
    for name in comparison.scores:
        summary = comparison.summary(name)
        lengths = (summary.peak_position_error, summary.worst_position_error, summary.rms_position_error)
        torques = (summary.rms_torque, summary.rms_torque_change)
        numbers = ["-" if math.isnan(value) else f"{value:.4f}" for value in (*lengths, *torques)]
        rows.append([name, *numbers, f"{summary.falls} of {summary.runs}"])
    return rows


def _results(comparison: Comparison) -> dict[str, object]:
    return {
        "seeds": list(comparison.seeds),
        "comparison": {name: _finite(asdict(comparison.summary(name))) for name in comparison.scores},
        "runs": {name: [_finite(asdict(one)) for one in runs] for name, runs in comparison.scores.items()},
    }


def _finite(values: dict[str, object]) -> dict[str, object]:
    """JSON knows no NaN."""
    return {
        key: None if isinstance(value, float) and math.isnan(value) else value
        for key, value in values.items()
    }
