"""What a survey of the geometry means, in sentences: where a tape measure was wrong, and what a log could not tell."""

from __future__ import annotations

import math

from ballbot.identification.geometry.survey import Geometry, Measured, common_turn

#: a deviation of fewer standard errors than this is noise
CLEAR = 3.0
_AGREES = (
    "The file agrees with the logs: no value differs by more than "
    "three standard errors and by more than slip and rollers can cause."
)


def geometry_remarks(geometry: Geometry) -> list[str]:
    """Return sentences, the gravest first."""
    turns = {kind: _frame_turn(geometry, kind) for kind in ("upside down", "balancing")}
    remarks = [_turned(kind, turn) for kind, turn in turns.items() if turn]
    both_radii = any(one.kind == "both" for one in geometry.measured)
    told: set[str] = set()
    for one in geometry.measured:
        # with both radii known, their ratio would only say the same again
        said_by_radii = both_radii and "/" in one.name
        turn = turns.get(one.kind, 0.0) if "azimuths" in one.name else 0.0
        if one.name not in told and not said_by_radii and _stands_out(one, turn):
            remarks.append(_sentence(one))
            told.add(one.name)
    for number, one in enumerate(geometry.wheel_ratios, start=1):
        if _stands_out(one, 0.0):
            more = 100.0 * (one.value / one.in_file - 1.0)
            remarks.append(
                f"Wheel {number} turns {more:+.1f} % faster than the mean of the wheels "
                "for the same motion of the ball: its radius differs, or it slips."
            )
    return [*(remarks or [_AGREES]), *_missing(geometry)]


def _stands_out(one: Measured, turn: float) -> bool:
    off = abs(one.in_file - one.value + turn)
    return off > CLEAR * one.standard_error and off > one.slip


def _sentence(one: Measured) -> str:
    value, in_file = _said(one.value, one), _said(one.in_file, one)
    off = f"{abs(one.deviation):.0f} standard errors"
    if one.name.startswith("IMU"):
        axis = one.name.removeprefix("IMU rotation ")
        return (
            f"By the cameras the IMU is turned by {value} {axis} against "
            f"the body ({off}); mount it straight, or correct its readings."
        )
    if one.name.startswith("camera"):
        axis = one.name.removeprefix("camera tilt ")
        return (
            "The frame of the camera that watched the ball is "
            f"tilted by {value} {axis} ({off}); this was corrected."
        )
    if one.unit == "rad":
        return (
            f"{one.name} is {value} by the logs and {in_file} in "
            f"the file, a difference of {off}; measure it again."
        )
    share = 100.0 * (one.in_file / one.value - 1.0)
    text = (
        f"{one.name} is {value} by the logs and {in_file} in "
        f"the file, a difference of {share:+.1f} % or {off}"
    )
    if "/" not in one.name:
        return f"{text}; measure it again, or use the value from the logs."
    if one.unit == "1":
        return f"{text}; a balancing run with motion capture would show which of the two radii is wrong."
    return f"{text}; a log of the robot upside down would show whether the radius or the tilt is wrong."


def _said(value: float, one: Measured) -> str:
    if one.unit == "rad":
        return f"{math.degrees(value):.2f} deg"
    decimals = max(0, 1 - math.floor(math.log10(one.standard_error)))
    return f"{value:.{decimals}f}{'' if one.unit == '1' else f' {one.unit}'}"


def _frame_turn(geometry: Geometry, kind: str) -> float:
    """Return by how much [rad] the azimuths are turned together where that stands out, else zero."""
    azimuths = geometry.azimuths(kind)
    if not azimuths:
        return 0.0
    turn = common_turn(azimuths)
    least = max(CLEAR * max(one.standard_error for one in azimuths), azimuths[0].slip)
    return turn if abs(turn) > least else 0.0


def _turned(kind: str, turn: float) -> str:
    return (
        f"All azimuths are turned by {math.degrees(turn):+.2f} deg in the logs ({kind}): the "
        "cameras' forward direction differs from the robot file's, or all wheels are mounted turned."
    )


def _missing(geometry: Geometry) -> list[str]:
    kinds = {one.kind for one in geometry.measured}
    if "balancing" not in kinds:
        return [
            "Each radius by itself and the mounting of the IMU "
            "need a balancing run with motion capture as well."
        ]
    if "upside down" not in kinds:
        return [
            "The tilt and both radii by themselves need a log of the robot upside down as well: while it "
            "balances, the body leans too little compared with play and rollers, and the ball may pivot."
        ]
    return []
