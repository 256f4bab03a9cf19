"""Signals of a log: smooth values, rates and accelerations, times of sampling, turning points, intervals of balancing.

`smooth` gives a value, rate and acceleration on even rows, from the cubic fitted around each row with Gaussian weights:
one filter for all signals, so that a linear relation between them is kept, whatever the filter removes.

`sampling_times` estimates from the encoders when they were read. A host that logs the latest message writes its own
clock beside angles that were read up to one message earlier. Every wheel of a row is then off its smooth course by
(wheel speed) x (one and the same time), so that the time is

    e = sum_i w_i r_i / (sum_i w_i^2 + (s / a)^2)

with w_i the smooth speeds, r_i angles minus smooth angles, s the noise of the angles, and a the usual size of e: least
squares with the prior that e is of size a, under which slow wheels do not change the time. A few rounds of fit and
correction converge. The intervals between messages may vary.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import factorial

import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import Bools, Floats, rows_between

#: a, the usual error of a row's time [s]: messages come every 5 ms, or 10
TIME_ERROR = 2e-3
#: s, noise of the angles [rad]: encoders of some thousand counts a turn, and the residual of a smooth course
ANGLE_NOISE = 6e-4
#: standard deviation of the weights of the smooth course [s]: of the logs of a course's robot it leaves a noise of 0.10
#: to 0.17 rad/s, and simulated messages are found to 0.2 ms; and the farthest that a row's time is moved [s]
COURSE_WIDTH, FARTHEST = 0.02, 0.06
ROUNDS = 6
#: the noise is estimated where the wheels turn at least so fast [rad/s], root of the sum of squares
FAST = 3.0
#: least number of such rows
FEWEST_FAST = 50
#: rows closer together than this part of the median interval are one message logged twice
REPEATED = 0.2


def sampling_times(t: Floats, angles: Floats) -> Floats:
    """Return the times (N,) [s] at which the rows' angles were read, up to a constant; equal for one message.

    Of the rows' own times (N,) [s], increasing, and angles (N, n) [rad] of two wheels or more, finite.
    """
    times, known = t.copy(), _has_a_course(t)
    for _ in range(ROUNDS):
        course, speeds = smooth_at(times, angles, width=COURSE_WIDTH)
        size = (speeds**2).sum(axis=1) + (ANGLE_NOISE / TIME_ERROR) ** 2
        times = times + known * (speeds * (angles - course)).sum(axis=1) / size
        # wheels that contradict each other would move them without end
        times = np.maximum.accumulate(np.clip(times, t - FARTHEST, t + FARTHEST))
    return times


def new_messages(times: Floats) -> Bools:
    """Return which rows (N,) have another message than the row before."""
    least = REPEATED * float(np.median(np.diff(times)))
    kept = np.ones(len(times), dtype=np.bool_)
    last = times[0]
    for row in range(1, len(times)):
        kept[row] = times[row] - last > least
        last = times[row] if kept[row] else last
    return kept


def speed_noise(times: Floats, angles: Floats) -> float:
    """Return the noise [rad/s] of the wheels' speeds from one row to the next, while they turn fast.

    It is the root mean square of speeds minus smooth speeds; nan if too few rows are fast.
    """
    kept = new_messages(times)
    times, angles = times[kept], angles[kept]
    _, speeds = smooth_at(times, angles, width=COURSE_WIDTH)
    between = 0.5 * (speeds[1:] + speeds[:-1])
    noise = np.diff(angles, axis=0) / np.diff(times)[:, None] - between
    fast = (np.sqrt((between**2).sum(axis=1)) > FAST) & _has_a_course(times)[1:]
    return float(np.sqrt((noise[fast] ** 2).mean())) if fast.sum() >= FEWEST_FAST else np.nan


def _has_a_course(t: Floats) -> Bools:
    """Return which rows (N,) are so far from the ends that all weights of the smooth course lie within the log."""
    return (t > t[0] + REACH * COURSE_WIDTH) & (t < t[-1] - REACH * COURSE_WIDTH)


#: missing cells are filled between known ones at most so far apart [s], or two and a half usual rows if rows come more
#: slowly: balancing happens at 1 to 3 Hz, so that a line over a twentieth of a second is off by a few per cent
LONGEST_HOLE = 0.05


def without_holes(t: Floats, values: Floats, *, held: bool = False) -> Floats:
    """Return values (N,) with short holes filled, by a line or, as commands are `held`, with the last known value.

    Longer holes stay missing (NaN). Times t (N,) [s] increase.
    """
    known = np.isfinite(values)
    if known.all() or known.sum() < 2:
        return values
    rows, every = np.flatnonzero(known), np.arange(len(values))
    before = rows[np.clip(np.searchsorted(rows, every, side="right") - 1, 0, None)]
    after = rows[np.clip(np.searchsorted(rows, every), None, len(rows) - 1)]
    inside = ~known & (t[after] - t[before] <= max(LONGEST_HOLE, 2.5 * float(np.median(np.diff(t)))))
    inside &= (before < every) & (every < after)
    return np.where(inside, values[before] if held else np.interp(t, t[known], values[known]), values)


def unwrapped(angle: Floats, *, period: float = 2.0 * np.pi) -> Floats:
    """Return an angle (N,) [rad], or in units of `period`, without jumps of a period; missing values stay missing."""
    known = np.isfinite(angle)
    continuous = angle.copy()
    continuous[known] = np.unwrap(angle[known], period=period)
    return continuous


def without_resets(t: Floats, angles: Floats, largest_speed: float) -> Floats:
    """Return encoders' angles without the steps that no wheel makes: resets and overflows.

    Missing values of the angles (N,) or (N, n) [rad] stay missing; the wheels cannot reach `largest_speed` [rad/s].
    """
    usual = float(np.median(np.diff(t))) if len(t) > 1 else 0.0
    continued = np.array(angles, dtype=np.float64)
    for column in continued.reshape(len(t), -1).T:
        known = np.isfinite(column)
        if known.sum() > 1:
            steps = np.diff(column[known])
            # three usual intervals, so that a late row is not taken for a reset
            impossible = np.abs(steps) > largest_speed * np.maximum(np.diff(t[known]), 3.0 * usual)
            lost = np.cumsum(np.where(impossible, steps, 0.0))
            column[known] -= np.concatenate(([0.0], lost))
    return continued


#: a value to which a signal jumps and from which it comes back so many times is one of a failed reading, if the jumps
#: are so many times its other steps, of which so many must be known
DROPOUTS, DROPPED, LEAST_STEPS = 3, 5.0, 50


def dropouts(values: Floats) -> Bools:
    """Return the rows of a signal (N,) with one value, such as 0, to which it jumps again and again, and comes back."""
    lost = np.zeros(len(values), dtype=np.bool_)
    rows = np.flatnonzero(np.isfinite(values))
    if rows.size <= LEAST_STEPS:
        return lost
    starts, lengths = runs_of(values[rows])
    x = values[rows][starts]
    if len(x) < 3:
        return lost
    change = np.diff(np.pad(x, 1, mode="reflect"))  # an end has its neighbour on both sides
    turns = np.flatnonzero(np.sign(change[1:]) * np.sign(change[:-1]) < 0.0)
    found, times = np.unique(x[turns], return_counts=True)
    there = x == found[np.argmax(times)]
    rest = np.abs(np.diff(x[~there]))
    if len(rest) < LEAST_STEPS or not rest.any():
        return lost
    beside = np.lib.stride_tricks.sliding_window_view(np.pad(rest, 2), 3).max(axis=1)
    turns = turns[there[turns]]
    near = beside[np.cumsum(~there)[turns]]
    jump = np.minimum(np.abs(change[turns]), np.abs(change[turns + 1]))
    if np.count_nonzero(jump > DROPPED * np.maximum(near, np.median(rest[rest > 0.0]))) >= DROPOUTS:
        inside = (turns > 0) & (turns < len(x) - 1)
        lost[rows] = np.repeat(np.isin(np.arange(len(x)), turns[inside | (jump > near)]), lengths)
    return lost


def encoder_step(angles: Floats) -> float | None:
    """Return the smallest step of which all steps of angles (N, n) are multiples; None if there is no such step."""
    steps_of_wheels = []
    for column in angles.T:
        steps = np.abs(np.diff(column))
        steps = steps[steps > 1e-9]
        if len(steps) < 20:
            continue
        step = float(np.quantile(steps, 0.001, method="lower"))
        multiples = steps[steps < 20.5 * step] / step
        whole = np.abs(multiples - np.round(multiples)) < 0.05
        if len(multiples) >= 20 and whole.mean() > 0.95:
            steps_of_wheels.append(step)
    return float(np.median(steps_of_wheels)) if steps_of_wheels else None


#: interval of the even rows [s]
INTERVAL = 0.005
#: standard deviation of the weights [s]: balancing happens at 1 to 3 Hz, an IMU's noise is above
WIDTH = 0.05
_DEGREE = 3
#: standard deviations of the weights to each side
REACH = 4.0
#: columns of one log that are smoothed at a time
_COLUMNS = 20


@dataclass(frozen=True, eq=False)
class Smooth:
    """A signal (N, c) on even rows."""

    value: Floats
    rate: Floats
    acceleration: Floats

    def each(self, change: Callable[[Floats], Floats]) -> Smooth:
        """Return the signal with its values and their derivatives changed alike."""
        return Smooth(change(self.value), change(self.rate), change(self.acceleration))


def even_rows(t: Floats) -> Floats:
    """Return times at even intervals over a log's (M,); InputError if they are too many."""
    rows_between(float(t[-1] - t[0]), INTERVAL, columns=_COLUMNS, source="The log")
    return np.arange(t[0], t[-1], INTERVAL)


