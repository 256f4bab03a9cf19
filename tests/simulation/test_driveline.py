"""One driveline: a closed form, an event-driven reference, the break-away torque, terms by direction and load."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from ballbot import InputError
from ballbot.mechanics.friction import WheelTerms
from ballbot.mechanics.friction_laws import Classical
from ballbot.simulation.driveline import Driveline, TorqueSpeedCurve, simulate_driveline

J = 2.97e-3  # j_w + j_r of the thesis's robot [kg m^2]
DRIVELINE = {"viscous": 0.014, "coulomb": 0.11}
STRIBECK = {"stribeck": 0.05, "stribeck_speed": 0.6}
LAW = Classical(**DRIVELINE, **STRIBECK, stribeck_exponent=1.1)
CURVE = TorqueSpeedCurve(no_load_speed=27.7, stall_torque=6.0)


def wheel(law, speed_limit=None, inertia=J) -> Driveline:
    return Driveline(inertia=inertia, friction=law, speed_limit=speed_limit)


def swinging_torques(samples: int, sample_time: float) -> np.ndarray:
    """Return torques that start, stop and reverse a driveline, and leave it at rest for a while."""
    t = sample_time * (np.arange(samples) + 0.5)
    wave = 0.35 * np.sin(2.0 * math.pi * t) + 0.1 * np.sin(7.0 * t + 1.0)
    return np.where(t % 1.0 > 0.7, 0.2 * wave, wave)


def test_the_supply_brakes_what_turns_too_fast():
    law, torques = Classical(viscous=0.0, coulomb=0.0), np.full(100, 5.0)
    motion = simulate_driveline(wheel(law, CURVE), torques, sample_time=0.005, initial_speed=35.0)
    rate = 6.0 / 27.7 / J
    # RK4, half a time constant a step
    np.testing.assert_allclose(motion.speeds[:8], 27.7 + 7.3 * np.exp(-rate * motion.t[:8]), rtol=1e-4)


def event_driven(law: Classical, torques: np.ndarray, sample_time: float) -> np.ndarray:
    """Return speeds by SciPy: solved between events, with rest as a state of its own."""
    limit, w, speeds = law.coulomb + law.stribeck, 0.0, []
    for u in torques:
        t = 0.0
        while t < sample_time * (1.0 - 1e-12):
            if w == 0.0 and abs(u) <= limit:
                break
            s = math.copysign(1.0, u if w == 0.0 else w)

            def rate(_, x, u=u, s=s):
                dry = law.coulomb + law.stribeck * math.exp(
                    -((abs(x[0]) / law.stribeck_speed) ** law.stribeck_exponent)
                )
                return [(u - law.viscous * x[0] - s * dry) / J]

            def stops(t, x, s=s, start=w, began=t):
                return s * x[0] if start != 0.0 or t > began + 1e-6 else 1.0

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
    law = Classical(**DRIVELINE, **STRIBECK, stribeck_exponent=exponent)
    torques = swinging_torques(150, 0.01)
    exact = event_driven(law, torques, 0.01)
    speeds = simulate_driveline(wheel(law), torques, sample_time=0.01, step=1e-4).speeds
    assert (exact == 0.0).sum() > 10  # it does rest
    np.testing.assert_array_equal(speeds == 0.0, exact == 0.0)
    # order 1 + delta from rest: 2e-7 at 1 ms; the solver is asked for 1e-11 a step
    np.testing.assert_allclose(speeds, exact, atol=5e-9)


@given(
    coulomb=st.floats(1e-4, 2.0),
    stribeck=st.floats(0.0, 2.0),
    sign=st.sampled_from([-1.0, 1.0]),
    exponent=st.floats(0.3, 3.0),
)
@settings(deadline=None, max_examples=60)
def test_break_away_at_exactly_c_plus_s(coulomb, stribeck, sign, exponent):
    shape = {"stribeck_speed": 0.5, "stribeck_exponent": exponent}
    law, limit = Classical(viscous=0.01, coulomb=coulomb, stribeck=stribeck, **shape), coulomb + stribeck
    held, moved = (
        simulate_driveline(wheel(law), np.full(20, sign * torque), sample_time=0.005)
        for torque in (limit, limit * (1.0 + 1e-9))
    )
    assert not held.speeds.any()
    assert (sign * moved.speeds > 0.0).all()


def test_a_stiff_driveline_takes_shorter_steps():
    stiff = Driveline(inertia=1e-5, friction=Classical(viscous=0.1, coulomb=0.1))
    motion = simulate_driveline(stiff, np.full(50, 0.5), sample_time=0.005)
    assert motion.speeds[-1] == pytest.approx(4.0, rel=1e-9)


@pytest.mark.parametrize("torque", [0.4, -0.4])
def test_each_direction_and_load_is_a_plain_law_of_its_own(torque):
    terms, direction = WheelTerms(coulomb_asymmetry=0.03, stribeck_asymmetry=-0.02, load=0.1), np.sign(torque)

    def in_direction(load: float) -> Classical:
        """Return the plain law of one direction under a held torque."""
        dry = {"coulomb": 0.11 + direction * 0.03 + 0.1 * load, "stribeck": 0.05 - direction * 0.02}
        return Classical(**DRIVELINE | STRIBECK | dry)

    law = Classical(**DRIVELINE, **STRIBECK, terms=terms)
    ours, theirs = (
        simulate_driveline(wheel(one), np.full(50, torque), sample_time=0.005)
        for one in (law, in_direction(abs(torque)))
    )
    np.testing.assert_allclose(ours.speeds, theirs.speeds, rtol=1e-12)
    assert abs(ours.speeds[-1]) > 1.0
    at = np.array([0.2, 3.0]) * direction
    np.testing.assert_allclose(law.steady_friction(at), in_direction(0.0).steady_friction(at), rtol=1e-14)


@pytest.mark.parametrize(
    "values", [{"torques": [math.nan]}, {"sample_time": 0.0}, {"step": 1e-12}, {"initial_speed": math.inf}]
)
def test_bad_input_is_refused(values):
    with pytest.raises(InputError, match=r"torques|sample time|inner steps|initial speed"):
        simulate_driveline(wheel(LAW), **({"torques": [0.0] * 5, "sample_time": 0.005} | values))
