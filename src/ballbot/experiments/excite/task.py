"""What an experiment is designed for: a robot as it is believed to be, its controller, limits and questions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ballbot.control.controller import Controller
from ballbot.control.references import Reference
from ballbot.errors import InputError
from ballbot.experiments.excite.information import Question
from ballbot.experiments.excite.limits import Limits, Peaks, peaks_of
from ballbot.identification.identify import estimated_parameters
from ballbot.identification.parameters import Bounds, Coordinates
from ballbot.identification.prediction import Predictor
from ballbot.identification.quantities import with_friction
from ballbot.identification.stages import EVOLUTION_STEP
from ballbot.log import STATE_NAMES, Log
from ballbot.log.columns import torque_names
from ballbot.mechanics.model import Model
from ballbot.robot import Robot
from ballbot.simulation.batch import simulate_batch

#: the laws whose parameters an experiment can be designed for
Law = Literal["viscous", "coulomb", "stribeck"]

#: a parameter believed to stand at a bound is taken so far within, scaled: s = 0 would hide v_s and delta
_INSIDE = 0.02
#: the limits must hold with friction of so many times the size believed
_FRICTIONS = (1.0, 0.5, 1.5)


@dataclass(frozen=True, kw_only=True, eq=False)
class Task:
    """Made by `task`."""

    robots: tuple[Robot, ...]  #: with the friction believed, then with less and with more
    controller: Controller
    limits: Limits
    duration: float  #: [s]
    question: Question

    @property
    def robot(self) -> Robot:
        """As it is believed to be."""
        return self.robots[0]


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """A reference followed on the model."""

    log: Log  #: with the friction believed
    peaks: Peaks  #: the worst, over less and more friction too
    lasted: float  #: share of the duration before any of them fell; 1 where none did


def task(
    robot: Robot,
    controller: Controller,
    *,
    limits: Limits,
    duration: float,
    deviations: NDArray[np.float64],
    law: Law = "stribeck",
    bounds: Bounds | None = None,
    window: float = 0.25,
) -> Task:
    """Return what to design an experiment for.

    Parameters
    ----------
    robot : Robot
        With friction from an identification before; without any, that from which identification's search begins.
    controller : Controller
        That the robot will be run with.
    limits : Limits
    duration : float
        Of the run [s].
    deviations : ndarray (10,)
        Standard deviation of each state's prediction over a window on the robot.
    law : {"stribeck", "coulomb", "viscous"}
        Whose parameters are asked for.
    bounds : Bounds, optional
        Identification's; errors count in shares of their width.
    window : float
        Identification's [s].

    Raises
    ------
    InputError
        Where a value makes no sense.
    """
    if deviations.shape != (10,) or not np.all(np.isfinite(deviations) & (deviations > 0.0)):
        raise InputError("The states' deviations must be ten positive numbers, one for each state.")
    coordinates = estimated_parameters(robot, free=("friction",), law=law, bounds=bounds or Bounds())
    point = _believed(robot, coordinates)
    question = Question(
        predictor=Predictor(
            robot=robot, formulation="exact", step=EVOLUTION_STEP, layout=coordinates.layout, threads=1
        ),
        coordinates=coordinates,
        point=point,
        deviations=deviations,
        window=window,
    )
    believed = with_friction(robot, coordinates.physical(point))
    return Task(
        robots=tuple(_with_friction_times(believed, factor) for factor in _FRICTIONS),
        controller=controller,
        limits=limits,
        duration=duration,
        question=question,
    )


def run(task: Task, reference: Reference) -> Run:
    """Follow a reference on the model."""
    batch = simulate_batch(
        Model(task.robot, step=task.question.predictor.step),
        task.controller,
        reference,
        duration=task.duration,
        robots=task.robots,
        threads=1,
    )
    states = np.concatenate([np.zeros((1, 10)), batch.states[0, :-1]])
    sample_time = task.controller.sample_time
    columns = {"t": sample_time * np.arange(len(states), dtype=np.float64)}
    columns |= dict(zip(STATE_NAMES, states.T, strict=True))
    columns |= dict(zip(torque_names(task.robot.wheel_count), batch.torques[0].T, strict=True))
    return Run(
        log=Log(columns),
        peaks=peaks_of(batch.states, batch.torques),
        lasted=float(min(1.0, batch.ended.min() / task.duration)),
    )


def _believed(robot: Robot, coordinates: Coordinates) -> NDArray[np.float64]:
    """Return the scaled parameters (p,) that the design is made about."""
    scaled = coordinates.scaled(coordinates.before)
    if _frictionless(robot):
        scaled = coordinates.from_search(np.full(len(scaled), 0.5))
    held = coordinates.scaled(coordinates.lower)
    return np.where(coordinates.free, np.clip(scaled, _INSIDE, 1.0 - _INSIDE), held)


def _frictionless(robot: Robot) -> bool:
    friction = robot.friction
    sizes: Sequence[float] = (*friction.viscous, *friction.coulomb, *friction.stribeck, friction.rolling)
    return not any(sizes)


def _with_friction_times(robot: Robot, factor: float) -> Robot:
    def times(values: Sequence[float]) -> tuple[float, ...]:
        return tuple(factor * value for value in values)

    friction = robot.friction
    return robot.replace(
        friction=replace(
            friction,
            viscous=times(friction.viscous),
            coulomb=times(friction.coulomb),
            stribeck=times(friction.stribeck),
            rolling=factor * friction.rolling,
        )
    )
