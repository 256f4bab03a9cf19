"""Whether several logs are of one robot, by what each log alone says of its mass, radii and gears.

A log's own scales (torque over what the motion needs, ball acceleration over the lean's, wheel speed over the ball's)
are those of its robot over the robot file's. They need not be one, but they must be the same in every log of a robot.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ballbot.findings import Finding, Place
from ballbot.log.physics.examine import Examined

#: two scales are of different robots if they differ by more than this factor beside their uncertainty
APART = 1.18
#: an uncertainty beside that of the brackets and errors, relative
MARGIN = 0.03
#: standard errors
SURE = 3.0
#: relative uncertainty of wheel gains [-]: play, slip and noise
WHEEL_ERROR = 0.04
#: widest bracket (of the two regressions) that is compared, and the part of its logarithm that is left uncertain on
#: each side of its middle: a whole half if nothing is known of the noises' sizes
WIDEST, TORQUE_SHARE, LEAN_SHARE = 1.6, 0.25, 0.3
#: share of the torques that must be explained: with less, friction that follows the need is large
EXPLAINED = 0.85


@dataclass(frozen=True, kw_only=True)
class Scale:
    """A scale that one log shows, over the robot file's."""

    middle: float
    systematic: float  #: relative, to each side
    error: float  #: standard error, relative

    @property
    def words(self) -> str:
        """The scale with its uncertainty."""
        return f"{self.middle:.2f} +- {self.middle * (self.systematic + SURE * self.error):.2f}"


def different_robots(examined: Mapping[str, Examined]) -> list[Finding]:
    """Return an error for each scale in which logs differ more than one robot's can.

    Parameters
    ----------
    examined : mapping of str to Examined
        What each log said by itself, by the names that messages use.
    """
    findings = []
    for scale_of, what, cause in _SCALES:
        known = {name: scale for name, one in examined.items() if (scale := scale_of(one))}
        finding = _compared(known, what, cause)
        if finding:
            findings.append(finding)
    return findings


def _compared(scales: Mapping[str, Scale], what: str, cause: str) -> Finding | None:
    """Return the finding on the two logs that are clearest apart; None if none are."""
    apart = {
        pair: margin
        for pair in combinations(scales, 2)
        if (margin := _margin(*(scales[n] for n in pair))) > 0.0
    }
    if not apart:
        return None
    first, second = max(apart, key=lambda pair: apart[pair])
    odd = _odd_one(scales, first, second)
    other = second if odd == first else first
    ratio = scales[odd].middle / scales[other].middle
    sentence = (
        f"{odd} and {other} are of different robots: {what} is {ratio:.2f} times as large "
        f"in {odd} (relative to the robot file it is {scales[odd].words} in {odd} and "
        f"{scales[other].words} in {other}). {cause} Use logs of one robot in one condition."
    )
    return Finding(code="robots", severity="error", text=sentence, where=Place(file=odd))


def _margin(one: Scale, other: Scale) -> float:
    """Return by how much the logarithms of two scales differ beyond what they may."""
    difference = abs(np.log(one.middle / other.middle))
    uncertain = one.systematic + other.systematic + SURE * np.hypot(one.error, other.error) + MARGIN
    return float(difference - max(uncertain, np.log(APART)))


def _odd_one(scales: Mapping[str, Scale], first: str, second: str) -> str:
    """Return the one of two logs that more others contradict; with a tie, the one that is farther from the file."""

    def contradicted(name: str) -> tuple[int, float]:
        number = sum(_margin(scales[name], other) > 0.0 for other in scales.values())
        return number, abs(np.log(scales[name].middle))

    return max(first, second, key=contradicted)


def _bracket(forward: float, reverse: float, error: float, *, share: float) -> Scale | None:
    if not (forward > 0.0 and np.isfinite(reverse) and reverse < WIDEST * forward):
        return None
    return Scale(
        middle=float(np.sqrt(forward * reverse)),
        systematic=share * abs(float(np.log(reverse / forward))),
        error=error / forward,
    )


def _torque_scale(one: Examined) -> Scale | None:
    if one.torque is None or one.torque.explained < EXPLAINED:
        return None
    return _bracket(*one.torque.scale, one.torque.scale_error, share=TORQUE_SHARE)


def _lean_scale(one: Examined) -> Scale | None:
    if one.lean is None or not one.lean.conclusive or one.lean.misread:
        return None
    return _bracket(
        abs(one.lean.gravity_gain), one.lean.reverse_gain, one.lean.gravity_error, share=LEAN_SHARE
    )


def _wheel_scale(one: Examined) -> Scale | None:
    return None if one.wheel_gain is None else Scale(middle=one.wheel_gain, systematic=WHEEL_ERROR, error=0.0)


_SCALES: tuple[tuple[Callable[[Examined], Scale | None], str, str], ...] = (
    (
        _torque_scale,
        "the torque that the motion needs",
        "One is heavier, or has another gear ratio or torque constant.",
    ),
    (
        _lean_scale,
        "the ball's acceleration at a lean",
        "They differ in wheel or ball radius, gear ratio, encoder counts or height of the centre of mass.",
    ),
    (
        _wheel_scale,
        "the wheels' speed at the same motion of the ball",
        "They differ in wheel or ball radius, gear ratio or encoder counts.",
    ),
)
