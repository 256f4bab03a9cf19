"""Checks of a log's time and of cells without a value. (Time that does not increase makes no `Log` at all.)"""

import numpy as np

from ballbot.findings import Finding, Place
from ballbot.log.log import Log

#: an interval this many times the usual longest one is a gap: one lost row of a regular log makes 2
GAP_RATIO = 1.5
#: intervals that scatter by more than this part of their median are worth a warning
JITTER_RATIO = 0.05


def check_rows(log: Log) -> list[Finding]:
    """Return an error for a log of one row."""
    if len(log) > 1:
        return []
    sentence = "The log has one row, which shows no motion; every use needs many rows."
    return [Finding(severity="error", code="rows", text=sentence)]


def check_gaps(log: Log) -> list[Finding]:
    """Return a warning where rows are missing: intervals longer than the clock's own scatter explains."""
    intervals = np.diff(log.t)
    if intervals.size < 3:
        return []
    # the 95th percentile, not the median: logs whose host polls late alternate between two intervals
    usual = float(np.quantile(intervals, 0.95, method="lower"))
    gaps = np.flatnonzero(intervals > GAP_RATIO * usual)
    if not gaps.size:
        return []
    first, longest = int(gaps[0]), float(intervals[gaps].max())
    number = "One gap" if gaps.size == 1 else f"{gaps.size} gaps"
    sentence = (
        f"{number} in time, the first of {intervals[first]:.4g} s after row "
        f"{first + 1} (t = {log.t[first]:.6g} s), the longest {longest:.4g} s, "
        f"while rows come every {log.sample_time:.4g} s; windows must not span them."
    )
    return [
        Finding(
            severity="warning",
            code="gap",
            text=sentence,
            where=Place(columns=("t",), time=float(log.t[first])),
        )
    ]


def check_jitter(log: Log) -> list[Finding]:
    """Return a warning where the intervals, gaps aside, scatter."""
    intervals = np.diff(log.t)
    if intervals.size < 3:
        return []
    typical = intervals[intervals <= GAP_RATIO * np.quantile(intervals, 0.95, method="lower")]
    scatter = float(typical.std() / np.median(typical))
    if scatter <= JITTER_RATIO:
        return []
    sentence = (
        f"The intervals between rows vary by {100 * scatter:.0f} % about {log.sample_time:.4g} s "
        f"(from {typical.min():.4g} to {typical.max():.4g} s); rates from differences will be noisy."
    )
    return [Finding(severity="warning", code="jitter", text=sentence, where=Place(columns=("t",)))]


def check_missing_values(log: Log) -> list[Finding]:
    """Return a warning for each column with cells that are NaN or infinite."""
    findings = []
    for name in log.names:
        bad = np.flatnonzero(~np.isfinite(log[name]))
        if not bad.size:
            continue
        time = float(log.t[bad[0]])
        sentence = (
            f"{name} has {bad.size} of {len(log)} values missing or not finite, the first at row {bad[0] + 1} "
            f"(t = {time:.6g} s); uses that need this column stop until they are filled or removed."
        )
        findings.append(
            Finding(
                severity="warning", code="missing", text=sentence, where=Place(columns=(name,), time=time)
            )
        )
    return findings
