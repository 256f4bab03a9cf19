"""What a path asks of a robot that follows it exactly, by the exact equations of motion run backwards.

Given x(t), y(t), psi(t), the five equations M q_ddot + bias = W^T u + rolling friction are left with two leans and n
torques. Velocities Z (5, 2) that turn no wheel, W Z = 0 (the body turning with the ball), leave the torques out:

    Z^T (M q_ddot + bias - rolling) = 0        about upright:  j theta_ddot - m_r g l theta = forcing

an unstable equation of which one solution stays small, the robot leaning into a bend before it comes. It is found with
the robot at rest before and after the path, by solving the linear equation for what the exact one has left over, again
and again. Then W^T u = M q_ddot + bias - rolling gives the torques, to which each wheel's dry friction is added.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_banded
from scipy.ndimage import gaussian_filter1d

from ballbot.errors import InputError
from ballbot.mechanics.friction import dry_friction_size
from ballbot.mechanics.model import Model

#: corners of a path are rounded by a Gaussian of this deviation [s]: a robot cannot change its speed at once
ROUNDING = 0.05
#: rest before and after the path [s], in which the robot leans into it and out of it
_REST = 2.0
_STEPS = 40  # of the correction at most
_ACCURATE = 1e-8  # change of the lean [rad] at which it has been found
_SLOW = 0.01  # [m/s, rad/s] below which friction's sign becomes a ramp


@dataclass(frozen=True, kw_only=True, eq=False)
class Demand:
    """What the path asks, at each time."""

    t: NDArray[np.float64]  #: (N,) [s]
    states: NDArray[np.float64]  #: (N, 10)
    torques: NDArray[np.float64]  #: (N, n) [N m]
    wheel_speeds: NDArray[np.float64]  #: (N, n) [rad/s]

    @property
    def power(self) -> NDArray[np.float64]:
        """Mechanical power of all motors (N,) [W]."""
        return (self.torques * self.wheel_speeds).sum(axis=1)


def lean_of(states: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the axis's lean from the vertical (...) [rad] of states (..., 10)."""
    return np.arccos(np.clip(np.cos(states[..., 2]) * np.cos(states[..., 3]), -1.0, 1.0))


def path_demand(model: Model, poses: NDArray[np.float64], sample_time: float) -> Demand:
    """Return what following x, y [m] and psi [rad], (N, 3), asks of a robot, at rest before and after.

    Parameters
    ----------
    model : Model
        Exact.
    poses : ndarray (N, 3)
        At every sample; corners are rounded.
    sample_time : float
        [s]

    Raises
    ------
    InputError
        Where no lean can follow the path.
    """
    rest = int(np.ceil(_REST / sample_time))
    path = np.pad(poses, ((rest, rest), (0, 0)), mode="edge")
    path = gaussian_filter1d(path, ROUNDING / sample_time, axis=0, mode="nearest")
    q = np.zeros((len(path), 5))
    q[:, [0, 1, 4]] = path
    preconditioner = _lean_equation(model)
    for _ in range(_STEPS):
        left_over = _left_over(model, q, sample_time)
        change = -_solve_lean(preconditioner, left_over, sample_time)
        q[:, 2:4] += change
        if not np.abs(q[:, 2:4]).max() < 1.0:
            break
        if np.abs(change).max() < _ACCURATE:
            return _demand(model, q, sample_time, rest)
    raise InputError("No lean below 1 rad lets the robot follow this path; make it slower or rounder.")


def _rates(
    values: NDArray[np.float64], sample_time: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return first and second derivatives by central differences; zero at the ends, where all rests."""
    first, second = np.zeros_like(values), np.zeros_like(values)
    first[1:-1] = (values[2:] - values[:-2]) / (2.0 * sample_time)
    second[1:-1] = (values[2:] - 2.0 * values[1:-1] + values[:-2]) / sample_time**2
    return first, second


def _forces(
    model: Model, q: NDArray[np.float64], q_dot: NDArray[np.float64], q_ddot: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the generalised forces (N, 5) that are left for the wheels: M q_ddot + bias - rolling."""
    n = model.robot.wheel_count
    unforced = model.acceleration(q, q_dot, np.zeros((len(q), n)))
    forces = np.einsum("kij,kj->ki", model.mass_matrix(q), q_ddot - unforced)
    robot = model.robot
    rolling = (robot.ball.mass + robot.body.mass) * robot.gravity * robot.friction.rolling
    v = q_dot[:, :2]
    forces[:, :2] += rolling * v / np.maximum(np.hypot(v[:, 0], v[:, 1]), _SLOW)[:, None]
    return forces


def _unturning(W: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return Z (N, 5, 2): W Z = 0, with unit rates of theta and phi."""
    others = np.linalg.pinv(W[:, :, [0, 1, 4]])
    solved = -others @ W[:, :, 2:4]
    Z = np.zeros((len(W), 5, 2))
    Z[:, [0, 1, 4]] = solved
    Z[:, 2, 0] = Z[:, 3, 1] = 1.0
    return Z


def _left_over(model: Model, q: NDArray[np.float64], sample_time: float) -> NDArray[np.float64]:
    q_dot, q_ddot = _rates(q, sample_time)
    return np.einsum("kij,ki->kj", _unturning(model.wheel_jacobian(q)), _forces(model, q, q_dot, q_ddot))


def _lean_equation(model: Model) -> tuple[float, float]:
    """Return j [kg m^2] and m_r g l [N m] of the lean's linear equation, the mean of both leans."""
    origin = np.zeros((1, 5))
    Z = _unturning(model.wheel_jacobian(origin))[0]
    inertia = Z.T @ model.mass_matrix(origin)[0]
    body = model.robot.body
    return 0.5 * float(inertia[0, 2] + inertia[1, 3]), body.mass * model.robot.gravity * body.center_of_mass


def _solve_lean(
    equation: tuple[float, float], right: NDArray[np.float64], sample_time: float
) -> NDArray[np.float64]:
    """Return the leans (N, 2) of j lean_ddot - m_r g l lean = right that are zero at both ends."""
    inertia, tipping = equation
    bands = np.empty((3, len(right)))
    bands[0] = bands[2] = inertia / sample_time**2
    bands[1] = -2.0 * inertia / sample_time**2 - tipping
    bands[1, [0, -1]], bands[0, 1], bands[2, -2] = 1.0, 0.0, 0.0
    inner = right.copy()
    inner[[0, -1]] = 0.0
    return np.asarray(solve_banded((1, 1), bands, inner), dtype=np.float64)


def _demand(model: Model, q: NDArray[np.float64], sample_time: float, rest: int) -> Demand:
    q_dot, q_ddot = _rates(q, sample_time)
    W = model.wheel_jacobian(q)
    torques = np.einsum("kij,kj->ki", np.linalg.pinv(np.swapaxes(W, 1, 2)), _forces(model, q, q_dot, q_ddot))
    speeds = np.einsum("kij,kj->ki", W, q_dot)
    friction = model.robot.friction
    torques += dry_friction_size(speeds, friction, torque=torques) * np.clip(speeds / _SLOW, -1.0, 1.0)
    return Demand(
        t=sample_time * np.arange(-rest, len(q) - rest, dtype=np.float64),
        states=np.hstack([q, q_dot]),
        torques=torques,
        wheel_speeds=speeds,
    )
