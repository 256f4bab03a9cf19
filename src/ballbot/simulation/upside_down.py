"""The ball on the wheels of a robot that is clamped upside down (thesis 3.6): no floor, no leaning.

    (J_ball + (j_w + j_r) A^T A) Omega_dot = A^T (u - tau(A Omega, u)) - B Omega

Omega is the ball's angular velocity in the robot's frame, and wheel i turns at row i of A times Omega. The ball is
free to turn about every axis. Its inertia is the same about all of them and the wheels' axles stand still, so that
both gyroscopic terms, Omega x J_ball Omega and that of the wheels, are zero and the mass matrix is constant:
without friction the plant is linear. B is a loss where wheels touch the ball, zero by default.

A step is RK4 with the signs and B Omega of its start. Where a wheel's speed does not keep its sign, or rests, the step
is taken in `PARTS` short ones, and those in which it happens are the convex step of `ballbot.mechanics.stick_slip`, of
first order, in which the ball's place on the floor has no part.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.arrays import positive_number, real_array
from ballbot.errors import InputError
from ballbot.mechanics.contacts import free_torque
from ballbot.mechanics.engine.arrays import fill
from ballbot.mechanics.engine.compiled import compiled, inlined
from ballbot.mechanics.engine.lanes import LANES
from ballbot.mechanics.engine.run import over_threads
from ballbot.mechanics.engine.tracing import traced
from ballbot.mechanics.engine.vector import dot, from_array
from ballbot.mechanics.friction import (
    OwnWheel,
    Wheel,
    breakaway,
    directed_friction,
    dry_friction,
    sign,
    under_load,
)
from ballbot.mechanics.geometry import transforms
from ballbot.mechanics.parameters import wheels_of
from ballbot.mechanics.stick_slip import minimiser
from ballbot.robot import Friction, Robot

#: parts of a step in which a sign changes, so that the first order of the method there costs a quarter of the error
PARTS = 4


class BallNumbers(NamedTuple):
    """A ball on clamped wheels, in compiled code."""

    M: NDArray[np.float64]  #: (3, 3) [kg m^2]
    push: NDArray[np.float64]  #: M^-1 A^T (3, n)
    wheels: tuple[Wheel, ...] | tuple[OwnWheel, ...]
    drag: NDArray[np.float64]  #: (n, 3) [N m s/rad], the wheel torques that B Omega is


@inlined
def _accelerate(ball, u, omega, signs, rate):
    """Fill `rate` (3,) with M^-1 A^T (u - tau(A Omega)), the dry friction having these signs."""
    rate[0] = rate[1] = rate[2] = 0.0
    for i in range(len(u)):
        wheel = under_load(ball.wheels[i], u[i])
        speed = dot(wheel.axle, omega)
        torque = u[i] - wheel.b * speed
        if signs[i] != 0.0:
            torque -= signs[i] * directed_friction(wheel, speed, signs[i])
        for axis in range(3):
            rate[axis] += ball.push[axis, i] * torque


@inlined
def _slide(ball, u, omega, signs, h, end, rates, middle):
    """Fill `end` (3,) with the RK4 step from `omega`; return whether every wheel keeps its sign."""
    for axis in range(3):
        end[axis] = middle[axis] = omega[axis]
    for stage in range(4):
        _accelerate(ball, u, middle, signs, rates)
        weight = h / 6.0 if stage in (0, 3) else h / 3.0
        ahead = h if stage == 2 else 0.5 * h
        for axis in range(3):
            end[axis] += weight * rates[axis]
            middle[axis] = omega[axis] + ahead * rates[axis]
    for i in range(len(u)):
        wheel = under_load(ball.wheels[i], u[i])
        if breakaway(wheel) > 0.0 and not dot(ball.wheels[i].axle, end) * signs[i] > 0.0:
            return False
    return True


@inlined
def _convex(ball, u, omega, h, end):
    """Fill `end` (3,) with the minimiser of docs/mechanics.md, its first two unknowns, x and y, idle."""
    limits = np.zeros(len(u))
    fill(end, omega)
    for i in range(len(u)):
        wheel = under_load(ball.wheels[i], u[i])
        speed = dot(wheel.axle, omega)
        limits[i] = dry_friction(wheel, speed) if speed != 0.0 else breakaway(wheel)
        for axis in range(3):
            end[axis] += h * ball.push[axis, i] * free_torque(wheel, u[i], speed)
    M, free, C, most = _problem(ball.wheels, ball.M, end, limits)
    fill(end, minimiser(M, free, C, most, 0.0, h)[2:])


@traced
def _problem(wheels, M, free, limits):
    """Return the numbers of `minimiser`'s arrays, as tuples."""
    mass = [(1.0, 0.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0, 0.0)]
    mass += [(0.0, 0.0, M[3 * i], M[3 * i + 1], M[3 * i + 2]) for i in range(3)]
    rows = tuple((0.0, 0.0, *wheel.axle) for wheel in wheels)
    return tuple(mass), (0.0, 0.0, free[0], free[1], free[2]), rows, from_array(wheels, limits)


