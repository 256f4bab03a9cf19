"""A robot's geometry from all its logs, compared with its file.

Upside down, the ball on the wheels gives r_b / r_w, tilt and azimuths; a balancing run that cameras watched gives
r_w / cos(tilt) and the azimuths again; both together give each radius:

    r_w = (r_w / cos alpha) cos alpha        r_b = (r_b / r_w) r_w

Standard errors are the delta method's, the two kinds of log being independent. They include the
noise, but not the few tenths of a percent by which real rollers slip and a ball dents; `SLIP` and `SLIP_ANGLE` are
bounds on these.

The findings name the values of the file that the logs contradict, and those that the logs do not determine.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from ballbot.errors import InputError
from ballbot.findings import Finding, note
from ballbot.fitting.least_squares import ClusteredFit
from ballbot.identification.geometry_fits import (
    UpsideDownGeometry,
    mocap_run,
    rolling_geometry,
    upside_down_geometry,
)
from ballbot.identification.turning import MotionFit
from ballbot.log import Log
from ballbot.progress import Progress, ProgressCallback, ignore_progress
from ballbot.robot import Robot
from ballbot.robot.parameters import Value

#: share of a radius, and angle [rad], that slip, dents and rollers may feign: on logs of a physics engine with two rows
#: of rollers and known geometry 0.42 % and 0.25 degrees were seen (the commands of docs/geometry.md)
SLIP = 0.006
SLIP_ANGLE = math.radians(0.4)


@dataclass(frozen=True, kw_only=True)
class Measured:
    """One quantity of the geometry, from logs and in the robot's file."""

    name: str  #: as in robot files where it stands there: "wheels.tilt", "wheels.azimuths[0]"
    value: float  #: SI units
    standard_error: float
    in_file: float  #: the file's value, or the value that follows from the file
    unit: str  #: "m", "rad" or "1"
    kind: str  #: of logs that it is from: "upside down", "balancing" or "both"

    @property
    def deviation(self) -> float:
        """How many standard errors the file's value lies off."""
        return (self.in_file - self.value) / self.standard_error

    @property
    def slip(self) -> float:
        """Largest error that slip may cause, in the quantity's unit."""
        return SLIP_ANGLE if self.unit == "rad" else SLIP * abs(self.value)


