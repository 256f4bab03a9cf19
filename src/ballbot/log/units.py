"""Decide the unit of a quantity: by its name, its size, the columns that it must agree with, and the robot.

Every command asks here. A unit in a name is taken. A column whose derivative, integral or copy stands beside it varies
as much as that: a ratio that is the factor of a unit is one (`unit_of_ratio`), and a contradiction. It is an error that
proposes the factor, and never changes data.

Without a name, every choice of units of a foreign log has a weight: the encoder's step, the size of the lean, and the
response of the lean to the wheels, which must be the robot's (`placement`), and the turning of the wheels with the
heading, which must be that of a ball that does not pivot.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from ballbot.arrays import Floats
from ballbot.findings import Finding, error
from ballbot.log.columns import FACTORS
from ballbot.log.evidence import probabilities
from ballbot.log.signals import encoder_step
from ballbot.robot import Robot

#: a balancing robot's lean is within this in nine tenths of the rows [rad], and hardly ever within this [deg]
LEAN_IN_RADIANS, LEAN_IN_DEGREES = 0.35, 0.15
#: a step that agrees with an encoder's this well is that encoder's
STEP_AGREEMENT = 0.02
#: no wheel turns faster than this many times the drive's own limit
BEYOND_LIMIT = 1.5
#: the robot file's radii, masses and heights give the lean's response to this [log]; a ball that pivots turns the
#: wheels less than the heading implies, so that the second counts for little
GAIN_DEVIATION, TURNING_DEVIATION, PIVOTS = 0.25, 0.1, 0.15
#: log weights: of steps of one count, and whole numbers that are counts
ONE_COUNT, WHOLE = 5.0, 8.0
#: [s] over which the changes of two signals are compared: a lean's noise (a few milliradians) and a gyro's drift are
#: both small then
COMPARED_TIME = 0.5
#: rows to compare at intervals longer than this [s], since the unit of time may be wrong
SLOW_ROWS, SLOW = 100, 0.2
FEWEST_ROWS = 40  #: for a comparison

#: the correlation of two signals that should be the same, and the ratio of their standard deviations with its sign
Agreement = tuple[float, float]


def agreement(first: Floats, second: Floats) -> Agreement | None:
    """Compare two signals (N,) at the rows where both are finite; None if these are too few."""
    both = np.isfinite(first) & np.isfinite(second)
    a, b = first[both], second[both]
    if both.sum() < FEWEST_ROWS or not (a.std() > 0.0 and b.std() > 0.0):
        return None
    correlation = float(np.corrcoef(a, b)[0, 1])
    return correlation, float(np.copysign(a.std() / b.std(), correlation))


def change_agreement(t: Floats, first: Floats, second: Floats) -> Agreement | None:
    """Compare the changes of two signals (N,) over half a second, at times (N,) [s]; None if these are too few."""
    known = np.isfinite(first) & np.isfinite(second)
    t, table = t[known], np.column_stack([first, second])[known]
    if len(t) < FEWEST_ROWS:
        return None
    usual = float(np.median(np.diff(t)))
    rows = int(np.clip(SLOW_ROWS if usual >= SLOW else round(COMPARED_TIME / usual), 1, len(t) // 4))
    spans, changes = t[rows:] - t[:-rows], table[rows:] - table[:-rows]
    return agreement(*changes[spans < 3.0 * np.median(spans)].T)  # not over a gap, where the rate is unknown


def unit_of_ratio(ratio: float, unit: str, *, within: float) -> str | None:
    """Return the unit of values that are `ratio` times as large as in Ballbot's `unit`; None if no factor is near.

    The nearest is taken if it is not Ballbot's own, and is away by less than the factor `within`.

    >>> unit_of_ratio(57.0, "rad", within=1.1), unit_of_ratio(1.02, "m", within=1.1)
    ('deg', None)
    """
    off = (
        {name: abs(math.log(ratio * factor)) for name, factor in FACTORS[unit].items()} if ratio > 0.0 else {}
    )
    nearest = min(off, key=lambda name: off[name], default=unit)
    return nearest if nearest != unit and off[nearest] < math.log(within) else None


def looks_like(own: str, name: str, unit: str, reason: str, option: str, *, code: str = "unit") -> Finding:
    """Return the error of a file's column that is in another unit than the log's column `own` is read in."""
    entry = f'{own} = {{ from = "{name}", unit = "{unit}" }}'
    text = (
        f"{name} looks like {unit}: {reason}. If so, write {entry} into a mapping, and give it with {option}."
    )
    return error(code, text, name)


@dataclass(frozen=True, kw_only=True)
class Unit:
    """The unit of columns, and the factor to Ballbot's."""

    name: str
    factor: float
    reason: str = ""
    weight: float = 0.0  #: logarithm of the prior weight