def smooth(rows: Floats, t: Floats, values: Floats, *, width: float = WIDTH) -> Smooth:
    """Return a signal and its derivatives on even rows; near the ends it is fitted from one side.

    The rows (N,) [s] are `INTERVAL` apart, the values (M, c) were measured at t (M,) [s], increasing, and `width` [s]
    is the standard deviation of the weights.
    """
    reach = round(REACH * width / INTERVAL)
    even = np.column_stack([_on_even_rows(rows, t, column) for column in values.T])
    padded = np.pad(even, ((reach, reach), (0, 0)), mode="edge")

    def filtered(kernel: Floats) -> Floats:
        return np.column_stack([np.convolve(column, kernel, mode="valid") for column in padded.T])

    return Smooth(*(filtered(_kernel(order, reach, width)) for order in range(3)))


def smooth_at(t: Floats, values: Floats, *, width: float) -> tuple[Floats, Floats]:
    """Return a smoothed signal (M, c) and its rate at the times (M,) [s] at which it was measured, not decreasing."""
    rows = even_rows(np.append(t, t[-1] + 2.0 * INTERVAL))
    course = smooth(rows, t, values, width=width)
    parts = ([np.interp(t, rows, column) for column in part.T] for part in (course.value, course.rate))
    value, rate = (np.column_stack(columns) for columns in parts)
    return value, rate


