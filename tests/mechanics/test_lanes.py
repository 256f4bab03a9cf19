"""Robots side by side in lanes: each moves as it does alone, and what is no number stays in its lane."""

from dataclasses import replace

import numpy as np
import pytest

from ballbot import Model
from ballbot.mechanics.engine.lanes import LANES
from ballbot.mechanics.engine.run import Lanes, code_of, simulate_lanes
from ballbot.mechanics.parameters import RIGID_SIZE, WHEEL_SIZE
from tests.support.control_examples import FRICTION, alten, four_wheeled


def kind_of_model(kind: str) -> Model:
    """Return a model of that kind with friction on every contact."""
    if kind == "four wheels":
        return Model(four_wheeled(friction=True))
    if kind == "thesis":
        return Model(alten(FRICTION), formulation="thesis")
    return Model(alten(FRICTION), pivoting=0.02 if kind == "pivoting" else None)


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
    lanes = Lanes(parameters=model.packed[None], initial=np.zeros((2, 10)), torques=torques)
    batch = simulate_lanes(model.selected, lanes, sample_time=0.005, steps=5, lost_lanes=True)
    assert not np.isfinite(batch.states[0, -1]).all()
    assert (batch.states[1] == 0.0).all()
    assert list(batch.ended < 4) == [True, False]


def test_robots_of_different_kinds_have_code_of_their_own() -> None:
    """Their selectors are tuples of the same numbers, which are equal whatever their kinds."""
    exact, thesis = Model(alten(FRICTION)), Model(alten(FRICTION), "thesis")
    assert code_of(exact.selected) != code_of(thesis.selected)
    directed = Model(alten(replace(FRICTION, coulomb_asymmetry=(0.02, -0.01, 0.0))))
    assert code_of(directed.selected) == code_of(exact.selected)
