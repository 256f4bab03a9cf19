"""The compiled steps of `ballbot.simulation.upside_down`: one lane through all its samples.

A step is RK4 with the signs of its start. Where a wheel's speed does not keep its sign, or rests, the step is taken in
`PARTS` short ones, and those in which it happens are the convex step of `ballbot.mechanics.stick_slip`, of first
order, in which the ball's place on the floor has no part.
"""

import numpy as np

from ballbot.mechanics.compiled import compiled, inlined
from ballbot.mechanics.elementary import exponential, logarithm
from ballbot.mechanics.friction import sign
from ballbot.mechanics.stick_slip import minimiser

#: parts of a step in which a sign changes, so that the first order of the method there costs a quarter of the error
PARTS = 4


@inlined
def _dry(friction, wheel, speed):
    """Return c + s exp(-|w/v_s|^delta) of a wheel; `friction` is [b.., c.., s.., v_s, delta]."""
    n = (len(friction) - 2) // 3
    ratio = logarithm(abs(speed) / friction[3 * n])
    return friction[n + wheel] + friction[2 * n + wheel] * exponential(
        -exponential(friction[3 * n + 1] * ratio)
    )


@inlined
def _accelerate(A, push, friction, u, omega, signs, rate):
    """Fill `rate` (3,) with M^-1 A^T (u - tau(A Omega)), the dry friction having these signs."""
    rate[0] = rate[1] = rate[2] = 0.0
    for i in range(len(u)):
        speed = A[i, 0] * omega[0] + A[i, 1] * omega[1] + A[i, 2] * omega[2]
        torque = u[i] - friction[i] * speed
        if signs[i] != 0.0:
            torque -= signs[i] * _dry(friction, i, speed)
        for axis in range(3):
            rate[axis] += push[axis, i] * torque


@inlined
def _slide(A, push, friction, u, omega, signs, h, end, rates, middle):
    """Fill `end` (3,) with the RK4 step from `omega`; return whether every wheel keeps its sign."""
    for axis in range(3):
        end[axis] = middle[axis] = omega[axis]
    for stage in range(4):
        _accelerate(A, push, friction, u, middle, signs, rates)
        weight = h / 6.0 if stage in (0, 3) else h / 3.0
        ahead = h if stage == 2 else 0.5 * h
        for axis in range(3):
            end[axis] += weight * rates[axis]
            middle[axis] = omega[axis] + ahead * rates[axis]
    for i in range(len(u)):
        speed = A[i, 0] * end[0] + A[i, 1] * end[1] + A[i, 2] * end[2]
        slides = friction[len(u) + i] + friction[2 * len(u) + i] > 0.0
        if slides and not speed * signs[i] > 0.0:
            return False
    return True


@inlined
def _convex(A, M, push, friction, u, omega, h, end):
    """Fill `end` (3,) with the minimiser of design section 5, its first two unknowns, x and y, idle."""
    n = len(u)
    mass, rows = np.zeros((5, 5)), np.zeros((n, 5))
    start, free, limits = np.zeros(5), np.zeros(5), np.zeros(n)
    mass[0, 0] = mass[1, 1] = 1.0
    mass[2:, 2:] = M
    rows[:, 2:] = A
    start[2:] = omega
    free[2:] = omega
    for i in range(n):
        speed = A[i, 0] * omega[0] + A[i, 1] * omega[1] + A[i, 2] * omega[2]
        limits[i] = _dry(friction, i, speed) if speed != 0.0 else friction[n + i] + friction[2 * n + i]
        for axis in range(3):
            free[2 + axis] += h * push[axis, i] * (u[i] - friction[i] * speed)
    end[:] = minimiser(mass, free, rows, limits, 0.0, h, start)[2:]


@compiled
def _in_parts(A, M, push, friction, u, omega, signs, h, end, rates, middle):
    """Advance `omega` (3,) by `PARTS` steps of h."""
    for _ in range(PARTS):
        for i in range(len(u)):
            signs[i] = sign(A[i, 0] * omega[0] + A[i, 1] * omega[1] + A[i, 2] * omega[2])
        if not _slide(A, push, friction, u, omega, signs, h, end, rates, middle):
            _convex(A, M, push, friction, u, omega, h, end)
        omega[:] = end


@compiled
def run_ball(A, M, push, friction, omega, torques, sample_time, steps, every, out):
    """Turn one ball on clamped wheels.

    Parameters
    ----------
    A : ndarray (n, 3)
    M : ndarray (3, 3)
        [kg m^2]
    push : ndarray (3, n)
        M^-1 A^T.
    friction : ndarray (3 n + 2,)
        b, c, s of each wheel, v_s and delta.
    omega : ndarray (3,)
        At the start [rad/s]; it is changed.
    torques : ndarray (samples, n)
        Each held over a sample.
    sample_time : float
    steps : int
        Inner steps a sample.
    every : int
        Record every so many samples.
    out : ndarray (samples // every, 3)
    """
    n, h = len(A), sample_time / steps
    signs, end, rates, middle = np.empty(n), np.empty(3), np.empty(3), np.empty(3)
    for sample in range(len(torques)):
        for _ in range(steps):
            for i in range(n):
                signs[i] = sign(A[i, 0] * omega[0] + A[i, 1] * omega[1] + A[i, 2] * omega[2])
            if _slide(A, push, friction, torques[sample], omega, signs, h, end, rates, middle):
                omega[:] = end
            else:
                _in_parts(A, M, push, friction, torques[sample], omega, signs, h / PARTS, end, rates, middle)
        if (sample + 1) % every == 0:
            out[(sample + 1) // every - 1] = omega
