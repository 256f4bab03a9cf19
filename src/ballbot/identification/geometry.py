"""A robot's geometry from its logs by kinematics alone, compared with its file.

Motion is measured as increments over windows: encoder angles, integrals of rates and sums of small rotations. They need
no derivative of encoder counts, and the noise of rates averages out.

A log upside down, the ball on the wheels, gives r_b / r_w, tilt and azimuths. Omega is the ball's angular velocity from
a camera, and R the small tilt of the camera's frame about x and y; its rotation about z is part of the azimuths:

    wheel angle_i = (r_b / r_w) a_i . R integral of Omega dt
    a_i = (-cos alpha cos beta_i, -cos alpha sin beta_i, sin alpha)

A balancing run with motion capture gives r_w / cos(alpha) and the azimuths. Increments in the body frame do not depend
on the cameras' frame; an error of e in `up`, the mean upright axis, changes the rolling by e^2/2:

    rolling = sum of up x R_k^T (p_k+1 - p_k) [m]
    wheel angle_i = a_i . ( rolling / r_w - share (r_b / r_w) turning ) + pivoting

Pivoting of the ball and the heading of the body add the same angle to every wheel and are removed from the windows.
Play and rollers are half as large as the lean, so the `share` of the turning that encoders show is estimated. Both
kinds of logs together give each radius. Standard errors do not include slip, which `SLIP` and `SLIP_ANGLE` bound.
"""

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation

from ballbot.arrays import Floats, Ints
from ballbot.errors import InputError
from ballbot.findings import Finding, note, stop_on_errors
from ballbot.fitting.experiment import BlockErrors, residuals_without_states
from ballbot.fitting.fit import Fit, fit
from ballbot.fitting.least_squares import fit_linear
from ballbot.fitting.parameter import FitParameter
from ballbot.identification.driveline import BALL_NAMES
from ballbot.identification.motion_capture import LARGEST_LEAN, frame_findings, poses_on_rows
from ballbot.identification.turning import (
    GYRO_NAMES,
    MotionFit,
    Turning,
    log_turning,
    match_turning,
    poses_turning,
)
from ballbot.log import Log
from ballbot.log.columns import wheel_angle_names
from ballbot.log.pose import read_poses
from ballbot.progress import Progress, ProgressCallback, ignore_progress
from ballbot.results import key, reported
from ballbot.robot import Robot
from ballbot.robot.parameters import Value
from ballbot.robot.wheel_directions import axles

#: duration of the windows in a cluster [s], about the time in which a roller passes
CLUSTER = 2.0
#: shortest gap, over the usual sampling interval
LARGEST_GAP = 1.5
#: offset of cluster numbers between logs
_CLUSTERS_OF_LOG = 1_000_000
#: least share of the rotation that log and cameras of one run have in common
_LEAST_SHARE = 0.5


def _increments(
    totals: Sequence[tuple[Log, tuple[Floats, ...]]], *, window: float
) -> tuple[list[Floats], Ints]:
    """Return increments (w, .) of running totals (N, .) over complete windows, end to end, and their clusters (w,)."""
    increments, clusters = [], []
    for number, (log, columns) in enumerate(totals):
        samples = round(window / log.sample_time)
        if samples < 2:
            raise InputError(
                f"The log's sample time of {log.sample_time:g} s is too long for windows of {window:g} s."
            )
        first = np.arange(0, len(log.t) - samples, samples)
        complete = np.asarray(np.isfinite(np.hstack(columns)).all(axis=1))
        follows = complete[1:] & complete[:-1] & (np.diff(log.t) < LARGEST_GAP * log.sample_time)
        broken = np.concatenate([[0], np.cumsum(~follows)])
        first = first[broken[first + samples] == broken[first]]
        increments.append([column[first + samples] - column[first] for column in columns])
        clusters.append(np.floor((log.t[first] - log.t[0]) / CLUSTER) + _CLUSTERS_OF_LOG * number)
    stacked = [np.concatenate(column) for column in zip(*increments, strict=True)]
    return stacked, np.concatenate(clusters).astype(np.int64)


@dataclass(frozen=True, kw_only=True, eq=False)
class MocapRun:
    """A balancing run: its log, the ball's rolling from cameras, and the alignment of the two."""

    log: Log
    rolling: Turning  #: [m], in the body frame, on the cameras' clock; missing while the robot falls
    motion: MotionFit  #: its `body_marker` rotates the body frame to the IMU's


