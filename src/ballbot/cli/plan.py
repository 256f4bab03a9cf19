"""`ballbot plan`: the fastest move within a robot's limits, as a reference that controllers follow."""

import math
from pathlib import Path

from ballbot.cli import options
from ballbot.cli.context import Content, changed_robot, open_result
from ballbot.control.controller import assumed_grip
from ballbot.control.file import controller_text
from ballbot.control.source import named_controller
from ballbot.errors import InputError
from ballbot.progress import Progress
from ballbot.report.plan import plan_report
from ballbot.robot.file import robot_text
from ballbot.twin.scenario_file import load_scenario
from ballbot.workflows.collocation import MoveLimits
from ballbot.workflows.plan import follow
from ballbot.workflows.plan import plan as find

_WRITTEN = ("reference.csv", "reference.h", "controller.toml", "robot.toml")


def plan(
    robot: options.Robot,
    /,
    *,
    to: tuple[float, float, float] | None = None,
    along: Path | None = None,
    stop_from: options.Positive | None = None,
    within: options.Positive | None = None,
    corridor: options.Positive = 0.02,
    controller: str = "precise",
    torque: options.Positive | None = None,
    lean: options.Positive = 20.0,
    speed: options.Positive | None = None,
    grip: options.Positive | None = None,
    reserve: float = 40.0,
    floor_grip: options.Positive = 1.0,
    pivot: options.Positive = 0.02,
    margin: float = 20.0,
    scenario: options.Scenario = "nominal",
    runs: options.Count = 20,
    change: options.Changes = None,
    out: options.Out,
) -> None:
    """Plan the fastest move to a pose, along a path or to a stop, within the robot's limits and with its friction.

    The move starts at rest at the origin. Its limits are the torque of the wheels with the motors' speed curve, the
    lean, the speed, and the grip of wheels and ball. Simulated robots then follow the plan.

    Writes report.html, results.json, reference.csv (the plan: t and the reference of each state), reference.h (the same
    for the firmware), controller.toml and robot.toml.

    Example: ballbot plan found/robot.toml --to 2 0 0 --out move

    Example: ballbot plan found/robot.toml --stop-from 1.4 --within 1.5 --out stop

    Parameters
    ----------
    to
        Where the move ends, at rest: x and y [m], psi [rad].
    along
        A path to move along: a reference file, whose times do not count.
    stop_from
        The speed [m/s], forward, from which the robot is to stop; a run-up comes before.
    within
        The longest time allowed [s]. If no plan is so fast, the limit that forbids it is named.
    corridor
        How far the ball may be from the path [m].
    controller
        The controller that follows: precise, or the file of a controller with feed-forward.
    torque
        Largest torque of a wheel [N m]; that of the controller if not given.
    lean
        Largest lean [degrees].
    speed
        Largest speed [m/s]; no limit but the motors' if not given.
    grip
        Friction coefficient of the wheels on the ball. If not given, the robot file's less two deviations, or 1 if that
        is unknown.
    reserve
        Part of a wheel's load at rest that holds no force of the motion [per cent]; a wheel with less slips.
    floor_grip
        Friction coefficient of the ball on the floor.
    pivot
        Moment that holds the ball from pivoting on the floor, over the normal force [m].
    margin
        What is left of torque, motor speed, lean and grip to the controller [per cent].
    runs
        Simulated robots that follow the plan.
    """
    described = changed_robot(robot, change)
    chosen = named_controller(controller, described)
    if not chosen.follows_plans:
        raise InputError(
            f"The controller {controller} has no feed-forward and follows no plan; give precise."
        )
    for name, percent in (("margin", margin), ("reserve", reserve)):
        if not 0.0 <= percent <= 90.0:
            raise InputError(f"--{name} is {percent:g} %; it must be 0 to 90 %.")
    limits = MoveLimits(
        torque=chosen.torque_limit if torque is None else torque,
        lean=math.radians(lean),
        speed=math.inf if speed is None else speed,
        grip=grip or assumed_grip(described),
        reserve=0.01 * reserve,
        floor_grip=floor_grip,
        pivot=pivot,
        margin=0.01 * margin,
    )
    truth = load_scenario(scenario, described)
    with open_result(out, doing="plan", writes=_WRITTEN) as result:
        result.report(Progress(stage="planning"))
        planned = find(
            described,
            to=to,
            along=along,
            stop_from=stop_from,
            within=within,
            corridor=corridor,
            limits=limits,
        )
        result.report(Progress(stage="following"))
        page = plan_report(planned, follow(planned, chosen, truth, runs=runs), scenario=truth.name)
        files: dict[str, Content] = {
            "reference.csv": planned.write,
            "reference.h": planned.c_table(),
            "controller.toml": controller_text(chosen),
            "robot.toml": robot_text(described),
        }
        duration = math.ceil(planned.t[-1]) + 2
        step = (
            f"`ballbot simulate {result.path('robot.toml')} --reference {result.path('reference.csv')} --controller "
            f"{result.path('controller.toml')} --duration {duration} --out run`, or `ballbot run PORT` likewise."
        )
        result.write(page, files=files, named=["reference.csv", "reference.h"], next_step=step)
