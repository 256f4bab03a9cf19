"""Robots that the one described may turn out to be, and what their loops may have to bear."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.robot import Robot
from ballbot.robot.robot import scaled_body
from ballbot.simulation.conditions import MAX_SLOPE, Conditions

#: the ball lies so far from where it is asked to be at the start [m]
START = 0.3


@dataclass(frozen=True, kw_only=True)
class Spread:
    """How far robots may be from the one described. Each is uniform, and independent of the others.

    Raises
    ------
    InputError
        Where one is not what it can be.
    """

    mass: float = (
        0.2  #: of the body, either way, as a share; its inertia about its centre of mass goes with it
    )
    height: float = 0.2  #: of the centre of mass, either way, as a share
    friction: float = 0.2  #: of each wheel's and of the rolling friction, either way, as a share
    delay: int = 2  #: most samples by which torques come late
    tilt: float = 1.0  #: most of the floor, in any direction [degrees]

    def __post_init__(self) -> None:
        for one in fields(self):
            value = getattr(self, one.name)
            if not (math.isfinite(value) and value >= 0.0):
                raise InputError(f"The perturbed {one.name} is {value!r}; it must be zero or more.")
        for name in ("mass", "height", "friction"):
            if getattr(self, name) >= 1.0:
                raise InputError(
                    f"The perturbed {name} is {getattr(self, name):g}; it is a fraction and must be below 1."
                )
        if not isinstance(self.delay, int):
            raise InputError(f"The delay is {self.delay!r} samples; it must be a whole number.")
        if math.tan(math.radians(self.tilt)) > MAX_SLOPE:
            raise InputError(
                f"The floor's tilt is {self.tilt:g} degrees; it must be at most "
                f"{math.degrees(math.atan(MAX_SLOPE)):.1f}."
            )


@dataclass(frozen=True, kw_only=True, eq=False)
class Perturbed:
    """Robots, what their loops bear, and where they start."""

    robots: tuple[Robot, ...]
    conditions: tuple[Conditions, ...]
    starts: NDArray[
        np.float64
    ]  #: (robots, 10), the ball `START` away from the origin in any direction, upright at rest

    def __len__(self) -> int:
        """Return how many robots there are."""
        return len(self.robots)


def draw_perturbed(robot: Robot, count: int, *, spread: Spread, seed: int) -> Perturbed:
    """Draw robots as `spread` says; equal seeds give equal robots.

    Raises
    ------
    InputError
        Where no robot is asked for, or one that is drawn cannot be.
    """
    if count < 1:
        raise InputError(
            f"The number of perturbed robots is {count}; it must be at least 1, and about a thousand for a "
            "meaningful worst tenth."
        )
    random = np.random.default_rng([seed, 71])
    robots, conditions, starts = [], [], np.zeros((count, 10))
    for lane in range(count):
        # mass, height and each friction: U(1 - share, 1 + share)
        mass, height = 1.0 + random.uniform(-1.0, 1.0, 2) * (spread.mass, spread.height)
        factors = 1.0 + spread.friction * random.uniform(-1.0, 1.0, robot.wheel_count + 1)
        # delay: any whole number of samples; tilt and its direction, and the start's: uniform
        delay = int(random.integers(0, spread.delay + 1))
        slope = math.tan(math.radians(spread.tilt * float(random.uniform(0.0, 1.0))))
        uphill, away = random.uniform(0.0, 2.0 * np.pi, 2)
        robots.append(_scaled(robot, float(mass), float(height), factors.tolist()))
        slopes = (slope * math.cos(uphill), slope * math.sin(uphill))
        conditions.append(Conditions(delay=delay, slope=slopes))
        starts[lane, :2] = START * math.cos(away), START * math.sin(away)
    return Perturbed(robots=tuple(robots), conditions=tuple(conditions), starts=starts)


def _scaled(robot: Robot, mass: float, height: float, friction: list[float]) -> Robot:
    """Return the robot with these factors on its body, and on the friction of each wheel and of the rolling ball."""
    *wheels, rolling = friction
    old = robot.friction

    def each(values: tuple[float, ...]) -> tuple[float, ...]:
        return tuple(factor * value for factor, value in zip(wheels, values, strict=True))

    new = replace(
        old,
        viscous=each(old.viscous),
        coulomb=each(old.coulomb),
        stribeck=each(old.stribeck),
        rolling=rolling * old.rolling,
    )
    return robot.replace(body=scaled_body(robot.body, mass=mass, height=height), friction=new)
