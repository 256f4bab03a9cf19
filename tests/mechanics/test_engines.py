"""The exact formulation against MuJoCo and Drake, whose models know nothing of rolling or meshing.

Both engines give mass matrix and bias of the mechanism taken apart (`freed_mechanism`); the constraints are imposed in
NumPy (`constraint_elimination`), so that neither their soft contacts nor any equation of `ballbot` takes part.
"""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from typing import NamedTuple

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from ballbot import Model, Robot
from tests.support.constraint_elimination import Freed, Solution, constrained, robot_acceleration
from tests.support.freed_mechanism import Motion, rolling_motion
from tests.support.normal_force import normal_force
from tests.support.symbolic_oracle import random_robot, random_state

# Required: 1e-8. Both sides are float64 and solve well-conditioned systems: 4e-14 was the worst seen
TOLERANCE = 1e-11

STATES = 200

#: an engine's package and the test module that builds the mechanism with it
ENGINES = {"mujoco": "tests.support.mujoco_mechanism", "pydrake": "tests.support.drake_mechanism"}


class Case(NamedTuple):
    """One robot at N states, and what an engine and the constraints make of it."""

    robot: Robot
    q: NDArray[np.float64]
    q_dot: NDArray[np.float64]
    u: NDArray[np.float64]
    motion: Motion
    freed: Freed
    solution: Solution


def case(engine: str, robot: Robot, rng: np.random.Generator, count: int) -> Case:
    """Return a robot at `count` random states in that engine, or skip where it is not installed."""
    pytest.importorskip(engine, reason=f"{engine} is not installed")
    mechanism = import_module(ENGINES[engine])
    states = [random_state(rng, robot.wheel_count) for _ in range(count)]
    q, q_dot, u = (np.array(part) for part in zip(*states, strict=True))
    motion = rolling_motion(robot, q, q_dot, seed=int(rng.integers(2**31)))
    freed = mechanism.freed(robot, motion)
    return Case(robot, q, q_dot, u, motion, freed, constrained(robot, motion, freed, u))


def random_cases(engine: str, wheel_count: int, *, states: int) -> list[Case]:
    """Return 20 random robots that share that many random states."""
    rng = np.random.default_rng(wheel_count)
    return [case(engine, random_robot(rng, wheel_count), rng, states // 20) for _ in range(20)]


def cases(engine: str, kind: str, *, states: int) -> list[Case]:
    """Return the cases of the preset, or of random robots with "3" or "4" wheels."""
    if kind == "alten":
        return [case(engine, Robot.load("alten"), np.random.default_rng(0), states)]
    return random_cases(engine, int(kind), states=states)


def relative_difference(actual: NDArray[np.float64], expected: NDArray[np.float64]) -> float:
    """Return the worst of N rows' largest differences, each over its row's largest value."""
    return float((np.abs(actual - expected).max(axis=1) / np.abs(expected).max(axis=1)).max())


def engine_acceleration(one: Case) -> NDArray[np.float64]:
    return robot_acceleration(one.q, one.q_dot, one.solution.accelerations)


each_engine = pytest.mark.parametrize("engine", list(ENGINES))
each_kind = pytest.mark.parametrize("kind", ["alten", "3", "4"])


@each_engine
@each_kind
def test_accelerations_floor_force_mass_matrix_and_energy_equal_the_engine_s(engine: str, kind: str) -> None:
    """Of the floor's force: it bears the robot. S^T M S with S the motions of unit rates, as an encoder sees them."""
    for one in cases(engine, kind, states=STATES):
        model, M = Model(one.robot, "exact"), one.freed.mass_matrix
        actual = model.acceleration(one.q, one.q_dot, one.u)
        assert relative_difference(actual, engine_acceleration(one)) < TOLERANCE
        # linear momentum: the floor bears the robot with `normal_force`
        upward = normal_force(model, one.q, one.q_dot, one.u)
        weight = (one.robot.ball.mass + one.robot.body.mass) * one.robot.gravity
        assert_allclose(one.solution.floor_force[:, 2], upward, rtol=0, atol=TOLERANCE * weight)
        units = [np.broadcast_to(unit, one.q.shape) for unit in np.eye(5)]
        S = np.stack([rolling_motion(one.robot, one.q, unit, 0).velocities for unit in units], axis=2)
        reduced = np.einsum("kia,kij,kjb->kab", S, M, S)
        assert_allclose(model.mass_matrix(one.q), reduced, rtol=0, atol=TOLERANCE * np.abs(reduced).max())
        nu = one.motion.velocities
        kinetic = np.einsum("ki,kij,kj->k", nu, M, nu) / 2
        at_rest = model.energy(one.q, np.zeros_like(one.q_dot))
        assert_allclose(model.energy(one.q, one.q_dot) - at_rest, kinetic, rtol=TOLERANCE * 10)
        assert_allclose(model.wheel_speed(one.q, one.q_dot), nu[:, 12:], rtol=0, atol=TOLERANCE * 100)


@each_engine
def test_an_error_of_a_wheel_s_inertia_would_show(engine: str) -> None:
    """The comparison distinguishes robots whose wheels alone differ, by one part in a million."""
    one = cases(engine, "alten", states=20)[0]
    wheels = one.robot.wheels
    heavier = replace(wheels, inertia=wheels.inertia * (1 + 1e-6))
    other = Model(one.robot.replace(wheels=heavier)).acceleration(one.q, one.q_dot, one.u)
    assert relative_difference(other, engine_acceleration(one)) > 1e3 * TOLERANCE
