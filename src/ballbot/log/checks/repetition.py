"""Values that a log repeats: a sensor or a whole log that froze, slow columns held at the log's rate, repeated rows.

Sensors with noise never repeat a value to the last bit. A robot at rest, an encoder at rest and a noiseless simulation
may, so that rows at rest, by their rates, give no finding.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.findings import Finding, Place
from ballbot.log.columns import MAX_WHEELS, STATE_NAMES, torque_names
from ballbot.log.log import Log

#: columns of sensors with noise; an encoder may rightly stay constant
NOISY_PREFIXES = ("theta", "phi", "psi", "gyro_", "acc_", "ball_omega_")
#: a column that changes at this fraction of the rows is live: staying constant is a fault
LIVE_FRACTION = 0.9
#: shortest standstill of a live column that is reported [s], [rows]
STUCK_TIME, STUCK_ROWS = 0.1, 10
#: standstill, while other columns move, above which results are wrong [s]
FROZEN_TIME = 0.4
#: shortest standstill of a torque that is not at its extreme [s]
FROZEN_TORQUE_TIME = 1.0
#: a state moves, and a rate is not one of rest, above this fraction of its standard deviation
MOVING = 0.2
#: a slower column repeats a value for so many rows, at least so often, in this fraction of cases equally long
HELD_ROWS, HELD_TIMES, HELD_FRACTION = 2, 20, 0.8
#: delay by repeated values above which states are wrong [s]
HELD_TIME = 0.04
#: fewest consecutive rows that are repeated if they were copied
COPIED_ROWS = 10
_GYRO = ("gyro_x", "gyro_y", "gyro_z")
_TORQUES = torque_names(MAX_WHEELS)


@dataclass(frozen=True, kw_only=True)
class Standstill:
    """The longest run of equal values of a column."""

    start: int
    rows: int
    changes: float  #: fraction of the other rows at which the column changes


def standstill(values: NDArray[np.float64]) -> Standstill:
    """Return the longest run of equal values of a column (N,)."""
    starts, lengths = _runs(values)
    k = int(np.argmax(lengths))
    outside = len(values) - int(lengths[k])
    return Standstill(
        start=int(starts[k]), rows=int(lengths[k]), changes=(len(starts) - 1) / outside if outside else 0.0
    )


def check_stuck(log: Log) -> list[Finding]:
    """Return findings on columns that stay constant for a while though they change at nearly all other rows.

    The finding is an error if other columns show that the robot moved meanwhile, and a warning if it may have been at
    rest.
    """
    if len(log) < 2 * STUCK_ROWS:
        return []
    shortest = max(STUCK_ROWS, round(STUCK_TIME / log.sample_time))
    names = [name for name in log.names if name.startswith(NOISY_PREFIXES)]
    found = {name: standstill(log[name]) for name in names}
    stuck = {
        name: one for name, one in found.items() if one.rows >= shortest and one.changes >= LIVE_FRACTION
    }
    together = _together(stuck)
    if len(together) >= 3:
        return [_frozen_log(log, together, stuck[together[0]])]
    return [_stuck_column(log, name, one) for name, one in stuck.items()] + _stuck_torques(log)


def check_held(log: Log) -> list[Finding]:
    """Return findings on columns that repeat each value for a fixed number of rows."""
    if len(log) < HELD_ROWS * HELD_TIMES:
        return []
    names = [n for n in (*STATE_NAMES, *_GYRO, *_TORQUES) if n in log]
    held = {name: rows for name in names if (rows := _held_rows(log[name])) >= HELD_ROWS}
    if not held:
        return []
    states = [name for name in held if name in STATE_NAMES]
    rows = max(held.values())
    delay = rows * log.sample_time
    repeats_all = set(names) == set(held) and len(set(held.values())) == 1 and _in_step(log, names)
    columns = tuple(held)
    if repeats_all:
        sentence = (
            f"Every row appears {rows} times: the log was written {rows} times as fast as it "
            f"was measured, or rows were duplicated. Keep only every {_ordinal(rows)} row."
        )
        return [Finding(severity="error", code="held", text=sentence, where=Place(columns=columns))]
    if not states and delay < 2.0 * HELD_TIME:
        return []  # a controller slower than its log
    wrong = delay >= HELD_TIME
    noun = "The columns" if len(columns) > 1 else "The column"
    verb = "change" if len(columns) > 1 else "changes"
    sentence = (
        f"{noun} {', '.join(columns)} {verb} only every {_ordinal(rows)} row, every "
        f"{delay:.3g} s, and {('repeat' if len(columns) > 1 else 'repeats')} the last value "
        "in between: a slower sensor, or resampling without interpolation. Its values "
        "are delayed by up to that time; interpolate them, or log at their rate."
    )
    severity = "error" if wrong else "warning"
    return [Finding(severity=severity, code="held", text=sentence, where=Place(columns=columns))]


def check_copied(log: Log) -> list[Finding]:
    """Return an error if an interval of rows is repeated later, to the last bit."""
    names = [name for name in log.names if name.startswith(NOISY_PREFIXES)]
    if len(names) < 3 or len(log) < 4 * COPIED_ROWS:
        return []
    table = np.column_stack([log[name] for name in names])
    _, first, which = np.unique(table, axis=0, return_index=True, return_inverse=True)
    earlier = first[which.ravel()]
    rows = np.arange(len(log))
    moving = np.any(np.diff(table, axis=0, prepend=table[:1]) != 0.0, axis=1)
    offset = np.where((earlier < rows) & moving & np.isfinite(table).all(axis=1), rows - earlier, 0)
    starts, lengths = _runs(offset.astype(np.float64))
    copied = (offset[starts] > 0) & (lengths >= COPIED_ROWS)
    if not copied.any():
        return []
    start, length = int(starts[copied][0]), int(lengths[copied][0])
    source = start - int(offset[start])
    time = float(log.t[start])
    sentence = (
        f"Rows {start + 1} to {start + length} (from t = {time:.6g} s) repeat rows "
        f"{source + 1} to {source + length} exactly, which no measurement does: a "
        "part of the log was copied or written twice. Remove one of the two."
    )
    return [
        Finding(severity="error", code="copied", text=sentence, where=Place(columns=tuple(names), time=time))
    ]


def _runs(values: NDArray[np.float64]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the starts and the lengths of the runs of equal values."""
    starts = np.concatenate(([0], np.flatnonzero(values[1:] != values[:-1]) + 1))
    return starts, np.diff(np.concatenate((starts, [len(values)])))


