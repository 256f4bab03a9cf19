"""Friction laws by themselves: steady curves, closed forms, what holds at rest, what is refused."""

import math
from dataclasses import replace

import numpy as np
import pytest
from friction_examples import LAWS, PAPER_LUGRE, pull_by_spring, push
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from ballbot import InputError
from ballbot.mechanics.friction import wheel_friction
from ballbot.mechanics.friction_laws import (
    Armstrong,
    Classical,
    Dahl,
    Karnopp,
    LuGre,
    Smoothed,
    advance,
    follow,
    friction_at,
)
from ballbot.robot import Friction

SPEEDS = st.floats(0.02, 30.0) | st.floats(-30.0, -0.02)


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


@pytest.mark.parametrize("name", ["classical", "karnopp"])
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


class TestKarnopp:
    law = Karnopp(viscous=0.0, coulomb=1.0, static=1.5, dead_zone=0.01)

    def test_mass_counts_as_at_rest_below_the_zone(self):
        # m = 1, 4 N against c = 1, then 0.45 N, which decelerate by 0.55 m/s^2
        forces = np.concatenate([np.full(100, 4.0), np.full(2000, 0.45)])
        motion = push(self.law, forces, 1e-3)
        top = motion[99, 0]
        # in the zone only F_s = 1.5 acts against 4 N, 2.5 m/s^2; then c = 1, 3 m/s^2
        assert top == pytest.approx(0.01 + 3.0 * (0.1 - 0.01 / 2.5), rel=1e-12)
        stops_after = (top - 0.01) / 0.55
        moving = np.flatnonzero(motion[:, 0])
        assert moving[-1] == 99 + math.floor(stops_after / 1e-3)
        distance = motion[99, 1] + (top**2 - 0.01**2) / (2 * 0.55)
        assert motion[-1, 1] == pytest.approx(distance, rel=1e-12)

    def test_holds_up_to_exactly_its_static_friction(self):
        assert not push(self.law, np.full(5000, 1.5), 1e-3)[:, :2].any()
        beyond = push(self.law, np.full(5000, 1.5 + 1e-3), 1e-3)
        # the excess of 1 mN needs 10 s to leave the zone of 0.01 m/s, and what is above c throws it on from there
        assert not beyond[:, 0].any()
        assert push(self.law, np.full(11_000, 1.5 + 1e-3), 1e-3)[-1, 0] > 0.4


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
    (Karnopp, {"viscous": 0.0, "coulomb": 1.0, "static": 1.5, "dead_zone": 0.0}, "dead_zone"),
    (Karnopp, {"viscous": 0.0, "coulomb": 1.0, "static": 0.9, "dead_zone": 0.01}, "static"),
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
def test_nonsense_is_refused_by_name(law, values, named):
    with pytest.raises(InputError, match=named):
        law(**values)


GOOD_LUGRE = {
    "viscous": 0.02,
    "coulomb": 0.1,
    "stribeck": 0.05,
    "stribeck_speed": 0.5,
    "stiffness": 50.0,
    "micro_damping": 0.03,
}


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("stiffness", -1.0),
        ("stiffness", math.nan),
        ("micro_damping", -0.01),
        ("coulomb", 0.0),
        ("stribeck", -0.01),
        ("stribeck_speed", 0.0),
        ("damping_speed", 0.0),
    ],
)
def test_lugre_refuses_what_other_tools_take_in_silence(name, value):
    """The list of mujoco#3487: values that disable the law or make it an engine, and say nothing."""
    LuGre(**GOOD_LUGRE)
    with pytest.raises(InputError, match=name):
        LuGre(**{**GOOD_LUGRE, name: value})


