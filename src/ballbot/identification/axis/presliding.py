"""Whether records agree with bristles: an axis held by them yields to a force below break-away.

Laws of bristles also imitate what they are not: a force that is missing, friction that changes with time, an elastic
part. They then predict windows that reverse better than the law without bristles, but the axis does not yield at rest.
Where the dry friction holds the axis (the force without offset and forces over position is below a share of c, and the
position stays within some of the bristles' travel c / sigma_0), bristles move it by the change of the force over
sigma_0. The median of moved over expected is 1 for bristles, and 0 for an axis that sticks.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ballbot.identification.axis.output_error import OutputErrorFit, Sighting

#: windows in which the axis may be held last so long [s], and have so many rows at least; the next begins halfway
_DURATION, _LEAST_ROWS = 0.03, 6
#: the force stays below this share of c and changes by that one, and the position stays within so many travels
_HELD, _CHANGE, _TRAVELS = 0.8, 0.1, 5.0
#: and so many standard deviations of its noise
_NOISES = 4.0
#: fewer windows show nothing; the least median of bristles
_LEAST_WINDOWS, _LEAST_YIELD = 5, 0.5


def bristles_agree(fit: OutputErrorFit, sightings: Sequence[Sighting]) -> bool:
    """Return whether the records can show the bristles of a fit, and do not contradict them."""
    found, visible = [], False
    for number, seen in enumerate(sightings):
        own = fit.model.values_for(fit.values, number)
        visible = visible or own["coulomb"] / own["stiffness"] > seen.noise
        found.append(_yields(fit, seen, number))
    yields = np.concatenate(found)
    return visible and (len(yields) < _LEAST_WINDOWS or float(np.median(yields)) > _LEAST_YIELD)


def _yields(fit: OutputErrorFit, seen: Sighting, number: int) -> NDArray[np.float64]:
    """Return moved over expected of each window in which the axis is held (w,)."""
    record, own = seen.record, fit.model.values_for(fit.values, number)
    axis = fit.model.axis(fit.values, number)
    force = axis.acting(record) - axis.position_force(record.position, record.known_load)
    rows = max(_LEAST_ROWS, round(_DURATION / record.sample_time))
    firsts = np.concatenate(
        [np.arange(first, last - rows + 1, max(1, rows // 2)) for first, last in record.segments]
    ).astype(np.int64)
    if not len(firsts):
        return np.empty(0)
    places = firsts[:, None] + np.arange(rows)
    # the force's noise is averaged over thirds of a window
    forces, positions = (
        np.stack([part.mean(axis=1) for part in np.array_split(values[places], 3, axis=1)], axis=1)
        for values in (force, record.position)
    )
    dry, stiffness = own["coulomb"], own["stiffness"]
    change = forces[:, 2] - forces[:, 0]
    near = np.ptp(record.position[places], axis=1) < _TRAVELS * dry / stiffness + _NOISES * seen.noise
    held = near & (np.abs(forces).max(axis=1) < _HELD * dry) & (np.abs(change) > _CHANGE * dry)
    return (positions[:, 2] - positions[:, 0])[held] * stiffness / change[held]
