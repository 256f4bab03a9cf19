"""Windows that the result predicts far worse than all others: a few bad rows, or something that acted once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ballbot.findings import Finding, warning
from ballbot.identification.axis.output_error import OutputErrorFit, Sighting
from ballbot.identification.axis.record import AxisRecord
from ballbot.identification.axis.selection import Blocks, problem_of

#: the error of such a window is above so many times what this share of the windows have at most; the largest of the 168
#: records of campaigns/axis_intervals.py, which have no outliers, is 9.2 times that
_TIMES, _SHARE = 12.0, 0.85
#: windows that a finding names
_NAMED = 3


def outlier_findings(
    fit: OutputErrorFit,
    sightings: Sequence[Sighting],
    given: Sequence[AxisRecord],
    blocks: Blocks,
    horizon: float,
) -> list[Finding]:
    """Return a warning that names these windows of a fit.

    Parameters
    ----------
    fit : OutputErrorFit
    sightings : sequence of Sighting
        Of the records that were fitted, of which rows may be left out.
    given : sequence of AxisRecord
        The same with all rows.
    blocks : Blocks
    horizon : float
        Length of the windows [s].
    """
    problem = problem_of(fit.model, sightings, blocks, horizon)
    errors = problem.projection(fit.values)(problem.errors(fit.values))
    sizes = np.sqrt(np.bincount(problem.window, errors**2) / np.bincount(problem.window))
    usual = float(np.quantile(sizes, _SHARE))
    places = np.flatnonzero(sizes > _TIMES * usual)
    if not places.size or not usual > 0.0:
        return []
    spans = []
    for one in problem.windows:
        record = sightings[one.record].record
        whole = given[one.record]
        # of a record without some of its rows, `times` counts from the first row of the whole record
        begin = 0.0 if record.times is None or len(record) == len(whole) else float(record.times[0])
        for first, count in zip(one.firsts, one.counts, strict=True):
            spans.append((whole, begin + record.t[first], begin + record.t[first + count]))
    names = []
    for place in places[np.argsort(-sizes[places])][:_NAMED]:
        record, start, end = spans[place]
        rows = np.searchsorted(record.t, [start, end]) + 1
        of_record = f" of {record.name}" if len(given) > 1 else ""
        names.append(f"{start:.4g} to {end:.4g} s (rows {rows[0]} to {rows[1]}{of_record})")
    largest, unit = float(sizes[places].max()), given[0].unit
    one = places.size == 1
    head = "Outlier: a window is" if one else f"Outliers: {places.size} windows are"
    more = f", and {places.size - _NAMED} more" if places.size > _NAMED else ""
    text = (
        f"{head} predicted with an error of up to {1e3 * largest:.3g} m{unit}, and {100.0 * _SHARE:.0f} % of the "
        f"windows with at most {1e3 * usual:.3g}: {'; '.join(names)}{more}. Rows are corrupted "
        "there, or something acted that is not recorded, such as a hand or a stop. Look at these rows; if they are "
        "wrong, leave their cells empty and run again. The 95 % intervals include how far parameters move without the "
        "windows of the largest errors."
    )
    return [warning("outliers", text)]
