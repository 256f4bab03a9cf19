"""A prediction about a simulated run of the precise controller, whose log is known."""

from dataclasses import asdict, replace
from functools import cache
from pathlib import Path

import numpy as np

from ballbot import Robot
from ballbot.control.file import write_controller
from ballbot.control.presets import nominal_controller, precise_controller
from ballbot.files import write_text
from ballbot.log import Log
from ballbot.mechanics.model import Model
from ballbot.results import as_json
from ballbot.simulation.run import simulate
from ballbot.simulation.sensed_plant import SensedPlant
from ballbot.twin import Scenario
from ballbot.twin.imperfections import imperfections_of
from ballbot.workflows.controller_choice import NamedCourse
from ballbot.workflows.controller_prediction import ControllerPrediction, checksum_of, performance_intervals
from ballbot.workflows.metrics import QUANTITIES, LogScore

ALTEN = Robot.load("alten")
SCENARIO = Scenario.nominal(ALTEN)
KNOWN = ALTEN.replace(friction=SCENARIO.friction)
CONTROLLER = precise_controller(KNOWN)
#: half of the square: with less motion the parts of the torque cannot be separated
COURSE = NamedCourse(name="square", duration=24.0)


@cache
def predicted_log() -> Log:
    """Return the log of the run."""
    plant = SensedPlant(Model(KNOWN), imperfections_of(SCENARIO, known=KNOWN), estimator=CONTROLLER.estimator)
    reference = COURSE.reference_spec.reference()
    return simulate(plant, CONTROLLER, reference, duration=COURSE.duration, seed=1).without_truth()


@cache
def known_prediction() -> ControllerPrediction:
    """Return a prediction about what that log shows, and without compensation forty times its errors."""
    seen = LogScore.of(predicted_log(), torque_limit=CONTROLLER.torque_limit)
    random = np.random.default_rng(0)
    numbers = np.array(list(asdict(seen).values())) * np.exp(0.1 * random.standard_normal((20, 5)))
    similar = [LogScore(**dict(zip(QUANTITIES, each, strict=True))) for each in numbers.tolist()]
    without = [
        replace(one, peak_error=40.0 * one.peak_error, rms_error=40.0 * one.rms_error) for one in similar
    ]
    factor = dict.fromkeys(QUANTITIES, (0.6, 1.7))
    return ControllerPrediction(
        course=COURSE,
        controller="precise",
        checksum=checksum_of(CONTROLLER),
        torque_limit=CONTROLLER.torque_limit,
        scenario="nominal",
        draws=20,
        chosen=performance_intervals(similar, discrepancy=factor),
        none=performance_intervals(without, discrepancy=factor),
        log_findings=("short",),
    )


def write_predicting_study(folder: Path) -> Path:
    """Write a folder as a study leaves it, and return it."""
    folder.mkdir()
    write_text(folder / "results.json", as_json({"prediction": known_prediction()}))
    KNOWN.write(folder / "robot.toml")
    write_controller(CONTROLLER, folder / "controller.toml")
    write_controller(nominal_controller(KNOWN, compensation="none"), folder / "previous_controller.toml")
    return folder
