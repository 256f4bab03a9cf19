"""In which unit a foreign file has its time: by name, by its intervals, and by the motion.

Rows come every 0.2 ms to 0.2 s, which only one power of 1000 allows. A clock with its unit in its name, or with
fractions of a second, is believed unless the motion contradicts it; whole numbers without a name may count anything,
and need the motion: the gyro against the derivative of the angles (gain 1 in one unit only), or gravity's part of the
lean's acceleration.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ballbot.log.columns import FACTORS
from ballbot.log.mapping_inference.evidence import Conclusion
from ballbot.log.mapping_inference.units import Scale

#: intervals between rows that a log may have [s]
INTERVALS = (2e-4, 0.2)
#: seconds of the robot over seconds of the file that contradict the unit of the time; noise makes the ratio too small
TIME_RATIOS = (0.15, 2.2)
#: a response of the lean to the wheels, over the robot's, that is off by more [log] confirms no unit: a clock that is
#: wrong by a factor of 5 makes it 0.11
TIME_GAIN = 0.7


def time_scale(t: NDArray[np.float64], named: str | None) -> Scale | None:
    """Return the unit of a column of times by its intervals and name; None if no unit makes it a log's.

    Parameters
    ----------
    t : ndarray (N,)
        As the file has it.
    named : str, optional
        The unit in its name.
    """
    steps = np.diff(t)
    usual = float(np.median(steps[steps > 0.0])) if np.any(steps > 0.0) else 0.0
    fitting = [u for u, f in FACTORS["s"].items() if INTERVALS[0] <= usual * f < INTERVALS[1]]
    if not fitting:
        return None
    unit = fitting[0]
    factor = FACTORS["s"][unit]
    rows = f"rows come every {usual:.6g}, as {1e3 * usual * factor:.4g} ms"
    if named is not None and named != unit:
        return Scale(
            unit=unit,
            factor=factor,
            reason=f"{rows}, but the name has the unit {named}",
            confidence=0.5,
            alternatives=(named,),
        )
    if named is not None:
        return Scale(
            unit=unit, factor=factor, reason=f"the name has the unit {named}; {rows}", confidence=0.98
        )
    whole = bool(np.all(t == np.round(t)))
    if whole:
        reason = f"{rows}; whole numbers without a unit in the name may count anything"
        return Scale(unit=unit, factor=factor, reason=reason, confidence=0.6, alternatives=("another unit",))
    return Scale(unit=unit, factor=factor, reason=rows, confidence=0.95)


#: a clock off by a factor c changes gravity's part of the lean's acceleration by c^2, and with it the lean's response
#: to the wheels, by c^2 where the robot is slow and not at all where it is quick: logarithm of the latter over that of
#: c, whose sign is known. Noise of the lean changes the first alone, a height of the centre of mass hardly the second
CLOCK_EXPONENTS = (0.8, 2.3)
#: changes [log] of c and of the response that are clearly none, and the largest standard error of c's
CLOCK_RATIO, CLOCK_GAIN, CLOCK_ERROR = 0.25, 0.3, 0.1


def wrong_clock(by_gravity: tuple[float, float], gain: float) -> float | None:
    """Return the seconds of the robot in one of the file if the motion shows that they are not one; else None.

    Parameters
    ----------
    by_gravity : tuple of float
        As `time_conclusion` takes it.
    gain : float
        Response of the lean to the wheels, over the robot's.
    """
    ratio, error = by_gravity
    if not (math.isfinite(ratio) and error < CLOCK_ERROR and gain > 0.0):
        return None
    if abs(math.log(ratio)) < CLOCK_RATIO or abs(math.log(gain)) < CLOCK_GAIN:
        return None
    exponent = -math.log(gain) / math.log(ratio)
    return ratio if CLOCK_EXPONENTS[0] < exponent < CLOCK_EXPONENTS[1] else None


def time_conclusion(
    time: Scale,
    *,
    by_gyro: float | None,
    gyro_named: bool,
    by_gravity: tuple[float, float],
    gain: float = 1.0,
) -> Conclusion:
    """Return what is concluded on the unit of the time from names, intervals and the motion.

    Parameters
    ----------
    time : Scale
        As `time_scale` found it.
    by_gyro : float, optional
        Gyro over the rate of the angles.
    gyro_named : bool
        Whether units in names leave the gain of the gyro no freedom.
    by_gravity : tuple of float
        Seconds of the robot in one of the file, by the lean's acceleration, and the standard error of its logarithm.
    gain : float
        Response of the lean to the wheels, over the robot's.
    """
    confidence, evidence = time.confidence, time.reason
    if by_gyro is not None and 0.7 < by_gyro < 1.4:
        confidence = max(confidence, 0.99 if gyro_named else 0.97)
        evidence += f"; gyro over rate of the angles {by_gyro:.2f}"
    elif by_gyro is not None and gyro_named:
        confidence = min(confidence, 0.3)
        evidence += f"; but gyro over rate of the angles is {by_gyro:.3g}"
    ratio, error = by_gravity
    if math.isfinite(ratio) and error < 0.4:
        if not TIME_RATIOS[0] < ratio < TIME_RATIOS[1]:
            evidence += f"; but by gravity's part of the motion a second of the file is {ratio:.2g} s"
            confidence = min(confidence, 0.3)
        else:
            # a ratio within these limits says no more: noise makes it too small
            evidence += "; gravity's part of the lean's acceleration fits"
        # a wrong unit of the time makes the lean's response to the wheels another robot's
        known_gain = abs(math.log(max(gain, 1e-12))) < TIME_GAIN
        if TIME_RATIOS[0] < ratio < TIME_RATIOS[1] and time.confidence < 0.9 and known_gain:
            confidence = max(confidence, 0.93 if 0.4 < ratio < 1.6 else 0.8)
    seconds = wrong_clock(by_gravity, gain)
    if seconds is not None:
        return Conclusion(
            name="clock",
            value=f"{time.unit} as written",
            confidence=min(confidence, 0.5),
            evidence=f"{time.reason}; but by gravity's part of the lean's acceleration, and by its response to the "
            f"wheels, which is {gain:.2g} times the robot's, a second of the file is about {seconds:.2g} s",
            alternatives=(f"a second of the file is about {seconds:.2g} s of the robot",),
            key="[columns] t",
        )
    return Conclusion(
        name="unit of the time",
        value=time.unit,
        confidence=confidence,
        evidence=evidence,
        alternatives=time.alternatives or (() if confidence >= 0.9 else ("another unit",)),
        key="[columns] t",
    )
