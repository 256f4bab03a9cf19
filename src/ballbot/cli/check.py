"""`ballbot check`: whether a robot is plausible, and what follows from its parameters; `ballbot new` writes one.

With `--swing` the body's inertia from a free swing; with `--reference` whether the robot can follow a reference.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from cyclopts import Parameter
from numpy.typing import NDArray
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from ballbot.cli.findings import Accept, check_input, finding_line, show_findings
from ballbot.cli.output import as_text, matrix_text, standard_output, table
from ballbot.control.file import read_controller
from ballbot.control.presets import nominal_controller
from ballbot.control.references import is_reference_file, reference_from
from ballbot.errors import InputError
from ballbot.files import check_file, write_text
from ballbot.findings import Finding, by_severity, check_codes, finding_results, no_command, stop_on_errors
from ballbot.identification.inertia import (
    Pivot,
    SwingInertia,
    inertia_of_swing,
    recording_findings,
    swing_findings,
    swing_results,
    swing_rows,
    swing_sentences,
)
from ballbot.identification.swing import SwingFit, fit_swing, swing_in_log
from ballbot.log import Log
from ballbot.log.checks.time_and_rates import check_gaps, check_jitter
from ballbot.log.formats import is_log_file
from ballbot.report.design import MISTAKEN_MATRICES, state_order
from ballbot.report.page import as_json
from ballbot.result_folder import ResultFolder, result_folder
from ballbot.robot import Robot
from ballbot.robot.derived import Derived, derived_quantities
from ballbot.robot.drawing import robot_drawing
from ballbot.robot.parameters import value_of
from ballbot.robot.plausibility import robot_findings
from ballbot.robot.robot import PARAMETERS
from ballbot.robot.variations import uncertain
from ballbot.workflows.reference_check import (
    MARGIN_HEADINGS,
    ReferenceMargins,
    check_reference,
    margin_results,
    margin_rows,
    reference_verdict,
)

if TYPE_CHECKING:
    from ballbot.log.checks import CheckedLogs
    from ballbot.mechanics.model import LinearModel
    from ballbot.workflows.parameter_uncertainty import PoleSpread, PredictionBand


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


@dataclass(frozen=True, kw_only=True)
class CheckedSwing:
    """A swing with all that `ballbot check` says about it."""

    robot: Robot
    pivot: Pivot
    fit: SwingFit
    found: SwingInertia
    findings: tuple[Finding, ...]

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        said: dict[str, object] = {
            "findings": finding_results(self.findings),
            "remarks": swing_sentences(self.fit, self.found, self.robot),
        }
        return said | swing_results(self.fit, self.found, self.pivot)

    def parts(self, *, framed: bool) -> list[RenderableType]:
        """Return what is printed."""
        headings = ("quantity", "value, 95 %", "unit")
        title = f"Swing from {self.fit.swing.source}"
        margin_rows = swing_rows(self.fit, self.found)
        return [
            Text(""),
            table(title, headings, margin_rows, framed=framed),
            *(finding_line(one, accepted=one.severity == "error") for one in self.findings),
            *(Text(one) for one in swing_sentences(self.fit, self.found, self.robot)),
        ]


def examine_swing(
    robot: Robot, file: Path, options: SwingOptions, *, accept: list[str] | None
) -> CheckedSwing:
    """Return what the swing in a file says of a robot's inertia.

    Raises
    ------
    InputError
        If the file has no free swing, or the swing has an error that is not accepted.
    """
    pivot = Pivot.of(robot, distance=options.pivot_distance, deviation=options.pivot_deviation)
    of_log: list[Finding] = []
    if is_log_file(file):  # every other is a video
        log = Log.read(file)
        of_log = [*check_gaps(log), *check_jitter(log)]
        swing = swing_in_log(log, column=options.swing_column)
    else:
        from ballbot.vision.swing import swing_in_video

        swing = swing_in_video(file)
    of_recording = recording_findings(swing)
    _stop_on_swing_errors(of_recording, file, accept)
    fit = fit_swing(swing)
    found = inertia_of_swing(fit, robot, pivot)
    findings = by_severity([*of_log, *of_recording, *swing_findings(fit, found, robot, pivot)])
    _stop_on_swing_errors(findings, file, accept)
    return CheckedSwing(robot=robot, pivot=pivot, fit=fit, found=found, findings=findings)


def _stop_on_swing_errors(findings: Sequence[Finding], file: Path, accept: list[str] | None) -> None:
    named = [replace(one, where=replace(one.where, file=str(file))) for one in findings]
    stop_on_errors(named, accept=check_codes(accept or ()), more=no_command)


#: how long a reference that has a name is looked at [s]: the longest of them goes once around
_DURATION = 40.0
#: and one in a file beyond its last row
_BEYOND = 3.0


@dataclass(frozen=True, kw_only=True)
class CheckedReference:
    """A reference with what it takes of a robot."""

    name: str
    margins: ReferenceMargins

    def parts(self, *, framed: bool) -> list[RenderableType]:
        """Return the parts of what is printed."""
        words = [Text(line) for line in reference_verdict(self.margins, self.name)]
        found = table("Largest use of each limit", MARGIN_HEADINGS, margin_rows(self.margins), framed=framed)
        return [Text(f"\nFollowing {self.name}", style="bold"), *words, found]

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds."""
        return {"name": self.name, **margin_results(self.margins)}


