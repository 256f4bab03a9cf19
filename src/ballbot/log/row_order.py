"""Rows of a file in the order of their times: repeated rows, rows out of order, runs that were joined.

Time goes back for one of two reasons. If runs were joined or a clock was set, it stays back, and another run begins
there. If a host stamps rows late or in whole milliseconds, it goes back or repeats for a few rows and then continues:
of these rows the longest series in which time increases is kept.
"""

from bisect import bisect_left
from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import Bools, Floats, format_duration
from ballbot.errors import InputError
from ballbot.findings import Finding, warning
from ballbot.log.clock import continuous_clock, without_bursts
from ballbot.log.columns import Columns
from ballbot.log.signals import dropouts
from ballbot.summary import counted

#: longest log and shortest interval between rows [s]
LONGEST, SHORTEST = 7.0 * 86400.0, 1e-9
#: largest step of time within one run [s]
LONGEST_PAUSE = 10.0
#: rows on either side of a step back that show whether time stays back
_BESIDE = 10
#: time must stay back by more than so many usual intervals and standard deviations of the stamps to be another run: the
#: difference of two medians of ten rows has 0.55 standard deviations
_INTERVALS, _DEVIATIONS = 3.0, 3.0


def longest_run(t: Floats) -> tuple[int, int]:
    """Return first and end of the longest stretch of rows that are one run; see `later_runs`."""
    edges = np.concatenate(([0], later_runs(t), [len(t)]))
    longest = int(np.argmax(np.diff(edges)))
    return int(edges[longest]), int(edges[longest + 1])


def later_runs(t: Floats) -> NDArray[np.intp]:
    """Return the first row of each run after the first."""
    steps = np.diff(t)
    breaks = ~(np.abs(steps) < LONGEST_PAUSE)  # also where a time is missing
    back = np.flatnonzero(~breaks & (steps < 0.0))
    if back.size:
        breaks[back] = _stays_back(t, back)
    return np.flatnonzero(breaks) + 1


def _stays_back(t: Floats, back: NDArray[np.intp]) -> Bools:
    """Return for each step back, after the rows `back`, whether another run begins there."""
    if len(t) <= 2 * _BESIDE:
        return np.ones(len(back), dtype=np.bool_)
    usual = float(np.nanmedian(t[2 * _BESIDE :] - t[: -2 * _BESIDE])) / (2 * _BESIDE)
    middle = t[_BESIDE:-_BESIDE] - 0.5 * (t[: -2 * _BESIDE] + t[2 * _BESIDE :])
    deviation = 1.4826 * float(np.nanmedian(np.abs(middle))) / np.sqrt(1.5)
    even = t - usual * np.arange(len(t))
    allowed = _INTERVALS * usual + _DEVIATIONS * deviation
    starts = back + 1
    after = [np.median(even[row : row + _BESIDE]) for row in starts]
    steps = [later - np.median(even[max(r - _BESIDE, 0) : r]) for r, later in zip(starts, after, strict=True)]
    return ~(np.array(steps) > -allowed)


def increasing_rows(t: Floats) -> Bools:
    """Return which rows (N,) form a longest series in which time increases."""
    if np.all(np.diff(t) > 0.0):
        return np.ones(len(t), dtype=np.bool_)
    last: list[float] = []  # by length, the least time that a series ends with
    ends: list[int] = []  # and the row of that time
    before: list[int] = []  # by row, the one before it in its series
    for row, time in enumerate(t.tolist()):
        length = bisect_left(last, time)
        last[length : length + 1], ends[length : length + 1] = [time], [row]
        before.append(ends[length - 1] if length else -1)
    kept = np.zeros(len(t), dtype=np.bool_)
    row = ends[-1]
    while row >= 0:
        kept[row] = True
        row = before[row]
    return kept


def rows_with_times(table: Mapping[str, Floats], time: str, notes: list[str]) -> Columns:
    """Return a table without the rows that lack a time or repeat the row before, its clock continued and even.

    Sentences on what is left out or changed are added to `notes`.
    """
    untimed = np.flatnonzero(~np.isfinite(table[time]))
    if len(untimed) == len(table[time]):
        return {**table}
    repeated = np.flatnonzero(np.diff(table[time]) == 0.0) + 1
    for values in table.values():
        value, before = values[repeated], values[repeated - 1]
        repeated = repeated[(value == before) | (np.isnan(value) & np.isnan(before))]
    again = "with the time and all values of the row before"
    for rows, what in ((untimed, "without a time"), (repeated, again)):
        if rows.size:
            notes.append(f"Left out: {counted(rows.size, 'row')} {what}, first row {rows[0] + 1}.")
    left_out = np.concatenate([untimed, repeated])
    rest = {name: np.delete(values, left_out) for name, values in table.items()}
    rest[time], resets = continuous_clock(rest[time])
    if resets.size:
        notes.append(
            f"{time} begins again {counted(resets.size, 'time')}, first at row {resets[0] + 1}, as a counter that "
            "overflows or a time of day at midnight: it is continued there."
        )
    rest[time], burst = without_bursts(rest, time)
    if burst:
        notes.append(
            f"By {time} rows arrive about {burst} at once, as a host stamps them: their mean interval is taken instead."
        )
    return rest


def without_dropouts(table: Mapping[str, Floats], sensors: Iterable[str]) -> tuple[Columns, list[Finding]]:
    """Return a table with NaN for failed readings of sensors (`signals.dropouts`), and a finding on each."""
    cleared, findings = {**table}, list[Finding]()
    for name in sensors:
        lost = dropouts(table[name]) if name in table else np.zeros(0, dtype=np.bool_)
        if lost.any():
            rows, cleared[name] = np.flatnonzero(lost), np.where(lost, np.nan, table[name])
            text = (
                f"{name} jumps to {table[name][rows[0]]:g} and back in {counted(rows.size, 'row')}, first at row "
                f"{rows[0] + 1}: a failed reading. These values count as missing."
            )
            findings.append(warning("missing", text, name))
    return cleared, findings


def check_time(t: Floats) -> None:
    """Raise InputError if times (N,) [s] are missing, do not increase, or are so many that they are in another unit."""
    unknown = np.flatnonzero(~np.isfinite(t))
    if unknown.size:
        raise InputError(
            f"The time t is missing or not finite at row {unknown[0] + 1}; give every row its time or remove the row."
        )
    steps = np.diff(t)
    wrong = np.flatnonzero(steps < SHORTEST)
    if wrong.size:
        k = int(wrong[0])
        change = "decreases" if steps[k] < 0.0 else "does not increase"
        raise InputError(
            f"Time {change} at row {k + 2}: t = {t[k + 1]:.9g} s after {t[k]:.9g} s. Sort the rows or split the log; "
            f"rows must be at least {SHORTEST:g} s apart."
        )
    span = float(t[-1] - t[0])
    if span > LONGEST:
        k = int(np.argmax(steps))
        stray = steps[k] > 0.5 * span
        cause = (
            f"t jumps from {t[k]:.9g} to {t[k + 1]:.9g} s at row {k + 2}. Correct that time, or remove the rows on one "
            "side of it."
            if stray
            else f"rows come every {format_duration(float(np.median(steps)))}. t is in seconds; convert it with a "
            "mapping file."
        )
        raise InputError(
            f"The log spans {format_duration(span)}: {cause} At most {format_duration(LONGEST)} are read."
        )
