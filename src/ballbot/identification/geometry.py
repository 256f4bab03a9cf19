"""A robot's geometry from all its logs by kinematics alone, compared with its file.

Motion is taken as increments over windows: encoder angles against integrals of rates and sums of small turns. They need
no derivative of an encoder, and the noise of a rate averages out.

Upside down, the ball on the wheels gives r_b / r_w, tilt and azimuths, with Omega the ball's angular velocity by a
camera and R the small tilt of the camera's frame about x and y; its turn about z is counted in the azimuths:

    wheel angle_i = (r_b / r_w) a_i . R integral of Omega dt
    a_i = (-cos alpha cos beta_i, -cos alpha sin beta_i, sin alpha)

A balancing run that cameras watched gives r_w / cos(alpha) and the azimuths. Increments in the body's own frame do not
depend on the cameras' frame; an error of e in `up`, the mean upright axis, changes the rolling by e^2/2:

    rolling = sum of up x R_k^T (p_k+1 - p_k) [m]
    wheel angle_i = a_i . ( rolling / r_w - share (r_b / r_w) turning ) + pivoting

Pivoting of the ball and the body's heading add the same angle to every wheel and are taken out of the windows. Play and
rollers are half as large as the lean, so the `share` of the turning that encoders show is estimated.

Both kinds of log together give each radius:

    r_w = (r_w / cos alpha) cos alpha        r_b = (r_b / r_w) r_w

Standard errors are the delta method's, the two kinds of log being independent. They do not include the few tenths of a
percent by which rollers slip and a ball dents; `SLIP` and `SLIP_ANGLE` bound these.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation

from ballbot.errors import InputError
from ballbot.findings import Finding, note
from ballbot.fitting.experiment import BlockErrors, residuals_without_states
from ballbot.fitting.fit import Fit, fit
from ballbot.fitting.least_squares import fit_linear
from ballbot.fitting.parameter import Parameter
from ballbot.identification.driveline import BALL_NAMES
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
from ballbot.results import key, reported, to_results
from ballbot.robot import Robot
from ballbot.robot.parameters import Value
from ballbot.robot.wheel_directions import axles

#: windows on end that count as one cluster together last this long [s]: a roller takes about as long to pass
CLUSTER = 2.0
#: a sampling interval longer than this many usual ones is a gap
LARGEST_GAP = 1.5
#: numbers of clusters that each log has for itself
_CLUSTERS_OF_LOG = 1_000_000
#: share of the turning that must be common to log and cameras, or they are not of the same run
_LEAST_SHARE = 0.5


def _increments(
    totals: Sequence[tuple[Log, tuple[NDArray[np.float64], ...]]], *, window: float
) -> tuple[list[NDArray[np.float64]], NDArray[np.int64]]:
    """Return the increments (w, .) of logs' running totals (N, .) over windows, end to end, and their clusters (w,).

    Windows without a value or a row are left out. InputError if a window [s] is less than two samples.
    """
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


#: beyond this angle from upright [rad] a robot is falling or in hands
LARGEST_LEAN = 0.35


@dataclass(frozen=True, kw_only=True, eq=False)
class MocapRun:
    """A balancing run: its log, the ball's rolling by cameras, and the alignment of the two."""

    log: Log
    rolling: (
        Turning  #: in the body's frame on the cameras' clock, totals in metres; a falling robot's is missing
    )
    motion: MotionFit  #: its `body_marker` takes vectors of the body's frame to the IMU's


def mocap_run(log: Log, film: Log) -> MocapRun:
    """Return a balancing run: its log, with a gyro, and its motion capture of ball and body.

    InputError if a column is missing, the robot is hardly ever seen upright, or both are not of one run.
    """
    log.require(*GYRO_NAMES)
    poses = read_poses(film)
    seen = poses.seen & np.isfinite(poses.places).all(axis=1)
    if seen.sum() < 10:
        raise InputError(
            "The motion capture has no poses; it needs the columns "
            "x, y, z and the unit quaternion qw, qx, qy, qz."
        )
    # an unseen pose is filled with the one before, so that nothing moves
    last = np.maximum.accumulate(np.where(seen, np.arange(len(seen)), np.argmax(seen)))
    positions, rotations = poses.places[last], Rotation.from_quat(poses.rotations.as_quat()[last])
    axis = rotations.apply([0.0, 0.0, 1.0])
    up = np.median(axis[seen], axis=0)
    up /= np.linalg.norm(up)
    usable = seen & (axis @ up > np.cos(LARGEST_LEAN))
    upright = poses_turning(replace(poses, seen=usable).seen_only())
    motion, _ = match_turning(log_turning(log), upright, least_share=_LEAST_SHARE)
    turns = (rotations[:-1].inv() * rotations[1:]).as_rotvec()
    middle = (rotations[:-1] * Rotation.from_rotvec(0.5 * turns)).inv()
    rolls = np.cross(middle.apply(up), middle.apply(np.diff(positions, axis=0)))
    return MocapRun(log=log, rolling=Turning.of(film.t, rolls, usable[1:] & usable[:-1]), motion=motion)


