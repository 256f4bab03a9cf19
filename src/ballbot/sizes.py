"""How large a table may become, and the refusal of a larger one before it is made.

A wrong unit or one stray number makes a table of seconds one of years. Whoever is about to make rows from numbers of
the user's asks here first.
"""

from __future__ import annotations

import math

from ballbot.errors import InputError

#: of a table in memory: 14 hours at 200 Hz; names of columns; 400 MB of float64
MOST_ROWS, MOST_COLUMNS, MOST_CELLS = 10_000_000, 1000, 50_000_000
#: between two decisions of a controller, and two steps of the physics engine [s]
SHORTEST_SAMPLE, SHORTEST_STEP = 1e-5, 1e-6
#: robots, candidates or generations of a search
MOST_TRIALS = 100_000
_YEAR = 365.25 * 86400.0
#: what a length of time is written in, and from which length on [s]
_LENGTHS = (
    (2.0 * _YEAR, "years", _YEAR),
    (2.0 * 86400.0, "days", 86400.0),
    (2.0 * 3600.0, "hours", 3600.0),
    (120.0, "minutes", 60.0),
)


def check_table(rows: float, columns: int, *, source: str) -> None:
    """Do nothing if a table of that size fits.

    Parameters
    ----------
    rows, columns : float, int
        Of the table that is to be made.
    source : str
        The subject of the refusal: a file's name, or "The run".

    Raises
    ------
    InputError
        If it does not.
    """
    if columns > MOST_COLUMNS:
        raise InputError(f"{source} has {columns:,} columns; at most {MOST_COLUMNS:,} are read.")
    most = min(MOST_ROWS, MOST_CELLS // max(columns, 1))
    if not rows <= most:
        raise InputError(
            f"{source} has {_count(rows)} rows of {columns} columns; at most {most:,} such rows fit in "
            "memory. Use a part of it or a lower sampling rate."
        )


def rows_between(span: float, interval: float, *, columns: int = 1, source: str) -> int:
    """Return how many whole intervals a span of time has.

    Parameters
    ----------
    span, interval : float
        [s]; the interval above zero.
    columns : int
        Of the table that will have so many rows.
    source : str
        The subject of the refusal, as for `check_table`.

    Raises
    ------
    InputError
        If a table of so many rows does not fit.
    """
    rows = span / interval if interval > 0.0 else math.inf
    most = min(MOST_ROWS, MOST_CELLS // max(columns, 1))
    if not 0.0 <= rows <= most:
        raise InputError(
            f"{source} spans {length_words(span)}, which is {_count(rows)} rows at intervals of {interval:g} "
            f"s; at most {most:,} rows fit in memory. Correct the times, their unit or the interval."
        )
    return math.floor(rows + 1e-6)


def length_words(seconds: float) -> str:
    """Return a length of time in the unit in which one reads it: 4.06 s, 54 years."""
    for least, unit, length in _LENGTHS:
        if abs(seconds) >= least:
            number = seconds / length
            return f"{number:.2g} {unit}" if abs(number) < 10.0 else f"{number:.0f} {unit}"
    return f"{seconds:.4g} s"


def size_words(size: float) -> str:
    """Return a number of bytes as one reads it: 1.2 MB."""
    for unit, bytes_each in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if size >= bytes_each:
            return f"{size / bytes_each:.3g} {unit}"
    return f"{size:.0f} bytes"


def _count(rows: float) -> str:
    return f"{rows:,.0f}" if rows < 1e15 else f"{rows:.3g}"
