"""Faults of the twin outside its drivelines (contacts, pushes, timing) against the law that each claims to follow."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ballbot import simulate
from ballbot.control.presets import precise_controller
from ballbot.errors import InputError
from ballbot.mechanics.model import Model
from ballbot.robot import Friction
from ballbot.simulation.imperfections import Push
from ballbot.twin import Scenario, Twin, twin_mjcf
from ballbot.twin.driveline import Shafts
from ballbot.twin.engine import Engine
from ballbot.twin.faults import Carpet, Compliance, LoadDependence, Payload, Softness, Timing
from ballbot.twin.imperfections import true_model
from ballbot.twin.mjcf import floor_friction
from tests.support.twin_examples import ALTEN, IDEAL, block_of, ideal, lone_ball

# Contacts


def test_soft_ball_sinks_and_oscillates_by_its_stiffness() -> None:
    """Upside down, 3 kg on three springs at 45 degrees: 3 K cos^2 carries it."""
    K, C = 1e4, 10.0
    # rows could share the load
    scenario = ideal(softness=Softness(stiffness=K, damping=C), wheel_contact="point")
    engine = Engine(twin_mjcf(ALTEN, scenario, mounting="upside_down"))
    shafts = Shafts(ALTEN, scenario, engine)
    height = engine.position("ball")[2:3]
    heights = []
    for _ in range(4000):
        shafts.turn_back()
        engine.step()
        heights.append(float(height[0]))
    vertical = 3 * K / 2
    sink = 3 * 9.81 / vertical  # down is +z here
    # the contacts turn by 2 mm in 119 mm as the ball sinks
    assert heights[-1] == pytest.approx(sink, rel=0.03)
    swing = np.array(heights[:1200]) - sink
    crossings = np.flatnonzero(np.diff(np.sign(swing)))
    period = 2 * np.mean(np.diff(crossings)) * engine.timestep
    # MuJoCo's soft contacts have a mass of their own (`ballbot.twin.mjcf`): a quarter over the inverse weights
    added = 3 / 2 * 0.25 / (engine.mobility("ball") + engine.mobility("roller 1.1"))
    assert 0.1 < added < 1.0
    assert 2 * np.pi / period == pytest.approx(np.sqrt(vertical / (3.0 + added)), rel=0.03)


def test_refuses_contacts_too_stiff_for_the_step() -> None:
    with pytest.raises(InputError, match="Reduce them or the timestep"):
        Twin(ALTEN, ideal(softness=Softness(stiffness=1e9, damping=100.0)))


def test_ball_slides_at_the_grip_of_the_floor() -> None:
    engine = lone_ball(ALTEN, ideal(floor_grip=0.1))
    for _ in range(200):  # settle
        engine.step()
    engine.qvel[:] = [0.3, 0, 0, 0, 0, 0]  # no spin: it slides
    for _ in range(200):
        engine.step()
    # MuJoCo's friction cone lifts what slides, for a moment
    assert engine.qvel[0] == pytest.approx(0.3 - 0.1 * 9.81 * 0.1, abs=0.01)


def test_ball_rolls_down_a_tilted_floor() -> None:
    """g sin(tilt) / (1 + j/(m r^2)): about +x tilts y upward, so that the ball rolls to -y."""
    engine = lone_ball(ALTEN, ideal(floor_tilt=(0.02, 0.03), friction=Friction.none(3)))
    for _ in range(1000):
        engine.step()
    rolling = 1 + 0.0242 / (3 * 0.11**2)
    expected = 9.81 * 0.5 / rolling * np.array([np.sin(0.03), -np.sin(0.02)])
    np.testing.assert_allclose(engine.qvel[:2], expected, rtol=0.01, atol=1e-4)


# From outside


def test_push_accelerates_as_the_equations_predict() -> None:
    """M q_dd = J^T F for a force on the body at height h, seen over the first 10 ms."""
    force, height = np.array([30.0, -20.0]), 0.5
    push = Push(time=0.005, duration=0.01, force=(30.0, -20.0, 0.0), height=height)
    scenario = ideal(pushes=(push,), wheel_contact="point", sensors=IDEAL.sensors)
    twin = Twin(ALTEN, scenario)
    twin.reset(None, seed=1)
    unmoved = twin.step(np.zeros(3), 0.005).truth
    assert np.abs(unmoved[5:]).max() < 1e-3
    for _ in range(2):
        pushed = twin.step(np.zeros(3), 0.005).truth
    Q = np.array([force[0], force[1], -height * force[1], height * force[0], 0.0])
    expected = 0.01 * np.linalg.solve(Model(ALTEN).mass_matrix(np.zeros(5)), Q)
    # soft contacts give way for some milliseconds
    np.testing.assert_allclose(pushed[5:9], expected[:4], rtol=0.1)
    after = twin.step(np.zeros(3), 0.005).truth
    np.testing.assert_allclose(after[5:9], pushed[5:9], rtol=0.15)  # it is over


def test_payload_moves_the_centre_of_mass() -> None:
    loaded = ideal(payload=Payload(mass=2.0, position=(0.1, -0.05, 0.6)))
    more, less = (block_of(Engine(twin_mjcf(ALTEN, one)), "body") for one in (loaded, IDEAL))
    more = more - less
    np.testing.assert_allclose(np.diag(more)[:3], 2.0, rtol=1e-12)
    # translation against rotation: m [r]x
    moment = 2.0 * np.array([[0, 0.6, 0.05], [-0.6, 0, 0.1], [-0.05, -0.1, 0]])
    np.testing.assert_allclose(more[:3, 3:], moment, atol=1e-12)


# Timing


def test_late_torques_act_a_sample_later() -> None:
    now, late = Twin(ALTEN, IDEAL), Twin(ALTEN, ideal(timing=Timing(delay=1)))
    torques = [np.array([0.3, -0.1, 0.2]), np.array([-0.2, 0.3, 0.1]), np.zeros(3)]
    now.reset(None, seed=1)
    late.reset(None, seed=1)
    first = [now.step(u, 0.005).truth for u in [np.zeros(3), *torques[:2]]]
    second = [late.step(u, 0.005).truth for u in torques]
    np.testing.assert_array_equal(first, second)


def test_jitter_keeps_the_mean_rate() -> None:
    scenario = replace(Scenario.nominal(ALTEN), timing=Timing(jitter=0.001))
    runs = []
    for _ in range(2):
        twin = Twin(ALTEN, scenario)
        twin.reset(None, seed=3)
        runs.append([twin.step(np.zeros(3), 0.005).t for _ in range(60)])
    assert runs[0] == runs[1]
    off = np.array(runs[0]) - 0.005 * np.arange(1, 61)
    assert np.abs(off).max() <= 0.001 + 1e-12
    assert len(np.unique(np.round(off / 0.0005))) == 5  # -2 to 2 steps of 0.5 ms


# Off


@pytest.mark.parametrize(
    ("faults", "sentence"),
    [
        ({"compliance": Compliance(frequency=400.0, damping_ratio=0.1)}, "too fast for a timestep"),
        ({"timing": Timing(jitter=0.003)}, "half a sample"),
        ({"load_dependence": LoadDependence(fraction=1.5)}, "must be at most 1"),
        ({"payload": Payload(mass=0.0, position=(0, 0, 0))}, r"payload\.mass is 0"),
        ({"pushes": (Push(time=0, duration=1, force=(np.nan, 0, 0), height=0),)}, r"pushes\.force is nan"),
    ],
)
def test_impossible_faults_are_refused(faults: dict[str, Any], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        Twin(ALTEN, ideal(**faults))


@pytest.mark.slow
def test_payload_is_put_on_and_taken_off() -> None:
    """While it is there, the body leans so that the common centre of mass is above the contact."""
    payload = Payload(mass=2.0, position=(0.05, 0.0, 0.6), put_on=4.0, taken_off=10.0)
    twin = Twin(ALTEN, ideal(payload=payload))
    log = simulate(twin, precise_controller(ALTEN), "hold", duration=16.0, initial_state=np.zeros(10))
    leans = log.truth()["phi"]
    moment = ALTEN.body.mass * ALTEN.body.center_of_mass + payload.mass * payload.position[2]
    expected = -payload.mass * payload.position[0] / moment
    # the robot settles within seconds; then the lean varies by less than a thousandth of a radian
    assert leans[700:790].mean() == pytest.approx(0.0, abs=3e-4)
    assert leans[1800:1990].mean() == pytest.approx(expected, abs=1e-3)
    assert leans[3000:].mean() == pytest.approx(0.0, abs=1e-3)


def test_a_twin_with_the_friction_of_a_robot_file_has_its_pivoting_too() -> None:
    own = replace(ALTEN.friction, pivoting=0.03)
    scenario = ideal(
        carpet=Carpet(rolling=0.0, pivoting=0.05, begins=1.0, ends=2.0), pivoting=0.01, friction=own
    )
    assert [floor_friction(ALTEN, scenario.at(t))[2] for t in (0.0, 1.0, 2.0)] == [0.03, 0.05, 0.03]
    model = true_model(ALTEN, scenario.at(1.0))
    assert model.pivoting == pytest.approx(0.05 * ALTEN.weight)
    assert true_model(ALTEN, ideal(pivoting=0.01)).pivoting is None


def test_carpet_is_under_the_robot_for_a_while() -> None:
    scenario = ideal(carpet=Carpet(rolling=0.03, pivoting=0.05, begins=0.01, ends=0.02), pivoting=0.01)
    twin = Twin(ALTEN, scenario)
    twin.reset()
    seen = []
    for _ in range(5):
        seen.append(twin.engine.floor_friction[2:4].tolist())
        twin.step(np.zeros(3), 0.005)
    on, off = [0.05, pytest.approx(0.03 * ALTEN.ball.radius)], [0.01, 0.0]
    # the third sample begins at 0.01 s, the fifth at 0.02 s
    assert seen == [off, off, off, on, on]
    assert twin.engine.floor_friction[2:4].tolist() == off
