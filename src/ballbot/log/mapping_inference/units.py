"""In which units a foreign file has its lean, wheel angles and heading: by name, by size, and by the motion.

Every choice of their units has a weight, from the names, the encoder's step, the lean's size, and from the lean's
response to the wheels, which must be the robot's (`ballbot.log.mapping_inference.placement`). Only
the ratio of lean and wheels is in that response: degrees for both fit as well as radians for both, and sizes and steps
decide. Where the heading turns with the wheels, as it does on a ball that does not pivot, it shows the ratio of heading
and wheels, and no mass or height enters: a yaw in degrees beside a lean in radians is found so, and counts per turn
unlike the robot file's, which are asked for.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ballbot.log.columns import FACTORS
from ballbot.log.mapping_inference.evidence import (
    MOST,
    normal_log_weight,
    probabilities,
)
from ballbot.robot import Robot
from ballbot.robot.derived import wheel_speed_limit

#: a wheel's path in place of its angle
PATH = "mm"


@dataclass(frozen=True, kw_only=True)
class Scale:
    """The unit of columns, and what turns their numbers into Ballbot's."""

    unit: str
    factor: float  #: what turns the file's number into Ballbot's unit, unit and scale in one
    scale: float = 1.0  #: part of the factor that the unit does not have
    reason: str
    confidence: float = 1.0
    alternatives: tuple[str, ...] = ()
    counted: bool = False  #: whether speeds are encoder counts from row to row, whose sum is exact

    @property
    def description(self) -> str:
        """The unit, with the scale if there is one."""
        if self.unit == "counts":
            return f"counts, {2.0 * math.pi / self.factor:g} a turn"
        if self.unit == "counts/s":
            return f"counts/s, {2.0 * math.pi / self.factor:g} counts a turn"
        if self.unit == PATH:
            return "mm of path, the wheel's radius times its angle"
        return self.unit if self.scale == 1.0 else f"{self.unit} of the motor"


def step_of(values: NDArray[np.float64]) -> float | None:
    """Return the smallest step of which all steps of a column are multiples; None if there is no such step."""
    steps = np.abs(np.diff(values[np.isfinite(values)]))
    steps = steps[steps > 1e-9]
    if len(steps) < 20:
        return None
    step = float(np.quantile(steps, 0.001, method="lower"))
    multiples = steps[steps < 20.5 * step] / step
    whole = np.abs(multiples - np.round(multiples)) < 0.05
    return step if len(multiples) >= 20 and whole.mean() > 0.95 else None


#: no wheel turns so far from one row of a log to the next [rad]: 20 rad/s in rows of 25 ms
LARGEST_INCREMENT = 0.5


def are_angles(values: NDArray[np.float64], robot: Robot) -> bool:
    """Return whether columns (M, n) step by one encoder count, as no speeds do, and are too large for increments."""
    count = 2.0 * math.pi / (robot.sensors.encoder_counts * robot.drive.gear_ratio)
    steps = [step for step in (step_of(column) for column in values.T) if step is not None]
    if not steps:
        return False
    step, largest = float(np.median(steps)), float(np.nanmax(np.abs(values)))
    factors = [FACTORS["rad"][unit] for unit in ("rad", "deg", "turn")]
    return any(
        abs(step * one / count - 1.0) < STEP_AGREEMENT and largest * one > LARGEST_INCREMENT
        for one in factors
    )


#: beyond this lean, in a tenth of the rows, a balancing robot's angle is not in radians
LEAN_IN_RADIANS = 0.35
#: and below this it is hardly in degrees [deg]
LEAN_IN_DEGREES = 0.15
#: beyond this, in half of the rows, a balancing robot's lean is hardly in degrees either [deg]
LEAN_IN_FINE_UNITS = 10.0
#: a step that agrees with an encoder's this well is that encoder's
STEP_AGREEMENT = 0.02
#: the robot file's radii, masses and heights give the lean's response to this [log]
GAIN_DEVIATION = 0.25
#: the wheels' turning over the heading's agrees with a ball that does not pivot to this [log]: in 74 of 77 logs of two
#: halves of campaigns/mapping_corpus.py, within 0.05
TURNING_DEVIATION = 0.1
#: unless the ball pivots: with this probability, and then to this. Three real logs have 0.16, 0.59 and 0.72
PIVOTS, PIVOTING_DEVIATION = 0.15, 0.7
#: the heading says something of the wheels' unit if their sum and its rate correlate so well
TURNING_CORRELATION = 0.9
#: probability of counts per turn unlike the robot file's, and by how much they then differ [log]: quadrature is 4
OTHER_COUNTS, OTHER_COUNTS_DEVIATION = 0.1, 1.1
#: such counts are known to some per cent and must be asked for
MOST_BY_HEADING = 0.6
#: counts a turn over the robot file's if one file has lines, and the other all edges of two channels, or one's
_OTHER_EDGES = (4.0, 2.0, 0.5, 0.25)
#: that the numbers fit such counts; and, if they do not, the likeliest reason
OTHER_EDGES_WORDS = "as if other edges of the encoder's lines were counted"
OTHER_ROBOT = "a robot unlike its file, whose radii and tilt this number rests on"
#: a name that has a unit is believed so much
_NAMED = 0.98


