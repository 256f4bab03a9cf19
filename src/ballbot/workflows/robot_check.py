"""Everything that `ballbot check` reports about a robot: derived quantities, matrices, poles, a swing.

The standard deviations in a robot's file are propagated to the mean of its unstable poles. The mean is a smooth
function of the parameters; the faster of two nearly equal poles, as a symmetric robot has for its two leans, is not.
"""

from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import Floats
from ballbot.control.margins import Margins, loop_margins
from ballbot.control.presets import KINDS
from ballbot.control.source import named_controller
from ballbot.errors import InputError
from ballbot.findings import Finding, stop_on_errors
from ballbot.identification.swing import SwingInertia, fit_swing, inertia_of_swing, swing_in_log
from ballbot.log import Log
from ballbot.log.checks.values import check_jitter, check_rows
from ballbot.log.columns import STATE_NAMES, torque_names, unit_of
from ballbot.mechanics.geometry import transforms
from ballbot.mechanics.model import Model
from ballbot.robot import Robot
from ballbot.robot.variations import Propagated, propagate, uncertain

#: the thesis's names of the matrices, with what each does and the thesis's equation of it
MATRICES = {
    "T_tbw": "torque on the ball from torque on the wheels (II.10)",
    "T_tbg": "torque on the ball from force on the ground (II.12)",
    "T_fgb": "force on the ground from torque on the ball",
    "T_owb": "wheel speed from the ball's angular velocity (II.13), (V.2)",
    "T_obw": "the ball's angular velocity from wheel speed (V.3)",
    "T_vgb": "velocity over ground from the ball's angular velocity (II.15)",
}


def check_swing(
    robot: Robot,
    file: Path,
    *,
    distance: float | None = None,
    deviation: float | None = None,
    accept: Collection[str] = (),
) -> SwingInertia:
    """Return a robot's inertia from the swing in a log.

    InputError if the log has no swing, the swing has an error whose code is not accepted, or the pivot is not possible.
    """
    log = Log.read(file)
    of_log = [*check_rows(Log({"t": log.t}), None), *check_jitter(log)]
    inertia = inertia_of_swing(fit_swing(swing_in_log(log)), robot, distance=distance, deviation=deviation)
    swing = replace(inertia, log_findings=tuple(of_log))
    stop_on_errors(
        [replace(finding, where=replace(finding.where, file=str(file))) for finding in swing.findings],
        accept=accept,
    )
    return swing


@dataclass(frozen=True, kw_only=True, eq=False)
class CheckedRobot:
    """A robot with everything that `ballbot check` reports about it."""

    robot: Robot
    findings: tuple[Finding, ...]  #: of the robot, errors first
    controller: str = "nominal"  #: whose margins are stated: "nominal", "precise" or a file
    swing: SwingInertia | None = None

    @cached_property
    def matrices(self) -> dict[str, Floats]:
        """The matrices of `MATRICES`."""
        return {name: getattr(transforms(self.robot), name) for name in MATRICES}

    @cached_property
    def poles(self) -> NDArray[np.complex128]:
        """The poles of the exact model about upright, fastest growth first [rad/s]."""
        poles = np.asarray(Model(self.robot).linearize().poles(), dtype=np.complex128)
        return poles[np.argsort(-poles.real)]

    @cached_property
    def spread(self) -> Propagated | None:
        """The mean of the unstable poles with its standard deviation; None if no value has one."""
        return propagate(self.robot, _mean_growth) if uncertain(self.robot) else None

    @cached_property
    def margins(self) -> Margins | str:
        """The controller's margins, or why there are none; InputError if there is no such controller file."""
        try:
            return loop_margins(named_controller(self.controller, self.robot))
        except InputError as error:
            if self.controller not in KINDS:
                raise
            return str(error)


def _mean_growth(robot: Robot) -> float:
    growths = Model(robot).linearize().poles().real
    return float(growths[growths > 0.0].mean())


def linearization_results(model: Model) -> dict[str, object]:
    """Return what results.json holds of the linearization of a model, whose viscous friction is in A."""
    linear, names = model.linearize(), [*STATE_NAMES]
    return {
        "about": "upright, at rest, psi = 0; viscous friction only",
        "state": names,
        "state_units": [unit_of(name) for name in names],
        "input": [*torque_names(model.robot.wheel_count)],
        "input_unit": "N m",
        "exact": {"A": linear.A, "B": linear.B},
    }
