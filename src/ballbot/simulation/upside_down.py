"""The ball on the wheels of a robot that is clamped upside down (thesis 3.6): no floor, no leaning.

    (J_ball + (j_w + j_r) A^T A) Omega_dot = A^T (u - tau(A Omega))

Omega is the ball's angular velocity in the robot's frame, and wheel i turns at row i of A times Omega. The ball is
free to turn about every axis. Its inertia is the same about all of them and the wheels' axles stand still, so that
both gyroscopic terms, Omega x J_ball Omega and that of the wheels, are zero and the mass matrix is constant:
without friction the plant is linear.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from ballbot.arrays import positive_number, real_array, whole_number
from ballbot.errors import InputError
from ballbot.mechanics.engine import over_threads
from ballbot.mechanics.geometry import transforms
from ballbot.mechanics.lanes import LANES
from ballbot.robot.derived import reflected_rotor_inertia
from ballbot.robot.robot import Friction, Robot
from ballbot.simulation.upside_down_step import run_ball


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearBall:
    """x_dot = A x + B u, x = [rotation about x, y, z of the robot's frame, and Omega]."""

    A: NDArray[np.float64]  #: (6, 6)
    B: NDArray[np.float64]  #: (6, n)


@dataclass(frozen=True, kw_only=True, eq=False)
class ClampedBall:
    """A ball on n clamped wheels."""

    A: NDArray[np.float64]  #: (n, 3), wheel speeds from the ball's angular velocity (II.13)
    inertia: NDArray[np.float64]  #: J_ball + (j_w + j_r) A^T A (3, 3) [kg m^2]

    def __post_init__(self) -> None:
        object.__setattr__(self, "A", real_array(self.A, ("wheels", 3), "A of a clamped ball"))
        object.__setattr__(self, "inertia", real_array(self.inertia, (3, 3), "inertia of a clamped ball"))

    @staticmethod
    def of_robot(robot: Robot) -> ClampedBall:
        """Return the plant that a robot becomes when it is clamped upside down; its friction is no part of it."""
        drive = robot.drive
        rotor = reflected_rotor_inertia(
            gear_ratio=drive.gear_ratio, motor_inertia=drive.motor_inertia, gear_inertia=drive.gear_inertia
        )
        A = np.ascontiguousarray(transforms(robot).T_owb)
        return ClampedBall(
            A=A, inertia=robot.ball.inertia * np.eye(3) + (robot.wheels.inertia + rotor) * A.T @ A
        )

    def push(self) -> NDArray[np.float64]:
        """Return M^-1 A^T (3, n): the ball's angular acceleration from wheel torques."""
        return np.ascontiguousarray(np.linalg.solve(self.inertia, self.A.T), dtype=np.float64)

    def linearize(self) -> LinearBall:
        """Return the plant without friction, exact for turning about one axis and for small angles about several."""
        n = len(self.A)
        A = np.block([[np.zeros((3, 3)), np.eye(3)], [np.zeros((3, 6))]])
        return LinearBall(A=A, B=np.vstack([np.zeros((3, n)), self.push()]))


def friction_row(friction: Friction) -> NDArray[np.float64]:
    """Return [b.., c.., s.., v_s, delta] (3 n + 2,), the numbers of a friction that this plant feels."""
    shared = (friction.stribeck_speed, friction.stribeck_exponent)
    return np.array([*friction.viscous, *friction.coulomb, *friction.stribeck, *shared])


def simulate_balls(
    ball: ClampedBall,
    *,
    friction: ArrayLike,
    initial: ArrayLike,
    torques: ArrayLike,
    sample_time: float,
    step: float = 1e-3,
    every: int = 1,
    threads: int | None = None,
) -> NDArray[np.float64]:
    """Turn the ball by torques held over each sample: every friction through every window.

    Parameters
    ----------
    ball : ClampedBall
    friction : array_like (sets, 3 n + 2)
        As `friction_row` gives them.
    initial : array_like (windows, 3)
        Omega at the start of each window [rad/s], in the robot's frame.
    torques : array_like (windows, samples, n)
        [N m].
    sample_time : float
        [s]
    step : float
        Longest inner step [s]. The method is RK4 while no wheel's speed changes sign and of first order where one
        does.
    every : int
        Record every so many samples.
    threads : int, optional
        All cores by default. The result does not depend on it.

    Returns
    -------
    ndarray (sets, windows, samples // every, 3)
        Omega after each recorded sample [rad/s].

    Raises
    ------
    InputError
        Where shapes disagree, a number is not finite, v_s or delta is not above zero, or a time is none.
    """
    n = len(ball.A)
    sets = real_array(friction, ("sets", 3 * n + 2), "The array of frictions")
    starts = real_array(initial, ("windows", 3), "The array of starts")
    inputs = real_array(torques, (len(starts), "samples", n), "The array of torques")
    if sets.min() < 0.0 or sets[:, -2:].min() <= 0.0:
        raise InputError(
            "A friction value is out of range; none may be negative, and v_s and delta must be above zero."
        )
    sample_time, step = positive_number(sample_time, "The sample time"), positive_number(step, "The step")
    every = whole_number(every, "every", least=1)
    steps = max(1, int(np.ceil(sample_time / step - 1e-9)))
    out = np.empty((len(sets), len(starts), inputs.shape[1] // every, 3))
    push, count = ball.push(), len(starts)

    def run(first: int) -> None:
        for lane in range(first, min(first + LANES, len(sets) * count)):
            chosen, window = divmod(lane, count)
            omega = starts[window].copy()
            arrays = (ball.A, ball.inertia, push, sets[chosen], omega, inputs[window])
            run_ball(*arrays, sample_time, steps, every, out[chosen, window])

    over_threads(run, len(sets) * count, threads)
    return out


@dataclass(frozen=True, kw_only=True, eq=False)
class BallRun:
    """A ball under control."""

    t: NDArray[np.float64]  #: (N,) [s]
    rotations: NDArray[
        np.float64
    ]  #: (N, 3), rotation vector from where the ball started [rad], robot's frame
    omegas: NDArray[np.float64]  #: (N, 3) [rad/s]
    torques: NDArray[np.float64]  #: (N, n) [N m]


def follow(
    ball: ClampedBall,
    *,
    friction: Friction,
    gain: ArrayLike,
    reference: Callable[[float], NDArray[np.float64]],
    duration: float,
    sample_time: float,
) -> BallRun:
    """Let the ball follow a reference under u = K [rotation that is missing; -Omega] (thesis, Figure 3.4).

    Parameters
    ----------
    ball : ClampedBall
    friction : Friction
        Of the wheels; rolling friction has no part here.
    gain : array_like (n, 6)
        K, by `ballbot.control.lqr` of `ball.linearize()`.
    reference : function of time
        f(t) -> rotation vector (3,) [rad] where the ball should be.
    duration, sample_time : float
        [s]

    Raises
    ------
    InputError
        If the gain or the reference has another shape or a value that is not finite, or a time is not above zero.
    """
    K = real_array(gain, (len(ball.A), 6), "The gain")
    duration = positive_number(duration, "The duration")
    sample_time = positive_number(sample_time, "The sample time")
    row, omega, turned = friction_row(friction)[None], np.zeros(3), Rotation.identity()
    t = sample_time * np.arange(max(1, round(duration / sample_time)), dtype=np.float64)
    rotations, omegas, torques = [], [], []
    for time in t:
        wanted = real_array(reference(float(time)), (3,), f"The reference at t = {time:g} s")
        missing = (Rotation.from_rotvec(wanted) * turned.inv()).as_rotvec()
        torque = K @ np.concatenate([missing, -omega])
        rotations.append(turned.as_rotvec())
        omegas.append(omega)
        torques.append(torque)
        after = simulate_balls(
            ball,
            friction=row,
            initial=omega[None],
            torques=torque[None, None],
            sample_time=sample_time,
            threads=1,
        )[0, 0, 0]
        turned = Rotation.from_rotvec(0.5 * sample_time * (omega + after)) * turned
        omega = after
    return BallRun(t=t, rotations=np.array(rotations), omegas=np.array(omegas), torques=np.array(torques))
