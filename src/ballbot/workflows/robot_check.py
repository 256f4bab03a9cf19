"""Everything that `ballbot check` states about a robot: derived quantities, matrices, poles, a swing, a reference."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot.control.file import read_controller
from ballbot.control.presets import nominal_controller
from ballbot.control.references import is_reference_file, reference_from
from ballbot.findings import Finding, by_severity, finding_results, no_command, stop_on_errors
from ballbot.identification.inertia import (
    Pivot,
    SwingInertia,
    inertia_findings,
    inertia_of_swing,
    recording_findings,
    swing_findings,
    swing_results,
    swing_rows,
)
from ballbot.identification.swing import SwingFit, fit_swing, swing_in_log
from ballbot.log import Log
from ballbot.log.checks import CheckedLogs
from ballbot.log.checks.time_and_rates import check_gaps, check_jitter
from ballbot.log.columns import STATE_NAMES, torque_names, unit_of
from ballbot.log.formats import is_log_file
from ballbot.mechanics.geometry import transforms
from ballbot.mechanics.model import LinearModel, Model
from ballbot.robot import Robot
from ballbot.robot.components import PARAMETERS
from ballbot.robot.derived import Derived, derived_quantities
from ballbot.robot.parameters import value_of
from ballbot.robot.variations import uncertain
from ballbot.workflows.parameter_uncertainty import PoleSpread, PredictionBand, pole_spread, prediction_band
from ballbot.workflows.reference_check import (
    ReferenceMargins,
    check_reference,
    margin_results,
    margin_rows,
    reference_verdict,
)

#: the thesis's names of the matrices, with what each does
MATRICES = {
    "T_tbw": "torque on the ball from torque on the wheels (II.10)",
    "T_trw": "torque on the body from torque on the wheels (II.11)",
    "T_tbg": "torque on the ball from force on the ground (II.12)",
    "T_fgb": "force on the ground from torque on the ball",
    "T_owb": "wheel speed from the ball's angular velocity (II.13, V.2)",
    "T_obw": "the ball's angular velocity from wheel speed (V.3)",
    "T_owr": "wheel speed from the body's angular velocity (II.14)",
    "T_vgb": "velocity over ground from the ball's angular velocity (II.15)",
}

#: what is wrong with each matrix that the thesis's mistakes are in; numbers: docs/generated/reproduce.md
MISTAKEN_MATRICES = {
    "T_trw": "the thesis's mistake 6: without the motors' counter-torque; the exact model does not use it",
    "T_owr": "the thesis's mistake 8: absolute spin, where motor, friction and encoder have the speed against the "
    "body; the exact model does not use it",
}
MISTAKEN_LINEARIZATION = (
    "the thesis's mistakes 5, 6, 7 and 17 (docs/generated/reproduce.md): to compare with, not to design with"
)

#: how long a named reference is examined [s]: the longest of them goes once around
_DURATION = 40.0
#: and one in a file beyond its last row
_BEYOND = 3.0


@dataclass(frozen=True, kw_only=True)
class CheckedSwing:
    """A body's inertia by a free swing."""

    robot: Robot
    pivot: Pivot
    fit: SwingFit
    found: SwingInertia
    findings: tuple[Finding, ...]

    def results(self) -> dict[str, object]:
        """Return what results.json holds."""
        stated: dict[str, object] = {
            "findings": finding_results(self.findings),
            "remarks": finding_results(self.remarks()),
        }
        return stated | swing_results(self.fit, self.found, self.pivot)

    def rows(self) -> Sequence[Sequence[str]]:
        """Return quantity, value and unit of each result."""
        return swing_rows(self.fit, self.found)

    def remarks(self) -> list[Finding]:
        """Return what the results mean."""
        return inertia_findings(self.fit, self.found, self.robot)


def check_swing(
    robot: Robot, file: Path, pivot: Pivot, *, column: str | None = None, accept: Collection[str] = ()
) -> CheckedSwing:
    """Return what the swing in a log or a video shows about a robot's inertia.

    Parameters
    ----------
    robot : Robot
    file : Path
    pivot : Pivot
    column : str, optional
        The swinging column of a log.
    accept : collection of str
        Codes of errors despite which to continue.

    Raises
    ------
    InputError
        If the file has no free swing, or the swing has an error that is not accepted.
    """
    of_log: list[Finding] = []
    if is_log_file(file):  # every other is a video
        log = Log.read(file)
        of_log = [*check_gaps(log), *check_jitter(log)]
        swing = swing_in_log(log, column=column)
    else:
        from ballbot.vision.swing import swing_in_video  # only a video needs OpenCV

        swing = swing_in_video(file)
    of_recording = recording_findings(swing)
    _stop(of_recording, file, accept)
    fit = fit_swing(swing)
    found = inertia_of_swing(fit, robot, pivot)
    findings = by_severity([*of_log, *of_recording, *swing_findings(fit, found, robot, pivot)])
    _stop(findings, file, accept)
    return CheckedSwing(robot=robot, pivot=pivot, fit=fit, found=found, findings=findings)


