"""Faults of the twin's drivelines against the law that each claims to follow."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from ballbot.robot import Friction
from ballbot.simulation.imperfections import Supply
from ballbot.twin import Twin, twin_mjcf
from ballbot.twin.driveline import TwinDriveline
from ballbot.twin.engine import Engine
from ballbot.twin.faults import Compliance, CurrentLoop, LoadDependence
from tests.support.twin_examples import ALTEN, INERTIA, ROTOR, ideal, turn, wheels_in_the_air


@pytest.mark.parametrize("frequency", [12.0, 25.0])
def test_resonance_is_at_the_given_frequency(frequency: float) -> None:
    """Rotors and wheels plucked apart on the standing robot, without friction or play."""
    zeta = 0.03
    compliance = Compliance(frequency=frequency, damping_ratio=zeta)
    # contacts of 4 ms would damp, too: leaning presses the wheels against the ball by turns
    scenario = ideal(compliance=compliance, timestep=0.00025, contact_time=0.001)
    twin = Twin(ALTEN, scenario)
    twin.reset(None, seed=1)
    engine = twin.engine
    for _ in range(100):
        engine.step()
    motors, play = engine.velocities("wheel", 3), engine.velocities("play", 3)
    pluck = np.array([0.5, -0.2, -0.3])
    engine.qvel[motors] += pluck  # the rotors alone: the wheels, behind the play, stay
    engine.qvel[play] -= pluck
    twist = []
    for _ in range(round(4.5 / frequency / engine.timestep)):
        engine.step()
        twist.append(engine.qpos[engine.positions("play", 3)].copy())
    first = np.array(twist)[:, 0]
    crossings = np.flatnonzero(np.diff(np.sign(first)))[:8]
    damped = 0.5 / (np.mean(np.diff(crossings)) * engine.timestep)
    # rows of rollers make the robot's inertia at a wheel uncertain by 1 to 2 %, of which the rotor sees a twentieth
    assert damped == pytest.approx(frequency, rel=0.03)
    peaks = [np.abs(first[a:b]).max() for a, b in pairwise(crossings)]
    decay = -np.polyfit(np.arange(len(peaks)), np.log(peaks), 1)[0] / np.pi
    assert decay == pytest.approx(zeta, rel=0.3)  # creeping contacts damp too


def test_a_twisting_driveline_is_slack_within_its_play() -> None:
    half = np.radians(0.5)
    compliance = Compliance(frequency=12, damping_ratio=0.0)
    engine, _ = wheels_in_the_air(ideal(backlash=2 * half, compliance=compliance))
    play = engine.positions("play", 3)
    accelerations = []
    for angle in (0.9 * half, 2.0 * half):
        engine.reset()
        engine.qpos[play] = angle
        engine.step()
        accelerations.append(engine.qvel[engine.velocities("play", 3)].copy() / engine.timestep)
    np.testing.assert_allclose(accelerations[0], 0.0, atol=1e-9)
    k = (2 * np.pi * 12) ** 2 / (1 / ROTOR + 1 / 0.0457)  # 0.0457: the robot's inertia at a wheel
    free = -k * half * (1 / ROTOR + 1 / 1e-3)
    np.testing.assert_allclose(accelerations[1], free, rtol=0.01)


def test_current_loop_lags() -> None:
    engine, driveline = wheels_in_the_air(ideal(current_loop=CurrentLoop(bandwidth=50.0)))
    driveline.command(np.array([1.0, -0.5, 0.0]))
    torques = []
    for _ in range(20):
        driveline.prepare_step()
        torques.append(engine.torques.copy())
        engine.step()
    t = engine.timestep * np.arange(1, 21)
    expected = np.outer(1 - np.exp(-2 * np.pi * 50.0 * t), [1.0, -0.5, 0.0])
    np.testing.assert_allclose(torques, expected, atol=1e-12)


def test_battery_limits_torque_and_speed_and_sags() -> None:
    R, R_i = ALTEN.drive.resistance, 0.3
    engine, driveline = wheels_in_the_air(ideal(supply=Supply(internal_resistance=0.0)))
    top = turn(engine, driveline, np.array([1.0, -1.0, 1.0]), 8000)[-1]
    np.testing.assert_allclose(np.abs(top), 24 * 303 * 2 * np.pi / 60 / 27.6, rtol=2e-3)  # Appendix I
    strong = ALTEN.replace(drive=replace(ALTEN.drive, torque_limit=100.0))
    for inner, volts in ((0.0, 24.0), (R_i, None)):
        scenario = ideal(supply=Supply(internal_resistance=inner))
        engine = Engine(twin_mjcf(strong, scenario, mounting="stand"))
        driveline = TwinDriveline(strong, scenario, engine)
        driveline.command(np.full(3, 20.0))
        driveline.prepare_step()
        ampere = 20.0 / (27.6 * 0.0315)
        volts = volts or 24.0 - R_i * 3 * R * ampere**2 / 24.0  # at rest all power is heat
        stall = 27.6 * 0.0315 * volts / R
        np.testing.assert_allclose(engine.torques, min(20.0, stall), rtol=1e-12)
    assert stall < 20.0  # the sag was seen


def test_friction_may_differ_forward_and_backward() -> None:
    friction = replace(Friction.none(3), coulomb=(0.1, 0.1, 0.1), coulomb_asymmetry=(0.02, 0.02, 0.02))
    engine, driveline = wheels_in_the_air(ideal(friction=friction))
    driveline.speeds[:] = [5.0, -5.0, 5.0]
    speeds = turn(engine, driveline, np.zeros(3), 50)[-1]
    slowed = np.array([0.12, 0.08, 0.12]) / INERTIA * 0.025
    np.testing.assert_allclose(np.abs(speeds), 5.0 - slowed, rtol=1e-3)


def test_friction_may_follow_the_load() -> None:
    friction = replace(Friction.none(3), coulomb=(0.1, 0.1, 0.1))
    scenario = ideal(friction=friction, load_dependence=LoadDependence(fraction=0.5))
    engine, driveline = wheels_in_the_air(scenario)
    driveline.speeds[:] = 5.0
    speeds = turn(engine, driveline, np.zeros(3), 50)[-1]
    # in the air half of it is left
    np.testing.assert_allclose(speeds, 5.0 - 0.05 / INERTIA * 0.025, rtol=1e-3)
    twin = Twin(ALTEN, scenario)
    twin.reset(None, seed=1)
    sizes = []
    for _ in range(40):
        twin.step(np.zeros(3), 0.005)
        sizes.append(twin.engine.dry_friction[twin.engine.velocities("wheel", 3)].copy())
    # on the ball it is whole; 1.4 degrees between rows and contacts that settle change the force by some per cent
    assert np.mean(sizes[20:]) == pytest.approx(0.1, rel=0.03)
