"""Samples without a valid state: the law, each of its parts and the estimators bridge them and forget them."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from ballbot.control.controller import Controller
from ballbot.control.interface import LARGEST_STATE
from ballbot.control.parts import KINDS, Parts
from ballbot.errors import InputError
from ballbot.estimation.interface import Estimator, Reading
from ballbot.estimation.kalman import KalmanFilter
from ballbot.estimation.onboard import OnboardState
from tests.support.control_examples import FRICTION, alten, everything, leaning

ROBOT = alten(FRICTION)
#: every part with those that it needs, none, and all of them together
PARTS = (*KINDS, "none", "all")
INVALID = (np.nan, np.inf, -np.inf, 2.0 * LARGEST_STATE)
H = ROBOT.sensors.sample_time


@cache
def whole() -> Controller:
    return everything(ROBOT)


def with_parts(name: str) -> Controller:
    parts = whole().parts
    if name != "all":
        kept = () if name == "none" else (name, *KINDS[name].needs)
        parts = Parts(**{one: getattr(parts, one) for one in kept})
    return whole().with_parts(parts)


def swaying(k: int) -> NDArray[np.float64]:
    """Return a state that moves in all ten numbers."""
    return 0.05 * np.sin(0.1 * k + np.arange(10.0)) + 0.01 * np.cos(0.37 * k)


def moving(k: int) -> NDArray[np.float64]:
    return np.array([0.1 * np.sin(0.02 * k), 0.002 * k, 0, 0, 0.001 * k, 0, 0, 0, 0, 0])


@pytest.mark.parametrize("name", PARTS)
def test_invalid_sample_gives_zero_torque_and_leaves_the_state_unchanged(name):
    """Each of the ten numbers, invalid in each way: later torques are those of a law that never saw it."""
    seeing, clean = with_parts(name), with_parts(name)
    for k in range(60):
        bad = swaying(k)
        bad[k % 10] = INVALID[k % len(INVALID)]
        before = seeing._memory.copy()
        assert (seeing.update(k * H, bad, moving(k)) == 0.0).all()
        np.testing.assert_array_equal(seeing._memory, before)
        after = seeing.update(k * H, swaying(k), moving(k))
        np.testing.assert_array_equal(after, clean.update(k * H, swaying(k), moving(k)))
        assert (after != 0.0).any()


def test_refused_reference_leaves_the_state_unchanged():
    without, controller = with_parts("none"), with_parts("all")
    for one in (without, controller):
        one.update(0.0, swaying(0), moving(0))
    before = without._memory.copy()
    with pytest.raises(InputError, match="asks for theta"):
        without.update(H, swaying(1), leaning(0.1))
    np.testing.assert_array_equal(without._memory, before)
    before = controller._memory.copy()
    with pytest.raises(InputError, match="The reference holds a value that is not finite"):
        controller.update(H, swaying(1), np.full(10, np.nan))
    np.testing.assert_array_equal(controller._memory, before)


def reading(k: int) -> Reading:
    """Return what the sensors say of a robot that sways."""
    s = 0.02 * np.sin(0.05 * k)
    angles = 0.03 * k + np.array([s, -s, 0.5 * s])
    return Reading(
        wheel_angles=angles,
        wheel_speeds=np.array([0.03, 0.03, 0.03]) / H,
        gyro=np.array([0.01, 0.02, 0.0]) * np.cos(0.05 * k),
        attitude=np.array([s, 0.5 * s, 0.0]),
    )


ESTIMATORS = {"kalman": KalmanFilter, "onboard": OnboardState}
LOST = ("wheel_angles", "wheel_speeds", "gyro", "attitude")


def started(kind: str) -> Estimator:
    estimator = ESTIMATORS[kind](ROBOT, sample_time=H)
    for k in range(50):
        estimator.update(reading(k))
    return estimator


@pytest.mark.slow
@pytest.mark.parametrize("kind", ESTIMATORS)
@pytest.mark.parametrize("bad", [np.nan, 2.0 * LARGEST_STATE])
@pytest.mark.parametrize("lost", [*((name,) for name in LOST), LOST])
def test_an_estimator_predicts_over_what_is_missing(kind, bad, lost):
    """Two samples without some or all values: never NaN, near the state of whole readings, and soon the same again."""
    estimator, whole = started(kind), started(kind)
    for k in range(50, 300):
        one = reading(k)
        if k in (50, 51):
            holes = {name: getattr(one, name).copy() for name in lost}
            for values in holes.values():
                values[k % 3] = bad
            one = replace(one, **holes)
            assert not one.whole
        found, expected = estimator.update(one), whole.update(reading(k))
        # two samples of at most 0.1 rad/s^2 and 0.3 m/s^2
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=0.02)
    np.testing.assert_allclose(found[2:], expected[2:], rtol=0.0, atol=1e-3)


@pytest.mark.parametrize("kind", ESTIMATORS)
def test_there_is_no_state_before_the_first_whole_reading(kind):
    estimator, fresh = (ESTIMATORS[kind](ROBOT, sample_time=H) for _ in range(2))
    lost = replace(reading(0), gyro=np.array([0.0, np.nan, 0.0]))
    assert np.isnan(estimator.update(lost)).all()
    np.testing.assert_array_equal(estimator.update(reading(0)), fresh.update(reading(0)))