#: share of a radius, and angle [rad], that slip, dents and rollers may mimic: on logs of a physics engine with two rows
#: of rollers and known geometry 0.42 % and 0.25 degrees were seen (the commands of docs/geometry.md)
SLIP = 0.006
SLIP_ANGLE = math.radians(0.4)
#: a deviation of fewer standard errors than this is noise
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
    """One quantity of the geometry, from logs and in the robot's file."""

    name: str  #: as in robot files where it stands there: "wheels.tilt", "wheels.azimuths[0]"
    value: float  #: SI units
    standard_error: float
    in_file: float  #: the file's value, or the value that follows from the file
    unit: str  #: "m", "rad", "s" or "1"
    #: of logs that it is from: "upside down", "balancing" or "both"
    kind: str = field(metadata=key("from"))

    @reported
    def deviation(self) -> float:
        """How many standard errors the file's value lies off."""
        return (self.in_file - self.value) / self.standard_error

    @property
    def slip(self) -> float:
        """Largest error that slip may cause, in the quantity's unit."""
        return SLIP_ANGLE if self.unit == "rad" else SLIP * abs(self.value)

    def stands_out(self, turn: float = 0.0) -> bool:
        """Return whether the file is off beyond noise and slip, but for a turn that several have in common."""
        off = abs(self.in_file - self.value + turn)
        return off > max(CLEAR * self.standard_error, self.slip)


def _azimuths(robot: Robot) -> list[Parameter]:
    return [
        Parameter.about(f"wheels.azimuths[{i}]", azimuth, "rad", within=0.5 * math.pi)
        for i, azimuth in enumerate(robot.wheels.azimuths)
    ]


#: clusters, at the least, for each parameter; fewer make a covariance too small
CLUSTERS_PER_PARAMETER = 2
#: of the normal equations, the parameters over their bounds' width
_LARGEST_CONDITION = 1e10


def _fitted(
    kind: str,
    parameters: Sequence[Parameter],
    residuals: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    clusters: NDArray[np.int64],
) -> tuple[list[GeometryQuantity], Fit[BlockErrors]]:
    """Return the fit from the file's values to residuals (w, n) of windows in clusters (w,), and its quantities."""
    start = np.array([one.default for one in parameters])
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
    found = fit(experiment, experiment.coordinates.scaled(start))
    condition = np.linalg.cond(found.finished.equations.matrix)
    if not found.estimated.all() or condition > _LARGEST_CONDITION:
        raise InputError(_UNDETERMINED[kind])
    numbers = zip(parameters, found.values.tolist(), found.errors.tolist(), strict=True)
    quantities = [
        GeometryQuantity(one.name, value, error, one.default, one.unit, kind) for one, value, error in numbers
    ]
    return quantities, found


#: length of a window [s]
ROLLING_WINDOW, UPSIDE_DOWN_WINDOW = 0.5, 0.25


def _of_rolling(
    robot: Robot, runs: Sequence[MocapRun], leaning: float
) -> tuple[list[GeometryQuantity], Fit[BlockErrors]]:
    """Find r_w / cos(tilt), the azimuths, the share of leaning seen and the delay of the encoders.

    The share is one of `leaning`, (r_b / r_w) cos(tilt), wheel angle for an angle of leaning.
    """
    n = robot.wheel_count
    totals = [(run.log, _rolling_totals(run, n)) for run in runs]
    (wheels, rolls, turns, speeds), clusters = _increments(totals, window=ROLLING_WINDOW)
    wheels = wheels - wheels.mean(axis=1, keepdims=True)

    def residuals(p: NDArray[np.float64]) -> NDArray[np.float64]:
        level = np.column_stack([-np.cos(p[1 : 1 + n]), -np.sin(p[1 : 1 + n])])
        rolled = (rolls - p[2 + n] * speeds) / p[0]
        seen = (rolled - p[1 + n] * leaning * turns) @ level.T
        return wheels - (seen - seen.mean(axis=1, keepdims=True))

    length = robot.wheels.radius / math.cos(robot.wheels.tilt)
    parameters = [
        Parameter.about("wheels.radius / cos(wheels.tilt)", length, "m", factor=2.0),
        *_azimuths(robot),
        Parameter.about("leaning seen", 1.0, "1", within=2.0),
        Parameter.about("delay of the encoders", 0.0, "s", within=0.5),
    ]
    return _fitted(BALANCING, parameters, residuals, clusters)


