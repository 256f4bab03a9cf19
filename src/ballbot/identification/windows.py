"""Short windows of logs, each predicted from a state at its start, and the intervals that a fit does not see.

The plant is unstable, so an open-loop prediction is meaningful for a fraction of a second only. A window of m samples
starts at row k: the torques are rows k .. k + m - 1, each held until the next, and states k + 1 .. k + m are compared.
The measured initial state is not smoothed: over 35 to 75 ms, which is not causal, that changed no state's error on
other windows by more than 1 %.

Hold-out. Intervals of 8 s in every 28 s of each log: neighbouring windows share a swing of the limit cycle, and a
closed-loop validation needs seconds on end. As 28 s is not a multiple of the 8 s or 32 s with which references often
repeat, the intervals cover different parts of the path.

Back-EMF. A motor on a duty d gives u = n k_t (d V - k_e n w) / R = u_0 - b_e w, with the torque at standstill
u_0 = n k_t V d / R and b_e = n^2 k_t k_e / R. A mapped log has u by the measured speed; in a prediction, the back-EMF
must follow the predicted one. So identification predicts with u_0 = u + b_e w and the viscous friction b + b_e, and
returns b. If b_e is unknown, a duty scaled to a torque may be used as u_0, and the result is b + b_e.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ballbot.arrays import Floats, Ints
from ballbot.errors import InputError
from ballbot.log import STATE_NAMES, Log
from ballbot.log.checks.values import spiked_rows
from ballbot.log.columns import torque_names
from ballbot.log.mapping import DutyTable, motor_resistance, read_mapping
from ballbot.log.pose import measured_wheel_speeds
from ballbot.robot import Robot

#: largest deviation of a sampling interval from the median, as a share of it
LARGEST_JITTER = 0.1
#: with a larger lean, theta or phi, a robot is falling or held by hand [rad]
LARGEST_LEAN = 0.6
#: times within a window at which prediction and measurement are compared in a fit
COMPARISONS = 10

_LEANS = [STATE_NAMES.index("theta"), STATE_NAMES.index("phi")]


def standstill_torques(log: Log, robot: Robot, back_emf: float) -> Log:
    """Return the log with u_0 in place of u; InputError if b_e, `back_emf` [N m s/rad], is negative or not finite."""
    if not (math.isfinite(back_emf) and back_emf >= 0.0):
        raise InputError(f"back_emf is {back_emf!r}; it must be n^2 k_t k_e / R in N m s/rad, zero or more.")
    speeds = measured_wheel_speeds(log, robot)
    names = torque_names(robot.wheel_count)
    return log.with_columns({name: log[name] + back_emf * speeds[:, i] for i, name in enumerate(names)})


def back_emf_of(mappings: Sequence[str | Path], robot: Robot) -> float:
    """Return b_e [N m s/rad] of the motors in mapping files, zero without duties; InputError if they differ."""
    drives = [(read.input, motor_resistance(read, robot)) for read in map(read_mapping, mappings)]
    values = {round(drive.back_emf(R) if isinstance(drive, DutyTable) else 0.0, 12) for drive, R in drives}
    if len(values) > 1:
        raise InputError(
            f"The motors of the mappings have back-EMF damping of {', '.join(f'{b:g}' for b in sorted(values))} N m "
            "s/rad; logs of one robot must have the same motor constants."
        )
    return values.pop() if values else 0.0


class Span(NamedTuple):
    """Log, start and end of a window."""

    log: int  #: which of the logs, from 0
    start: float  #: time of the window's start [s]
    end: float  #: time of its last compared state [s]


@dataclass(frozen=True, kw_only=True, eq=False)
class Windows:
    """w windows of m samples each."""

    initial: Floats  #: (w, 10), initial states
    torques: Floats  #: (w, m, n) [N m]
    measured: Floats  #: (w, m, 10), states after each sample
    earlier: Floats  #: (w, h, n), torques of the h rows before the start
    spin: Floats  #: (w,), of the ball about the vertical at the start [rad/s], or NaN
    spans: tuple[Span, ...]  #: (w,)
    sample_time: float  #: [s]

    def __len__(self) -> int:
        return len(self.initial)

    @property
    def samples(self) -> int:
        """Samples in each window, m."""
        return self.torques.shape[1]

    @property
    def comparison_interval(self) -> int:
        """Samples between the comparisons of a fit."""
        return self.samples // min(COMPARISONS, self.samples)

    def take(self, rows: Ints) -> Windows:
        """Return the windows in these rows."""
        arrays = {name: getattr(self, name)[rows] for name in _ARRAYS}
        return Windows(**arrays, spans=tuple(self.spans[row] for row in rows), sample_time=self.sample_time)


#: fields of `Windows` with a row a window
_ARRAYS = ("initial", "torques", "measured", "earlier", "spin")


def cut_windows(
    logs: Sequence[Log],
    *,
    wheel_count: int,
    duration: float,
    history: int = 0,
    spins: Sequence[Floats] | None = None,
) -> Windows:
    """Cut logs into windows that lie end to end; InputError if a log lacks a column, or the sample times differ.

    The duration of a window [s] is rounded to samples, and to a multiple of `COMPARISONS` samples if it has more.
    Windows with a missing or corrupted value, an uneven sampling interval or a lean past recovery are left out. One
    needs `history` rows of torques before its start; `spins` has the ball's spin (N,) [rad/s] in the rows of each log.
    """
    sample_time = common_sample_time(logs, duration=duration)
    names = (*STATE_NAMES, *torque_names(wheel_count))
    samples = round(duration / sample_time)
    samples = COMPARISONS * round(samples / COMPARISONS) if samples >= COMPARISONS else samples
    columns: dict[str, list[Floats]] = {name: [] for name in _ARRAYS}
    spans = list[Span]()
    for number, log in enumerate(logs):
        values = np.column_stack([log[name] for name in names])
        for name, column in zip(names, values.T, strict=True):
            if not np.isfinite(column).any():
                raise InputError(
                    f"{_named(number + 1, logs)}'s column {name} has no value in any row; identification needs it."
                )
        states, torques = np.split(values, [len(STATE_NAMES)], axis=1)
        usable = np.isfinite(values).all(axis=1) & ~spiked_rows(log, names)
        usable &= (np.abs(states[:, _LEANS]) < LARGEST_LEAN).all(axis=1)
        follows = usable[1:] & usable[:-1]
        follows &= np.abs(np.diff(log.t) - log.sample_time) <= LARGEST_JITTER * log.sample_time
        edges = np.flatnonzero(np.diff(np.concatenate([[False], follows, [False]]))).reshape(-1, 2)
        between = [np.arange(a + history, b + 1 - samples, samples) for a, b in edges]
        starts = np.concatenate([np.empty(0, dtype=np.int64), *between])
        rows = starts[:, None] + np.arange(samples + 1)
        columns["initial"].append(states[starts])
        columns["torques"].append(torques[rows[:, :-1]])
        columns["measured"].append(states[rows[:, 1:]])
        columns["earlier"].append(torques[starts[:, None] + np.arange(-history, 0)])
        columns["spin"].append(np.full(len(starts), np.nan) if spins is None else spins[number][starts])
        times = log.t[rows[:, [0, -1]]].tolist()
        spans += [Span(log=number, start=start, end=end) for start, end in times]
    return Windows(
        **{name: np.concatenate(pieces) for name, pieces in columns.items()},
        spans=tuple(spans),
        sample_time=sample_time,
    )


def common_sample_time(logs: Sequence[Log], *, duration: float) -> float:
    """Return the common sample time [s] of logs to be cut into windows; InputError if they differ or are too short."""
    for number, log in enumerate(logs, start=1):
        if len(log) < 2:
            raise InputError(f"{_named(number, logs)} has one row; a prediction needs at least two.")
    sample_time = logs[0].sample_time
    for log in logs[1:]:
        if abs(log.sample_time - sample_time) > 0.01 * sample_time:
            raise InputError(
                f"The logs have sample times of {sample_time:g} and "
                f"{log.sample_time:g} s; they must have the same sample time."
            )
    if not 2.0 * sample_time <= duration < np.inf:
        raise InputError(
            f"The window is {duration:g} s long; it must be at least two samples, {2 * sample_time:g} s."
        )
    return sample_time


def _named(number: int, logs: Sequence[Log]) -> str:
    return "The log" if len(logs) == 1 else f"Log {number}"


#: fraction of each log that a fit does not see
HELD_OUT = 2 / 7
#: period of the held-out intervals, and start of the interval within it [s]
_HOLDOUT_CYCLE, _HOLDOUT_OFFSET = 28.0, 12.0


def holdout_intervals(log: Log, *, fraction: float = HELD_OUT) -> tuple[tuple[float, float], ...]:
    """Return the held-out intervals (start, end) [s]; a log shorter than a cycle has one, in proportion."""
    first, duration = float(log.t[0]), float(log.t[-1] - log.t[0])
    cycle = min(_HOLDOUT_CYCLE, duration)
    length = fraction * cycle
    offset = min(_HOLDOUT_OFFSET * cycle / _HOLDOUT_CYCLE, cycle - length)
    starts = np.arange(offset, max(duration - 0.5 * length, np.nextafter(offset, np.inf)), cycle)
    ends = np.minimum(starts + length, duration)
    return tuple((first + float(start), first + float(end)) for start, end in zip(starts, ends, strict=True))


def split_in_time(
    spans: Sequence[Span], held_out: Sequence[Sequence[tuple[float, float]]]
) -> tuple[Ints, Ints]:
    """Return the rows of the windows to fit and of those held out, at least one.

    A window is held out if it overlaps an interval of its log; `held_out` has the intervals (start, end) [s] of each.
    """
    held = np.array(
        [any(span.start < end and start < span.end for start, end in held_out[span.log]) for span in spans],
        dtype=bool,
    )
    if len(held) and not held.any():
        held[len(held) // 2] = True
    return np.flatnonzero(~held), np.flatnonzero(held)
