"""The friction that campaigns on control compensate: identified from two logs of the nominal twin."""

from __future__ import annotations

from ballbot.control.controller import Controller
from ballbot.control.presets import design_gain
from ballbot.control.references import figure_eight, square
from ballbot.identification import Bounds, Identification, identify
from ballbot.identification.identify import DEFAULT_OPTIONS, IdentificationOptions
from ballbot.robot import Robot
from ballbot.simulation.run import simulate
from ballbot.twin import Twin

RECORDED = 48.0  # seconds of each log


def identified_robot(
    robot: Robot,
    *,
    recorded: float = RECORDED,
    bounds: Bounds | None = None,
    options: IdentificationOptions = DEFAULT_OPTIONS,
) -> Robot:
    """Return the robot with the friction identified from two logs of its nominal twin."""
    return identified(robot, recorded=recorded, bounds=bounds, options=options).robot


def identified(
    robot: Robot,
    *,
    recorded: float = RECORDED,
    bounds: Bounds | None = None,
    options: IdentificationOptions = DEFAULT_OPTIONS,
) -> Identification:
    """Return the identification from two logs of the robot's nominal twin, each `recorded` seconds long."""
    controller = Controller(robot, design_gain(robot).gain)
    logs = [
        simulate(Twin(robot), controller, reference, duration=recorded, seed=seed).without_truth()
        for seed, reference in ((1, square(side=0.5, period=32.0)), (2, figure_eight()))
    ]
    return identify(robot, logs, bounds=bounds, seed=0, options=options)
