"""Findings on an identification: parameters that its logs do not determine, and experiments that would.

Parameters with the same finding share one sentence, as those of a robot's wheels often do.
"""

import math
from collections.abc import Mapping
from itertools import combinations

import numpy as np

from ballbot.arrays import Bools, Floats
from ballbot.errors import every
from ballbot.findings import Finding, warning
from ballbot.fitting.fit import OtherOptimum
from ballbot.fitting.intervals import Interval, Uncertainty
from ballbot.identification.quantities import FRICTION, QUANTITIES, Coordinates
from ballbot.mechanics.parameters import MAX_WHEELS

#: beyond this correlation, the logs determine the sum or ratio of two parameters but not each
LARGEST_CORRELATION = 0.9
#: pairs named in a finding
MOST_PAIRS = 6
#: a parameter is poorly determined if its standard error exceeds this share of the bounds' width
LARGEST_ERROR = 0.25
#: collinear: so many parameters at least, whose errors would be so many times smaller if all others were known
LEAST_RIDGE, LEAST_INFLATION = 3, 5.0

#: the symbol of each label, as "c" of "c1"
_SYMBOLS = {label: quantity.symbol for quantity in QUANTITIES for label in quantity.labels(MAX_WHEELS)}
#: symbols, and the experiment that separates any two of them
_EXPERIMENTS = {
    "c s v_s delta": "To separate dry friction at rest from that at speed, log slow motion through "
    "standstill: a free wheel swept from zero to several times v_s and back.",
    "b c s v_s delta": "To separate viscous from dry friction, log high and low speeds: runs back and "
    "forth at several steady speeds, or a free-wheel sweep up to the speed limit.",
    "b c s C_rr T_p": "To separate the friction of the floor from that of the wheels, log the "
    "robot upside down or with its wheels free, where the floor has no effect.",
    "gain l S j_w j_r j_b": "Torque gain, inertia and height of the centre of mass are nearly interchangeable: "
    "fix one at a data sheet's value.",
    "b c s gain l S j_w j_r j_b": "To separate friction from a motor's torque gain or an inertia, fix the gain at the "
    "data sheet's torque constant (--bounds).",
    "offset lean gyro": "To separate a torque offset from a tilted sensor, log the robot at two headings, half a turn "
    "apart.",
    "delay late_imu late_v": "To separate the delay of a command from that of a sensor, log quick "
    "changes of torque: pushes, steps of the reference, or a dither of some Hz.",
}


def _of(code: str, numbers: Mapping[str, str], singular: str, plural: str) -> list[Finding]:
    """Return the finding on parameters with their numbers, in the singular or the plural; none without parameters."""
    if not numbers:
        return []
    text = (singular if len(numbers) == 1 else plural).format(every(numbers), every(numbers.values()))
    return [warning(code, text)]


def parameter_findings(
    coordinates: Coordinates,
    uncertainty: Uncertainty,
    *,
    no_influence: Bools,
    at_bound: Bools,
    other: OtherOptimum | None,
) -> list[Finding]:
    """Return findings on the parameters (p,) that the logs do not determine."""
    labels, values = coordinates.labels, coordinates.physical(uncertainty.point)
    errors = uncertainty.scaled_errors
    ends: dict[tuple[str, str], dict[str, str]] = {}  # parameters by bound and advice
    for i in np.flatnonzero(at_bound).tolist():
        # a search ends beside its bound, not on it
        lowest = coordinates.scaled(values)[i] < 0.5
        side, bound = ("lower", coordinates.lower[i]) if lowest else ("upper", coordinates.upper[i])
        zero = "zero friction of this kind" if coordinates.names[i] in FRICTION else "zero"
        advice = f"{zero} fits best" if bound == 0.0 else "widen the bound, or fix the parameter"
        ends.setdefault((f"{side} bound {bound:g}", advice), {})[labels[i]] = ""
    return [
        *_of(
            "no-influence",
            {labels[i]: f"{values[i]:g}" for i in np.flatnonzero(no_influence)},
            "{} has no influence on these logs and was not estimated; robot.toml keeps {}.",
            "{} have no influence on these logs and were not estimated; robot.toml keeps {}.",
        ),
        *(
            finding
            for (bound, advice), at in ends.items()
            for finding in _of(
                "at-bound",
                at,
                f"{{}} is at its {bound} and has no standard error: {advice}.",
                f"{{}} are at their {bound} and have no standard error: {advice}.",
            )
        ),
        *_of(
            "poorly-determined",
            {labels[i]: f"{100 * errors[i]:.0f}" for i in np.flatnonzero(errors > LARGEST_ERROR)},
            "{} is poorly determined: its standard error is {} % of the width of its bounds.",
            "{} are poorly determined: their standard errors are {} % of the width of their bounds.",
        ),
        *interval_findings(uncertainty.intervals),
        *correlation_findings(labels, uncertainty.correlation),
        *optimum_findings(coordinates, uncertainty.point, other),
    ]


