"""Check each column by itself: gaps, missing values, spikes, jumps, limits, falls, dead, frozen and slow columns.

A value is a spike if it differs from both neighbouring rows, to the same side, by more than five times the range of
nearly all others: a corrupted message, or a marker such as 9999 for a missing one. A motion takes several rows to get
there and back, and noise of that size would affect many rows. One value to which a signal jumps again and again is
one, too (`ballbot.log.signals.dropouts`).

Positions and angles must change from row to row by the integral of their rates. The mean lean of a balancing robot is
near zero, since a constant lean is a constant acceleration. Sensors with noise never repeat a value to the last bit; a
robot at rest, an encoder at rest and a noiseless simulation may, so that rows at rest, by their rates, give no finding.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import combinations

import numpy as np

from ballbot.arrays import Bools, Floats
from ballbot.errors import nearest
from ballbot.findings import Finding
from ballbot.log.checks.table import CHECKS, judged
from ballbot.log.columns import (
    KNOWN_NAMES,
    MAX_WHEELS,
    POSITION_NAMES,
    STATE_NAMES,
    TRUE_PREFIX,
    torque_names,
    unit_of,
    wheel_angle_names,
    wheel_speed_names,
)
from ballbot.log.log import Log
from ballbot.log.signals import LIVE_FRACTION, dropouts, runs_of
from ballbot.robot import Drive, Robot
from ballbot.summary import counted

#: an interval this many times the longest usual one is a gap; one missing row of a regular log gives 2
GAP_RATIO = 1.5
FALLEN_LEAN = 0.6  #: [rad], from which no ball-balancing robot of this kind recovers
#: smallest jump beyond the integral of the rates [m, m, rad, rad, rad]; and so many times the usual change
LEAST_JUMP, FAR = {"x": 0.08, "y": 0.08, "theta": 0.08, "phi": 0.08, "psi": 0.2}, 30.0
#: standard deviation of a state that moves [m, rad, m/s, rad/s], and of the ball's velocity if the robot does [m/s]
LEAST_MOVING, LEAST_SPEED = 1e-3, 2e-3
#: a live column (`LIVE_FRACTION`) that stays constant for so long [rows, s] has a fault
STUCK_ROWS, STUCK_TIME = 10, 0.1
#: shortest standstill of a torque that is not at its extreme [s]
FROZEN_TORQUE_TIME = 1.0
#: a state moves, and a rate is not one of rest, above this fraction of its standard deviation
MOVING = 0.2
#: a slower column repeats a value for so many rows, at least so often, in this fraction of cases equally long
HELD_ROWS, HELD_TIMES, HELD_FRACTION = 2, 20, 0.8

_TORQUES, _LEAN = torque_names(MAX_WHEELS), ("theta", "phi")
_RATES = (*STATE_NAMES[5:], "gyro_x", "gyro_y", "gyro_z")
#: references and true states, which no sensor measures
_NOT_MEASURED = ("ref_", TRUE_PREFIX)


def spikes(values: Floats) -> Bools:
    """Return which rows of a signal (N,) are spikes; the first and the last, and missing values, never are."""
    is_spike = np.zeros(len(values), dtype=bool)
    rows = np.flatnonzero(np.isfinite(values))
    if rows.size < 50:  # the usual range is unknown
        return is_spike
    known = values[rows]
    there, back = np.diff(known)[:-1], -np.diff(known)[1:]
    off = np.where(there * np.sign(back) > 0.0, np.minimum(np.abs(there), np.abs(back)), 0.0)
    excluded = math.ceil(0.005 * known.size)
    ordered = np.sort(known)
    usual = ordered[-1 - excluded] - ordered[excluded]
    is_spike[rows[1:-1]] = (usual > 0.0) & (off > 5.0 * usual)
    return is_spike


def spiked_rows(log: Log, names: Sequence[str]) -> Bools:
    """Return which rows of a log (N,) have a spike in one of these columns."""
    return np.any([_spikes_of(log, name, None) for name in names], axis=0)


def _spikes_of(log: Log, name: str, _: object) -> Bools:
    """Return which rows of a column (N,) are spikes; a torque or a speed by counts may rightly be 0 again and again."""
    may_be_zero = name in _TORQUES or name.endswith("_dot")
    return spikes(log[name]) if may_be_zero else spikes(log[name]) | dropouts(log[name])


def _rows_at_top(log: Log, name: str, _: object) -> Floats:
    """Return for how many rows (N,) a torque stays at its largest value; zero elsewhere, or if it always does."""
    size = np.nan_to_num(np.abs(log[name]))
    top = (size == size.max()) & (size > 0.0)
    starts, lengths = runs_of(top.astype(np.float64))
    return np.repeat(np.where(top[starts], lengths, 0), lengths) * float(not top.all())


def _jumps(log: Log, name: str, _: object) -> Floats:
    """Return the change (N,) of a position or angle that its rate does not explain, over the least jump."""
    if f"{name}_dot" not in log or len(log) < 4:
        return np.zeros(len(log))
    values, rate, intervals = log[name], log[f"{name}_dot"], np.diff(log.t)
    change = np.abs(np.nan_to_num(np.diff(values) - 0.5 * (rate[1:] + rate[:-1]) * intervals))
    # across a gap, any change up to the largest rate is possible
    gap = np.where(intervals > 1.5 * log.sample_time, 2.0 * np.nanmax(np.abs(rate)) * intervals, 0.0)
    least = LEAST_JUMP[name] + FAR * float(np.median(change)) + gap
    spiked = spikes(values)
    return np.concatenate(([0.0], np.where(spiked[1:] | spiked[:-1], 0.0, change / least)))


def _longest_usual(log: Log) -> float:
    """Return the longest interval without a gap [s].

    By the 95th percentile, not the median: logs whose host polls late alternate between two intervals.
    """
    return GAP_RATIO * float(np.quantile(np.diff(log.t), 0.95, method="lower")) if len(log) > 3 else math.inf


def _gaps(log: Log, *_: object) -> Floats:
    """Return the interval (N,) [s] after each row, if rows are missing there."""
    intervals = np.append(np.diff(log.t), 0.0)
    return np.where(intervals > _longest_usual(log), intervals, 0.0)


#: faults in single rows of a signal: the key, the signals that may have it, and the statistic of each row (N,)
ROW_CHECKS: tuple[tuple[str, tuple[str, ...], Callable[[Log, str, Drive | None], Floats | Bools]], ...] = (
    ("gap", ("t",), _gaps),
    # accelerometers measure shocks, and references may jump
    ("spike", tuple(n for n in KNOWN_NAMES[1:] if not n.startswith(("acc_", *_NOT_MEASURED))),
     _spikes_of),
    ("wrap", wheel_angle_names(MAX_WHEELS),
     lambda log, name, _: np.abs(np.abs(np.diff(log[name], prepend=log[name][:1])) - 2.0 * np.pi) < 0.5),
    ("jump", POSITION_NAMES, _jumps),
    ("saturation", _TORQUES, _rows_at_top),
    ("torque-limit", _TORQUES,
     lambda log, name, drive: np.abs(log[name]) / (drive.torque_limit if drive else math.inf)),
    ("speed-limit", wheel_speed_names(MAX_WHEELS),
     lambda log, name, drive: np.abs(log[name]) / (drive.top_speed if drive else math.inf)),
)  # fmt: skip


def check_rows(log: Log, robot: Robot | None) -> Iterator[Finding]:
    """Return a finding for each column with rows beyond the limit of one of `ROW_CHECKS`."""
    drive = robot.drive if robot else None
    limits = {"torque": drive.torque_limit, "speed": drive.top_speed} if drive else {}
    for key, signals, statistic in ROW_CHECKS:
        for name in (name for name in signals if name in log):
            size = statistic(log, name, drive)
            over = np.flatnonzero(size > min(CHECKS[key][0].values()))
            if over.size:
                k, times = int(over[0]), counted(over.size, "row" if key != "gap" else "place")
                yield from judged(
                    key, [name], size.max(), float(log.t[k]), name=name, rows=times, place=_place(log, k),
                    first=size[k], value=float(log[name][k]), unit=unit_of(name), period=log.sample_time,
                    largest=size.max(), **limits,
                )  # fmt: skip


def _place(log: Log, row: int) -> str:
    return f"row {row + 1} (t = {log.t[row]:.6g} s)"


def check_jitter(log: Log) -> list[Finding]:
    """Return a warning if the intervals without gaps vary."""
    if len(log) < 4:
        return []
    usual = np.diff(log.t)
    usual = usual[usual <= _longest_usual(log)]
    scatter, period = float(usual.std() / np.median(usual)), log.sample_time
    numbers = {"percent": 100 * scatter, "period": period, "least": usual.min(), "most": usual.max()}
    return judged("jitter", ["t"], scatter, **numbers)


def check_missing_values(log: Log) -> Iterator[Finding]:
    """Return a warning for each set of columns in which the same cells are NaN or infinite."""
    columns: dict[bytes, list[str]] = {}
    for name in log.names:
        columns.setdefault(np.isfinite(log[name]).tobytes(), []).append(name)
    for known, names in columns.items():
        bad = np.flatnonzero(~np.frombuffer(known, dtype=np.bool_))
        if bad.size:
            place, t = _place(log, int(bad[0])), float(log.t[bad[0]])
            numbers = {"names": ", ".join(names), "count": bad.size, "rows": len(log), "place": place}
            yield from judged("missing", names, bad.size, t, **numbers)


def check_names(log: Log) -> list[Finding]:
    """Return a note on columns that Ballbot does not know, with the name that was perhaps meant."""
    unknown = [name for name in log.names if name not in KNOWN_NAMES]
    meant = {name: nearest(name, KNOWN_NAMES, likeness=0.8) for name in unknown}
    listed = [f"{name} (did you mean {near[0]}?)" if near else name for name, near in meant.items()]
    return judged("unknown", unknown, len(unknown), listed=", ".join(listed))


def is_constant(values: Floats) -> bool:
    """Return whether a column (N,) of several rows never changes; one without any value does not."""
    known = values[np.isfinite(values)]
    return known.size > 1 and bool(np.all(known == known[0]))


def check_copies(columns: Mapping[str, Floats], names: Sequence[str]) -> Iterator[Finding]:
    """Return the error of each two columns of sensors or motors that have the same values, and change."""
    for one, other in combinations([name for name in names if name in columns], 2):
        first, second = columns[one], columns[other]
        changes = np.unique(first[np.isfinite(first)]).size > 1
        if changes and np.array_equal(first, second, equal_nan=True):
            yield from judged("copied", [one, other], one=one, other=other)


def check_log_copies(log: Log) -> Iterator[Finding]:
    """Return the errors of `check_copies`; torques and wheels of a robot on a bench may rightly be the same."""
    axes = [("theta", "phi"), ("gyro_x", "gyro_y", "gyro_z"), ("acc_x", "acc_y", "acc_z")]
    if {*STATE_NAMES} <= set(log.names):
        axes += [names(MAX_WHEELS) for names in (torque_names, wheel_angle_names, wheel_speed_names)]
    for names in axes:
        yield from check_copies(log.columns, names)


def check_constant(log: Log) -> Iterator[Finding]:
    """Return a finding for each column that never changes, or one for a log at rest: no sensor and no torque changes.

    It is an error if the column is a state whose rate, or angle, changes, or the torque of a robot that balances and
    moves; and a note if it is a reference.
    """
    names = [name for name in log.names if name != "t" and not name.startswith(TRUE_PREFIX)]
    still = [name for name in names if len(log) > 1 and np.all(log[name] == log[name][0])]
    sensors = [name for name in names if not name.startswith(_NOT_MEASURED)]
    if len(sensors) > 1 and set(sensors) <= set(still):
        yield from judged("constant: all", sensors, duration=log.t[-1] - log.t[0])
        return
    moves = {*STATE_NAMES} <= set(names) and float(np.nanstd([log["x_dot"], log["y_dot"]])) > LEAST_SPEED
    dead = [name for name in still if name in _TORQUES and moves]
    values = ", ".join(f"{name} is {log[name][0] + 0.0:.3g} N m" for name in dead)
    yield from judged("dead-motor", dead, len(dead), values=values)
    for name in (name for name in still if name not in dead):
        other = name.removesuffix("_dot") if name.endswith("_dot") else f"{name}_dot"
        wrong = name in STATE_NAMES and other in log and float(np.nanstd(log[other])) > LEAST_MOVING
        key = "constant: reference" if name.startswith("ref_") else "constant"
        though = f" though {other} changes" if wrong else ""
        yield from judged(key, [name], 1.0 + wrong, name=name, value=log[name][0], though=though)


def check_lean(log: Log) -> Iterator[Finding]:
    """Return findings on a lean in degrees, or a fall; and on a balancing robot's mean lean."""
    if not {*_LEAN} <= set(log.names):
        return
    # missing values have a finding of their own
    lean = np.nan_to_num(np.hypot(log["theta"], log["phi"]), posinf=0.0)
    fallen, peak = np.flatnonzero(lean > FALLEN_LEAN), float(lean.max())
    if fallen.size:
        times, t = 1 + int(np.count_nonzero(np.diff(fallen) > 1)), float(log.t[fallen[0]])
        key = "degrees: lean" if times >= 3 or peak > np.pi / 2 else "fall"
        numbers = {"limit": FALLEN_LEAN, "times": times, "peak": peak, "t": t, "row": fallen[0] + 1}
        yield from judged(key, _LEAN, math.inf, t, **numbers)
    rows: Bools = np.all(np.isfinite([log[name] for name in (*_LEAN, "psi") if name in log]), axis=0)
    rows[fallen[0] if fallen.size else len(rows) :] = False
    # over shorter times a balancing robot's lean has a mean
    if "psi" in log and rows.sum() >= 2 and np.ptp(log.t[rows]) >= 8.0:
        lean_of_body = (log["theta"][rows] + 1j * log["phi"][rows]) * np.exp(-1j * log["psi"][rows])
        mean = complex(lean_of_body.mean())
        theta, phi = np.degrees([mean.real, mean.imag])
        yield from judged("lean-offset", _LEAN, abs(mean), theta=theta, phi=phi)


