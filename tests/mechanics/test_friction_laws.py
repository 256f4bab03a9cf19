"""Friction laws by themselves: steady curves, closed forms, what holds at rest, what is refused."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ballbot import InputError
from ballbot.mechanics.friction import wheel_friction
from ballbot.mechanics.friction_laws import (
    Armstrong,
    Classical,
    Dahl,
    Smoothed,
    advance,
    follow,
    friction_at,
)
from ballbot.mechanics.friction_laws.interface import crossing
from ballbot.robot import Friction
from tests.support.friction_examples import LAWS, push

SPEEDS = st.floats(0.02, 30.0) | st.floats(-30.0, -0.02)


@pytest.mark.slow
@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
@given(speed=SPEEDS)
@settings(deadline=None, max_examples=40)
def test_long_constant_speed_ends_on_the_steady_curve(law, speed):
    # 2 rad of sliding is many times the longest bending, c/sigma = 2 mrad; and longer than Armstrong's memory
    duration = max(2.0 / abs(speed), 0.1)
    friction = follow(law, np.full(201, speed), sample_time=duration / 200)[-1]
    # Dahl's own approach to c is exponential, and rounding of y = 1 - F/c ends it at 1e-16 of c
    assert friction == pytest.approx(float(law.steady_friction(speed)), rel=1e-12)


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_steady_friction_is_odd_and_acts_against_the_speed(law):
    speeds = np.geomspace(1e-3, 100.0, 60)
    forward = law.steady_friction(speeds)
    assert (forward >= 0.0).all()
    np.testing.assert_array_equal(law.steady_friction(-speeds), -forward)
    assert law.steady_friction(0.0) == 0.0


def test_classical_is_the_robots_law():
    law = LAWS["classical"]
    friction = Friction(
        viscous=(law.viscous,),
        coulomb=(law.coulomb,),
        stribeck=(law.stribeck,),
        stribeck_speed=law.stribeck_speed,
        stribeck_exponent=law.stribeck_exponent,
        rolling=0.0,
    )
    speeds = np.linspace(-5.0, 5.0, 41)[:, None]
    np.testing.assert_allclose(
        [[friction_at(law, w)] for w in speeds[:, 0]], wheel_friction(speeds, friction), rtol=1e-12
    )


@pytest.mark.parametrize("name", ["classical"])
@pytest.mark.parametrize("applied", [0.0, 0.05, -0.16, 0.159999])
def test_at_rest_friction_balances_what_is_applied_up_to_its_limit(name, applied):
    assert friction_at(LAWS[name], 0.0, applied=applied) == applied
    assert friction_at(LAWS[name], 0.0, applied=7.0) == pytest.approx(0.16, rel=1e-15)


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
@pytest.mark.parametrize("seed", range(5))
def test_no_law_gives_energy(law, seed):
    """From rest, whatever the speeds do, the work done against friction is never negative.

    A driveline's LuGre values are those whose friction cannot drive: 0.02 * 0.05/0.11 < 0.014.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(20_000) * 1e-4
    amplitude, frequency, phase = rng.uniform(0.01, 3.0, 5), rng.uniform(1, 60, 5), rng.uniform(0, 6, 5)
    speeds = (amplitude * np.sin(frequency * t[:, None] + phase)).sum(axis=1) * np.minimum(t / 0.05, 1.0)
    friction = follow(law, speeds, sample_time=1e-4)
    power = friction * speeds
    work = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1]) * 1e-4)])
    # quadrature over 0.1 ms of a spring that may swing: second order, and c * w * h = 1e-5 J is one sample's work
    assert work.min() > -1e-5
    assert work[-1] > 0.01


