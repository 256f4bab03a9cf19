"""Draw robots near this one from its standard deviations, and propagate them to results.

Errors of different parameters count as independent, but for those whose correlations the robot states. A number that
was estimated without a standard error is drawn within the interval that the robot states, with the deviation of an even
distribution over it.

Linear propagation is the delta method: with the central differences d_i of a result over a tenth of each standard
deviation s_i and the correlations r_ij, its variance is the sum of d_i s_i r_ij s_j d_j.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.robot.components import BY_NAME, deviation_labels, parameters_of_robot
from ballbot.robot.parameters import Value, numbers_of, value_of
from ballbot.robot.robot import Robot, with_values

#: differences are taken over this fraction of a standard deviation
STEP = 0.1
#: draws that describe no robot, for each that does, before the standard deviations are refused
_MOST_REFUSALS = 20
#: smallest fraction of v_s and delta, which must stay above zero, that is drawn
_LEAST_SHARE = 0.1


@dataclass(frozen=True, kw_only=True)
class Uncertain:
    """One number of a robot that is known to an error above zero."""

    label: str  #: "ball.radius" or "wheels.azimuths[1]"
    name: str
    place: int  #: within the parameter's numbers
    deviation: float  #: SI units


def uncertain(robot: Robot) -> list[Uncertain]:
    """Return the numbers that have a standard deviation above zero, in the files' order."""
    even = {label: (most - least) / math.sqrt(12.0) for label, (least, most) in robot.intervals.items()}
    return [
        Uncertain(label=label, name=name, place=place, deviation=known)
        for label, name, place, deviation in deviation_labels(robot.standard_deviations)
        if (known := even.get(label, deviation)) > 0.0
    ]


def with_default_errors(robot: Robot) -> Robot:
    """Return a robot with the errors that its parameters have by default (`Parameter.error`), in place of its own."""
    errors: dict[str, Value] = {}
    for parameter in parameters_of_robot(robot):
        value = value_of(robot, parameter)
        if parameter.error and isinstance(value, float):
            errors[parameter.name] = parameter.error * abs(value)
    return robot.annotated(standard_deviations=errors)


def correlations(robot: Robot) -> NDArray[np.float64]:
    """Return the correlation matrix (k, k) of the errors of the numbers of `uncertain`."""
    labels = [number.label for number in uncertain(robot)]
    result = np.eye(len(labels))
    known = robot.correlation.among(labels)
    places = [labels.index(label) for label in known.of]
    result[np.ix_(places, places)] = known.matrix()
    return result


def shifted(robot: Robot, amounts: dict[Uncertain, float]) -> Robot:
    """Return the robot with these amounts [SI units] added to its numbers; InputError if that is not a robot."""
    changes: dict[str, Value] = {}
    for which, amount in amounts.items():
        value = changes.get(which.name, value_of(robot, BY_NAME[which.name]))
        numbers = list(numbers_of(value))
        numbers[which.place] += amount
        changes[which.name] = tuple(numbers) if isinstance(value, tuple) else numbers[0]
    return with_values(robot, changes)


def draw_robots(robot: Robot, count: int, *, seed: int) -> list[Robot]:
    """Return robots as this one may be: each uncertain number drawn from a normal distribution about its value.

    Friction is drawn at its least value if it would be below: estimates of a very small term lie near zero, and with
    several such terms hardly any draw would be valid. Other draws that describe no robot (a negative mass, an inertia
    that no body has) are drawn again.

    InputError if nearly all draws describe no robot.

    >>> weighed = Robot.load("alten").annotated(standard_deviations={"body.mass": 0.1})
    >>> len({robot.body.mass for robot in draw_robots(weighed, 3, seed=0)})
    3
    """
    random, numbers = np.random.default_rng(seed), uncertain(robot)
    mixing, own = _square_root(correlations(robot)), [number.deviation for number in numbers]
    robots: list[Robot] = []
    for _ in range(_MOST_REFUSALS * (count + 1)):
        if len(robots) == count:
            break
        errors = own * (mixing @ random.standard_normal(len(numbers)))  # N(0, 1), correlated as stated
        pairs = zip(numbers, errors, strict=True)
        amounts = {number: _within(robot, number, float(error)) for number, error in pairs}
        try:
            robots.append(shifted(robot, amounts))
        except InputError:
            continue
    if len(robots) < count:
        raise InputError(
            f"The standard deviations of {robot.name} are so large that hardly any draw is a possible "
            "robot. Make them smaller, or use `ballbot check` to see which value is at a limit."
        )
    return robots


def _within(robot: Robot, number: Uncertain, amount: float) -> float:
    """Return an amount of friction that leaves zero or more, and of v_s and delta a tenth; others as they are.

    A number with an interval stays within it.
    """
    parameter = BY_NAME[number.name]
    value = float(numbers_of(value_of(robot, parameter))[number.place])
    if number.label in robot.intervals:
        least, most = robot.intervals[number.label]
        return min(max(amount, least - value), most - value)
    if parameter.table != "friction" or parameter.least < 0.0:
        return amount
    zero = parameter.least_is_allowed and parameter.default != 0.0  # which else means unknown
    least = parameter.least if zero else _LEAST_SHARE * value
    return max(amount, least - value)


def _square_root(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return R with R R^T = a correlation matrix, whose rounding may have left eigenvalues below zero."""
    values, vectors = np.linalg.eigh(matrix)
    return vectors * np.sqrt(np.maximum(values, 0.0))


@dataclass(frozen=True, kw_only=True, eq=False)
class Propagated:
    """The uncertainty of a result from that of the parameters."""

    deviation: float  #: standard deviation
    parts: dict[str, float]  #: of each uncertain number alone, by its label; signed, for one deviation

    def largest(self, count: int = 3) -> list[tuple[str, float]]:
        """Return the numbers that matter most: label and fraction of the variance of independent errors."""
        whole = sum(part**2 for part in self.parts.values())
        if whole == 0.0:
            return []
        fractions = {label: part**2 / whole for label, part in self.parts.items()}
        return sorted(fractions.items(), key=lambda item: -item[1])[:count]


def propagate(
    robot: Robot,
    result_of: Callable[[Robot], float],  # smooth in the robot's numbers
) -> Propagated:
    """Carry a robot's standard deviations through to a result, linearly.

    InputError if no robot a tenth of a standard deviation away can exist, on either side.

    >>> weighed = Robot.load("alten").annotated(standard_deviations={"body.mass": 0.1})
    >>> doubled = propagate(weighed, lambda robot: 2.0 * robot.body.mass)
    >>> round(doubled.deviation, 9)
    0.2
    """
    value, parts = result_of(robot), dict[str, float]()
    for number in uncertain(robot):
        ends, refusal = [], None
        for step in (STEP, -STEP):
            try:
                ends.append((step, result_of(shifted(robot, {number: step * number.deviation}))))
            except InputError as error:
                refusal = error
        if not ends:
            raise InputError(f"{number.label} cannot vary by a tenth of its standard deviation: {refusal}")
        # a number at its bound, such as friction of zero, can only be shifted to one side
        (ahead, high), (behind, low) = ends if refusal is None else (*ends, (0.0, value))
        parts[number.label] = (high - low) / (ahead - behind)
    stacked = np.array([*parts.values()])
    variance = float(stacked @ correlations(robot) @ stacked)
    return Propagated(deviation=math.sqrt(max(variance, 0.0)), parts=parts)
