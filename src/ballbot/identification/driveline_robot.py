"""The robot that a sweep of its free wheels describes, and whether its file agrees.

Each wheel has its own v_s and delta; a robot file has one of each, the mean over the wheels that determine it. Its
standard deviation is that of a single wheel's value: it combines the errors of the mean with the scatter of the wheels.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ballbot.identification.agreement import StageEstimate
from ballbot.identification.driveline import LOWER, NAMES, UPPER, DrivelineFit
from ballbot.identification.quantities import OF_WHEELS
from ballbot.identification.stated_uncertainty import ends_without_error, with_uncertainty
from ballbot.robot import Friction, Robot

_LINES = tuple(f"friction.{name}" for name in OF_WHEELS)


def _friction(values: NDArray[np.float64], known: NDArray[np.bool_], *, rolling: float) -> Friction:
    """Return the friction of numbers (n, 5), of which those `known` (n, 5) count in a mean, all if none is."""

    def mean(place: int) -> float:
        some = known[:, place] if known[:, place].any() else np.ones(len(values), dtype=bool)
        return sum(values[some, place].tolist()) / int(some.sum())

    b, c, s = (tuple(values[:, place].tolist()) for place in range(3))
    return Friction(
        viscous=b,
        coulomb=c,
        stribeck=s,
        stribeck_speed=mean(3),
        stribeck_exponent=mean(4),
        rolling=rolling,
    )


def robot_of_sweep(robot: Robot, fits: Sequence[DrivelineFit], *, log: str) -> Robot:
    """Return the robot with the friction of its drivelines, its standard deviations and their correlations.

    Parameters
    ----------
    robot : Robot
    fits : sequence of DrivelineFit
        Of all wheels.
    log : str
        Name of the sweep's log, for the sources.
    """
    known = np.array([~fit.unknown for fit in fits])
    values = np.array([fit.values for fit in fits])
    rolling = robot.friction.rolling
    moved = robot.replace(friction=_friction(values, known, rolling=rolling))
    sources = dict.fromkeys(_LINES, f"identified: sweep of the free wheels, {log}")

    def robot_of(parameters: NDArray[np.float64]) -> Robot:
        # the last two parameters are the scatter of v_s and delta between wheels; it shifts their means only
        shifted = parameters[:-2].reshape(-1, len(NAMES)).copy()
        shifted[:, 3:] += parameters[-2:]
        return robot.replace(friction=_friction(shifted, known, rolling=rolling))

    return with_uncertainty(
        moved.annotated(sources={**moved.sources, **sources}),
        robot_of,
        np.concatenate([values.ravel(), np.zeros(2)]),
        _covariance(fits, values, known),
        names=_LINES,
        ends=_ends(fits),
    )


def _ends(fits: Sequence[DrivelineFit]) -> dict[int, tuple[float, float]]:
    """Return the interval, or the range, of each number without a standard deviation, by its place."""
    size, bounds = len(NAMES), np.array([LOWER, UPPER]).T
    ends = {}
    for wheel, fit in enumerate(fits):
        errors = np.array([_deviation(fit, place) for place in range(size)])
        of_wheel = ends_without_error(NAMES, fit.values, errors, bounds=bounds, intervals=fit.intervals)
        ends |= {size * wheel + place: both for place, both in of_wheel.items()}
    return ends


def _covariance(
    fits: Sequence[DrivelineFit], values: NDArray[np.float64], known: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Return the covariance (5 n + 2, 5 n + 2) of all wheels' numbers, and of the two shifts."""
    size = len(NAMES)
    full = np.zeros((size * len(fits) + 2, size * len(fits) + 2))
    for wheel, fit in enumerate(fits):
        errors = np.array([_deviation(fit, place) for place in range(size)])
        R = np.where(np.isfinite(fit.correlation), fit.correlation, np.eye(size))
        part = slice(size * wheel, size * (wheel + 1))
        full[part, part] = R * np.outer(np.nan_to_num(errors), np.nan_to_num(errors))
    for shift, place in ((-2, 3), (-1, 4)):
        several = values[known[:, place], place]
        if len(several) > 1:
            full[shift, shift] = float(np.var(several, ddof=1))
    return full


def _deviation(fit: DrivelineFit, place: int) -> float:
    """Return a number's standard error, or its interval's if larger; NaN if it has none or the interval is open."""
    interval = fit.intervals.get(NAMES[place])
    if fit.unknown[place] or interval is None:
        return np.nan
    deviation = interval.deviation
    return float(np.maximum(deviation, fit.standard_errors[place]))


def sweep_estimate(fits: Sequence[DrivelineFit]) -> StageEstimate:
    """Return b and c of all wheels with their covariance."""
    count = len(fits)
    labels = [f"{symbol}{fit.wheel}" for symbol in ("b", "c") for fit in fits]
    values = np.array([fit.values[place] for place in range(2) for fit in fits])
    covariance = np.full((2 * count, 2 * count), 0.0)
    for wheel, fit in enumerate(fits):
        places = [wheel, count + wheel]
        errors = fit.standard_errors[:2]
        covariance[np.ix_(places, places)] = np.nan_to_num(fit.correlation[:2, :2] * np.outer(errors, errors))
    return StageEstimate(source="the sweep", labels=tuple(labels), values=values, covariance=covariance)