def _on_even_rows(rows: Floats, t: Floats, values: Floats) -> Floats:
    """Return a signal (M,) on even rows (N,): interpolated, or the mean about each row where the log's come faster.

    Single values of a fast log would alias its noise: a derivative's then no longer cancels from row to row.
    """
    values_on_rows = np.interp(rows, t, values)
    if len(t) < 2 or np.median(np.diff(t)) > 0.9 * INTERVAL:
        return values_on_rows
    area = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(t))])
    ends = np.clip(np.append(rows - 0.5 * INTERVAL, rows[-1] + 0.5 * INTERVAL), t[0], t[-1])
    inside = np.diff(ends) > 0.1 * INTERVAL
    return np.divide(np.diff(np.interp(ends, t, area)), np.diff(ends), out=values_on_rows, where=inside)


def _kernel(order: int, reach: int, width: float) -> Floats:
    """Return the kernel whose convolution with a signal is the derivative of that order."""
    x = INTERVAL * np.arange(-reach, reach + 1)
    weights = np.exp(-0.5 * (x / width) ** 2)
    powers = np.vander(x, _DEGREE + 1, increasing=True)
    fit = np.linalg.solve(powers.T @ (weights[:, None] * powers), (powers * weights[:, None]).T)
    return factorial(order) * fit[order][::-1]


def turning_points(values: Floats, least_turn: float) -> list[int]:
    """Return the first row of a signal (n,), the rows where it turns back by more than `least_turn`, and the last."""
    turns, highest, lowest, rising, listed = [0], 0, 0, 0, values.tolist()
    for row, value in enumerate(listed):
        highest = row if value > listed[highest] else highest
        lowest = row if value < listed[lowest] else lowest
        if rising >= 0 and value < listed[highest] - least_turn:
            turns.append(highest)
            rising, lowest = -1, row
        elif rising <= 0 and value > listed[lowest] + least_turn:
            turns.append(lowest)
            rising, highest = 1, row
    # a signal that moves from its first row on has not turned there
    first = 2 if len(turns) > 1 and turns[1] == 0 else 1
    return [0, *turns[first:], len(listed) - 1]


