"""The task of an experiment: a robot with nominal friction, its controller, limits, and parameters to estimate.

The value of a run is the standard errors that identification would give on its log, before there is one. A run that is
simulated with the parameters believed is cut into windows as identification cuts a log, and linearised as its last
stage does: batched central differences of the windows' predictions, each window's initial state estimated along with
the parameters. With residuals r_w of deviations sigma, J_w = d r_w / d z weighted by 1/sigma and the initial states
eliminated, the information and the expected covariance of scaled parameters z are

    H = sum_w J_w^T J_w                cov z >= H^-1

This linear bound (Cramer-Rao) is for comparing runs. With independent noise, and nothing unmodelled, estimates of the
Coulomb law scattered as it says, and those of the Stribeck law by 1.0 to 2.0 times as much (8 and 12 seeds), along the
bent and nearly level valley of b, c, s and v_s. Residuals that are correlated within a window, as they are on a robot,
add to that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ballbot.control.controller import Controller
from ballbot.control.references import Reference
from ballbot.errors import InputError
from ballbot.fitting.run import Threads
from ballbot.identification.identify import estimated_parameters
from ballbot.identification.initial_states import linearize
from ballbot.identification.parameters import Bounds, Coordinates
from ballbot.identification.prediction import Cost, Predictor, Problem
from ballbot.identification.quantities import with_friction
from ballbot.identification.stages import INNER_STEP, windows_for
from ballbot.log import STATE_NAMES, Log
from ballbot.log.columns import torque_names
from ballbot.mechanics.model import Model
from ballbot.robot import Robot
from ballbot.robot.components import scaled_friction
from ballbot.simulation.batch import simulate_batch
from ballbot.workflows.metrics import lean_of

#: length of the windows that identification cuts a log into [s]
WINDOW = 0.25

PEAK_UNITS = {"lean": "rad", "floor": "m", "torque": "N m"}


@dataclass(frozen=True, kw_only=True)
class RunPeaks:
    """How far a run, or the worst of some, went."""

    lean: float  #: of the axis from the vertical [rad]
    floor: float  #: distance from where the run began [m]
    torque: float  #: of any wheel [N m]


@dataclass(frozen=True, kw_only=True)
class RunLimits:
    """How far a run may go.

    Raises
    ------
    InputError
        If a limit is not positive, or the lean not below a quarter of a turn.
    """

    lean: float  #: of the axis from the vertical [rad]
    floor: float  #: distance from where the run begins [m]
    torque: float  #: of any wheel [N m]

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (np.isfinite(value) and value > 0.0):
                raise InputError(
                    f"The {field.name} limit is {value:g} {PEAK_UNITS[field.name]}; it must be positive."
                )
        if self.lean >= 0.5 * np.pi:
            raise InputError(
                f"The lean limit is {np.degrees(self.lean):.4g} degrees; it must be below 90 degrees."
            )

    def scaled(self, share: float) -> RunLimits:
        """Return that share of them."""
        return RunLimits(lean=share * self.lean, floor=share * self.floor, torque=share * self.torque)

    def used(self, peaks: RunPeaks) -> dict[str, float]:
        """Return the share of each limit that the peaks use; above 1 it is exceeded."""
        return {field.name: getattr(peaks, field.name) / getattr(self, field.name) for field in fields(self)}

    def exceeded(self, peaks: RunPeaks) -> list[str]:
        """Return the names of the limits that are exceeded."""
        return [name for name, share in self.used(peaks).items() if share > 1.0]


def peaks_of(states: NDArray[np.float64], torques: NDArray[np.float64]) -> RunPeaks:
    """Return the peaks of states (..., 10) and torques (..., n), of runs that begin at the origin."""
    return RunPeaks(
        lean=float(lean_of(states[..., 2], states[..., 3]).max()),
        floor=float(np.hypot(states[..., 0], states[..., 1]).max()),
        torque=float(np.abs(torques).max()),
    )


#: least information on a scaled parameter with the others known; below it the parameter has no influence
_MIN_INFORMATION = 1.0
#: relative to the largest; gives directions without information a large finite error
_RIDGE = 1e-13


@dataclass(frozen=True, kw_only=True, eq=False)
class InformationProblem:
    """The parameters that a run is to determine."""

    predictor: Predictor  #: its step is the simulation's
    coordinates: Coordinates
    point: NDArray[np.float64]  #: (p,), scaled, what is believed
    deviations: NDArray[np.float64]  #: (10,), of each state's prediction on the robot

    @property
    def labels(self) -> tuple[str, ...]:
        """Of the parameters sought."""
        free = self.coordinates.free
        return tuple(label for label, one in zip(self.coordinates.labels, free, strict=True) if one)

    def in_units(self, scaled: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return standard errors of the parameters sought in SI units, from scaled ones."""
        return scaled * self.coordinates.slopes(self.point)[self.coordinates.free]


def expected_errors(question: InformationProblem, logs: Sequence[Log]) -> NDArray[np.float64]:
    """Return the least standard errors to expect of the parameters sought, in shares of their bounds' width.

    Parameters
    ----------
    question : InformationProblem
    logs : sequence of Log
        Simulated with what is believed, without noise.

    Returns
    -------
    ndarray (f,)
        Of the free parameters; infinite if the runs have no information on one.
    """
    H = _information(question, logs)
    H = H[np.ix_(question.coordinates.free, question.coordinates.free)]
    known = H.diagonal() > _MIN_INFORMATION
    errors = np.full(len(H), np.inf)
    if known.any():
        scale = 1.0 / np.sqrt(H.diagonal()[known])
        R = H[np.ix_(known, known)] * np.outer(scale, scale)
        inverse = np.linalg.inv(R + _RIDGE * np.eye(len(R)))
        errors[known] = scale * np.sqrt(np.maximum(inverse.diagonal(), 1.0))
    return errors


