"""Friction laws by themselves: steady curves, closed forms, energy, what is refused."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ballbot import InputError
from ballbot.mechanics.friction import wheel_friction
from ballbot.mechanics.friction_laws import BristleLaw, Classical, Dahl, LuGre
from ballbot.robot import Friction

#: Table I of Canudas de Wit et al. 1995; its friction can drive (Barabanov and Ortega 2000), hence the last word
PAPER_LUGRE = LuGre(
    viscous=0.4,
    coulomb=1.0,
    stribeck=0.5,
    stribeck_speed=0.001,
    stiffness=1e5,
    micro_damping=1e5**0.5,
    may_drive=True,
)
#: of a driveline's size; units N m and rad
LUGRE = LuGre(
    viscous=0.014, coulomb=0.11, stribeck=0.05, stribeck_speed=0.6, stiffness=50.0, micro_damping=0.02
)
DAHL = Dahl(viscous=0.014, coulomb=0.11, stiffness=50.0)
BRISTLES = {"lugre": LUGRE, "dahl": DAHL}


def follow(law: BristleLaw, speeds: np.ndarray, h: float) -> np.ndarray:
    """Return the friction along a history of speeds, from a long rest."""
    z, found = 0.0, []
    for k, speed in enumerate(speeds.tolist()):
        if k > 0:
            z = law.advanced(z, speed=0.5 * (speed + float(speeds[k - 1])), step=h)
        found.append(law.friction(z, speed))
    return np.array(found)


def test_classical_is_the_robots_law():
    law = Classical(viscous=0.014, coulomb=0.11, stribeck=0.05, stribeck_speed=0.6, stribeck_exponent=1.1)
    friction = Friction(
        viscous=(law.viscous,),
        coulomb=(law.coulomb,),
        stribeck=(law.stribeck,),
        stribeck_speed=law.stribeck_speed,
        stribeck_exponent=law.stribeck_exponent,
        rolling=0.0,
    )
    speeds = np.linspace(-5.0, 5.0, 41)
    ours = law.steady_friction(speeds)
    np.testing.assert_allclose(ours, wheel_friction(speeds[:, None], friction)[:, 0], rtol=1e-12)


@pytest.mark.parametrize("speed", [0.02, -0.5, 30.0])
@pytest.mark.parametrize("law", BRISTLES.values(), ids=BRISTLES)
def test_long_constant_speed_ends_on_the_steady_curve(law, speed):
    # 2 rad of sliding is many times the longest bending, c/sigma = 2 mrad
    z = law.advanced(0.0, speed=speed, step=2.0 / abs(speed))
    stribeck = law.stribeck * math.exp(-((speed / 0.6) ** 2)) if isinstance(law, LuGre) else 0.0
    steady = math.copysign(0.11 + stribeck, speed) + 0.014 * speed
    assert law.friction(z, speed) == pytest.approx(steady, rel=1e-12)


@pytest.mark.parametrize("law", BRISTLES.values(), ids=BRISTLES)
@pytest.mark.parametrize("seed", range(3))
def test_no_law_gives_energy(law, seed):
    """From rest, whatever the speeds do, the work done against friction is never negative.

    A driveline's LuGre values are those whose friction cannot drive: 0.02 * 0.05/0.11 < 0.014.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(20_000) * 1e-4
    amplitude, frequency, phase = rng.uniform(0.01, 3.0, 5), rng.uniform(1, 60, 5), rng.uniform(0, 6, 5)
    speeds = (amplitude * np.sin(frequency * t[:, None] + phase)).sum(axis=1) * np.minimum(t / 0.05, 1.0)
    power = follow(law, speeds, 1e-4) * speeds
    work = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1]) * 1e-4)])
    # quadrature over 0.1 ms of a spring that may swing: second order, and c * w * h = 1e-5 J is one sample's work
    assert work.min() > -1e-5
    assert work[-1] > 0.01


GOOD_LUGRE = {
    "viscous": 0.02,
    "coulomb": 0.1,
    "stribeck": 0.05,
    "stribeck_speed": 0.5,
    "stiffness": 50.0,
    "micro_damping": 0.03,
}
NONSENSE = [
    (Classical, {"viscous": -0.1, "coulomb": 1.0}, "viscous"),
    (Classical, {"viscous": 0.0, "coulomb": math.nan}, "coulomb"),
    (Classical, {"viscous": 0.0, "coulomb": 1.0, "stribeck_speed": 0.0}, "stribeck_speed"),
    (Dahl, {"coulomb": 0.0, "stiffness": 1.0}, "coulomb"),
    (Dahl, {"coulomb": 1.0, "stiffness": 1.0, "shape": -1.0}, "shape"),
    # the list of mujoco#3487: values that disable the law or make it an engine, and say nothing
    *(
        (LuGre, {**GOOD_LUGRE, name: value}, name)
        for name, value in (
            ("stiffness", -1.0),
            ("stiffness", math.nan),
            ("micro_damping", -0.01),
            ("coulomb", 0.0),
            ("stribeck", -0.01),
            ("stribeck_speed", 0.0),
            ("damping_speed", 0.0),
        )
    ),
]


