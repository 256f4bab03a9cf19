"""Random problems of the convex step, and Clarabel's answer.

The step (`ballbot.mechanics.stick_slip`) is

    nu+ = argmin 1/2 (nu - nu_free)^T M (nu - nu_free) + h sum_i g_i |C_i nu| + h rho |nu_xy|

Clarabel (P. J. Goulart, Y. Chen, Clarabel: an interior-point solver for conic programs with quadratic objectives, 2024)
solves the step as a second-order cone program. It ends at a duality gap, here 1e-13 of the objective, which bounds the
square of the distance to the minimiser: its velocities are good to 1e-9, or 1e-6 at times.
"""

from typing import Literal, NamedTuple

import clarabel
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from ballbot import Model
from ballbot.mechanics.engine.compiled import compiled
from ballbot.mechanics.stick_slip import minimiser
from tests.support.control_examples import alten, four_wheeled

#: what is drawn: from stuck to sliding; with some limits zero; with speeds down to 1e-12 of the usual; with steps of up
#: to a second; with all limits reached at once, but for a share of 1e-14 to 1e-1
Kind = Literal["usual", "some without friction", "tiny speeds", "huge steps", "almost held"]
KINDS: tuple[Kind, ...] = ("usual", "some without friction", "tiny speeds", "huge steps", "almost held")


class Problem(NamedTuple):
    """A step's numbers."""

    M: NDArray[np.float64]  #: (m, m), m = 5, or 6 where the ball pivots
    free: NDArray[np.float64]  #: (m,) nu_free
    C: NDArray[np.float64]  #: (k, m) rows of the wheels, and of the spin
    limits: NDArray[np.float64]  #: (k,) g_i [N m]
    rolling: float  #: rho [N]
    h: float  #: [s]


def minimise(problem: Problem, backward: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
    """Return the velocities (m,) by the compiled minimiser; `backward` (k,) are the limits of backward speeds."""
    M, free, C, limits, rolling, h = problem
    if backward is not None:  # an asymmetric box is a symmetric one about a force of its own
        free = free - h * np.linalg.solve(M, C.T @ (0.5 * (limits - backward)))
        limits = 0.5 * (limits + backward)
    rows = [tuple(map(tuple, one.tolist())) for one in (M, C)]
    return np.array(_minimise(rows[0], tuple(free.tolist()), rows[1], tuple(limits.tolist()), rolling, h))


@compiled
def _minimise(M, free, C, limits, rolling_force, h):
    return minimiser(M, free, C, limits, rolling_force, h)


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
    robot = four_wheeled(friction=False) if wheel_count == 4 else alten()
    model = Model(robot, pivoting=1.0 if pivoting else None)
    q = np.concatenate([np.zeros(2), rng.uniform(-1, 1, 2), rng.uniform(-3, 3, 1)])
    M, C = model.mass_matrix(q), model.wheel_jacobian(q)
    S = 10.0 ** rng.uniform(-0.5, 0.5, len(M))
    S[1] = S[0]
    M = M * np.outer(S, S)
    return M, np.vstack([C, np.eye(6)[5]]) if pivoting else C


def distance(problem: Problem, nu: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Return |nu - other| / |nu_free| in the norm of the kinetic energy, sqrt(nu^T M nu)."""
    d, free = nu - other, problem.free
    return float(np.sqrt((d @ problem.M @ d) / max(free @ problem.M @ free, 1e-300)))


def objective(
    problem: Problem, nu: NDArray[np.float64], backward: NDArray[np.float64] | None = None
) -> float:
    """Return what is minimised; `backward` (k,) are the limits against speeds below zero, if they differ."""
    d, speeds = nu - problem.free, problem.C @ nu
    against = problem.limits if backward is None else np.where(speeds < 0.0, backward, problem.limits)
    dry = against @ np.abs(speeds) + problem.rolling * np.hypot(nu[0], nu[1])
    return float(0.5 * d @ problem.M @ d + problem.h * dry)


def solve_conic(problem: Problem, backward: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
    """Return the velocities that Clarabel finds.

    `backward` (k,) are the limits against speeds below zero, if they differ from `problem.limits`, which are then
    those against speeds above it and are above zero.

    With nu = scale L^-T y, M = L L^T: min 1/2 y.y - y_free.y + sum w_i t_i + w s, where |rows of C . y| <= t_i
    (backward, times the ratio of both limits) and (s, ball's x, ball's y) is in the second-order cone; rows are scaled
    to length one.
    """
    M, free, C, limits, rolling, h = problem
    k, m = C.shape
    L = np.linalg.cholesky(M)
    scale = float(np.linalg.norm(L.T @ free)) or 1.0
    to_nu = scale * np.linalg.inv(L).T
    lengths = np.linalg.norm(C @ to_nu, axis=1)
    rows = (C @ to_nu) / lengths[:, None]
    disc_length = float(np.linalg.norm(to_nu[:2]))
    disc = 1 if rolling > 0.0 else 0
    P = np.diag(np.append(np.ones(m), np.zeros(k + disc)))
    weights = np.append(limits * lengths, [rolling * disc_length] * disc) * h / scale**2
    A = np.zeros((2 * k + 3 * disc, m + k + disc))
    ratio = np.ones(k) if backward is None else backward / limits
    A[:k, :m], A[k : 2 * k, :m] = rows, -ratio[:, None] * rows
    A[:k, m : m + k] = A[k : 2 * k, m : m + k] = -np.eye(k)
    cones = [clarabel.NonnegativeConeT(2 * k)]
    if disc:
        A[2 * k, -1] = -1.0
        A[2 * k + 1 :, :m] = -to_nu[:2] / disc_length
        cones.append(clarabel.SecondOrderConeT(3))
    q = np.append(-L.T @ free / scale, weights)
    zeros = np.zeros(len(A))
    solver = clarabel.DefaultSolver(sparse.csc_matrix(P), q, sparse.csc_matrix(A), zeros, cones, _settings())
    solution = solver.solve()
    return to_nu @ np.array(solution.x[:m])


def _settings() -> clarabel.DefaultSettings:
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_iter = 200
    # asked for less, it breaks down in some problems of a hundred
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-13
    return settings
