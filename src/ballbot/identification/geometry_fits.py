"""The fits behind the survey of a geometry: increments, motion capture, mounting, rolling and upside down.

Motion as increments over windows: encoder angles against integrals of rates and sums of small turns.

Increments need no derivative of an encoder, so that counts, sampling jitter and glitches of logged speeds do not
matter, and the noise of a rate averages out over the window.

The cameras measure a balancing robot. Their increments are taken in the body's own frame and so do not depend on the
cameras' frame.

    ball's rolling        sum of up x R_k^T (p_k+1 - p_k), in metres; divided by r_b it is the turning of a ball that
                          rolls without slip

`up` is the mean direction of the body's z axis while it is upright: an error of e in it changes the rolling by e^2/2.

The IMU's orientation on the body and the cameras' clock are those of `ballbot.identification.turning`.

The wheels' rolling radius and azimuths from a balancing robot that cameras watched.

    wheel angle_i = a_i . ( rolling / r_w - share (r_b / r_w) turning ) + pivoting

The ball's pivoting on the floor adds the same angle to every wheel, sin(alpha) r_b / r_w times an unknown. So does the
body's heading. Both are taken out of the windows. Left is r_w / cos(alpha), the radius of a wheel that
would turn as fast if it stood upright on the ball's equator, and the azimuths. Turning is from the gyro: the lean is a
degree or two, play and rollers are half as much, so that its `share` that the encoders show is found, not trusted.

Ratio of the radii, tilt and azimuths from the robot clamped upside down, the ball on its wheels.

    wheel angle_i = (r_b / r_w) a_i . R integral of Omega dt
    a_i = (-cos alpha cos beta_i, -cos alpha sin beta_i, sin alpha)

Omega is the ball's angular velocity as a camera sees it; R, the small tilt of the camera's frame about x and y, and the
camera's delay are found as well. A turn of its frame about z is the same as one of all azimuths, and is counted there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ballbot.errors import InputError
from ballbot.fitting.least_squares import ClusteredFit, fit_clustered
from ballbot.identification.turning import (
    GYRO_NAMES,
    MotionFit,
    Turning,
    log_turning,
    match_turning,
    poses_turning,
)
from ballbot.identification.upside_down import BALL_NAMES
from ballbot.log import Log
from ballbot.log.columns import wheel_angle_names
from ballbot.log.pose import read_poses
from ballbot.robot import Robot

_ROLLING_UNDETERMINED = (
    "The motion in these logs does not determine the wheels' radius and azimuths; move in both directions "
    "and turn all wheels."
)
_UPSIDE_DOWN_UNDETERMINED = (
    "The motion in these logs does not determine the ratio of the radii, the tilt and the azimuths; turn the "
    "ball about all three axes."
)

#: windows on end that count as one cluster together last this long [s]: a roller takes about as long to pass
CLUSTER = 2.0
#: a sampling interval longer than this many usual ones is a gap
LARGEST_GAP = 1.5
#: share of the turning that must be common to log and cameras, or they are not of the same run
_LEAST_SHARE = 0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class Cuts:
    """The first and last rows of a log's w windows, and their clusters."""

    first: NDArray[np.int64]  #: (w,)
    last: NDArray[np.int64]  #: (w,)
    clusters: NDArray[np.int64]  #: (w,)

    def __len__(self) -> int:
        return len(self.first)

    def of(self, total: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the increments (w, k) of a running total (N, k)."""
        return total[self.last] - total[self.first]

    def chosen(self, which: NDArray[np.bool_]) -> Cuts:
        """Return the windows that `which` (w,) marks."""
        return Cuts(first=self.first[which], last=self.last[which], clusters=self.clusters[which])


def cut(log: Log, columns: NDArray[np.float64], *, window: float) -> Cuts:
    """Return the windows, end to end, in which no row of `columns` (N, k) is missing and no row left out.

    Raises
    ------
    InputError
        If a window is less than two samples.
    """
    samples = round(window / log.sample_time)
    if samples < 2:
        raise InputError(
            f"The log's sample time of {log.sample_time:g} s is too long for windows of {window:g} s."
        )
    first = np.arange(0, len(log.t) - samples, samples)
    whole = np.asarray(np.isfinite(columns).all(axis=1))
    follows = whole[1:] & whole[:-1] & (np.diff(log.t) < LARGEST_GAP * log.sample_time)
    broken = np.concatenate([[0], np.cumsum(~follows)])
    usable = first[broken[first + samples] == broken[first]]
    clusters = np.floor((log.t[usable] - log.t[0]) / CLUSTER).astype(np.int64)
    return Cuts(first=usable, last=usable + samples, clusters=clusters)


def wheel_angles(log: Log, wheel_count: int) -> NDArray[np.float64]:
    """Return the encoders' angles (N, n) [rad].

    Raises
    ------
    InputError
        If one is not in the log.
    """
    return np.column_stack([log[name] for name in wheel_angle_names(wheel_count)])


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

    Raises
    ------
    InputError
        If a column is missing, the robot is hardly ever seen upright, or both are not of one run.
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


#: length of a window [s]
ROLLING_WINDOW = 0.5


def rolling_geometry(robot: Robot, runs: Sequence[MocapRun], *, leaning: float) -> ClusteredFit:
    """Find [r_w / cos(tilt) [m], azimuths.. [rad], share of leaning seen, delay of the encoders [s]] (n + 3,).

    Parameters
    ----------
    robot : Robot
        Its values start the search.
    runs : sequence of MocapRun
    leaning : float
        (r_b / r_w) cos(tilt), wheel angle for an angle of leaning, which the share is one of.

    Raises
    ------
    InputError
        If a column is missing or the motion does not determine the geometry.
    """
    n = robot.wheel_count
    parts = [_rolling_increments(run, n) for run in runs]
    wheels, rolls, turns, speeds = (np.concatenate([part[i] for part in parts]) for i in range(4))
    clusters = np.concatenate([part[4] + 1_000_000 * number for number, part in enumerate(parts)])
    wheels = wheels - wheels.mean(axis=1, keepdims=True)

    def residuals(p: NDArray[np.float64]) -> NDArray[np.float64]:
        level = np.column_stack([-np.cos(p[1 : 1 + n]), -np.sin(p[1 : 1 + n])])
        rolled = (rolls - p[2 + n] * speeds) / p[0]
        seen = (rolled - p[1 + n] * leaning * turns) @ level.T
        return wheels - (seen - seen.mean(axis=1, keepdims=True))

    start = np.array([robot.wheels.radius / np.cos(robot.wheels.tilt), *robot.wheels.azimuths, 1.0, 0.0])
    scales = np.array([0.1 * start[0], *n * [0.1], 0.1, 0.01])
    return fit_clustered(
        residuals, start, scales=scales, clusters=clusters, undetermined=_ROLLING_UNDETERMINED
    )


def _rolling_increments(
    run: MocapRun, wheel_count: int
) -> tuple[
    NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]
]:
    """Return increments (w, .) of wheel angles, rolling, turning and rolling's rate, all level parts; clusters (w,)."""
    log, rolling, motion = run.log, run.rolling, run.motion
    angles = wheel_angles(log, wheel_count)
    gyro = np.column_stack([log[name] for name in GYRO_NAMES])
    cuts = cut(log, np.hstack([angles, gyro]), window=ROLLING_WINDOW)
    start, end = (motion.clock.to_cameras(log.t[rows]) for rows in (cuts.first, cuts.last))
    whole = rolling.covers(start - 0.05, end + 0.05)
    cuts, start, end = cuts.chosen(whole), start[whole], end[whole]
    turning = motion.body_marker.inv().apply(Turning.of_rates(log.t, gyro - motion.bias).total)
    # the rolling's rate [m/s] over 40 ms
    before, after = (rolling.over(at - 0.02, at + 0.02)[:, :2] / 0.04 for at in (start, end))
    rolls = rolling.over(start, end)
    return cuts.of(angles), rolls[:, :2], cuts.of(turning)[:, :2], after - before, cuts.clusters


#: length of a window [s]
UPSIDE_DOWN_WINDOW = 0.25


@dataclass(frozen=True, kw_only=True, eq=False)
class UpsideDownGeometry:
    """Geometry of n wheels from the ball upon them; angles in rad."""

    #: [r_b / r_w, tilt, azimuths.., camera's tilt about x and y, camera's delay [s]] (n + 5,)
    fit: ClusteredFit
    #: (n,), r_b / r_w of each wheel by itself, where nothing is assumed of its direction
    ratios: NDArray[np.float64]
    ratio_errors: NDArray[np.float64]  #: (n,)


def upside_down_geometry(robot: Robot, logs: Sequence[Log]) -> UpsideDownGeometry:
    """Find the wheels' geometry from logs of wheel angles and ball_omega_x, _y, _z.

    Raises
    ------
    InputError
        If a column is missing or the motion does not determine the geometry.
    """
    n = robot.wheel_count
    parts = [_upside_down_increments(log, n) for log in logs]
    wheels = np.concatenate([part[0] for part in parts])
    turns, rates = (np.concatenate([part[i] for part in parts]) for i in (1, 2))
    clusters = np.concatenate([part[3] + 1_000_000 * number for number, part in enumerate(parts)])

    def residuals(p: NDArray[np.float64]) -> NDArray[np.float64]:
        frame = Rotation.from_rotvec([p[2 + n], p[3 + n], 0.0])
        return wheels - p[0] * frame.apply(turns - p[4 + n] * rates) @ axle_directions(p[1], p[2 : 2 + n]).T

    start = np.array(
        [robot.ball.radius / robot.wheels.radius, robot.wheels.tilt, *robot.wheels.azimuths, 0.0, 0.0, 0.0]
    )
    scales = np.array([0.1, *(n + 3) * [0.1], 0.01])
    fit = fit_clustered(
        residuals, start, scales=scales, clusters=clusters, undetermined=_UPSIDE_DOWN_UNDETERMINED
    )
    ratios, errors = _each_wheel(wheels, turns - fit.values[-1] * rates, clusters)
    return UpsideDownGeometry(fit=fit, ratios=ratios, ratio_errors=errors)


def axle_directions(tilt: float, azimuths: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a_i (n, 3) as `ballbot.mechanics.geometry.axles` does, from angles that no robot need have."""
    lean = np.cos(tilt)
    return np.column_stack(
        [-lean * np.cos(azimuths), -lean * np.sin(azimuths), np.full(len(azimuths), np.sin(tilt))]
    )


def _upside_down_increments(
    log: Log, wheel_count: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """Return increments (w, .) of wheel angles, of the ball's turning and of its rate, and clusters (w,)."""
    angles = wheel_angles(log, wheel_count)
    omega = np.column_stack([log[name] for name in BALL_NAMES])
    cuts = cut(log, np.hstack([angles, omega]), window=UPSIDE_DOWN_WINDOW)
    return cuts.of(angles), cuts.of(Turning.of_rates(log.t, omega).total), cuts.of(omega), cuts.clusters


def _each_wheel(
    wheels: NDArray[np.float64], turns: NDArray[np.float64], clusters: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return |row| of the matrix G (n, 3) with wheels = turns G^T, and its standard error, for each wheel."""
    G = np.linalg.lstsq(turns, wheels, rcond=None)[0].T
    ratios, errors = np.linalg.norm(G, axis=1), []
    for i, row in enumerate(G):
        fit = fit_clustered(
            lambda p, i=i: (wheels[:, i] - turns @ p)[:, None],
            row,
            scales=np.full(3, 0.1),
            clusters=clusters,
            undetermined=_UPSIDE_DOWN_UNDETERMINED,
        )
        direction = row / ratios[i]
        errors.append(float(np.sqrt(direction @ fit.covariance @ direction)))
    return ratios, np.array(errors)
