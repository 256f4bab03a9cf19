"""What pushes the twin from outside: pushes on the body, bumps of the floor. Set once a sample."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ballbot.robot.robot import Robot
from ballbot.twin.engine import Engine
from ballbot.twin.faults import Push, Roughness
from ballbot.twin.scenario import Scenario

_WAVES = 24


class Disturbance(Protocol):
    """Forces from outside."""

    def prepare_sample(self, t: float) -> None:
        """Set the forces for the sample that begins at t [s]."""
        ...


def disturbances(robot: Robot, scenario: Scenario, engine: Engine) -> list[Disturbance]:
    """Return those that a scenario has."""
    found: list[Disturbance] = []
    if scenario.pushes:
        found.append(Pushes(scenario.pushes, engine))
    if scenario.roughness:
        carried = scenario.payload.mass if scenario.payload else 0.0
        weight = (robot.ball.mass + robot.body.mass + carried) * robot.gravity
        found.append(Bumps(scenario.roughness, weight, engine))
    return found


class Pushes:
    """Forces on the body, each for its while."""

    def __init__(self, pushes: tuple[Push, ...], engine: Engine) -> None:
        self._pushes = pushes
        self._wrench = engine.external_force("body")
        self._center_of_mass = engine.center_of_mass("body")
        body = engine.first_position("body")
        self._pose = engine.qpos[body : body + 7]

    def prepare_sample(self, t: float) -> None:
        """Set the sum of the pushes that last at t [s]; half a microsecond of rounding is forgiven."""
        self._wrench[:] = 0.0
        for push in self._pushes:
            if push.time - 5e-7 <= t < push.time + push.duration - 5e-7:
                force = np.array(push.force)
                arm = self._pose[:3] + push.height * _up(self._pose[3:]) - self._center_of_mass
                self._wrench[:3] += force
                self._wrench[3:] += np.cross(arm, force)


class Bumps:
    """The force that the slope of an uneven floor makes, at the ball's centre."""

    def __init__(self, roughness: Roughness, weight: float, engine: Engine) -> None:
        self._wrench = engine.external_force("ball")
        ball = engine.first_position("ball")
        self._place = engine.qpos[ball : ball + 2]
        self._weight = weight  # of all that rolls [N]
        self._floor = UnevenFloor(roughness)

    def prepare_sample(self, t: float) -> None:  # noqa: ARG002 (the interface's)
        """Set the force for where the ball is."""
        self._wrench[:2] = -self._weight * self._floor.slope(self._place)


class UnevenFloor:
    """Height of a floor over the plane: a sum of waves that a seed draws."""

    def __init__(self, roughness: Roughness) -> None:
        random = np.random.default_rng([roughness.seed, 900])
        heading = random.uniform(0.0, 2 * np.pi, _WAVES)  # U(0, 2 pi)
        length = roughness.wavelength * 4.0 ** random.uniform(
            0.0, 1.0, _WAVES
        )  # log-uniform, up to four times
        self._phases = random.uniform(0.0, 2 * np.pi, _WAVES)  # U(0, 2 pi)
        self._numbers = (2 * np.pi / length)[:, None] * np.column_stack((np.cos(heading), np.sin(heading)))
        self._amplitude = roughness.height * np.sqrt(2.0 / _WAVES)

    def height(self, place: NDArray[np.float64]) -> float:
        """Return h(x, y) [m]."""
        return float(self._amplitude * np.sin(self._numbers @ place + self._phases).sum())

    def slope(self, place: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return grad h (2,) at a place (2,) [m]."""
        return self._amplitude * np.cos(self._numbers @ place + self._phases) @ self._numbers


def _up(quaternion_wxyz: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the body's z axis (3,) in the world's frame."""
    w, x, y, z = quaternion_wxyz.tolist()
    return np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
