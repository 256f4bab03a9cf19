"""What single columns show: gaps, missing values, spikes, jumps, limits, falls, dead, frozen and slow columns.

Faults of single rows are a table, `ROW_FAULTS`: which columns, which rows have it, and the sentence.

A value is a spike if it differs from both neighbouring rows, to the same side, by more than five times the range of
nearly all others: a corrupted message, or a marker such as 9999 for a missing one. A motion takes several rows to get
there and back, and noise of that size would affect many rows.

Positions and angles must change from row to row by the integral of their rates. The mean lean of a balancing robot is
near zero, since a constant lean is a constant acceleration. Sensors with noise never repeat a value to the last bit; a
robot at rest, an encoder at rest and a noiseless simulation may, so that rows at rest, by their rates, give no finding.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import nearest
from ballbot.findings import Finding, Severity, error, finding, note, warning
from ballbot.log.columns import (
    KNOWN_NAMES,
    MAX_WHEELS,
    POSITION_NAMES,
    STATE_NAMES,
    TRUE_PREFIX,
    Bools,
    Floats,
    torque_names,
    unit_of,
    wheel_angle_names,
    wheel_speed_names,
)
from ballbot.log.log import Log
from ballbot.robot import Robot
from ballbot.summary import counted

#: a spike differs by so many times the range of the others, without this fraction of them at either end
_FAR, _ENDS = 5.0, 0.005
#: with fewer rows the usual range is unknown
_LEAST_ROWS = 50
#: references and true states, which no sensor measures
_NOT_MEASURED = ("ref_", TRUE_PREFIX)
#: an interval this many times the usual longest one is a gap; one missing row of a regular log gives 2
GAP_RATIO = 1.5
#: standard deviation of the intervals, relative to their median, that gives a warning
JITTER_RATIO = 0.05
#: a limit shows as at least this many equal extreme torques in a row
SATURATED_ROWS = 3
FALLEN_LEAN = 0.6  #: [rad], from which no ball-balancing robot of this kind recovers
#: smallest jump: change from one row to the next beyond the integral of the rates [m, m, rad, rad, rad]
LEAST_JUMP = {"x": 0.08, "y": 0.08, "theta": 0.08, "phi": 0.08, "psi": 0.2}
#: and so many times the usual change
FAR = 30.0
#: standard deviation of a state that moves [m, rad, m/s, rad/s], and of the ball's velocity if the robot does [m/s]
LEAST_MOVING, LEAST_SPEED = 1e-3, 2e-3
#: shortest time over which a balancing robot's lean is averaged [s]
AVERAGED_TIME = 8.0
#: the lean and the ball's acceleration are compared as means over [s]
BLOCK_TIME = 1.0
#: mean lean [rad] that gives a warning (slope, load off the axis), and one that is an error
TILTED, OFFSET = 0.025, 0.04
_LEAN = ("theta", "phi")


def spikes(values: Floats) -> Bools:
    """Return which rows of a signal (N,) are spikes; the first and the last, and missing values, never are."""
    found = np.zeros(len(values), dtype=bool)
    rows = np.flatnonzero(np.isfinite(values))
    if rows.size < _LEAST_ROWS:
        return found
    known = values[rows]
    steps = np.diff(known)
    there, back = steps[:-1], -steps[1:]
    off = np.where(there * np.sign(back) > 0.0, np.minimum(np.abs(there), np.abs(back)), 0.0)
    excluded = math.ceil(_ENDS * known.size)
    ordered = np.sort(known)
    usual = ordered[-1 - excluded] - ordered[excluded]
    found[rows[1:-1]] = (usual > 0.0) & (off > _FAR * usual)
    return found


def spiked_rows(log: Log, names: Sequence[str]) -> Bools:
    """Return which rows of a log (N,) have a spike in one of these columns."""
    return np.any([spikes(log[name]) for name in names], axis=0)


def runs_of(values: Floats) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the starts and the lengths of the runs of equal values of a column (N,)."""
    starts = np.concatenate(([0], np.flatnonzero(values[1:] != values[:-1]) + 1))
    return starts, np.diff(np.concatenate((starts, [len(values)])))


def _at_limit(log: Log, name: str, _: float) -> Bools:
    """Return the rows in which a torque stays at its largest value."""
    size = np.nan_to_num(np.abs(log[name]))
    top = size == size.max()
    starts, lengths = runs_of(top.astype(np.float64))
    long = np.repeat(top[starts] & (lengths >= SATURATED_ROWS), lengths)
    return long & (size > 0.0) & (not long.all())


