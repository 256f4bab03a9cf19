"""The convex step: its minimiser's conditions, friction's work, break-away, rest."""

from dataclasses import replace
from typing import Literal, NamedTuple, get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit
from numpy.typing import NDArray
from scipy.linalg import null_space
from scipy.optimize import minimize_scalar

from ballbot import Model
from ballbot.mechanics.engine.compiled import compiled
from ballbot.mechanics.engine.convex import convex_block, problem_in
from ballbot.mechanics.engine.lanes import LANES, MARGIN, ROWS, STATE, STEP, TORQUE, TRIAL
from ballbot.mechanics.stick_slip import minimiser
from tests.support.control_examples import FRICTION, alten, four_wheeled

#: what is drawn: from stuck to sliding; with some limits zero; with speeds down to 1e-12 of the usual; with steps of up
#: to a second; with all limits reached at once, but for a share of 1e-14 to 1e-1; with other limits of backward speeds
Kind = Literal["usual", "some without friction", "tiny speeds", "huge steps", "almost held", "by direction"]


class Problem(NamedTuple):
    """A step: argmin 1/2 (nu - free)^T M (nu - free) + h sum_i g_i |C_i nu| + h rho |nu_xy|."""

    M: NDArray[np.float64]  #: (m, m), m = 5, or 6 where the ball pivots
    free: NDArray[np.float64]  #: (m,) velocities without friction
    C: NDArray[np.float64]  #: (k, m) rows of the wheels, and of the spin
    limits: NDArray[np.float64]  #: (k,) g_i of speeds above zero [N m]
    backward: NDArray[np.float64]  #: (k,) g_i of speeds below zero [N m]
    rolling: float  #: rho [N]
    h: float  #: [s]


def minimise(problem: Problem) -> NDArray[np.float64]:
    """Return the velocities (m,) by the compiled minimiser."""
    M, free, C, limits, backward, rolling, h = problem
    # an asymmetric box is a symmetric one about a force of its own
    free = free - h * np.linalg.solve(M, C.T @ (0.5 * (limits - backward)))
    rows = [tuple(map(tuple, one.tolist())) for one in (M, C)]
    half = 0.5 * (limits + backward)
    return np.array(_minimise(rows[0], tuple(free.tolist()), rows[1], tuple(half.tolist()), rolling, h))


@compiled
def _minimise(M, free, C, limits, rolling_force, h):
    return minimiser(M, free, C, limits, rolling_force, h)


def random_problem(rng: np.random.Generator, *, wheel_count: int, pivoting: bool, kind: Kind) -> Problem:
    """Return the step of a robot at a random attitude (lean to 1 rad), its forces of the size of its limits.

    The rates are q_dot (the step has the same form in any). Inertias are a tenth to ten times the thesis's robot's: M
    becomes S M S, S diagonal and alike for x and y.
    """
    model = Model(
        four_wheeled(friction=False) if wheel_count == 4 else alten(), pivoting=1.0 if pivoting else None
    )
    q = np.concatenate([np.zeros(2), rng.uniform(-1, 1, 2), rng.uniform(-3, 3, 1)])
    M, C = model.mass_matrix(q), model.wheel_jacobian(q)
    S = 10.0 ** rng.uniform(-0.5, 0.5, len(M))
    S[1] = S[0]
    M = M * np.outer(S, S)
    C = np.vstack([C, np.eye(6)[5]]) if pivoting else C
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
    backward = limits * rng.uniform(0.0, 2.0, len(limits)) if kind == "by direction" else limits
    return Problem(M, free, C, limits, backward, float(rolling), float(h))


shapes = st.tuples(st.sampled_from([3, 4]), st.booleans())


