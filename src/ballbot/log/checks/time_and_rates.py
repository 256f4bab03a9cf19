"""Checks of a log's time, of cells without a value, and of positions and angles against their rates.

(A `Log` refuses time that does not increase.) The rates show the unit of time, units of columns, signs and swapped
columns. A column's change over half a second is compared with the integral of its rate over the same time, so that a
lean angle's noise (a few milliradians) and a gyro's drift are both small in comparison. The ratio is one of standard
deviations: it is 57.3 if the column is in degrees and its rate in radians.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.findings import Finding, Place
from ballbot.log.columns import POSITION_NAMES, STATE_NAMES, numbered_names
from ballbot.log.log import Log

#: an interval this many times the usual longest one is a gap; one missing row of a regular log gives 2
GAP_RATIO = 1.5
#: standard deviation of the intervals, relative to their median, that gives a warning
JITTER_RATIO = 0.05


def check_rows(log: Log) -> list[Finding]:
    """Return an error for a log of one row."""
    if len(log) > 1:
        return []
    sentence = "The log has one row, which shows no motion; every use needs many rows."
    return [Finding(severity="error", code="rows", text=sentence)]


def check_gaps(log: Log) -> list[Finding]:
    """Return a warning if rows are missing, by intervals longer than the clock's scatter."""
    intervals = np.diff(log.t)
    if intervals.size < 3:
        return []
    # the 95th percentile, not the median: logs whose host polls late alternate between two intervals
    usual = float(np.quantile(intervals, 0.95, method="lower"))
    gaps = np.flatnonzero(intervals > GAP_RATIO * usual)
    if not gaps.size:
        return []
    first, longest = int(gaps[0]), float(intervals[gaps].max())
    number = "One gap" if gaps.size == 1 else f"{gaps.size} gaps"
    sentence = (
        f"{number} in time, the first of {intervals[first]:.4g} s after row "
        f"{first + 1} (t = {log.t[first]:.6g} s), the longest {longest:.4g} s, "
        f"while rows come every {log.sample_time:.4g} s; windows must not span them."
    )
    return [
        Finding(
            severity="warning",
            code="gap",
            text=sentence,
            where=Place(columns=("t",), time=float(log.t[first])),
        )
    ]


def check_jitter(log: Log) -> list[Finding]:
    """Return a warning if the intervals, without gaps, vary."""
    intervals = np.diff(log.t)
    if intervals.size < 3:
        return []
    typical = intervals[intervals <= GAP_RATIO * np.quantile(intervals, 0.95, method="lower")]
    scatter = float(typical.std() / np.median(typical))
    if scatter <= JITTER_RATIO:
        return []
    sentence = (
        f"The intervals between rows vary by {100 * scatter:.0f} % about {log.sample_time:.4g} s "
        f"(from {typical.min():.4g} to {typical.max():.4g} s); rates from differences will be noisy."
    )
    return [Finding(severity="warning", code="jitter", text=sentence, where=Place(columns=("t",)))]


def check_missing_values(log: Log) -> list[Finding]:
    """Return a warning for each set of columns in which the same cells are NaN or infinite."""
    columns: dict[bytes, list[str]] = {}
    for name in log.names:
        columns.setdefault(np.isfinite(log[name]).tobytes(), []).append(name)
    findings = []
    for known, names in columns.items():
        bad = np.flatnonzero(~np.frombuffer(known, dtype=np.bool_))
        if not bad.size:
            continue
        time = float(log.t[bad[0]])
        sentence = (
            f"{', '.join(names)}: {bad.size} of {len(log)} values missing or not finite, the first at row {bad[0] + 1} "
            f"(t = {time:.6g} s); uses that need the column leave these rows out."
        )
        findings.append(
            Finding(
                severity="warning",
                code="missing",
                text=sentence,
                where=Place(columns=tuple(names), time=time),
            )
        )
    return findings


DEGREES = float(np.degrees(1.0))
COMPARED_TIME = 0.5  #: [s] over which an angle's change and its rate's integral are compared
#: rows to compare at intervals longer than this [s], since the unit of time may be wrong
SLOW_ROWS, SLOW = 100, 0.2
FEWEST_ROWS = 40  #: for a comparison
#: columns that a robot's own sensors and motors give, at the rate of its control
_OF_A_RUN = {"u1", "theta", "gyro_x", "wheel1"}
CLEAR_CORRELATION = 0.8  #: below which a comparison is not conclusive
#: columns are swapped if each agrees with the other's rate by this much, and more than with its own by the margin
SWAPPED_CORRELATION, SWAPPED_MARGIN = 0.7, 0.3
#: ratios within the first factor of each other are equal, and one beyond the second is not noise
SAME, OFF = 1.25, 1.3
#: a scale wrong by this factor makes results wrong
WRONG_SCALE = 4.0
#: units that a column may be in, by their number in an SI unit
_LENGTHS = {100.0: "cm", 1000.0: "mm"}
_ANGLES = {DEGREES: "degrees", 1000.0: "mrad", 1.0 / (2.0 * np.pi): "turns"}
_ANGULAR_RATES = _ANGLES | {60.0 / (2.0 * np.pi): "rpm"}
_TIMES = {1e-3: "ms", 1e-6: "us", 1e-9: "ns", 1.0 / 60.0: "minutes"}
_GYRO = ("gyro_x", "gyro_y", "gyro_z")