def _rolling_totals(run: MocapRun, wheel_count: int) -> tuple[NDArray[np.float64], ...]:
    """Return wheel angles, and level rolling, turning and rolling's rate, at a log's rows (N, .); NaN if unknown."""
    log, rolling, motion = run.log, run.rolling, run.motion
    angles = np.column_stack([log[name] for name in wheel_angle_names(wheel_count)])
    gyro = np.column_stack([log[name] for name in GYRO_NAMES])
    turning = motion.body_marker.inv().apply(Turning.of_rates(log.t, gyro - motion.bias).total)
    t = motion.clock.to_cameras(log.t)
    known = rolling.covers(t - 0.05, t + 0.05) & np.isfinite(gyro).all(axis=1)
    rolled = rolling.over(np.full(len(t), rolling.t[0]), t)[:, :2]
    rate = rolling.over(t - 0.02, t + 0.02)[:, :2] / 0.04  # [m/s] over 40 ms
    return angles, np.where(known[:, None], rolled, np.nan), turning[:, :2], rate


def _of_upside_down(
    robot: Robot, logs: Sequence[Log]
) -> tuple[list[GeometryQuantity], list[GeometryQuantity], Fit[BlockErrors]]:
    """Find r_b / r_w, tilt, azimuths, and the camera's tilt and delay; and r_b / r_w of each wheel by itself."""
    n = robot.wheel_count
    totals = []
    for log in logs:
        angles, omega = (
            np.column_stack([log[name] for name in names]) for names in (wheel_angle_names(n), BALL_NAMES)
        )
        totals.append((log, (angles, Turning.of_rates(log.t, omega).total, omega)))
    (wheels, turns, rates), clusters = _increments(totals, window=UPSIDE_DOWN_WINDOW)

    def residuals(p: NDArray[np.float64]) -> NDArray[np.float64]:
        frame = Rotation.from_rotvec([p[2 + n], p[3 + n], 0.0])
        return wheels - p[0] * frame.apply(turns - p[4 + n] * rates) @ axles(p[2 : 2 + n], p[1]).T

    parameters = [
        Parameter.about(
            "ball.radius / wheels.radius", robot.ball.radius / robot.wheels.radius, "1", factor=2.0
        ),
        Parameter.about("wheels.tilt", robot.wheels.tilt, "rad", within=0.5),
        *_azimuths(robot),
        Parameter.about("camera tilt about x", 0.0, "rad", within=1.0),
        Parameter.about("camera tilt about y", 0.0, "rad", within=1.0),
        Parameter.about("camera delay", 0.0, "s", within=0.5),
    ]
    quantities, found = _fitted(UPSIDE_DOWN, parameters, residuals, clusters)
    # nothing is assumed of a wheel's direction: |row| of the matrix G (n, 3) with wheels = turns G^T
    own = [fit_linear(turns - found.values[-1] * rates, angles, clusters) for angles in wheels.T]
    ratios = []
    for number, one in enumerate(own, start=1):
        size = float(np.linalg.norm(one.values))
        error = math.sqrt(one.values @ one.covariance @ one.values) / size
        name, common = f"ball.radius / wheels.radius, wheel {number}", float(found.values[0])
        ratios.append(GeometryQuantity(name, size, error, common, "1", UPSIDE_DOWN))
    return quantities, ratios, found


