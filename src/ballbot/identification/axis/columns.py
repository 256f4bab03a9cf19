"""Columns of an axis's record that are not what they are taken for, found before anything is fitted.

A sensor that repeats its value while the axis moves, a force that is the position's reference or a magnitude, and a
demand that exceeds what the supply or the driver lets act. The last two are hypotheses about the force that explain far
more of it, by the inverse model, than the force as it was recorded.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.findings import Finding, Place, Severity
from ballbot.identification.axis.inverse import RegressionRows
from ballbot.identification.axis.motion import default_bandwidth, smoothed_motion
from ballbot.identification.axis.record import AxisRecord

#: a value that is repeated for this time [s] and over this many rows does not repeat by chance
_LONG, _ROWS = 0.2, 40
#: after it, the position jumps by so many of the largest other steps
_JUMP = 3.0
#: a force that a noisy sensor or a loop gives changes from row to row in this share of the rows
_CHANGING = 0.9
#: while its force is repeated, the acceleration varies by this share of its usual variation
_LIVELY = 0.5


@dataclass(frozen=True, kw_only=True)
class _Repetition:
    """Rows first to last - 1 with one value."""

    first: int
    last: int


def _longest_repetition(values: NDArray[np.float64]) -> _Repetition:
    edges = np.flatnonzero(np.append(True, np.append(np.diff(values) != 0.0, True)))
    place = int(np.argmax(np.diff(edges)))
    return _Repetition(first=int(edges[place]), last=int(edges[place + 1]))


def stuck_findings(record: AxisRecord) -> Iterator[Finding]:
    """Find a position or a force that repeats its value while the axis moves."""
    for name, stuck in (("position", _stuck_position), ("force", _stuck_force)):
        longest = _longest_repetition(getattr(record, name))
        first, last = longest.first, longest.last
        duration = float(record.t[min(last, len(record) - 1)] - record.t[first])
        if last - first < _ROWS or duration < _LONG or last == len(record) or not stuck(record, longest):
            continue
        value, unit = getattr(record, name)[first], record.unit if name == "position" else record.force_unit
        follows = (
            "then it jumps" if name == "position" else "while the axis speeds up and slows down as before"
        )
        text = (
            f"The {name} is {value:.4g} {unit} without change for {duration:.2g} s (from row {first + 1}, "
            f"{record.t[first]:.4g} s after the first one), {follows}: the log repeats its last value. "
            "Leave these cells empty."
        )
        yield column_finding("stuck", "error", text, name)


def _stuck_position(record: AxisRecord, longest: _Repetition) -> bool:
    """Return whether the position jumps after it: an axis that was at rest begins to move slowly."""
    speeds = np.abs(np.diff(record.position)) / np.diff(record.t)
    others = np.delete(speeds, longest.last - 1)
    return bool(speeds[longest.last - 1] > _JUMP * others.max())


def _stuck_force(record: AxisRecord, longest: _Repetition) -> bool:
    """Return whether the axis accelerates to and fro meanwhile, under a force that otherwise always changes.

    A motor that is off, at its limit, or driven in steps repeats its force, too.
    """
    force, rows = record.force, slice(longest.first, longest.last)
    changes = np.delete(np.diff(force), np.s_[longest.first : longest.last - 1])
    if (
        np.mean(changes != 0.0) < _CHANGING
        or not 0.0 < abs(force[longest.first]) < 0.98 * np.abs(force).max()
    ):
        return False
    acceleration = smoothed_motion(record, bandwidth=default_bandwidth(record)).acceleration
    return bool(np.std(acceleration[rows]) > _LIVELY * np.std(acceleration))


#: a force that leads the position by at most this time [s] and has this correlation with it, ...
_LEAD, _FOLLOWS = 0.2, 0.995
#: in one of these units of the position, to this share, is its reference
_UNITS, _SAME = (1.0, float(np.degrees(1.0)), 100.0, 1000.0), 0.05


def reference_findings(record: AxisRecord) -> Iterator[Finding]:
    """Find a force that is the position some rows later, in metres or radians, degrees, centimetres or millimetres."""
    force, position = record.force, record.position
    # values so small that their squares vanish have no correlation
    if np.std(force) == 0.0 or np.std(position) == 0.0:
        return
    most = min(int(_LEAD / record.sample_time), len(record) // 4)
    leads = range(0, most + 1, max(1, most // 40))

    def alike(rows: int) -> float:
        ahead, behind = force[: len(force) - rows], position[rows:]
        return (
            float(np.corrcoef(ahead, behind)[0, 1]) if np.std(ahead) > 0.0 and np.std(behind) > 0.0 else 0.0
        )

    if alike(best := max(leads, key=alike)) < _FOLLOWS:
        return
    ratio = float(np.std(force) / np.std(position))
    factor = min(_UNITS, key=lambda one: abs(np.log(ratio / one)))
    apart = abs(float(np.mean(force)) / factor - float(np.mean(position)))
    if abs(ratio / factor - 1.0) > _SAME or apart > _SAME * float(np.ptp(position)):
        return
    times = "" if factor == 1.0 else f"{factor:.4g} times "
    text = (
        f"The force is {times}the position {1e3 * best * record.sample_time:.3g} ms later: it appears to be the "
        "reference of the position, and not a force. Name the column of the force, current or voltage with --force."
    )
    yield column_finding("force-unrelated", "error", text, "force")


#: a hypothesis is looked for if the motion leaves more than this share of the force's square, and is found if
#: it leaves less than this share of that
_UNEXPLAINED, _EXPLAINS = 0.05, 0.25
#: a force of one sign is below this share of its largest value for the other one
_OTHER_SIGN = 0.02
#: limits tried, as quantiles of the size of the force, and speeds without force, over the largest
_LIMITS, _FREE_SPEEDS = np.linspace(0.05, 1.0, 39), (np.inf, 1.05, 1.2, 1.5, 2.0)
#: a limit that is found changes this share of the rows at least
_LIMITED_ROWS = 0.02


def force_findings(record: AxisRecord, rows: RegressionRows) -> Iterator[Finding]:
    """Find why the inverse model's rows do not explain the force: it is a magnitude, or a demand beyond a limit.

    Not under a known load, whose force is subtracted from that of the rows.
    """
    if record.known_load.weight or record.known_load.inertia or record.loop is not None:
        return
    F, speed = rows.force, rows.seen["speed"]
    Q, _ = np.linalg.qr(np.column_stack(list(rows.columns.values())))

    def unexplained(force: NDArray[np.float64]) -> float:
        return float(np.sum((force - Q @ (Q.T @ force)) ** 2) / max(np.sum(force**2), np.finfo(float).tiny))

    usual = unexplained(F)
    if usual < _UNEXPLAINED:
        return
    size = np.abs(F)
    if min(np.quantile(F, 0.99), -np.quantile(F, 0.01)) < _OTHER_SIGN * size.max():
        left = []
        for start in (speed, rows.columns["mass"]):
            sign = np.sign(start)
            # each sign is that of the model's own force; this settles within a few rounds
            for _ in range(20):
                sign = np.sign(Q @ (Q.T @ (sign * size)))
            left.append(unexplained(sign * size))
        if min(left) < _EXPLAINS * usual:
            text = (
                "The force never changes its sign, and the motion explains it far better with changing signs: it is "
                "the magnitude of a force or current. Record it with its sign."
            )
            yield column_finding("force-sign", "error", text, "force")
            return
    yield from _limit_finding(record, F, speed, usual, unexplained)


def _limit_finding(
    record: AxisRecord,
    force: NDArray[np.float64],
    speed: NDArray[np.float64],
    usual: float,
    unexplained: Callable[[NDArray[np.float64]], float],
) -> Iterator[Finding]:
    """Find a limit of the force, at all speeds or falling evenly to zero at some speed, that explains the motion."""
    fastest = float(np.quantile(np.abs(speed), 0.99))
    found: list[tuple[float, float, float]] = []
    for limit in np.quantile(np.abs(force), _LIMITS).tolist():
        for free in (fastest * one for one in _FREE_SPEEDS):
            acting = np.clip(
                force,
                -limit * np.maximum(0.0, 1.0 + speed / free),
                limit * np.maximum(0.0, 1.0 - speed / free),
            )
            if np.mean(np.abs(acting - force) > _OTHER_SIGN * limit) > _LIMITED_ROWS:
                found.append((unexplained(acting), limit, free))
    constant = min((one for one in found if np.isinf(one[2])), default=None)
    best = constant if constant and constant[0] < _EXPLAINS * usual else min(found, default=None)
    if best is None or best[0] >= _EXPLAINS * usual:
        return
    left, limit, free = best
    before, after = (f"{100.0 * (1.0 - one):.3g} %" for one in (usual, left))
    unit = record.force_unit
    if np.isinf(free):
        text = (
            f"The motion explains {after} of the force, not only {before}, if no more than about {limit:.2g} {unit} "
            "acts: the record is a demand, and the driver or the supply limits it. Give the limit of the force's "
            "variable with --limit."
        )
    else:
        text = (
            f"The motion explains {after} of the force, and not only {before}, if the largest force falls from about "
            f"{limit:.3g} {unit} at rest to zero at about {free:.3g} {record.unit}/s, as the supply voltage limits it: "
            "the recorded force does not act at high speed. Remove these rows (gaps are allowed), record with less "
            "force or speed, or record the current."
        )
    yield column_finding("speed-limit" if np.isfinite(free) else "force-unrelated", "warning", text, "force")


def column_finding(code: str, severity: Severity, text: str, *columns: str) -> Finding:
    """Return a finding about columns of a record."""
    return Finding(code=code, severity=severity, text=text, where=Place(columns=columns))
