"""The LuGre law: the paper's figures, when its friction may drive, what is refused."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ballbot import InputError
from ballbot.mechanics.friction_laws import Classical, LuGre, advance, follow, friction_at
from tests.support.friction_examples import PAPER_LUGRE, pull_by_spring, push

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
def test_lugre_refuses_parameters_without_physical_meaning(name, value):
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

    @pytest.mark.slow
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
