"""The symbolic equations of motion against Appendix II in NumPy and the poles that are known.

The compiled equations are tested against them (tests/mechanics/test_equations.py), and the exact ones against MuJoCo
and Drake (tests/mechanics/test_engines.py).
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.mechanics.geometry import rotation, transforms
from ballbot.mechanics.parameters import Formulation
from ballbot.robot import Robot
from tests.support.lagrangian import equations
from tests.support.symbolic_oracle import (
    linearized_about_upright,
    random_robot,
    random_state,
    relative_difference,
)

# Some thousand operations in double precision and a solve whose condition number is below 1e3; 6e-15 was seen
TOLERANCE = 1e-12

seeds = st.integers(0, 2**32 - 1)
wheel_counts = st.sampled_from([3, 4])
# deriving takes a second or two the first time
pytestmark = pytest.mark.slow  # SymPy derives the equations first

unhurried = settings(deadline=None, max_examples=50)


def drawn(seed: int, wheel_count: int) -> tuple[Robot, NDArray, NDArray, NDArray]:
    rng = np.random.default_rng(seed)
    return random_robot(rng, wheel_count), *random_state(rng, wheel_count)


def velocity_of(points: NDArray, q: NDArray, q_dot: NDArray) -> NDArray:
    """Return the velocities (k, 3) of points (k, 3) fixed in the body, by a complex step along the motion."""
    h = 1e-40
    moved = q + 1j * h * q_dot
    return np.imag(np.array([*moved[:2], 0]) + points @ rotation(*moved[2:]).T) / h


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


def test_an_unknown_formulation_is_refused():
    with pytest.raises(InputError, match="'exact' and 'thesis'"):
        equations(Robot.load("alten"), "newton")  # pyright: ignore[reportArgumentType]
