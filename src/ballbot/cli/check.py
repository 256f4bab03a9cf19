"""`ballbot check`: whether a robot is plausible, and what follows from its parameters.

With `--swing` the body's inertia from a free swing; with `--reference` whether the robot can follow a reference.
"""

from __future__ import annotations

from collections import Counter
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from cyclopts import Parameter
from numpy.typing import NDArray
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from ballbot.cli.context import CommandResult, input_files, open_result
from ballbot.cli.findings import Accept, check_input, finding_line, show_findings
from ballbot.cli.output import as_text, matrix_text, standard_output, table
from ballbot.errors import InputError
from ballbot.files import check_file, write_text
from ballbot.findings import Finding, by_severity, check_codes, stop_on_errors
from ballbot.robot import Robot
from ballbot.robot.derived import Derived
from ballbot.robot.drawing import robot_drawing
from ballbot.robot.plausibility import robot_findings

if TYPE_CHECKING:
    from ballbot.log.checks import CheckedLogs
    from ballbot.workflows.parameter_uncertainty import PoleSpread, PredictionBand
    from ballbot.workflows.robot_check import CheckedReference, CheckedRobot, CheckedSwing


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class SwingOptions:
    """A free swing of the body."""

    swing: Path | None = None
    """A log (gyro or angle) or a video of the body swinging freely: gives its inertia as in the thesis's Appendix
    III."""

    swing_column: str | None = None
    """The swinging column of the log, if it is not one of gyro_x .. gyro_z, theta, phi, psi."""

    pivot_distance: float | None = None
    """Distance from the pivot to the centre of mass, in m. If not given, the pivot is at the ball's centre."""

    pivot_deviation: float | None = None
    """Standard deviation of that distance, in m."""


_WRITTEN = ("results.json", "check.txt", "swing.svg")

_SWING = SwingOptions()


def check(
    robot: str,
    /,
    *,
    figure: Path | None = None,
    predict: Path | None = None,
    reference: str | None = None,
    controller: Path | None = None,
    swinging: SwingOptions = _SWING,
    accept: Accept = None,
    out: Path | None = None,
) -> None:
    """Check that a robot is plausible, print quantities that follow from its parameters, and draw it.

    Prints derived quantities, the thesis's transformation matrices, A, B and the poles of the exact model about
    upright, and a drawing to scale. Standard deviations in the file are propagated to the unstable pole.

    Example: `ballbot check alten --figure alten.svg`

    Example: `ballbot check mine.toml --predict square.csv --out checked`

    Example: `ballbot check mine.toml --reference circle --controller controller.toml`

    Example: `ballbot check mine.toml --swing hanging.csv --out checked`

    Parameters
    ----------
    robot : str
        A preset's name or a robot file.
    figure : Path
        File for a drawing: .svg, .pdf or .png.
    predict : Path
        A log: shows how far the standard deviations in the file spread predictions of it over 0.25 s.
    reference : str
        A reference's name, or a file with t, ref_x, ref_y and ref_psi: shows whether the robot can follow it, and why.
    controller : Path
        The controller file that follows the reference; the nominal controller if not given.
    out : Path
        Folder for results.json and check.txt, with a swing also swing.svg.
    """
    hung, console = Robot.load(robot), standard_output()
    findings = _robot_findings(hung, accept)
    if figure is not None:
        check_file(figure)
    from ballbot.workflows.robot_check import (
        check_robot,  # compiled code, once the robot has passed its checks
    )

    inputs = input_files(robot, predict, reference, controller, swinging.swing)
    held = open_result(out, command="check", writes=_WRITTEN, inputs=inputs) if out else nullcontext()
    with held as result:
        checked = check_robot(
            hung,
            findings,
            swing=_swing(hung, swinging, accept),
            log=None if predict is None else _log(hung, robot, predict, accept),
            following=_following(hung, reference, controller),
        )
        for part in _report(checked, framed=console.is_terminal):
            console.print(part)
        if figure is not None:
            _save_figure(checked.robot, figure)
            console.print(f"Wrote {figure}.", soft_wrap=True)
        if result is not None:
            for path in _write(checked, result):
                console.print(f"Wrote {path}.", soft_wrap=True)


def _write(checked: CheckedRobot, result: CommandResult) -> list[Path]:
    """Write the result and return its files."""
    with result.replaced() as new:
        result.write_json(checked.results(), new)
        write_text(new / "check.txt", as_text(_report(checked, framed=False)))
        if checked.swing is not None:
            _save_swing_figure(checked.swing, new / "swing.svg")
        names = [name for name in _WRITTEN if (new / name).exists()]
    return [result.folder.path / name for name in names]


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
        stop_on_errors(refused, more=lambda _: "shown above")
    return findings


def _following(robot: Robot, reference: str | None, controller: Path | None) -> CheckedReference | None:
    if reference is None:
        if controller is not None:
            raise InputError(
                "--controller is the controller that follows a reference; "
                "give the reference with --reference NAME or FILE."
            )
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


def _log(robot: Robot, source: str, path: Path, accept: list[str] | None) -> CheckedLogs:
    from ballbot.log import Log
    from ballbot.log.checks import CheckedLogs

    log = Log.read(path)
    return CheckedLogs(
        logs={str(path): log}, findings=check_input(robot, {path: log}, accept=accept, source=source)
    )


