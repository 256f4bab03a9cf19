"""Compare the convex step's minimiser with a reference solver's on 10,000 random problems.

.venv/bin/python -m campaigns.evidence convex_step

The step (`ballbot.mechanics.stick_slip`) is

    nu+ = argmin 1/2 (nu - nu_free)^T M (nu - nu_free) + h sum_i g_i |C_i nu| + h rho |nu_xy|

and its minimiser is where friction lambda_i in [-g_i, g_i], r in the disc of radius rho, takes the velocity nu_free to:

    M (nu_free - nu) = h (C^T lambda + P^T r),   lambda_i = g_i sign(C_i nu) and r = rho nu_xy / |nu_xy| where moving

Problems are drawn at random or made around a known minimiser. The reference (`reference`) is Clarabel (P. J. Goulart,
Y. Chen, Clarabel: an interior-point solver for conic programs with quadratic objectives, 2024), which solves the step
as a second-order cone program. An interior point ends at a duality gap, here 1e-13 of the objective. The gap bounds the
square of the distance to the minimiser: its velocities are good to 1e-9, or 1e-6 at times. Which contacts stick it
knows far better. `reference` therefore solves for the velocities once more with those stuck, and proves the answer. If
friction forces within their limits and against the motion leave a residual e,

    M (nu_free - nu) = h (C^T lambda + P^T r) + h e        =>        |nu - minimiser| <= |h M^-1 e|

in the norm of the kinetic energy, because the step is a projection in that norm (a proximal map) and so increases no
distance.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import combinations, islice, product
from typing import Literal, NamedTuple

import clarabel
import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from ballbot import Model, Robot
from ballbot.mechanics.stick_slip import minimise
from ballbot.robot import Friction
from campaigns.section import Section

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


def objective(
    problem: Problem, nu: NDArray[np.float64], backward: NDArray[np.float64] | None = None
) -> float:
    """Return what is minimised; `backward` (k,) are the limits against speeds below zero, if they differ."""
    d, speeds = nu - problem.free, problem.C @ nu
    against = problem.limits if backward is None else np.where(speeds < 0.0, backward, problem.limits)
    dry = against @ np.abs(speeds) + problem.rolling * np.hypot(nu[0], nu[1])
    return float(0.5 * d @ problem.M @ d + problem.h * dry)


#: a proven distance that ends the search for a better one
GOOD = 1e-13
_MOST_PARTITIONS = 128
_NEWTON_STEPS = 30


@dataclass(frozen=True, kw_only=True, eq=False)
class Reference:
    """Clarabel's solution and its refinement."""

    conic: NDArray[np.float64]  #: (m,) Clarabel's velocities
    nu: NDArray[np.float64]  #: (m,) refined
    bound: float  #: proven largest |nu - minimiser| / |nu_free|


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """Velocities and friction forces that belong to a guess of what sticks."""

    nu: NDArray[np.float64]  #: (m,)
    forces: NDArray[np.float64]  #: (k,) lambda
    floor: NDArray[np.float64]  #: (2,) r


def reference(problem: Problem) -> Reference:
    """Return the minimiser by Clarabel, refined and certified."""
    problem = without_idle_contacts(problem)
    conic = solve_conic(problem)
    best = Reference(conic=conic.nu, nu=conic.nu, bound=np.inf)
    for sticks in islice(likely_partitions(problem, conic), _MOST_PARTITIONS):
        motion = refined(problem, conic, sticks)
        bound = certificate(problem, motion, sticks)
        if bound < best.bound:
            best = Reference(conic=conic.nu, nu=motion.nu, bound=bound)
        if bound < GOOD:
            break
    return best


def without_idle_contacts(problem: Problem) -> Problem:
    """Return the problem without the wheels, or the spin, that have no friction."""
    rubs = problem.limits > 0.0
    return problem._replace(C=problem.C[rubs], limits=problem.limits[rubs])