@dataclass(frozen=True, kw_only=True, eq=False)
class Geometry:
    """A robot's geometry as its logs determine it."""

    measured: tuple[GeometryQuantity, ...]
    #: r_b / r_w of each wheel by itself; empty without upside-down logs
    wheel_ratios: tuple[GeometryQuantity, ...] = ()
    #: delay of the camera that watched the ball upside down [s], and the share of the body's leaning that the encoders
    #: show; play hides the rest
    others: tuple[GeometryQuantity, ...] = ()

    def find(self, name: str) -> GeometryQuantity:
        """Return the first quantity of that name; InputError if the logs did not give it."""
        for one in (*self.measured, *self.others):
            if one.name == name:
                return one
        raise InputError(f"These logs do not determine {name}.")

    def azimuths(self, kind: str) -> list[GeometryQuantity]:
        """Return the wheels' azimuths from that kind of logs, none if there were no such logs."""
        return [one for one in self.measured if "azimuths" in one.name and one.kind == kind]

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds, SI units."""
        return to_results(self)


def common_turn(azimuths: Sequence[GeometryQuantity]) -> float:
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

    InputError if there is no log, a column is missing, or the motion does not determine the geometry.

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
    """
    if not upside_down and not balancing:
        raise InputError(
            "No log is given; geometry needs a log of the robot upside "
            "down, or of the robot balancing with motion capture."
        )
    stages = ["fitting the logs upside down"] if upside_down else []
    stages += (
        [*("aligning the motion capture" for _ in balancing), "fitting the balancing logs"]
        if balancing
        else []
    )
    steps = (Progress(stage=stage, done=k, total=len(stages)) for k, stage in enumerate(stages))
    leaning = robot.ball.radius / robot.wheels.radius * math.cos(robot.wheels.tilt)
    measured, ratios, runs = list[GeometryQuantity](), list[GeometryQuantity](), list[MocapRun]()
    on_wheels = None
    if upside_down:
        progress(next(steps))
        measured, ratios, on_wheels = _of_upside_down(robot, upside_down)
        leaning = float(on_wheels.values[0] * math.cos(on_wheels.values[1]))
    for log, film in balancing:
        progress(next(steps))
        runs.append(mocap_run(log, film))
    if runs:
        progress(next(steps))
        of_rolling, rolling = _of_rolling(robot, runs, leaning)
        measured += of_rolling[:-1]
        measured += _of_both(robot, on_wheels, rolling) if on_wheels else []
        measured += _of_mountings([run.motion for run in runs])
    others = [one for one in measured if one.name in _OTHERS]
    return Geometry(
        measured=tuple(one for one in measured if one not in others),
        wheel_ratios=tuple(ratios),
        others=tuple(others),
    )


#: what is no geometry
_OTHERS = ("camera delay", "leaning seen")


def _of_both(robot: Robot, on_wheels: Fit[BlockErrors], rolling: Fit[BlockErrors]) -> list[GeometryQuantity]:
    """Return each radius: r_w = length cos(tilt) and r_b = ratio r_w."""
    ratio, tilt, length = (*on_wheels.values[:2].tolist(), float(rolling.values[0]))
    c, s = math.cos(tilt), math.sin(tilt)
    covariance = block_diag(on_wheels.covariance[:2, :2], rolling.errors[0] ** 2)
    # by ratio, tilt and length
    J = np.array([[0.0, -length * s, c], [length * c, -ratio * length * s, ratio * c]])
    errors = np.sqrt(np.diag(J @ covariance @ J.T)).tolist()
    return [
        GeometryQuantity("wheels.radius", length * c, errors[0], robot.wheels.radius, "m", BOTH),
        GeometryQuantity("ball.radius", ratio * length * c, errors[1], robot.ball.radius, "m", BOTH),
    ]


def _of_mountings(motions: Sequence[MotionFit]) -> list[GeometryQuantity]:
    """Return the IMU's rotation against the body as the cameras have it, a mean weighted by the runs' variances."""
    values = np.array([one.body_marker.as_rotvec() for one in motions])
    weights = 1.0 / np.array([one.rotation_errors for one in motions]) ** 2
    mean, errors = (weights * values).sum(axis=0) / weights.sum(axis=0), 1.0 / np.sqrt(weights.sum(axis=0))
    return [
        GeometryQuantity(f"IMU rotation about {axis}", value, error, 0.0, "rad", BALANCING)
        for axis, value, error in zip("xyz", mean.tolist(), errors.tolist(), strict=True)
    ]