def _together(stuck: dict[str, Standstill]) -> list[str]:
    """Return the largest set of columns with the same standstill, within a row at either end."""
    best: list[str] = []
    for one in stuck.values():
        same = [
            name
            for name, other in stuck.items()
            if abs(other.start - one.start) <= 2 and abs(other.start + other.rows - one.start - one.rows) <= 2
        ]
        best = max(best, same, key=len)
    return best


def _frozen_log(log: Log, names: list[str], one: Standstill) -> Finding:
    start, time = one.start, float(log.t[one.start])
    lasting = float(log.t[start + one.rows - 1] - time)
    rows = slice(start, start + one.rows)
    rates = [name for name in (*STATE_NAMES[5:], *_GYRO) if name in names]
    moved = any(abs(log[name][start]) > MOVING * np.nanstd(log[name]) for name in rates)
    # at rest, rates are zero to the last bit
    others = any(log[name][start] for name in names) and _others_move(log, rows, names)
    severity = "error" if (moved or others) and lasting >= FROZEN_TIME else "warning"
    end = "" if severity == "error" else ", or everything was at rest"
    sentence = (
        f"The log is frozen for {lasting:.3g} s from row {start + 1} (t = {time:.6g} "
        f"s): {_short(names)} repeat one value, though they change at nearly all other "
        f"rows. Messages were lost, or the logger hung{end}; remove this interval."
    )
    return Finding(
        severity=severity, code="stuck", text=sentence, where=Place(columns=tuple(names), time=time)
    )