def lean_units(lean: NDArray[np.float64], named: str | None) -> dict[Scale, float]:
    """Return the units of roll and pitch (N, 2) with the logarithms of their weights, by name and size."""
    size = float(np.nanquantile(np.abs(lean - np.nanmedian(lean, axis=0)), 0.9))
    found = {}
    usual = float(
        np.nanmedian(np.abs(lean - np.nanmedian(lean, axis=0)))
    )  # a fallen robot may lie for a while
    fine = ("mrad", "cdeg") if usual > LEAN_IN_FINE_UNITS or named in ("mrad", "cdeg") else ()
    for unit in ("rad", "deg", *fine):
        factor = FACTORS["rad"][unit]
        weight = 0.0 if named is None else math.log(_NAMED if unit == named else 1.0 - _NAMED)
        if unit == "rad" and size > LEAN_IN_RADIANS:
            weight -= 9.0
        if unit == "deg":
            weight -= 5.0 if size < LEAN_IN_DEGREES else 1.5 if size < LEAN_IN_RADIANS else 0.0
            weight -= 4.0 if usual > LEAN_IN_FINE_UNITS else 0.0
        reason = f"nine tenths of the angles are within {size:.2g}"
        found[Scale(unit=unit, factor=factor, reason=_with_name(named, reason))] = weight
    return found


#: an encoder that begins again after so many counts is absolute; after more, it may be a counter that is full
LARGEST_ABSOLUTE = 2.0**14
#: such counts
OF_THE_ENCODER = "counts of the encoder, after which it begins again"


def wheel_units(
    angles: NDArray[np.float64], robot: Robot, named: str | None, *, wrap: float | None = None
) -> dict[Scale, float]:
    """Return the units of wheel angles (N, n) with the logarithms of their weights, by name and encoder step.

    `wrap` is the counts after which encoders begin again, on the wheel or on the motor.
    """
    gear, counts = robot.drive.gear_ratio, float(robot.sensors.encoder_counts)
    steps = [step for step in (step_of(column) for column in angles.T) if step is not None]
    step = float(np.median(steps)) if steps else None
    whole = bool(np.all(angles[np.isfinite(angles)] == np.round(angles[np.isfinite(angles)])))
    turn = 2.0 * math.pi
    wheel_factors = [(unit, FACTORS["rad"][unit]) for unit in ("rad", "deg", "turn")]
    candidates = [(unit, factor, 1.0, unit, 0.0) for unit, factor in wheel_factors]
    candidates.append(
        (
            "counts",
            turn / (counts * gear),
            1.0,
            f"{counts * gear:g} counts a turn, by the robot file",
            0.0,
        )
    )
    candidates.append((PATH, 1e-3 / robot.wheels.radius, 1.0, "path by the wheel's radius", 0.0))
    if wrap is not None:
        rare = 3.0 if wrap <= LARGEST_ABSOLUTE else -3.0
        candidates = [(*one[:4], one[4] - rare) for one in candidates]
        candidates += [
            ("counts", turn / (wrap * each), 1.0, f"{wrap:g} {OF_THE_ENCODER}", rare)
            for each in dict.fromkeys((1.0, gear))
        ]
    if gear != 1.0:
        motor = [
            (unit, factor / gear, 1.0 / gear, f"{unit} of the motor", -3.0) for unit, factor in wheel_factors
        ]
        candidates += [
            *motor,
            ("counts", turn / counts, 1.0, f"{counts:g} counts a turn of the wheel, by the robot file", -3.0),
        ]
    found = {}
    for unit, factor, scale, reason, rare in candidates:
        weight = rare + _unit_weight(unit, named, whole)
        agrees = step is not None and abs(step * factor / (turn / (counts * gear)) - 1.0) < STEP_AGREEMENT
        if agrees and unit != "counts":
            weight += 5.0
            reason += f"; steps of {step:.5g} are one encoder count"
        found[Scale(unit=unit, factor=factor, scale=scale, reason=_with_name(named, reason))] = weight
    return found