#: rows that take this many times as long as usual have a gap between them
LONGEST_SPAN = 3.0


@dataclass(frozen=True, kw_only=True)
class Agreement:
    """How two signals that should be the same agree."""

    correlation: float
    ratio: float  #: of the standard deviations, first over second, with the correlation's sign

    @property
    def clear(self) -> bool:
        """Whether the two are one signal, scaled."""
        return abs(self.correlation) >= CLEAR_CORRELATION


def agreement(first: NDArray[np.float64], second: NDArray[np.float64]) -> Agreement | None:
    """Compare two signals (N,) at the rows where both are finite; None if these are too few."""
    both = np.isfinite(first) & np.isfinite(second)
    if both.sum() < FEWEST_ROWS:
        return None
    a, b = first[both], second[both]
    if not (a.std() > 0.0 and b.std() > 0.0):
        return None
    correlation = float(np.corrcoef(a, b)[0, 1])
    return Agreement(correlation=correlation, ratio=float(np.copysign(a.std() / b.std(), correlation)))


def check_rates(log: Log) -> list[Finding]:
    """Return contradictions of angles and positions to their rates: time, degrees, sign, scale, swapped."""
    if len(log) < FEWEST_ROWS:
        return []
    names = [name for name in _with_rates(log) if f"{name}_dot" in log]
    found = {name: one for name in names if (one := _change_against_rate(log, name, f"{name}_dot"))}
    if _runs_backwards(found):
        sentence = (
            "All positions and angles change in the opposite direction to their rates: "
            "the rows are in reverse order of time. Sort them, or negate all rates."
        )
        return [_error("time-scale", sentence, "t")]
    factor = _time_factor(found)
    if factor is not None:
        return [_time_finding(log, factor)]
    balances = not _OF_A_RUN.isdisjoint(log.names)
    if log.sample_time >= SLOW and balances and not any(one.clear for one in found.values()):
        return [_slow_finding(log)]
    findings = []
    for name, one in found.items():
        if one.clear:
            findings += _verdict(name, f"{name}_dot", one, verb="changes", reference="integrates to")
    return findings + _swapped(log, found)


def check_gyro(log: Log) -> list[Finding]:
    """Return contradictions of the gyro to the body rates w = B(Phi) Phi_dot of the state columns."""
    from ballbot.mechanics.geometry import body_rates_matrix

    if not {*_GYRO, *STATE_NAMES[2:5], *STATE_NAMES[7:10]} <= set(log.names):
        return []
    rates = np.column_stack([log[name] for name in STATE_NAMES[7:10]])
    body = np.einsum("nij,nj->ni", body_rates_matrix(log["theta"], log["phi"], log["psi"]), rates)
    findings, own = [], {}
    for i, name in enumerate(_GYRO):
        found = agreement(log[name], body[:, i])
        if found is not None and found.clear:
            findings += _verdict(
                name, "the turning of theta, phi, psi", found, verb="varies", reference="gives"
            )
        own[i] = abs(found.correlation) if found else 1.0
    for i, k in ((0, 1), (0, 2), (1, 2)):
        crossed = [agreement(log[_GYRO[i]], body[:, k]), agreement(log[_GYRO[k]], body[:, i])]
        if _is_swapped(crossed, (own[i], own[k])):
            sentence = f"{_GYRO[i]} and {_GYRO[k]} are swapped: each follows the states of the other."
            findings.append(_error("swapped", sentence, _GYRO[i], _GYRO[k]))
    return findings


def _with_rates(log: Log) -> list[str]:
    wheels = numbered_names(log.names, prefix="wheel") if "wheel1" in log else ()
    return [name for name in (*POSITION_NAMES, *wheels) if name in log]


def _change_against_rate(log: Log, name: str, rate_name: str) -> Agreement | None:
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
    return agreement((angle[rows:] - angle[:-rows])[whole], (integral[rows:] - integral[:-rows])[whole])


def _runs_backwards(found: Mapping[str, Agreement]) -> bool:
    clear = [one.ratio for one in found.values() if one.clear]
    return len(clear) >= 3 and max(clear) < 0.0