def _stuck_column(log: Log, name: str, one: Standstill) -> Finding:
    time = float(log.t[one.start])
    lasting = float(log.t[one.start + one.rows - 1] - time)
    moved = _others_move(log, slice(one.start, one.start + one.rows), (name,))
    severity = "error" if moved and lasting >= FROZEN_TIME else "warning"
    cause = (
        "the sensor froze or messages were lost"
        if moved
        else "the sensor froze, messages were lost, or everything was at rest"
    )
    sentence = (
        f"{name} repeats {log[name][one.start]:.6g} for {one.rows} rows ({lasting:.3g} s) from row {one.start + 1} "
        f"(t = {time:.6g} s), though it changes at nearly all others: {cause}."
    )
    return Finding(severity=severity, code="stuck", text=sentence, where=Place(columns=(name,), time=time))


def _others_move(log: Log, rows: slice, names: Sequence[str]) -> bool:
    """Return whether states other than these move in those rows, by more than their noise."""
    others = (log[other] for other in STATE_NAMES[2:] if other in log and other not in names)
    return any(np.nanstd(values[rows]) > MOVING * np.nanstd(values) for values in others)


def _stuck_torques(log: Log) -> list[Finding]:
    """Return an error for a torque that froze while the others changed or the robot moved, except at its extreme.

    It is a warning if all torques are zero: the motors may be off while the robot is carried.
    """
    findings = []
    names = [name for name in _TORQUES if name in log]
    shortest = max(STUCK_ROWS, round(FROZEN_TORQUE_TIME / log.sample_time))
    for name in names if {*STATE_NAMES} <= set(log.names) else []:
        one = standstill(log[name])
        value = float(log[name][one.start])
        extreme = abs(value) >= 0.999 * float(np.nanmax(np.abs(log[name])))
        if one.rows < shortest or one.changes < LIVE_FRACTION or (value != 0.0 and extreme):
            continue
        rows = slice(one.start, one.start + one.rows)
        alone = any(standstill(log[other][rows]).rows < one.rows / 2 for other in names if other != name)
        if not (alone or _others_move(log, rows, ())):
            continue
        time = float(log.t[one.start])
        off = not any(log[other][rows].any() for other in names)
        cause = "the motors were off" if off else "messages were lost, or the motor is dead"
        sentence = (
            f"{name} repeats {value:.4g} N m for {one.rows} rows from row {one.start + 1} (t = {time:.6g} s) while "
            f"{'the other torques change' if alone else 'the robot moves'}: {cause}."
        )
        severity = "warning" if off else "error"
        findings.append(
            Finding(severity=severity, code="stuck", text=sentence, where=Place(columns=(name,), time=time))
        )
    return findings


def _held_rows(values: NDArray[np.float64]) -> int:
    """Return for how many rows a column repeats each of its values; 1 if the number varies."""
    _, lengths = _runs(values)
    inner = lengths[1:-1]
    if len(inner) < HELD_TIMES:
        return 1
    usual = int(np.median(inner))
    regular = np.mean(np.abs(inner - usual) <= (1 if usual > HELD_ROWS else 0))
    return usual if regular >= HELD_FRACTION else 1


def _in_step(log: Log, names: Sequence[str]) -> bool:
    """Return whether all columns change at the same rows."""
    changes = [np.diff(log[name]) != 0.0 for name in names]
    together = np.all(changes, axis=0).sum()
    return bool(together >= HELD_FRACTION * np.any(changes, axis=0).sum())


def _short(names: Sequence[str]) -> str:
    return (
        ", ".join(names) if len(names) <= 4 else f"{', '.join(names[:3])} and {len(names) - 3} more columns"
    )


def _ordinal(number: int) -> str:
    return {2: "second", 3: "third"}.get(number, f"{number}th")