def fastest(robot: Robot) -> float:
    """Return the speed [rad/s] of a wheel at which the back-EMF is the supply's voltage."""
    drive = robot.drive
    return wheel_speed_limit(
        supply_voltage=drive.supply_voltage, speed_constant=drive.speed_constant, gear_ratio=drive.gear_ratio
    )


#: a wheel's encoder counts from one row to the next, in place of its speed
PER_ROW = "counts a row"


def speed_units(
    speeds: NDArray[np.float64], robot: Robot, named: str | None, *, interval: float
) -> dict[Scale, float]:
    """Return the units of wheel speeds with the logarithms of their weights, by name, whole numbers and step.

    Parameters
    ----------
    speeds : ndarray (N, n)
        As the file has them.
    robot : Robot
        Gives the gear and the encoder's counts.
    named : str, optional
        The unit in their names; "rps" leaves open whether revolutions or radians are meant.
    interval : float
        Between the rows [s].
    """
    gear, turn = robot.drive.gear_ratio, 2.0 * math.pi
    count = turn / (robot.sensors.encoder_counts * gear)
    known = speeds[np.isfinite(speeds)]
    whole = bool(np.all(known == np.round(known)))
    limit = _BEYOND_LIMIT * fastest(robot)
    step = next((one for column in speeds.T if (one := step_of(column)) is not None), None)
    found = {}
    units = [(unit, FACTORS["rad/s"].get(unit, turn), 1.0) for unit in _SPEED_WEIGHTS]
    units += [(unit, factor / gear, 1.0 / gear) for unit, factor, _ in units if gear != 1.0]
    for unit, factor, scale in units:
        weight = _SPEED_WEIGHTS[unit] - (OF_MOTORS if scale != 1.0 else 0.0)
        if named == "rps":
            weight += math.log(_NAMED if unit in ("rad/s", "turn/s") else 1.0 - _NAMED)
        elif named is not None:
            weight += math.log(_NAMED if unit == named else 1.0 - _NAMED)
        largest = float(np.quantile(np.abs(known), LARGEST_PART)) * factor if len(known) else 0.0
        weight -= 9.0 if largest > limit else 3.0 if largest < SLOWEST else 0.0
        reason = unit
        counted = step is not None and abs(step * factor * interval / count - 1.0) < STEP_AGREEMENT
        if counted:
            weight += 5.0
            reason += f"; steps of {step:.5g} are one encoder count a row"
        found[
            Scale(unit=unit, factor=factor, scale=scale, reason=_with_name(named, reason), counted=counted)
        ] = weight
    if whole:
        by_file = f"{turn / count:g} counts a turn, by the robot file"
        weight = WHOLE_SPEEDS + (0.0 if named is None else math.log(1.0 - _NAMED))
        per_row = Scale(
            unit=PER_ROW, factor=count / interval, reason=_with_name(named, by_file), counted=True
        )
        found[per_row] = weight
        weight += math.log(_NAMED / (1.0 - _NAMED)) if named == "counts/s" else 0.0
        found[Scale(unit="counts/s", factor=count, reason=_with_name(named, by_file))] = weight
    return found


#: logarithms of how usual units of a wheel's speed are, of those behind the gear over the motor's, and of counts if all
#: numbers are whole; chosen
_SPEED_WEIGHTS = {"rad/s": 0.0, "rpm": 0.0, "deg/s": -1.0, "turn/s": -2.0, "mrad/s": -4.0, "mdeg/s": -5.0}
OF_MOTORS, WHOLE_SPEEDS = 2.0, 0.0
#: it is no unit in which a fiftieth of the speeds are beyond this many times the drive's limit, and hardly one in which
#: all others are below this [rad/s]; chosen
LARGEST_PART, _BEYOND_LIMIT, SLOWEST = 0.98, 1.5, 0.1


def _unit_weight(unit: str, named: str | None, whole: bool) -> float:
    if unit == "counts" and not whole:
        return -20.0
    # a path is so rare, and fits so near to degrees, that the motion must exclude it for degrees to be certain
    weight = {"rad": 0.0, "deg": -1.0, "turn": -3.0, "counts": -1.0, PATH: -3.0}[unit]
    if whole:
        weight += 8.0 if unit == "counts" else 0.0
    if named is not None:
        weight += math.log(_NAMED if unit == named else 1.0 - _NAMED)
    return weight


