"""The exact formulation, and that with a ball that pivots, against MuJoCo and Drake, which know nothing of rolling.

Both engines give mass matrix and bias of the mechanism taken apart (`freed_mechanism`); the constraints are imposed in
NumPy (`constraint_elimination`), so that neither their soft contacts nor any equation of `ballbot` takes part.
"""

from importlib import import_module

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from ballbot import Model, Robot
from ballbot.simulation.model_plant import sinking_and_speeds
from tests.support.constraint_elimination import NO_PIVOT, constrained, robot_acceleration
from tests.support.freed_mechanism import rolling_motion
from tests.support.symbolic_oracle import random_robot, random_state

# Required: 1e-8. Both sides are float64 and solve well-conditioned systems: 4e-14 was the worst seen
TOLERANCE = 1e-11

STATES = 200

#: an engine's package and the test module that builds the mechanism with it
ENGINES = {"mujoco": "tests.support.mujoco_mechanism", "pydrake": "tests.support.drake_mechanism"}


def relative_difference(actual: NDArray[np.float64], expected: NDArray[np.float64]) -> float:
    """Return the worst of N rows' largest differences, each over its row's largest value."""
    return float((np.abs(actual - expected).max(axis=1) / np.abs(expected).max(axis=1)).max())


@pytest.mark.parametrize("pivots", [False, pytest.param(True, marks=pytest.mark.slow)])
@pytest.mark.parametrize("engine", list(ENGINES))
@pytest.mark.parametrize("kind", ["alten", "3", "4"])
def test_accelerations_floor_force_mass_matrix_and_energy_equal_the_engine_s(engine, kind, pivots):
    """Of the thesis's robot, or of 20 random ones with so many wheels; the ball may have a spin of its own.

    The floor's force bears the robot. S^T M S with S the motions of unit rates, as an encoder sees them.
    """
    pytest.importorskip(engine, reason=f"{engine} is not installed")
    rng = np.random.default_rng(31)
    robots = [Robot.load("alten")] if kind == "alten" else [random_robot(rng, int(kind)) for _ in range(20)]
    for robot in robots:
        states = [random_state(rng, robot.wheel_count) for _ in range(STATES // len(robots))]
        q, q_dot, u = (np.array(part) for part in zip(*states, strict=True))
        if pivots:
            q_dot = np.column_stack([q_dot, rng.uniform(-3, 3, len(q))])
        model, motion = (
            Model(robot, pivoting=0.0 if pivots else None),
            rolling_motion(robot, q, q_dot, seed=1),
        )
        freed = import_module(ENGINES[engine]).freed(robot, motion)
        solution = constrained(robot, motion, freed, u, released=(NO_PIVOT,) if pivots else ())
        expected = robot_acceleration(q, q_dot, solution.accelerations)
        if pivots:
            expected = np.column_stack([expected, solution.accelerations[:, 5]])
        assert relative_difference(model.acceleration(q, q_dot, u), expected) < TOLERANCE
        if robot.wheel_count == 3 and not pivots:  # other robots' would be compiled for this alone
            states = zip(np.column_stack([q, q_dot]), u, strict=True)
            sinking = [sinking_and_speeds(model.selected, model.packed, *one)[0] for one in states]
            # linear momentum: the floor bears the weight, less what the body's centre of mass sinks by
            upward = robot.weight - robot.body.mass * robot.body.center_of_mass * np.array(sinking)
            assert_allclose(solution.floor_force[:, 2], upward, rtol=0, atol=TOLERANCE * robot.weight)
        units = [np.broadcast_to(unit, q_dot.shape) for unit in np.eye(q_dot.shape[1])]
        S = np.stack([rolling_motion(robot, q, unit, 0).velocities for unit in units], axis=2)
        reduced = np.einsum("kia,kij,kjb->kab", S, freed.mass_matrix, S)
        assert_allclose(model.mass_matrix(q), reduced, rtol=0, atol=TOLERANCE * np.abs(reduced).max())
        nu = motion.velocities
        kinetic = np.einsum("ki,kij,kj->k", nu, freed.mass_matrix, nu) / 2
        at_rest = model.energy(q, np.zeros_like(q_dot))
        assert_allclose(model.energy(q, q_dot) - at_rest, kinetic, rtol=TOLERANCE * 10)
        assert_allclose(model.wheel_speed(q, q_dot), nu[:, 12:], rtol=0, atol=TOLERANCE * 100)