def checked_reference(robot: Robot, source: str, controller: Path | None) -> CheckedReference:
    """Return what following the reference of that name or file takes, by a controller file or the nominal one."""
    reference = reference_from(source)
    duration = float(Log.read(source).t[-1]) + _BEYOND if is_reference_file(source) else _DURATION
    chosen = read_controller(controller, robot) if controller else nominal_controller(robot)
    return CheckedReference(name=source, margins=check_reference(robot, chosen, reference, duration=duration))


_WRITTEN = ("results.json", "check.txt", "swing.svg")

#: the thesis's names of the matrices, with what each does
_MATRICES = {
    "T_tbw": "torque on the ball from torque on the wheels (II.10)",
    "T_trw": "torque on the body from torque on the wheels (II.11)",
    "T_tbg": "torque on the ball from force on the ground (II.12)",
    "T_fgb": "force on the ground from torque on the ball",
    "T_owb": "wheel speed from the ball's angular velocity (II.13, V.2)",
    "T_obw": "the ball's angular velocity from wheel speed (V.3)",
    "T_owr": "wheel speed from the body's angular velocity (II.14)",
    "T_vgb": "velocity over ground from the ball's angular velocity (II.15)",
}


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
    named = (robot, predict, reference, controller, swinging.swing)
    inputs = [Path(one) for one in named if one is not None and Path(one).is_file()]
    held = result_folder(out, command="check", names=_WRITTEN, inputs=inputs) if out else nullcontext()
    with held as folder:
        swung = _swing_result(hung, swinging, accept)
        log = None if predict is None else _log(hung, robot, predict, accept)
        checked = _examine(hung, findings, log, swung, _followed(hung, reference, controller))
        for part in _report(checked, framed=console.is_terminal):
            console.print(part)
        if figure is not None:
            _save_figure(checked.robot, figure)
            console.print(f"Wrote {figure}.", soft_wrap=True)
        if folder is not None:
            for path in _write(checked, folder):
                console.print(f"Wrote {path}.", soft_wrap=True)


def _write(checked: _Checked, folder: ResultFolder) -> list[Path]:
    """Write the result and return its files."""
    with folder.replaced() as new:
        write_text(new / "results.json", as_json(_results(checked)))
        write_text(new / "check.txt", as_text(_report(checked, framed=False)))
        if checked.swing is not None:
            _save_swing_figure(checked.swing, new / "swing.svg")
        names = [name for name in _WRITTEN if (new / name).exists()]
    return [folder.path / name for name in names]


@dataclass(frozen=True, kw_only=True)
class _Checked:
    """A robot with all that `ballbot check` says about it."""

    robot: Robot
    derived: list[Derived]
    matrices: dict[str, NDArray[np.float64]]
    linear: LinearModel  #: the exact model about upright
    linearization: dict[str, object]  #: the same for results.json, with the thesis's beside it
    poles: NDArray[np.complex128]  #: of the exact model about upright, fastest growth first [rad/s]
    spread: PoleSpread | None  #: None where no value has a standard deviation
    band: PredictionBand | None
    findings: tuple[Finding, ...]  #: of the robot, and of the log that is predicted
    swing: CheckedSwing | None
    following: CheckedReference | None


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


def _followed(robot: Robot, reference: str | None, controller: Path | None) -> CheckedReference | None:
    if reference is None:
        if controller is not None:
            raise InputError(
                "--controller is the controller that follows a reference; "
                "give the reference with --reference NAME or FILE."
            )
        return None

    return checked_reference(robot, reference, controller)


def _swing_result(robot: Robot, options: SwingOptions, accept: list[str] | None) -> CheckedSwing | None:
    if options.swing is None:
        if options != _SWING:
            raise InputError(
                "--swing-column, --pivot-distance and --pivot-deviation "
                "describe a swing; give the swing with --swing FILE."
            )
        return None
    return examine_swing(robot, options.swing, options, accept=accept)


def _examine(
    robot: Robot,
    findings: tuple[Finding, ...],
    log: CheckedLogs | None,
    swing: CheckedSwing | None,
    following: CheckedReference | None,
) -> _Checked:
    # the compiled model is imported only once the robot has passed its checks
    from ballbot.mechanics.geometry import transforms
    from ballbot.mechanics.model import Model
    from ballbot.report.design import linearization_results
    from ballbot.workflows.parameter_uncertainty import pole_spread

    found, model = transforms(robot), Model(robot)
    linear = model.linearize()
    poles = np.asarray(linear.poles(), dtype=np.complex128)
    return _Checked(
        robot=robot,
        spread=pole_spread(robot) if uncertain(robot) else None,
        findings=by_severity([*findings, *(log.findings if log else ())]),
        band=None if log is None else _band(robot, log),
        swing=swing,
        following=following,
        derived=derived_quantities(robot),
        matrices={name: getattr(found, name) for name in _MATRICES},
        linear=linear,
        linearization=linearization_results(model),
        poles=poles[np.argsort(-poles.real)],
    )


