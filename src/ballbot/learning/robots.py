"""The robots that learning draws from: one, uniform boxes about it, or what an identification leaves open.

A study or an identification writes the standard deviations and correlations of what it found into `robot.toml`, and
the spread between logs into `results.json`. Another day's robot is drawn from both, as every command draws robots from
an identification (`ballbot.robot.variations.draw_robots`): its numbers are normal about the estimates with the
covariance C + diag(t^2), C of the estimates and t the spread between logs.
"""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from ballbot.control.overcompensation import has_friction
from ballbot.errors import InputError
from ballbot.files import read_json
from ballbot.identification.quantities import BY_NAME as QUANTITIES
from ballbot.identification.quantities import FRICTION
from ballbot.robot import Robot, as_robot
from ballbot.robot.components import scaled_body, scaled_friction
from ballbot.robot.variations import draw_robots, uncertain
from ballbot.simulation.imperfections import MAX_DELAY
from ballbot.twin.imperfections import with_identified
from ballbot.twin.scenario import Scenario
from ballbot.workflows.grid import LoopRobot

#: robots of a pool
DRAWN = 64
#: of the boxes: the body's mass, the height of its centre of mass and each friction may differ by these shares, as in
#: published work (floor friction of 0.6 to 1.2)
MASS, HEIGHT, FRICTION_SHARE = 0.2, 0.2, 1.0 / 3.0
#: of the boxes: most samples by which torques come late, and the steepest floor [rad]
DELAY, TILT = 2, math.radians(1.0)


def learned_robot(robot: Robot | None, randomize: str | Path | None) -> Robot:
    """Return the robot that is known: the one given, else that of the identification that robots are drawn from.

    InputError if both are given and differ in name.
    """
    if randomize is None or randomize == "boxes":
        return robot if robot is not None else as_robot("alten")
    identified = Robot.load(_in_folder(randomize, "robot.toml"))
    if robot is not None and robot.name != identified.name:
        raise InputError(
            f"{randomize} is an identification of {identified.name!r}, not of {robot.name!r}; give no robot, or this."
        )
    return identified


def drawn_robots(
    robot: Robot, scenario: Scenario, randomize: str | Path | None, *, seed: int = 0, count: int = DRAWN
) -> list[LoopRobot]:
    """Return the robots that episodes draw from; their estimator knows `robot`.

    Parameters
    ----------
    robot : Robot
        With friction that was identified; a robot without any has the scenario's. Wheels touch in a point, since
        identified friction contains the losses of the rollers.
    scenario : Scenario
        Sensors, drive and floor of all robots.
    randomize : None, "boxes" or a folder
        Only that robot; `count` from uniform boxes about it, or from the result of a study or an identification.
    seed : int
        The same seed gives the same robots.

    Raises
    ------
    InputError
        If the folder has no such result, or the result states no standard deviation.
    """
    if not has_friction(robot.friction):
        robot = robot.replace(friction=scenario.friction)
    scenario = with_identified(scenario, robot.friction)
    if randomize is None:
        return [LoopRobot.of(robot, scenario, known=robot)]
    if randomize == "boxes":
        random = np.random.default_rng([seed, 71])
        return [_drawn_from_boxes(robot, scenario, random, seed=seed + lane) for lane in range(count)]
    folder = Path(randomize)
    if not uncertain(robot):
        raise InputError(
            f"{folder / 'robot.toml'} states no standard deviations; give a study's or identify's folder."
        )
    spread = _between_logs(read_json(_in_folder(folder, "results.json")), robot.wheel_count)
    return [
        LoopRobot.of(drawn, scenario, known=robot)
        for drawn in draw_robots(robot, count, seed=seed, further=spread)
    ]


def _drawn_from_boxes(
    robot: Robot, scenario: Scenario, random: np.random.Generator, *, seed: int
) -> LoopRobot:
    """Return a robot about the one known, each number uniform within its range and independent of the others."""
    mass, height = (1.0 + random.uniform(-1.0, 1.0, 2) * (MASS, HEIGHT)).tolist()
    *wheels, rolling = 1.0 + FRICTION_SHARE * random.uniform(-1.0, 1.0, robot.wheel_count + 1)
    delay, slope = int(random.integers(0, DELAY + 1)), math.tan(TILT * random.uniform())
    uphill = random.uniform(0.0, 2.0 * np.pi)
    true = robot.replace(
        body=scaled_body(robot.body, mass=mass, height=height),
        friction=scaled_friction(robot.friction, wheels, rolling_factor=float(rolling)),
    )
    drawn = LoopRobot.of(true, scenario, known=robot)
    imperfections = replace(
        drawn.imperfections,
        delay=min(drawn.imperfections.delay + delay, MAX_DELAY),
        slope=(slope * math.cos(uphill), slope * math.sin(uphill)),
        seed=seed,
    )
    return replace(drawn, imperfections=imperfections)


def _between_logs(tree: object, wheels: int) -> dict[str, float]:
    """Return the spread between logs by a robot file's labels, from the results of a study or an identification."""
    if not isinstance(tree, dict):
        return {}
    found = tree.get("between_logs")
    if not isinstance(found, dict):
        parts = (_between_logs(part, wheels) for part in tree.values())
        return next((part for part in parts if part), {})
    sizes = found.get("standard_deviations")
    if not (isinstance(sizes, dict) and all(isinstance(size, int | float) for size in sizes.values())):
        raise InputError(
            "between_logs in results.json has no standard_deviations in numbers; run the study again."
        )
    by_label = {}
    for name in FRICTION:
        labels = QUANTITIES[name].labels(wheels)
        for index, label in enumerate(labels):
            place = f"[{index}]" if len(labels) > 1 else ""
            by_label[f"friction.{name}{place}"] = float(sizes.get(label, 0.0))
    return by_label


def _in_folder(folder: str | Path, name: str) -> Path:
    path = Path(folder) / name
    if not path.is_file():
        raise InputError(
            f"There is no {path}; robots are drawn from the folder of a study or an identification, or from boxes."
        )
    return path