class TestLuGreMayDrive:
    """sigma_1 s/c > b: friction gives energy when bristles that were bent slowly meet a high speed."""

    @staticmethod
    def cycle_work(law: LuGre, fast: float) -> float:
        """Return the work against friction when bristles are bent at low speed and then taken along fast."""
        slow, h = 1e-6, 1e-9
        bend = np.full(60, slow)  # 60 s at 1 um/s: bent to c + s
        work = float((follow(law, bend, sample_time=1.0) * slow)[1:].sum())
        state = law.initial_state(1.0)
        for _ in range(60):
            state = advance(law, state, speed=slow, step=1.0)
        for _ in range(3000):
            power = friction_at(law, fast, state=state) * fast
            state = advance(law, state, speed=fast, step=h)
            work += 0.5 * h * (power + friction_at(law, fast, state=state) * fast)
        return work

    def test_the_papers_own_values_do(self):
        speed = PAPER_LUGRE.driving_speed()
        assert speed is not None
        assert self.cycle_work(PAPER_LUGRE, 50.0) < -0.03
        bent = np.array([1.5 / PAPER_LUGRE.stiffness])
        assert friction_at(PAPER_LUGRE, speed, state=bent) < 0.0

    def test_they_are_refused_unless_asked_for(self):
        with pytest.raises(InputError, match="may_drive"):
            replace(PAPER_LUGRE, may_drive=False)

    def test_micro_damping_at_the_bound_is_taken(self):
        bound = 0.4 * 1.0 / 0.5
        law = replace(PAPER_LUGRE, micro_damping=bound, may_drive=False)
        assert self.cycle_work(law, 50.0) > 0.0
        with pytest.raises(InputError, match=r"at most 0\.8,"):
            replace(PAPER_LUGRE, micro_damping=bound * 1.01, may_drive=False)

    def test_fading_micro_damping_cures_it(self):
        law = replace(PAPER_LUGRE, damping_speed=0.005, may_drive=False)
        for fast in (0.002, 0.005, 0.02, 1.0):
            assert friction_at(law, fast, state=np.array([1.5 / law.stiffness])) > 0.0
        assert law.driving_speed() is None


