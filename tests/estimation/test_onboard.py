"""The on-board state, the thesis's way, against motions whose answer is known; and what errors are called."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.estimation import OnboardState, Reading, named_estimator
from ballbot.estimation.interface import state_errors
from ballbot.estimation.kalman import KalmanFilter
from ballbot.mechanics.geometry import body_rates_matrix, rotation, transforms
from ballbot.robot import Robot

ALTEN = Robot.load("alten")

states = arrays(np.float64, 10, elements=st.floats(-1.2, 1.2))


def reading_of(state: NDArray[np.float64]) -> Reading:
    """Perfect wheel speeds and gyro of a state: A (z - w) and w, straight from docs/mechanics.md."""
    gyro = body_rates_matrix(*state[2:5]) @ state[7:10]
    omega = np.array([-state[6], state[5], 0.0]) / ALTEN.ball.radius
    speeds = transforms(ALTEN).T_owb @ (rotation(*state[2:5]).T @ omega - gyro)
    return Reading(wheel_angles=np.zeros(3), wheel_speeds=speeds, gyro=gyro, attitude=state[2:5])


@given(states)
def test_perfect_sensors_give_back_the_state(state: NDArray[np.float64]) -> None:
    onboard = OnboardState(ALTEN, sample_time=0.005)
    onboard.reset(position=(state[0], state[1]))
    # rounding of two inverses, the second worst near phi = 1.2
    np.testing.assert_allclose(onboard.update(reading_of(state)), state, atol=1e-12)


def test_position_of_a_circle_driven_while_turning() -> None:
    """One lap of radius 0.5 m in 10 s while the heading turns the other way: x, y stay the world's."""
    onboard = OnboardState(ALTEN, sample_time=0.005)
    onboard.reset()
    speed, times, found = 2 * np.pi / 10, 0.005 * np.arange(2001), []
    for t in times:
        state = np.zeros(10)
        state[4], state[9] = -0.7 * t, -0.7
        state[5], state[6] = 0.5 * speed * np.cos(speed * t), 0.5 * speed * np.sin(speed * t)
        found.append(onboard.update(reading_of(state))[:2].copy())
    place = 0.5 * np.stack([np.sin(speed * times), 1 - np.cos(speed * times)], axis=1)
    # trapezoid's error: h^2/12 times path times speed^2
    np.testing.assert_allclose(found, place, atol=1e-5)


@pytest.mark.parametrize(("name", "kind"), [("onboard", OnboardState), ("kalman", KalmanFilter)])
def test_estimator_is_found_by_name_and_reset_restores_its_initial_state(name, kind) -> None:
    used, fresh = (named_estimator(name, ALTEN, sample_time=0.005) for _ in range(2))
    assert type(used) is kind
    readings = [reading_of(0.1 * np.random.default_rng(seed).normal(size=10)) for seed in range(5)]
    for one in readings:
        used.update(one)
    for one in (used, fresh):
        one.reset(position=(1.0, 2.0))
    for one in readings:
        found = used.update(one)
        assert (found == fresh.update(one)).all()
    np.testing.assert_allclose(found[:2], [1.0, 2.0], atol=0.1)
    with pytest.raises(InputError, match="above 0 s"):
        kind(ALTEN, sample_time=0.0)


def test_unknown_estimator_is_refused_with_the_nearest() -> None:
    with pytest.raises(InputError, match="did you mean 'kalman'"):
        named_estimator("kalmann", ALTEN, sample_time=0.005)  # type: ignore[arg-type]


def test_run_errors_equal_those_added_to_the_truth() -> None:
    t = np.linspace(0.0, 180.0, 1801)
    truth = np.random.default_rng(1).normal(size=(len(t), 10))
    states = truth.copy()
    states[:, 0] += 0.03 * t / 60  # 3 cm a minute
    states[:, 1] -= 0.04 * t / 60  # 4 cm a minute: 5 together
    states[:, 2] += 0.3
    states[:, 3] -= 0.4
    states[:, 4] += 0.1 * np.sin(2 * np.pi * t / 10)
    states[:, 8] += 0.7
    found = state_errors(t, states, truth)
    assert found.position_drift == pytest.approx(0.05)
    assert found.position == pytest.approx(0.15 / np.sqrt(3), rel=1e-3)  # of a ramp to 15 cm
    assert found.lean == pytest.approx(0.5)
    assert found.heading == pytest.approx(0.1 / np.sqrt(2), rel=1e-3)
    assert (found.rate, found.velocity) == (pytest.approx(0.7), 0.0)
    assert np.isnan(state_errors(t[:500], states[:500], truth[:500]).position_drift)
