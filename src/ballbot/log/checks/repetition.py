"""Values that a log repeats: a sensor or a whole log that froze, slow columns held at the log's rate, repeated rows.

Sensors with noise never repeat a value to the last bit. A robot at rest, an encoder at rest and a noiseless simulation
may, so that rows at rest, by their rates, give no finding.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.findings import Finding, error, finding
from ballbot.log.checks.values import runs_of
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
#: standstills that begin and end within so many rows of each other are one
TOGETHER = 2
#: a slower column repeats a value for so many rows, at least so often, in this fraction of cases equally long
HELD_ROWS, HELD_TIMES, HELD_FRACTION = 2, 20, 0.8
#: delay by repeated values above which states are wrong [s]
HELD_TIME = 0.04
#: fewest consecutive rows that are repeated if they were copied
COPIED_ROWS = 10
_GYRO = ("gyro_x", "gyro_y", "gyro_z")
_TORQUES = torque_names(MAX_WHEELS)


@dataclass(frozen=True, kw_only=True)
class _Standstill:
    """The longest run of equal values of a column."""

    start: int
    rows: int
    changes: float  #: fraction of the other rows at which the column changes

    @property
    def within(self) -> slice:
        """Its rows."""
        return slice(self.start, self.start + self.rows)


def _standstill(values: NDArray[np.float64]) -> _Standstill:
    starts, lengths = runs_of(values)
    k = int(np.argmax(lengths))
    outside = len(values) - int(lengths[k])
    changes = (len(starts) - 1) / outside if outside else 0.0
    return _Standstill(start=int(starts[k]), rows=int(lengths[k]), changes=changes)


def check_stuck(log: Log) -> list[Finding]:
    """Return findings on columns that stay constant for a while though they change at nearly all other rows.

    The finding is an error if other columns show that the robot moved meanwhile, and a warning if it may have been at
    rest, or the motors off. A torque may stay at its extreme, and at rest.
    """
    if len(log) < 2 * STUCK_ROWS:
        return []
    found: dict[str, _Standstill] = {}
    torques = [name for name in _TORQUES if name in log] if {*STATE_NAMES} <= set(log.names) else []
    for name in (*(n for n in log.names if n.startswith(NOISY_PREFIXES)), *torques):
        one, shortest = _standstill(log[name]), FROZEN_TORQUE_TIME if name in torques else STUCK_TIME
        value = abs(log[name][one.start])
        extreme = name in torques and value > 0.0 and value >= 0.999 * np.nanmax(np.abs(log[name]))
        if one.rows >= max(STUCK_ROWS, shortest / log.sample_time) and one.changes >= LIVE_FRACTION:
            found |= {} if extreme else {name: one}
    findings = []
    while found:
        first = next(iter(found.values()))
        names = [
            name
            for name, one in found.items()
            if abs(one.start - first.start) <= TOGETHER
            and abs(one.start + one.rows - first.start - first.rows) <= TOGETHER
        ]
        findings += _stuck(log, names, first, torques)
        found = {name: one for name, one in found.items() if name not in names}
    return findings


def _stuck(log: Log, names: list[str], one: _Standstill, torques: Sequence[str]) -> list[Finding]:
    """Return the finding on columns that stand still together."""
    rows, of_motors = one.within, set(names) <= set(torques)
    others = [name for name in STATE_NAMES[2:] if name in log and name not in names]
    moved = any(np.nanstd(log[name][rows]) > MOVING * np.nanstd(log[name]) for name in others)
    rates = [name for name in (*STATE_NAMES[5:], *_GYRO) if name in names]
    moved |= any(abs(log[name][one.start]) > MOVING * np.nanstd(log[name]) for name in rates)
    off = of_motors and not any(log[name][rows].any() for name in torques)
    if of_motors:
        moved |= any(_standstill(log[n][rows]).rows < one.rows / 2 for n in torques if n not in names)
        if not moved:
            return []
    time = float(log.t[one.start])
    lasting = float(log.t[one.start + one.rows - 1] - time)
    cause = "messages were lost, or the sensor or the logger froze"
    if of_motors:
        cause = "the motors were off" if off else "messages were lost, or a motor is dead"
    text = (
        f"{', '.join(names)}: one value repeats for {lasting:.3g} s from row {one.start + 1} (t = {time:.6g} s), and "
        f"nearly all other rows differ: {cause}{'' if moved else ', or everything was at rest'}."
    )
    severity = "error" if moved and lasting >= FROZEN_TIME and not off else "warning"
    return [finding("stuck", severity, text, *names, time=time)]


def check_held(log: Log) -> list[Finding]:
    """Return a finding on columns that repeat each value for a fixed number of rows."""
    if len(log) < HELD_ROWS * HELD_TIMES:
        return []
    names = [n for n in (*STATE_NAMES, *_GYRO, *_TORQUES) if n in log]
    held = {name: rows for name in names if (rows := _held_rows(log[name])) >= HELD_ROWS}
    if not held:
        return []
    rows = max(held.values())
    delay = rows * log.sample_time
    duplicated = set(names) == set(held) and len(set(held.values())) == 1 and _in_step(log, names)
    if not duplicated and delay < 2.0 * HELD_TIME and not any(name in held for name in STATE_NAMES):
        return []  # a controller slower than its log
    cause = "rows were duplicated" if duplicated else "a slower sensor, or resampling without interpolation"
    text = (
        f"{', '.join(held)}: a new value comes only every {rows} rows, every {delay:.3g} s, and repeats in between: "
        f"{cause}. Values are late by up to that time; keep one row of {rows}, interpolate, or log at their rate."
    )
    return [finding("held", "error" if duplicated or delay >= HELD_TIME else "warning", text, *held)]


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
    starts, lengths = runs_of(offset.astype(np.float64))
    copied = (offset[starts] > 0) & (lengths >= COPIED_ROWS)
    if not copied.any():
        return []
    start, length = int(starts[copied][0]), int(lengths[copied][0])
    source, time = start - int(offset[start]), float(log.t[start])
    text = (
        f"Rows {start + 1} to {start + length} (from t = {time:.6g} s) repeat rows {source + 1} to {source + length} "
        "exactly, which no measurement does: a part of the log was written twice. Remove one of the two."
    )
    return [error("copied", text, *names, time=time)]


def _held_rows(values: NDArray[np.float64]) -> int:
    """Return for how many rows a column repeats each of its values; 1 if the number varies."""
    inner = runs_of(values)[1][1:-1]
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
