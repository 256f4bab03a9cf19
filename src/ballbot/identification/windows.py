"""Short windows of logs, and models of the motors, sensors and delays between robot and log.

Back-EMF. A motor driven by voltage is braked in proportion to its speed. On a duty d it gives u = n k_t (d V - k_e n w)
/ R = u_0 - b_e w, with the torque at standstill u_0 = n k_t V d / R and b_e = n^2 k_t k_e / R. A log of duties is
converted to torques u with the measured speed w. The command is u_0, though, and in a prediction the back-EMF must
follow the predicted speed. So identification predicts with u_0 = u + b_e w and the viscous friction b + b_e, and
returns b. If b_e is unknown, a duty scaled to a torque may be used as u_0, and the identified viscous friction is
b + b_e.

Hold-out. Intervals of 8 s in every 28 s of each log are held out: neighbouring windows share a swing of the limit
cycle, and a closed-loop validation needs seconds on end. As 28 s is not a multiple of the 8 s or 32 s with which
references often repeat, the intervals cover different parts of the path.

Windows. Each is predicted from a state at its start: in a fit one that is estimated (`balancing`), on held-out windows
the one measured. The plant is unstable, so an open-loop prediction is
meaningful for a fraction of a second only. A window of m samples starts at row k: the torques are rows k .. k + m - 1,
each held until the next, and states k + 1 .. k + m are compared. Windows with a missing or corrupted value
(`ballbot.log.checks.values`), an uneven sampling interval or a lean past recovery are left out.

The measured initial state is not smoothed. Smoothing over 35 to 75 ms, which is not causal, changed no state's error on
other windows by more than 1 %, on logs with encoder counts and gearbox play.

Torques. Over the sample that begins at row k, the torque that acts on wheel i is

    gain_i ((1 - f) u_i[k - m] + f u_i[k - m - 1]) + offset_i        delay = (m + f) sample times, 0 <= f < 1

A torque that is late by a fraction f of a sample has its old value in the first part of the sample. Here the weighted
mean of both values acts throughout, with the same impulse a sample.

Sensors. An IMU that is tilted by small angles (a, b) about the body's x and y axes reads R Rx(a) Ry(b) instead of
R = Rx(theta) Ry(phi) Rz(psi); a centre of mass off the axis has the same effect. To first order it reads

    theta + a cos psi - b sin psi        phi + a sin psi + b cos psi

and the gyro's bias (g_x, g_y, g_z) appears in the rates of the lean likewise. The bias about z adds to psi_dot, and a
heading that is the integral of psi_dot drifts by g_z times the time since the start.

Sensor delays. The angles or velocities in a row may be older than its positions: an IMU's message waits for the next
row, and its filter lags; velocities from differenced encoder counts are means over the last sample. Of a state whose
sensor is late by d, row k then shows

    seen_k = state(t_k - d)                with linear interpolation between samples

Delays are relative to the positions x and y. The initial state of a window is seen late too: the true one is ahead by d
times the slope of a first sample, simulated from what was seen.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.identification.quantities import Layout
from ballbot.log import STATE_NAMES, Log
from ballbot.log.checks.values import spiked_rows
from ballbot.log.columns import torque_names, wheel_speed_names
from ballbot.log.mapping import DutyTable, read_mapping
from ballbot.log.pose import measured_wheel_speeds
from ballbot.mechanics.geometry import body_rates_matrix, rotation, transforms
from ballbot.robot import Robot


def ball_spin(log: Log, robot: Robot) -> NDArray[np.float64]:
    """Return the ball's spin about the vertical (N,) [rad/s], from the encoders and the body's rates.

    The encoders measure A (z - w), with the rates w of the body and z = R^T Omega of the ball in the body frame, so the
    spin is the vertical component of R (A^-1 wheel speeds + w). InputError if the log has no wheel speeds.
    """
    names = wheel_speed_names(robot.wheel_count)
    if not all(name in log for name in names):
        raise InputError(
            f"To estimate pivoting, the log needs the wheel speeds {names[0]} .. {names[-1]}, "
            "which it does not have; exclude the heading from the cost instead."
        )
    angles, rates = _state_columns(log)[:, 2:5], _state_columns(log)[:, 7:10]
    w = (body_rates_matrix(*angles.T) @ rates[..., None])[..., 0]
    z = measured_wheel_speeds(log, robot) @ transforms(robot).T_obw.T + w
    return (rotation(*angles.T)[:, 2] * z).sum(axis=1)


def _state_columns(log: Log) -> NDArray[np.float64]:
    return np.column_stack([log[name] for name in STATE_NAMES])


def standstill_torques(log: Log, robot: Robot, back_emf: float) -> Log:
    """Return the log with the standstill torques u_0 in place of u.

    `back_emf` is b_e [N m s/rad], the same for every motor; InputError if it is negative or not finite.
    """
    if not (math.isfinite(back_emf) and back_emf >= 0.0):
        raise InputError(f"back_emf is {back_emf!r}; it must be n^2 k_t k_e / R in N m s/rad, zero or more.")
    speeds = measured_wheel_speeds(log, robot)
    names = torque_names(robot.wheel_count)
    return log.with_columns({name: log[name] + back_emf * speeds[:, i] for i, name in enumerate(names)})


def back_emf_of(mappings: Sequence[str | Path]) -> float:
    """Return b_e [N m s/rad] of the motors in mapping files; zero if the logs have torques or currents.

    InputError if a file cannot be read or is not a mapping, or the mappings have different b_e.
    """
    drives = [read_mapping(mapping).input for mapping in mappings]
    values = {round(drive.back_emf if isinstance(drive, DutyTable) else 0.0, 12) for drive in drives}
    if len(values) > 1:
        raise InputError(
            "The motors of the mappings have back-EMF damping of "
            f"{', '.join(f'{b:g}' for b in sorted(values))} N m s/rad; logs of one "
            "robot must have the same supply voltage, resistance and motor constants."
        )
    return values.pop() if values else 0.0


#: largest deviation of a sampling interval from the median, as a share of it
LARGEST_JITTER = 0.1
#: with a larger lean, theta or phi, a robot is falling or held by hand [rad]
LARGEST_LEAN = 0.6
#: times within a window at which prediction and measurement are compared in a fit
COMPARISONS = 10

_LEANS = [STATE_NAMES.index("theta"), STATE_NAMES.index("phi")]


@dataclass(frozen=True, kw_only=True)
class Span:
    """Log, start and end of a window."""

    log: int  #: which of the logs, from 0
    start: float  #: time of the window's start [s]
    end: float  #: time of its last compared state [s]


@dataclass(frozen=True, kw_only=True, eq=False)
class Windows:
    """w windows of m samples each."""

    initial: NDArray[np.float64]  #: (w, 10), initial states
    torques: NDArray[np.float64]  #: (w, m, n) [N m]
    measured: NDArray[np.float64]  #: (w, m, 10), states after each sample
    earlier: NDArray[np.float64]  #: (w, h, n), torques of the h rows before the start
    #: (w,), the ball's spin about the vertical at the start [rad/s]; NaN if not measured
    spin: NDArray[np.float64]
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

    def take(self, rows: NDArray[np.int64]) -> Windows:
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
    before: Callable[[float], int] | None = None,
    spins: Sequence[NDArray[np.float64]] | None = None,
) -> Windows:
    """Cut logs, with the ten state columns and u1 .. un, into windows that lie end to end.

    The duration of a window [s] is rounded to samples, and to a multiple of `COMPARISONS` samples if it has more.
    `before` returns, for a sample time, how many rows of torques before its start a window needs; `spins` has the
    ball's spin (N,) [rad/s] in the rows of each log. InputError if there is no log, a column is missing or empty, the
    sample times differ, or the duration is invalid.
    """
    sample_time = common_sample_time(logs, duration=duration)
    for number, log in enumerate(logs, start=1):
        for name in (*STATE_NAMES, *torque_names(wheel_count)):
            if not np.isfinite(log[name]).any():
                raise InputError(
                    f"{_named(number, logs)}'s column {name} has no value in any row; identification needs it."
                )
    samples = round(duration / sample_time)
    samples = COMPARISONS * round(samples / COMPARISONS) if samples >= COMPARISONS else samples

    history = before(sample_time) if before else 0
    spins = spins or [np.full(len(log), np.nan) for log in logs]
    pieces = [
        _cut(number, log, spin, wheel_count=wheel_count, samples=samples, history=history)
        for number, (log, spin) in enumerate(zip(logs, spins, strict=True))
    ]
    return Windows(
        **{name: np.concatenate([getattr(piece, name) for piece in pieces]) for name in _ARRAYS},
        spans=tuple(span for piece in pieces for span in piece.spans),
        sample_time=sample_time,
    )


def common_sample_time(logs: Sequence[Log], *, duration: float) -> float:
    """Return the common sample time [s] of logs to be cut into windows of this duration [s].

    InputError if there is no log, a log has one row, the sample times differ, or the duration is invalid.
    """
    if not logs:
        raise InputError("Identification needs at least one log.")
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


def split(count: int, *, held_out: float, seed: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Divide rows 0 .. count - 1 at random into those to fit and those held out, at least one; both sorted."""
    order = np.random.default_rng(seed).permutation(count)
    kept = max(1, round(held_out * count))
    return np.sort(order[kept:]), np.sort(order[:kept])


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
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
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


