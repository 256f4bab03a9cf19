"""What an identification has to say in plain words: each remark is a sentence."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from ballbot.identification.coordinates import Coordinates
from ballbot.identification.intervals import Interval
from ballbot.identification.quantities import FRICTION

#: beyond this correlation, the logs tell two parameters' sum or ratio and not each
LARGEST_CORRELATION = 0.9
#: pairs named in the remark
MOST_PAIRS = 6
#: a standard error of this share of the bounds' width leaves a parameter all but open
LARGEST_ERROR = 0.25
#: a ridge: so many parameters at least, whose errors would be so many times smaller if all others were known
LEAST_RIDGE, LEAST_INFLATION = 3, 5.0

_WHOLE = ("v_s", "C_rr", "T_p", "j_b", "j_w", "j_r", "late_imu", "late_v")
#: symbols, and what would tell any two of them apart
_EXPERIMENTS: tuple[tuple[frozenset[str], str], ...] = (
    (
        frozenset({"c", "s", "v_s", "delta"}),
        "To separate dry friction at rest from that at speed, log slow motion through "
        "standstill: a free wheel swept from zero to several times v_s and back.",
    ),
    (
        frozenset({"b", "c", "s", "v_s", "delta"}),
        "To separate viscous from dry friction, log high and low speeds: runs back and "
        "forth at several steady speeds, or a free-wheel sweep up to the speed limit.",
    ),
    (
        frozenset({"b", "c", "s", "C_rr", "T_p"}),
        "To separate the friction of the floor from that of the wheels, log the "
        "robot upside down or with its wheels free, where the floor has no effect.",
    ),
    (
        frozenset({"gain", "l", "S", "j_w", "j_r", "j_b"}),
        "Torque gain, inertia and height of the centre of mass are nearly interchangeable: "
        "fix one at a data sheet's value, or fit a free-wheel sweep first.",
    ),
    (
        frozenset({"b", "c", "s", "gain", "l", "S", "j_w", "j_r", "j_b"}),
        "To separate friction from a motor's torque gain or an inertia, fix the gain at the data sheet's "
        "torque constant (--bounds), or fit a sweep of the free wheels together with the logs (--sweep).",
    ),
    (
        frozenset({"offset", "lean", "gyro"}),
        "To separate a torque offset from a tilted sensor, log the robot at two headings, half a turn apart.",
    ),
    (
        frozenset({"delay", "late_imu", "late_v"}),
        "To separate the delay of a command from that of a sensor, log quick "
        "changes of torque: pushes, steps of the reference, or a dither of some Hz.",
    ),
)


def bound_remarks(
    coordinates: Coordinates, values: NDArray[np.float64], at_bound: NDArray[np.bool_]
) -> list[str]:
    """Return a sentence for each parameter that stands at a bound; `values` (p,) in SI units."""
    remarks = []
    for i in np.flatnonzero(at_bound):
        lowest = values[i] <= coordinates.lower[i]
        side, bound = ("lower", coordinates.lower[i]) if lowest else ("upper", coordinates.upper[i])
        none = "zero friction of this kind" if coordinates.names[i] in FRICTION else "none of it"
        advice = f"{none} fits best" if bound == 0.0 else "widen it, or fix the parameter"
        remarks.append(
            f"{coordinates.labels[i]} is at its {side} bound {bound:g} and has no standard error: {advice}."
        )
    return remarks


def influence_remarks(
    coordinates: Coordinates, values: NDArray[np.float64], no_influence: NDArray[np.bool_]
) -> list[str]:
    """Return a sentence for each parameter that the logs say nothing of; `values` (p,) in SI units."""
    return [
        f"{coordinates.labels[i]} has no influence on these logs "
        f"and was not estimated; robot.toml keeps {values[i]:g}."
        for i in np.flatnonzero(no_influence)
    ]


def error_remarks(coordinates: Coordinates, scaled_errors: NDArray[np.float64]) -> list[str]:
    """Return a sentence for each parameter whose standard error (p,), scaled, leaves it all but open."""
    return [
        f"{coordinates.labels[i]} is poorly determined: its standard error "
        f"is {100 * scaled_errors[i]:.0f} % of the width of its bounds."
        for i in np.flatnonzero(scaled_errors > LARGEST_ERROR)
    ]


def interval_remarks(intervals: Mapping[str, Interval]) -> list[str]:
    """Return a sentence for each parameter that the logs limit on one side only, or not at all."""
    remarks = []
    for label, one in intervals.items():
        if np.isinf(one.lower) and np.isinf(one.upper):
            remarks.append(f"{label} is not limited by these logs on either side: its value means nothing.")
        elif one.lower == 0.0 and np.isinf(one.upper):
            remarks.append(f"{label} is not limited by these logs: any value fits, zero included.")
        elif np.isinf(one.upper):
            remarks.append(
                f"{label} is limited from below only: {one.lower:.3g} or more, with 95 % confidence."
            )
        elif np.isinf(one.lower):
            remarks.append(
                f"{label} is limited from above only: {one.upper:.3g} or less, with 95 % confidence."
            )
    return remarks


def correlation_remarks(labels: tuple[str, ...], correlation: NDArray[np.float64]) -> list[str]:
    """Return sentences that name the pairs of parameters that the logs cannot tell apart, and what would."""
    rows, columns = np.nonzero(np.triu(np.abs(correlation), 1) > LARGEST_CORRELATION)
    strongest = np.argsort(-np.abs(correlation[rows, columns]), kind="stable")
    named = [(labels[rows[k]], labels[columns[k]], correlation[rows[k], columns[k]]) for k in strongest]
    if not named:
        return []
    pairs = [f"{one} and {other} ({value:+.2f})" for one, other, value in named[:MOST_PAIRS]]
    more = f", and {len(named) - MOST_PAIRS} pairs more" if len(named) > MOST_PAIRS else ""
    advice = dict.fromkeys(text for one, other, _ in named if (text := _experiment(one, other)))
    return [
        f"Poorly separated by these logs, by their correlation: {', '.join(pairs)}{more}; "
        "trust the combined effect of such a pair, not each value.",
        *advice,
    ]


def ridge_remarks(labels: tuple[str, ...], correlation: NDArray[np.float64]) -> list[str]:
    """Return a sentence that names parameters each of which the others can stand in for, where more than a pair do.

    The inverse's diagonal tells what knowing all others would take off a parameter's variance.
    """
    places = np.flatnonzero(np.isfinite(correlation.diagonal()))
    if not len(places):
        return []
    variance = np.linalg.pinv(correlation[np.ix_(places, places)], hermitian=True).diagonal()
    inflation = np.sqrt(np.maximum(variance, 1.0))  # less is a rounding error: knowing the others cannot harm
    together = [labels[i] for i in places[inflation > LEAST_INFLATION]]
    if len(together) < LEAST_RIDGE:
        return []
    least = inflation[inflation > LEAST_INFLATION].min()
    advice = (_experiment(one, other) for one, other in combinations(together, 2))
    return [
        f"{', '.join(together[:-1])} and {together[-1]} are nearly collinear and can "
        f"replace one another: each would be known at least {least:.0f} times better "
        "if the others were known. Fix some of them at values measured otherwise.",
        *dict.fromkeys(text for text in advice if text),
    ]


def _experiment(one: str, other: str) -> str:
    """Return what would tell two parameters apart, by their labels; empty where nothing is known."""
    symbols = {_symbol(one), _symbol(other)}
    return next((text for pair, text in _EXPERIMENTS if symbols <= pair), "")


def _symbol(label: str) -> str:
    return label if label in _WHOLE else label.rstrip("0123456789").split("_")[0]


def prediction_remarks(ratios: Mapping[str, float]) -> list[str]:
    """Return a sentence for each state that friction does not help to predict; error ratios by state."""
    return [
        f"{state} is not predicted better with friction than "
        f"without (error ratio {ratio:.2f} on held-out windows)."
        for state, ratio in ratios.items()
        if not ratio < 1.0
    ]
