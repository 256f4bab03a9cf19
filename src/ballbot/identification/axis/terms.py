"""Selection of the forces of an axis over position, and of a drift of its offset.

Forces enter the inverse model one after another, the one first that explains most of the force of held-out blocks,
while the gain has a 95 % interval above zero and the coefficients differ from zero (`LARGEST_CHANCE`). The harmonics
tried are the first one of an axis that turns, and those at which the residual force is largest.

Noise of the position biases the inverse model: it takes some of the mass's force away, and if an axis repeats its
motion, a force over position may stand for what is missing. The open loop does not have that bias. Forces whose
coefficients are all within `_REFUTED` standard errors of zero there are dropped, if the fit without them predicts
held-out blocks no worse; so is friction under load, whatever its coefficient.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ballbot.fitting.least_squares import fit_linear
from ballbot.fitting.model_selection import Gain, gain_between, neighbours
from ballbot.identification.axis.inverse import BLOCK, RegressionRows, regression_rows
from ballbot.identification.axis.laws import Values
from ballbot.identification.axis.load import possible_loads
from ballbot.identification.axis.output_error import Sighting
from ballbot.identification.axis.presliding import bristles_travel
from ballbot.identification.axis.record import AxisRecord, moved_by_one_load
from ballbot.identification.axis.repetition import parts_at, parts_in
from ballbot.identification.axis.selection import FOLDS, MOST_BLOCKS, Blocks, fit_all, held_out_errors
from ballbot.identification.axis.structure import TURN, AxisModel, base_name, harmonic

#: largest p-value of the coefficients of a force that is selected; divided by the number of harmonics searched
LARGEST_CHANCE = 1e-3
#: and if it lowers the error of the force on held-out blocks by this share
LEAST_GAIN = 0.01
#: forces over position selected at most, and the highest harmonic searched
_MOST_TERMS, _HIGHEST_HARMONIC = 6, 120
#: a harmonic is searched in rows between which its phase moves by less [rad], if there are so many
_FASTEST_PHASE, _LEAST_SLOW_ROWS = 1.5, 50
#: weight of the gain of a spring on an axis that turns, and of a load: gravity comes before a spring, which resembles
#: it over a small travel, and before friction that depends on the drive's force, which contains a gravity not yet found
_SPRING_WORTH, _LOAD_WORTH = 0.3, 0.3
#: least travel over which a harmonic is searched, in its periods; gravity over less resembles it
_PERIODS = 1.5
#: a drift has a piece for so long [s], at most so many
_DRIFT_PIECE, _MOST_PIECES = 8.0, 6
#: of the columns of a wider model, each of length one
_LARGEST_CONDITION = 300.0
#: coefficients of a force that the open loop refutes are within so many standard errors of zero
_REFUTED = 2.0

#: kinds of forces that can be selected
Kind = Literal["spring", "harmonic", "load", "drift"]
KINDS: tuple[Kind, ...] = ("spring", "harmonic", "load", "drift")


def select_terms(
    records: Sequence[AxisRecord],
    model: AxisModel,
    *,
    kinds: Collection[Kind] = KINDS,
    bandwidth: float | None = None,
) -> tuple[AxisModel, tuple[tuple[str, Gain], ...]]:
    """Return a model with the forces of these kinds and the bristles that records support, and each force's gain."""
    wanted, gains = model, list[tuple[str, Gain]]()
    turns = records[0].unit == "rad"
    rows = regression_rows(records, model, bandwidth=bandwidth, moving=True)
    squares = _held_out_force(records, rows)
    for _ in range(_MOST_TERMS):
        best = None
        for name, candidate in _wider(records, model, rows, kinds):
            searched = name.startswith("harmonic ") and name != "harmonic 1"
            chance = LARGEST_CHANCE / (_HIGHEST_HARMONIC if searched else 1)
            found = _gain_of(records, candidate, rows, squares, bandwidth, chance)
            if not found:
                continue
            worth = found[1].share * (_SPRING_WORTH if name == "spring" and turns else 1.0)
            worth *= _LOAD_WORTH if name.startswith("load ") else 1.0
            if best is None or worth > best[0]:
                best = (worth, name, candidate, found[1], found[0])
        if best is None:
            break
        _, name, model, gain, rows = best
        gains.append((name, gain))
        squares = _held_out_force(records, rows)
    if wanted.bending == 0.0 and (travel := bristles_travel(records, model, bandwidth=bandwidth)):
        # forces over position may have stood for bristles
        return select_terms(records, replace(wanted, bending=travel), kinds=kinds, bandwidth=bandwidth)
    return model, tuple(gains)