Units = tuple[Unit, Unit]  #: of the lean and the wheels


def wheel_units(
    t: Floats, angles: Floats, robot: Robot, named: str | None, *, of_speeds: bool, per_turn: float | None
) -> list[Unit]:
    """Return the units that wheel angles (N, n) may have, or their speeds; one alone if the heading has it.

    The counts `per_turn` of a wheel are those of the robot file if none are given.
    """
    rate = "/s" if of_speeds else ""
    counts = per_turn or robot.sensors.encoder_counts * robot.drive.gear_ratio
    of_counts = f"{counts:g} a turn {'as given' if per_turn else 'by the robot file'}"
    count = 2.0 * math.pi / counts
    table = {**FACTORS["rad" + rate], "counts" + rate: count}
    if named in table:
        reason = f"the heading has it{f', {of_counts}' if 'counts' in named else ''}"
        return [Unit(name=named, factor=table[named], reason=reason)]
    whole, step = bool(np.all(angles == np.round(angles))), None if of_speeds else encoder_step(angles)
    speeds = np.abs(angles) if of_speeds else np.abs(np.diff(angles, axis=0)) / float(np.median(np.diff(t)))
    largest = float(np.quantile(speeds, 0.98)) if speeds.size else 0.0
    units = []
    for name in ("rad/s", "deg/s", "rpm", "counts/s") if of_speeds else ("rad", "deg", "turn", "counts"):
        factor, reason = table[name], "no other unit fits as well"
        weight = 0.0 if name.startswith("rad") or name == "rpm" else -1.0
        if name.startswith("counts"):
            if not whole:
                continue
            weight, reason = weight + WHOLE, of_counts
        elif not whole and step is not None and abs(step * factor / count - 1.0) < STEP_AGREEMENT:
            weight, reason = weight + ONE_COUNT, f"steps of {step:.5g} are one encoder count"
        weight -= 9.0 if largest * factor > BEYOND_LIMIT * robot.drive.top_speed else 0.0
        units.append(Unit(name=name, factor=factor, reason=reason, weight=weight))
    return units


def lean_units(lean: Floats, named: str | None) -> list[Unit]:
    """Return the units that roll and pitch (N, 2) may have; one alone if the heading has it."""
    table = FACTORS["rad"]
    if named in table:
        return [Unit(name=named, factor=table[named], reason="the heading has it")]
    size = float(np.nanquantile(np.abs(lean - np.nanmedian(lean, axis=0)), 0.9))
    reason = f"nine tenths of the angles are within {size:.2g}"
    weights = {
        "rad": -9.0 if size > LEAN_IN_RADIANS else 0.0,
        "deg": -5.0 if size < LEAN_IN_DEGREES else -1.5 if size < LEAN_IN_RADIANS else 0.0,
    }
    return [Unit(name=name, factor=table[name], reason=reason, weight=w) for name, w in weights.items()]


def likeliest_units(
    leans: Sequence[Unit],
    wheels: Sequence[Unit],
    assumed: Units | None = None,
    *,
    gain: float | None = None,
    turning: float | None = None,
    heading_named: bool = False,
) -> dict[Units, float]:
    """Return the probability of each choice of units of lean and wheels, the likeliest first.

    `gain` is the response of the lean to the wheels over the robot's, and `turning` that of the wheels to the heading
    over that of a ball that does not pivot, as the motion shows them with the units `assumed`. A heading without a unit
    of its own has the lean's.
    """
    weights = {}
    for lean, wheel in product(leans, wheels):
        weight = lean.weight + wheel.weight
        old_lean, old_wheel = assumed or (lean, wheel)
        leaned, turned = lean.factor / old_lean.factor, wheel.factor / old_wheel.factor
        if gain is not None:
            # noise of the wheels, and rolling on play, make the gain too small
            off = math.log(max(gain, 1e-12) * leaned / turned) + 0.1
            weight += math.log(_normal(off, GAIN_DEVIATION) + 1e-3)
        if turning is not None:
            off = math.log(max(turning, 1e-12) * turned / (1.0 if heading_named else leaned))
            likely = (1.0 - PIVOTS) * _normal(off, TURNING_DEVIATION) + PIVOTS * _normal(off, 0.7)
            weight += math.log(likely + 1e-3)
        weights[lean, wheel] = weight
    return probabilities(weights)


def _normal(value: float, deviation: float) -> float:
    return math.exp(-0.5 * min((value / deviation) ** 2, 1400.0))
