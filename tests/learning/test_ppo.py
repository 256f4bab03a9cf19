"""The network's slopes, and that a training repeats."""

import numpy as np
import pytest

from ballbot.learning.lanes import TaskLanes
from ballbot.learning.ppo import Adam, Training, backward, forward, new_layers, train
from ballbot.learning.tasks import task_named
from tests.learning.test_lanes import ROBOTS

SMALL = Training(lanes=40, decisions=16, updates=2, batches=4, hidden=8)


def test_slopes_are_those_of_differences():
    random = np.random.default_rng(1)
    layers = [layer.astype(np.float64) for layer in new_layers((5, 7, 6, 2), random, last=1.0)]
    x, weight = random.standard_normal((9, 5)), random.standard_normal((9, 2))
    slopes = backward(layers, forward(layers, x)[1], weight)
    for layer, slope in zip(layers, slopes, strict=True):
        for place in [(0,) * layer.ndim, tuple(size - 1 for size in layer.shape)]:
            found = []
            for step in (1e-5, -1e-5):
                layer[place] += step
                found.append(float((weight * forward(layers, x)[0]).sum()))
                layer[place] -= step
            # central differences: the square of the step, and rounding over it
            assert slope[place] == pytest.approx((found[0] - found[1]) / 2e-5, rel=1e-6, abs=1e-8)


def test_adam_goes_down_to_the_least():
    layer = np.array([3.0, -2.0], np.float32)
    adam = Adam([layer])
    for _ in range(400):
        adam.step([2.0 * (layer - np.array([1.0, 1.0], np.float32))], 0.05)
    np.testing.assert_allclose(layer, 1.0, atol=0.02)


@pytest.mark.parametrize("other", [0, 1])
def test_training_repeats_bit_for_bit_with_its_seed_only(other):
    ends = []
    for seed in (0, other):
        lanes = TaskLanes(ROBOTS, task_named("balance"), lanes=SMALL.lanes, seed=seed)
        *_, last = train(lanes, SMALL, moving=np.eye(3), torque_scale=3.0, seed=seed)
        lanes.close()
        ends.append(b"".join(layer.tobytes() for layer in last.actor))
    assert (ends[0] == ends[1]) == (other == 0)


def test_torques_that_move_nothing_are_not_learned():
    lanes = TaskLanes(ROBOTS, task_named("balance"), lanes=SMALL.lanes, seed=0)
    idle = np.array([1.0, -2.0, 1.0]) / 6.0**0.5
    moving = np.eye(3) - np.outer(idle, idle)
    *_, last = train(lanes, SMALL, moving=moving, torque_scale=3.0, seed=0)
    lanes.close()
    # rounding of single precision
    for layer in last.actor[-2:]:
        np.testing.assert_allclose(layer @ idle, 0.0, atol=1e-6)
