"""Margins of a sampled loop, against closed forms, Nyquist's criterion and a finer simulation."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from ballbot.control.lqr import held
from ballbot.control.margins import Loop, loop_margins
from ballbot.control.presets import design_gain, design_integral_gain, loop_of
from ballbot.robot import Robot


def unstable_pole(gain: float, sample_time: float) -> Loop:
    """Return the loop x_dot = x + u, u = -gain x."""
    one = np.ones((1, 1))
    return Loop(A=one, B=one, K=gain * one, sample_time=sample_time)


@pytest.fixture(scope="module")
def nominal():
    robot = Robot.load("alten")
    return loop_of(robot, design_gain(robot))


@settings(max_examples=20)
@given(gain=st.floats(1.5, 20.0), sample_time=st.floats(0.002, 0.02))
def test_margins_of_one_unstable_pole_are_those_of_the_closed_form(gain, sample_time):
    found = loop_margins(unstable_pole(gain, sample_time))
    G = np.expm1(sample_time)
    # |exp(T) - g K (exp(T) - 1)| = 1; a bracket of a tenth halved 16 times leaves 2e-6
    assert found.least_gain == pytest.approx(1.0 / gain, rel=1e-5)
    assert found.greatest_gain == pytest.approx((np.exp(sample_time) + 1.0) / (gain * G), rel=1e-5)


@settings(max_examples=20)
@given(gain=st.floats(2.0, 8.0), sample_time=st.floats(0.01, 0.05))
def test_delays_of_whole_samples_are_stable_as_nyquist_says(gain, sample_time):
    loop = unstable_pole(gain, sample_time)
    G = np.expm1(sample_time)

    def open_loop(w: float) -> complex:
        return gain * G / (np.exp(1j * w * sample_time) - np.exp(sample_time))

    crossing = brentq(lambda w: abs(open_loop(w)) - 1.0, 1e-6, np.pi / sample_time)
    margin = (np.pi + np.angle(open_loop(crossing))) / crossing
    samples = int(margin / sample_time)
    assert loop.is_stable(delay=samples * sample_time)
    assert not loop.is_stable(delay=(samples + 1) * sample_time)
    assert samples * sample_time <= loop_margins(loop).delay <= (samples + 1) * sample_time


@pytest.mark.parametrize("quarters", [0, 1, 4, 7])
def test_a_delayed_loop_moves_as_one_simulated_in_quarters_of_a_sample(nominal, quarters):
    T, (m, n) = nominal.sample_time, nominal.B.shape
    F, G = held(nominal.A, nominal.B, T / 4)
    start = np.random.default_rng(0).normal(size=m)
    x, commands, expected = start, [], []
    for k in range(12):
        commands.append(-nominal.K @ x)
        for quarter in range(4):
            when = 4 * k + quarter - quarters
            x = F @ x + G @ (commands[when // 4] if when >= 0 else np.zeros(n))
        expected.append(x)
    closed = nominal.closed(delay=quarters * T / 4)
    state, found = np.concatenate([start, np.zeros(len(closed) - m)]), []
    for _ in range(12):
        state = closed @ state
        found.append(state[:m])
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("precise", [False, True])
def test_the_open_loop_is_minus_one_where_a_gain_margin_ends(precise):
    robot = Robot.load("alten")
    loop = loop_of(robot, design_integral_gain(robot) if precise else design_gain(robot))
    found = loop_margins(loop)
    assert 0.0 < found.least_gain < 1.0 < found.greatest_gain
    frequencies = np.append(np.geomspace(0.01, 0.5 / loop.sample_time, 20_000), 0.5 / loop.sample_time)
    for factor in (found.least_gain, found.greatest_gain):
        # between two frequencies the locus moves by about 1e-3
        assert np.abs(1.0 + factor * loop.responses(frequencies)).min() < 5e-3


def test_a_step_arrives_without_a_lean_or_a_torque_left(nominal):
    states, torques = nominal.step(0, 0.1, 30.0)
    np.testing.assert_allclose(states[0], 0.0)
    np.testing.assert_allclose(torques[0], nominal.K[:, 0] * 0.1)
    # exp(-slowest * 30 s) is below 1e-6 of the step
    np.testing.assert_allclose(states[-1], np.eye(10)[0] * 0.1, atol=1e-6)
    np.testing.assert_allclose(torques[-1], 0.0, atol=1e-5)
    assert nominal.slowest == pytest.approx(
        float(-design_gain(Robot.load("alten")).poles.real.max()), rel=1e-6
    )