@given(shapes, st.integers(0, 2**32 - 1), st.sampled_from(get_args(Kind)))
@settings(max_examples=120, deadline=None)
def test_the_minimiser_meets_the_conditions_of_optimality(shape, seed, kind):
    """Enough for a convex problem: forces within limits, of the law's power. No solver finds a lower objective."""
    problem = random_problem(np.random.default_rng(seed), wheel_count=shape[0], pivoting=shape[1], kind=kind)
    M, free, C, limits, backward, rolling, h = problem
    nu, norm = minimise(problem), np.linalg.norm
    force, speeds = M @ (free - nu) / h, C @ nu
    law = np.where(speeds > 0.0, limits, backward) @ np.abs(speeds) + rolling * np.hypot(nu[0], nu[1])
    # To first order, an error d of nu changes the power by (M (free - 2 nu) / h) . d and the law by at most
    # sum g_i |C_i . d| + rho |d|. With |d| <= e |free| the two agree to e times this product; in huge steps nu is
    # small beside free and the product far above the law. The worst e of 3,000 problems was 4e-12.
    most = np.maximum(limits, backward) @ norm(C, axis=1) + rolling
    assert abs(force @ nu - law) <= 1e-11 * norm(free) * (norm(M @ (free - 2.0 * nu)) / h + most)
    # the contacts' forces, the ball's on the floor last; those of four wheels are known but for one number
    rows = np.vstack([C, np.eye(len(M))[:2]]).T
    known, others = np.linalg.lstsq(rows, force)[0], null_space(rows)

    def beyond(t: float) -> float:
        forces = known + others.sum(axis=1) * t
        dry, ball = forces[:-2], forces[-2:]
        return max(np.max(dry - limits), np.max(-backward - dry), norm(ball) - rolling)

    size = norm(known) + limits.sum() + backward.sum() + rolling
    least = minimize_scalar(
        beyond, bounds=(-size, size), method="bounded", options={"xatol": 1e-12 * size}
    ).fun
    # the worst of 3,000 problems was 2e-11 of this
    assert min(least, beyond(0.0)) <= 1e-10 * (size + norm(np.linalg.pinv(rows)) * norm(M) * norm(free) / h)


# --- the engine's step for robots side by side ------------------------------------------------------


@njit(error_model="numpy")
def _step(selected, work):
    convex_block(selected, work, 0, 1)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("wheel_count", "pivoting"),
    [(3, None), *(pytest.param(*one, marks=pytest.mark.sample) for one in ((3, 0.02), (4, None)))],
)
def test_the_engine_s_step_meets_the_optimality_conditions(wheel_count: int, pivoting: float | None) -> None:
    """From random states, slow to fast: of the forces that a lane's second pass ends with."""
    rng = np.random.default_rng(43)
    robot = four_wheeled(friction=True) if wheel_count == 4 else alten(FRICTION)
    model = Model(robot, pivoting=pivoting)
    size, worst = 5 + model.velocity_count, 0.0
    for _ in range(200):
        work = np.zeros(ROWS * LANES)
        lane = work.reshape(ROWS, LANES)[:, 0]
        lane[: len(model.packed)] = model.packed
        lean = rng.uniform(-0.3, 0.3, 2) * 10.0 ** rng.uniform(-4, 0)
        velocities = rng.normal(size=size - 5) * 10.0 ** rng.uniform(-6, 0)
        lane[STATE : STATE + size] = np.concatenate([np.zeros(2), lean, rng.uniform(-3, 3, 1), velocities])
        lane[STEP] = 10.0 ** rng.uniform(-4, -2)
        lane[TORQUE : TORQUE + wheel_count] = rng.uniform(-1, 1, wheel_count) * 10.0 ** rng.uniform(-2, 0)
        lane[MARGIN] = -1.0  # an open step
        _step(model.selected, work)
        if not lane[TRIAL + 5 : TRIAL + size].any():
            continue  # it rests
        problem, one, _, forces = problem_in(model.selected, work, 0)
        after = np.add(forces, one.b) - np.array(problem.G) @ forces
        limits = np.array(one.limits)
        share = min(1.0, one.rolling_force / max(np.hypot(*after[-2:]), 1e-300))
        projected = np.concatenate([np.clip(after[:-2], -limits, limits), share * after[-2:]])
        worst = max(worst, np.abs(projected - forces).max() / np.abs(one.b).max())
    assert worst < 1e-12


# --- break-away ------------------------------------------------------------------------------------


@given(
    st.lists(st.floats(0.01, 0.5), min_size=3, max_size=3),
    st.lists(st.floats(-0.99, 0.99), min_size=3, max_size=3),
    st.integers(0, 2),
    st.sampled_from([-1.0, 1.0]),
    st.floats(1e-9, 1.0),
    st.booleans(),
)
def test_each_wheel_breaks_away_at_exactly_its_c_plus_s(limits, shares, wheel, direction, excess, beyond):
    """Upright at rest, the others under torques they hold: nothing moves up to c + s, and beyond it the wheel does."""
    coulomb, stribeck = (share * np.array(limits) for share in (0.6, 0.4))
    model = Model(
        alten(replace(FRICTION, coulomb=tuple(coulomb.tolist()), stribeck=tuple(stribeck.tolist())))
    )
    held = coulomb + stribeck
    torques = held * np.array(shares)
    torques[wheel] = direction * held[wheel] * (1.0 + excess if beyond else 1.0 - min(excess, 0.5))
    end = model.advance(np.zeros(10), torques, 1e-3)
    assert bool(np.any(end != 0.0)) == beyond
    if beyond:
        speed = model.wheel_speed(end[:5], end[5:])[wheel]
        assert speed * direction > 0.0
