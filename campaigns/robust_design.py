"""Optimise weights over perturbed robots, and test them on other robots and on the twin."""

from collections.abc import Sequence
from dataclasses import replace
from time import perf_counter

import numpy as np

from ballbot.control.controller import Controller
from ballbot.control.references import square
from ballbot.estimation.interface import EstimatorName
from ballbot.robot import Robot
from ballbot.robot.components import scaled_body
from ballbot.twin import Scenario
from ballbot.twin.faults import Timing
from ballbot.workflows.controller_choice import SQUARE
from ballbot.workflows.grid import Condition, TwinRobot, grid_runs, run_grid
from ballbot.workflows.metrics import SETTLE, Score
from ballbot.workflows.robust_design import Effort, PerturbationRanges, RobustDesign, robust_design
from campaigns.section import Section
from campaigns.twin_logs import identified

EFFORT = Effort(robots=200, generations=15, population=10, fresh=500)
#: robots that differ from the one described, on the twin: shares of mass and height, samples of delay, tilt [rad]
TWINS = (
    ("nominal twin", 1.0, 1.0, 0, 0.0),
    ("20 % lighter and lower, 1° floor", 0.8, 0.8, 0, 0.0175),
    ("20 % heavier and taller, 2 samples late, 1° floor", 1.2, 1.2, 2, 0.0175),
)
#: whose state is fed back on the twins
ESTIMATORS: dict[EstimatorName, str] = {"kalman": "Kalman filter's state", "onboard": "thesis's state"}
SEEDS = (300, 301, 302)


def campaign() -> Section:
    """Search, compare, and return the section of docs/generated/evidence.md."""
    robot = identified().robot
    began = perf_counter()
    result = robust_design(
        robot,
        compensation="full",
        spread=PerturbationRanges(),
        scenario=Scenario.nominal(robot),
        effort=EFFORT,
    )
    took = perf_counter() - began
    controllers = {
        name: Controller(robot, design.gain, compensation="full") for name, design in result.compared.items()
    }
    weights = ", ".join(f"{weight:.3g}" for weight in result.state_weights)
    return Section(
        title="Weights optimised over perturbed robots",
        before=f"`ballbot design --robust --compensation full`: {EFFORT.robots} perturbed robots (mass, height and"
        f" friction 20 %, up to 2 samples late, floor up to 1°) evaluate every candidate, {len(result.history)} "
        f"generations"
        f" of {EFFORT.population} ({took:.0f} s); compared on {EFFORT.fresh} fresh robots, and on twins that differ "
        f"from the robot file: peak position error on a 0.5 m square at least {SETTLE:g} s after each corner, mean of"
        f" {len(SEEDS)} seeds (torque's change from sample to sample in brackets). Friction identified from the twin's"
        " logs.",
        columns=["", "weights found", "nominal weights"],
        rows=[
            *_on_fresh(result),
            *(_on_twin(robot, controllers, case, state) for state in ESTIMATORS for case in TWINS),
        ],
        after=f"Found: Q = diag({weights}), R = {result.torque_weight:g} I.",
    )


_ORDER = ("robust", "nominal")


def _on_fresh(result: RobustDesign) -> list[list[str]]:
    designs = [result.compared[name] for name in _ORDER]
    return [
        ["worst tenth of J", *(f"{design.worst_tenth:.2f}" for design in designs)],
        ["mean J", *(f"{design.mean:.2f}" for design in designs)],
        ["worst tenth of settled errors [mm]", *(f"{1e3 * design.worst_error:.0f}" for design in designs)],
        ["worst tenth of torque changes [N m]", *(f"{design.worst_roughness:.3f}" for design in designs)],
        ["falls", *(f"{design.falls}" for design in designs)],
    ]


def _on_twin(
    robot: Robot,
    controllers: dict[str, Controller],
    case: tuple[str, float, float, int, float],
    state: EstimatorName,
) -> list[str]:
    name, mass, height, delay, tilt = case
    true = robot.replace(body=scaled_body(robot.body, mass=mass, height=height))
    scenario = replace(
        Scenario.nominal(true), floor_tilt=(tilt, 0.0), timing=Timing(delay=delay) if delay else None
    )
    plant = TwinRobot(robot=true, scenario=scenario, known=robot)
    conditions = [
        Condition(plant=plant, reference=square, duration=SQUARE.duration, seed=seed) for seed in SEEDS
    ]
    asked = {design: law.with_estimator(state) for design, law in controllers.items()}
    made = run_grid(grid_runs(asked, conditions))
    return [f"{name}, {ESTIMATORS[state]}: peak error [mm]", *(_cell(made.of(design)) for design in _ORDER)]


def _cell(scores: Sequence[Score]) -> str:
    falls = sum(score.ended is not None for score in scores)
    if falls:
        return f"{falls} of {len(scores)} fall"
    peak, rough = np.mean([(score.peak_position_error, score.rms_torque_change) for score in scores], axis=0)
    return f"{1e3 * peak:.0f} ({rough:.2f} N m)"