def mocap_run(log: Log, mocap: Log, *, accept: Collection[str] = ()) -> MocapRun:
    """Return a balancing run, from its log with a gyro and its motion capture of ball and body.

    InputError if a column is missing, the robot is hardly ever seen upright, the two are of different runs, or the
    positions are in another unit or frame (`frame_findings`) and the code of that is not accepted.
    """
    log.require(*GYRO_NAMES)
    seen = read_poses(mocap)
    placed = np.asarray(np.isfinite(seen.places).all(axis=1))
    if placed.sum() < 10:
        raise InputError(
            "The motion capture has no poses; it needs the columns x, y, z and the unit quaternion qw, qx, qy, qz."
        )
    poses = seen.of_rows(placed)
    axis = poses.rotations.apply([0.0, 0.0, 1.0])
    up = np.median(axis, axis=0)
    up /= np.linalg.norm(up)
    upright = poses.of_rows(axis @ up > np.cos(LARGEST_LEAN))
    turning, rotations = poses_turning(upright), upright.rotations
    motion, _ = match_turning(log_turning(log), turning, least_share=_LEAST_SHARE)
    stop_on_errors(frame_findings(log, poses_on_rows(log, seen, motion), motion), accept=accept)
    turns = (rotations[:-1].inv() * rotations[1:]).as_rotvec()
    middle = (rotations[:-1] * Rotation.from_rotvec(0.5 * turns)).inv()
    rolls = np.cross(middle.apply(up), middle.apply(np.diff(upright.places, axis=0)))
    known = np.diff(turning.missing) == 0.0
    return MocapRun(log=log, rolling=Turning.of(upright.t, rolls, known), motion=motion)


#: largest error of a radius, as a share, and of an angle [rad] by slip, deformation and rollers: 0.42 % and 0.25
#: degrees on logs of a physics engine with two rows of rollers and known geometry (commands in docs/geometry.md)
SLIP = 0.006
SLIP_ANGLE = math.radians(0.4)
#: a deviation of fewer standard errors is noise
CLEAR = 3.0
UPSIDE_DOWN, BALANCING, BOTH = "upside down", "balancing", "both"
_UNDETERMINED = {
    BALANCING: "The motion in these logs does not determine the wheels' radius and azimuths; move in both directions "
    "and turn all wheels.",
    UPSIDE_DOWN: "The motion in these logs does not determine the ratio of the radii, the tilt and the azimuths; turn "
    "the ball about all three axes.",
}


@dataclass(frozen=True)
class GeometryQuantity:
    """A quantity of the geometry, from logs and in the robot's file.

    >>> length = GeometryQuantity("wheels.radius", 0.0635, 0.0001, in_file=0.063, unit="m", kind="both")
    >>> round(length.deviation, 1), length.stands_out()  # in standard errors; beyond noise and slip
    (-5.0, True)
    """

    name: str  #: as in a robot file if it is there: "wheels.tilt", "wheels.azimuths[0]"
    value: float  #: SI units
    standard_error: float
    in_file: float  #: value in the robot's file, or one that follows from it
    unit: str  #: "m", "rad", "s" or "1"
    kind: str = field(metadata=key("from"))  #: "upside down", "balancing" or "both"

    @reported
    def deviation(self) -> float:
        """Difference of the file's value, in standard errors."""
        return (self.in_file - self.value) / self.standard_error

    @property
    def slip(self) -> float:
        """Largest error that slip may cause, in the quantity's unit."""
        return SLIP_ANGLE if self.unit == "rad" else SLIP * abs(self.value)

    def stands_out(self, turn: float = 0.0) -> bool:
        """Return whether the file differs beyond noise and slip, except for a common `turn` of azimuths."""
        return abs(self.in_file - self.value + turn) > max(CLEAR * self.standard_error, self.slip)


def _azimuths(robot: Robot) -> list[FitParameter]:
    return [
        FitParameter.about(f"wheels.azimuths[{i}]", azimuth, "rad", within=0.5 * math.pi)
        for i, azimuth in enumerate(robot.wheels.azimuths)
    ]


#: least clusters for each parameter; with fewer a covariance is too small
CLUSTERS_PER_PARAMETER = 2
#: largest condition number of the normal equations, with parameters scaled by their bounds
_LARGEST_CONDITION = 1e10