def _named(number: int, logs: Sequence[Log]) -> str:
    return "The log" if len(logs) == 1 else f"Log {number}"


def _cut(
    number: int, log: Log, spin: NDArray[np.float64], *, wheel_count: int, samples: int, history: int
) -> Windows:
    """Return one log's windows."""
    states = np.column_stack([log[name] for name in STATE_NAMES])
    torques = np.column_stack([log[name] for name in torque_names(wheel_count)])
    runs = _even_runs(log, states, torques)
    starts = np.array(
        [k for first, end in runs for k in range(first + history, end - samples, samples)], dtype=np.int64
    )
    rows = starts[:, None] + np.arange(samples + 1)
    return Windows(
        initial=states[starts],
        torques=torques[rows[:, :-1]],
        measured=states[rows[:, 1:]],
        earlier=torques[starts[:, None] + np.arange(-history, 0)],
        spin=spin[starts],
        spans=tuple(Span(log=number, start=float(log.t[k[0]]), end=float(log.t[k[-1]])) for k in rows),
        sample_time=log.sample_time,
    )


def _even_runs(
    log: Log, states: NDArray[np.float64], torques: NDArray[np.float64]
) -> Iterator[tuple[int, int]]:
    """Yield (first, end) of the longest runs of complete, uncorrupted rows at even intervals."""
    complete = np.all(np.isfinite(states), axis=1) & np.all(np.isfinite(torques), axis=1)
    complete &= ~spiked_rows(log, (*STATE_NAMES, *torque_names(torques.shape[1])))
    usable = complete & np.all(np.abs(states[:, _LEANS]) < LARGEST_LEAN, axis=1)
    even: NDArray[np.bool_] = np.abs(np.diff(log.t) - log.sample_time) <= LARGEST_JITTER * log.sample_time
    follows = usable[1:] & usable[:-1] & even
    edges = np.flatnonzero(np.diff(np.concatenate([[False], follows, [False]])))
    for first, last in edges.reshape(-1, 2):
        yield int(first), int(last) + 1


