"""Set-valued friction: the convex step against a reference solver, break-away, rest, dissipation."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from ballbot import Model, Robot
from ballbot.mechanics.stick_slip import minimise
from ballbot.robot import Friction, Wheels

FRICTION = Friction(
    viscous=(0.0, 0.0, 0.0),
    coulomb=(0.11, 0.09, 0.12),
    stribeck=(0.05, 0.04, 0.06),
    stribeck_speed=0.6,
    stribeck_exponent=1.1,
    rolling=0.007,
)


def robot_with(friction: Friction) -> Robot:
    return Robot.load("alten").replace(friction=friction)


def random_problem(rng: np.random.Generator, wheel_count: int):
    """Return M, nu_free, C, limits, rolling, h of a robot at a random attitude, from stuck to sliding."""
    robot = Robot.load("alten")
    if wheel_count == 4:
        wheels = robot.wheels
        robot = robot.replace(
            wheels=Wheels(
                radius=wheels.radius,
                inertia=wheels.inertia,
                tilt=wheels.tilt,
                azimuths=tuple(np.pi / 2 * np.arange(4)),
                rollers=wheels.rollers,
            ),
            friction=Friction.none(4),
        )
    model = Model(robot)
    q = np.concatenate([np.zeros(2), rng.uniform(-0.5, 0.5, 2), rng.uniform(-3, 3, 1)])
    M, C = model.mass_matrix(q), model.wheel_jacobian(q)
    free = rng.normal(size=5) * 10.0 ** rng.uniform(-4, 0)
    return M, free, C, rng.uniform(0, 0.3, wheel_count), rng.uniform(0, 3), 10.0 ** rng.uniform(-4, -2)


def objective(nu, M, free, C, limits, rolling, h):
    difference = nu - free
    dry = limits @ np.abs(C @ nu) + rolling * np.hypot(nu[0], nu[1])
    return 0.5 * difference @ M @ difference + h * dry


def is_optimal(nu, M, free, C, limits, rolling, h):
    """Return the largest violation of the optimality conditions, relative to the forces' sizes.

    The friction forces lambda, r with M (nu_free - nu) = h (C^T lambda + P^T r) must be in their sets and,
    where there is motion, at the limit against it. With four wheels lambda is found by bounded least squares.
    """
    from scipy.optimize import lsq_linear

    force = M @ (free - nu) / h
    speeds, speed = C @ nu, np.hypot(nu[0], nu[1])
    tiny = 1e-9 * (np.abs(C) @ np.abs(nu)).max() if np.abs(nu).any() else 0.0
    low = np.where(speeds > tiny, limits, -limits)
    high = np.where(speeds < -tiny, -limits, limits)
    columns = np.concatenate([C.T, np.eye(5)[:, :2]], axis=1)
    if speed > tiny:
        r = rolling * nu[:2] / speed
        low, high = np.concatenate([low, r]), np.concatenate([high, r])
    else:
        low, high = np.concatenate([low, [-rolling] * 2]), np.concatenate([high, [rolling] * 2])
    widen = 1e-12 * (1 + np.abs(high))
    found = lsq_linear(columns, force, (low - widen, high + widen), tol=1e-15)
    return np.abs(columns @ found.x - force).max() / (1.0 + np.abs(force).max())


@pytest.mark.parametrize("wheel_count", [3, 4])
def test_minimiser_satisfies_the_optimality_conditions(wheel_count):
    rng = np.random.default_rng(11)
    worst = 0.0
    for _ in range(300):
        M, free, C, limits, rolling, h = random_problem(rng, wheel_count)
        nu = minimise(M, free, C, limits, rolling, h)
        worst = max(worst, is_optimal(nu, M, free, C, limits, rolling, h))
    # rounding of the forces, divided by h: M nu / h * 1e-16, and lsq_linear's own tolerance
    assert worst < 1e-8


def test_minimiser_is_no_worse_than_a_general_solvers():
    rng = np.random.default_rng(12)
    for _ in range(60):
        problem = random_problem(rng, 3)
        nu = minimise(*problem)
        value = objective(nu, *problem)
        rival = minimize(
            objective, nu + rng.normal(size=5) * 1e-4, args=problem, method="Nelder-Mead", tol=1e-14
        )
        assert value <= rival.fun + 1e-13 * max(1.0, abs(value))


@pytest.mark.slow
@given(st.floats(0.5, 2.0), st.floats(0.0, 2 * np.pi), st.floats(-3.0, 3.0))
@settings(max_examples=50, deadline=None)
def test_rest_is_held_up_to_the_limit_and_not_beyond(scale, direction, psi):
    """A lone ground force on a robot at rest is held by the floor up to N C_rr, the wheels being all but free."""
    model = Model(robot_with(FRICTION))
    q = np.array([0, 0, 0, 0, psi])
    M, C = model.mass_matrix(q), model.wheel_jacobian(q)
    h, rolling = 1e-3, 1.4
    push = np.array([np.cos(direction), np.sin(direction), 0, 0, 0]) * rolling * scale
    free = h * np.linalg.solve(M, push)
    limits = np.full(3, 1e-9)  # all but none: what the wheels hold must cover the rounding of their own part
    held = not minimise(M, free, C, limits, rolling, h).any()
    assert held == (scale <= 1.0) or scale == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("excess", [-1e-9, 1e-9])
def test_break_away_at_exactly_c_plus_s(excess):
    """Equal torques on three equal wheels turn the heading alone; nothing moves until u passes c + s."""
    friction = replace(FRICTION, coulomb=(0.11,) * 3, stribeck=(0.05,) * 3)
    model = Model(robot_with(friction))
    state = model.advance(np.zeros(10), np.full(3, 0.16 * (1 + excess)), 1e-3)
    moved = bool(np.any(state != 0.0))
    assert moved == (excess > 0)


@pytest.mark.slow
def test_a_robot_held_by_friction_does_not_move_by_one_bit_in_an_hour():
    model = Model(robot_with(FRICTION))
    start = np.array([0.3, -0.2, 0.0015, -0.001, 2.0, 0, 0, 0, 0, 0])
    end = model.advance(start, np.array([0.01, -0.02, 0.015]), 3600.0)
    assert (end == start).all()


def test_without_rolling_friction_the_whole_robot_does_not_rest():
    model = Model(robot_with(replace(FRICTION, rolling=0.0)))
    start = np.array([0, 0, 0.0015, 0, 0, 0, 0, 0, 0, 0.0])
    assert (model.advance(start, np.zeros(3), 0.1) != start).any()


def test_friction_takes_energy_only():
    """Released from a lean with every wheel crossing zero, the mechanical energy never grows."""
    model = Model(robot_with(FRICTION))
    state = np.array([0, 0, 0.05, -0.03, 0.2, 0.15, -0.1, -0.3, 0.2, 0.4])
    energy = model.energy(state[:5], state[5:])
    for _ in range(300):
        state = model.advance(state, np.zeros(3), 1e-3)
        after = model.energy(state[:5], state[5:])
        # a first-order step at a change of sign may misjudge the energy by h^2 times the accelerations squared
        assert after <= energy + 2e-5
        energy = after


def test_stuck_wheels_hold_while_the_others_slide():
    """One wheel far stronger than the rest sticks exactly while the ball is driven about."""
    friction = replace(FRICTION, coulomb=(5.0, 0.05, 0.05), stribeck=(0.0, 0.0, 0.0))
    model = Model(robot_with(friction))
    state, speeds = np.zeros(10), []
    for _ in range(200):
        state = model.advance(state, np.array([0.0, 0.4, 0.5]), 1e-3)
        speeds.append(model.wheel_speed(state[:5], state[5:]))
    speeds = np.array(speeds)
    # the constraint is met at each step's start attitude; the speed left is the attitude's change within a step
    assert np.abs(speeds[:, 0]).max() < 1e-3
    assert np.abs(speeds[:, 1]).max() > 0.5


def test_whole_method_converges_in_stick_slip_motion():
    """Halving the step halves the error at least: only steps at a change of sign are of first order."""
    robot = robot_with(FRICTION)
    start = np.array([0, 0, 0.02, 0.01, 0.1, 0.2, -0.15, 0, 0, 0.3])
    torques = [np.array([0.5 * np.sin(8 * k * 0.05), 0.4 * np.cos(11 * k * 0.05), -0.3]) for k in range(8)]

    def end(step):
        state = start
        for torque in torques:
            state = Model(robot, step=step).advance(state, torque, 0.05)
        return state

    reference = end(2e-6)
    errors = np.array([np.abs(end(step) - reference).max() for step in (2e-3, 1e-3, 5e-4, 2.5e-4, 1.25e-4)])
    # errors fall from step to step by a factor that scatters about two (where in a step a sign changes is chance)
    assert errors[0] / errors[-1] > 8
