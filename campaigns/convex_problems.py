"""Problems for the convex step (`ballbot.mechanics.stick_slip`), drawn at random or made around their minimiser.

    nu+ = argmin 1/2 (nu - nu_free)^T M (nu - nu_free) + h sum_i g_i |C_i nu| + h rho |nu_xy|

The minimiser is where friction lambda_i in [-g_i, g_i], r in the disc of radius rho, takes the velocity nu_free to:

    M (nu_free - nu) = h (C^T lambda + P^T r),   lambda_i = g_i sign(C_i nu) and r = rho nu_xy / |nu_xy| where moving
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot import Model, Robot
from ballbot.robot import Friction

#: what is drawn: from stuck to sliding; with some limits zero; with speeds down to 1e-12 of the usual; with steps of up
#: to a second; with all limits reached at once, but for a share of 1e-14 to 1e-1
Kind = Literal["usual", "some without friction", "tiny speeds", "huge steps", "almost held"]
KINDS: tuple[Kind, ...] = ("usual", "some without friction", "tiny speeds", "huge steps", "almost held")


class Problem(NamedTuple):
    """The arguments of `minimise`, but for its guess."""

    M: NDArray[np.float64]  #: (m, m), m = 5, or 6 where the ball pivots
    free: NDArray[np.float64]  #: (m,) nu_free
    C: NDArray[np.float64]  #: (k, m) rows of the wheels, and of the spin
    limits: NDArray[np.float64]  #: (k,) g_i [N m]
    rolling: float  #: rho [N]
    h: float  #: [s]


def robot_with(wheel_count: int) -> Robot:
    """Return the thesis's robot on three or four wheels, without friction."""
    robot = Robot.load("alten")
    if wheel_count == robot.wheel_count:
        return robot
    azimuths = tuple(2 * np.pi / wheel_count * np.arange(wheel_count))
    wheels = replace(robot.wheels, azimuths=azimuths)
    return robot.replace(wheels=wheels, friction=Friction.none(wheel_count))


def random_problem(
    rng: np.random.Generator, *, wheel_count: int, pivoting: bool, kind: Kind = "usual"
) -> Problem:
    """Return the step of a robot at a random attitude (lean to 1 rad), its forces of the size of its limits."""
    M, C = matrices(rng, wheel_count=wheel_count, pivoting=pivoting)
    limits = rng.uniform(0, 0.3, len(C))
    rolling, h = rng.uniform(0, 3), 10.0 ** rng.uniform(-4, -2)
    free = rng.normal(size=len(M)) * 10.0 ** rng.uniform(-4, 0)
    if kind == "some without friction":
        limits[rng.random(len(limits)) < 0.5] = 0.0
        rolling *= rng.integers(0, 2)
    elif kind == "tiny speeds":
        free *= 10.0 ** rng.uniform(-12, -4)
    elif kind == "huge steps":
        h = 10.0 ** rng.uniform(-2, 0)
    elif kind == "almost held":
        excess = rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(-14, -1)
        push = C.T @ (limits * rng.choice([-1.0, 1.0], len(limits)))
        direction = rng.normal(size=2)
        push[:2] += rolling * direction / np.linalg.norm(direction)
        free = h * (1.0 + excess) * np.linalg.solve(M, push)
    return Problem(M, free, C, limits, float(rolling), float(h))


def matrices(
    rng: np.random.Generator, *, wheel_count: int, pivoting: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return M and C in the coordinates q_dot (the step has the same form in any rates) at a random attitude.

    Inertias are a tenth to ten times the thesis's robot's: M becomes S M S, S diagonal and alike for x and y.
    """
    model = Model(robot_with(wheel_count), pivoting=1.0 if pivoting else None)
    q = np.concatenate([np.zeros(2), rng.uniform(-1, 1, 2), rng.uniform(-3, 3, 1)])
    M, C = model.mass_matrix(q), model.wheel_jacobian(q)
    S = 10.0 ** rng.uniform(-0.5, 0.5, len(M))
    S[1] = S[0]
    M = M * np.outer(S, S)
    return M, np.vstack([C, np.eye(6)[5]]) if pivoting else C


def with_minimiser(
    rng: np.random.Generator, *, wheel_count: int, pivoting: bool
) -> tuple[Problem, NDArray[np.float64]]:
    """Return a problem made around its minimiser: random contacts stick, half of the time at exactly their limit."""
    M, C = matrices(rng, wheel_count=wheel_count, pivoting=pivoting)
    limits, rolling, h = rng.uniform(0.01, 0.3, len(C)), rng.uniform(0.1, 3), 10.0 ** rng.uniform(-4, -1)
    sticks, disc_sticks = rng.random(len(C)) < rng.uniform(0, 1), rng.random() < 0.4
    held = np.vstack([C[sticks], np.eye(len(M))[: 2 if disc_sticks else 0]])
    nu = _without(rng.normal(size=len(M)) * 10.0 ** rng.uniform(-6, 0), held)

    tiny = 1e-12 * np.abs(nu).max()
    forces = limits * np.where(np.abs(C @ nu) > tiny, np.sign(C @ nu), _shares(rng, len(C)))
    rolls = np.hypot(*nu[:2]) > tiny
    heading = nu[:2] if rolls else rng.normal(size=2)
    floor = rolling * heading / np.hypot(*heading) * (1.0 if rolls else _shares(rng, 1)[0])
    push = C.T @ forces
    push[:2] += floor
    return Problem(M, nu + h * np.linalg.solve(M, push), C, limits, rolling, h), nu


def _shares(rng: np.random.Generator, count: int) -> NDArray[np.float64]:
    """Return shares of a limit (count,), half of them exactly 1 or -1."""
    return np.where(rng.random(count) < 0.5, rng.uniform(-1, 1, count), rng.choice([-1.0, 1.0], count))


def _without(nu: NDArray[np.float64], rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return nu with what the rows see taken out; zero where they see all."""
    if len(rows) == 0:
        return nu
    _, s, Vt = np.linalg.svd(rows)
    rank = int(np.sum(s > 1e-9 * s[0]))
    null = Vt[rank:]
    return null.T @ (null @ nu)


def distance(problem: Problem, nu: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Return |nu - other| / |nu_free| in the norm of the kinetic energy, sqrt(nu^T M nu)."""
    d, free = nu - other, problem.free
    return float(np.sqrt((d @ problem.M @ d) / max(free @ problem.M @ free, 1e-300)))


def objective(problem: Problem, nu: NDArray[np.float64]) -> float:
    """Return what is minimised."""
    d = nu - problem.free
    dry = problem.limits @ np.abs(problem.C @ nu) + problem.rolling * np.hypot(nu[0], nu[1])
    return float(0.5 * d @ problem.M @ d + problem.h * dry)
