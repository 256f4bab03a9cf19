"""Findings of an alignment: the sensors first, then clocks and frames, then the values that are not determined."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ballbot.findings import Finding, note
from ballbot.validation.alignment.align import ANGLES, Alignment, SensorError, SensorErrors
from ballbot.validation.alignment.frame import LEAST_LEVER
from ballbot.validation.alignment.motion import nearest_cube_rotation

#: share of the error from which position follows the heading
_FOLLOWS = 0.5
#: a log's offset below this is a delay and not another clock [s]
_DELAY = 0.1
#: delays of angles below this are not reported [s]
_LEAST_DELAY = 2e-3
#: a larger share of the time out of view is reported
_UNSEEN = 0.01


def alignment_findings(alignment: Alignment) -> tuple[Finding, ...]:
    """Return the findings, the one on the heading first where there is one."""
    found: list[str] = []
    if alignment.sensors is not None:
        found += [_heading(alignment.sensors), _leans(alignment.sensors), *_delays(alignment)]
        found += _scale(alignment.sensors)
    found += [_clock(alignment), _markers(alignment)]
    found += (
        _flips(alignment)
        + _lever(alignment)
        + _gaps(alignment)
        + _frame(alignment)
        + _undetermined(alignment)
    )
    return tuple(note("alignment", sentence) for sentence in found)


def _heading(sensors: SensorErrors) -> str:
    psi, position = sensors.of["psi"], sensors.position
    drifts = abs(psi.drift) > psi.drift_half_width
    drift, half_width = 60 * np.degrees(psi.drift), 60 * np.degrees(psi.drift_half_width)
    half = _two(half_width)
    if drifts:
        total = abs(np.degrees(psi.drift)) * sensors.duration
        words = (
            f"Heading drifts {_rounded(abs(drift), half_width)} degrees a minute (± {half}; {total:.1f} degrees in "
            f"{_duration(sensors.duration)})"
        )
    else:
        words = f"Heading does not drift: {_signed(drift)} ± {half} degrees a minute"
    if position is None:
        return f"{words}."
    reaches = f"reaches {_two(1000.0 * position.largest)} mm on a path of {_two(position.path)} m"
    if not drifts:
        return f"{words}; the position error {reaches}."
    follows = "follows it" if position.by_heading > _FOLLOWS else "does not follow it"
    share = "none" if position.by_heading < 0.005 else f"{100 * position.by_heading:.0f} %"
    return (
        f"{words}. The position error {follows} and {reaches}; rotating "
        f"that path by the heading error explains {share} of it."
    )


def _leans(sensors: SensorErrors) -> str:
    theta, phi = sensors.of["theta"], sensors.of["phi"]
    largest = max(theta, phi, key=lambda one: one.largest)
    drifting = [one for one in (theta, phi) if abs(one.drift) > one.drift_half_width]
    drifts = " and ".join(f"{one.name} drifts {_drift(one)}" for one in drifting) or "neither drifts"
    return (
        f"The lean angles are accurate to {_two(np.degrees(theta.rms))} (theta) and "
        f"{_two(np.degrees(phi.rms))} (phi) degrees RMS, {_two(np.degrees(largest.largest))} "
        f"at worst ({largest.name}); {drifts}. A constant error of them cannot be separated "
        "from a tilt of the cameras' frame and is not counted."
    )


def _drift(one: SensorError) -> str:
    return f"{_signed(60 * np.degrees(one.drift))} ± {_two(60 * np.degrees(one.drift_half_width))} degrees a minute"


def _delays(alignment: Alignment) -> list[str]:
    assert alignment.sensors is not None
    words = []
    for name in ANGLES:
        one = alignment.sensors.of[name]
        if one.delay is None or one.delay_half_width is None:
            continue
        if abs(one.delay) > max(_LEAST_DELAY, one.delay_half_width):
            way = "behind" if one.delay > 0 else "ahead of"
            words.append(
                f"{name} is logged {1000.0 * abs(one.delay):.1f} ± {_two(1000.0 * one.delay_half_width)} "
                f"ms {way} the {alignment.clock_signal}, to which the clock is aligned."
            )
    return words


def _scale(sensors: SensorErrors) -> list[str]:
    scale = sensors.position.scale if sensors.position is not None else None
    if scale is None or abs(scale.scale - 1.0) <= 3.0 * scale.scale_half_width:
        return []
    way = "long" if scale.scale > 1.0 else "short"
    return [
        f"The log's distances are {100 * abs(scale.scale - 1.0):.2f} ± "
        f"{100 * scale.scale_half_width:.2f} % too {way}: the radius of the ball or "
        "of the wheels differs from the one that the robot uses, or the wheels slip."
    ]


def _clock(alignment: Alignment) -> str:
    motion, signal = alignment.motion, alignment.clock_signal
    offset, half = motion.clock.offset, motion.offset_half_width
    rate = f"{_signed(1e6 * motion.clock.rate)} ± {_two(1e6 * motion.rate_half_width)} ppm"
    if abs(offset) < _DELAY:
        milliseconds = f"{_rounded(1e3 * abs(offset), 1e3 * half)} ± {_two(1e3 * half)} ms"
        way = "later" if offset < 0 else "earlier"
        return (
            f"The log's {signal} comes {milliseconds} {way} than the cameras'; their clock runs {rate} fast."
        )
    return (
        f"The cameras' clock was at {_rounded(offset, half)} ± {_two(half)} s at the log's zero, and runs "
        f"{rate} fast. A delay of the {signal} is included in the first and cannot be separated from it."
    )


def _markers(alignment: Alignment) -> str:
    motion = alignment.motion
    whole, rest = nearest_cube_rotation(motion.body_marker)
    half = motion.rotation_half_width
    error = float(np.degrees(half.max())) if np.isfinite(half).all() else math.nan
    known = f"± {_two(error)} degrees" if math.isfinite(error) else "not fully determined"
    further = _rounded(float(np.degrees(rest)), error) if math.isfinite(error) else f"{np.degrees(rest):.2f}"
    if whole.magnitude() < 0.1:
        return f"The markers' frame is rotated by {further} degrees ({known}) against the log's body frame."
    vector = whole.as_rotvec()
    return (
        f"The markers' frame is the log's body frame rotated by {np.degrees(whole.magnitude()):.0f} "
        f"degrees about {_axis(vector / np.linalg.norm(vector))}, and by a further "
        f"{further} degrees ({known})."
    )


def _flips(alignment: Alignment) -> list[str]:
    flips = alignment.flips
    if not flips:
        return []
    first = ", ".join(
        f"{np.degrees(one.angle):.0f} degrees about {_axis(np.array(one.axis))} at {one.t:.2f} s"
        for one in flips[:3]
    )
    more = f" and {len(flips) - 3} more" if len(flips) > 3 else ""
    times = {1: "once", 2: "twice"}.get(len(flips), f"{len(flips)} times")
    return [f"The cameras confused two markers {times} ({first}{more}, on their clock); this was corrected."]


def _lever(alignment: Alignment) -> list[str]:
    lever = alignment.lever
    if lever is None:
        return []
    pairs = list(zip((1e3 * lever.arm).tolist(), (1e3 * lever.half_width).tolist(), strict=True))
    arm = ", ".join(_rounded(value, error) for value, error in pairs)
    half = ", ".join(_two(error) for _, error in pairs)
    if lever.used.any():
        return [
            f"The cameras track a point at ({arm}) ± ({half}) mm from the "
            "ball's centre in the markers' frame; this was corrected."
        ]
    if np.linalg.norm(lever.arm) <= np.linalg.norm(lever.half_width):
        return [
            f"The cameras track the ball's centre: the lever arm, ({arm}) ± ({half}) mm, is not significant."
        ]
    return [
        "The point that the cameras track is assumed to be the ball's centre. A lever "
        f"arm of ({arm}) ± ({half}) mm fits, but one of less than {1000.0 * LEAST_LEVER:.0f} "
        "mm beyond chance may also be the log's own error as the robot rocks."
    ]


def _gaps(alignment: Alignment) -> list[str]:
    if alignment.unseen < _UNSEEN:
        return []
    return [f"For {100 * alignment.unseen:.0f} % of the log's time the cameras saw nothing."]


def _frame(alignment: Alignment) -> list[str]:
    if alignment.frame is None:
        return [
            "The log has no theta, phi and psi, so the cameras' frame cannot be aligned with its world frame."
        ]
    up = alignment.frame.camera_world.apply([0.0, 0.0, 1.0])
    tilt = np.degrees(np.arccos(np.clip(up[2], -1.0, 1.0)))
    if tilt > 45.0:
        return [
            f"The vertical of the log's world is {_axis(up)} in "
            "the cameras' frame, whose z axis does not point up."
        ]
    half = float(np.degrees(alignment.frame.tilt_half_width))
    return [
        f"The cameras' frame is tilted by {_rounded(float(tilt), half)} ± {_two(half)} "
        "degrees against the log's world; heading and origin are those of the first two seconds."
    ]


def _undetermined(alignment: Alignment) -> list[str]:
    words = []
    axis = alignment.motion.unobservable_axis
    if axis is not None:
        words.append(
            f"The rotation of the markers' frame about {_axis(axis)} of the body "
            "is not determined: the robot hardly turned about another axis."
        )
    if alignment.rival_clock is not None:
        words.append(
            "Another alignment fits nearly as well, with the cameras' clock at "
            f"{alignment.rival_clock.offset:.2f} s at the log's zero, because the motion "
            "repeats itself. A log that begins or ends with a sideways push would decide."
        )
    return words


def _axis(axis: NDArray[np.float64]) -> str:
    """Return an axis as x, -y or (0.71, 0.00, 0.71)."""
    for index, name in enumerate("xyz"):
        if abs(axis[index]) > 0.999:
            return name if axis[index] > 0 else f"-{name}"
    return "(" + ", ".join(f"{value:.2f}" for value in np.round(axis, 2) + 0.0) + ")"


def _two(value: float) -> str:
    """Return a positive number to two significant digits."""
    return _rounded(value, value)


def _rounded(value: float, error: float) -> str:
    """Return a number to the second significant digit of its error."""
    if not np.isfinite(value) or not error > 0.0 or not np.isfinite(error):
        return f"{value:g}"
    places = max(0, 1 - int(np.floor(np.log10(error))))
    return f"{round(value, places) + 0.0:.{places}f}"  # adding zero keeps a minus sign off what prints as nothing


def _signed(value: float) -> str:
    return ("+" if value >= 0 else "-") + _two(abs(float(value)))


def _duration(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 100 else f"{seconds / 60:.1f} min"
