"""The ball that pivots: what holds it, where it breaks away, and runs with it; its equations: test_engines."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray

from ballbot import InputError, Model, Robot, simulate
from tests.support.control_examples import FRICTION, alten, four_wheeled
from tests.support.freed_mechanism import reflected_inertia

pytestmark = pytest.mark.sample  # no other test compiles the pivoting model's engines

#: more than any wheel of these robots can exert on the ball [N m]
HIGH = 1e3


# --- held: the five-DOF model comes back -----------------------------------------------------------


def driven(model: Model, state: NDArray, torques: NDArray) -> NDArray[np.float64]:
    """Return the states (samples, size) after each 5 ms of torques (samples, n)."""
    states = []
    for u in torques:
        state = model.advance(state, u, 5e-3)
        states.append(state)
    return np.array(states)


@pytest.mark.parametrize("robot", [alten(FRICTION), four_wheeled(friction=True)], ids=["3", "4"])
def test_infinite_pivot_friction_gives_the_five_dof_model(robot: Robot) -> None:
    """Through smooth motion and stick-slip alike the spin is zero to the bit and all else equal to rounding."""
    rng = np.random.default_rng(33)
    start = np.array([0.1, -0.2, 0.03, -0.02, 0.4, 0.2, -0.1, 0.1, 0.05, 0.5])
    torques = rng.uniform(-0.5, 0.5, (100, robot.wheel_count))
    plain = driven(Model(robot), start, torques)
    pivoting = driven(Model(robot, pivoting=HIGH), np.append(start, 0.0), torques)
    assert_array_equal(pivoting[:, 10], 0.0)
    # 500 steps; differences of rounding, 1e-16, grow with the robot's fall and the wheels' sticking
    assert_allclose(pivoting[:, :10], plain, rtol=0, atol=1e-11)


# --- break-away ------------------------------------------------------------------------------------


def yaw_inertia(robot: Robot) -> tuple[NDArray[np.float64], float]:
    """Return, upright, the mass matrix (2, 2) of (ball's spin, body's yaw rate), and the ball's torque over u.

    By hand: equal wheels turn at kappa (sigma - w), kappa = (r_b / r_w) sin(tilt), about axles that see sin(tilt) of
    the body's yaw; the body's inertia J_0 has the locked wheels in it.
    """
    n, wheels, ball = robot.wheel_count, robot.wheels, robot.ball
    slope = np.sin(wheels.tilt)
    kappa = ball.radius / wheels.radius * slope
    both = n * kappa**2 * (wheels.inertia + reflected_inertia(robot))
    mixed = n * kappa * wheels.inertia * slope
    J = robot.body.inertia_about_ball_center()[2, 2]
    M = np.array([[ball.inertia + both, -both - mixed], [-both - mixed, J + both + 2 * mixed]])
    return M, n * kappa


def held_torque(robot: Robot, u: float) -> float:
    """Return the torque on the ball that pivoting friction must bear, upright at rest under equal torques u."""
    M, gain = yaw_inertia(robot)
    return gain * u * (1.0 + M[0, 1] / M[1, 1])


@given(st.floats(0.005, 3.0), st.floats(1e-9, 0.5), st.booleans(), st.sampled_from([1.0, -1.0]))
def test_the_spin_breaks_away_at_exactly_the_limit(u, excess, beyond, direction):
    """Equal torques on frictionless wheels, from rest (the convex step) and while the heading turns (RK4)."""
    robot = alten()
    limit = held_torque(robot, u) / (1.0 + excess if beyond else 1.0 - excess)
    model = Model(robot, pivoting=limit)
    for heading_rate in (0.0, 0.1):
        start = np.zeros(11)
        start[9] = heading_rate
        end = model.advance(start, np.full(3, direction * u), 1e-3)
        assert (end[10] != 0.0) == beyond
        assert not beyond or np.sign(end[10]) == direction


@given(st.floats(0.01, 0.3), st.floats(0.01, 0.3), st.floats(1e-9, 0.1), st.booleans())
def test_a_whole_robot_at_rest_turns_where_the_weaker_of_wheels_and_pivot_gives_way(dry, u, excess, beyond):
    """Wheels that stick carry the motors' torque back into the body: nothing turns until u passes c + s."""
    friction = replace(FRICTION, coulomb=(0.7 * dry,) * 3, stribeck=(0.3 * dry,) * 3)
    model = Model(alten(friction), pivoting=held_torque(alten(), u))
    torque = dry * (1.0 + excess if beyond else 1.0 - excess)
    end = model.advance(np.zeros(11), np.full(3, torque), 1e-3)
    assert bool(np.any(end != 0.0)) == beyond


def test_a_spinning_ball_is_braked_by_exactly_the_limit_and_stops_for_good() -> None:
    """Without drive or wheels to hold it, the ball loses its spin at limit / inertia, and then has none."""
    robot = alten()
    M, _ = yaw_inertia(robot)
    limit, start = 0.02, np.zeros(11)
    start[10] = 1.0
    model = Model(robot, pivoting=limit)
    braking = np.linalg.solve(M, [-limit, 0.0])[0]
    end = model.advance(start, np.zeros(3), 0.5)
    assert end[10] == pytest.approx(1.0 + 0.5 * braking, abs=1e-12)
    stopped = model.advance(start, np.zeros(3), 1.5 / -braking)
    assert stopped[10] == 0.0
    assert stopped[9] != 0.0  # the wheels' inertia has passed some of it to the body


# --- friction's work, plants and refusals -----------------------------------------------------------


def test_pivoting_model_refuses_unsupported_options() -> None:
    with pytest.raises(InputError, match=r"pivoting friction is -1.*torque in N m"):
        Model(alten(), pivoting=-1.0)
    with pytest.raises(InputError, match="thesis's equations have no pivoting ball"):
        Model(alten(), "thesis", pivoting=0.1)
    with pytest.raises(InputError, match="linearise the model without pivoting"):
        Model(alten(), pivoting=0.1).linearize()
    with pytest.raises(InputError, match="its last dimension must be 10"):
        simulate(Model(alten(), pivoting=0.1), "nominal", "hold", duration=0.1, initial_state=np.zeros(11))