@inlined
def _in_parts(ball, u, omega, signs, h, end, rates, middle):
    """Advance `omega` (3,) by `PARTS` steps of h."""
    for _ in range(PARTS):
        for i in range(len(u)):
            signs[i] = sign(dot(ball.wheels[i].axle, omega))
        if not _slide(ball, u, omega, signs, h, end, rates, middle):
            _convex(ball, u, omega, h, end)
        fill(omega, end)


@compiled
def run_ball(ball, omega, torques, sample_time, steps, out):
    """Turn one ball on clamped wheels from omega (3,) [rad/s], which is changed, by torques (samples, n).

    `out` (samples, 3) takes Omega after each sample of so many inner steps.
    """
    n, h = len(ball.wheels), sample_time / steps
    u, signs, end, rates, middle = np.empty(n), np.empty(n), np.empty(3), np.empty(3), np.empty(3)
    for sample in range(len(torques)):
        for _ in range(steps):
            for i in range(n):
                signs[i] = sign(dot(ball.wheels[i].axle, omega))
                u[i] = torques[sample, i] - dot(ball.drag[i], omega)
            if _slide(ball, u, omega, signs, h, end, rates, middle):
                fill(omega, end)
            else:
                _in_parts(ball, u, omega, signs, h / PARTS, end, rates, middle)
        fill(out[sample], omega)


@dataclass(frozen=True, kw_only=True, eq=False)
class ClampedBall:
    """A ball on n clamped wheels."""

    A: NDArray[np.float64]  #: (n, 3), wheel speeds from the ball's angular velocity (II.13)
    inertia: NDArray[np.float64]  #: J_ball + (j_w + j_r) A^T A (3, 3) [kg m^2]
    loss: float = 0.0  #: B [N m s/rad]

    @staticmethod
    def of_robot(robot: Robot) -> ClampedBall:
        """Return the plant that a robot becomes when it is clamped upside down; its friction is no part of it."""
        wheel = robot.wheels.inertia + robot.drive.reflected_inertia
        A = np.ascontiguousarray(transforms(robot).T_owb)
        return ClampedBall(A=A, inertia=robot.ball.inertia * np.eye(3) + wheel * A.T @ A)

    def push(self) -> NDArray[np.float64]:
        """Return M^-1 A^T (3, n): the ball's angular acceleration from wheel torques."""
        return np.ascontiguousarray(np.linalg.solve(self.inertia, self.A.T), dtype=np.float64)


def simulate_balls(
    ball: ClampedBall,
    *,
    friction: Friction,
    initial: ArrayLike,
    torques: ArrayLike,
    sample_time: float,
    step: float = 1e-3,
) -> NDArray[np.float64]:
    """Return Omega (windows, samples, 3) [rad/s] after each sample of torques (windows, samples, n) [N m].

    Windows start at Omega `initial` (windows, 3) [rad/s], in the robot's frame. Rolling friction has no part here. An
    inner step lasts at most `step` [s]; the method is RK4 while no wheel's speed changes sign, and else of first order.

    InputError if shapes disagree, a number is not finite, or a time is not above zero.
    """
    n = len(ball.A)
    if len(friction.viscous) != n:
        raise InputError(f"The friction is that of {len(friction.viscous)} wheels; the ball has {n}.")
    starts = real_array(initial, ("windows", 3), "The array of starts")
    inputs = real_array(torques, (len(starts), "samples", n), "The array of torques")
    sample_time, step = positive_number(sample_time, "The sample time"), positive_number(step, "The step")
    steps = max(1, int(np.ceil(sample_time / step - 1e-9)))
    out = np.empty((len(starts), inputs.shape[1], 3))
    drag = np.ascontiguousarray(ball.loss * np.linalg.pinv(ball.A.T), dtype=np.float64)
    numbers = BallNumbers(ball.inertia, ball.push(), wheels_of(friction, ball.A), drag)

    def run(first: int) -> None:
        for window in range(first, min(first + LANES, len(starts))):
            omega = starts[window].copy()
            run_ball(numbers, omega, inputs[window], sample_time, steps, out[window])

    over_threads(run, len(starts), None)
    return out