def gain_of_load(
    records: Sequence[AxisRecord], model: AxisModel, *, bandwidth: float | None = None
) -> Gain | None:
    """Return what friction over a model's load gains; None if the records do not support it."""
    rows = regression_rows(records, replace(model, load=None), bandwidth=bandwidth, moving=True)
    found = _gain_of(records, model, rows, _held_out_force(records, rows), bandwidth, LARGEST_CHANCE)
    return found[1] if found else None


def chance_of_load(
    records: Sequence[AxisRecord], model: AxisModel, *, bandwidth: float | None = None
) -> float:
    """Return the p-value that the inverse model gives to no friction over a model's load."""
    rows = regression_rows(records, model, bandwidth=bandwidth, moving=True)
    own = [place for place, label in enumerate(rows.columns) if base_name(label) == "load"]
    return fit_linear(np.column_stack(list(rows.columns.values())), rows.force, rows.block).p_value(own)


def _wider(
    records: Sequence[AxisRecord], model: AxisModel, rows: RegressionRows, kinds: Collection[Kind]
) -> list[tuple[str, AxisModel]]:
    """Return models with one force more."""
    found = []
    falling = moved_by_one_load(records)
    if "spring" in kinds and "spring" not in model.terms and not falling:
        found.append(("spring", replace(model, terms=("spring", *model.terms))))
    if "drift" in kinds and model.drifts == 0:
        shortest = min(record.duration for record in records)
        pieces = int(min(_MOST_PIECES, max(2.0, shortest / _DRIFT_PIECE)))
        found.append(("drift", replace(model, drifts=pieces)))
    if "load" in kinds and model.load is None and not falling:
        possible = possible_loads(records, over_position=bool(model.terms))
        found += [(f"load {one}", replace(model, load=one)) for one in possible]
    if "harmonic" in kinds and (records[0].unit == "rad" or model.period != TURN):
        numbers = [*([] if falling else [1]), *_strongest_harmonics(model, rows)]
        for number in dict.fromkeys(numbers):
            names = harmonic(number)
            if names[0] not in model.terms:
                found.append((f"harmonic {number}", replace(model, terms=(*model.terms, *names))))
    return found


def _strongest_harmonics(model: AxisModel, rows: RegressionRows) -> list[int]:
    """Return the two harmonics at which the residual force is largest."""
    X = np.column_stack(list(rows.columns.values()))
    residual = rows.force - X @ np.linalg.lstsq(X, rows.force, rcond=None)[0]
    position = rows.seen["position"]
    least = max(2, int(np.ceil(_PERIODS * model.period / np.ptp(position))))
    numbers = [n for n in range(least, _HIGHEST_HARMONIC + 1) if harmonic(n)[0] not in model.terms]
    # the filter has removed a harmonic that passes faster than rows come
    turning = np.abs(rows.seen["speed"]) * float(np.median(np.abs(np.diff(rows.seen["time"]))))
    sizes = np.zeros(len(numbers))
    for place, number in enumerate(numbers):
        wave = 2.0 * np.pi / model.period * number
        slow = wave * turning < _FASTEST_PHASE
        if slow.sum() >= _LEAST_SLOW_ROWS:
            waves = np.exp(-1j * wave * position[slow])
            sizes[place] = abs(waves @ residual[slow]) / np.sqrt(slow.sum())
    order = np.argsort(sizes)[::-1][:2]
    return [numbers[i] for i in order]


def _gain_of(
    records: Sequence[AxisRecord],
    candidate: AxisModel,
    rows: RegressionRows,
    squares: NDArray[np.float64],
    bandwidth: float | None,
    largest_chance: float,
) -> tuple[RegressionRows, Gain] | None:
    """Return the rows of a wider model and its gain; None if the records do not support it."""
    wider = regression_rows(records, candidate, bandwidth=bandwidth, moving=True)
    X = np.column_stack(list(wider.columns.values()))
    new = [i for i, label in enumerate(wider.columns) if label not in rows.columns]
    lengths = np.linalg.norm(X, axis=0)
    if not lengths.all() or np.linalg.cond(X / lengths) > _LARGEST_CONDITION:
        return None
    chance = fit_linear(X, wider.force, wider.block).p_value(new)
    ours = _held_out_force(records, wider)
    gain = gain_between(ours, squares, neighbours(range(len(ours)), block=1))
    if not gain.significant or gain.share < LEAST_GAIN or chance > largest_chance:
        return None
    return wider, gain