_PSI = 4


def acting_torques(
    layout: Layout, values: NDArray[np.float64], windows: Windows
) -> NDArray[np.float64] | None:
    """Return the acting torques (sets, w, m, n) by parameters (sets, p); None if they are those logged."""
    gain, offset, delay = (layout.part(name, values) for name in ("torque_gain", "torque_offset", "delay"))
    if gain is None and offset is None and delay is None:
        return None
    if delay is None:
        u = np.broadcast_to(windows.torques, (len(values), *windows.torques.shape))
    else:
        u = _delayed(delay[:, 0] / windows.sample_time, windows)
    if gain is not None:
        u = u * gain[:, None, None, :]
    if offset is not None:
        u = u + offset[:, None, None, :]
    return u


def sensor_offsets(
    layout: Layout, values: NDArray[np.float64], states: NDArray[np.float64], times: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    """Return the sensor errors (sets, w, k, 10) by parameters (sets, p); None if no parameter is a bias.

    The heading of the measured `states` (w, k, 10) gives the orientation; `times` (k,) [s] are since the window's
    start.
    """
    lean, gyro = layout.part("lean_bias", values), layout.part("gyro_bias", values)
    if lean is None and gyro is None:
        return None
    offsets = np.zeros((len(values), *states.shape))
    if lean is not None:
        offsets[..., 2], offsets[..., 3] = _turned(lean, states)
    if gyro is not None:
        offsets[..., 7], offsets[..., 8] = _turned(gyro, states)
        about_z = gyro[:, 2, None, None]
        offsets[..., 9] = about_z
        offsets[..., _PSI] = about_z * times
    return offsets


def samples_before(layout: Layout, upper: NDArray[np.float64], sample_time: float) -> int:
    """Return how many rows of torques before a window parameters up to `upper` (p,) need."""
    delay = layout.part("delay", upper)
    return 0 if delay is None else int(np.floor(delay[0] / sample_time + 1e-9)) + 1


def _delayed(samples: NDArray[np.float64], windows: Windows) -> NDArray[np.float64]:
    """Return the torques (sets, w, m, n), delayed by so many samples (sets,)."""
    record = np.concatenate([windows.earlier, windows.torques], axis=1)
    before, count = windows.earlier.shape[1], windows.samples
    full = np.minimum(np.floor(samples).astype(np.int64), before - 1)
    late = np.empty((len(samples), *windows.torques.shape))
    for i, (m, f) in enumerate(zip(full, samples - full, strict=True)):
        first = before - m
        now, previous = record[:, first : first + count], record[:, first - 1 : first - 1 + count]
        late[i] = (1.0 - f) * now + f * previous
    return late


def _turned(
    pair: NDArray[np.float64], states: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return a pair about the body's axes (sets, 2 or more) about the axes of lean, (sets, w, k) each."""
    a, b = pair[:, 0, None, None], pair[:, 1, None, None]
    c, s = np.cos(states[..., _PSI]), np.sin(states[..., _PSI])
    return c * a - s * b, s * a + c * b


#: which states each quantity delays
_LATE = {
    "imu_delay": tuple(
        STATE_NAMES.index(name + rate) for name in ("theta", "phi", "psi") for rate in ("", "_dot")
    ),
    "velocity_delay": (STATE_NAMES.index("x_dot"), STATE_NAMES.index("y_dot")),
}


def state_delays(layout: Layout, values: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Return the sensor delay of each state (sets, 10) [s] by parameters (sets, p); None if no parameter is one."""
    if not set(_LATE) & set(layout.extra):
        return None
    delays = np.zeros((len(values), len(STATE_NAMES)))
    for name, states in _LATE.items():
        part = layout.part(name, values)
        if part is not None:
            delays[:, states] = part
    return delays


def seen_late(
    states: NDArray[np.float64], delays: NDArray[np.float64], sample_time: float
) -> NDArray[np.float64]:
    """Return the readings (sets, w, m, 10) in rows 1 to m of sensors with delays (sets, 10) [s].

    `states` (sets, w, m + 1, 10) begin with the initial state. Beyond the ends, the first and last line are extended.
    """
    m = states.shape[2] - 1
    sample = np.arange(1.0, m + 1.0)[:, None] - delays[:, None] / sample_time  # (sets, m, 10)
    before = np.clip(np.floor(sample), 0, m - 1).astype(np.int64)
    share = (sample - before)[:, None]
    first = np.take_along_axis(states, before[:, None], axis=2)
    second = np.take_along_axis(states, before[:, None] + 1, axis=2)
    return (1.0 - share) * first + share * second
