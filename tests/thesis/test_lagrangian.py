"""The symbolic equations of motion against independent ways to the same physics."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.mechanics.geometry import body_rates_matrix, rotation, transforms
from ballbot.mechanics.parameters import Formulation
from ballbot.robot import Robot
from tests.support.lagrangian import Equations, equations
from tests.support.symbolic_oracle import (
    cloud_body,
    force_along_speeds,
    linearized_about_upright,
    random_cloud,
    random_robot,
    random_state,
    relative_difference,
)

# Some thousand operations in double precision and a solve whose condition number is below 1e3; 6e-15 was seen
TOLERANCE = 1e-12

seeds = st.integers(0, 2**32 - 1)
wheel_counts = st.sampled_from([3, 4])
formulations = st.sampled_from(["exact", "thesis"])
# deriving takes a second or two the first time
pytestmark = pytest.mark.slow  # SymPy derives the equations first

unhurried = settings(deadline=None, max_examples=50)


def drawn(seed: int, wheel_count: int) -> tuple[Robot, NDArray, NDArray, NDArray]:
    rng = np.random.default_rng(seed)
    return random_robot(rng, wheel_count), *random_state(rng, wheel_count)


# --- the closed form of docs/mechanics.md, written plainly --------------------------------------


class ClosedForm(NamedTuple):
    """What the design page prints, at one state: M nu_dot = W^T u - b + gravity with nu = (v, w)."""

    kinetic: float
    potential: float
    M: NDArray
    b: NDArray
    gravity: NDArray
    W: NDArray


def cross_matrix(a: NDArray) -> NDArray:
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def closed_form(robot: Robot, q: NDArray, q_dot: NDArray) -> ClosedForm:
    r_b, m_r, l, g = robot.ball.radius, robot.body.mass, robot.body.center_of_mass, robot.gravity  # noqa: E741
    m_t = robot.ball.mass + robot.ball.inertia / r_b**2 + m_r
    j_w, j_r = (
        robot.wheels.inertia,
        robot.drive.gear_ratio**2 * (robot.drive.motor_inertia + robot.drive.gear_inertia),
    )
    k, J_0 = 1 + robot.wheels.radius / r_b, robot.body.inertia_about_ball_center()
    A = transforms(robot).T_owb
    D = A.T @ A
    D1, D2, D3 = (j_w + j_r) * D, (j_w * k + j_r) * D, (j_w * (2 * k - 1) + j_r) * D

    R, w = rotation(*q[2:]), body_rates_matrix(*q[2:]) @ q_dot[2:]
    v, e, E = q_dot[:2], np.array([0.0, 0.0, 1.0]), np.array([[0.0, -1.0], [1.0, 0.0], [0.0, 0.0]])
    z, q1 = R.T @ E @ v / r_b, R.T @ np.array([*v, 0.0])
    x = np.cross
    H = J_0 @ w + (D3 - D2) @ (w - z)
    M_vv = m_t * np.eye(2) + E.T @ R @ D1 @ R.T @ E / r_b**2
    M_vw = -m_r * l * (R @ cross_matrix(e))[:2] - E.T @ R @ D2 / r_b
    b_v = m_r * l * (R @ x(w, x(w, e)))[:2] + E.T @ R @ D1 @ x(z, w) / r_b
    b_w = x(w, H) - D2 @ x(z, w)
    body_terms = m_t * v @ v / 2 + m_r * l * q1 @ x(w, e) + w @ J_0 @ w / 2
    return ClosedForm(
        kinetic=float(body_terms + z @ D1 @ z / 2 - z @ D2 @ w + w @ D3 @ w / 2),
        potential=float(m_r * g * l * (R @ e) @ e),
        M=np.block([[M_vv, M_vw], [M_vw.T, J_0 + D3]]),
        b=np.concatenate([b_v, b_w]),
        gravity=np.concatenate([[0, 0], m_r * g * l * x(R.T @ e, e)]),
        W=np.hstack([A @ R.T @ E / r_b, -A]),
    )


def to_body_rates(q: NDArray) -> NDArray:
    """Return J (5, 5) with nu = J q_dot."""
    J = np.eye(5)
    J[2:, 2:] = body_rates_matrix(*q[2:])
    return J


def closed_form_acceleration(robot: Robot, q: NDArray, q_dot: NDArray, u: NDArray) -> NDArray:
    """Return q_ddot from the closed form, with nu_dot = J q_ddot + J_dot q_dot."""
    form, J = closed_form(robot, q, q_dot), to_body_rates(q)
    torque = u - np.array(robot.friction.viscous) * (form.W @ J @ q_dot)
    nu_dot = np.linalg.solve(form.M, form.W.T @ torque - form.b + form.gravity)
    h = 1e-40  # a complex step has no rounding, so it may be as small as this
    B_dot = np.imag(body_rates_matrix(*(q[2:] + 1j * h * q_dot[2:]))) / h
    nu_dot[2:] -= B_dot @ q_dot[2:]
    return np.linalg.solve(J, nu_dot)


@pytest.mark.slow
@unhurried
@given(seeds, wheel_counts)
def test_exact_equations_equal_the_closed_form(seed: int, wheel_count: int):
    robot, q, q_dot, u = drawn(seed, wheel_count)
    exact, form, J = equations(robot, "exact"), closed_form(robot, q, q_dot), to_body_rates(q)
    assert relative_difference(exact.mass_matrix(q), J.T @ form.M @ J) <= TOLERANCE
    assert relative_difference(exact.wheel_speed(q, q_dot), form.W @ J @ q_dot) <= TOLERANCE
    assert exact.potential_energy(q) == pytest.approx(form.potential, rel=TOLERANCE)
    assert (
        relative_difference(exact.acceleration(q, q_dot, u), closed_form_acceleration(robot, q, q_dot, u))
        <= TOLERANCE
    )


@unhurried
@given(seeds, wheel_counts)
def test_energy_of_the_bodies_one_by_one_is_the_designs_kinetic_energy(seed: int, wheel_count: int):
    robot, q, q_dot, _ = drawn(seed, wheel_count)
    kinetic = equations(robot, "exact").kinetic_energy(q, q_dot)
    assert kinetic == pytest.approx(closed_form(robot, q, q_dot).kinetic, rel=TOLERANCE)


# --- other independent ways -----------------------------------------------------------------------


def velocity_of(points: NDArray, q: NDArray, q_dot: NDArray) -> NDArray:
    """Return the velocities (k, 3) of points (k, 3) fixed in the body, by a complex step along the motion."""
    h = 1e-40
    moved = q + 1j * h * q_dot
    return np.imag(np.array([*moved[:2], 0]) + points @ rotation(*moved[2:]).T) / h


@unhurried
@given(seeds)
def test_kinetic_energy_of_the_body_is_that_of_its_points(seed: int):
    rng = np.random.default_rng(seed)
    points, robot = random_cloud(rng), random_robot(rng, 3)
    body = cloud_body(points, mass=12.0, center_of_mass=0.35)
    weightless = replace(robot.wheels, inertia=0.0)
    no_rotor = replace(robot.drive, motor_inertia=0.0, gear_inertia=0.0)
    robot = robot.replace(body=body, wheels=weightless, drive=no_rotor)
    q, q_dot, _ = random_state(rng, 3)
    r_dot = velocity_of(points + np.array([0, 0, body.center_of_mass]), q, q_dot)
    m_ball = robot.ball.mass + robot.ball.inertia / robot.ball.radius**2
    expected = body.mass * np.mean(np.sum(r_dot**2, axis=1)) / 2 + m_ball * q_dot[:2] @ q_dot[:2] / 2
    assert equations(robot, "exact").kinetic_energy(q, q_dot) == pytest.approx(expected, rel=TOLERANCE)


@pytest.mark.slow
@unhurried
@given(seeds, wheel_counts)
def test_thesis_energies_are_those_of_its_appendix(seed: int, wheel_count: int):
    """(II.20), (II.25), (II.27) in plain NumPy, with Phi_dot for the body's angular velocity."""
    robot, q, q_dot, _ = drawn(seed, wheel_count)
    ball, body, T = robot.ball, robot.body, transforms(robot)
    v_g, Phi_dot, R = np.array([*q_dot[:2], 0.0]), q_dot[2:], rotation(*q[2:])
    Omega_ball = np.linalg.pinv(T.T_vgb) @ v_g
    v_body = velocity_of(np.array([[0, 0, body.center_of_mass]]), q, q_dot)[0]
    wheels = T.T_owr @ R.T @ Phi_dot + T.T_owb @ R.T @ Omega_ball
    expected = (
        ball.mass * v_g @ v_g
        + ball.inertia * Omega_ball @ Omega_ball
        + body.mass * v_body @ v_body
        + Phi_dot @ body.inertia_matrix() @ Phi_dot
        + robot.wheels.inertia * wheels @ wheels
    ) / 2
    thesis = equations(robot, "thesis")
    assert thesis.kinetic_energy(q, q_dot) == pytest.approx(expected, rel=TOLERANCE)
    assert relative_difference(thesis.wheel_speed(q, q_dot), wheels) <= TOLERANCE


