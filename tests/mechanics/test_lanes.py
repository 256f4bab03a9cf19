"""A block of robots in short loops over lanes against one robot's step in one piece, and robots among others."""

from dataclasses import replace

import numpy as np
import pytest
from numba import njit

from ballbot import Model, Robot
from ballbot.mechanics.engine.compiled import FAST
from ballbot.mechanics.engine.lanes import (
    LANES,
    MARGIN,
    MAX_PARAMETERS,
    ROWS,
    STATE,
    STEP,
    TORQUE,
    TRIAL,
    load,
)
from ballbot.mechanics.engine.run import Lanes, code_of, load_state, load_torques, simulate_lanes
from ballbot.mechanics.engine.smooth import begin_steps, smooth_block
from ballbot.mechanics.parameters import RIGID_SIZE, WHEEL_SIZE, row_size, selector
from ballbot.robot import Wheels
from ballbot.robot.friction_law import MOST_PARAMETERS
from benchmarks.operations import runge_kutta_step
from tests.support.control_examples import FRICTION, alten


@njit(error_model="numpy", fastmath=FAST)
def _in_one_piece(selected, work, lane):
    """The step of one robot, in one piece."""
    P, state, u = (
        load(selected, work, lane),
        load_state(selected, work, lane),
        load_torques(selected, work, lane),
    )
    return runge_kutta_step(selected, P, state, u, work[STEP * LANES + lane])


@njit
def _in_a_block(selected, work, width):
    begin_steps(selected, work, width)
    smooth_block(selected, work, width)


FOUR = Wheels(
    radius=0.063,
    inertia=1e-3,
    tilt=np.pi / 4,
    azimuths=tuple(np.pi / 2 * np.arange(4)),
    rollers=Robot.load("alten").wheels.rollers,
)


def kind_of_model(kind: str) -> Model:
    """Return a model of that kind with friction on every contact."""
    robot = Robot.load("alten").replace(friction=FRICTION)
    if kind == "four wheels":
        four = {name: (*getattr(FRICTION, name), 0.01) for name in ("viscous", "coulomb", "stribeck")}
        return Model(robot.replace(wheels=FOUR, friction=replace(FRICTION, **four)))
    if kind == "thesis":
        return Model(robot, formulation="thesis")
    return Model(robot, pivoting=0.02 if kind == "pivoting" else None)


#: each other kind compiles forms of its own
OTHER_KINDS = [pytest.param(kind, marks=pytest.mark.sample) for kind in ("thesis", "pivoting", "four wheels")]
kinds = pytest.mark.parametrize("kind", ["exact", *OTHER_KINDS])


def random_states(count: int, size: int, rng: np.random.Generator) -> np.ndarray:
    """Return states (count, size) from upright to nearly fallen, slow to fast."""
    states = np.zeros((count, size))
    states[:, 2:4] = rng.uniform(-1.1, 1.1, (count, 2))
    states[:, 4] = rng.uniform(-3, 3, count)
    states[:, 5:] = rng.normal(size=(count, size - 5)) * 10.0 ** rng.uniform(-3, 0.5, (count, 1))
    return states


def rows_like(model: Model, count: int, rng: np.random.Generator) -> np.ndarray:
    """Return packed parameters (count, ..), each robot its own: viscous friction and mass change."""
    rows = np.tile(model.packed, (count, 1))
    first = RIGID_SIZE + WHEEL_SIZE * np.arange(model.robot.wheel_count) + 3
    rows[:, first] *= rng.uniform(0.5, 2.0, (count, len(first)))
    rows[:, 2] *= rng.uniform(1.0, 1.2, count)
    return rows