def robot_with_geometry(robot: Robot, geometry: Geometry) -> Robot:
    """Return the robot with the radii, tilt and azimuths found, where the logs gave them.

    Azimuths are upside down's where there are both, less the turn that all have in common, which is a camera's heading.
    A standard deviation is that of noise and of slip together.

    InputError if that is no robot, as when another radius does not go with the ball's inertia.
    """
    found = {one.name: [one] for one in reversed(geometry.measured)}  # the first of a name counts
    found["wheels.azimuths"] = geometry.azimuths(UPSIDE_DOWN) or geometry.azimuths(BALANCING)
    values, sources, deviations = dict[str, Value](), dict(robot.sources), dict(robot.standard_deviations)
    for name in ("ball.radius", "wheels.radius", "wheels.tilt", "wheels.azimuths"):
        if name in found:
            as_in_file = float if name.endswith("radius") else _in_degrees
            several = name == "wheels.azimuths"
            turn = common_turn(found[name]) if several else 0.0
            numbers = tuple(as_in_file(one.value - turn) for one in found[name])
            sizes = tuple(as_in_file(math.hypot(one.standard_error, one.slip)) for one in found[name])
            values[name], deviations[name] = (numbers, sizes) if several else (numbers[0], sizes[0])
            sources[name] = f"identified: geometry from logs ({found[name][0].kind})"
    return robot.replace(values).annotated(sources=sources, standard_deviations=deviations)


def _in_degrees(angle: float) -> float:
    """Return an angle [rad] that a file writes in degrees with nine decimals."""
    return math.radians(round(math.degrees(angle), 9))


_AGREES = (
    "The file agrees with the logs: no value differs by more than "
    "three standard errors and by more than slip and rollers can cause."
)
_NO_BALANCING = (
    "Each radius by itself and the mounting of the IMU need a balancing run with motion capture as well."
)
_NO_UPSIDE_DOWN = (
    "The tilt and both radii by themselves need a log of the robot upside down as well: while it "
    "balances, the body leans too little compared with play and rollers, and the ball may pivot."
)


def geometry_findings(geometry: Geometry) -> list[Finding]:
    """Return the findings about a geometry, the most severe first."""
    found, turns = list[str](), dict[str, float]()
    for kind in (UPSIDE_DOWN, BALANCING):
        azimuths = geometry.azimuths(kind)
        turn = common_turn(azimuths) if azimuths else 0.0
        if azimuths and abs(turn) > max(*(CLEAR * one.standard_error for one in azimuths), SLIP_ANGLE):
            turns[kind] = turn
            found.append(
                f"All azimuths are turned by {math.degrees(turn):+.2f} deg in the logs ({kind}): the "
                "cameras' forward direction differs from the robot file's, or all wheels are mounted turned."
            )
    kinds = {one.kind for one in geometry.measured}
    named = dict[str, str]()
    for one in geometry.measured:
        turn = turns.get(one.kind, 0.0) if "azimuths" in one.name else 0.0
        # with both radii known, their ratio adds nothing
        if one.stands_out(turn) and not (BOTH in kinds and "/" in one.name):
            named.setdefault(one.name, _sentence(one))
    found += named.values()
    for number, one in enumerate(geometry.wheel_ratios, start=1):
        if one.stands_out():
            more = 100.0 * (one.value / one.in_file - 1.0)
            found.append(
                f"Wheel {number} turns {more:+.1f} % faster than the mean of the wheels "
                "for the same motion of the ball: its radius differs, or it slips."
            )
    missing = [] if BALANCING in kinds else [_NO_BALANCING]
    missing += [] if UPSIDE_DOWN in kinds else [_NO_UPSIDE_DOWN]
    return [note("geometry", text) for text in (*(found or [_AGREES]), *missing)]


#: what to do if a quantity differs from the file, by the beginning of its name
_ADVICE = {
    "IMU": "mount it straight, or correct its readings.",
    "camera": "the camera that watched the ball is tilted, which was corrected.",
    "ball.radius /": "a balancing run with motion capture would show which of the two radii is wrong.",
    "wheels.radius /": "a log of the robot upside down would show whether the radius or the tilt is wrong.",
    "": "measure it again, or use the value from the logs.",
}


def _sentence(one: GeometryQuantity) -> str:
    if one.unit == "rad":
        value, in_file = (f"{math.degrees(number):.2f} deg" for number in (one.value, one.in_file))
        share = ""
    else:
        decimals = max(0, 1 - math.floor(math.log10(one.standard_error)))
        unit = "" if one.unit == "1" else f" {one.unit}"
        value, in_file = (f"{number:.{decimals}f}{unit}" for number in (one.value, one.in_file))
        share = f"{100.0 * (one.in_file / one.value - 1.0):+.1f} % or "
    advice = next(text for name, text in _ADVICE.items() if one.name.startswith(name))
    return (
        f"{one.name} is {value} by the logs and {in_file} in the file, a difference of {share}"
        f"{abs(one.deviation):.0f} standard errors; {advice}"
    )
