"""The clock of a log's rows: one made of two columns, one that begins again, rows that arrive in bursts, its unit.

Whole seconds and their fraction, such as the columns sec and nanosec, are one clock. Rows that a host stamps as they
arrive, several at a time, were measured evenly: their mean interval holds.
"""

import re
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import Bools, Floats
from ballbot.errors import InputError
from ballbot.findings import Finding
from ballbot.log.columns import FACTORS, Columns
from ballbot.log.units import Unit, looks_like

#: intervals between rows that a log may have [s], and the units in which clocks count
INTERVALS, _OF_CLOCKS = (2e-4, 0.2), ("s", "ms", "us", "ns")
#: a name that ends in a unit of time of the second, and what it is a fraction of
_OF_SECONDS = re.compile(r"(.*?)(nano|micro|milli|[nuµm])?(?:seconds?|secs?|s)")
_FRACTIONS = {"nano": 1e-9, "n": 1e-9, "micro": 1e-6, "u": 1e-6, "µ": 1e-6, "milli": 1e-3, "m": 1e-3}
#: rows of a burst: two come together by chance, and a serial port's 4 kB hold no more
_LEAST_ROWS, _MOST_ROWS = 3, 200
#: fewest bursts that show an interval
_BURSTS = 10
#: interval within a burst over the mean one
_TOGETHER = 0.1
#: change of a column from one burst to the next over that within bursts; between separate runs more changes
_CONTINUES = 3.0
#: time from burst to burst over its rows' intervals if rows were lost; a late arrival is half as much
_LOST = 1.6


def with_fractions(columns: Columns, notes: list[str]) -> Columns:
    """Return columns in which fractions of seconds are added to their seconds; `notes` gets a sentence on each."""
    read = {name: match for name in columns if (match := _OF_SECONDS.fullmatch(name.lower()))}
    seconds = {match[1]: name for name, match in read.items() if not match[2]}
    joined = dict(columns)
    for name, match in read.items():
        whole, factor = seconds.get(match[1]), _FRACTIONS.get(match[2], 0.0)
        if whole is None or not factor or columns[whole].shape != columns[name].shape:
            continue
        parts = np.column_stack([columns[whole], columns[name]])
        parts, time = parts[np.isfinite(parts).all(axis=1)], columns[whole] + factor * columns[name]
        digits = bool(((parts == np.floor(parts)) & (parts >= 0.0)).all()) and len({*parts[:, 1]}) > 1
        if digits and parts[:, 1].max() * factor < 1.0 and np.mean(np.diff(time) >= 0.0) > 0.9:
            joined[whole] = time
            del joined[name]
            notes.append(f"{whole} and {name} are one clock, seconds and their fraction, and are added.")
    return joined


def without_bursts(table: Mapping[str, Floats], time: str) -> tuple[Floats, int]:
    """Return the times (N,) of a table's rows, even if they arrived in bursts, and the rows of a burst, else 0."""
    t = table[time]
    steps = np.diff(t)
    if len(t) < _BURSTS * _LEAST_ROWS or not (steps >= 0.0).all():
        return t, 0
    apart = steps > np.mean(steps)
    ends = np.append(np.flatnonzero(apart), len(t) - 1)
    rows, intervals = np.diff(ends), np.diff(t[ends])
    together = float(np.median(steps)) < _TOGETHER * np.mean(steps) and len(rows) >= _BURSTS
    if not together or not _LEAST_ROWS <= np.median(rows) <= _MOST_ROWS or not _continues(table, apart):
        return t, 0
    usual = float(np.median(intervals / rows))
    even, first = np.empty(len(t)), 0
    for burst in (*np.flatnonzero(intervals > _LOST * usual * rows).tolist(), len(ends) - 1):
        # a stretch without lost rows ends with this burst; an arrival is late by any time
        of_stretch = ends[(ends >= first) & (ends <= ends[burst])]
        h = usual if len(of_stretch) < _BURSTS else float(np.polyfit(of_stretch, t[of_stretch], 1)[0])
        numbers = np.arange(first, ends[burst] + 1)
        even[numbers] = h * numbers + np.mean(t[of_stretch] - h * of_stretch)
        first = int(ends[burst]) + 1
    return (even, int(np.median(rows))) if (np.diff(even) > 0.0).all() else (t, 0)


