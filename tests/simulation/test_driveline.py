"""One driveline: closed forms, an event-driven reference, exact sticking, order, the clamp of (3.2), many at once."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from ballbot import InputError
from ballbot.mechanics.friction import steady_friction
from ballbot.robot import Friction
from ballbot.simulation.driveline import Driveline, TorqueSpeedCurve, simulate_driveline

J = 2.97e-3  # j_w + j_r of the thesis's robot [kg m^2]
DRIVELINE = {"viscous": 0.014, "coulomb": 0.11}
STRIBECK = {"stribeck": 0.05, "stribeck_speed": 0.6}


def law_of(*, stribeck_speed: float = 1.0, stribeck_exponent: float = 2.0, **numbers: float) -> Friction:
    """Return the friction of one wheel."""
    shape = {"stribeck_speed": stribeck_speed, "stribeck_exponent": stribeck_exponent}
    return replace(Friction.none(1), **shape, **{name: (number,) for name, number in numbers.items()})


LAW = law_of(**DRIVELINE, **STRIBECK, stribeck_exponent=1.1)
CURVE = TorqueSpeedCurve(no_load_speed=27.7, stall_torque=6.0)


def wheel(law, speed_limit=None, inertia=J) -> Driveline:
    return Driveline(inertia=inertia, friction=law, speed_limit=speed_limit)


def swinging_torques(samples: int, sample_time: float) -> np.ndarray:
    """Return torques that start, stop and reverse a driveline, and leave it at rest for a while."""
    t = sample_time * (np.arange(samples) + 0.5)
    wave = 0.35 * np.sin(2.0 * math.pi * t) + 0.1 * np.sin(7.0 * t + 1.0)
    return np.where(t % 1.0 > 0.7, 0.2 * wave, wave)


class TestClosedForms:
    def test_the_supply_brakes_what_turns_too_fast(self):
        law = law_of(viscous=0.0, coulomb=0.0)
        motion = simulate_driveline(
            wheel(law, CURVE), np.full(100, 5.0), sample_time=0.005, initial_speed=35.0
        )
        rate = 6.0 / 27.7 / J
        # RK4, half a time constant a step
        np.testing.assert_allclose(motion.speeds[:8], 27.7 + 7.3 * np.exp(-rate * motion.t[:8]), rtol=1e-4)


def event_driven(law: Friction, torques: np.ndarray, sample_time: float) -> np.ndarray:
    """Return speeds by SciPy: solved between events, with rest as a state of its own."""
    (b,), (c,), (s,) = law.viscous, law.coulomb, law.stribeck
    limit, w, speeds = c + s, 0.0, []
    for u in torques:
        t = 0.0
        while t < sample_time * (1.0 - 1e-12):
            if w == 0.0 and abs(u) <= limit:
                break
            way = math.copysign(1.0, u if w == 0.0 else w)

            def rate(_, x, u=u, way=way):
                dry = c + s * math.exp(-((abs(x[0]) / law.stribeck_speed) ** law.stribeck_exponent))
                return [(u - b * x[0] - way * dry) / J]

            def stops(t, x, way=way, start=w, began=t):
                return way * x[0] if start != 0.0 or t > began + 1e-6 else 1.0

            stops.terminal, stops.direction = True, -1.0
            path = solve_ivp(
                rate, (t, sample_time), [w], method="DOP853", rtol=1e-11, atol=1e-13, events=stops
            )
            t = path.t[-1]
            w = 0.0 if path.status == 1 else path.y[0, -1]
        speeds.append(w)
    return np.array(speeds)


@pytest.mark.parametrize("exponent", [1.1, 2.0])
def test_classical_law_against_an_event_driven_solver(exponent):
    law = law_of(**DRIVELINE, **STRIBECK, stribeck_exponent=exponent)
    torques = swinging_torques(150, 0.01)
    exact = event_driven(law, torques, 0.01)
    speeds = simulate_driveline(wheel(law), torques, sample_time=0.01, step=1e-4).speeds
    assert (exact == 0.0).sum() > 10  # it does rest
    np.testing.assert_array_equal(speeds == 0.0, exact == 0.0)
    # order 1 + delta from rest: 2e-7 at 1 ms; the solver is asked for 1e-11 a step
    np.testing.assert_allclose(speeds, exact, atol=5e-9)


@pytest.mark.parametrize(("exponent", "order"), [(1.0, 4.0), (2.0, 4.0), (1.1, 2.1), (0.7, 1.7)])
def test_order_through_stops_and_starts(exponent, order):
    """Four where the law is smooth for one sign (even |w|^2, or |w|), else 1 + delta from each start."""
    law, torques = law_of(**DRIVELINE, **STRIBECK, stribeck_exponent=exponent), swinging_torques(200, 0.01)

    def speeds(count: int) -> np.ndarray:
        return simulate_driveline(wheel(law), torques, sample_time=0.01, step=0.01 / count).speeds

    fine = speeds(1024)
    errors = [np.abs(speeds(count) - fine).max() for count in (8, 16, 32, 64, 128)]
    # the mean over doublings: errors of several starts cancel at one step and not at the next
    assert np.mean(np.log2(errors[:-1]) - np.log2(errors[1:])) == pytest.approx(order, abs=0.3)


class TestRest:
    law = LAW

    def test_an_hour_at_rest_without_a_bit_of_motion(self):
        t = np.arange(720_000) * 0.005
        motion = simulate_driveline(wheel(self.law, CURVE), 0.1599 * np.sin(t), sample_time=0.005)
        assert not motion.speeds.any()
        assert not motion.angles.any()

    @given(
        coulomb=st.floats(1e-4, 2.0),
        stribeck=st.floats(0.0, 2.0),
        sign=st.sampled_from([-1.0, 1.0]),
        exponent=st.floats(0.3, 3.0),
    )
    @settings(deadline=None, max_examples=60)
    def test_break_away_at_exactly_c_plus_s(self, coulomb, stribeck, sign, exponent):
        law = law_of(
            viscous=0.01, coulomb=coulomb, stribeck=stribeck, stribeck_speed=0.5, stribeck_exponent=exponent
        )
        limit = coulomb + stribeck
        held = simulate_driveline(wheel(law), np.full(20, sign * limit), sample_time=0.005)
        assert not held.speeds.any()
        pushed = sign * limit * (1.0 + 1e-9)
        moved = simulate_driveline(wheel(law), np.full(20, pushed), sample_time=0.005)
        assert (sign * moved.speeds > 0.0).all()

    @given(st.integers(0, 10_000))
    @settings(deadline=None, max_examples=30)
    def test_friction_only_takes_energy(self, seed):
        """Kinetic energy gained is at most the work of the torque, in every sample."""
        rng = np.random.default_rng(seed)
        law = law_of(
            viscous=rng.uniform(0, 0.05),
            coulomb=rng.uniform(0, 0.2),
            stribeck=rng.uniform(0, 0.1),
            stribeck_speed=rng.uniform(0.1, 2.0),
            stribeck_exponent=rng.uniform(0.5, 2.5),
        )
        torques = np.repeat(rng.uniform(-0.5, 0.5, 50), 4)
        motion = simulate_driveline(wheel(law), torques, sample_time=0.005, initial_speed=rng.uniform(-3, 3))
        energy = 0.5 * J * motion.speeds[1:] ** 2 - 0.5 * J * motion.speeds[:-1] ** 2
        work = torques[1:] * np.diff(motion.angles)
        # speed and angle are of order four and not each other's: 1e-7 J of some 1e-2
        assert (energy <= work + 1e-7).all()


def test_a_stiff_driveline_takes_shorter_steps():
    stiff = Driveline(inertia=1e-5, friction=law_of(viscous=0.1, coulomb=0.1))
    motion = simulate_driveline(stiff, np.full(50, 0.5), sample_time=0.005)
    assert motion.speeds[-1] == pytest.approx(4.0, rel=1e-9)


class TestTermsByDirectionAndLoad:
    law = law_of(**DRIVELINE, **STRIBECK, coulomb_asymmetry=0.03, stribeck_asymmetry=-0.02, load=0.1)

    def in_direction(self, direction: float, torque: float) -> Friction:
        """Return the plain law of one direction under a held torque."""
        sizes = {"coulomb": 0.11 + direction * 0.03 + 0.1 * abs(torque), "stribeck": 0.05 - direction * 0.02}
        return law_of(**(DRIVELINE | STRIBECK | sizes))

    @pytest.mark.parametrize("torque", [0.4, -0.4])
    def test_each_direction_is_a_plain_law_of_its_own(self, torque):
        plain = self.in_direction(np.sign(torque), torque)
        inputs = np.full(50, torque)
        ours, theirs = (
            simulate_driveline(wheel(one), inputs, sample_time=0.005) for one in (self.law, plain)
        )
        np.testing.assert_allclose(ours.speeds, theirs.speeds, rtol=1e-12)
        assert abs(ours.speeds[-1]) > 1.0
        at = np.array([0.2, 3.0]) * np.sign(torque)
        unloaded = self.in_direction(np.sign(torque), 0.0)
        np.testing.assert_allclose(steady_friction(at, self.law), steady_friction(at, unloaded), rtol=1e-14)


@pytest.mark.parametrize(
    "values", [{"torques": [math.nan]}, {"sample_time": 0.0}, {"step": 1e-12}, {"initial_speed": math.inf}]
)
def test_bad_input_is_refused(values):
    with pytest.raises(InputError, match=r"torques|sample time|inner steps|initial speed"):
        simulate_driveline(wheel(LAW), **({"torques": [0.0] * 5, "sample_time": 0.005} | values))
