"""Positions, angles and the gyro against the rates beside them: the unit of time, units of columns, signs, exchanges.

A column's change over half a second is compared with the integral of its rate over the same time, so that a lean
angle's noise (a few milliradians) and a gyro's drift are both small in comparison. The ratio is one of standard
deviations: it is 57.3 if the column is in degrees and its rate in radians.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import combinations

import numpy as np

from ballbot.arrays import Floats
from ballbot.findings import Finding
from ballbot.log.checks.table import judged
from ballbot.log.columns import POSITION_NAMES, STATE_NAMES, numbered_names
from ballbot.log.evidence import RELATED
from ballbot.log.log import Log

COMPARED_TIME = 0.5  #: [s] over which an angle's change and its rate's integral are compared
#: rows to compare at intervals longer than this [s], since the unit of time may be wrong
SLOW_ROWS, SLOW = 100, 0.2
FEWEST_ROWS = 40  #: for a comparison
#: columns are swapped if each agrees with the other's rate by more than with its own by this much
SWAPPED_MARGIN = 0.3
#: units that a column may be in, by their number in an SI unit
_LENGTHS = {100.0: "cm", 1000.0: "mm"}
_ANGLES = {float(np.degrees(1.0)): "degrees", 1000.0: "mrad", 1.0 / (2.0 * np.pi): "turns"}
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
    wheels = numbered_names(log.names, prefix="wheel")
    names = [name for name in (*POSITION_NAMES, *wheels) if name in log and f"{name}_dot" in log]

    def compared(name: str, other: str) -> _Agreement | None:
        """Compare a column's changes over half a second with the integral of a rate."""
        finite = np.isfinite(log[name]) & np.isfinite(log[f"{other}_dot"])
        t, angle, rate = log.t[finite], log[name][finite], log[f"{other}_dot"][finite]
        if len(t) < FEWEST_ROWS:
            return None
        integral = np.concatenate(([0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(t))))
        slow = log.sample_time >= SLOW
        rows = int(np.clip(SLOW_ROWS if slow else round(COMPARED_TIME / log.sample_time), 1, len(t) // 4))
        spans = t[rows:] - t[:-rows]
        whole = spans < 3.0 * np.median(spans)  # not over a gap, where the rate is unknown
        return _agreement((angle[rows:] - angle[:-rows])[whole], (integral[rows:] - integral[:-rows])[whole])

    if len(log) < 2:
        return []
    pairs = ("x", "y"), ("theta", "phi")
    clear, findings = _contradictions(compared, names, lambda name: f"{name}_dot", pairs)
    return _time_findings(log, clear) or findings


def check_gyro(log: Log) -> list[Finding]:
    """Return contradictions of the gyro to the body rates w = B(Phi) Phi_dot of the state columns."""
    from ballbot.mechanics.geometry import body_rates_matrix

    if not {*_GYRO, *STATE_NAMES[2:5], *STATE_NAMES[7:10]} <= set(log.names):
        return []
    rates = np.column_stack([log[name] for name in STATE_NAMES[7:10]])
    body = np.einsum("nij,nj->ni", body_rates_matrix(log["theta"], log["phi"], log["psi"]), rates)

    def compared(name: str, other: str) -> _Agreement | None:
        return _agreement(log[name], body[:, _GYRO.index(other)])

    pairs = combinations(_GYRO, 2)
    return _contradictions(compared, _GYRO, lambda _: "theta_dot, phi_dot, psi_dot", pairs)[1]


def _contradictions(
    compared: Callable[[str, str], _Agreement | None],
    names: Iterable[str],
    rates: Callable[[str], str],
    pairs: Iterable[tuple[str, str]],
) -> tuple[dict[str, float], list[Finding]]:
    """Return the clear ratios of columns to their own rates, and findings on these and on pairs that are exchanged."""
    agreements = {name: agreement for name in names if (agreement := compared(name, name))}
    clear = {name: own for name, own in agreements.items() if abs(own[0]) >= RELATED}
    findings = [item for name in clear for item in _verdict(name, rates(name), *clear[name])]

    def follows(name: str, other: str) -> bool:
        crossed, own = compared(name, other), abs(agreements[name][0])
        return crossed is not None and abs(crossed[0]) >= max(RELATED, own + SWAPPED_MARGIN)

    for first, second in (pair for pair in pairs if {*pair} <= set(agreements)):
        if follows(first, second) and follows(second, first):
            findings += judged("swapped", [first, second], first=first, second=second)
    return {name: ratio for name, (_, ratio) in clear.items()}, findings


def _time_findings(log: Log, ratios: Mapping[str, float]) -> list[Finding]:
    """Return the error of the unit or the direction of time, by all clear ratios."""
    if len(ratios) >= 3 and max(ratios.values()) < 0.0:
        return judged("time-scale: reverse", ["t"])
    of_states = {name: ratio for name, ratio in ratios.items() if not name.startswith("wheel")}
    factor, by_t = float(np.median(list(of_states.values()) or [1.0])), log.sample_time
    both_kinds = len({name in ("x", "y") for name in of_states}) == 2
    if both_kinds and all(factor / 1.25 < ratio < factor * 1.25 for ratio in of_states.values()):
        unit = _unit(factor, _TIMES)
        cause = f"t is in {unit}, not in seconds" if unit else "t is stretched (wrong sample time or unit)"
        numbers = {"factor": factor, "by_rates": factor * by_t, "by_t": by_t, "cause": cause}
        return judged("time-scale", ["t"], max(factor, 1.0 / factor), **numbers)
    # columns that a robot's own sensors and motors give come at the rate of its control
    of_a_run = not {"u1", "theta", "gyro_x", "wheel1"}.isdisjoint(log.names)
    slow = len(log) >= FEWEST_ROWS and by_t >= SLOW and not ratios and of_a_run
    return judged("time-scale: slow", ["t"], float(slow), by_t=by_t)


def _verdict(name: str, rates: str, correlation: float, ratio: float) -> Iterator[Finding]:
    """Return the findings on a ratio other than one."""
    size, of_length, is_gyro = abs(ratio), name in ("x", "y"), name.startswith("gyro")
    columns = [name] if is_gyro else [name, rates]
    numbers = {"name": name, "rates": rates, "size": size, "correlation": correlation}
    yield from judged("sign", columns, -ratio, **numbers)
    for column, factor, timed in ((name, size, is_gyro), (rates, 1.0 / size, True)):
        unit = _unit(factor, _LENGTHS if of_length else _ANGLES | (_RPM if timed else {}))
        if unit:
            each, key = " per second" if timed else "", "degrees" if unit == "degrees" else "scale: unit"
            numbers |= {"column": column, "unit": unit + each * (unit != "rpm")}
            yield from judged(key, columns, right=("m" if of_length else "radians") + each, **numbers)
            return
    yield from judged("scale", columns, max(size, 1.0 / size), **numbers)


def _unit(ratio: float, units: Mapping[float, str]) -> str | None:
    """Return the unit whose size is nearest to a ratio, if one is near."""
    near = [size for size in units if 0.75 < ratio / size < 1.33]
    return units[min(near, key=lambda size: abs(np.log(ratio / size)))] if near else None