def _with_name(named: str | None, reason: str) -> str:
    if named is None:
        return reason
    # the name says it already
    rest = reason.removeprefix(named).lstrip("; ") if reason.split(";")[0] == named else reason
    return f"the name has the unit {named}; {rest}" if rest else f"the name has the unit {named}"


#: a heading in another unit than the lean, where no name says so, and where only the heading's does; chosen
OTHER_THAN_LEAN, OTHER_BY_NAME = 0.02, 0.3
#: largest heading [rad] without a wrap that is usual; and how near a jump must be to a turn to be one
LARGEST_HEADING, NEAR_TURN = 4.0 * math.pi, 0.02


def heading_units(
    heading: NDArray[np.float64], named: str | None, lean: Scale, lean_named: str | None
) -> dict[Scale, float]:
    """Return the units of a yaw (N,) beside a lean in a unit, with the logarithms of their weights.

    Parameters
    ----------
    heading : ndarray (N,)
    named, lean_named : str, optional
        The units in the names of yaw and roll.
    lean : Scale
        That of roll and pitch.
    """
    known = heading[np.isfinite(heading)]
    largest = float(np.abs(known - np.median(known)).max(initial=0.0)) if len(known) else 0.0
    jump = float(np.abs(np.diff(known)).max(initial=0.0))
    other = 1.0 if named and lean_named else OTHER_BY_NAME if named else OTHER_THAN_LEAN
    found = {}
    own = (named,) if named in FACTORS["rad"] else ()
    for unit in dict.fromkeys((lean.unit, "rad", "deg", *own)):
        turn = 2.0 * math.pi / FACTORS["rad"][unit]
        weight = 0.0 if named is None else math.log(_NAMED if unit == named else 1.0 - _NAMED)
        weight += 0.0 if unit == lean.unit else math.log(other)
        weight -= 4.0 if unit == "rad" and largest > LARGEST_HEADING else 0.0
        weight += 5.0 if abs(jump / turn - 1.0) < NEAR_TURN else 0.0
        reason = _with_name(named, f"the heading is within {largest:.2g} of its middle")
        found[Scale(unit=unit, factor=FACTORS["rad"][unit], reason=reason)] = weight
    return found


@dataclass(frozen=True, kw_only=True)
class UnitEvidence:
    """What the motion shows with assumed units of lean, wheels and heading."""

    assumed: tuple[Scale, Scale, Scale]  #: of lean, wheels and heading
    gain: (
        float | None
    )  #: response of the lean to the wheels over the robot's; None if the log does not show it
    gain_error: float  #: standard error of its logarithm
    #: turning of the wheels over the heading's, over that of a ball that does not pivot; None if they do not agree
    turning: float | None

    def log_weight(self, lean: Scale, wheel: Scale, heading: Scale) -> float:
        """Return the logarithm of how well units fit the motion."""
        turned = wheel.factor / self.assumed[1].factor
        change = turned / (lean.factor / self.assumed[0].factor)
        weight = 0.0
        if self.gain is not None:
            deviation = math.hypot(GAIN_DEVIATION, self.gain_error) if math.isfinite(self.gain_error) else 1.0
            # noise of the wheels makes the gain too small, and rolling on play, too
            off = math.log(max(self.gain, 1e-12) / change)
            weight += normal_log_weight(off + 0.1, deviation if off > 0.0 else 1.3 * deviation, outlier=1e-3)
        if self.turning is not None:
            off = math.log(self.turning * turned / (heading.factor / self.assumed[2].factor))
            pivoting = PIVOTS * _density(off, PIVOTING_DEVIATION)
            weight += math.log((1.0 - PIVOTS) * _density(off, TURNING_DEVIATION) + pivoting)
        return weight

    def counts_by_heading(
        self, units: tuple[Scale, Scale, Scale], declared: float
    ) -> tuple[Scale, float] | None:
        """Return the counts per turn by which the wheels turn as the heading does, with its log weight over `counts`.

        Parameters
        ----------
        units : tuple of Scale
            Of lean, wheels, which are counts, and heading.
        declared : float
            Counts a turn of the wheel by the robot file.

        Returns
        -------
        tuple of Scale and float, or None
            None if the log does not show it.
        """
        if self.turning is None:
            return None
        lean, counts, heading = units
        change = counts.factor / self.assumed[1].factor / (heading.factor / self.assumed[2].factor)
        off = self.turning * change
        measured = 2.0 * math.pi / counts.factor * off
        per_turn = float(f"{measured:.3g}")
        reason = f"by the heading, about {per_turn:g} counts a turn of the wheel, not the robot file's"
        near = min(_OTHER_EDGES, key=lambda one: abs(math.log(measured / (one * declared))))
        if abs(math.log(measured / (near * declared))) < TURNING_DEVIATION:
            per_turn = near * declared
            times = f"{near:g} times" if near > 1.0 else f"1/{1.0 / near:g} of"
            reason = (
                f"by the heading, about {measured:.3g} counts a turn of the wheel: {times} the robot file's "
                f"{declared:g}, {OTHER_EDGES_WORDS}"
            )
        other = replace(counts, factor=2.0 * math.pi / per_turn, reason=reason)
        # in place of the heading's own term, how usual such a mistake is
        weight = math.log(OTHER_COUNTS * _density(math.log(off), OTHER_COUNTS_DEVIATION))
        return other, weight + replace(self, turning=None).log_weight(lean, other, heading)