def _jumps(log: Log, name: str, _: float) -> Bools:
    """Return the rows to which a position or angle jumps where its rate does not, and stays there."""
    if f"{name}_dot" not in log or len(log) < 4:
        return np.zeros(len(log), dtype=np.bool_)
    values, rate, intervals = log[name], log[f"{name}_dot"], np.diff(log.t)
    change = np.diff(values) - 0.5 * (rate[1:] + rate[:-1]) * intervals
    change = np.abs(np.nan_to_num(change))
    # across a gap, any change up to the largest rate is possible
    gap = np.where(intervals > 1.5 * log.sample_time, 2.0 * np.nanmax(np.abs(rate)) * intervals, 0.0)
    far = change > LEAST_JUMP[name] + FAR * float(np.median(change)) + gap
    spiked = spikes(values)
    return np.concatenate(([False], far & ~spiked[1:] & ~spiked[:-1]))


@dataclass(frozen=True, kw_only=True)
class RowFault:
    """A fault that single rows of a column show."""

    code: str
    severity: Severity
    columns: tuple[str, ...]  #: that may have it, as far as a log has them
    rows: Callable[[Log, str, float], Bools]  #: which rows (N,) of a column have it, by the limit
    #: {rows} that have it, the first with its {row}, time and {value} in a {unit}; {limit} of the robot
    text: str
    limit: Callable[[Robot], float] | None = None  #: without a robot it is not examined


_TORQUES = torque_names(MAX_WHEELS)
#: accelerometers measure shocks, and references may jump
_SPIKED = tuple(n for n in KNOWN_NAMES[1:] if not n.startswith(("acc_", *_NOT_MEASURED)))
_WHERE = "at row {row} (t = {t:.6g} s)"
ROW_FAULTS = (
    RowFault(
        code="spike",
        severity="warning",
        columns=_SPIKED,
        rows=lambda log, name, _: spikes(log[name]),
        text="{name} jumps away and back in {rows}, to {value:.6g} " + _WHERE + ", further than it moves otherwise: a "
        "corrupted message, or a marker of missing values, which a mapping file can name.",
    ),
    RowFault(
        code="wrap",
        severity="warning",
        columns=wheel_angle_names(MAX_WHEELS),
        rows=lambda log, name, _: np.abs(np.abs(np.diff(log[name], prepend=log[name][:1])) - 2.0 * np.pi) < 0.5,
        text="{name} jumps by a full turn in {rows}, first " + _WHERE + ": it is wrapped. Unwrap it (numpy.unwrap) "
        "before use.",
    ),
    RowFault(
        code="jump",
        severity="error",
        columns=POSITION_NAMES,
        rows=_jumps,
        text="{name} jumps in {rows}, first to {value:.3g} {unit} " + _WHERE + ", which its rate does not explain: "
        "joined logs, a restart, or a sensor that was reset. Split the log there.",
    ),
    RowFault(
        code="saturation",
        severity="warning",
        columns=_TORQUES,
        rows=_at_limit,
        text="{name} stays at its largest value, {value:.4g} N m, in {rows}, first " + _WHERE + ": it is saturated "
        "there, or the recording clips it, and it does not follow the control law.",
    ),
    RowFault(
        code="torque-limit",
        severity="warning",
        columns=_TORQUES,
        rows=lambda log, name, limit: np.abs(log[name]) > 1.01 * limit,  # 1 %: rounding in the file
        limit=lambda robot: robot.drive.torque_limit,
        text="{name} is above the robot's limit of {limit:.4g} N m in {rows}, first " + _WHERE + ": the input may not "
        "be a torque, or the limit in the robot file is too low.",
    ),
    RowFault(
        code="speed-limit",
        severity="warning",
        columns=wheel_speed_names(MAX_WHEELS),
        rows=lambda log, name, limit: np.abs(log[name]) > limit,
        limit=lambda robot: robot.drive.top_speed,
        text="{name} is above {limit:.4g} rad/s, the limit of the robot's supply and motors, in {rows}, first "
        + _WHERE + ": the commanded torque is not the torque that acted.",
    ),
)  # fmt: skip