class TestArmstrong:
    law = Armstrong(
        viscous=0.4, coulomb=1.0, stribeck=0.5, stribeck_speed=0.01, stiffness=1e4, memory=0.05, rise_time=0.3
    )

    def test_rest_is_a_spring(self):
        travel = np.linspace(0.0, 1e-4, 50)
        friction = follow(self.law, np.full(50, (travel[1] - travel[0]) / 0.01), sample_time=0.01)
        np.testing.assert_allclose(friction, 1e4 * travel, rtol=1e-12, atol=1e-15)

    @pytest.mark.parametrize("dwell", [0.03, 0.3, 2.0])
    def test_static_friction_rises_with_the_time_at_rest(self, dwell):
        """s(t_2) = s_a + (s_inf - s_a) t_2/(t_2 + gamma), s_a the Stribeck part as it stopped."""
        h = 1e-3
        creeping = 1.1e-4  # past break-away at 1.5 N / 1e4 N/m = 0.15 mm within 2 ms at 0.1 m/s
        rest = round(dwell / h)
        speeds = np.concatenate([np.full(200, 0.1), np.zeros(rest), np.full(2000, creeping)])
        friction = follow(self.law, speeds, sample_time=h)
        peak = 200 + rest + int(np.argmax(friction[200 + rest :]))
        t_2 = (peak - 199) * h  # the peak is the last sample before break-away
        s_a = 0.5 / (1.0 + (0.1 / 0.01) ** 2)
        limit = 1.0 + s_a + (0.5 - s_a) * t_2 / (t_2 + 0.3)
        # the spring grows by k_t * 1.1e-4 * 1 ms = 1.1 mN a sample, the limit by less than 1.4 mN
        assert friction[peak] == pytest.approx(limit, abs=2.5e-3)

    def test_the_stribeck_part_lags_by_the_memory(self):
        h, t = 1e-3, np.arange(3000) * 1e-3
        speeds = 0.02 + 0.015 * np.sin(5.0 * t)
        friction = follow(self.law, speeds, sample_time=h)
        s = 0.5  # after the first rest
        lagging = 0.02 + 0.015 * np.sin(5.0 * (t - 0.05))
        expected = 1.0 + 0.4 * speeds + s / (1.0 + (lagging / 0.01) ** 2)
        # 50 ms is 50 whole samples, so nothing is interpolated
        np.testing.assert_allclose(friction[200:], expected[200:], rtol=1e-12)

    @pytest.mark.slow
    def test_a_mass_swings_on_the_spring_and_breaks_away_at_the_limit(self):
        law = Armstrong(viscous=0.0, coulomb=1.0, stribeck=0.5, stribeck_speed=0.01, stiffness=1e4)
        held = push(law, np.full(3000, 0.7), 1e-3)
        swing = 0.7e-4 * (1.0 - np.cos(100.0 * 1e-3 * np.arange(1, 3001)))
        np.testing.assert_allclose(held[:, 1], swing, atol=1e-15)
        # undamped, a sudden force swings to twice its own deflection: 0.75 N is the most that is held
        assert np.abs(push(law, np.full(3000, 0.7499), 1e-3)[:, 1]).max() < 1.5e-4
        assert push(law, np.full(3000, 0.7501), 1e-3)[-1, 1] > 1.5e-4


class TestSmoothed:
    @pytest.mark.parametrize("sign", ["tanh", "root"])
    def test_creeps_where_the_classical_law_sticks(self, sign):
        law = Smoothed(viscous=0.0, coulomb=1.0, width=1e-4, sign=sign)
        creep = push(law, np.full(2000, 0.7), 1e-3)[-1, 0]
        closed_form = math.atanh(0.7) if sign == "tanh" else 0.7 / math.sqrt(1 - 0.49)
        assert creep == pytest.approx(1e-4 * closed_form, rel=1e-9)
        assert not push(Classical(viscous=0.0, coulomb=1.0), np.full(2000, 0.7), 1e-3)[:, :2].any()


