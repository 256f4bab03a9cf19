"""`ballbot check`: check a robot's parameters and print derived quantities.

`--swing` determines the body's inertia from a free swing; `--reference` checks that the robot can follow a
reference.
"""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from cyclopts import Parameter

from ballbot.cli import OUTPUT
from ballbot.cli.context import PAGE, input_files, open_result
from ballbot.cli.findings import Accept, show_findings
from ballbot.cli.output import emit, print_parts, progress_bar, standard_output, suggest_page
from ballbot.errors import InputError
from ballbot.files import check_file
from ballbot.findings import Finding, by_severity, check_codes, stop_on_errors
from ballbot.report.console import finding_line
from ballbot.robot import Robot
from ballbot.robot.plausibility import robot_findings

if TYPE_CHECKING:
    from ballbot.workflows.reference_check import ReferenceMargins
    from ballbot.workflows.robot_check import CheckedSwing


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class SwingOptions:
    """A free swing of the body."""

    swing: Path | None = None
    """A log (gyro or angle) or a video of the body swinging freely, hung up as a pendulum, from which its inertia is
    determined."""

    swing_column: str | None = None
    """The swinging column of the log, if it is not one of gyro_x .. gyro_z, theta, phi, psi."""

    pivot_distance: float | None = None
    """Distance from the pivot to the centre of mass [m]. If not given, the pivot is at the ball's centre."""

    pivot_deviation: float | None = None
    """Standard deviation of that distance [m]."""


_WRITTEN = (PAGE, "results.json")

_SWING = SwingOptions()


def check(
    robot: str,
    /,
    *,
    figure: Path | None = None,
    reference: str | None = None,
    controller: str = "nominal",
    swinging: SwingOptions = _SWING,
    accept: Accept = None,
    out: Path | None = None,
) -> None:
    """Check that a robot is plausible, and print quantities that follow from its parameters.

    Prints derived quantities, the transformation matrices between ball and wheels, A, B and the poles of the exact
    model about upright, and the stability margins with a controller. Standard deviations in the file are propagated to
    the unstable pole.

    Example: `ballbot check alten --figure alten.svg`

    Example: `ballbot check mine.toml --reference circle --controller controller.toml`

    Example: `ballbot check mine.toml --swing hanging.csv --out checked`

    Parameters
    ----------
    robot : str
        A preset's name or a robot file.
    figure : Path
        File to save a drawing to scale to: .svg, .pdf or .png.
    reference : str
        A reference's name, or a file with t, ref_x, ref_y and ref_psi: shows whether the robot can follow it and
        how much of each limit that takes.
    controller : str
        The controller whose margins are computed and that follows the reference: nominal, precise or a controller
        file.
    out : Path
        Folder for report.html and results.json.
    """
    hung, console = Robot.load(robot), standard_output()
    findings = _robot_findings(hung, accept)
    if figure is not None:
        check_file(figure)
    # compiled code, once the robot has passed its checks
    from ballbot.report.robot_check import robot_check_report
    from ballbot.workflows.robot_check import check_robot

    inputs = input_files(robot, reference, controller, swinging.swing)
    held = open_result(out, command="check", writes=_WRITTEN, inputs=inputs) if out else nullcontext()
    with held as result:
        with progress_bar(console, "checking the robot"):
            checked = check_robot(
                hung,
                findings,
                controller=controller,
                swing=_swing(hung, swinging, accept),
                following=_following(hung, reference, controller),
            )
        if OUTPUT.get().json:
            emit(checked.results())
        report = robot_check_report(checked)
        console.print(report.title, markup=False)
        print_parts((finding_line(one, accepted=True) for one in checked.findings), console)
        print_parts(report.parts(), console)
        if figure is not None:
            _save_figure(checked.robot, figure)
            console.print(f"Wrote {figure}.", soft_wrap=True)
        if result is None:
            suggest_page()
            return
        with result.replaced() as new:
            result.write_json(checked.results(), new)
            result.write_page(report, new)
        result.show_file(*_WRITTEN)


def _robot_findings(robot: Robot, accept: list[str] | None) -> tuple[Finding, ...]:
    """Return what is unusual in the robot; print it all and stop if there is an error that is not accepted."""
    from ballbot.twin.recording import twin_findings

    codes = check_codes(accept or ())
    findings = robot_findings(robot)
    if all(one.severity != "error" or one.code in codes for one in findings):
        findings = by_severity([*findings, *twin_findings(robot)])
    refused = [one for one in findings if one.severity == "error" and one.code not in codes]
    if refused:
        show_findings(findings, accept=codes)
        stop_on_errors(refused, others="above")
    return findings


def _following(robot: Robot, reference: str | None, controller: str) -> ReferenceMargins | None:
    if reference is None:
        return None
    from ballbot.workflows.robot_check import follow_reference

    return follow_reference(robot, reference, controller)


def _swing(robot: Robot, options: SwingOptions, accept: list[str] | None) -> CheckedSwing | None:
    if options.swing is None:
        if options != _SWING:
            raise InputError(
                "--swing-column, --pivot-distance and --pivot-deviation "
                "describe a swing; give the swing with --swing FILE."
            )
        return None
    from ballbot.identification.inertia import Pivot
    from ballbot.workflows.robot_check import check_swing

    pivot = Pivot.of(robot, distance=options.pivot_distance, deviation=options.pivot_deviation)
    codes = check_codes(accept or ())
    return check_swing(robot, options.swing, pivot, column=options.swing_column, accept=codes)


def _save_figure(robot: Robot, path: Path) -> None:
    from ballbot.robot.figure import save_robot_figure

    save_robot_figure(robot, path)