def check_row_faults(log: Log, robot: Robot | None) -> list[Finding]:
    """Return a finding for each column with rows that have one of `ROW_FAULTS`."""
    findings = []
    for one in ROW_FAULTS:
        if one.limit and robot is None:
            continue
        limit = one.limit(robot) if one.limit and robot else math.nan
        for name in (n for n in one.columns if n in log):
            rows = np.flatnonzero(one.rows(log, name, limit))
            if rows.size:
                k = int(rows[0])
                time, value = float(log.t[k]), float(log[name][k])
                text = one.text.format(
                    name=name, rows=counted(rows.size, "row"), row=k + 1, t=time, value=value,
                    unit=unit_of(name), limit=limit,
                )  # fmt: skip
                findings.append(finding(one.code, one.severity, text, name, time=time))
    return findings


def check_intervals(log: Log) -> list[Finding]:
    """Return a warning if rows are missing, and one if the other intervals vary."""
    intervals = np.diff(log.t)
    if intervals.size < 3:
        return []
    # the 95th percentile, not the median: logs whose host polls late alternate between two intervals
    usual = float(np.quantile(intervals, 0.95, method="lower"))
    gaps = np.flatnonzero(intervals > GAP_RATIO * usual)
    findings = []
    if gaps.size:
        time = float(log.t[gaps[0]])
        text = (
            f"{counted(gaps.size, 'gap')} in time, first of {intervals[gaps[0]]:.4g} s after row {gaps[0] + 1} "
            f"(t = {time:.6g} s), the longest {intervals[gaps].max():.4g} s, while rows come every "
            f"{log.sample_time:.4g} s; windows must not span them."
        )
        findings.append(warning("gap", text, "t", time=time))
    typical = intervals[intervals <= GAP_RATIO * usual]
    scatter = float(typical.std() / np.median(typical))
    if scatter > JITTER_RATIO:
        text = (
            f"The intervals between rows vary by {100 * scatter:.0f} % about {log.sample_time:.4g} s "
            f"(from {typical.min():.4g} to {typical.max():.4g} s); rates from differences will be noisy."
        )
        findings.append(warning("jitter", text, "t"))
    return findings


def check_missing_values(log: Log) -> list[Finding]:
    """Return a warning for each set of columns in which the same cells are NaN or infinite."""
    columns: dict[bytes, list[str]] = {}
    for name in log.names:
        columns.setdefault(np.isfinite(log[name]).tobytes(), []).append(name)
    findings = []
    for known, names in columns.items():
        bad = np.flatnonzero(~np.frombuffer(known, dtype=np.bool_))
        if bad.size:
            time = float(log.t[bad[0]])
            text = (
                f"{', '.join(names)}: {bad.size} of {len(log)} values missing or not finite, the first at row "
                f"{bad[0] + 1} (t = {time:.6g} s); uses that need the column leave these rows out."
            )
            findings.append(warning("missing", text, *names, time=time))
    return findings


def check_names(log: Log) -> list[Finding]:
    """Return a note on columns that Ballbot does not know, with the name that was perhaps meant."""
    unknown = [name for name in log.names if name not in KNOWN_NAMES]
    meant = {name: nearest(name, KNOWN_NAMES, likeness=0.8) for name in unknown}
    listed = [f"{name} (did you mean {near[0]}?)" if near else name for name, near in meant.items()]
    text = f"Columns that Ballbot does not know and does not use: {', '.join(listed)}."
    return [note("unknown", text, *unknown)] if unknown else []


def check_constant(log: Log) -> list[Finding]:
    """Return a finding for each column that never changes, or one for a log at rest: no sensor and no torque changes.

    It is an error if the column is a state whose rate, or angle, changes, or the torque of a robot that balances and
    moves; and a note if it is a reference.
    """
    names = [name for name in log.names if name != "t" and not name.startswith(TRUE_PREFIX)]
    still = [name for name in names if len(log) > 1 and np.all(log[name] == log[name][0])]
    sensors = [name for name in names if not name.startswith(_NOT_MEASURED)]
    if len(sensors) > 1 and set(sensors) <= set(still):
        text = (
            f"No measurement and no torque changes in {log.t[-1] - log.t[0]:.3g} s: the robot is at rest "
            "throughout, or was not recorded. Record it while it moves."
        )
        return [warning("constant", text, *sensors)]
    findings = []
    moves = {*STATE_NAMES} <= set(names) and float(np.nanstd([log["x_dot"], log["y_dot"]])) > LEAST_SPEED
    dead = [name for name in still if name in _TORQUES and moves]
    if dead:
        values = ", ".join(f"{name} is {log[name][0] + 0.0:.3g} N m" for name in dead)
        text = (
            f"{values} throughout though the robot balances and moves: a motor that is dead or off, or a torque that "
            "was not recorded. Identification and validation would use it as the torque that acted."
        )
        findings.append(error("dead-motor", text, *dead))
    for name in (name for name in still if name not in dead):
        text, is_reference = f"{name} is {log[name][0]:g} throughout", name.startswith("ref_")
        other = name.removesuffix("_dot") if name.endswith("_dot") else f"{name}_dot"
        wrong = name in STATE_NAMES and other in log and float(np.nanstd(log[other])) > LEAST_MOVING
        cause = f"{f' though {other} changes' if wrong else ''}, as if its sensor or cable were dead."
        text += ": the reference is constant." if is_reference else cause
        findings.append(
            finding("constant", "note" if is_reference else "error" if wrong else "warning", text, name)
        )
    return findings