#: a lean beyond this [rad] is a fall, or somebody holds the robot
FALLEN = 0.3
#: excluded before and after a fall [s]
AROUND_A_FALL = 0.5
#: wheels slower than this [rad/s], root of the sum of squares, for `AT_REST` seconds are at rest
MOVING_SPEED = 0.3
AT_REST = 1.0
#: motors without a command for so long are off [s]
OFF = 0.3
#: intervals shorter than the first are not kept [s], gaps shorter than the second are closed
SHORTEST_SPAN = 2.0
SHORTEST_GAP = 0.2


def balancing_rows(lean: Floats | None, speeds: Floats, commands: Floats | None) -> Bools:
    """Return the even rows (N,) at which the robot moves and has not fallen.

    By roll and pitch (N, 2) [rad], the wheels' speeds (N, n) [rad/s] and their commands (N, n), as far as known.
    """
    usable = near(np.sqrt((speeds**2).sum(axis=1)) > MOVING_SPEED, AT_REST)
    if lean is not None:
        usable &= ~near(np.abs(lean).max(axis=1) > FALLEN, AROUND_A_FALL)
    if commands is not None:
        usable &= near(np.any(commands != 0.0, axis=1), OFF)
    return usable


def row_spans(rows: Floats, kept: Bools) -> tuple[tuple[float, float], ...]:
    """Return start and end [s] of the intervals of kept rows; short gaps are closed, short intervals dropped."""
    from scipy.ndimage import binary_opening

    gaps: Bools = np.asarray(binary_opening(~kept, np.ones(round(SHORTEST_GAP / INTERVAL))), np.bool_)
    closed = binary_opening(~gaps, np.ones(round(SHORTEST_SPAN / INTERVAL)))
    edges = np.flatnonzero(np.diff(np.concatenate(([False], closed, [False])).astype(np.int8))).reshape(-1, 2)
    return tuple((float(rows[first]), float(rows[last - 1] + INTERVAL)) for first, last in edges)


def near(marked: Bools, reach: float) -> Bools:
    """Return the even rows (N,) within `reach` seconds of a marked one."""
    from scipy.ndimage import maximum_filter1d

    marked_nearby = maximum_filter1d(marked, 2 * round(reach / INTERVAL) + 1, mode="constant")
    return np.asarray(marked_nearby, dtype=np.bool_)


def across_a_gap(rows: Floats, t: Floats, longest: float) -> Bools:
    """Return which even rows (N,) lie between two times (M,) of a log that are further apart than `longest` [s]."""
    return np.diff(t)[np.clip(np.searchsorted(t, rows, side="right") - 1, 0, len(t) - 2)] >= longest


def runs_of(values: Floats) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the starts and the lengths of the runs of equal rows of values (N,) or (N, k)."""
    rows = values.reshape(len(values), -1)
    starts = np.concatenate(([0], np.flatnonzero(np.any(rows[1:] != rows[:-1], axis=1)) + 1))
    return starts, np.diff(np.append(starts, len(rows)))


def longest_repeat(values: Floats) -> tuple[int, int]:
    """Return the first and the last row of the longest stretch in which values (N,) or (N, k) repeat themselves."""
    starts, lengths = runs_of(values)
    longest = int(np.argmax(lengths))
    return int(starts[longest]), int(starts[longest] + lengths[longest]) - 1


#: a live column changes at this fraction of the rows; one that then repeats a value for so long froze [s]: longer than
#: messages are late
LIVE_FRACTION, FROZEN_TIME = 0.9, 0.4


def frozen_rows(t: Floats, values: Floats) -> Bools:
    """Return which rows of a live signal (N,), at times (N,) [s], repeat a value for longer than messages are late."""
    starts, lengths = runs_of(values)
    frozen = t[starts + lengths - 1] - t[starts] >= FROZEN_TIME
    live = len(starts) - frozen.sum() >= LIVE_FRACTION * (len(t) - lengths[frozen].sum())
    return np.repeat(frozen & live, lengths)
