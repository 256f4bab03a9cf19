"""The wheels' rolling radius and azimuths from a balancing robot that cameras watched.

    wheel angle_i = a_i . ( rolling / r_w - share (r_b / r_w) turning ) + pivoting

What the ball's pivoting on the floor adds is the same for every wheel, sin(alpha) r_b / r_w times an unknown, and so is
what the body's heading adds; both are taken out of the windows. Left is r_w / cos(alpha), the radius of a wheel that
would turn as fast if it stood upright on the ball's equator, and the azimuths. Turning is from the gyro: the lean is a
degree or two, play and rollers are half as much, so that its `share` that the encoders show is found, not trusted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.identification.geometry.increments import cut, wheel_angles
from ballbot.identification.geometry.least_squares import Fit, fit_clustered
from ballbot.identification.geometry.motion_capture import Film
from ballbot.identification.geometry.mounting import GYRO_NAMES, Mounting
from ballbot.log import Log
from ballbot.robot import Robot

#: length of a window [s]
WINDOW = 0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """A balancing run: its log, what the cameras saw and how the two go together."""

    log: Log
    film: Film
    mounting: Mounting


def rolling_geometry(robot: Robot, runs: Sequence[Run], *, leaning: float) -> Fit:
    """Find [r_w / cos(tilt) [m], azimuths.. [rad], share of leaning seen, delay of the encoders [s]] (n + 3,).

    Parameters
    ----------
    robot : Robot
        Where the search begins.
    runs : sequence of Run
    leaning : float
        (r_b / r_w) cos(tilt), wheel angle for an angle of leaning, which the share is one of.

    Raises
    ------
    InputError
        Where a column is missing or the motion does not determine the geometry.
    """
    n = robot.wheel_count
    parts = [_increments(run, n) for run in runs]
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
    return fit_clustered(residuals, start, scales=scales, clusters=clusters)


def _increments(
    run: Run, wheel_count: int
) -> tuple[
    NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]
]:
    """Return increments (w, .) of wheel angles, rolling, turning and rolling's rate, all level parts; clusters (w,)."""
    log, film, mounting = run.log, run.film, run.mounting
    angles = wheel_angles(log, wheel_count)
    gyro = np.column_stack([log[name] for name in GYRO_NAMES])
    cuts = cut(log, np.hstack([angles, gyro]), window=WINDOW)
    start, end = mounting.camera_time(log.t[cuts.first]), mounting.camera_time(log.t[cuts.last])
    whole = film.covers(start - 0.05, end + 0.05)
    cuts, start, end = cuts.chosen(whole), start[whole], end[whole]
    rolls = film.rolling_at(end) - film.rolling_at(start)
    turns = cuts.of(mounting.body_turning(log))
    return cuts.of(angles), rolls[:, :2], turns[:, :2], _rate(film, end) - _rate(film, start), cuts.clusters


def _rate(film: Film, t: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rolling's rate (k, 2) [m/s] at times of the cameras, over 40 ms."""
    return (film.rolling_at(t + 0.02) - film.rolling_at(t - 0.02))[:, :2] / 0.04