def check_lean(log: Log) -> list[Finding]:
    """Return findings on a lean in degrees, or a fall; and on a balancing robot's mean lean."""
    if not {*_LEAN} <= set(log.names):
        return []
    # missing values have a finding of their own
    lean = np.nan_to_num(np.hypot(log["theta"], log["phi"]), posinf=0.0)
    fallen = np.flatnonzero(lean > FALLEN_LEAN)
    findings = []
    if fallen.size:
        time, peak = float(log.t[fallen[0]]), float(lean.max())
        times = 1 + int(np.count_nonzero(np.diff(fallen) > 1))
        if times >= 3 or peak > np.pi / 2:
            text = (
                f"The lean exceeds {FALLEN_LEAN:g} {times} times and reaches {peak:.3g}, which no balancing robot does "
                f"in radians: theta and phi are in degrees, or the log continues after a fall (t = {time:.6g} s)."
            )
            findings.append(error("degrees", text, *_LEAN, time=time))
        else:
            text = (
                f"The robot falls or is caught: its lean exceeds {FALLEN_LEAN:g} rad at t = {time:.6g} s (row "
                f"{fallen[0] + 1}); only the rows before show balancing."
            )
            findings.append(warning("fall", text, *_LEAN, time=time))
    if "psi" not in log:
        return findings
    rows: Bools = np.all(np.isfinite([log[name] for name in (*_LEAN, "psi")]), axis=0)
    rows[fallen[0] if fallen.size else len(rows) :] = False
    if rows.sum() < 2 or np.ptp(log.t[rows]) < AVERAGED_TIME:
        return findings
    mean = _resting_lean(log, rows)
    if abs(mean) >= TILTED:
        text = (
            f"theta and phi are ({np.degrees(mean.real):.2g}, {np.degrees(mean.imag):.2g}) degrees on average, "
            "and a balancing robot's are near zero: the IMU is mounted at an angle or has a bias, the centre "
            "of mass lies off the axis, or the floor slopes. Subtract the mean, or correct the cause."
        )
        findings.append(finding("lean-offset", "error" if abs(mean) >= OFFSET else "warning", text, *_LEAN))
    return findings


def _resting_lean(log: Log, rows: Bools) -> complex:
    """Return theta + j phi [rad] about the body's axes at zero acceleration.

    Averaged over a second, lean = offset + c a / g with the acceleration a of the ball, which is constant on a circle;
    c, above one, depends on the robot and is fitted.
    """
    t, turn = log.t[rows], np.exp(-1j * log["psi"][rows])
    lean = (log["theta"][rows] + 1j * log["phi"][rows]) * turn
    if not {"x_dot", "y_dot"} <= set(log.names):
        return complex(lean.mean())
    velocity = np.nan_to_num(log["x_dot"][rows]) + 1j * np.nan_to_num(log["y_dot"][rows])
    # a positive phi leans towards x, a positive theta away from y
    pull = 1j * np.gradient(velocity, t) * turn
    starts = np.unique(np.floor((t - t[0]) / BLOCK_TIME), return_index=True)[1]
    lean, pull = (np.add.reduceat(one, starts) / np.diff(np.append(starts, len(t))) for one in (lean, pull))
    centred = pull - pull.mean()
    power = max(float(np.vdot(centred, centred).real), 1e-12)
    slope = float(np.vdot(centred, lean - lean.mean()).real) / power
    return complex(lean.mean() - slope * pull.mean())


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
_GYRO = ("gyro_x", "gyro_y", "gyro_z")