def _time_factor(found: Mapping[str, Agreement]) -> float | None:
    """Return the common ratio of all changes to the integrals of their rates; None if they differ or it is one."""
    ratios = {name: one.ratio for name, one in found.items() if one.clear and not name.startswith("wheel")}
    lengths = [name for name in ratios if name in ("x", "y")]
    if not lengths or len(lengths) == len(ratios) or min(ratios.values()) <= 0.0:
        return None
    middle = float(np.median(list(ratios.values())))
    if not all(middle / SAME < ratio < middle * SAME for ratio in ratios.values()):
        return None
    return None if 1.0 / OFF < middle < OFF else middle


def _time_finding(log: Log, factor: float) -> Finding:
    unit = _unit(factor, _TIMES)
    seen = (
        f"Positions and angles all change {factor:.3g} times as much as the integrals of their rates over t"
    )
    if unit:
        sentence = f"{seen}: t is in {unit}, not in seconds (rows come every {log.sample_time:.4g})."
    else:
        sentence = (
            f"{seen}: t runs {1.0 / factor:.3g} times as fast as it should (wrong "
            "sample time or unit), or all rates were computed with another sample "
            f"time. By the rates, rows come every {factor * log.sample_time:.3g} s."
        )
    return _error("time-scale", sentence, "t")


def _slow_finding(log: Log) -> Finding:
    sentence = (
        f"Rows come every {log.sample_time:.4g} s and no value continues from row to row: t is in ms or "
        "another unit, not in seconds, or the log was thinned out. No robot balances at such a rate."
    )
    return _error("time-scale", sentence, "t")


def _verdict(name: str, other: str, found: Agreement, *, verb: str, reference: str) -> list[Finding]:
    """Return the finding on a ratio other than one; a factor of 1.5 may still be noise."""
    size = abs(found.ratio)
    seen = f"{name} {verb} {size:.3g} times as much as {other} {reference}"
    columns = (name, other) if other.endswith("_dot") else (name,)
    findings = []
    if found.ratio < 0.0:
        sentence = (
            f"{name} and {other} have opposite signs (correlation "
            f"{found.correlation:.2f}); negate one of them."
        )
        findings.append(_error("sign", sentence, *columns))
    length, rate = name in ("x", "y"), name.startswith("gyro")
    units, right = (_LENGTHS, "m") if length else (_ANGLES, "radians")
    rate_units = _LENGTHS if length else _ANGULAR_RATES
    rates = other if other.endswith("_dot") else "theta_dot, phi_dot or psi_dot"
    for unit, column, per_second in (
        (_unit(size, rate_units if rate else units), name, rate),
        (_unit(1.0 / size, rate_units), rates, True),
    ):
        if unit:
            wanted = f"{right} per second" if per_second else right
            of = f"{unit} per second" if per_second and unit != "rpm" else unit
            code = "degrees" if unit == "degrees" else "scale"
            findings.append(_error(code, f"{seen}: {column} is in {of}, not in {wanted}.", *columns))
            return findings
    if not 1.0 / 1.5 < size < 1.5:
        sentence = f"{seen}: one of the two has a wrong scale, a delay or much noise."
        wrong = not 1.0 / WRONG_SCALE < size < WRONG_SCALE
        severity = "error" if wrong else "warning"
        findings.append(Finding(severity=severity, code="scale", text=sentence, where=Place(columns=columns)))
    return findings


def _swapped(log: Log, found: Mapping[str, Agreement]) -> list[Finding]:
    """Return an error for each pair whose columns follow each other's rates."""
    findings = []
    for first, second in (("x", "y"), ("theta", "phi")):
        if not {first, second} <= set(found):
            continue
        crossed = [
            _change_against_rate(log, first, f"{second}_dot"),
            _change_against_rate(log, second, f"{first}_dot"),
        ]
        if _is_swapped(crossed, tuple(abs(found[name].correlation) for name in (first, second))):
            sentence = (
                f"{first} and {second} are swapped, or {first}_dot and {second}_dot are: {first} "
                f"changes like the integral of {second}_dot, and {second} like that of {first}_dot."
            )
            findings.append(_error("swapped", sentence, first, second))
    return findings


def _is_swapped(crossed: list[Agreement | None], own: tuple[float, ...]) -> bool:
    sizes = [abs(one.correlation) for one in crossed if one]
    return len(sizes) == 2 and all(
        size >= SWAPPED_CORRELATION and size > kept + SWAPPED_MARGIN
        for size, kept in zip(sizes, own, strict=True)
    )


def _unit(ratio: float, units: Mapping[float, str]) -> str | None:
    """Return the unit whose size is nearest to a ratio, if one is near."""
    near = [size for size in units if 0.75 < ratio / size < 1.33]
    return units[min(near, key=lambda size: abs(np.log(ratio / size)))] if near else None


def _error(code: str, sentence: str, *columns: str) -> Finding:
    return Finding(severity="error", code=code, text=sentence, where=Place(columns=columns))
