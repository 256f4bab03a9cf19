"""Short windows of logs, and the motors, sensors and delays between a log's numbers and the robot.

Back-EMF. The back-EMF of a motor driven by voltage brakes with the wheel's speed. A motor on a duty d gives u = n k_t
(d V - k_e n w) / R = u_0 - b_e w, with the torque at standstill u_0 = n k_t V d / R and b_e = n^2 k_t k_e / R. A log of
duties becomes torques u with the speed w that was measured. What was commanded is u_0, though, and in a prediction the
brake must follow the predicted speed: a model that turns too fast would else not be braked for it. So identification
predicts with u_0 = u + b_e w and with the viscous friction b + b_e, and gives b.

If b_e is not known, a duty scaled to a torque may stand for u_0 and the viscous friction found is b + b_e.

Whole intervals of each log are held out, 8 s of every 28 s: neighbouring windows share a swing of the limit cycle, and
a validation in closed loop needs seconds in one piece. As 28 s is not a multiple of the 8 s or 32 s with which
references often repeat, the intervals do not always hold the same piece of the path.

Windows. Each is predicted from the state measured at its start. An unstable plant's open-loop prediction means
something for a fraction of a second only. A window of m samples starts at row k: the torques are rows k .. k + m - 1,
each held until the next, and states k + 1 .. k + m are compared. Windows with a missing value or a spoilt one
(`ballbot.log.checks.values`), an uneven sampling interval or a lean past recovery are left out.

The start is the measured state as it is. Smoothing it over 35 to 75 ms, which looks ahead, was tried on logs
with encoder counts and gearbox play: no state's error on other windows changed by more than 1 %.

Torques. Of the torque u_i logged in row k there acts, over the sample that begins at row k,

    gain_i ((1 - f) u_i[k - m] + f u_i[k - m - 1]) + offset_i        delay = (m + f) sample times, 0 <= f < 1

A held torque that comes a fraction f of a sample late acts over the first part of the sample with its old value; here
both values act throughout with that share, so that each sample has the same impulse.

Sensors. An IMU that is tilted by small angles (a, b) about the body's x and y axes reads R Rx(a) Ry(b) in place of
R = Rx(theta) Ry(phi) Rz(psi); a centre of mass beside the axis looks the same. To first order it reads

    theta + a cos psi - b sin psi        phi + a sin psi + b cos psi

and the gyro's bias (g_x, g_y, g_z) turns with the body likewise in the lean's rates. That about z is added to
psi_dot, and a heading that is the integral of psi_dot runs away at that rate: by g_z times the time since the start.

Sensor delays. A row's angles, or its velocities, may be older than its positions. An IMU's message waits for the next
row, its filter lags; velocities that are encoders' differences are means over the sample that ends. Row k then shows,
of a state whose sensor is late by d,

    seen_k = state(t_k - d)                with the states between samples on straight lines

The positions x and y are the clock. A window's start is seen late as well: the true one lies ahead of it by d times the
slope of a first sample simulated from what was seen.
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
from ballbot.log.wheel_speeds import measured_wheel_speeds
from ballbot.mechanics.geometry import body_rates_matrix, rotation, transforms
from ballbot.robot import Robot


def ball_spin(log: Log, robot: Robot) -> NDArray[np.float64]:
    """Return the ball's spin about the vertical (N,) [rad/s], from the encoders and the body's rates.

    The encoders see A (z - w), w the body's rates and z = R^T Omega the ball's, both in the body's frame; so the spin
    is the vertical part of R (A^-1 wheel speeds + w).

    Raises
    ------
    InputError
        If the log has no wheel speeds.
    """
    names = wheel_speed_names(robot.wheel_count)
    if not all(name in log for name in names):
        raise InputError(
            f"A pivoting ball needs the wheel speeds {names[0]} .. {names[-1]}, "
            "which the log does not have; exclude the heading from the cost instead."
        )
    angles, rates = _state_columns(log)[:, 2:5], _state_columns(log)[:, 7:10]
    w = (body_rates_matrix(*angles.T) @ rates[..., None])[..., 0]
    z = measured_wheel_speeds(log, robot) @ transforms(robot).T_obw.T + w
    return (rotation(*angles.T)[:, 2] * z).sum(axis=1)


def _state_columns(log: Log) -> NDArray[np.float64]:
    return np.column_stack([log[name] for name in STATE_NAMES])


def standstill_torques(log: Log, robot: Robot, back_emf: float) -> Log:
    """Return the log with u_0 in place of u.

    Parameters
    ----------
    back_emf : float
        b_e [N m s/rad], the same for every motor.

    Raises
    ------
    InputError
        If b_e is no number from zero up.
    """
    if not (math.isfinite(back_emf) and back_emf >= 0.0):
        raise InputError(f"back_emf is {back_emf!r}; it must be n^2 k_t k_e / R in N m s/rad, zero or more.")
    speeds = measured_wheel_speeds(log, robot)
    names = torque_names(robot.wheel_count)
    return log.with_columns({name: log[name] + back_emf * speeds[:, i] for i, name in enumerate(names)})


def back_emf_of(mappings: Sequence[str | Path]) -> float:
    """Return b_e [N m s/rad] of the motors that mapping files describe; zero if the logs have torques or currents.

    Raises
    ------
    InputError
        If a file cannot be read or is no mapping, or the mappings differ in it.
    """
    drives = [read_mapping(mapping).input for mapping in mappings]
    found = {round(one.back_emf if isinstance(one, DutyTable) else 0.0, 12) for one in drives}
    if len(found) > 1:
        raise InputError(
            "The motors of the mappings have back-EMF damping of "
            f"{', '.join(f'{b:g}' for b in sorted(found))} N m s/rad; logs of one "
            "robot must have the same supply voltage, resistance and motor constants."
        )
    return found.pop() if found else 0.0


#: a sampling interval may differ from the median one by this share of it
LARGEST_JITTER = 0.1
#: beyond this lean, theta or phi, a robot is falling or held by hands [rad]
LARGEST_LEAN = 0.6
#: times within a window at which prediction and measurement are compared in a fit
COMPARISONS = 10

_LEANS = [STATE_NAMES.index("theta"), STATE_NAMES.index("phi")]


@dataclass(frozen=True, kw_only=True)
class Span:
    """Log, start and end of a window."""

    log: int  #: which of the logs, from 0
    start: float  #: its `t` at the window's start [s]
    end: float  #: and at its last compared state [s]


@dataclass(frozen=True, kw_only=True, eq=False)
class Windows:
    """w windows of m samples each."""

    initial: NDArray[np.float64]  #: (w, 10), states at the starts
    torques: NDArray[np.float64]  #: (w, m, n) [N m]
    measured: NDArray[np.float64]  #: (w, m, 10), states after each sample
    earlier: NDArray[np.float64]  #: (w, h, n), torques of the h rows before the starts
    #: (w,), the ball's spin about the vertical at the starts [rad/s]; NaN if not measured
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
        """Samples from one comparison of a fit to the next."""
        return self.samples // min(COMPARISONS, self.samples)

    def take(self, rows: NDArray[np.int64]) -> Windows:
        """Return the windows of those numbers."""
        arrays = {name: getattr(self, name)[rows] for name in _ARRAYS}
        return Windows(**arrays, spans=tuple(self.spans[row] for row in rows), sample_time=self.sample_time)


#: fields of `Windows` with a row for each
_ARRAYS = ("initial", "torques", "measured", "earlier", "spin")


def cut_windows(
    logs: Sequence[Log],
    *,
    wheel_count: int,
    duration: float,
    before: Callable[[float], int] | None = None,
    spins: Sequence[NDArray[np.float64]] | None = None,
) -> Windows:
    """Cut logs into windows that lie end to end.

    Parameters
    ----------
    logs : sequence of Log
        With the ten state columns and u1 .. un, of one sample time.
    wheel_count : int
    duration : float
        Length of a window [s]; rounded to samples, and to a multiple of `COMPARISONS` samples where it has more.
    before : callable, optional
        From the sample time to how many rows of torques before its start a window takes along; none by default.
    spins : sequence of ndarray (N,), optional
        The ball's spin about the vertical in each row of each log [rad/s].

    Raises
    ------
    InputError
        If there is no log, a column is missing or empty, the sample times differ or the window is no length.
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
        **{name: np.concatenate([getattr(one, name) for one in pieces]) for name in _ARRAYS},
        spans=tuple(span for one in pieces for span in one.spans),
        sample_time=sample_time,
    )


