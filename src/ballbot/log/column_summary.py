"""The columns of a log, one by one: ranges, missing values and rates of change."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ballbot.log.columns import unit_of
from ballbot.log.log import Log


@dataclass(frozen=True, kw_only=True)
class ColumnSummary:
    """One column of a log."""

    name: str
    unit: str | None  #: None for a name that is not Ballbot's
    least: float | None  #: of the finite values; None if no value is finite
    greatest: float | None
    missing: int  #: cells that are NaN or infinite
    change_rate: float  #: changes of the value per second; for a slow sensor its own rate


def summarize(log: Log) -> tuple[ColumnSummary, ...]:
    """Return a summary of each of the log's columns, in their order."""
    duration = float(log.t[-1] - log.t[0])
    summaries = []
    for name in log.names:
        values = log[name]
        finite = values[np.isfinite(values)]
        changes = int(np.count_nonzero(np.diff(finite)))
        summaries.append(
            ColumnSummary(
                name=name,
                unit=unit_of(name),
                least=float(finite.min()) if finite.size else None,
                greatest=float(finite.max()) if finite.size else None,
                missing=len(values) - finite.size,
                change_rate=changes / duration if duration > 0.0 else 0.0,
            )
        )
    return tuple(summaries)
