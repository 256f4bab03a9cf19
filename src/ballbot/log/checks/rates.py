"""Positions, angles and the gyro against the rates beside them: the unit of time, units of columns, signs, exchanges.

A column's change over half a second is compared with the integral of its rate over the same time, so that a lean
angle's noise (a few milliradians) and a gyro's drift are both small in comparison. The ratio is one of standard
deviations: it is 57.3 if the column is in degrees and its rate in radians.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import combinations

import numpy as np

from ballbot.findings import Finding, error, finding
from ballbot.log.columns import POSITION_NAMES, STATE_NAMES, Floats, numbered_names
from ballbot.log.log import Log

DEGREES = float(np.degrees(1.0))
COMPARED_TIME = 0.5  #: [s] over which an angle's change and its rate's integral are compared
#: rows to compare at intervals longer than this [s], since the unit of time may be wrong
SLOW_ROWS, SLOW = 100, 0.2
FEWEST_ROWS = 40  #: for a comparison
#: rows that take this many times as long as usual have a gap between them
LONGEST_SPAN = 3.0
#: columns that a robot's own sensors and motors give, at the rate of its control
_OF_A_RUN = {"u1", "theta", "gyro_x", "wheel1"}
CLEAR_CORRELATION = 0.8  #: below which a comparison is not conclusive
#: columns are swapped if each agrees with the other's rate by this much, and more than with its own by the margin
SWAPPED_CORRELATION, SWAPPED_MARGIN = 0.7, 0.3
#: ratios within the first factor of each other are equal, and one beyond the second is not noise
SAME, OFF = 1.25, 1.3
#: a scale is off beyond the first factor, and results are wrong beyond the second
NOISE, WRONG_SCALE = 1.5, 4.0
#: units that a column may be in, by their number in an SI unit
_LENGTHS = {100.0: "cm", 1000.0: "mm"}
_ANGLES = {DEGREES: "degrees", 1000.0: "mrad", 1.0 / (2.0 * np.pi): "turns"}
_RPM = {60.0 / (2.0 * np.pi): "rpm"}
_TIMES = {1e-3: "ms", 1e-6: "us", 1e-9: "ns", 1.0 / 60.0: "minutes"}
_GYRO = ("gyro_x", "gyro_y", "gyro_z")

#: the correlation of two signals that should be the same, and the ratio of their standard deviations with its sign
_Agreement = tuple[float, float]


def _agreement(first: Floats, second: Floats) -> _Agreement | None:
    """Compare two signals (N,) at the rows where both are finite; None if these are too few."""
    both = np.isfinite(first) & np.isfinite(second)
    a, b = first[both], second[both]
    if both.sum() < FEWEST_ROWS or not (a.std() > 0.0 and b.std() > 0.0):
        return None
    correlation = float(np.corrcoef(a, b)[0, 1])
    return correlation, float(np.copysign(a.std() / b.std(), correlation))


def check_rates(log: Log) -> list[Finding]:
    """Return contradictions of angles and positions to their rates: time, degrees, sign, scale, swapped."""
    wheels = numbered_names(log.names, prefix="wheel") if "wheel1" in log else ()
    names = [name for name in (*POSITION_NAMES, *wheels) if name in log and f"{name}_dot" in log]

    def compared(name: str, other: str) -> _Agreement | None:
        return _change_against_rate(log, name, f"{other}_dot")

    found = {name: one for name in names if (one := compared(name, name))} if len(log) > 1 else {}
    clear = {name: one for name, one in found.items() if abs(one[0]) >= CLEAR_CORRELATION}
    time = _time_fault(log, {name: ratio for name, (_, ratio) in clear.items()})
    if time:
        return [error("time-scale", time, "t")]
    findings = [one for name in clear for one in _verdict(name, f"{name}_dot", *clear[name])]
    return findings + _swapped(compared, found, (("x", "y"), ("theta", "phi")))


def check_gyro(log: Log) -> list[Finding]:
    """Return contradictions of the gyro to the body rates w = B(Phi) Phi_dot of the state columns."""
    from ballbot.mechanics.geometry import body_rates_matrix

    if not {*_GYRO, *STATE_NAMES[2:5], *STATE_NAMES[7:10]} <= set(log.names):
        return []
    rates = np.column_stack([log[name] for name in STATE_NAMES[7:10]])
    body = np.einsum("nij,nj->ni", body_rates_matrix(log["theta"], log["phi"], log["psi"]), rates)

    def compared(name: str, other: str) -> _Agreement | None:
        return _agreement(log[name], body[:, _GYRO.index(other)])

    found = {name: one for name in _GYRO if (one := compared(name, name))}
    clear = [name for name in found if abs(found[name][0]) >= CLEAR_CORRELATION]
    findings = [one for n in clear for one in _verdict(n, "theta_dot, phi_dot, psi_dot", *found[n])]
    return findings + _swapped(compared, found, list(combinations(_GYRO, 2)))


def _change_against_rate(log: Log, name: str, rate_name: str) -> _Agreement | None:
    rate = log[rate_name]
    finite = np.isfinite(log[name]) & np.isfinite(rate)
    t, angle, rate = log.t[finite], log[name][finite], rate[finite]
    if len(t) < FEWEST_ROWS:
        return None
    integral = np.concatenate(([0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(t))))
    slow = log.sample_time >= SLOW
    rows = int(np.clip(SLOW_ROWS if slow else round(COMPARED_TIME / log.sample_time), 1, len(t) // 4))
    spans = t[rows:] - t[:-rows]
    whole = spans < LONGEST_SPAN * np.median(spans)  # not over a gap, where the rate is unknown
    return _agreement((angle[rows:] - angle[:-rows])[whole], (integral[rows:] - integral[:-rows])[whole])


def _time_fault(log: Log, ratios: Mapping[str, float]) -> str:
    """Return the sentence on the unit or the direction of time, by all clear ratios; empty if it is right."""
    if len(ratios) >= 3 and max(ratios.values()) < 0.0:
        return (
            "All positions and angles change in the opposite direction to their rates: the rows are in reverse order "
            "of time. Sort them, or negate all rates."
        )
    of_states = {name: ratio for name, ratio in ratios.items() if not name.startswith("wheel")}
    of_both_kinds = len({name in ("x", "y") for name in of_states}) == 2
    factor = float(np.median(list(of_states.values()))) if of_both_kinds else 1.0
    same = all(factor / SAME < ratio < factor * SAME for ratio in of_states.values())
    if same and not 1.0 / OFF < factor < OFF:
        unit = _unit(factor, _TIMES)
        cause = f"t is in {unit}, not in seconds" if unit else "t is stretched (wrong sample time or unit)"
        return (
            f"Positions and angles all change {factor:.3g} times as much as the integrals of their rates over t: "
            f"{cause}. By the rates, rows come every {factor * log.sample_time:.3g} s, by t every "
            f"{log.sample_time:.4g}."
        )
    if (
        len(log) >= FEWEST_ROWS
        and log.sample_time >= SLOW
        and not ratios
        and not _OF_A_RUN.isdisjoint(log.names)
    ):
        return (
            f"Rows come every {log.sample_time:.4g} s and no value continues from row to row: t is in ms or "
            "another unit, not in seconds, or the log was thinned out. No robot balances at such a rate."
        )
    return ""


def _verdict(name: str, rates: str, correlation: float, ratio: float) -> list[Finding]:
    """Return the findings on a ratio other than one; a factor of `NOISE` may still be noise."""
    size = abs(ratio)
    seen = f"{name} varies {size:.3g} times as much as {rates} give"
    columns = (name, rates) if rates in STATE_NAMES or name.startswith("wheel") else (name,)
    findings = []
    if ratio < 0.0:
        text = f"{name} and {rates} have opposite signs (correlation {correlation:.2f}); negate one of them."
        findings.append(error("sign", text, *columns))
    of_length, is_rate = name in ("x", "y"), name.startswith("gyro")
    units = _LENGTHS if of_length else _ANGLES
    per_second = units if of_length else _ANGLES | _RPM
    for unit, column, timed in (
        (_unit(size, per_second if is_rate else units), name, is_rate),
        (_unit(1.0 / size, per_second), rates, True),
    ):
        if unit:
            each = " per second" if timed else ""
            given = unit if unit == "rpm" else f"{unit}{each}"
            text = f"{seen}: {column} is in {given}, not in {'m' if of_length else 'radians'}{each}."
            return [*findings, error("degrees" if unit == "degrees" else "scale", text, *columns)]
    if not 1.0 / NOISE < size < NOISE:
        text = f"{seen}: one of the two has a wrong scale, a delay or much noise."
        wrong = not 1.0 / WRONG_SCALE < size < WRONG_SCALE
        findings.append(finding("scale", "error" if wrong else "warning", text, *columns))
    return findings


def _swapped(
    compared: Callable[[str, str], _Agreement | None],
    found: Mapping[str, _Agreement],
    pairs: Sequence[tuple[str, str]],
) -> list[Finding]:
    """Return an error for each pair of columns that follow each other's rates."""
    findings = []
    for first, second in (pair for pair in pairs if {*pair} <= set(found)):
        crossed = (compared(first, second), found[first]), (compared(second, first), found[second])
        if all(
            one and abs(one[0]) >= max(SWAPPED_CORRELATION, abs(own[0]) + SWAPPED_MARGIN)
            for one, own in crossed
        ):
            text = f"{first} and {second} are swapped, or their rates are: each changes by the rate of the other."
            findings.append(error("swapped", text, first, second))
    return findings


def _unit(ratio: float, units: Mapping[float, str]) -> str | None:
    """Return the unit whose size is nearest to a ratio, if one is near."""
    near = [size for size in units if 0.75 < ratio / size < 1.33]
    return units[min(near, key=lambda size: abs(np.log(ratio / size)))] if near else None