def solve_conic(problem: Problem, backward: NDArray[np.float64] | None = None) -> Motion:
    """Return what Clarabel finds.

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
    z = np.array(solution.z) * scale**2 / h
    return Motion(
        nu=to_nu @ np.array(solution.x[:m]),
        forces=(z[:k] - ratio * z[k : 2 * k]) / lengths,
        floor=-z[-2:] / disc_length if disc else np.zeros(2),
    )


def _settings() -> clarabel.DefaultSettings:
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_iter = 200
    # asked for less, it breaks down in some problems of a hundred
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-13
    return settings


def likely_partitions(problem: Problem, conic: Motion) -> Iterator[NDArray[np.bool_]]:
    """Yield which contacts stick (k + 1,), the disc last, the likeliest first.

    An interior point has speed times unused force alike everywhere, so that a contact sticks where the share of its
    force that is unused is greater than its speed's share of what it would be without friction; what is close to even
    is tried both ways.
    """
    free, limits = problem.free, np.append(problem.limits, problem.rolling)
    speeds = np.append(np.abs(problem.C @ conic.nu), np.hypot(*conic.nu[:2]))
    usual = np.append(np.abs(problem.C) @ np.abs(free), np.abs(free).sum()) + 1e-300
    used = np.append(np.abs(conic.forces), np.hypot(*conic.floor))
    unused = 1.0 - used / np.maximum(limits, 1e-300)
    evidence = np.log(np.maximum(unused, 1e-16)) - np.log(np.maximum(speeds / usual, 1e-16))
    fixed = limits == 0.0  # a disc without friction slides
    evidence[fixed] = -100.0
    flips = [np.array(flip) for flip in product([False, True], repeat=len(evidence))]
    for flip in sorted(flips, key=lambda flip: np.abs(evidence) @ flip):
        if not (flip & fixed).any():
            yield (evidence > 0.0) ^ flip


def refined(problem: Problem, conic: Motion, sticks: NDArray[np.bool_]) -> Motion:
    """Return the motion in which those contacts stick and the others slide the way that Clarabel's forces oppose.

    Newton's method on the equations of motion. A ball that rolls has polar velocities, (speed, direction), in which
    the equations are well conditioned however slow it is.
    """
    M, free, C, limits, rolling, h = problem
    m, rolls = len(free), rolling > 0.0 and not sticks[-1]
    rows = _stuck_rows(problem, sticks)
    push = C[~sticks[:-1]].T @ (limits * np.sign(conic.forces))[~sticks[:-1]]
    nu, held = conic.nu.copy(), np.zeros(len(rows))
    direction = np.arctan2(*conic.floor[::-1])
    speed = float(np.hypot(*nu[:2]))
    for _ in range(_NEWTON_STEPS):
        to_nu = np.eye(m)  # from the unknowns' changes to the velocities'
        force = push.copy()
        brake = np.zeros((m, m))
        if rolls:
            along, across = _unit(direction), _unit(direction + np.pi / 2)
            nu[:2] = speed * along
            to_nu[:2, :2] = np.column_stack([along, speed * across])
            force[:2] += rolling * along
            brake[:2, 1] = h * rolling * across
        balance = M @ (nu - free) + h * (force + rows.T @ held)
        matrix = np.block([[M @ to_nu + brake, h * rows.T], [rows @ to_nu, np.zeros((len(rows),) * 2)]])
        step = -np.linalg.lstsq(matrix, np.append(balance, rows @ nu), rcond=1e-14)[0]
        held = held + step[m:]
        if rolls:
            speed, direction = speed + step[0], direction + step[1]
            nu[:2] = speed * _unit(direction)
            nu[2:] += step[2:m]
        else:
            nu += step[:m]
        if not np.isfinite(step).all() or np.abs(to_nu @ step[:m]).max() <= 1e-17 * np.abs(free).max():
            break
    return _completed(problem, nu, held, direction, sticks)


def _completed(
    problem: Problem,
    nu: NDArray[np.float64],
    held: NDArray[np.float64],
    direction: float,
    sticks: NDArray[np.bool_],
) -> Motion:
    """Return the motion with the forces of all contacts, clipped to their limits."""
    C, limits, rolling = problem.C, problem.limits, problem.rolling
    held = _least_overloaded(_stuck_rows(problem, sticks), held, limits[sticks[:-1]])
    count = int(sticks[:-1].sum())
    forces = limits * np.sign(C @ nu)
    forces[sticks[:-1]] = np.clip(held[:count], -limits[sticks[:-1]], limits[sticks[:-1]])
    if sticks[-1]:
        floor = held[count:] * min(1.0, rolling / max(float(np.hypot(*held[count:])), 1e-300))
    else:
        floor = rolling * _unit(direction)
    return Motion(nu=nu, forces=forces, floor=floor)


def certificate(problem: Problem, motion: Motion, sticks: NDArray[np.bool_]) -> float:
    """Return what |nu - minimiser| / |nu_free| is at most, in the norm of the kinetic energy.

    The motion's forces are within their limits and, where wheels slide, against the motion. What sticks still moves
    by rounding; to stop it takes the velocities 'still' away from here, and e with them. A ball that moves against its
    friction proves nothing.
    """
    M, free, C, _, rolling, h = problem
    if not np.isfinite(motion.nu).all() or (
        not sticks[-1] and rolling > 0.0 and motion.nu[:2] @ motion.floor < 0.0
    ):
        return np.inf
    force = C.T @ motion.forces
    force[:2] += motion.floor
    e = M @ (free - motion.nu) / h - force
    rows = _stuck_rows(problem, sticks)
    still = np.linalg.pinv(rows) @ (rows @ motion.nu)
    size = np.sqrt(max(float(free @ M @ free), 1e-300))
    return (h * float(np.sqrt(e @ np.linalg.solve(M, e))) + 2.0 * float(np.sqrt(still @ M @ still))) / size


def _unit(angle: float) -> NDArray[np.float64]:
    return np.array([np.cos(angle), np.sin(angle)])


def _stuck_rows(problem: Problem, sticks: NDArray[np.bool_]) -> NDArray[np.float64]:
    size = len(problem.free)
    disc = np.eye(size)[:2] if sticks[-1] else np.zeros((0, size))
    return np.vstack([problem.C[sticks[:-1]], disc])


def _least_overloaded(
    rows: NDArray[np.float64], held: NDArray[np.float64], limits: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the forces moved along what four wheels can exert without effect, to where the worst is least."""
    if len(rows) == 0:
        return held
    _, s, Vt = np.linalg.svd(rows.T)
    idle = Vt[int(np.sum(s > 1e-11 * s[0])) :]
    if len(idle) == 0:
        return held
    along, count = idle[0], len(limits)
    # the least of a largest of lines is where two of them cross
    height, slope = (
        np.concatenate([part, -part]) / np.tile(limits, 2) for part in (held[:count], along[:count])
    )
    crossings = [
        (height[j] - height[i]) / (slope[i] - slope[j])
        for i, j in combinations(range(2 * count), 2)
        if slope[i] != slope[j]
    ]
    best = min(crossings, key=lambda amount: float(np.max(height + amount * slope)))
    return held + best * along