@pytest.mark.parametrize(
    ("formulation", "pole", "within"),
    # the design page prints 5.20, and 3.63 for what is 3.62499
    [("thesis", 3.625, 5e-4), ("exact", 5.20, 5e-3)],
)
def test_unstable_pole_of_the_thesis_robot(formulation: Formulation, pole: float, within: float):
    A = linearized_about_upright(equations(Robot.load("alten"), formulation))
    unstable = np.linalg.eigvals(A).real
    assert np.sort(unstable)[-2:] == pytest.approx([pole, pole], abs=within)


@unhurried
@given(seeds, wheel_counts)
def test_exact_mass_matrix_is_symmetric_and_positive_definite(seed: int, wheel_count: int):
    robot, q, _, _ = drawn(seed, wheel_count)
    M = equations(robot, "exact").mass_matrix(q)
    assert relative_difference(M, M.T) <= TOLERANCE
    assert np.linalg.eigvalsh(M).min() > 0


@unhurried
@given(seeds, wheel_counts, formulations)
def test_energy_changes_by_the_power_of_torques_less_friction(
    seed: int, wheel_count: int, formulation: Formulation
):
    """True of the thesis's equations too: they are a Lagrangian's, only of another machine."""
    robot, q, q_dot, u = drawn(seed, wheel_count)
    model = equations(robot, formulation)
    speed = model.wheel_speed(q, q_dot)
    power = (u - np.array(robot.friction.viscous) * speed) @ speed
    assert energy_rate(model, q, q_dot, u) == pytest.approx(
        power, abs=float(1e-8 * np.abs(u) @ np.abs(speed))
    )