#: sentences on parameters without a limit on either side, or on one
_UNLIMITED = {
    "either": "not limited by these logs on either side: its value means nothing.",
    "zero": "not limited by these logs: any value fits, zero included.",
    "below": "limited from below only: {1} or more, with 95 % confidence.",
    "above": "limited from above only: {1} or less, with 95 % confidence.",
}


def interval_findings(intervals: Mapping[str, Interval]) -> list[Finding]:
    """Return findings on parameters that the logs limit on one side only, or not at all."""
    groups: dict[str, dict[str, str]] = {side: {} for side in _UNLIMITED}
    for label, known in intervals.items():
        low, high = math.isfinite(known.lower), math.isfinite(known.upper)
        if not (low and high):
            limited = "zero" if known.lower == 0.0 else "below" if low else "above"
            side = limited if low or high else "either"
            groups[side][label] = f"{known.lower if low else known.upper:.3g}"
    return [
        finding
        for side, ends in groups.items()
        for finding in _of("unlimited", ends, f"{{0}} is {_UNLIMITED[side]}", f"{{0}} are {_UNLIMITED[side]}")
    ]


def correlation_findings(labels: tuple[str, ...], correlation: Floats) -> list[Finding]:
    """Return findings on parameters that the logs cannot separate, and experiments that would.

    They are pairs, and sets of three or more that are collinear: the diagonal of the inverse correlation matrix is the
    factor by which a parameter's variance would shrink if all others were known.
    """
    rows, columns = np.nonzero(np.triu(np.abs(correlation), 1) > LARGEST_CORRELATION)
    strongest = np.argsort(-np.abs(correlation[rows, columns]), kind="stable")
    named = [(labels[rows[k]], labels[columns[k]], correlation[rows[k], columns[k]]) for k in strongest]
    sentences = []
    if named:
        pairs = [f"{first} and {second} ({value:+.2f})" for first, second, value in named[:MOST_PAIRS]]
        more = f", and {len(named) - MOST_PAIRS} pairs more" if len(named) > MOST_PAIRS else ""
        sentences += [
            f"Poorly separated by these logs, by their correlation: {', '.join(pairs)}{more}; "
            "trust the combined effect of such a pair, not each value.",
            *(_experiment(first, second) for first, second, _ in named),
        ]
    known = np.flatnonzero(np.isfinite(correlation.diagonal()))
    variance = np.linalg.pinv(correlation[np.ix_(known, known)], hermitian=True).diagonal()
    inflation = np.sqrt(np.maximum(variance, 1.0))  # less than 1 is a rounding error
    together = [labels[i] for i in known[inflation > LEAST_INFLATION]]
    if len(together) >= LEAST_RIDGE:
        least = inflation[inflation > LEAST_INFLATION].min()
        sentences += [
            f"{every(together)} are nearly collinear and can replace one another: each would be known at least "
            f"{least:.0f} times better if the others were known. Fix some of them at values measured otherwise.",
            *(_experiment(first, second) for first, second in combinations(together, 2)),
        ]
    return [warning("correlated", text) for text in dict.fromkeys(sentences) if text]


def _experiment(first: str, second: str) -> str:
    """Return the experiment that separates two parameters, by their labels; empty if none is known."""
    symbols = {_SYMBOLS.get(first, first), _SYMBOLS.get(second, second)}
    return next((text for those, text in _EXPERIMENTS.items() if symbols <= set(those.split())), "")


def optimum_findings(coordinates: Coordinates, point: Floats, other: OtherOptimum | None) -> list[Finding]:
    """Return the finding on another optimum than that at scaled parameters (p,)."""
    if other is None:
        return []
    index = int(np.abs(coordinates.scaled(other.values) - point).argmax())
    unit = coordinates.parameters[index].unit
    used, elsewhere = (
        f"{value:.3g} {unit}".removesuffix(" 1")
        for value in (coordinates.physical(point)[index], other.values[index])
    )
    text = (
        f"The fit has two optima, which differ most in {coordinates.labels[index]}: {used} in the one that is "
        f"used, {elsewhere} in the other, where errors are {100.0 * np.expm1(other.rise):.2g} % larger."
    )
    return [warning("two-optima", text)]


def prediction_findings(ratios: Mapping[str, float], *, of: str = "held-out windows") -> list[Finding]:
    """Return the finding on states that friction does not help to predict, from errors with over those without."""
    than = f"not predicted better with friction than without ({{1}} times the error on {of})."
    worse = {state: f"{ratio:.2f}" for state, ratio in ratios.items() if not ratio < 1.0}
    return _of("not-predicted", worse, f"{{0}} is {than}", f"{{0}} are {than}")
