"""The standard deviations, correlations and intervals that an identified robot's file states.

The robot's numbers y follow from the parameters p that were estimated. With the covariance C of these and the
derivatives G = dy/dp, the delta method gives the numbers' covariance G C G^T. A number that depends on a parameter that
was estimated without a standard error has none either: its standard deviation is infinite, and its interval is what it
takes on over that parameter's interval or, lacking one, its range. A number that depends on no estimated parameter has
no standard deviation, and counts as exact.

A robot that is written and read again has the same covariance within the digits of its file: deviations have four, and
correlations five decimals.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.fitting.intervals import HALF_WIDTH, Interval
from ballbot.robot import Robot
from ballbot.robot.components import BY_NAME, Correlation
from ballbot.robot.parameters import Value, value_of

#: derivatives are differences over this share of a deviation
_STEP = 0.1
#: a number that changes by less, relative to its size, does not depend on a parameter
_UNCHANGED = 1e-12


def ends_without_error(
    labels: Sequence[str],
    values: NDArray[np.float64],
    errors: NDArray[np.float64],
    *,
    bounds: NDArray[np.float64],
    intervals: Mapping[str, Interval],
) -> dict[int, tuple[float, float]]:
    """Return the interval or, lacking one, the range of each estimated parameter without a standard error.

    By the parameter's place. Equal `bounds` (p, 2) hold a parameter: it is not estimated.
    """
    ends = {}
    for i in np.flatnonzero((bounds[:, 1] > bounds[:, 0]) & ~np.isfinite(errors)).tolist():
        one = intervals.get(labels[i])
        low, high = (-np.inf, np.inf) if one is None else (one.lower, one.upper)
        least, most = max(low, float(bounds[i, 0])), min(high, float(bounds[i, 1]))
        ends[i] = (min(least, float(values[i])), max(most, float(values[i])))
    return ends


def with_uncertainty(
    found: Robot,
    robot_of: Callable[[NDArray[np.float64]], Robot],
    values: NDArray[np.float64],
    covariance: NDArray[np.float64],
    *,
    names: Collection[str],
    ends: Mapping[int, tuple[float, float]] = MappingProxyType({}),
) -> Robot:
    """Return a robot with the standard deviations, correlations and intervals of the numbers that parameters determine.

    `found` is the robot of the parameters `values` (p,), SI units, and `robot_of` gives that of others. `covariance`
    is zero or NaN for parameters without a standard error; `ends` are those of `ends_without_error`. It is stated of
    the robot's parameters `names`, dotted.
    """
    names = [name for name in BY_NAME if name in set(names) and value_of(found, BY_NAME[name]) != ()]
    covariance = np.nan_to_num(covariance)
    numbers = _numbers(found, names)
    G = np.zeros((len(numbers), len(values)))
    for place in np.flatnonzero(covariance.diagonal() > 0.0):
        step = _STEP * float(np.sqrt(covariance[place, place]))
        G[:, place] = _derivative(robot_of, values, int(place), step, names)
    spread = G @ covariance @ G.T
    sizes = np.sqrt(np.maximum(spread.diagonal(), 0.0))
    least, most = numbers.copy(), numbers.copy()
    for place, both in ends.items():
        for end in both:
            moved = values.copy()
            moved[place] = end
            try:
                at_end = _numbers(robot_of(moved), names)
            except InputError:
                continue  # no robot has it
            least, most = np.minimum(least, at_end), np.maximum(most, at_end)
    unknown = most - least > _UNCHANGED * np.abs(numbers)
    least, most = least - HALF_WIDTH * sizes, most + HALF_WIDTH * sizes
    sizes[unknown] = np.inf
    stated: dict[str, Value] = {}
    intervals: dict[str, tuple[float, float]] = {}
    labels: list[str] = []
    kept: list[int] = []
    first = 0
    for name in names:
        value = value_of(found, BY_NAME[name])
        count = len(value) if isinstance(value, tuple) else 1
        part = range(first, first + count)
        first += count
        if not np.any(sizes[part] > 0.0):
            continue
        rounded = [float(f"{one:.4g}") for one in sizes[part]]
        stated[name] = tuple(rounded) if isinstance(value, tuple) else rounded[0]
        for i, place in enumerate(part):
            label = f"{name}[{i}]" if isinstance(value, tuple) else name
            if unknown[place]:
                intervals[label] = (float(least[place]), float(most[place]))
            elif sizes[place] > 0.0:
                labels.append(label)
                kept.append(place)
    R = spread[np.ix_(kept, kept)] / np.outer(sizes[kept], sizes[kept])
    related = [i for i in range(len(kept)) if np.any(np.abs(np.delete(R[i], i)) > 5e-6)]
    return found.annotated(
        standard_deviations={**found.standard_deviations, **stated},
        intervals={**found.intervals, **intervals},
        correlation=Correlation.of_matrix([labels[i] for i in related], R[np.ix_(related, related)]),
    )


def _derivative(
    robot_of: Callable[[NDArray[np.float64]], Robot],
    values: NDArray[np.float64],
    place: int,
    step: float,
    names: Collection[str],
) -> NDArray[np.float64]:
    """Return the derivatives of the robot's numbers by one parameter; one-sided next to what no robot has."""
    ends = []
    for sign in (1.0, -1.0):
        moved = values.copy()
        moved[place] += sign * step
        try:
            ends.append((sign * step, _numbers(robot_of(moved), names)))
        except InputError:
            continue
    if not ends:
        return np.zeros(len(_numbers(robot_of(values), names)))
    if len(ends) == 1:
        ends.append((0.0, _numbers(robot_of(values), names)))
    (ahead, high), (behind, low) = ends
    slope = (high - low) / (ahead - behind)
    return np.where(np.abs(high - low) > _UNCHANGED * np.abs(high), slope, 0.0)


def _numbers(robot: Robot, names: Collection[str]) -> NDArray[np.float64]:
    """Return the numbers of these parameters, one after another."""
    return np.concatenate(
        [np.atleast_1d(np.asarray(value_of(robot, BY_NAME[name]), dtype=np.float64)) for name in names]
        or [np.empty(0)]
    )
