"""`ballbot check`: check a robot's parameters and print derived quantities.

`--swing` determines the body's inertia from a free swing.
"""

from pathlib import Path

from ballbot.cli import options
from ballbot.cli.context import open_result
from ballbot.cli.findings import stop_or_show
from ballbot.errors import InputError
from ballbot.findings import check_codes
from ballbot.report.blocks import RESULTS, finding_line
from ballbot.robot import Robot
from ballbot.robot.plausibility import robot_findings


def check(
    robot: options.Robot,
    /,
    *,
    controller: str = "nominal",
    swing: Path | None = None,
    pivot_distance: float | None = None,
    pivot_deviation: float | None = None,
    accept: options.Accept = None,
    out: options.OptionalOut = None,
) -> None:
    """Check that a robot is plausible, and print quantities that follow from its parameters.

    Prints derived quantities, the poles of the exact model about upright, and the stability margins with a controller.
    The page and results.json (--json) also have A, B and the transformation matrices between ball and wheels. Standard
    deviations in the file are propagated to the unstable pole.

    Example: `ballbot check alten`

    Example: `ballbot check mine.toml --controller controller.toml`

    Example: `ballbot check mine.toml --swing hanging.csv --out checked`

    Parameters
    ----------
    controller : str
        The controller whose margins are computed: none, full, partial, nominal, precise, a controller file, or
        FILE.py:NAME if NAME(robot) returns a ballbot.Controller.
    swing : Path
        A log (gyro_x to gyro_z, or theta, phi or psi) of the body swinging freely, hung up as a pendulum, which
        determines its inertia.
    pivot_distance : float
        Distance from the pivot to the centre of mass [m]. If not given, the pivot is at the ball's centre.
    pivot_deviation : float
        Standard deviation of that distance [m].
    """
    if swing is None and not (pivot_distance is pivot_deviation is None):
        raise InputError("--pivot-distance and --pivot-deviation describe a swing: give --swing FILE.")
    hung = Robot.load(robot)
    of_robot = stop_or_show(robot_findings(hung), accept=accept, show=False)
    # imported late: they compile, and a bad robot is reported first
    from ballbot.report.robot_check import robot_check_report
    from ballbot.twin.recording import twin_findings
    from ballbot.workflows.robot_check import CheckedRobot, check_swing

    findings = stop_or_show([*of_robot, *twin_findings(hung)], accept=accept, show=False)
    with open_result(out, doing="checking the robot") as result:
        swung = swing and check_swing(
            hung,
            swing,
            distance=pivot_distance,
            deviation=pivot_deviation,
            accept=check_codes(accept or ()),
        )
        checked = CheckedRobot(robot=hung, findings=findings, controller=controller, swing=swung)
        page = robot_check_report(checked)
        lines = [finding_line(finding, accepted=True) for finding in checked.findings]
        printed = [page.title, *lines, *page.parts()]
        step = f"`ballbot check-log LOG --robot {robot}`"
        result.write(page, printed=printed, named=[RESULTS], next_step=step)