def _information(question: InformationProblem, logs: Sequence[Log]) -> NDArray[np.float64]:
    """Return H (p, p) of the scaled parameters."""
    predictor = question.predictor
    windows = windows_for(predictor, question.coordinates.upper, logs, duration=WINDOW)
    # measurements off by exactly their deviations: identification takes its weights from the residuals
    off = replace(
        windows,
        initial=windows.initial + question.deviations,
        measured=windows.measured + question.deviations,
    )
    problem = Problem(
        predictor=predictor,
        windows=off,
        coordinates=question.coordinates,
        cost=Cost(reference=question.deviations**2),
        executor=Threads(count=1),
    )
    return linearize(problem, question.point, windows.initial).equations.normal.matrix


#: the laws whose parameters an experiment can be designed for
Law = Literal["viscous", "coulomb", "stribeck"]

#: a parameter believed to stand at a bound is taken so far within, scaled: s = 0 would hide v_s and delta
_INSIDE = 0.02
#: the limits must hold with friction of so many times the size believed
FRICTIONS = (1.0, 0.5, 1.5)


@dataclass(frozen=True, kw_only=True, eq=False)
class ExcitationTask:
    """Made by `task`."""

    robots: tuple[Robot, ...]  #: with the friction believed, then with less and with more
    controller: Controller
    limits: RunLimits
    duration: float  #: [s]
    question: InformationProblem

    @property
    def robot(self) -> Robot:
        """As it is believed to be."""
        return self.robots[0]


@dataclass(frozen=True, kw_only=True, eq=False)
class ReferenceRun:
    """A reference followed on the model."""

    log: Log  #: with the friction believed
    peaks: RunPeaks  #: the worst, over less and more friction too
    lasted: float  #: share of the duration before any of them fell; 1 if none did


def task(
    robot: Robot,
    controller: Controller,
    *,
    limits: RunLimits,
    duration: float,
    deviations: NDArray[np.float64],
    law: Law = "stribeck",
    bounds: Bounds | None = None,
) -> ExcitationTask:
    """Return what to design an experiment for.

    Parameters
    ----------
    robot : Robot
        With friction from an identification before; without any, that from which identification's search begins.
    controller : Controller
        That the robot will be run with.
    limits : RunLimits
    duration : float
        Of the run [s].
    deviations : ndarray (10,)
        Standard deviation of each state's prediction over a window on the robot.
    law : {"stribeck", "coulomb", "viscous"}
        The law whose parameters are estimated.
    bounds : Bounds, optional
        Identification's; errors count in shares of their width.

    Raises
    ------
    InputError
        If a value is invalid.
    """
    if deviations.shape != (10,) or not np.all(np.isfinite(deviations) & (deviations > 0.0)):
        raise InputError("The states' deviations must be ten positive numbers, one for each state.")
    coordinates = estimated_parameters(robot, free=("friction",), law=law, bounds=bounds or Bounds())
    point = _believed(robot, coordinates)
    question = InformationProblem(
        predictor=Predictor(
            robot=robot, formulation="exact", step=INNER_STEP, layout=coordinates.layout, threads=1
        ),
        coordinates=coordinates,
        point=point,
        deviations=deviations,
    )
    believed = with_friction(robot, coordinates.physical(point))
    return ExcitationTask(
        robots=tuple(_with_friction_times(believed, factor) for factor in FRICTIONS),
        controller=controller,
        limits=limits,
        duration=duration,
        question=question,
    )


def run_on_model(task: ExcitationTask, reference: Reference) -> ReferenceRun:
    """Follow a reference on the model."""
    batch = simulate_batch(
        [Model(robot, step=task.question.predictor.step) for robot in task.robots],
        task.controller,
        reference,
        duration=task.duration,
        initial_states=np.zeros(10),
        threads=1,
    )
    states = np.concatenate([np.zeros((1, 10)), batch.states[0, :-1]])
    sample_time = task.controller.sample_time
    columns = {"t": sample_time * np.arange(len(states), dtype=np.float64)}
    columns |= dict(zip(STATE_NAMES, states.T, strict=True))
    columns |= dict(zip(torque_names(task.robot.wheel_count), batch.torques[0].T, strict=True))
    return ReferenceRun(
        log=Log(columns),
        peaks=peaks_of(batch.states, batch.torques),
        lasted=float(min(1.0, batch.ended.min() / task.duration)),
    )


def _believed(robot: Robot, coordinates: Coordinates) -> NDArray[np.float64]:
    """Return the scaled parameters (p,) that the design is made about."""
    scaled = coordinates.scaled(coordinates.nominal)
    if _frictionless(robot):
        scaled = coordinates.from_search(np.full(len(scaled), 0.5))
    held = coordinates.scaled(coordinates.lower)
    return np.where(coordinates.free, np.clip(scaled, _INSIDE, 1.0 - _INSIDE), held)


def _frictionless(robot: Robot) -> bool:
    friction = robot.friction
    sizes: Sequence[float] = (*friction.viscous, *friction.coulomb, *friction.stribeck, friction.rolling)
    return not any(sizes)


def _with_friction_times(robot: Robot, factor: float) -> Robot:
    return robot.replace(friction=scaled_friction(robot.friction, factor))