@pytest.mark.parametrize(("law", "values", "named"), NONSENSE)
def test_impossible_values_are_refused_by_name(law, values, named):
    LuGre(**GOOD_LUGRE)
    with pytest.raises(InputError, match=named):
        law(**values)


class TestLuGreMayDrive:
    """sigma_1 s/c > b: friction gives energy when bristles that were bent slowly meet a high speed."""

    @staticmethod
    def cycle_work(law: LuGre, fast: float) -> float:
        """Return the work against friction when bristles are bent at low speed and then taken along fast."""
        slow, h = 1e-6, 1e-9
        work = float((follow(law, np.full(60, slow), 1.0) * slow)[1:].sum())  # bent to c + s in 60 s
        z = law.advanced(0.0, speed=slow, step=60.0)
        for _ in range(3000):
            power = law.friction(z, fast) * fast
            z = law.advanced(z, speed=fast, step=h)
            work += 0.5 * h * (power + law.friction(z, fast) * fast)
        return work

    def test_the_papers_own_values_do(self):
        speed = PAPER_LUGRE.driving_speed()
        assert speed is not None
        assert self.cycle_work(PAPER_LUGRE, 50.0) < -0.03
        assert PAPER_LUGRE.friction(1.5 / PAPER_LUGRE.stiffness, speed) < 0.0

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
            assert law.friction(1.5 / law.stiffness, fast) > 0.0
        assert law.driving_speed() is None


def test_lugre_state_at_constant_speed_is_that_of_the_equation():
    for speed in (1e-5, 5e-4, 0.003, -0.2):
        g = 1.0 + 0.5 * math.exp(-((speed / 0.001) ** 2))
        start, h = -0.7e-5, 0.4 * g / (1e5 * abs(speed))
        exact = solve_ivp(
            lambda _, z, v=speed, g=g: v - 1e5 * abs(v) / g * z, (0.0, h), [start], rtol=1e-12, atol=1e-18
        ).y[0, -1]
        z = PAPER_LUGRE.advanced(start, speed=speed, step=h)
        assert z == pytest.approx(exact, rel=1e-9)
        # and in any number of steps the same
        for _ in range(7):
            start = PAPER_LUGRE.advanced(start, speed=speed, step=h / 7)
        assert start == pytest.approx(z, rel=1e-11)


def test_frictional_lag_of_lugre_grows_with_frequency():
    """Between 0.1 and 1.1 mm/s: more friction while the speed rises, the wider the faster (the paper's Figure 3)."""
    widths = []
    for frequency in (1.0, 10.0, 25.0):
        t = np.linspace(0.0, 6.0 * math.pi / frequency, 30_001)
        friction = follow(PAPER_LUGRE, 6e-4 - 5e-4 * np.cos(frequency * t), t[1])
        last = friction[20_000:]
        rising, falling = last[:5001], last[5000:][::-1]  # the same speeds, both ways
        assert (rising[100:-100] > falling[100:-100]).all()
        widths.append((rising - falling).max())
    assert widths[0] < widths[1] < widths[2]
    # at 1 rad/s the loop is a small part of F_s - F_c = 0.5 N, at 25 rad/s a large one
    assert widths[0] < 0.05 < 0.1 < widths[2]


class TestDahl:
    @pytest.mark.parametrize("shape", [0.5, 1.0, 1.5, 2.0])
    def test_hysteresis_in_closed_form(self, shape):
        """F(x) from reversal to reversal, at any rate."""
        law = Dahl(coulomb=1.5, stiffness=300.0, shape=shape)
        for pace in (0.01, 3.0):
            F = z = 0.0
            for leg in (0.004, -0.009, 0.006, -0.002):
                s = math.copysign(1.0, leg)
                y, kappa = 1.0 - s * F / 1.5, 300.0 * abs(leg) / 1.5
                if shape == 1.0:
                    y *= math.exp(-kappa)
                else:
                    y = max(y ** (1.0 - shape) + (shape - 1.0) * kappa, 0.0) ** (1.0 / (1.0 - shape))
                F = s * 1.5 * (1.0 - y)
                for _ in range(5):
                    z = law.advanced(z, speed=s * pace, step=abs(leg) / pace / 5)
                assert law.friction(z, 0.0) == pytest.approx(F, rel=1e-12)

    def test_force_never_exceeds_coulombs(self):
        law = Dahl(coulomb=1.5, stiffness=300.0, shape=0.3)
        friction = follow(law, np.random.default_rng(3).normal(size=3000), 0.01)
        assert np.abs(friction).max() <= 1.5 * (1.0 + 1e-15)
