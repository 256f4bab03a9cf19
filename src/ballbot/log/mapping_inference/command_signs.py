"""The sign of commands that are never negative: a number that stands for zero, or columns with the direction.

A duty about 128 of 255, or a servo's pulse about 1500 us, has its zero at a number that every maker of such drivers
uses. The commands show which one it is while the motors rest, when all commands are that number, or by their mean: a
robot that balances pushes one way as much as the other. A robot that leans a little on average shifts the mean, so two
candidate zeros that are close together, compared with the size of the commands, cannot be told apart. The choice
between them then changes the commands as little.

A magnitude has its direction in a column of its own, 0 or 1, or -1 or 1. Which of them is forward is part of the signs
of the commands (`ballbot.log.mapping_inference.commands`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.log.mapping_inference.evidence import (
    CONFIDENT,
    MOST,
    jackknife_error,
    normal_log_weight,
    probabilities,
)
from ballbot.log.mapping_inference.names import Reading

#: full scales, with weights, of the numbers that stand for zero: half a range of 1, of percents, of a servo's degrees,
#: of a byte, of a thousand, of 10 and 12 bits, a servo's pulse [us], and of 16 bits
_FULL_SCALES: dict[float, dict[float, float]] = {
    0.5: {0.5: 1.0},
    50.0: {50.0: 1.0},
    90.0: {90.0: 1.0},
    127.0: {127.0: 1.0},
    127.5: {127.5: 1.0},
    128.0: {127.0: 1.0},
    500.0: {500.0: 1.0},
    511.5: {511.5: 1.0},
    512.0: {511.0: 1.0},
    1000.0: {1000.0: 1.0},
    1500.0: {500.0: 1.0, 400.0: 0.3},
    2047.5: {2047.5: 1.0},
    2048.0: {2047.0: 1.0},
    32767.5: {32767.5: 1.0},
    32768.0: {32767.0: 1.0},
}
_RARE_ZEROS = {500.0: 0.3, 1000.0: 0.3, 511.5: 0.5, 2047.5: 0.5, 32767.5: 0.5, 127.0: 0.7}
#: commands that balance pass through zero: of their magnitudes, this fraction is below that fraction of the largest
LEAST_MAGNITUDE, FAR_FROM_ZERO = 0.1, 0.15
#: error of the commands' mean beyond the jackknife, and how near to another zero the right one may be to be the same
#: answer, both in standard deviations of the commands; chosen
MEAN_ERROR, SAME_ZERO = 0.15, 0.06
#: motors that hold one number together for so many rows, in which nothing else is commanded, rest
RESTING_ROWS = 25
#: standard errors by which the mean of the commands may be off their zero
FARTHEST = 4.0
#: a number at which motors rest is a usual zero, trimmed, if it differs by less than this part of the full scale; and
#: the confidence in it
TRIMMED, RESTING = 0.08, 0.99


@dataclass(frozen=True, kw_only=True)
class CommandZero:
    """The number that stands for a command of zero."""

    value: float  #: in the file's numbers
    #: the numbers that may be a full duty, from the zero, with the weights that they have by use
    full_scales: Mapping[float, float]
    confidence: float
    evidence: str
    alternatives: tuple[float, ...] = ()


def never_negative(commands: NDArray[np.float64]) -> bool:
    """Return whether commands (N, n) have no sign: none is negative, and one is positive."""
    known = commands[np.isfinite(commands)]
    return len(known) > 0 and not known.min() < 0.0 < known.max()


def far_from_zero(commands: NDArray[np.float64]) -> bool:
    """Return whether commands without a sign stay far from zero, as those of a balancing robot do not."""
    size = np.abs(commands[np.isfinite(commands)])
    return bool(np.quantile(size, LEAST_MAGNITUDE) > FAR_FROM_ZERO * size.max())


def zero_of(commands: NDArray[np.float64], seconds: NDArray[np.float64]) -> CommandZero | None:
    """Return the number that stands for zero in commands that stay far from zero; None if no usual one fits.

    Parameters
    ----------
    commands : ndarray (N, n)
        As the file has them.
    seconds : ndarray (N,)
        The rows' times [s].
    """
    whole = np.isfinite(commands).all(axis=1)
    values, t = commands[whole], seconds[whole]
    if len(values) < RESTING_ROWS:
        return None
    resting = _resting_number(values)
    driven = np.ones(len(values), dtype=np.bool_) if resting is None else (values != resting).any(axis=1)
    if driven.sum() < RESTING_ROWS:
        return None
    size = float(values[driven].std())
    mean, error = _mean_with_error(values[driven], np.floor(t[driven] - t[0]).astype(int))
    error = float(np.hypot(error, MEAN_ERROR * size))
    extent = float(values.min()), float(values.max())
    shown = f"the commands are {extent[0]:g} to {extent[1]:g}, in the mean {mean:.4g} (standard error {error:.2g})"
    if resting is not None and abs(resting - mean) < FARTHEST * error:
        usual = min(_FULL_SCALES, key=lambda zero: abs(zero - resting))
        scales = _reached(_FULL_SCALES[usual], resting, extent)
        if scales and abs(usual - resting) <= TRIMMED * max(scales):
            evidence = f"{shown}; while the motors rest, all are {resting:g}"
            return CommandZero(value=resting, full_scales=scales, confidence=RESTING, evidence=evidence)
    fractions = bool(np.any(values != np.round(values)))
    weights = {
        zero: normal_log_weight(zero - mean, error, outlier=1e-9) + math.log(_RARE_ZEROS.get(zero, 1.0))
        for zero, scales in _FULL_SCALES.items()
        # a range of 1 has fractions
        if abs(zero - mean) < FARTHEST * error
        and _reached(scales, zero, extent)
        and (zero >= 1.0 or fractions)
    }
    return _likeliest(weights, size, extent, shown) if weights else None


def _likeliest(
    weights: Mapping[float, float], size: float, extent: tuple[float, float], shown: str
) -> CommandZero:
    """Return the likeliest zero, with those that are no other answer to commands of a size."""
    found = probabilities(weights)
    value = next(iter(found))
    same = [zero for zero in found if abs(zero - value) < SAME_ZERO * size]
    confidence = min(sum(found[zero] for zero in same), MOST)
    return CommandZero(
        value=value,
        full_scales=_reached(_FULL_SCALES[value], value, extent),
        confidence=confidence,
        evidence=shown,
        alternatives=tuple(zero for zero, p in found.items() if zero not in same and p > 1.0 - MOST)
        if confidence < CONFIDENT
        else (),
    )


def _resting_number(values: NDArray[np.float64]) -> float | None:
    """Return the number that all commands (N, n) have for the most rows on end; None if for no long time."""
    alike = np.all(values == values[:, :1], axis=1)
    new = np.concatenate(([True], (np.diff(values[:, 0]) != 0.0) | ~alike[1:] | ~alike[:-1]))
    starts = np.flatnonzero(new)
    lengths = np.diff(np.append(starts, len(values)))
    longest = int(np.argmax(lengths))
    return float(values[starts[longest], 0]) if lengths[longest] >= RESTING_ROWS else None


def _mean_with_error(values: NDArray[np.float64], blocks: NDArray[np.intp]) -> tuple[float, float]:
    """Return the mean of commands (N, n) over rows and motors, and its standard error over blocks of a second."""
    rows = values.mean(axis=1)
    _, place = np.unique(blocks, return_inverse=True)
    sums, counts = np.bincount(place, weights=rows), np.bincount(place)
    if len(sums) < 3:
        return float(rows.mean()), float(rows.std())
    return float(rows.mean()), jackknife_error((sums.sum() - sums) / (counts.sum() - counts))


def _reached(scales: Mapping[float, float], zero: float, extent: tuple[float, float]) -> dict[float, float]:
    """Return the full scales that no command exceeds by more than a step of rounding."""
    beyond = max(extent[1] - zero, zero - extent[0])
    return {full: weight for full, weight in scales.items() if beyond <= 1.01 * full}


def directions_of(
    readings: Sequence[Reading], columns: Mapping[str, NDArray[np.float64]], commands: Sequence[str]
) -> tuple[str, ...]:
    """Return the columns with the directions of commands that are magnitudes, in their order; empty if unclear.

    Parameters
    ----------
    readings : sequence of Reading
        Of the columns' names.
    columns : mapping of str to (N,) array
    commands : sequence of str
        The columns of the magnitudes.
    """
    places = {one.name: one.index for one in readings if one.index is not None}
    if not all(name in places for name in commands):
        return ()
    series: dict[str, dict[int, str]] = {}
    for one in readings:
        if one.index is not None and one.name not in commands and _is_direction(columns[one.name]):
            series.setdefault(one.stem, {})[one.index] = one.name
    wanted = [places[name] for name in commands]
    found = [
        tuple(names[k] for k in wanted if k is not None)
        for names in series.values()
        if set(wanted) <= {*names}
    ]
    return found[0] if len(found) == 1 else ()


def _is_direction(values: NDArray[np.float64]) -> bool:
    """Return whether a column has the values 0 and 1, or -1 and 1, perhaps with 0 for none."""
    known = {float(one) for one in np.unique(values[np.isfinite(values)])[:4]}
    return known in ({0.0, 1.0}, {-1.0, 1.0}, {-1.0, 0.0, 1.0})