def _stop(findings: Sequence[Finding], file: Path, accept: Collection[str]) -> None:
    named = [replace(one, where=replace(one.where, file=str(file))) for one in findings]
    stop_on_errors(named, accept=accept, more=no_command)


@dataclass(frozen=True, kw_only=True)
class CheckedReference:
    """A reference with what it takes of a robot."""

    name: str
    margins: ReferenceMargins

    def verdict(self) -> Sequence[str]:
        """Return whether the robot can follow it, and why, as lines."""
        return reference_verdict(self.margins, self.name)

    def rows(self) -> Sequence[Sequence[str]]:
        """Return the largest use of each limit."""
        return margin_rows(self.margins)

    def results(self) -> dict[str, object]:
        """Return what results.json holds."""
        return {"name": self.name, **margin_results(self.margins)}


def follow_reference(robot: Robot, source: str, controller: Path | None) -> CheckedReference:
    """Return what following the reference of that name or file takes, with a controller file or the nominal one."""
    reference = reference_from(source)
    duration = float(Log.read(source).t[-1]) + _BEYOND if is_reference_file(source) else _DURATION
    chosen = read_controller(controller, robot) if controller else nominal_controller(robot)
    return CheckedReference(name=source, margins=check_reference(robot, chosen, reference, duration=duration))


@dataclass(frozen=True, kw_only=True)
class CheckedRobot:
    """A robot with everything that `ballbot check` states about it."""

    robot: Robot
    derived: list[Derived]
    matrices: dict[str, NDArray[np.float64]]
    linear: LinearModel  #: the exact model about upright
    linearization: dict[str, object]  #: the same for results.json, with the thesis's beside it
    poles: NDArray[np.complex128]  #: of the exact model about upright, fastest growth first [rad/s]
    spread: PoleSpread | None  #: None if no value has a standard deviation
    band: PredictionBand | None
    findings: tuple[Finding, ...]  #: of the robot, and of the log that is predicted
    swing: CheckedSwing | None
    following: CheckedReference | None

    def results(self) -> dict[str, object]:
        """Return what results.json holds."""
        return {
            "robot": self.robot.name,
            "parameters": {
                one.name: value for one in PARAMETERS if (value := value_of(self.robot, one)) != ()
            },
            "derived": {one.name: one.value for one in self.derived},
            "matrices": self.matrices,
            "mistaken_matrices": {
                name: MISTAKEN_MATRICES[name] for name in self.matrices if name in MISTAKEN_MATRICES
            },
            "linearization": self.linearization,
            "poles": self.poles,
            "unstable_pole": float(self.poles[0].real),
            "standard_deviations": self.robot.standard_deviations,
            "unstable_pole_uncertainty": self.spread,
            "findings": finding_results(self.findings),
            "prediction": self.band,
            "swing": self.swing.results() if self.swing else None,
            "reference": self.following.results() if self.following else None,
        }


def check_robot(
    robot: Robot,
    findings: Sequence[Finding],
    *,
    log: CheckedLogs | None = None,
    swing: CheckedSwing | None = None,
    following: CheckedReference | None = None,
) -> CheckedRobot:
    """Return a robot with what follows from its parameters.

    Parameters
    ----------
    robot : Robot
    findings : sequence of Finding
        Of the robot.
    log : CheckedLogs, optional
        A log to predict; the spread of the predictions then follows from the standard deviations.
    swing : CheckedSwing, optional
    following : CheckedReference, optional
    """
    found, model = transforms(robot), Model(robot)
    linear = model.linearize()
    poles = np.asarray(linear.poles(), dtype=np.complex128)
    return CheckedRobot(
        robot=robot,
        spread=pole_spread(robot) if uncertain(robot) else None,
        findings=by_severity([*findings, *(log.findings if log else ())]),
        band=None if log is None else prediction_band(robot, next(iter(log.logs.values()))),
        swing=swing,
        following=following,
        derived=derived_quantities(robot),
        matrices={name: getattr(found, name) for name in MATRICES},
        linear=linear,
        linearization=linearization_results(model),
        poles=poles[np.argsort(-poles.real)],
    )


def linearization_results(model: Model) -> dict[str, object]:
    """Return what results.json holds of a model's linearization, the thesis's formulation marked beside it.

    Parameters
    ----------
    model : Model
        In the exact formulation, with the friction whose viscous part is to be in A.
    """
    names = [*STATE_NAMES]
    return {
        "about": "upright, at rest, psi = 0; viscous friction only",
        "state": names,
        "state_units": [unit_of(name) for name in names],
        "input": [*torque_names(model.robot.wheel_count)],
        "input_unit": "N m",
        "exact": _matrices(model.linearize()),
        "thesis": {"mistake": MISTAKEN_LINEARIZATION}
        | _matrices(replace(model, formulation="thesis").linearize()),
    }


def state_order(wheel_count: int) -> str:
    """Return what the rows and columns of A and B are, as a line of text."""
    states = ", ".join(f"{name} [{unit_of(name)}]" for name in STATE_NAMES)
    return f"x = {states}\nu = {', '.join(torque_names(wheel_count))} [N m]"


def _matrices(linear: LinearModel) -> dict[str, object]:
    return {"A": linear.A, "B": linear.B}
