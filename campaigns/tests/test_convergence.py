"""The order of the whole method: a sample of docs/generated/evidence.md."""

import numpy as np
import pytest
from numpy.typing import NDArray

from ballbot import Model
from ballbot.mechanics.engine.run import Lanes, simulate_lanes
from campaigns.convergence import (
    SAMPLE_TIME,
    changes,
    errors,
    follow,
    observed_order,
    reversing_cases,
    smooth_cases,
    sticking_cases,
    sticks,
)
from tests.support.control_examples import FRICTION, alten, four_wheeled

STEPS = (4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4)


def test_smooth_motion_has_order_four() -> None:
    cases = smooth_cases(np.random.default_rng(61), 4)
    known = follow(cases)
    assert all(changes(one) == 0 for one in known)
    # three steps: at 0.5 ms the error is 2e-13, rounding
    assert observed_order(STEPS[:3], errors(cases, known, STEPS[:3])) == pytest.approx(4.0, abs=0.1)


@pytest.mark.sample
def test_stick_slip_has_order_two_and_small_errors() -> None:
    """Root mean square over motions, because where in a step a sign changes is random."""
    cases = sticking_cases(np.random.default_rng(62), 6)
    known = follow(cases)
    assert all(sticks(one) and changes(one) >= 3 for one in known)
    found = errors(cases, known, STEPS)
    # few motions: one in which two wheels change in one step moves the mean by as much
    assert observed_order(STEPS, found) == pytest.approx(2.1, abs=0.35)
    assert found[2] < 2e-5  # at 1 ms; rad/s, after 0.4 s of an unstable robot


def test_reversals_have_order_two() -> None:
    cases = reversing_cases(np.random.default_rng(63), 2)
    known = follow(cases)
    assert not any(sticks(one) for one in known)
    assert sum(changes(one) for one in known) >= 2
    assert observed_order(STEPS, errors(cases, known, STEPS)) == pytest.approx(2.0, abs=0.1)


@pytest.mark.slow
@pytest.mark.parametrize(
    "model",
    [
        pytest.param(Model(four_wheeled(friction=True)), marks=pytest.mark.sample),
        Model(alten(FRICTION), "thesis"),
    ],
    ids=["four wheels", "thesis"],
)
def test_other_models_have_order_two_against_steps_of_two_microseconds(model: Model) -> None:
    """Torques swing so that wheels stick, break away and turn about; the same motions from 20 starts."""
    rng, n = np.random.default_rng(64), model.robot.wheel_count
    k = np.arange(8)
    torques = np.stack([0.3 * np.sin(0.9 * k + 2.0 * i) for i in range(n)], axis=1)
    starts = np.zeros((20, 5 + model.velocity_count))
    starts[:, 2:10] = [0.01, 0.005, 0, 0.07, -0.05, 0, 0, 0.1] + 0.02 * rng.uniform(-1, 1, (20, 8))

    def ends(step: float) -> NDArray[np.float64]:
        lanes = Lanes(parameters=model.packed[None], initial=starts, torques=torques[None])
        steps = round(SAMPLE_TIME / step)
        run = simulate_lanes(model.selected, lanes, sample_time=SAMPLE_TIME, steps=steps)
        return run.states[:, -1]

    known = ends(2e-6)
    # the median: a ball that passes close by rest turns its friction about in a step, and its motion leads any mean
    found = np.array([np.median(np.abs(ends(step) - known).max(axis=1)) for step in STEPS])
    # 1.6 and 1.7: at 4 ms several contacts change in one step
    assert observed_order(STEPS, found) > 1.5
    assert found[2] < 1e-5