def _fitted(
    kind: str, parameters: Sequence[FitParameter], residuals: Callable[[Floats], Floats], clusters: Ints
) -> tuple[list[GeometryQuantity], Fit[BlockErrors]]:
    """Fit parameters, from the file's values, to residuals (w, n) of windows in clusters (w,)."""
    start = np.array([parameter.default for parameter in parameters])
    names, block = np.unique(clusters, return_inverse=True)
    least = CLUSTERS_PER_PARAMETER * len(start)
    if len(names) < least:
        raise InputError(
            f"The logs have {len(names)} intervals of usable motion for {len(start)} unknowns, which need {least}; "
            "log for longer."
        )
    experiment = residuals_without_states(
        residuals,
        parameters=parameters,
        block=np.repeat(block, residuals(start).shape[1]).astype(np.int64),
        block_log=(names // _CLUSTERS_OF_LOG).astype(np.int64),
    )
    result = fit(experiment, experiment.coordinates.scaled(start))
    condition = np.linalg.cond(result.finished.equations.matrix)
    if not result.estimated.all() or condition > _LARGEST_CONDITION:
        raise InputError(_UNDETERMINED[kind])
    numbers = zip(parameters, result.values.tolist(), result.errors.tolist(), strict=True)
    found = [GeometryQuantity(p.name, value, error, p.default, p.unit, kind) for p, value, error in numbers]
    return found, result


#: length of a window [s]
ROLLING_WINDOW, UPSIDE_DOWN_WINDOW = 0.5, 0.25


def _of_rolling(
    robot: Robot, runs: Sequence[MocapRun], leaning: float
) -> tuple[list[GeometryQuantity], Fit[BlockErrors]]:
    """Identify r_w / cos(tilt), the azimuths, the share of `leaning`, (r_b / r_w) cos(tilt), seen, and the delay."""
    n, totals = robot.wheel_count, []
    for run in runs:
        log, rolling, motion = run.log, run.rolling, run.motion
        angles, gyro = (
            np.column_stack([log[name] for name in names]) for names in (wheel_angle_names(n), GYRO_NAMES)
        )
        turning = motion.body_marker.inv().apply(Turning.of_rates(log.t, gyro - motion.bias).total)[:, :2]
        t = motion.clock.to_cameras(log.t)
        known = rolling.covers(t - 0.05, t + 0.05) & np.isfinite(gyro).all(axis=1)
        rolled = np.where(known[:, None], rolling.over(np.full(len(t), rolling.t[0]), t)[:, :2], np.nan)
        rate = rolling.over(t - 0.02, t + 0.02)[:, :2] / 0.04  # [m/s] over 40 ms
        totals.append((log, (angles, rolled, turning, rate)))
    (wheels, rolls, turns, speeds), clusters = _increments(totals, window=ROLLING_WINDOW)
    wheels = wheels - wheels.mean(axis=1, keepdims=True)

    def residuals(p: Floats) -> Floats:
        level = np.column_stack([-np.cos(p[1 : 1 + n]), -np.sin(p[1 : 1 + n])])
        rolled = (rolls - p[2 + n] * speeds) / p[0]
        seen = (rolled - p[1 + n] * leaning * turns) @ level.T
        return wheels - (seen - seen.mean(axis=1, keepdims=True))

    length = robot.wheels.radius / math.cos(robot.wheels.tilt)
    parameters = [
        FitParameter.about("wheels.radius / cos(wheels.tilt)", length, "m", factor=2.0),
        *_azimuths(robot),
        FitParameter.about("leaning seen", 1.0, "1", within=2.0),
        FitParameter.about("delay of the encoders", 0.0, "s", within=0.5),
    ]
    return _fitted(BALANCING, parameters, residuals, clusters)


def _of_upside_down(
    robot: Robot, logs: Sequence[Log]
) -> tuple[list[GeometryQuantity], list[GeometryQuantity], Fit[BlockErrors]]:
    """Identify r_b / r_w, tilt, azimuths, the camera's tilt and delay, and r_b / r_w of each wheel by itself."""
    n, ratio = robot.wheel_count, robot.ball.radius / robot.wheels.radius
    totals = []
    for log in logs:
        angles, omega = (
            np.column_stack([log[name] for name in names]) for names in (wheel_angle_names(n), BALL_NAMES)
        )
        totals.append((log, (angles, Turning.of_rates(log.t, omega).total, omega)))
    (wheels, turns, rates), clusters = _increments(totals, window=UPSIDE_DOWN_WINDOW)

    def residuals(p: Floats) -> Floats:
        frame = Rotation.from_rotvec([p[2 + n], p[3 + n], 0.0])
        return wheels - p[0] * frame.apply(turns - p[4 + n] * rates) @ axles(p[2 : 2 + n], p[1]).T

    parameters = [
        FitParameter.about("ball.radius / wheels.radius", ratio, "1", factor=2.0),
        FitParameter.about("wheels.tilt", robot.wheels.tilt, "rad", within=0.5),
        *_azimuths(robot),
        FitParameter.about("camera tilt about x", 0.0, "rad", within=1.0),
        FitParameter.about("camera tilt about y", 0.0, "rad", within=1.0),
        FitParameter.about("camera delay", 0.0, "s", within=0.5),
    ]
    quantities, common_fit = _fitted(UPSIDE_DOWN, parameters, residuals, clusters)
    # without assuming a wheel's direction: the length of its row of G (n, 3) in wheels = turns G^T
    own = [fit_linear(turns - common_fit.values[-1] * rates, angles, clusters) for angles in wheels.T]
    ratios = []
    for number, wheel in enumerate(own, start=1):
        size = float(np.linalg.norm(wheel.values))
        error = math.sqrt(wheel.values @ wheel.covariance @ wheel.values) / size
        name, common = f"ball.radius / wheels.radius, wheel {number}", float(common_fit.values[0])
        ratios.append(GeometryQuantity(name, size, error, common, "1", UPSIDE_DOWN))
    return quantities, ratios, common_fit


@dataclass(frozen=True, kw_only=True, eq=False)
class Geometry:
    """A robot's geometry from its logs."""

    measured: tuple[GeometryQuantity, ...]
    wheel_ratios: tuple[GeometryQuantity, ...] = ()  #: r_b / r_w of each by itself
    #: delay of the camera upside down [s], and the share of the lean that the encoders show; play hides the rest
    others: tuple[GeometryQuantity, ...] = ()

    def azimuths(self, kind: str) -> list[GeometryQuantity]:
        """Return the wheels' azimuths from that kind of logs; an empty list without such logs."""
        return [azimuth for azimuth in self.measured if "azimuths" in azimuth.name and azimuth.kind == kind]


def common_turn(azimuths: Sequence[GeometryQuantity]) -> float:
    """Return the common turn [rad] of azimuths against the file, as their median, so that one may be wrong."""
    return float(np.median([azimuth.value - azimuth.in_file for azimuth in azimuths]))


def survey_geometry(
    robot: Robot,
    *,
    upside_down: Sequence[Log] = (),
    balancing: Sequence[tuple[Log, Log]] = (),
    accept: Collection[str] = (),
    progress: ProgressCallback = ignore_progress,
) -> Geometry:
    """Identify a robot's geometry by kinematics alone.

    InputError if there is no log, a column is missing, or the motion does not determine the geometry.

    Parameters
    ----------
    robot : Robot
        Its geometry starts the fit, and is compared with the result.
    upside_down : sequence of Log
        With wheel1 .. wheeln and ball_omega_x, _y, _z in the robot's frame.
    balancing : sequence of (Log, Log)
        A run's log, with wheel1 .. wheeln and gyro_x, _y, _z, and its motion capture: t, x y z of the ball's centre, qw
        qx qy qz of the body, on its own clock and in its own frame.
    accept : collection of str, optional
        Codes of errors of the motion capture to continue with.
    progress : callable, optional
        Called before each stage.

    Examples
    --------
    >>> robot = Robot.load("alten")
    >>> t = 0.005 * np.arange(8000)
    >>> f, size = np.array([[1.3, 1.9, 2.7], [0.7, 3.1, 2.2]]), np.array([3.0, 4.0, 2.5])
    >>> phases = np.multiply.outer(t, f)
    >>> omega, turned = (size * (np.sin(phases)).sum(axis=1), size * ((1.0 - np.cos(phases)) / f).sum(axis=1))
    >>> A = robot.ball.radius / robot.wheels.radius * axles(robot.wheels.azimuths, robot.wheels.tilt)
    >>> columns = dict(zip(BALL_NAMES, omega.T)) | dict(zip(("wheel1", "wheel2", "wheel3"), (turned @ A.T).T))
    >>> geometry = survey_geometry(robot, upside_down=[Log({"t": t, **columns})])
    >>> tilt, = (quantity for quantity in geometry.measured if quantity.name == "wheels.tilt")
    >>> round(tilt.value / robot.wheels.tilt, 3)
    1.0
    """
    if not upside_down and not balancing:
        raise InputError(
            "No log is given; geometry needs a log of the robot upside "
            "down, or of the robot balancing with motion capture."
        )
    stages = [
        *(["fitting the logs upside down"] if upside_down else []),
        *(["aligning the motion capture"] * len(balancing)),
        *(["fitting the balancing logs"] if balancing else []),
    ]
    steps = (Progress(stage=stage, done=k, total=len(stages)) for k, stage in enumerate(stages))
    leaning = robot.ball.radius / robot.wheels.radius * math.cos(robot.wheels.tilt)
    measured, ratios, runs = list[GeometryQuantity](), list[GeometryQuantity](), list[MocapRun]()
    on_wheels = None
    if upside_down:
        progress(next(steps))
        measured, ratios, on_wheels = _of_upside_down(robot, upside_down)
        leaning = float(on_wheels.values[0] * math.cos(on_wheels.values[1]))
    for log, mocap in balancing:
        progress(next(steps))
        runs.append(mocap_run(log, mocap, accept=accept))
    if runs:
        progress(next(steps))
        of_rolling, rolling = _of_rolling(robot, runs, leaning)
        measured += of_rolling[:-1]
        measured += _of_both(robot, on_wheels, rolling) if on_wheels else []
        measured += _of_mountings([run.motion for run in runs])
    others = tuple(quantity for quantity in measured if quantity.name in _OTHERS)
    kept = tuple(quantity for quantity in measured if quantity not in others)
    return Geometry(measured=kept, wheel_ratios=tuple(ratios), others=others)


#: quantities that are not geometry
_OTHERS = ("camera delay", "leaning seen")


def _of_both(robot: Robot, on_wheels: Fit[BlockErrors], rolling: Fit[BlockErrors]) -> list[GeometryQuantity]:
    """Return both radii, r_w = length cos(tilt) and r_b = ratio r_w, by the delta method."""
    ratio, tilt, length = (*on_wheels.values[:2].tolist(), float(rolling.values[0]))
    c, s = math.cos(tilt), math.sin(tilt)
    covariance = block_diag(on_wheels.covariance[:2, :2], rolling.errors[0] ** 2)
    # derivatives by ratio, tilt and length
    J = np.array([[0.0, -length * s, c], [length * c, -ratio * length * s, ratio * c]])
    wheel, ball = np.sqrt(np.diag(J @ covariance @ J.T)).tolist()
    return [
        GeometryQuantity("wheels.radius", length * c, wheel, robot.wheels.radius, "m", BOTH),
        GeometryQuantity("ball.radius", ratio * length * c, ball, robot.ball.radius, "m", BOTH),
    ]


def _of_mountings(motions: Sequence[MotionFit]) -> list[GeometryQuantity]:
    """Return the IMU's rotation against the body frame of the cameras, the variance-weighted mean over runs."""
    values = np.array([motion.body_marker.as_rotvec() for motion in motions])
    weights = 1.0 / np.array([motion.rotation_errors for motion in motions]) ** 2
    mean, errors = (weights * values).sum(axis=0) / weights.sum(axis=0), 1.0 / np.sqrt(weights.sum(axis=0))
    return [
        GeometryQuantity(f"IMU rotation about {axis}", value, error, 0.0, "rad", BALANCING)
        for axis, value, error in zip("xyz", mean.tolist(), errors.tolist(), strict=True)
    ]


def robot_with_geometry(robot: Robot, geometry: Geometry) -> Robot:
    """Return the robot with the radii, tilt and azimuths that the logs determine.

    Azimuths are those upside down if there are both, less their common turn, which is the camera's heading. A standard
    deviation includes noise and slip. InputError if the robot is invalid, as with a radius that does not suit the
    ball's inertia.

    >>> radius = GeometryQuantity("wheels.radius", 0.0635, 0.0001, in_file=0.063, unit="m", kind="both")
    >>> robot_with_geometry(Robot.load("alten"), Geometry(measured=(radius,))).wheels.radius
    0.0635
    """
    values, sources, deviations = dict[str, Value](), dict(robot.sources), dict(robot.standard_deviations)
    azimuths = geometry.azimuths(UPSIDE_DOWN) or geometry.azimuths(BALANCING)
    for name in ("ball.radius", "wheels.radius", "wheels.tilt", "wheels.azimuths"):
        of_all, single = name == "wheels.azimuths", [q for q in geometry.measured if q.name == name][:1]
        if quantities := azimuths if of_all else single:
            rounded = float if name.endswith("radius") else _in_degrees
            turn = common_turn(quantities) if of_all else 0.0
            numbers = tuple(rounded(q.value - turn) for q in quantities)
            sizes = tuple(rounded(math.hypot(q.standard_error, q.slip)) for q in quantities)
            values[name], deviations[name] = (numbers, sizes) if of_all else (numbers[0], sizes[0])
            sources[name] = f"identified: geometry from logs ({quantities[0].kind})"
    return robot.replace(values).annotated(sources=sources, standard_deviations=deviations)


def _in_degrees(angle: float) -> float:
    """Return an angle [rad], rounded to nine decimals in degrees as in a file."""
    return math.radians(round(math.degrees(angle), 9))


_AGREES = (
    "The file agrees with the logs: no value differs by more than "
    "three standard errors and by more than slip and rollers can cause."
)
#: by the kind of logs that are lacking
_WITHOUT = {
    BALANCING: "Each radius by itself and the mounting of the IMU need a balancing run with motion capture as well.",
    UPSIDE_DOWN: "The tilt and both radii by themselves need a log of the robot upside down as well: while it "
    "balances, the body leans too little compared with play and rollers, and the ball may pivot.",
}


def geometry_findings(geometry: Geometry) -> list[Finding]:
    """Return the findings on a geometry, the most severe first."""
    kinds = {quantity.kind for quantity in geometry.measured}
    sentences, named, turns = list[str](), dict[str, str](), dict[str, float]()
    for kind in (UPSIDE_DOWN, BALANCING):
        azimuths = geometry.azimuths(kind)
        turn = common_turn(azimuths) if azimuths else 0.0
        if abs(turn) > max([SLIP_ANGLE, *(CLEAR * azimuth.standard_error for azimuth in azimuths)]):
            turns[kind] = turn
            sentences.append(
                f"All azimuths are turned by {math.degrees(turn):+.2f} deg in the logs ({kind}): the "
                "cameras' forward direction differs from the robot file's, or all wheels are mounted turned."
            )
    for quantity in geometry.measured:
        turn = turns.get(quantity.kind, 0.0) if "azimuths" in quantity.name else 0.0
        # with both radii known, their ratio adds nothing
        if quantity.stands_out(turn) and not (BOTH in kinds and "/" in quantity.name):
            named.setdefault(quantity.name, _sentence(quantity))
    sentences += named.values()
    sentences += [
        f"Wheel {number} turns {100.0 * (ratio.value / ratio.in_file - 1.0):+.1f} % faster than the mean of the wheels "
        "for the same motion of the ball: its radius differs, or it slips."
        for number, ratio in enumerate(geometry.wheel_ratios, start=1)
        if ratio.stands_out()
    ]
    missing = [text for kind, text in _WITHOUT.items() if kind not in kinds]
    return [note("geometry", text) for text in (*(sentences or [_AGREES]), *missing)]


#: advice on a quantity that differs from the file, by the beginning of its name
_ADVICE = {
    "IMU": "mount it straight, or correct its readings.",
    "camera": "the camera that watched the ball is tilted, which was corrected.",
    "ball.radius /": "a balancing run with motion capture would show which of the two radii is wrong.",
    "wheels.radius /": "a log of the robot upside down would show whether the radius or the tilt is wrong.",
    "": "measure it again, or use the value from the logs.",
}


def _sentence(quantity: GeometryQuantity) -> str:
    if quantity.unit == "rad":
        value, in_file = (f"{math.degrees(number):.2f} deg" for number in (quantity.value, quantity.in_file))
        share = ""
    else:
        decimals = max(0, 1 - math.floor(math.log10(quantity.standard_error)))
        unit = "" if quantity.unit == "1" else f" {quantity.unit}"
        value, in_file = (f"{number:.{decimals}f}{unit}" for number in (quantity.value, quantity.in_file))
        share = f"{100.0 * (quantity.in_file / quantity.value - 1.0):+.1f} % or "
    advice = next(text for name, text in _ADVICE.items() if quantity.name.startswith(name))
    return (
        f"{quantity.name} is {value} by the logs and {in_file} in the file, a difference of {share}"
        f"{abs(quantity.deviation):.0f} standard errors; {advice}"
    )