class TestLuGreOfThePaper:
    """The simulations of Canudas de Wit et al. 1995 with its Table I, m = 1 kg."""

    def test_stiffness_and_damping_at_rest(self):
        """m x'' + (sigma_1 + sigma_2) x' + sigma_0 x = F for small F, in steps longer than it takes to swing."""
        force, h = 1e-5, 5e-3  # sqrt(sigma_0/m) = 316 rad/s
        motion = push(PAPER_LUGRE, np.full(40, force), h)
        damping = PAPER_LUGRE.micro_damping + PAPER_LUGRE.viscous
        rate = np.array([[0.0, 1.0], [-1e5, -damping]])
        t = h * np.arange(1, 41)
        values, vectors = np.linalg.eig(rate)
        still = np.array([force / 1e5, 0.0])
        parts = np.linalg.solve(vectors, -still)
        expected = still[0] + ((vectors[0] * parts) * np.exp(np.outer(t, values))).sum(axis=1).real
        # bristles slip by a share F/(2 F_s) = 3e-6 of what they bend
        np.testing.assert_allclose(motion[:, 1], expected, rtol=1e-5)

    def test_state_at_constant_speed_is_that_of_the_equation(self):
        for speed in (1e-5, 5e-4, 0.003, -0.2):
            g = 1.0 + 0.5 * math.exp(-((speed / 0.001) ** 2))
            start, h = -0.7e-5, 0.4 * g / (1e5 * abs(speed))
            exact = solve_ivp(
                lambda _, z, v=speed, g=g: v - 1e5 * abs(v) / g * z, (0.0, h), [start], rtol=1e-12, atol=1e-18
            ).y[0, -1]
            z = advance(PAPER_LUGRE, np.array([start]), speed=speed, step=h)[0]
            assert z == pytest.approx(exact, rel=1e-9)
            # and in any number of steps the same
            for _ in range(7):
                start = advance(PAPER_LUGRE, np.array([start]), speed=speed, step=h / 7)[0]
            assert start == pytest.approx(z, rel=1e-11)

    @pytest.mark.filterwarnings("ignore:overflow encountered:RuntimeWarning")  # SciPy's numerical Jacobian
    def test_presliding_hysteresis(self):
        """A force swinging to 1.425 N, 95 % of F_s, moves the mass around a loop (its Figure 2)."""
        h = 2.5e-4
        ramp = np.interp(
            np.arange(0.0, 60.0, h) + h / 2,
            [0, 5, 15, 25, 35, 45, 60],
            1.425 * np.array([0, 1, -1, 1, -1, 1, 1]),
        )
        motion = push(PAPER_LUGRE, ramp, h)
        exact = solve_ivp(
            lambda t, x: lugre_rates(x, np.interp(t, [0, 5, 15, 25], 1.425 * np.array([0, 1, -1, 1]))),
            (0.0, 25.0),
            [0.0, 0.0, 0.0],
            method="Radau",
            rtol=1e-8,
            atol=1e-13,
            max_step=0.05,
            t_eval=np.arange(1.0, 25.5, 1.0),
        )
        ends = np.round(exact.t / h).astype(int) - 1
        np.testing.assert_allclose(
            motion[ends, 1], exact.y[0], atol=1e-8
        )  # of 40 um; order two: 9e-8 at 1 ms
        # far below F_s a spring: 0.1425 N bend by F/sigma_0 to a few per cent
        assert motion[1999, 1] == pytest.approx(0.1425 / 1e5, rel=0.06)
        loop = slice(60_000, 140_000)
        work = float(np.sum(np.diff(motion[loop, 1]) * ramp[loop][1:]))
        assert work > 1e-5
        assert motion[139_999, 1] == pytest.approx(motion[59_999, 1], abs=1e-6)

    def test_frictional_lag_grows_with_frequency(self):
        """Between 0.1 and 1.1 mm/s: more friction while the speed rises, the wider the faster (its Figure 3)."""
        widths = []
        for frequency in (1.0, 10.0, 25.0):
            t = np.linspace(0.0, 6.0 * math.pi / frequency, 30_001)
            speeds = 6e-4 - 5e-4 * np.cos(frequency * t)
            friction = follow(PAPER_LUGRE, speeds, sample_time=t[1])
            last = friction[20_000:]
            rising, falling = last[:5001], last[5000:][::-1]  # the same speeds, both ways
            assert (rising[100:-100] > falling[100:-100]).all()
            widths.append((rising - falling).max())
        assert widths[0] < widths[1] < widths[2]
        # at 1 rad/s the loop is a small part of F_s - F_c = 0.5 N, at 25 rad/s a large one
        assert widths[0] < 0.05 < 0.1 < widths[2]

    def test_break_away_force_falls_with_the_rate_of_the_force(self):
        """From near F_s = 1.5 N at 1 N/s to near F_c = 1 N at 50 N/s (its Figure 4)."""
        h, peaks = 1e-4, []
        for rate in (1.0, 2.0, 5.0, 10.0, 20.0, 50.0):
            ramp = rate * (np.arange(round(2.0 / rate / h)) + 0.5) * h
            peaks.append(push(PAPER_LUGRE, ramp, h)[:, 2].max())
        assert (np.diff(peaks) < 0.0).all()
        assert 1.4 < peaks[0] < 1.5
        assert 1.0 < peaks[-1] < 1.1

    def test_stick_slip(self):
        """Pulled at 0.1 m/s by 2 N/m, the mass stands until the spring holds nearly F_s, then jumps (Figures 5, 6)."""
        h, duration = 1e-4, 40.0
        motion = pull_by_spring(PAPER_LUGRE, spring=2.0, speed=0.1, duration=duration, h=h)
        exact = solve_ivp(
            lambda t, x: lugre_rates(x, 2.0 * (0.1 * t - x[0])),
            (0.0, duration),
            [0.0, 0.0, 0.0],
            method="Radau",
            rtol=1e-8,
            atol=1e-11,
            max_step=0.02,
            t_eval=np.arange(0.5, duration + 0.1, 0.5),
        )
        ends = np.round(exact.t / h).astype(int) - 1
        np.testing.assert_allclose(
            motion[ends, 1], exact.y[0], atol=2e-4
        )  # of 3.5 m; order two, and 1e-2 at 1 ms
        moving = motion[:, 0] > 0.01
        starts = np.flatnonzero(moving[1:] & ~moving[:-1]) * h
        assert len(starts) >= 3
        # the first jump: the spring's force rises by 0.2 N/s, so break-away is just below F_s
        assert 2.0 * 0.1 * starts[0] == pytest.approx(1.5, rel=0.02)
        assert np.ptp(np.diff(starts)) < 0.01 * np.diff(starts).mean()
        # the classical law of the same numbers stands exactly to 7.5 s; it breaks away at F_s and not below, so jumps
        # of its own are a little farther apart
        classical = Classical(viscous=0.4, coulomb=1.0, stribeck=0.5, stribeck_speed=0.001)
        stick = pull_by_spring(classical, spring=2.0, speed=0.1, duration=duration, h=h)
        jumps = np.flatnonzero((stick[1:, 0] > 0.01) & (stick[:-1, 0] <= 0.01)) * h
        assert np.diff(starts).mean() == pytest.approx(np.diff(jumps).mean(), rel=0.03)
        assert not stick[: round(7.49 / h)].any()


def lugre_rates(x, force):
    """Return the rates of (distance, speed, bending) of 1 kg under Table I, written from the paper's equations."""
    _, v, z = x
    g = (1.0 + 0.5 * math.exp(-((v / 0.001) ** 2))) / 1e5
    z_dot = v - abs(v) / g * z
    return [v, force - (1e5 * z + math.sqrt(1e5) * z_dot + 0.4 * v), z_dot]


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


def test_follow_refuses_what_is_no_history():
    with pytest.raises(InputError, match="speeds"):
        follow(LAWS["dahl"], np.zeros((2, 2)), sample_time=0.1)
    with pytest.raises(InputError, match="sample time"):
        follow(LAWS["dahl"], np.zeros(2), sample_time=0.0)