def _density(value: float, deviation: float) -> float:
    """Return the density of a normal distribution around zero; never quite zero."""
    return max(math.exp(-0.5 * (value / deviation) ** 2) / deviation, 1e-300)


def likeliest_units(
    leans: dict[Scale, float],
    wheels: dict[Scale, float],
    headings: Callable[[Scale], dict[Scale, float]],
    motion: UnitEvidence,
) -> tuple[Scale, Scale, Scale]:
    """Return the likeliest units of lean, wheels and heading together, with their confidence.

    Parameters
    ----------
    leans, wheels : dict of Scale to float
        Logarithms of weights.
    headings : function
        Those of the heading with a unit of the lean.
    motion : UnitEvidence
    """
    weights, by_heading = {}, set()
    turns = [
        2.0 * math.pi / one.factor
        for one in wheels
        if one.unit == "counts" and OF_THE_ENCODER not in one.reason
    ]
    declared = max(turns, default=0.0)  # of the wheel, behind the gear
    triples = (
        ((lean, wheel, heading), lean_weight + wheel_weight + heading_weight)
        for lean, lean_weight in leans.items()
        for heading, heading_weight in headings(lean).items()
        for wheel, wheel_weight in wheels.items()
    )
    for units, weight in triples:
        lean, wheel, heading = units
        weights[units] = weight + motion.log_weight(lean, wheel, heading)
        other = motion.counts_by_heading(units, declared) if wheel.unit == "counts" else None
        if other is not None:
            # the encoder's counts and those of a turn of the wheel lead to the same number
            same = lean, other[0], heading
            weights[same] = max(weight + other[1], weights.get(same, -math.inf))
            by_heading.add(other[0])
    found = probabilities(weights)
    best = next(iter(found))
    lean, wheel, heading = (_with_confidence(best[place], _totals(found, place)) for place in range(3))
    if best[1] in by_heading:
        other_robot = () if OTHER_EDGES_WORDS in wheel.reason else (OTHER_ROBOT,)
        wheel = replace(
            wheel,
            confidence=min(wheel.confidence, MOST_BY_HEADING),
            alternatives=(*other_robot, *wheel.alternatives),
        )
    elif (
        wheel.unit == "counts"
        and OF_THE_ENCODER not in wheel.reason
        and motion.turning is None
        and 2.0 * math.pi / wheel.factor < 0.99 * declared
    ):
        # counts without the gear are rarer than a robot file of another robot
        wheel = replace(
            wheel,
            confidence=min(wheel.confidence, MOST_BY_HEADING),
            alternatives=(OTHER_ROBOT, *wheel.alternatives),
        )
    return lean, wheel, heading


def _totals(found: dict[tuple[Scale, Scale, Scale], float], place: int) -> dict[Scale, float]:
    totals: dict[Scale, float] = {}
    for pair, p in found.items():
        totals[pair[place]] = totals.get(pair[place], 0.0) + p
    return totals


def _with_confidence(best: Scale, shares: dict[Scale, float]) -> Scale:
    # units with one factor are one answer
    confidence = sum(p for one, p in shares.items() if abs(one.factor / best.factor - 1.0) < 1e-6)
    others = sorted((one for one in shares if one.factor != best.factor), key=lambda one: -shares[one])
    return Scale(
        unit=best.unit,
        factor=best.factor,
        scale=best.scale,
        reason=best.reason,
        confidence=min(confidence, MOST),
        alternatives=tuple(one.description for one in others if shares[one] > 0.02),
    )
