"""The metrics of closed-loop runs against closed forms, on logs made by hand."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ballbot import InputError
from ballbot.log import STATE_NAMES
from ballbot.report.run import run_verdict
from ballbot.workflows.metrics import (
    BAND,
    HIGH_FREQUENCY,
    Rules,
    energy,
    heading_error,
    high_frequency_torque,
    position_error,
    rms_speed_error,
    run_results,
    score,
    settled,
    settling_time,
    stop_of,
    top_speed,
)
from tests.support.league_examples import made_log

SAMPLE = 0.005


def test_errors_count_once_settled():
    log = made_log(rate=10.0, ref_x=lambda t: np.where(t < 10.0, 0.0, 1.0))
    np.testing.assert_array_equal(np.flatnonzero(settled(log, 6.0)), [*range(60, 100), *range(160, 200)])


def test_errors_of_a_robot_that_swings():
    log = made_log(duration=12.0, x=lambda t: 0.3 * np.sin(np.pi * t), psi=lambda t: 0.2 * np.cos(np.pi * t))
    found = score(log, Rules(settle=2.0))  # five whole swings count
    assert found.peak_position_error == pytest.approx(0.3)
    assert found.rms_position_error == pytest.approx(0.3 / np.sqrt(2.0))
    assert found.peak_heading_error == pytest.approx(0.2)


@settings(deadline=None, max_examples=30)
@given(away=st.floats(-3.1, 3.1), turns=st.integers(-3, 3))
def test_whole_turns_are_no_heading_error(away, turns):
    log = made_log(duration=0.1, psi=1.0 + away + 2.0 * np.pi * turns, ref_psi=1.0)
    np.testing.assert_allclose(heading_error(log), abs(away), atol=1e-12)


def test_truth_counts_where_there_is_one():
    truth = {f"true_{name}": 0.0 for name in STATE_NAMES} | {"true_x": 0.1, "true_psi": -0.2}
    log = made_log(**truth)
    np.testing.assert_allclose(position_error(log), 0.1)
    np.testing.assert_allclose(heading_error(log), 0.2)


@settings(deadline=None, max_examples=30)
@given(size=st.floats(0.06, 2.0), time_constant=st.floats(0.2, 1.5), jump=st.floats(2.0, 6.0))
def test_settling_of_an_exponential(size, time_constant, jump):
    """e(t) = size exp(-(t - jump) / T) is within the band from T ln(size / band) on."""

    def distance(t):
        return np.where(t < jump, 0.0, size * np.exp(-(t - jump) / time_constant))

    log = made_log(
        x=lambda t: np.where(t < jump, 0.0, 1.0) + distance(t), ref_x=lambda t: np.where(t < jump, 0.0, 1.0)
    )
    longest, always = settling_time(log)
    assert always
    # the jump and the arrival are each seen at a sample
    assert longest == pytest.approx(time_constant * np.log(size / BAND), abs=2.0 * SAMPLE)


def test_the_longest_settling_of_a_run_counts():
    def x(t):
        return np.where((t >= 5.0) & (t < 6.0), 0.2, 0.0) + np.where((t >= 12.0) & (t < 15.0), 0.2, 0.0)

    assert settling_time(made_log(x=x)) == (pytest.approx(15.0, abs=2 * SAMPLE), True)
    found = settling_time(made_log(x=x), disturbed=[5.0, 12.0])
    assert found == (pytest.approx(3.0, abs=2 * SAMPLE), True)
    assert settling_time(made_log(x=lambda t: 0.2 * x(t)), disturbed=[5.0, 12.0]) == (0.0, True)
    # times outside of the run disturb nothing
    assert settling_time(made_log(x=x), disturbed=[5.0, 12.0, 40.0]) == found


def test_robot_that_never_settles_is_reported():
    longest, always = settling_time(made_log(x=lambda t: np.where(t < 8.0, 0.0, 0.1)), disturbed=[6.0])
    assert longest == pytest.approx(14.0, abs=2 * SAMPLE)
    assert not always


@settings(deadline=None, max_examples=30)
@given(frequency=st.floats(0.2, 90.0), size=st.floats(0.01, 5.0), offset=st.floats(-5.0, 5.0))
def test_high_frequency_torque_of_a_sine(frequency, size, offset):
    """A digital Butterworth filter of order 2, both ways, keeps 1 / (1 + (w_c / w)^4), w = tan(pi f / f_s)."""

    def torque(t):
        return offset + size * np.sin(2.0 * np.pi * frequency * t)

    found = high_frequency_torque(made_log(u1=torque, u2=torque, u3=torque))
    ratio = np.tan(np.pi * HIGH_FREQUENCY * SAMPLE) / np.tan(np.pi * frequency * SAMPLE)
    expected = size / np.sqrt(2.0) / (1.0 + ratio**4)
    # the 20 s are no whole number of periods, and at the ends the filter settles within a few hundredths of a second
    assert found == pytest.approx(expected, rel=0.03, abs=2e-3 * (size + abs(offset)))


def test_too_low_sample_rate_for_roughness_is_reported():
    with pytest.raises(InputError, match="sampled at 20 Hz"):
        high_frequency_torque(made_log(rate=20.0))
    assert np.isnan(score(made_log(rate=20.0)).high_frequency_torque)
    assert high_frequency_torque(made_log(duration=0.01, u1=1.0)) == pytest.approx(0.0, abs=1e-9)


@settings(deadline=None, max_examples=30)
@given(torque=st.floats(-3.0, 3.0), speed=st.floats(-20.0, 20.0))
def test_energy_of_a_steady_wheel(torque, speed):
    exchanged = energy(made_log(u2=torque, wheel2=lambda t: speed * t))
    seconds = 20.0 - SAMPLE  # the last row's torque does no work in the log
    assert exchanged == pytest.approx(abs(torque * speed) * seconds, abs=1e-9)


def test_fall_is_counted():
    log = made_log(duration=2.0, ended="fallen: lean past 0.6 rad at t = 2.000 s", u1=1.0)
    found = score(log)
    assert np.isnan([found.peak_position_error, found.rms_position_error, found.peak_heading_error]).all()
    assert found.ended == log.ended
    assert not found.arrived
    assert found.rms_torque == pytest.approx(np.sqrt(1.0 / 3.0))


def test_too_short_run_is_reported():
    with pytest.raises(InputError, match="30 s after the start"):
        score(made_log(), Rules(settle=30.0))


@pytest.mark.parametrize(("duration", "seconds"), [(4.0, None), (20.0, 14.0)])
def test_results_of_a_run_have_the_errors_once_settled_and_of_the_whole_run(duration, seconds):
    """The error shrinks by 0.1 m/s from 2 m; the robot leans by 0.3 rad in one axis and 0.4 in the other."""
    made = made_log(duration=duration, x=lambda t: 0.1 * (20.0 - t), theta=0.3, phi=0.4, u2=-0.7)
    found = run_results(made)
    assert found["peak_position_error_whole_run"] == pytest.approx(2.0)
    assert found["final_position_error"] == pytest.approx(0.1 * (20.0 - made.t[-1]))
    assert found["peak_lean"] == pytest.approx(np.arccos(np.cos(0.3) * np.cos(0.4)))
    assert found["peak_torque"] == 0.7
    assert found["rms_torque"] == pytest.approx(0.7 / np.sqrt(3.0))
    assert found.get("peak_position_error") == (seconds and pytest.approx(0.1 * seconds))
    assert ("settling_time" in found) == (seconds is not None)
    ((_, _), (heading, words)) = run_verdict(made)
    assert heading == "Distance from the reference"
    assert words.startswith("1400 mm at most" if seconds else "Not rated, as the run is shorter than")


@settings(deadline=None, max_examples=30)
@given(
    speed=st.floats(0.3, 3.0),
    heading=st.floats(-3.0, 3.0),
    braking=st.floats(0.5, 3.0),
    back=st.floats(0.0, 0.3),
)
def test_stop_at_an_even_deceleration(speed, heading, braking, back):
    """v = v_0 - a t until it has gone back by so much; then it stands. The way is v_0^2 / 2 a."""
    turn, way = speed / braking, 0.5 * speed**2 / braking
    rest = turn + np.sqrt(2.0 * back / braking)

    def along(t):
        since = np.clip(t - 5.0, 0.0, rest)
        return np.minimum(t - 5.0, 0.0) * speed + speed * since - 0.5 * braking * since**2

    def velocity(t):
        return np.where(t < 5.0, speed, np.where(t < 5.0 + rest, speed - braking * (t - 5.0), 0.0))

    c, s = np.cos(heading), np.sin(heading)
    log = made_log(
        x=lambda t: c * along(t),
        y=lambda t: s * along(t),
        x_dot=lambda t: c * velocity(t),
        y_dot=lambda t: s * velocity(t),
    )
    stop = stop_of(log, 5.0)
    assert stop["rested"]
    # half a sample's way at the turn
    assert stop["stopping_distance"] == pytest.approx(max(way, back - way), abs=1e-4)
    assert stop["overshoot"] == pytest.approx(back, abs=1e-4)
    # at rest once slower than 0.1 m/s for good: before the turn, or, if it goes back faster, at the end
    slow = rest if np.sqrt(2.0 * braking * back) > 0.1 else turn - 0.1 / braking
    assert stop["stopping_time"] == pytest.approx(slow, abs=2.0 * SAMPLE)
    assert not stop_of(made_log(x_dot=0.2), 5.0)["rested"]


def test_speeds_of_a_robot_that_lags():
    """It goes at 1.5 m/s where 1 m/s is asked; the second of a fall, three times as fast, does not count."""

    def x(t):
        return 1.5 * t + 3.0 * np.maximum(t - 19.0, 0.0)

    log = made_log(x=x, x_dot=1.5, ref_x=lambda t: t, ended="fallen")
    assert top_speed(log) == pytest.approx(1.5)
    assert rms_speed_error(log) == pytest.approx(0.5)
    assert top_speed(made_log(x=x)) == pytest.approx(4.5, rel=0.01)  # the last second begins a sample earlier
