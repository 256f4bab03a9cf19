"""Perturbed plants: robots as uncertain as their identification leaves them, with a scenario's imperfections.

A controller that is tried on the robot that was identified, and on it alone, is tried on the one robot that nobody has.
Here the friction, and what else was identified, is drawn from the normal distribution of its estimates, clipped to
what is physical:

    p ~ N(p_hat, D C D)        D standard errors, C their correlation; a parameter without an error stays

and the plant has the delay, play, noise, sensors and floor of a scenario: the equations of motion (`SensedPlant`) or
the physics-engine twin. Estimator and controller know the robot as identified.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.estimation import named_estimator
from ballbot.estimation.interface import EstimatorName
from ballbot.identification import Identification
from ballbot.identification.quantities import BY_NAME
from ballbot.identification.result import estimated_robot
from ballbot.mechanics.model import Model
from ballbot.robot import Robot
from ballbot.simulation.plant import Plant
from ballbot.simulation.sensed_plant import SensedPlant
from ballbot.twin.imperfections import imperfections_of
from ballbot.twin.scenario import Scenario
from ballbot.twin.twin import Twin
from ballbot.workflows.courses import PlantName


def available_plant(name: PlantName | None) -> PlantName:
    """Return the plant of that name; without a name the twin if its engine is installed, else the model.

    Raises
    ------
    InputError
        If there is no such plant, or the twin's engine is not installed.
    """
    installed = find_spec("mujoco") is not None
    if name is None:
        return "twin" if installed else "model"
    if name not in get_args(PlantName):
        raise InputError(f"The plant is {name!r}; it must be 'model' or 'twin'.")
    if name == "twin" and not installed:
        raise InputError("The twin needs MuJoCo, which is not installed: pip install 'ballbot[twin]'.")
    return name


@dataclass(frozen=True, kw_only=True, eq=False)
class PlantDraw:
    """One robot to try controllers on."""

    robot: Robot  #: the true one
    known: Robot  #: as identified; what the estimator knows
    scenario: Scenario  #: with the true robot's friction
    plant: PlantName
    seed: int  #: of noise, start and all else that is random in a run

    def make(self, estimator: EstimatorName) -> Plant:
        """Return the plant, its measured state by that estimator."""
        if self.plant == "model":
            imperfections = imperfections_of(self.scenario)
            return SensedPlant(Model(self.robot), imperfections, known=self.known, estimator=estimator)
        state = named_estimator(estimator, self.known, sample_time=self.scenario.sensors.sample_time)
        return Twin(self.robot, self.scenario, estimator=state)


def draw_plants(
    found: Identification, *, plant: PlantName, scenario: Scenario, count: int, seed: int
) -> tuple[PlantDraw, ...]:
    """Draw plants from what an identification leaves uncertain.

    Parameters
    ----------
    found : Identification
    plant : {"model", "twin"}
    scenario : Scenario
        Its imperfections; its friction is replaced by the one drawn.
    count : int
        Number of plants, 2 or more for an interval.
    seed : int
        Random seed; draw k has the seed `seed` + k. The same seed gives the same draws.

    Raises
    ------
    InputError
        If `count` is below 1.
    """
    if count < 1:
        raise InputError(f"The number of draws is {count}; it must be 1 or more, such as 20.")
    random = np.random.default_rng([seed, 14])
    draws = []
    for k, values in enumerate(_parameters(found, count, random)):
        robot = _with_parameters(found, values)
        draws.append(
            PlantDraw(
                robot=robot,
                known=found.robot,
                scenario=replace(scenario, friction=robot.friction),
                plant=plant,
                seed=seed + k,
            )
        )
    return tuple(draws)


def parameter_covariance(found: Identification) -> NDArray[np.float64]:
    """Return the covariance (p, p) of what was identified, SI units; zero for a parameter without standard error."""
    errors = np.concatenate(
        [np.atleast_1d(found.standard_errors[BY_NAME[name].symbol]) for name in found.layout.names]
    ).astype(np.float64)
    known = np.isfinite(errors)
    D = np.diag(np.where(known, errors, 0.0))
    return D @ np.where(np.outer(known, known), found.correlation, 0.0) @ D


def _parameters(
    found: Identification, count: int, random: np.random.Generator
) -> Sequence[NDArray[np.float64]]:
    """Return parameter vectors (p,) drawn about the identified robot's, each within its quantity's bounds."""
    mean = found.layout.nominal(found.robot)
    if found.robot.friction.coulomb_asymmetry:  # estimated as a torque offset against it
        offsets = np.array(
            [name == "torque_offset" for name in found.layout.names for _ in _numbers_of(found, name)]
        )
        mean[offsets] = np.negative(found.robot.friction.coulomb_asymmetry)
    bounds = np.concatenate([BY_NAME[name].default_bounds(found.robot) for name in found.layout.names])
    drawn = random.multivariate_normal(mean, parameter_covariance(found), size=count, method="eigh")
    # a value identified beyond the default bounds, by bounds of the user's own, stays where it is
    lower, upper = np.minimum(bounds[:, 0], mean), np.maximum(bounds[:, 1], mean)
    return list(np.clip(drawn, lower, upper))


def _numbers_of(found: Identification, name: str) -> tuple[str, ...]:
    return BY_NAME[name].labels(found.layout.wheel_count)


def _with_parameters(found: Identification, values: NDArray[np.float64]) -> Robot:
    asymmetric = bool(found.robot.friction.coulomb_asymmetry)
    return estimated_robot(found.robot, found.layout, values, asymmetric=asymmetric)
