"""What an identification has to say in plain words: each remark is a sentence."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ballbot.identification.coordinates import Coordinates

#: beyond this correlation, the logs tell two parameters' sum or ratio and not each
LARGEST_CORRELATION = 0.9
#: pairs named in the remark
MOST_PAIRS = 6
#: a standard error of this share of the bounds' width leaves a parameter all but open
LARGEST_ERROR = 0.25


def bound_remarks(
    coordinates: Coordinates, values: NDArray[np.float64], at_bound: NDArray[np.bool_]
) -> list[str]:
    """Return a sentence for each parameter that stands at a bound; `values` (p,) in SI units."""
    remarks = []
    for i in np.flatnonzero(at_bound):
        lowest = values[i] <= coordinates.lower[i]
        side, bound = ("lower", coordinates.lower[i]) if lowest else ("upper", coordinates.upper[i])
        advice = "zero friction of this kind fits best" if bound == 0.0 else "widen it, or hold the parameter"
        remarks.append(
            f"{coordinates.labels[i]} stands at its {side} bound {bound:g} and has no standard error: {advice}."
        )
    return remarks


def influence_remarks(
    coordinates: Coordinates, values: NDArray[np.float64], no_influence: NDArray[np.bool_]
) -> list[str]:
    """Return a sentence for each parameter that the logs say nothing of; `values` (p,) in SI units."""
    return [
        f"{coordinates.labels[i]} has no influence on what these logs show and was not estimated; the robot carries "
        f"{values[i]:g}."
        for i in np.flatnonzero(no_influence)
    ]


def error_remarks(coordinates: Coordinates, scaled_errors: NDArray[np.float64]) -> list[str]:
    """Return a sentence for each parameter whose standard error (p,), scaled, leaves it all but open."""
    return [
        f"{coordinates.labels[i]} is hardly determined: its standard error is {100 * scaled_errors[i]:.0f} % of the "
        "width of its bounds."
        for i in np.flatnonzero(scaled_errors > LARGEST_ERROR)
    ]


def correlation_remarks(labels: tuple[str, ...], correlation: NDArray[np.float64]) -> list[str]:
    """Return a sentence that names the pairs of parameters that the logs cannot tell apart, if there are any."""
    rows, columns = np.nonzero(np.triu(np.abs(correlation), 1) > LARGEST_CORRELATION)
    strongest = np.argsort(-np.abs(correlation[rows, columns]), kind="stable")
    pairs = [
        f"{labels[rows[k]]} and {labels[columns[k]]} ({correlation[rows[k], columns[k]]:+.2f})"
        for k in strongest
    ]
    if not pairs:
        return []
    more = f", and {len(pairs) - MOST_PAIRS} pairs more" if len(pairs) > MOST_PAIRS else ""
    return [
        f"Hard to tell apart in these logs, by their correlation: {', '.join(pairs[:MOST_PAIRS])}{more}; trust the "
        "common effect of such a pair, not each number."
    ]


def prediction_remarks(ratios: Mapping[str, float]) -> list[str]:
    """Return a sentence for each state that friction does not help to predict; error ratios by state."""
    return [
        f"{state} is not predicted better with friction than without (error ratio {ratio:.2f} on windows held out)."
        for state, ratio in ratios.items()
        if not ratio < 1.0
    ]
