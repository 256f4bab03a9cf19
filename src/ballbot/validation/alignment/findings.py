"""What an alignment shows in sentences: the heading first, then what else is significant; the numbers are tables."""

from __future__ import annotations

import numpy as np

from ballbot.findings import Finding, note
from ballbot.identification.turning import ANGLE_NAMES
from ballbot.rounding import digits, percent, plus_minus
from ballbot.validation.alignment.align import LEAST_LEVER, Alignment, PathFit, SensorErrors

#: share of the error from which position follows the heading
_FOLLOWS = 0.5
#: delays of angles below this are not reported [s]
_LEAST_DELAY = 2e-3
#: as exactly as markers are mounted [m]
_LEAST_ARM = 0.01
#: a larger share of the time out of view is reported
_UNSEEN = 0.01


def alignment_findings(alignment: Alignment) -> tuple[Finding, ...]:
    """Return the findings, the one on the heading first where there is one."""
    found: list[str] = []
    if alignment.sensors is None:
        found.append(
            "The log has no theta, phi and psi in common with the cameras: clocks and markers are aligned alone."
        )
    else:
        found += [_heading(alignment.sensors), _leans(alignment.sensors)]
        found += _delays(alignment.sensors, alignment.clock_signal)
    if alignment.path is not None:
        found += _scale(alignment.path) + _lever(alignment.path)
    if alignment.unseen >= _UNSEEN:
        found.append(
            f"For {percent(alignment.unseen)} of the log's time the cameras saw nothing, or confused two markers."
        )
    if alignment.rival_clock is not None:
        found.append(
            "Another alignment fits nearly as well, with the cameras' clock at "
            f"{alignment.rival_clock.offset:.2f} s at the log's zero, because the motion "
            "repeats itself. A log that begins or ends with a sideways push would decide."
        )
    return tuple(note("alignment", sentence) for sentence in found)


def _heading(sensors: SensorErrors) -> str:
    psi, position = sensors.of["psi"], sensors.position
    drifts = abs(psi.drift) > psi.drift_half_width
    drift, half = 60 * np.degrees(psi.drift), 60 * np.degrees(psi.drift_half_width)
    if drifts:
        total = digits(abs(np.degrees(psi.drift)) * sensors.duration, 2)
        words = (
            f"Heading drifts {plus_minus(abs(drift), half)} degrees a minute, {total} degrees in "
            f"{sensors.duration:.0f} s"
        )
    else:
        words = f"Heading does not drift, {plus_minus(drift, half)} degrees a minute"
    if position is None:
        return f"{words}."
    reaches = f"reaches {digits(1000.0 * position.largest, 2)} mm on a path of {digits(position.path, 2)} m"
    if not drifts:
        return f"{words}; the position error {reaches}."
    follows = "follows it" if position.by_heading > _FOLLOWS else "does not follow it"
    share = "none" if position.by_heading < 0.005 else percent(position.by_heading)
    return (
        f"{words}. The position error {follows} and {reaches}; rotating "
        f"that path by the heading error explains {share} of it."
    )


def _leans(sensors: SensorErrors) -> str:
    sizes = (digits(np.degrees(sensors.of[name].rms), 2) for name in ("theta", "phi"))
    drifting = []
    for name in ("theta", "phi"):
        drift, half = np.degrees([60.0 * sensors.of[name].drift, 60.0 * sensors.of[name].drift_half_width])
        if abs(drift) > half:
            drifting.append(f"{name} drifts {plus_minus(drift, half)} degrees a minute")
    return (
        f"The lean angles are accurate to {' and '.join(sizes)} degrees RMS; "
        f"{' and '.join(drifting) or 'neither drifts'}. A constant error of them cannot be separated from a tilt of "
        "the cameras' frame and is not counted."
    )


def _delays(sensors: SensorErrors, signal: str) -> list[str]:
    words = []
    for name in ANGLE_NAMES:
        delay, half = sensors.of[name].delay, sensors.of[name].delay_half_width
        if delay is not None and half is not None and abs(delay) > max(_LEAST_DELAY, half):
            way = "behind" if delay > 0 else "ahead of"
            words.append(
                f"{name} is logged {plus_minus(1e3 * abs(delay), 1e3 * half)} ms {way} the {signal}, to which the "
                "clock is aligned."
            )
    return words


def _scale(path: PathFit) -> list[str]:
    if abs(path.scale - 1.0) <= 3.0 * path.scale_half_width:
        return []
    off = plus_minus(100 * abs(path.scale - 1.0), 100 * path.scale_half_width)
    return [
        f"The log's distances are {off} % too {'long' if path.scale > 1.0 else 'short'}: the radius of the ball or "
        "of the wheels differs from the one that the robot uses, or the wheels slip."
    ]


def _lever(path: PathFit) -> list[str]:
    if path.used.any():
        return ["The cameras track a point beside the ball's centre; the lever arm was subtracted."]
    if np.linalg.norm(path.arm) <= max(_LEAST_ARM, float(np.linalg.norm(path.arm_half_width))):
        return []
    return [
        "The point that the cameras track is assumed to be the ball's centre. A lever arm fits, but one of less than "
        f"{1000.0 * LEAST_LEVER:.0f} mm beyond chance may also be the log's own error as the robot rocks."
    ]
