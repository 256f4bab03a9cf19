"""Ratio of the radii, tilt and azimuths from the robot clamped upside down, the ball on its wheels.

    wheel angle_i = (r_b / r_w) a_i . R integral of Omega dt
    a_i = (-cos alpha cos beta_i, -cos alpha sin beta_i, sin alpha)

Omega is the ball's angular velocity as a camera sees it; R, the small tilt of the camera's frame about x and y, and the
camera's delay are found as well. A turn of its frame about z is the same as one of all azimuths, and is counted there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ballbot.identification.geometry.increments import cut, integral, wheel_angles
from ballbot.identification.geometry.least_squares import Fit, fit_clustered
from ballbot.identification.upside_down.windows import BALL_NAMES
from ballbot.log import Log
from ballbot.robot import Robot

#: length of a window [s]
WINDOW = 0.25


@dataclass(frozen=True, kw_only=True, eq=False)
class UpsideDownGeometry:
    """What the ball upon the wheels tells of n wheels; angles in rad."""

    #: [r_b / r_w, tilt, azimuths.., camera's tilt about x and y, camera's delay [s]] (n + 5,)
    fit: Fit
    ratios: NDArray[
        np.float64
    ]  #: (n,), r_b / r_w of each wheel by itself, where nothing is assumed of its direction
    ratio_errors: NDArray[np.float64]  #: (n,)


def upside_down_geometry(robot: Robot, logs: Sequence[Log]) -> UpsideDownGeometry:
    """Find the wheels' geometry from logs of wheel angles and ball_omega_x, _y, _z.

    Raises
    ------
    InputError
        Where a column is missing or the motion does not determine the geometry.
    """
    n = robot.wheel_count
    parts = [_increments(log, n) for log in logs]
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
    fit = fit_clustered(residuals, start, scales=scales, clusters=clusters)
    ratios, errors = _each_wheel(wheels, turns - fit.values[-1] * rates, clusters)
    return UpsideDownGeometry(fit=fit, ratios=ratios, ratio_errors=errors)


def axle_directions(tilt: float, azimuths: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a_i (n, 3) as `ballbot.mechanics.geometry.axles` does, from angles that no robot need have."""
    lean = np.cos(tilt)
    return np.column_stack(
        [-lean * np.cos(azimuths), -lean * np.sin(azimuths), np.full(len(azimuths), np.sin(tilt))]
    )


def _increments(
    log: Log, wheel_count: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """Return increments (w, .) of wheel angles, of the ball's turning and of its rate, and clusters (w,)."""
    angles = wheel_angles(log, wheel_count)
    omega = np.column_stack([log[name] for name in BALL_NAMES])
    cuts = cut(log, np.hstack([angles, omega]), window=WINDOW)
    return cuts.of(angles), cuts.of(integral(log.t, omega)), cuts.of(omega), cuts.clusters


def _each_wheel(
    wheels: NDArray[np.float64], turns: NDArray[np.float64], clusters: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return |row| of the matrix G (n, 3) with wheels = turns G^T, and its standard error, for each wheel."""
    G = np.linalg.lstsq(turns, wheels, rcond=None)[0].T
    ratios, errors = np.linalg.norm(G, axis=1), []
    for i, row in enumerate(G):
        fit = fit_clustered(
            lambda p, i=i: (wheels[:, i] - turns @ p)[:, None], row, scales=np.full(3, 0.1), clusters=clusters
        )
        direction = row / ratios[i]
        errors.append(float(np.sqrt(direction @ fit.covariance @ direction)))
    return ratios, np.array(errors)