def common_sample_time(logs: Sequence[Log], *, duration: float) -> float:
    """Return the sample time [s] of logs that are to be cut into windows of that duration [s].

    Raises
    ------
    InputError
        If there is no log or one of one row, the sample times differ or the window is no length.
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
    """Divide window numbers 0 .. count - 1 at random into those to fit and those held out, both rising.

    At least one is held out.
    """
    order = np.random.default_rng(seed).permutation(count)
    kept = max(1, round(held_out * count))
    return np.sort(order[kept:]), np.sort(order[:kept])


#: fraction of each log that a fit does not see
HELD_OUT = 2 / 7
#: from one interval that is held out to the next, and what of that comes before it [s]
_HOLDOUT_CYCLE, _HOLDOUT_OFFSET = 28.0, 12.0


def holdout_intervals(log: Log, *, fraction: float = HELD_OUT) -> tuple[tuple[float, float], ...]:
    """Return the (start, end) [s] that a fit does not see; a log shorter than a cycle has one, in proportion."""
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
    """Return the numbers of the windows to fit and of those held out, which overlap an interval of their log.

    At least one is held out.

    Parameters
    ----------
    spans : sequence of Span
    held_out : sequence of sequence of (float, float)
        The intervals (start, end) [s] of each log.
    """
    held = np.array(
        [any(one.start < end and start < one.end for start, end in held_out[one.log]) for one in spans],
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
    """Yield (first, end) of the longest runs of complete rows, none of them spoilt, at even intervals."""
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
    """Return the torques that act (sets, w, m, n) for sets of parameters (sets, p); None where those logged do."""
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
    """Return the errors that sensors add to measured states; None if they have none.

    Parameters
    ----------
    values : ndarray (sets, p)
    states : ndarray (w, k, 10)
        As measured; their heading gives the body's orientation.
    times : ndarray (k,)
        Since each window's start [s].

    Returns
    -------
    ndarray (sets, w, k, 10)
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
    """Return how many rows of torques before a window its prediction may need; `upper` (p,) bounds the parameters."""
    delay = layout.part("delay", upper)
    return 0 if delay is None else int(np.floor(delay[0] / sample_time + 1e-9)) + 1


