"""How well a robot's parameters are known: standard deviations, robots drawn from them, and what they do to a result.

Errors of different parameters count as independent. Linear propagation is the delta method: with the central
differences d_i of a result over a tenth of each standard deviation s_i, its variance is the sum of (d_i s_i)^2.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from numbers import Real
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.robot.parameters import BY_NAME, PARAMETERS, Value, value_of

if TYPE_CHECKING:
    from ballbot.robot.robot import Robot

#: differences are taken over this share of a standard deviation
STEP = 0.1
#: draws that describe no robot, for each that does, before a robot's standard deviations are refused
_MOST_REFUSALS = 20


def check_deviations(robot: Robot) -> None:
    """Refuse standard deviations that are none.

    Raises
    ------
    InputError
        Where a name is no parameter's, the parameter is a whole number, or a standard deviation is not a finite number
        of zero or more, one for each of the parameter's.
    """
    for name, deviation in robot.standard_deviations.items():
        if name not in BY_NAME or BY_NAME[name].shape == "whole number":
            raise InputError(f"{name} has a standard deviation but is not a parameter that can have one.")
        value, numbers = value_of(robot, BY_NAME[name]), _numbers(deviation)
        count = len(_numbers(value))
        if isinstance(value, tuple) != isinstance(deviation, tuple) or len(numbers) != count:
            raise InputError(f"{name} has the standard deviation {deviation!r}; it needs {count} of them.")
        for one in numbers:
            if not isinstance(one, Real) or not math.isfinite(one) or one < 0.0:
                raise InputError(
                    f"{name} has the standard deviation {one!r}; it must be finite, zero or more."
                )


@dataclass(frozen=True, kw_only=True)
class Uncertain:
    """One number of a robot that is known to a standard deviation above zero."""

    label: str  #: "ball.radius" or "wheels.azimuths[1]"
    name: str
    place: int  #: within the parameter's numbers
    deviation: float  #: SI units


def uncertain(robot: Robot) -> list[Uncertain]:
    """Return the numbers that have a standard deviation, in the files' order."""
    return list(_uncertain(robot))


def shifted(robot: Robot, amounts: dict[Uncertain, float]) -> Robot:
    """Return the robot with these amounts [SI units] added to its numbers.

    Raises
    ------
    InputError
        Where that is no robot.
    """
    from ballbot.robot.robot import Values, assemble

    values = {one.name: value_of(robot, one) for one in PARAMETERS}
    for which, amount in amounts.items():
        numbers = list(_numbers(values[which.name]))
        numbers[which.place] += amount
        values[which.name] = tuple(numbers) if isinstance(values[which.name], tuple) else numbers[0]
    return assemble(
        name=robot.name,
        inertia_about=robot.body.inertia_about,
        values=Values(by_name=values),
        sources=robot.sources,
    )


def draw_robots(robot: Robot, count: int, *, seed: int) -> list[Robot]:
    """Return robots as this one may be: each uncertain number drawn from a normal distribution about its value.

    Draws that describe no robot (a negative mass, an inertia that no body has) are drawn again.

    Raises
    ------
    InputError
        Where nearly all draws are such.
    """
    random, numbers = np.random.default_rng(seed), uncertain(robot)
    robots: list[Robot] = []
    for _ in range(_MOST_REFUSALS * count + _MOST_REFUSALS):
        if len(robots) == count:
            break
        # errors: N(0, deviation)
        errors = random.standard_normal(len(numbers))
        try:
            robots.append(
                shifted(
                    robot,
                    {one: one.deviation * float(error) for one, error in zip(numbers, errors, strict=True)},
                )
            )
        except InputError:
            continue
    if len(robots) < count:
        raise InputError(
            f"The standard deviations of {robot.name} are so large that hardly any draw is a possible "
            "robot. Make them smaller, or use `ballbot check` to see which value is at a limit."
        )
    return robots


@dataclass(frozen=True, kw_only=True, eq=False)
class Propagated:
    """A result (any shape) and what the parameters' uncertainty does to it."""

    value: NDArray[np.float64]
    deviation: NDArray[np.float64]  #: standard deviation, of the value's shape
    parts: dict[
        str, NDArray[np.float64]
    ]  #: of each uncertain number alone, by its label; signed, for one deviation

    def largest(self, count: int = 3) -> list[tuple[str, float]]:
        """Return the numbers that matter most: label and share of the variance, summed over the result."""
        whole = float((self.deviation**2).sum())
        if whole == 0.0:
            return []
        shares = {label: float((part**2).sum()) / whole for label, part in self.parts.items()}
        return sorted(shares.items(), key=lambda share: -share[1])[:count]


def propagate(robot: Robot, result_of: Callable[[Robot], NDArray[np.float64]]) -> Propagated:
    """Carry a robot's standard deviations through to a result, linearly.

    Parameters
    ----------
    robot : Robot
    result_of : callable
        From a robot to an array of always the same shape, smooth in the robot's numbers.

    Raises
    ------
    InputError
        Where a robot within a tenth of a standard deviation cannot exist.
    """
    value = np.asarray(result_of(robot), dtype=np.float64)
    parts = {}
    for one in uncertain(robot):
        step = STEP * one.deviation
        try:
            ends = [result_of(shifted(robot, {one: sign * step})) for sign in (1.0, -1.0)]
        except InputError as error:
            raise InputError(
                f"{one.label} cannot vary by a tenth of its standard deviation: {error}"
            ) from None
        parts[one.label] = np.asarray((ends[0] - ends[1]) / (2.0 * STEP), dtype=np.float64)
    variance = sum((part**2 for part in parts.values()), np.zeros_like(value))
    return Propagated(value=value, deviation=np.sqrt(variance), parts=parts)


def _uncertain(robot: Robot) -> Iterator[Uncertain]:
    for name in BY_NAME:
        deviation = robot.standard_deviations.get(name, 0.0)
        for place, one in enumerate(_numbers(deviation)):
            if one > 0.0:
                label = f"{name}[{place}]" if isinstance(deviation, tuple) else name
                yield Uncertain(label=label, name=name, place=place, deviation=float(one))


def _numbers(value: Value) -> tuple[float, ...]:
    return value if isinstance(value, tuple) else (value,)