def energy_rate(model: Equations, q: NDArray, q_dot: NDArray, u: NDArray) -> float:
    """Return dE/dt along the motion by a five-point difference; 6e-11 of the torques' power was seen."""
    q_ddot = model.acceleration(q, q_dot, u)
    h = 1e-3 / (1 + np.abs(q_ddot).max())
    E = [model.energy(q + a * h * q_dot, q_dot + a * h * q_ddot) for a in (-2, -1, 1, 2)]
    return (E[0] - 8 * E[1] + 8 * E[2] - E[3]) / (12 * h)


@unhurried
@given(seeds, wheel_counts, formulations)
def test_forces_act_where_speeds_are_measured(seed: int, wheel_count: int, formulation: Formulation):
    """(II.31) to (II.33) add up to the transposed Jacobian of the wheel speed."""
    robot, q, _, u = drawn(seed, wheel_count)
    model = equations(robot, formulation)
    force = model.generalized_force(q, np.zeros(5), u)
    assert relative_difference(force, force_along_speeds(model, q, u)) <= TOLERANCE


# --- the rest -------------------------------------------------------------------------------------


def test_an_unknown_formulation_is_refused():
    with pytest.raises(InputError, match="'exact' and 'thesis'"):
        equations(Robot.load("alten"), "newton")  # pyright: ignore[reportArgumentType]