def _delayed(samples: NDArray[np.float64], windows: Windows) -> NDArray[np.float64]:
    """Return the torques (sets, w, m, n) that come so many samples (sets,) late."""
    record = np.concatenate([windows.earlier, windows.torques], axis=1)
    before, count = windows.earlier.shape[1], windows.samples
    whole = np.minimum(np.floor(samples).astype(np.int64), before - 1)
    late = np.empty((len(samples), *windows.torques.shape))
    for i, (m, f) in enumerate(zip(whole, samples - whole, strict=True)):
        first = before - m
        now, previous = record[:, first : first + count], record[:, first - 1 : first - 1 + count]
        late[i] = (1.0 - f) * now + f * previous
    return late


def _turned(
    pair: NDArray[np.float64], states: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return a body's pair (sets, 2 or more) about the axes of lean, (sets, w, k) each."""
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
    """Return by how much each state is seen late (sets, 10) [s], for parameters (sets, p); None if none may be."""
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
    """Return delayed sensors' readings (sets, w, m, 10) of rows 1 to m, for states (sets, w, m + 1, 10), start first.

    Parameters
    ----------
    states : ndarray (sets, w, m + 1, 10)
    delays : ndarray (sets, 10)
        [s].
    sample_time : float
        [s].
    """
    m = states.shape[2] - 1
    place = np.arange(1.0, m + 1.0)[:, None] - delays[:, None] / sample_time  # (sets, m, 10), in samples
    before = np.clip(np.floor(place), 0, m - 1).astype(
        np.int64
    )  # beyond the ends, the first and the last line go on
    share = (place - before)[:, None]
    first = np.take_along_axis(states, before[:, None], axis=2)
    second = np.take_along_axis(states, before[:, None] + 1, axis=2)
    return (1.0 - share) * first + share * second