NONSENSE = [
    (Classical, {"viscous": -0.1, "coulomb": 1.0}, "viscous"),
    (Classical, {"viscous": 0.0, "coulomb": math.nan}, "coulomb"),
    (Classical, {"viscous": 0.0, "coulomb": 1.0, "stribeck_speed": 0.0}, "stribeck_speed"),
    (Dahl, {"coulomb": 0.0, "stiffness": 1.0}, "coulomb"),
    (Dahl, {"coulomb": 1.0, "stiffness": 1.0, "shape": -1.0}, "shape"),
    (Smoothed, {"viscous": 0.0, "coulomb": 1.0, "width": 0.0}, "width"),
    (Smoothed, {"viscous": 0.0, "coulomb": 1.0, "width": 0.1, "sign": "step"}, "sign"),
    (
        Armstrong,
        {"viscous": 0, "coulomb": 1, "stribeck": 0, "stribeck_speed": 1, "stiffness": 1, "memory": -1.0},
        "memory",
    ),
]


@pytest.mark.parametrize(("law", "values", "named"), NONSENSE)
def test_impossible_values_are_refused_by_name(law, values, named):
    with pytest.raises(InputError, match=named):
        law(**values)


class TestDahl:
    @pytest.mark.parametrize("shape", [0.5, 1.0, 1.5, 2.0])
    def test_hysteresis_in_closed_form(self, shape):
        """F(x) from reversal to reversal; `follow` sees speeds only, at any rate."""
        law = Dahl(coulomb=1.5, stiffness=300.0, shape=shape)
        legs = [0.004, -0.009, 0.006, -0.002]
        for pace in (0.01, 3.0):
            F = 0.0
            state = law.initial_state(1.0)
            for leg in legs:
                s = math.copysign(1.0, leg)
                y, kappa = 1.0 - s * F / 1.5, 300.0 * abs(leg) / 1.5
                if shape == 1.0:
                    y *= math.exp(-kappa)
                else:
                    y = max(y ** (1.0 - shape) + (shape - 1.0) * kappa, 0.0) ** (1.0 / (1.0 - shape))
                F = s * 1.5 * (1.0 - y)
                for _ in range(5):
                    state = advance(law, state, speed=s * pace, step=abs(leg) / pace / 5)
                assert friction_at(law, 0.0, state=state) == pytest.approx(F, rel=1e-12)

    @pytest.mark.parametrize("shape", [0.5, 1.0, 2.0])
    def test_slope_is_that_of_the_equation(self, shape):
        law = Dahl(coulomb=1.5, stiffness=300.0, shape=shape)
        for F in (-1.4, -0.5, 0.0, 0.9, 1.3):
            forces = [
                friction_at(law, 0.0, state=advance(law, np.array([F / 300.0]), speed=1.0, step=x))
                for x in (1e-7, 2e-7)
            ]
            slope = (forces[1] - forces[0]) / 1e-7
            assert slope == pytest.approx(300.0 * (1.0 - F / 1.5) ** shape, rel=1e-3)

    def test_force_never_exceeds_coulombs(self):
        law = Dahl(coulomb=1.5, stiffness=300.0, shape=0.3)
        rng = np.random.default_rng(3)
        friction = follow(law, rng.normal(size=3000), sample_time=0.01)
        assert np.abs(friction).max() <= 1.5 * (1.0 + 1e-15)


def test_follow_refuses_invalid_histories():
    with pytest.raises(InputError, match="speeds"):
        follow(LAWS["dahl"], np.zeros((2, 2)), sample_time=0.1)
    with pytest.raises(InputError, match="sample time"):
        follow(LAWS["dahl"], np.zeros(2), sample_time=0.0)


@given(st.floats(0.01, 0.99), st.sampled_from([1e-300, 1e-200, 1e-160, 1.0, 1e100, 1e200]))
def test_crossing_is_found_at_any_scale(root, scale):
    # the squares of the function's values underflow or overflow at most of these scales
    found = crossing.py_func(lambda x, context: scale * (x**3 - context), root**3, 0.0, 1.0)
    # x^3 - root^3 is rounded by an ulp of root^3, of which x is a third
    assert found == pytest.approx(root, rel=1e-14)