def check_stuck(log: Log) -> list[Finding]:
    """Return findings on columns that stay constant for a while though they change at nearly all other rows.

    The finding is an error if other columns show that the robot moved meanwhile, and a warning if it may have been at
    rest, or the motors off. A torque may stay at its extreme, and at rest.
    """
    if len(log) < 2 * STUCK_ROWS:
        return []
    balancing = {*STATE_NAMES} <= set(log.names)
    torques = [name for name in _TORQUES if name in log and balancing]
    found: list[tuple[slice, list[str]]] = []  # rows, and the columns that stand still there
    for name in (*(n for n in log.names if n.startswith(NOISY_PREFIXES)), *torques):
        values, shortest = log[name], FROZEN_TORQUE_TIME if name in torques else STUCK_TIME
        starts, lengths = runs_of(values)
        start, rows = int(starts[np.argmax(lengths)]), int(lengths.max())
        live = len(starts) - 1 >= LIVE_FRACTION * (len(log) - rows) > 0
        extreme = name in torques and 0.999 * np.nanmax(np.abs(values)) <= abs(values[start]) > 0.0
        if rows < max(STUCK_ROWS, shortest / log.sample_time) or not live or extreme:
            continue
        ends = start, start + rows
        together = [
            names
            for one, names in found
            if max(abs(one.start - ends[0]), abs(one.stop - ends[1])) <= TOGETHER
        ]
        if together:
            together[0].append(name)
        else:
            found.append((slice(*ends), [name]))
    return [one for rows, names in found for one in _stuck(log, names, rows, torques)]


def _stuck(log: Log, names: list[str], rows: slice, torques: Sequence[str]) -> list[Finding]:
    """Return the finding on columns that stand still together."""
    of_motors = set(names) <= set(torques)
    others = [name for name in STATE_NAMES[2:] if name in log and name not in names]
    moved = any(np.nanstd(log[name][rows]) > MOVING * np.nanstd(log[name]) for name in others)
    rates = [name for name in (*STATE_NAMES[5:], *_GYRO) if name in names]
    moved |= any(abs(log[name][rows.start]) > MOVING * np.nanstd(log[name]) for name in rates)
    off = of_motors and not any(log[name][rows].any() for name in torques)
    if of_motors:
        half = (rows.stop - rows.start) / 2
        moved |= any(runs_of(log[n][rows])[1].max() < half for n in torques if n not in names)
        if not moved:
            return []
    time = float(log.t[rows.start])
    lasting = float(log.t[rows.stop - 1] - time)
    cause = "messages were lost, or the sensor or the logger froze"
    if of_motors:
        cause = "the motors were off" if off else "messages were lost, or a motor is dead"
    text = (
        f"{', '.join(names)}: one value repeats for {lasting:.3g} s from row {rows.start + 1} (t = {time:.6g} s), and "
        f"nearly all other rows differ: {cause}{'' if moved else ', or everything was at rest'}."
    )
    severity = "error" if moved and lasting >= FROZEN_TIME and not off else "warning"
    return [finding("stuck", severity, text, *names, time=time)]


def check_held(log: Log) -> list[Finding]:
    """Return a finding on columns that repeat each value for a fixed number of rows."""
    names = [n for n in (*STATE_NAMES, *_GYRO, *_TORQUES) if n in log]
    held: dict[str, int] = {}
    for name in names:
        inner = runs_of(log[name])[1][1:-1]
        usual = int(np.median(inner)) if len(inner) >= HELD_TIMES else 1
        off = np.abs(inner - usual) <= (1 if usual > HELD_ROWS else 0)
        if usual >= HELD_ROWS and off.mean() >= HELD_FRACTION:
            held[name] = usual
    if not held:
        return []
    rows = max(held.values())
    delay = rows * log.sample_time
    changes = np.array([np.diff(log[name]) != 0.0 for name in names])
    in_step = changes.all(axis=0).sum() >= HELD_FRACTION * changes.any(axis=0).sum()
    duplicated = set(names) == set(held) and in_step
    if not duplicated and delay < 2.0 * HELD_TIME and not any(name in held for name in STATE_NAMES):
        return []  # a controller slower than its log
    cause = "rows were duplicated" if duplicated else "a slower sensor, or resampling without interpolation"
    text = (
        f"{', '.join(held)}: a new value comes only every {rows} rows, every {delay:.3g} s, and repeats in between: "
        f"{cause}. Values are late by up to that time; keep one row of {rows}, interpolate, or log at their rate."
    )
    return [finding("held", "error" if duplicated or delay >= HELD_TIME else "warning", text, *held)]