@pytest.mark.slow
@kinds
def test_the_stages_of_a_block_are_the_step_in_one_piece(kind: str) -> None:
    rng = np.random.default_rng(5)
    model = kind_of_model(kind)
    size, n = 5 + model.velocity_count, model.robot.wheel_count
    work = np.zeros(ROWS * LANES)
    lanes = work.reshape(ROWS, LANES)
    lanes[: len(model.packed)] = rows_like(model, LANES, rng).T
    lanes[STATE : STATE + size] = random_states(LANES, size, rng).T
    lanes[STATE + 5 : STATE + size, :4] = 0.0  # at rest: no trial of theirs counts
    lanes[TORQUE : TORQUE + n] = rng.normal(size=(n, LANES))
    lanes[STEP] = 1e-3
    _in_a_block(model.selected, work, LANES)
    counted = set()
    for lane in range(LANES):
        end, margin = _in_one_piece(model.selected, work, lane)
        # the same operations, summed in another order: rounding, relative to each state's largest number
        assert np.abs(lanes[TRIAL : TRIAL + size, lane] - end).max() < 1e-14 * np.abs(end).max()
        assert (lanes[MARGIN, lane] > 0.0) == (margin > 0.0)
        counted.add(bool(margin > 0.0))
    assert counted == {True, False}


@kinds
def test_a_robot_s_motion_does_not_depend_on_its_neighbours(kind: str) -> None:
    """Robots that slide, stick and fall, sorted within their blocks by what they do, against each one alone."""
    rng = np.random.default_rng(6)
    model = kind_of_model(kind)
    size, n = 5 + model.velocity_count, model.robot.wheel_count
    robots = LANES + 5  # a whole block and one with empty lanes
    starts = random_states(robots, size, rng)
    starts[:, 2:] *= rng.choice([0.0, 0.01, 1.0], (robots, 1))  # some at rest
    starts[0, 2], starts[0, 7] = 1.1, 5.0  # one that falls
    torques = rng.normal(size=(robots, 20, n)) * rng.choice([0.0, 0.1, 1.0], (robots, 1, 1))
    rows = rows_like(model, robots, rng)
    common = {"sample_time": 0.005, "steps": 5}
    lanes = Lanes(parameters=rows, initial=starts, torques=torques)
    together = simulate_lanes(model.selected, lanes, **common)
    assert together.ended.min() < 20 <= together.ended.max()
    assert (together.states[:, -1] == starts).all(axis=1).any()  # one that rested throughout
    for i in range(robots):
        one = replace(lanes, **{f"{name}_of": np.array([i]) for name in ("parameter", "initial", "torque")})
        alone = simulate_lanes(model.selected, one, **common)
        assert alone.ended[0] == together.ended[i]
        # one lane's code rounds elsewhere than eight's; 100 steps of an unstable robot let it grow a hundredfold
        assert np.abs(alone.states[0] - together.states[i]).max() < 1e-10 * np.abs(starts[i]).max(initial=1.0)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_nan_in_one_lane_is_flagged_and_leaves_other_lanes_unchanged(bad: float) -> None:
    """Torques that are no numbers, once, on a robot at rest: that one is lost, and the other keeps standing."""
    model = kind_of_model("exact")
    torques = np.zeros((2, 4, 3))
    torques[0, 0] = bad
    batch = simulate_lanes(
        model.selected,
        Lanes(parameters=model.packed[None], initial=np.zeros((2, 10)), torques=torques),
        sample_time=0.005,
        steps=5,
        lost_lanes=True,
    )
    assert not np.isfinite(batch.states[0, -1]).all()
    assert (batch.states[1] == 0.0).all()
    assert list(batch.ended < 4) == [True, False]


def test_the_largest_robot_fills_the_rows_of_a_lane() -> None:
    assert row_size(selector("exact", 4)) + 4 * MOST_PARAMETERS == MAX_PARAMETERS


def test_robots_of_different_kinds_have_code_of_their_own() -> None:
    """Their selectors are tuples of the same numbers, which are equal whatever their kinds."""
    exact, thesis = Model(alten(FRICTION)), Model(alten(FRICTION), "thesis")
    assert code_of(exact.selected) != code_of(thesis.selected)
    directed = Model(alten(replace(FRICTION, coulomb_asymmetry=(0.02, -0.01, 0.0))))
    assert code_of(directed.selected) == code_of(exact.selected)