def _held_out_force(records: Sequence[AxisRecord], rows: RegressionRows) -> NDArray[np.float64]:
    """Return the sum of squared force errors of each held-out group of blocks (g, 1)."""
    X = np.column_stack(list(rows.columns.values()))
    part = parts_of(records, rows)
    count = int(part.max()) + 1
    group = part * min(count, MOST_BLOCKS) // count
    squares = np.empty((int(group.max()) + 1, 1))
    for fold in range(FOLDS):
        seen = group % FOLDS != fold
        found = np.linalg.lstsq(X[seen], rows.force[seen], rcond=None)[0]
        errors = (rows.force[~seen] - X[~seen] @ found) ** 2
        sums = np.bincount(group[~seen], weights=errors, minlength=len(squares))
        squares[fold::FOLDS, 0] = sums[fold::FOLDS]
    return squares


def parts_of(records: Sequence[AxisRecord], rows: RegressionRows) -> NDArray[np.int64]:
    """Return the part of the motion that each row (n,) is in: its block, or all blocks that repeat each other."""
    found, begin = np.empty(len(rows.block), dtype=np.int64), 0
    for number, record in enumerate(records):
        own = rows.seen["record"] == number
        count = parts_in(record.repetition, BLOCK)
        parts = parts_at(rows.seen["time"][own], record.repetition, count) if count else rows.block[own]
        _, parts = np.unique(parts, return_inverse=True)
        found[own] = begin + parts
        begin = int(found[own].max()) + 1
    return found


def without_refuted(
    model: AxisModel,
    start: Values,
    selected: tuple[tuple[str, Gain], ...],
    sightings: Sequence[Sighting],
    blocks: Blocks,
    horizon: float,
) -> tuple[AxisModel, tuple[tuple[str, Gain], ...]]:
    """Return a model and the selected forces without those over position that the open loop refutes.

    Parameters
    ----------
    model : AxisModel
        With a law of dry friction.
    start : mapping of str to float
        Where its fit begins.
    selected : tuple
        Of names of forces, "spring" or "harmonic 4", and their gains.
    sightings, blocks
    horizon : float
        Length of the windows [s].
    """
    if not any(coefficients_of(name) for name, _ in selected):
        return model, selected
    full = fit_all(model, start, sightings, blocks, horizon)

    def differs(label: str) -> bool:
        # a coefficient without a standard error is at a bound or has no effect
        return abs(full.values[label]) > _REFUTED * full.standard_errors[label]

    kept = tuple(
        (force, gain)
        for force, gain in selected
        if not (own := coefficients_of(force))
        or any(differs(label) for label in model.labels if base_name(label) in own)
    )
    if kept == selected and model.load:
        # a friction that other causes resemble must gain in the open loop as well
        kept = tuple((force, gain) for force, gain in selected if not force.startswith("load "))
    if kept == selected:
        return model, selected
    dropped = {name for one in selected if one not in kept for name in coefficients_of(one[0])}
    narrow = replace(
        model,
        terms=tuple(name for name in model.terms if name not in dropped),
        load=None if "load" in dropped else model.load,
    )
    own = {label: full.values[label] for label in narrow.labels}
    fits = (full, fit_all(narrow, own, sightings, blocks, horizon))
    wide, thin = (
        held_out_errors(fit, sightings, blocks, horizon=horizon, judged=[(horizon, False)]) for fit in fits
    )
    needed = gain_between(wide, thin, blocks.groups()).significant
    return (model, selected) if needed else (narrow, kept)


def coefficients_of(force: str) -> tuple[str, ...]:
    """Return the parameters of a force that is selected by name; none of a drift, which is subtracted before."""
    kind, _, number = force.partition(" ")
    return harmonic(int(number)) if kind == "harmonic" else () if kind == "drift" else (kind,)
