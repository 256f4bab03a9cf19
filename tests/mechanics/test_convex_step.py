"""The convex step: its minimiser against Clarabel's and its conditions, friction's work, break-away, rest."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit

from ballbot import Model
from ballbot.mechanics.engine.convex import convex_block, problem_in
from ballbot.mechanics.engine.lanes import LANES, MARGIN, ROWS, STATE, STEP, TORQUE, TRIAL
from tests.support.control_examples import FRICTION, alten, four_wheeled
from tests.support.convex_problems import (
    KINDS,
    Kind,
    distance,
    minimise,
    objective,
    random_problem,
    solve_conic,
)

#: of an objective, over that at rest
TOLERANCE = 1e-10

shapes = st.tuples(st.sampled_from([3, 4]), st.booleans())


# --- the minimiser ---------------------------------------------------------------------------------


@given(shapes, st.integers(0, 2**32 - 1), st.sampled_from(KINDS))
@settings(max_examples=80, deadline=None)
def test_the_minimiser_is_no_worse_than_clarabel_s(shape: tuple[int, bool], seed: int, kind: Kind) -> None:
    """Clarabel's answer is nowhere lower, but for the kinks.

    There a contact's speed of nearly zero costs its friction, which is of first order in it (1.2e-11 of 900 problems).
    """
    rng = np.random.default_rng(seed)
    problem = random_problem(rng, wheel_count=shape[0], pivoting=shape[1], kind=kind)
    nu = minimise(problem)
    rest = objective(problem, np.zeros_like(nu))
    assert objective(problem, nu) <= objective(problem, solve_conic(problem)) + TOLERANCE * rest


@given(shapes, st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_the_minimiser_of_friction_by_direction_is_clarabel_s(shape: tuple[int, bool], seed: int) -> None:
    """MuJoCo's `frictionloss` has one limit for both directions, so that a conic solver is the oracle here."""
    rng = np.random.default_rng(seed)
    problem = random_problem(rng, wheel_count=shape[0], pivoting=shape[1])
    backward = problem.limits * rng.uniform(0.0, 2.0, len(problem.limits))
    nu = minimise(problem, backward)
    conic = solve_conic(problem, backward)
    rest = objective(problem, np.zeros_like(nu), backward)
    assert objective(problem, nu, backward) <= objective(problem, conic, backward) + TOLERANCE * rest
    # near its minimum the objective is quadratic: 1e-13 of it, Clarabel's tolerance, is some 1e-6 of the velocity, and
    # 1.2e-5 in the worst problem seen, in which ours is the lower of the two
    assert distance(problem, nu, conic) < 1e-4
    # and both directions matter: the symmetric law of the forward limits ends elsewhere, unless all is at rest
    if nu.any():
        assert distance(problem, minimise(problem), nu) > 1e-9 or (problem.C @ nu >= -1e-12).all()


@given(shapes, st.integers(0, 2**32 - 1), st.sampled_from(KINDS))
@settings(max_examples=80, deadline=None)
def test_friction_s_power_is_that_of_its_limits_and_never_drives(shape, seed, kind):
    """M (nu_free - nu)/h . nu = sum g_i |C_i nu| + rho |nu_xy| >= 0: what the law takes, from an impulse that is."""
    rng = np.random.default_rng(seed)
    problem = random_problem(rng, wheel_count=shape[0], pivoting=shape[1], kind=kind)
    M, free, C, limits, rolling, h = problem
    nu = minimise(problem)
    power = M @ (free - nu) @ nu / h
    law = limits @ np.abs(C @ nu) + rolling * np.hypot(nu[0], nu[1])
    # To first order, an error d of nu changes the power by (M (free - 2 nu) / h) . d and the law by at most
    # sum g_i |C_i . d| + rho |d|. With |d| <= e |free| the two agree to e times this product; in huge steps nu is
    # small beside free and the product far above the law. The worst e of 80,000 problems was 2e-13.
    norm = np.linalg.norm
    change = norm(free) * (norm(M @ (free - 2.0 * nu)) / h + limits @ norm(C, axis=1) + rolling)
    assert abs(power - law) <= 1e-11 * change


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
@settings(max_examples=60, deadline=None)
def test_each_wheel_breaks_away_at_exactly_its_c_plus_s(limits, shares, wheel, direction, excess, beyond):
    """Upright at rest, the others under torques they hold: nothing moves up to c + s, and beyond it the wheel does."""
    friction = replace(
        FRICTION,
        coulomb=tuple(0.6 * limit for limit in limits),
        stribeck=tuple(0.4 * limit for limit in limits),
    )
    model = Model(alten(friction))
    held = 0.6 * np.array(limits) + 0.4 * np.array(limits)
    torques = held * np.array(shares)
    torques[wheel] = direction * held[wheel] * (1.0 + excess if beyond else 1.0 - min(excess, 0.5))
    end = model.advance(np.zeros(10), torques, 1e-3)
    assert bool(np.any(end != 0.0)) == beyond
    if beyond:
        speed = model.wheel_speed(end[:5], end[5:])[wheel]
        assert speed * direction > 0.0
