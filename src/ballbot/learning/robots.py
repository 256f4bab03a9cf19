"""The robots that learning draws from: one, or uniform boxes about it."""

import math
from dataclasses import replace

import numpy as np

from ballbot.control.overcompensation import has_friction
from ballbot.errors import InputError
from ballbot.robot import Robot
from ballbot.robot.components import scaled_body, scaled_friction
from ballbot.simulation.imperfections import MAX_DELAY, Grip
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
#: of the boxes: the friction coefficients beyond which wheels slip on the ball, and the ball on the floor
GRIP = 0.4, 1.0


def drawn_robots(
    robot: Robot, scenario: Scenario, randomize: str | None, *, seed: int = 0, count: int = DRAWN
) -> list[LoopRobot]:
    """Return the robots that episodes draw from; their estimator knows `robot`.

    Parameters
    ----------
    robot : Robot
        With friction that was identified; a robot without any has the scenario's. Wheels touch in a point, since
        identified friction contains the losses of the rollers.
    scenario : Scenario
        Sensors, drive and floor of all robots.
    randomize : None or "boxes"
        Only that robot, or `count` from uniform boxes about it.
    seed : int
        The same seed gives the same robots.

    Raises
    ------
    InputError
        If `randomize` is another word.
    """
    if not has_friction(robot.friction):
        robot = robot.replace(friction=scenario.friction)
    scenario = with_identified(scenario, robot.friction)
    if randomize is None:
        return [LoopRobot.of(robot, scenario, known=robot)]
    if randomize != "boxes":
        raise InputError(
            f"randomize is {str(randomize)!r}; it can only be 'boxes'. For robots about one that was identified, give "
            "its robot.toml as the robot."
        )
    random = np.random.default_rng([seed, 71])
    return [_drawn_from_boxes(robot, scenario, random, seed=seed + lane) for lane in range(count)]


def _drawn_from_boxes(
    robot: Robot, scenario: Scenario, random: np.random.Generator, *, seed: int
) -> LoopRobot:
    """Return a robot about the one known, each number uniform within its range and independent of the others."""
    mass, height = (1.0 + random.uniform(-1.0, 1.0, 2) * (MASS, HEIGHT)).tolist()
    *wheels, rolling = 1.0 + FRICTION_SHARE * random.uniform(-1.0, 1.0, robot.wheel_count + 1)
    delay, slope = int(random.integers(0, DELAY + 1)), math.tan(TILT * random.uniform())
    uphill = random.uniform(0.0, 2.0 * np.pi)
    grip, floor_grip = random.uniform(*GRIP, 2).tolist()
    true = robot.replace(
        body=scaled_body(robot.body, mass=mass, height=height),
        friction=scaled_friction(robot.friction, wheels, rolling_factor=float(rolling)),
    )
    drawn = LoopRobot.of(true, scenario, known=robot)
    imperfections = replace(
        drawn.imperfections,
        delay=min(drawn.imperfections.delay + delay, MAX_DELAY),
        slope=(slope * math.cos(uphill), slope * math.sin(uphill)),
        grip=Grip(wheels=grip, floor=floor_grip),
        seed=seed,
    )
    return replace(drawn, imperfections=imperfections)
