"""Find the largest tilts and impulses from which the robot recovers, on the model and the twin.

Loop and twin have the same friction and sensors here, so that they differ only in what the loop leaves out: slipping
and lifting wheels, play, rollers.
"""

from dataclasses import dataclass

import numpy as np

from ballbot.control.controller import Compensation, Controller
from ballbot.control.presets import nominal_controller
from ballbot.fitting.run import Run
from ballbot.report.limits import directions_figure, planes_figure
from ballbot.robot import Robot
from ballbot.twin import Scenario
from ballbot.workflows.limits import ControlledRobot, RobotLimits, TwinLimit, find_limits, twin_limits
from campaigns.section import Section, write_picture

#: compensation and torque limit [N m]
CASES: tuple[tuple[Compensation, float], ...] = (
    ("none", 6.0),
    ("full", 6.0),
    ("partial", 6.0),
    ("none", 4.0),
    ("none", 3.0),
    ("none", 2.0),
)
#: directions tried on the twin, of 36
ON_TWIN = (0, 9, 18, 27)


@dataclass(frozen=True, kw_only=True)
class Case:
    """One closed loop's limits."""

    name: str
    model: RobotLimits
    twin: list[TwinLimit]


def campaign() -> Section:
    """Find the limits and return the section of docs/generated/evidence.md."""
    robot = Robot.load("alten")
    robot = robot.replace(friction=Scenario.nominal(robot).friction)
    cases = [_case(robot, compensation, limit) for compensation, limit in CASES]
    drawn = cases[:2]
    model, twin = {case.name: case.model for case in drawn}, {case.name: case.twin for case in drawn}
    pictures = [
        write_picture("limits_planes", lambda: planes_figure(model)),
        write_picture("limits_directions", lambda: directions_figure(model, twin)),
    ]
    compared = [limit.agrees for case in cases for limit in case.twin]
    return Section(
        title="The largest tilts and impulses from which the robot recovers",
        before="The smallest over four directions of the largest tilt at rest, and of the largest impulse at the height"
        " of the centre of mass, from which the nominal gain recovers: on the loop if no wheel may slip (grip 1), on"
        " the nominal twin, and on the loop with wheels that never slip. A push on the twin lasts 20 ms.",
        columns=[
            "compensation, torque limit",
            *(f"{kind}: {which}" for kind in ("tilt [deg]", "impulse [N s]") for which in _BOUNDS),
        ],
        rows=[_row(case) for case in cases],
        after=f"The twin's limit lies between the model's two bounds in {sum(compared)} of {len(compared)}"
        " cases, to 5 %.\n\n"
        + "\n\n".join(f"![{alt}]({path})" for alt, path in zip(_ALTS, pictures, strict=True)),
    )


_BOUNDS = ("no wheel slips", "twin", "wheels never slip")
_ALTS = (
    "Leans and lean rates in the worst direction from which the robot recovers",
    "Tilts and impulses over all directions from which the robot recovers",
)


def _case(robot: Robot, compensation: Compensation, limit: float) -> Case:
    nominal = nominal_controller(robot, compensation=compensation)
    controller = Controller(robot, nominal.gain, compensation=compensation, torque_limit=limit)
    loop = ControlledRobot(robot=robot, controller=controller, scenario=Scenario.nominal(robot))
    model = find_limits(loop)
    edges = twin_limits(loop, model, directions=ON_TWIN, run=Run(seed=1))
    return Case(name=f"{compensation}, {limit:g} N m", model=model, twin=edges)


def _row(case: Case) -> list[str]:
    cells = [case.name]
    for kind, unit in (("lean", 180.0 / np.pi), ("impulse", 1.0)):
        edges = [edge for edge in case.twin if edge.kind == kind]
        cells += [
            f"{unit * min(getattr(edge, which) for edge in edges):.1f}"
            for which in ("lower", "twin", "upper")
        ]
    return cells