#: for each of 3 and 4 wheels, with and without a ball that pivots: 4 x (5 x 400 + 500) = 10,000
OF_A_KIND = 400
MADE = 500
TARGET = 1e-10


@dataclass(frozen=True, kw_only=True)
class Compared:
    """Distances of one problem, over |nu_free|, in the norm of the kinetic energy."""

    ours: float  #: to the refined reference, or to the minimiser that the problem was made around
    bound: float  #: of the reference to the minimiser, proven
    conic: float  #: of Clarabel's own answer to it


def compare(problem: Problem, rng: np.random.Generator, known: NDArray[np.float64] | None = None) -> Compared:
    """Return how far the minimiser that is found is from the reference; the guess of signs is chance's."""
    nu = minimise(*problem, rng.normal(size=len(problem.free)))
    found = reference(problem)
    return Compared(
        ours=distance(problem, nu, found.nu if known is None else known),
        bound=found.bound,
        conic=distance(problem, found.conic, found.nu),
    )


def campaign() -> Section:
    """Return the worst distances of each kind of problem."""
    rng = np.random.default_rng(41)

    def drawn(make: Callable[[int, bool], Compared], count: int) -> list[Compared]:
        return [make(n, pivots) for n in (3, 4) for pivots in (False, True) for _ in range(count)]

    table = {
        kind: drawn(
            lambda n, pivots, kind=kind: compare(
                random_problem(rng, wheel_count=n, pivoting=pivots, kind=kind), rng
            ),
            OF_A_KIND,
        )
        for kind in KINDS
    }

    def made(n: int, pivots: bool) -> Compared:
        problem, known = with_minimiser(rng, wheel_count=n, pivoting=pivots)
        return compare(problem, rng, known)

    table["made around a known minimiser"] = drawn(made, MADE)
    total = sum(len(results) for results in table.values())
    worst = max(one.ours for results in table.values() for one in results)
    return Section(
        title=f"The convex step's minimiser on {total:,} random problems",
        before="Distance between the computed velocities and the reference's, relative to the norm of the "
        "friction-free ones, "
        f"sqrt(nu^T M nu); the target is {TARGET:g}. The reference is Clarabel {clarabel.__version__}'s answer, "
        "refined and certified (`campaigns/convex_step.py`): it proves an upper bound of its own distance from the "
        "minimiser. Three and four wheels, with and without a pivoting ball, a quarter each; attitudes, inertias (a "
        "tenth to ten times the thesis's robot's) and the guess of the signs are random.",
        columns=["problems", "number", "worst", "median", "reference proven to", "Clarabel alone, median"],
        rows=[_row(kind, results) for kind, results in table.items()],
        after=f"Worst of all: {worst:.1e}. Clarabel stops at a duality gap of 1e-13, which bounds the square of the "
        "distance; the worst of its own answers is off by "
        f"{max(one.conic for results in table.values() for one in results):.1e}.",
    )


def _row(kind: str, results: list[Compared]) -> list[str]:
    ours, bound, conic = (
        np.array([getattr(one, name) for one in results]) for name in ("ours", "bound", "conic")
    )
    return [
        kind,
        f"{len(results):,}",
        f"{ours.max():.1e}",
        f"{np.median(ours):.1e}",
        f"{bound.max():.1e}",
        f"{np.median(conic):.1e}",
    ]
