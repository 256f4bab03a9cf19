"""Findings on an identification: what its logs leave open about the parameters, and what would determine them.

One sentence names all parameters of which the same is to be said: the wheels of a robot are alike.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import every
from ballbot.findings import Finding, warning
from ballbot.fitting.fit import OtherOptimum
from ballbot.fitting.intervals import Interval
from ballbot.identification.quantities import FRICTION, QUANTITIES, Coordinates
from ballbot.mechanics.parameters import MAX_WHEELS

#: beyond this correlation, the logs determine two parameters' sum or ratio and not each
LARGEST_CORRELATION = 0.9
#: pairs named in the finding
MOST_PAIRS = 6
#: a standard error of this share of the bounds' width leaves a parameter all but open
LARGEST_ERROR = 0.25
#: a ridge: so many parameters at least, whose errors would be so many times smaller if all others were known
LEAST_RIDGE, LEAST_INFLATION = 3, 5.0

#: the symbol of each label, as "c" of "c1"
_SYMBOLS = {label: one.symbol for one in QUANTITIES for label in one.labels(MAX_WHEELS)}
#: symbols, and the experiment that separates any two of them
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


def bound_findings(
    coordinates: Coordinates, values: NDArray[np.float64], at_bound: NDArray[np.bool_]
) -> list[Finding]:
    """Return a finding for each bound that parameters are at; `values` (p,) in SI units."""
    at: dict[tuple[str, str], list[str]] = {}  # parameters by their bound and the advice
    nearer = coordinates.scaled(values) < 0.5  # a search ends beside its bound, not on it
    for i in np.flatnonzero(at_bound):
        side, bound = ("lower", coordinates.lower[i]) if nearer[i] else ("upper", coordinates.upper[i])
        zero = "zero friction of this kind" if coordinates.names[i] in FRICTION else "zero"
        advice = f"{zero} fits best" if bound == 0.0 else "widen the bound, or fix the parameter"
        at.setdefault((f"{side} bound {bound:g}", advice), []).append(coordinates.labels[i])
    found = []
    for (bound, advice), labels in at.items():
        are, have = ("is at its", "has") if len(labels) == 1 else ("are at their", "have")
        text = f"{every(labels)} {are} {bound} and {have} no standard error: {advice}."
        found.append(warning("at-bound", text))
    return found


def influence_findings(
    coordinates: Coordinates, values: NDArray[np.float64], no_influence: NDArray[np.bool_]
) -> list[Finding]:
    """Return a finding on the parameters without influence on the logs, if any; `values` (p,) in SI units."""
    places = np.flatnonzero(no_influence)
    if not len(places):
        return []
    has, was = ("has", "was") if len(places) == 1 else ("have", "were")
    text = (
        f"{every([coordinates.labels[i] for i in places])} {has} no influence on these logs and {was} not estimated; "
        f"robot.toml keeps {every([f'{values[i]:g}' for i in places])}."
    )
    return [warning("no-influence", text)]


def error_findings(coordinates: Coordinates, scaled_errors: NDArray[np.float64]) -> list[Finding]:
    """Return a finding on the parameters that their standard errors (p,), scaled, leave all but open, if any."""
    places = np.flatnonzero(scaled_errors > LARGEST_ERROR)
    if not len(places):
        return []
    is_, its, errors = ("is", "its", "error is") if len(places) == 1 else ("are", "their", "errors are")
    text = (
        f"{every([coordinates.labels[i] for i in places])} {is_} poorly determined: {its} standard {errors} "
        f"{every([f'{100 * scaled_errors[i]:.0f}' for i in places])} % of the width of {its} bounds."
    )
    return [warning("poorly-determined", text)]


def interval_findings(intervals: Mapping[str, Interval]) -> list[Finding]:
    """Return findings on the parameters that the logs limit on one side only, or not at all."""
    groups: dict[str, dict[str, float]] = {"either": {}, "zero": {}, "below": {}, "above": {}}
    for label, one in intervals.items():
        low, high = math.isfinite(one.lower), math.isfinite(one.upper)
        if not (low and high):
            side = (
                "either" if not (low or high) else "zero" if one.lower == 0.0 else "below" if low else "above"
            )
            groups[side][label] = one.lower if low else one.upper
    found = []
    for side, ends in groups.items():
        if not ends:
            continue
        limited = f"{every(ends)} {'is' if len(ends) == 1 else 'are'}"
        values = (
            f"{every([f'{end:.3g}' for end in ends.values()])} or {'more' if side == 'below' else 'less'}"
        )
        text = {
            "either": f"{limited} not limited by these logs on either side: its value means nothing.",
            "zero": f"{limited} not limited by these logs: any value fits, zero included.",
        }.get(side, f"{limited} limited from {side} only: {values}, with 95 % confidence.")
        found.append(warning("unlimited", text))
    return found


def correlation_findings(labels: tuple[str, ...], correlation: NDArray[np.float64]) -> list[Finding]:
    """Return findings that name the parameters that the logs cannot separate, and experiments that would.

    They are pairs, and a ridge of more than two each of which the others can stand in for: the diagonal of the inverse
    is the factor by which knowing all others would reduce a parameter's variance.
    """
    rows, columns = np.nonzero(np.triu(np.abs(correlation), 1) > LARGEST_CORRELATION)
    strongest = np.argsort(-np.abs(correlation[rows, columns]), kind="stable")
    named = [(labels[rows[k]], labels[columns[k]], correlation[rows[k], columns[k]]) for k in strongest]
    found = []
    if named:
        pairs = [f"{one} and {other} ({value:+.2f})" for one, other, value in named[:MOST_PAIRS]]
        more = f", and {len(named) - MOST_PAIRS} pairs more" if len(named) > MOST_PAIRS else ""
        found += [
            f"Poorly separated by these logs, by their correlation: {', '.join(pairs)}{more}; "
            "trust the combined effect of such a pair, not each value.",
            *(_experiment(one, other) for one, other, _ in named),
        ]
    places = np.flatnonzero(np.isfinite(correlation.diagonal()))
    variance = np.linalg.pinv(correlation[np.ix_(places, places)], hermitian=True).diagonal()
    inflation = np.sqrt(np.maximum(variance, 1.0))  # less is a rounding error: knowing the others cannot harm
    together = [labels[i] for i in places[inflation > LEAST_INFLATION]]
    if len(together) >= LEAST_RIDGE:
        least = inflation[inflation > LEAST_INFLATION].min()
        found += [
            f"{every(together)} are nearly collinear and can "
            f"replace one another: each would be known at least {least:.0f} times better "
            "if the others were known. Fix some of them at values measured otherwise.",
            *(_experiment(one, other) for one, other in combinations(together, 2)),
        ]
    return [warning("correlated", text) for text in dict.fromkeys(found) if text]


def optimum_findings(
    coordinates: Coordinates, point: NDArray[np.float64], other: OtherOptimum | None
) -> list[Finding]:
    """Return a finding on another optimum than that at scaled parameters (p,), and on where they differ most."""
    if other is None:
        return []
    place = int(np.abs(coordinates.scaled(other.values) - point).argmax())
    unit = coordinates.parameters[place].unit
    found, elsewhere = (
        f"{one:.3g} {unit}".removesuffix(" 1")
        for one in (coordinates.physical(point)[place], other.values[place])
    )
    text = (
        f"The fit has two optima, which differ most in {coordinates.labels[place]}: {found} in the one that is "
        f"taken, {elsewhere} in the other, where errors are {100.0 * np.expm1(other.rise):.2g} % larger."
    )
    return [warning("two-optima", text)]


def _experiment(one: str, other: str) -> str:
    """Return the experiment that separates two parameters, by their labels; empty if none is known."""
    symbols = {_SYMBOLS.get(one, one), _SYMBOLS.get(other, other)}
    return next((text for pair, text in _EXPERIMENTS if symbols <= pair), "")


def prediction_findings(ratios: Mapping[str, float], *, of: str = "held-out windows") -> list[Finding]:
    """Return a finding on the states that friction does not help to predict, from errors with over errors without."""
    worse = {state: f"{ratio:.2f}" for state, ratio in ratios.items() if not ratio < 1.0}
    if not worse:
        return []
    text = (
        f"{every(worse)} {'is' if len(worse) == 1 else 'are'} not predicted better with friction than without "
        f"({every(worse.values())} times the error on {of})."
    )
    return [warning("not-predicted", text)]