def check_stuck(log: Log) -> Iterator[Finding]:
    """Return findings on columns that stay constant for a while though they change at nearly all other rows.

    The finding is an error if other columns show that the robot moved meanwhile, and a warning if it may have been at
    rest, or the motors off. A torque may stay at its extreme, and at rest. An encoder may rightly stay constant.
    """
    if len(log) < 2 * STUCK_ROWS:
        return
    torques = [name for name in _TORQUES if name in log and {*STATE_NAMES} <= set(log.names)]
    noisy = [n for n in log.names if n.startswith(("theta", "phi", "psi", "gyro_", "acc_", "ball_omega_"))]
    together: dict[tuple[int, int], list[str]] = {}  # the columns that are constant between two rows
    for name in (*noisy, *torques):
        values, shortest = log[name], FROZEN_TORQUE_TIME if name in torques else STUCK_TIME
        starts, lengths = runs_of(values)
        start, rows = int(starts[np.argmax(lengths)]), int(lengths.max())
        end, live = start + rows, len(starts) - 1 >= LIVE_FRACTION * (len(log) - rows) > 0
        extreme = name in torques and 0.999 * np.nanmax(np.abs(values)) <= abs(values[start]) > 0.0
        if rows >= max(STUCK_ROWS, shortest / log.sample_time) and live and not extreme:
            together.setdefault((start, end), []).append(name)
    for (start, end), names in together.items():
        of_motors, parts = set(names) <= set(torques), {name: log[name][start:end] for name in log.names}
        others = [name for name in STATE_NAMES[2:] if name in log and name not in names]
        moved = any(np.nanstd(parts[name]) > MOVING * np.nanstd(log[name]) for name in others)
        moved |= any(abs(parts[n][0]) > MOVING * np.nanstd(log[n]) for n in _RATES if n in names)
        off = of_motors and not any(parts[name].any() for name in torques)
        if moved or not of_motors:
            what = "a motor is dead" if of_motors else "the sensor or the logger froze"
            cause = "the motors were off" if off else f"messages were lost, or {what}"
            cause += "" if moved else ", or everything was at rest"
            lasting, t = float(log.t[end - 1] - log.t[start]), float(log.t[start])
            numbers = {"names": ", ".join(names), "lasting": lasting, "cause": cause}
            size = lasting if moved and not off else 0.0
            yield from judged("stuck", names, size, t, place=_place(log, start), **numbers)


def check_held(log: Log) -> list[Finding]:
    """Return a finding on columns that repeat each value for a fixed number of rows."""
    names = [n for n in (*STATE_NAMES, *_RATES[5:], *_TORQUES) if n in log]
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
    if not duplicated and delay < 0.08 and held.keys().isdisjoint(STATE_NAMES):
        return []  # a controller slower than its log
    cause = "rows were duplicated" if duplicated else "a slower sensor, or resampling without interpolation"
    size = math.inf if duplicated else delay
    return judged("held", [*held], size, names=", ".join(held), rows=rows, delay=delay, cause=cause)