def _log(robot: Robot, source: str, path: Path, accept: list[str] | None) -> CheckedLogs:
    from ballbot.log import Log
    from ballbot.log.checks import CheckedLogs

    log = Log.read(path)
    return CheckedLogs(
        logs={str(path): log}, findings=check_input(robot, {path: log}, accept=accept, source=source)
    )


def _band(robot: Robot, log: CheckedLogs) -> PredictionBand:
    from ballbot.workflows.parameter_uncertainty import prediction_band

    (one,) = log.logs.values()
    return prediction_band(robot, one)


def _results(checked: _Checked) -> dict[str, object]:
    return {
        "robot": checked.robot.name,
        "parameters": {
            one.name: value for one in PARAMETERS if (value := value_of(checked.robot, one)) != ()
        },
        "derived": {one.name: one.value for one in checked.derived},
        "matrices": {name: matrix.tolist() for name, matrix in checked.matrices.items()},
        "mistaken_matrices": {
            name: MISTAKEN_MATRICES[name] for name in checked.matrices if name in MISTAKEN_MATRICES
        },
        "linearization": checked.linearization,
        "poles": [[float(pole.real), float(pole.imag)] for pole in checked.poles],
        "unstable_pole": float(checked.poles[0].real),
        "standard_deviations": dict(checked.robot.standard_deviations),
        "unstable_pole_uncertainty": checked.spread.to_dict() if checked.spread else None,
        "findings": finding_results(checked.findings),
        "prediction": checked.band.to_dict() if checked.band else None,
        "swing": checked.swing.to_dict() if checked.swing else None,
        "reference": checked.following.to_dict() if checked.following else None,
    }


def _report(checked: _Checked, *, framed: bool) -> list[RenderableType]:
    """Return the parts of what is printed, top to bottom."""
    robot = checked.robot
    kinds = Counter(source.partition(":")[0] for source in robot.sources.values())
    counts = ", ".join(f"{count} {kind}" for kind, count in kinds.most_common())
    margin_rows = [[one.name, f"{one.value:.5g}", _unit(one), one.meaning] for one in checked.derived]
    parts: list[RenderableType] = [
        Text(f"{robot.name}: a robot with {robot.wheel_count} wheels. Sources of its parameters: {counts}."),
        *(finding_line(one, accepted=one.severity == "error") for one in checked.findings),
        Text(""),
        table("Derived quantities", ("quantity", "value", "unit", "meaning"), margin_rows, framed=framed),
        Text("\nTransformation matrices", style="bold"),
    ]
    for name, meaning in _MATRICES.items():
        mistake = MISTAKEN_MATRICES.get(name)
        heading = f"\n{meaning}" + (f"\nMISTAKEN: {mistake}" if mistake else "")
        parts += [Text(heading), Text(matrix_text(name, checked.matrices[name]))]
    parts += [*_linear_lines(checked), *_pole_lines(checked.poles), Text(_uncertainty_line(checked.spread))]
    if checked.band:
        parts += [Text(""), _band_table(checked.band, framed=framed)]
    if checked.swing:
        parts += checked.swing.parts(framed=framed)
    if checked.following:
        parts += checked.following.parts(framed=framed)
    return [*parts, Text("\nDrawing", style="bold"), Text(robot_drawing(robot))]


def _unit(one: Derived) -> str:
    return "" if one.unit == "1" else one.unit


def _linear_lines(checked: _Checked) -> list[Text]:
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
    causes = ", ".join(f"{100.0 * share:.0f} % from {label}" for label, share in spread.causes[:3])
    return (
        "From the standard deviations in the file, its standard deviation is "
        f"{spread.deviation:.2g} rad/s, and it lies between {spread.lower:.3g} "
        f"and {spread.upper:.3g} in 95 % of {spread.draws} draws ({causes})."
    )


def _band_table(band: PredictionBand, *, framed: bool) -> Table:
    margin_rows = [
        [state, f"{spread:.2g}", f"{band.error_at_end[state]:.2g}"] for state, spread in band.at_end.items()
    ]
    title = f"Predictions after {band.t[-1]:g} s, root mean square over {len(band.starts)} windows of the log"
    return table(title, ("state", "spread by the standard deviations", "error"), margin_rows, framed=framed)


def _save_figure(robot: Robot, path: Path) -> None:
    from ballbot.robot.figure import save_robot_figure

    save_robot_figure(robot, path)


def _save_swing_figure(swing: CheckedSwing, path: Path) -> None:
    from ballbot.report.bench import swing_figure
    from ballbot.report.style import drawn

    write_text(path, drawn(lambda: swing_figure(swing.fit), name="swing"))