def _report(checked: CheckedRobot, *, framed: bool) -> list[RenderableType]:
    """Return the parts of what is printed, top to bottom."""
    from ballbot.workflows.robot_check import MATRICES, MISTAKEN_MATRICES

    robot = checked.robot
    kinds = Counter(source.partition(":")[0] for source in robot.sources.values())
    counts = ", ".join(f"{count} {kind}" for kind, count in kinds.most_common())
    rows = [[one.name, f"{one.value:.5g}", _unit(one), one.meaning] for one in checked.derived]
    parts: list[RenderableType] = [
        Text(f"{robot.name}: a robot with {robot.wheel_count} wheels. Sources of its parameters: {counts}."),
        *(finding_line(one, accepted=one.severity == "error") for one in checked.findings),
        Text(""),
        table("Derived quantities", ("quantity", "value", "unit", "meaning"), rows, framed=framed),
        Text("\nTransformation matrices", style="bold"),
    ]
    for name, meaning in MATRICES.items():
        mistake = MISTAKEN_MATRICES.get(name)
        heading = f"\n{meaning}" + (f"\nMISTAKEN: {mistake}" if mistake else "")
        parts += [Text(heading), Text(matrix_text(name, checked.matrices[name]))]
    parts += [*_linear_lines(checked), *_pole_lines(checked.poles), Text(_uncertainty_line(checked.spread))]
    if checked.band:
        parts += [Text(""), _band_table(checked.band, framed=framed)]
    if checked.swing:
        parts += _swing_parts(checked.swing, framed=framed)
    if checked.following:
        parts += _reference_parts(checked.following, framed=framed)
    return [*parts, Text("\nDrawing", style="bold"), Text(robot_drawing(robot))]


def _unit(one: Derived) -> str:
    return "" if one.unit == "1" else one.unit


def _linear_lines(checked: CheckedRobot) -> list[Text]:
    from ballbot.workflows.robot_check import state_order

    return [
        Text("\nLinear model x_dot = A x + B u about upright, exact model", style="bold"),
        Text(state_order(checked.robot.wheel_count)),
        Text(matrix_text("A", checked.linear.A)),
        Text(matrix_text("B", checked.linear.B)),
    ]


def _pole_lines(poles: NDArray[np.complex128]) -> list[Text]:
    # adding zero keeps a minus sign off what prints as nothing
    rounded = np.round(poles, 3) + 0.0
    listed = ", ".join(f"{pole.real:g}{f'{pole.imag:+g}j' if pole.imag else ''}" for pole in rounded)
    fastest = float(poles[0].real)
    time = f"; a lean doubles in {np.log(2.0) / fastest:.3f} s" if fastest > 0.0 else ""
    return [
        Text("\nPoles about upright, exact model [rad/s]", style="bold"),
        Text(listed),
        Text(f"unstable pole: {fastest:.3f} rad/s{time}."),
    ]


def _uncertainty_line(spread: PoleSpread | None) -> str:
    if spread is None:
        return (
            "No value in the file has a standard_deviation; with some, "
            "the standard deviation of the pole would be shown here."
        )
    largest = list(spread.variance_shares.items())[:3]
    causes = ", ".join(f"{100.0 * share:.0f} % from {label}" for label, share in largest)
    low, high = spread.interval_95
    return (
        "From the standard deviations in the file, its standard deviation is "
        f"{spread.standard_deviation:.2g} rad/s, and it lies between {low:.3g} "
        f"and {high:.3g} in 95 % of {spread.draws} draws ({causes})."
    )


def _band_table(band: PredictionBand, *, framed: bool) -> Table:
    rows = [
        [state, f"{spread:.2g}", f"{band.rmse_at_end[state]:.2g}"]
        for state, spread in band.standard_deviation_at_end.items()
    ]
    title = f"Predictions after {band.t[-1]:g} s, root mean square over {len(band.starts)} windows of the log"
    return table(title, ("state", "spread by the standard deviations", "error"), rows, framed=framed)


def _swing_parts(swing: CheckedSwing, *, framed: bool) -> list[RenderableType]:
    headings = ("quantity", "value, 95 %", "unit")
    title = f"Swing from {swing.fit.swing.source}"
    return [
        Text(""),
        table(title, headings, swing.rows(), framed=framed),
        *(finding_line(one, accepted=one.severity == "error") for one in swing.findings),
        *(Text(one.text) for one in swing.remarks()),
    ]


def _reference_parts(reference: CheckedReference, *, framed: bool) -> list[RenderableType]:
    from ballbot.workflows.reference_check import MARGIN_HEADINGS

    found = table("Largest use of each limit", MARGIN_HEADINGS, reference.rows(), framed=framed)
    sentences = [Text(line) for line in reference.verdict()]
    return [Text(f"\nFollowing {reference.name}", style="bold"), *sentences, found]


def _save_figure(robot: Robot, path: Path) -> None:
    from ballbot.robot.figure import save_robot_figure

    save_robot_figure(robot, path)


def _save_swing_figure(swing: CheckedSwing, path: Path) -> None:
    from ballbot.report.bench import swing_figure
    from ballbot.report.style import drawn

    write_text(path, drawn(lambda: swing_figure(swing.fit), name="swing"))