def _continues(table: Mapping[str, Floats], apart: Bools) -> bool:
    """Return whether no column but clocks changes much more where rows are `apart` (N - 1,) than elsewhere."""
    for values in table.values():
        steps = np.diff(values)
        change, known = np.abs(steps), np.isfinite(steps)
        across, within = known & apart, known & ~apart
        more = change[across].sum() * within.sum() > _CONTINUES * change[within].sum() * across.sum()
        if more and (steps[known] < 0.0).any():
            return False
    return True


def _usual_step(t: Floats) -> float:
    """Return the median time by which rows (N,) move forward; zero if none does."""
    steps = np.diff(t)
    return float(np.median(steps[steps > 0.0])) if np.any(steps > 0.0) else 0.0


def units_of_clock(t: Floats, *, named: str | None = None) -> dict[str, float]:
    """Return the units in which times (N,) have the intervals of a log, with that interval [s]; minutes if named so."""
    usual = _usual_step(t)
    units = {name: usual * factor for name, factor in FACTORS["s"].items() if name in (named, *_OF_CLOCKS)}
    return {name: interval for name, interval in units.items() if INTERVALS[0] <= interval < INTERVALS[1]}


def clock_unit(t: Floats, name: str, named: str | None) -> Unit:
    """Return the unit of a column of times (N,), by its name's unit if it has one, and its intervals.

    InputError, with what helps, if they are the intervals of no log, or of one in another unit than the name's.
    """
    fits = units_of_clock(t, named=named)
    for unit, interval in fits.items():
        if named in (None, unit):
            return Unit(
                name=unit, factor=FACTORS["s"][unit], reason=f"rows come every {1e3 * interval:.4g} ms"
            )
    different, usual = len(np.unique(t)), _usual_step(t)
    if different < 0.5 * len(t):
        raise InputError(
            f"the time {name} has only {different} different values in {len(t)} rows, {usual:.6g} apart near "
            f"{t[-1]:.10g}: digits were lost, as 32-bit floats lose them of a time since 1970. Log the time since the "
            "start, or in numbers of 64 bits with all digits."
        )
    if fits:
        unit, interval = next(iter(fits.items()))
        raise InputError(
            f"the time {name} is in {named} by its name, but its rows are {usual:.6g} apart, which in {unit} is every "
            f"{1e3 * interval:.4g} ms. Name it after its unit, in the file or with --columns, or write a mapping file "
            f'with t = {{ from = "{name}", unit = "{unit}" }}.'
        )
    raise InputError(
        f"the rows of {name} are {usual:.6g}{f' {named}' if named else ''} apart, and those of a log "
        f"{1e3 * INTERVALS[0]:g} to {1e3 * INTERVALS[1]:g} ms: log every control period, or write a mapping file with "
        f'the scale of its clock, t = {{ from = "{name}", scale = .. }}, in seconds.'
    )


#: periods after which clocks restart, in their own unit: counters of 16 and 32 bits, those of 32 bits of micro- and of
#: milliseconds written in seconds, and a day in seconds, milliseconds or microseconds
_PERIODS = (2.0**16, 2.0**32, 2.0**32 * 1e-6, 2.0**32 * 1e-3, 86400.0, 86400e3, 86400e6)
#: most usual intervals across a restart
_MEANWHILE = 5.0


def continuous_clock(t: Floats) -> tuple[Floats, NDArray[np.intp]]:
    """Return a clock's times (N,), in any unit, continued where it begins again, and the rows where it does.

    A clock begins again if a step back is one of the periods of clocks, less the time from one row to the next.
    """
    steps, usual, continued, rows = np.diff(t), _usual_step(t), t, []
    for row in np.flatnonzero(steps < 0.0):
        for period in _PERIODS:
            if t[row + 1] >= 0.0 and 0.0 < steps[row] + period <= _MEANWHILE * usual:
                continued = np.concatenate((continued[: row + 1], continued[row + 1 :] + period))
                rows.append(row + 1)
    return continued, np.array(rows, dtype=np.intp)


def clock_findings(t: Floats, option: str, *, code: str = "time-scale") -> list[Finding]:
    """Return the error of times (N,) that are in another unit than seconds; `option` takes a mapping of that file."""
    reason, unit = f"rows come every {_usual_step(t):.4g} s", next(iter(units_of_clock(t)), "s")
    return [looks_like("t", "t", unit, reason, option, code=code)] if unit != "s" else []
