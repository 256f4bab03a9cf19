"""The friction that campaigns on control compensate: identified from two logs of the nominal twin, as in the demo."""

from __future__ import annotations

from ballbot.control.presets import nominal_controller
from ballbot.control.references import figure_eight, square
from ballbot.identification import Identification, identify
from ballbot.robot import Robot
from ballbot.simulation.run import simulate
from ballbot.twin import Twin


def identified(robot: Robot) -> Identification:
    """Return the identification from two logs of 48 s of the robot's nominal twin, without compensation."""
    logs = [
        simulate(Twin(robot), nominal_controller(robot), reference, duration=48.0, seed=seed).without_truth()
        for seed, reference in ((1, square(side=0.5, period=32.0)), (2, figure_eight()))
    ]
    return identify(robot, logs, seed=0)
