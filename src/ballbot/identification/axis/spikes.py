"""Corrupted rows of a record: values of position or force that jump away for a single row and back.

A lost message that is logged as zero, or a bit that flips, is a row far from the straight line between the rows beside
it. One such row is most of a fit's sum of squares, and resembles play, a delay or friction near rest. It is replaced by
that line, and reported. A real motion is not replaced: it goes on in the rows beside it, and an axis that bounces off a
stop approaches it and leaves it as fast.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ballbot.findings import Finding
from ballbot.identification.axis.columns import column_finding
from ballbot.identification.axis.record import AxisRecord, Spike, SpikeColumn

#: a spike is off the line by so many times what this share of the rows is off at most
_FAR, _USUAL = 10.0, 0.95
#: and by so many times the steps of the rows on either side of it, of which the two beside it differ by a smaller share
_STEPS, _BACK = 3.0, 0.5
#: a force may vary quickly: its spikes exceed this share of its range (between the 1 % and 99 % quantiles)
_SHARE_OF_FORCE = 0.5
#: more rows than this share, and than so many, are no exception
_MOST, _ALWAYS = 0.01, 5
#: rows that a finding names
_NAMED = 4


def spike_rows(values: NDArray[np.float64], *, least: float = 0.0) -> NDArray[np.int64]:
    """Return the rows of values (N,) that jump away by more than `least` and back; empty if they are no exception."""
    a, b, value, c, d = (values[place : len(values) - 4 + place] for place in range(5))
    off = np.abs(value - 0.5 * (b + c))
    steps = np.maximum(np.abs(b - a), np.abs(d - c))
    changes = np.abs(np.diff(values))
    resolution = float(changes[changes > 0.0].min(initial=np.inf))
    usual = max(float(np.quantile(off, _USUAL)), resolution)
    found = (off > max(_FAR * usual, least)) & (off > _STEPS * steps) & (np.abs(c - b) < _BACK * off)
    rows = np.flatnonzero(found) + 2
    return rows if len(rows) <= max(_ALWAYS, _MOST * len(values)) else rows[:0]


def without_spikes(record: AxisRecord) -> AxisRecord:
    """Return a record whose spikes are replaced, and listed in it."""
    low, high = np.quantile(record.force, [0.01, 0.99])
    columns, spikes = dict[SpikeColumn, NDArray[np.float64]](), list[Spike]()
    least_of: dict[SpikeColumn, float] = {"position": 0.0, "force": _SHARE_OF_FORCE * float(high - low)}
    for name, least in least_of.items():
        values = getattr(record, name)
        rows = spike_rows(values, least=least)
        columns[name] = values.copy()
        columns[name][rows] = 0.5 * (values[rows - 1] + values[rows + 1])
        spikes += [
            Spike(column=name, row=int(row), value=float(values[row]), replacement=float(columns[name][row]))
            for row in rows
        ]
    return replace(record, **columns, spikes=tuple(spikes)) if spikes else record


def spike_findings(record: AxisRecord) -> Iterator[Finding]:
    """Give a warning for each column in which spikes were replaced."""
    for name, unit in (("position", record.unit), ("force", record.force_unit)):
        found = [one for one in record.spikes if one.column == name]
        if not found:
            continue
        first, *others = found
        rows = ", ".join(f"{one.row + 1} ({record.t[one.row]:.4g} s)" for one in others[: _NAMED - 1])
        more = f", and {len(others) - _NAMED + 1} more" if len(others) >= _NAMED else ""
        likewise = f"; likewise in row{'s' if len(others) > 1 else ''} {rows}{more}" if others else ""
        text = (
            f"Outlier{'s' if others else ''}: the {name} is {first.value:.4g} {unit} in row {first.row + 1} "
            f"({record.t[first.row]:.4g} s after the first one), and about {first.replacement:.4g} in the rows before "
            f"and after it{likewise}. Such single rows are taken as corrupted and replaced by the mean of these two. "
            "Look for lost messages in the log. If the values are real, record faster, so that they last several rows."
        )
        yield column_finding("spike", "warning", text, name)