@dataclass(frozen=True, kw_only=True, eq=False)
class Geometry:
    """A robot's geometry as its logs determine it."""

    measured: tuple[Measured, ...]
    wheel_ratios: tuple[Measured, ...]  #: r_b / r_w of each wheel by itself; empty without upside-down logs
    camera_delay: Measured | None  #: of the camera that watched the ball upside down [s]
    leaning_seen: Measured | None  #: share of the body's leaning that the encoders show; play hides the rest

    def find(self, name: str, kind: str | None = None) -> Measured:
        """Return the quantity of that name, from that kind of logs where it is given.

        Raises
        ------
        InputError
            If the logs did not give it.
        """
        for one in self.measured:
            if one.name == name and kind in (None, one.kind):
                return one
        raise InputError(f"These logs do not determine {name}.")

    def azimuths(self, kind: str) -> list[Measured]:
        """Return the wheels' azimuths from that kind of logs, none if there were no such logs."""
        return [one for one in self.measured if "azimuths" in one.name and one.kind == kind]

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds, SI units."""
        more = [one for one in (self.camera_delay, self.leaning_seen) if one]
        return {
            "measured": [_entry(one) for one in self.measured],
            "wheel_ratios": [_entry(one) for one in self.wheel_ratios],
            "others": [_entry(one) for one in more],
        }


def common_turn(azimuths: Sequence[Measured]) -> float:
    """Return the turn [rad] that azimuths have in common against the file: their median, so that one may be wrong."""
    return float(np.median([one.value - one.in_file for one in azimuths]))


def survey_geometry(
    robot: Robot,
    *,
    upside_down: Sequence[Log] = (),
    balancing: Sequence[tuple[Log, Log]] = (),
    progress: ProgressCallback = ignore_progress,
) -> Geometry:
    """Find a robot's geometry by kinematics alone.

    Parameters
    ----------
    robot : Robot
        Its values start the search, and the result is compared with them.
    upside_down : sequence of Log
        With wheel1 .. wheeln and ball_omega_x, _y, _z in the robot's frame.
    balancing : sequence of (Log, Log)
        A run's log, with wheel1 .. wheeln and gyro_x, _y, _z, and its motion capture: t, x y z of the ball's centre, qw
        qx qy qz of the body, on its own clock and in its own frame.
    progress : callable, optional
        Called before each stage.

    Raises
    ------
    InputError
        If there is no log, a column is missing, or the motion does not determine the geometry.
    """
    if not upside_down and not balancing:
        raise InputError(
            "No log is given; geometry needs a log of the robot upside "
            "down, or of the robot balancing with motion capture."
        )
    total = (1 if upside_down else 0) + (len(balancing) + 1 if balancing else 0)
    if upside_down:
        progress(Progress(stage="fitting the logs upside down", done=0, total=total))
    on_wheels = upside_down_geometry(robot, upside_down) if upside_down else None
    runs = []
    for log, film in balancing:
        done = total - len(balancing) - 1 + len(runs)
        progress(Progress(stage="aligning the motion capture", done=done, total=total))
        runs.append(mocap_run(log, film))
    if runs:
        progress(Progress(stage="fitting the balancing logs", done=total - 1, total=total))
    rolling = rolling_geometry(robot, runs, leaning=_leaning(robot, on_wheels)) if runs else None
    measured = [
        *(_of_upside_down(robot, on_wheels) if on_wheels else ()),
        *(_of_rolling(robot, rolling) if rolling else ()),
        *(_of_both(robot, on_wheels.fit, rolling) if on_wheels and rolling else ()),
        *(_of_mountings([run.motion for run in runs]) if runs else ()),
    ]
    n = robot.wheel_count
    return Geometry(
        measured=tuple(measured),
        wheel_ratios=_wheel_ratios(on_wheels) if on_wheels else (),
        camera_delay=_of_fit("camera delay", on_wheels.fit, n + 4, 0.0, "s", "upside down")
        if on_wheels
        else None,
        leaning_seen=_of_fit("leaning seen", rolling, n + 1, 1.0, "1", "balancing") if rolling else None,
    )


def _leaning(robot: Robot, on_wheels: UpsideDownGeometry | None) -> float:
    """Return (r_b / r_w) cos(tilt) by the logs where they gave it, else by the file."""
    if on_wheels:
        return float(on_wheels.fit.values[0] * np.cos(on_wheels.fit.values[1]))
    return robot.ball.radius / robot.wheels.radius * math.cos(robot.wheels.tilt)


def _of_fit(name: str, fit: ClusteredFit, place: int, in_file: float, unit: str, kind: str) -> Measured:
    return _measured(name, (float(fit.values[place]), float(fit.errors[place])), in_file, unit, kind)


def _measured(name: str, found: tuple[float, float], in_file: float, unit: str, kind: str) -> Measured:
    value, error = found
    return Measured(name=name, value=value, standard_error=error, in_file=in_file, unit=unit, kind=kind)


def _azimuths(robot: Robot, fit: ClusteredFit, first: int, kind: str) -> list[Measured]:
    return [
        _of_fit(f"wheels.azimuths[{i}]", fit, first + i, azimuth, "rad", kind)
        for i, azimuth in enumerate(robot.wheels.azimuths)
    ]


def _of_upside_down(robot: Robot, found: UpsideDownGeometry) -> list[Measured]:
    n, kind, fit = robot.wheel_count, "upside down", found.fit
    return [
        _of_fit("ball.radius / wheels.radius", fit, 0, robot.ball.radius / robot.wheels.radius, "1", kind),
        _of_fit("wheels.tilt", fit, 1, robot.wheels.tilt, "rad", kind),
        *_azimuths(robot, fit, 2, kind),
        _of_fit("camera tilt about x", fit, n + 2, 0.0, "rad", kind),
        _of_fit("camera tilt about y", fit, n + 3, 0.0, "rad", kind),
    ]


def _of_rolling(robot: Robot, fit: ClusteredFit) -> list[Measured]:
    in_file = robot.wheels.radius / math.cos(robot.wheels.tilt)
    return [
        _of_fit("wheels.radius / cos(wheels.tilt)", fit, 0, in_file, "m", "balancing"),
        *_azimuths(robot, fit, 1, "balancing"),
    ]


def _of_both(robot: Robot, on_wheels: ClusteredFit, rolling: ClusteredFit) -> list[Measured]:
    ratio, tilt, length = (*on_wheels.values[:2].tolist(), float(rolling.values[0]))
    c, s = math.cos(tilt), math.sin(tilt)
    covariance = block_diag(on_wheels.covariance[:2, :2], rolling.errors[0] ** 2)
    # of r_w = length cos(tilt) and r_b = ratio r_w by ratio, tilt and length
    J = np.array([[0.0, -length * s, c], [length * c, -ratio * length * s, ratio * c]])
    r_w, r_b = np.sqrt(np.diag(J @ covariance @ J.T)).tolist()
    return [
        _measured("wheels.radius", (length * c, r_w), robot.wheels.radius, "m", "both"),
        _measured("ball.radius", (ratio * length * c, r_b), robot.ball.radius, "m", "both"),
    ]


def _of_mountings(motions: Sequence[MotionFit]) -> list[Measured]:
    """Return the IMU's rotation against the body as the cameras have it, a mean weighted by the runs' variances."""
    values = np.array([one.body_marker.as_rotvec() for one in motions])
    weights = 1.0 / np.array([one.rotation_errors for one in motions]) ** 2
    mean, errors = (weights * values).sum(axis=0) / weights.sum(axis=0), 1.0 / np.sqrt(weights.sum(axis=0))
    return [
        _measured(f"IMU rotation about {axis}", found, 0.0, "rad", "balancing")
        for axis, found in zip("xyz", zip(mean.tolist(), errors.tolist(), strict=True), strict=True)
    ]


def _wheel_ratios(found: UpsideDownGeometry) -> tuple[Measured, ...]:
    common = float(found.fit.values[0])
    pairs = zip(found.ratios.tolist(), found.ratio_errors.tolist(), strict=True)
    return tuple(
        _measured(f"ball.radius / wheels.radius, wheel {i}", pair, common, "1", "upside down")
        for i, pair in enumerate(pairs, start=1)
    )


def _entry(one: Measured) -> dict[str, object]:
    return {
        "name": one.name,
        "value": one.value,
        "standard_error": one.standard_error,
        "in_file": one.in_file,
        "deviation": one.deviation,
        "unit": one.unit,
        "from": one.kind,
    }


def robot_with_geometry(robot: Robot, geometry: Geometry) -> Robot:
    """Return the robot with the radii, tilt and azimuths found, where the logs gave them.

    Azimuths are upside down's where there are both, less the turn that all have in common, which is a camera's heading.
    A standard deviation is that of noise and of slip together.

    Raises
    ------
    InputError
        If that is no robot, as when another radius does not go with the ball's inertia.
    """
    found = {one.name: one for one in reversed(geometry.measured)}  # the first of a name counts
    ball, wheels = robot.ball, robot.wheels
    sources, deviations = dict(robot.sources), dict(robot.standard_deviations)
    kept: list[tuple[str, list[Measured]]] = []
    if "ball.radius" in found:
        ball = replace(ball, radius=found["ball.radius"].value)
        wheels = replace(wheels, radius=found["wheels.radius"].value)
        kept += [(name, [found[name]]) for name in ("ball.radius", "wheels.radius")]
    if "wheels.tilt" in found:
        wheels = replace(wheels, tilt=found["wheels.tilt"].value)
        kept.append(("wheels.tilt", [found["wheels.tilt"]]))
    azimuths = [found[f"wheels.azimuths[{i}]"] for i in range(robot.wheel_count)]
    turn = common_turn(azimuths)
    wheels = replace(wheels, azimuths=tuple(one.value - turn for one in azimuths))
    kept.append(("wheels.azimuths", azimuths))
    for name, numbers in kept:
        deviation: Value = tuple(math.hypot(one.standard_error, one.slip) for one in numbers)
        deviations[name] = deviation if name == "wheels.azimuths" else deviation[0]
        sources[name] = f"identified: geometry from logs ({numbers[0].kind})"
    moved = robot.replace(ball=ball, wheels=wheels)
    return moved.annotated(sources=sources, standard_deviations=deviations)


#: a deviation of fewer standard errors than this is noise
CLEAR = 3.0
_AGREES = (
    "The file agrees with the logs: no value differs by more than "
    "three standard errors and by more than slip and rollers can cause."
)


def geometry_findings(geometry: Geometry) -> list[Finding]:
    """Return the findings about a geometry, the most severe first."""
    turns = {kind: _frame_turn(geometry, kind) for kind in ("upside down", "balancing")}
    findings = [_turned(kind, turn) for kind, turn in turns.items() if turn]
    both_radii = any(one.kind == "both" for one in geometry.measured)
    reported: set[str] = set()
    for one in geometry.measured:
        # with both radii known, their ratio adds nothing
        covered_by_radii = both_radii and "/" in one.name
        turn = turns.get(one.kind, 0.0) if "azimuths" in one.name else 0.0
        if one.name not in reported and not covered_by_radii and _stands_out(one, turn):
            findings.append(_sentence(one))
            reported.add(one.name)
    for number, one in enumerate(geometry.wheel_ratios, start=1):
        if _stands_out(one, 0.0):
            more = 100.0 * (one.value / one.in_file - 1.0)
            findings.append(
                f"Wheel {number} turns {more:+.1f} % faster than the mean of the wheels "
                "for the same motion of the ball: its radius differs, or it slips."
            )
    return [note("geometry", text) for text in (*(findings or [_AGREES]), *_missing(geometry))]


def _stands_out(one: Measured, turn: float) -> bool:
    off = abs(one.in_file - one.value + turn)
    return off > CLEAR * one.standard_error and off > one.slip


def _sentence(one: Measured) -> str:
    value, in_file = _rounded(one.value, one), _rounded(one.in_file, one)
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


def _rounded(value: float, one: Measured) -> str:
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
