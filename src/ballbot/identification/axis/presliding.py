"""Presliding: bristles in the inverse model, and whether records agree with those of a fit.

An axis that moves little has bristles that bend all the time. In an inverse model whose dry friction is a step, mass
and viscous friction then take what bends, and may be far off, or a mass below zero. With the bend that Dahl's law
gives for the recorded positions, the model stays linear but for one number, the bristles' travel: if the best explains
clearly more than a step, it is used (`bristles_travel`).

Laws of bristles also imitate what they are not: a force that is missing, friction that changes with time, an elastic
part. They then predict windows that reverse better than the law without bristles, but the axis does not yield to a
force below break-away.
Where the dry friction holds the axis (the force without offset and forces over position is below a share of c, and the
position stays within some of the bristles' travel c / sigma_0), bristles move it by the change of the force over
sigma_0. The median of moved over expected is 1 for bristles, and 0 for an axis that sticks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.identification.axis.inverse import InverseFit, free_inverse_fit
from ballbot.identification.axis.motion import default_bandwidth, position_noise
from ballbot.identification.axis.output_error import OutputErrorFit, Sighting
from ballbot.identification.axis.record import AxisRecord
from ballbot.identification.axis.structure import AxisModel

#: windows in which the axis may be held last so long [s], and have so many rows at least; the next begins halfway
_DURATION, _LEAST_ROWS = 0.03, 6
#: the force stays below this share of c and changes by that one, and the position stays within so many travels
_HELD, _CHANGE, _TRAVELS = 0.8, 0.1, 5.0
#: and so many standard deviations of its noise
_NOISES = 4.0
#: fewer windows show nothing; the least median of bristles
_LEAST_WINDOWS, _LEAST_YIELD = 5, 0.5

#: travels of bristles that are tried, as shares of the axis's travel, and how often again between the best's neighbours
_TRAVELS_TRIED, _ROUNDS = np.logspace(-4.5, -1.5, 7), 2
#: bristles are used if they lower the inverse model's error of the force to less than this share
_CLEARLY_BENT = 0.8


def bristles_travel(
    records: Sequence[AxisRecord], model: AxisModel, *, bandwidth: float | None = None
) -> float:
    """Return the travel [m] of the bristles that the inverse model of some records needs; zero if a step serves.

    Parameters
    ----------
    records : sequence of AxisRecord
    model : AxisModel
        With the forces over position that it supports.
    bandwidth : float, optional
        Of the motion [Hz].
    """

    def fit(travel: float) -> InverseFit:
        bent = replace(model, bending=travel)
        return free_inverse_fit(records, model=bent, bandwidth=bandwidth, moving=True)

    try:
        step = fit(0.0).relative_force_error
        tried = max(float(np.ptp(one.position)) for one in records) * _TRAVELS_TRIED
        fits = [fit(float(travel)) for travel in tried]
        noise = max(position_noise(one, bandwidth=bandwidth or default_bandwidth(one)) for one in records)
    except InputError:  # says what a step cannot be fitted to, where it is fitted
        return 0.0
    best = _closest(fits)
    if fits[best].relative_force_error > _CLEARLY_BENT * step or best in (0, len(tried) - 1):
        return 0.0
    for _ in range(_ROUNDS):
        tried = np.geomspace(tried[max(best - 1, 0)], tried[min(best + 1, len(tried) - 1)], len(tried))
        fits = [fit(float(travel)) for travel in tried]
        best = _closest(fits)
    wrong = min(fits[best].value("mass"), fits[best].value("coulomb")) <= 0.0
    return 0.0 if wrong or tried[best] < _NOISES * noise else float(tried[best])


def _closest(fits: Sequence[InverseFit]) -> int:
    return int(np.argmin([one.relative_force_error for one in fits]))


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
