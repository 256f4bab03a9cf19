"""The robot's friction law: its optional terms in file, model, convex step, gear play and batch alike."""

from dataclasses import fields, replace

import numpy as np
import pytest

from ballbot import Model, Robot
from ballbot.errors import InputError
from ballbot.fitting.intervals import Uncertainty
from ballbot.identification.quantities import Bounds, scale_between
from ballbot.identification.stated_uncertainty import found_robot
from ballbot.mechanics.friction import wheel_friction
from ballbot.robot import Friction
from ballbot.robot.components import scaled_friction
from ballbot.robot.file import robot_text
from ballbot.simulation.imperfections import Imperfections
from ballbot.simulation.sensed_plant import SensedPlant
from tests.support.control_examples import FRICTION, alten

COULOMB = (0.03, -0.02, 0.04)
STRIBECK = (-0.02, 0.01, 0.05)
LOAD = (0.2, 0.1, 0.3)
FULL = replace(FRICTION, coulomb_asymmetry=COULOMB, stribeck_asymmetry=STRIBECK, load=LOAD)
STATE = np.array([0.0, 0.0, 0.02, 0.01, 0.3, 0.1, 0.0, 0.0, 0.0, 0.3])
TORQUES = np.array([0.3, -0.2, 0.25])


def test_terms_survive_the_robot_file_and_absent_terms_are_not_written(tmp_path):
    alten(FULL).write(tmp_path / "robot.toml")
    assert Robot.load(tmp_path / "robot.toml").friction == FULL
    text = robot_text(alten(FRICTION))
    assert "asymmetry" not in text
    assert "\nload" not in text.split("[friction]")[1]


def test_every_term_but_the_shape_of_the_stribeck_curve_is_scaled():
    scaled = scaled_friction(FULL, (2.0, 3.0, 4.0), rolling_factor=5.0)
    for one in fields(Friction):
        before, after = getattr(FULL, one.name), getattr(scaled, one.name)
        if one.name in ("stribeck_speed", "stribeck_exponent", "law", "own"):
            assert after == before
        else:
            factors = (2.0, 3.0, 4.0) if isinstance(before, tuple) else 5.0
            assert after == pytest.approx(np.multiply(factors, before), rel=1e-15), one.name


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"coulomb_asymmetry": (0.0, 0.0, 0.2)}, "asymmetry[2] is 0.2 N m; it must be from -0.12 to 0.12"),
        ({"stribeck_asymmetry": (-0.06, 0.0, 0.0)}, "stribeck_asymmetry[0] is -0.06 N m"),
        ({"load": (0.1, 0.1)}, "friction.load has 2 numbers"),
        ({"load": (1.1, 0.0, 0.0)}, "friction.load[0] is 1.1"),
        ({"load": (-0.1, 0.0, 0.0)}, "friction.load[0] is -0.1; it cannot be negative"),
    ],
)
def test_terms_that_no_friction_has_are_refused(change, words):
    with pytest.raises(InputError) as refusal:
        alten(replace(FRICTION, **change))
    assert words in str(refusal.value)


def test_wheel_friction_is_that_of_the_direction_plus_the_load():
    speeds = np.array([[-2.0, -0.3, 0.4], [1.5, 0.2, -0.1], [0.0, 0.0, 0.0]])
    sign, E = np.sign(speeds), np.exp(-((np.abs(speeds) / 0.6) ** 1.1))
    size = (
        FRICTION.coulomb + sign * COULOMB + LOAD * np.abs(TORQUES) + (FRICTION.stribeck + sign * STRIBECK) * E
    )
    expected = FRICTION.viscous * speeds + size * sign
    np.testing.assert_allclose(wheel_friction(speeds, FULL, torque=TORQUES), expected, rtol=1e-14)


@pytest.mark.slow
@pytest.mark.parametrize("friction", [FRICTION, FULL], ids=["plain", "full"])
def test_friction_of_moving_wheels_and_of_the_ball_is_that_of_numpy(friction):
    """Accelerations, from a short step, against M q_ddot = .. - W^T tau(w) - N C_rr v/|v|."""
    rng, h = np.random.default_rng(3), 1e-6
    model, free = Model(alten(friction)), Model(alten(Friction.none(3)))
    for _ in range(20):
        q = np.concatenate([np.zeros(2), rng.uniform(-1.1, 1.1, 2), rng.uniform(-20, 20, 1)])
        q_dot = rng.uniform(-3, 3, 5)
        net = TORQUES - wheel_friction(free.wheel_speed(q, q_dot), friction, torque=TORQUES)
        floor = -model.robot.weight * friction.rolling * q_dot[:2] / np.hypot(*q_dot[:2])
        by_floor = np.linalg.solve(free.mass_matrix(q), np.append(floor, np.zeros(3)))
        expected = free.acceleration(q, q_dot, net) + by_floor
        rate = (model.advance(np.concatenate([q, q_dot]), TORQUES, h)[5:] - q_dot) / h
        # one-sided difference: h times the jerk (at most some 1e3) and rounding 1e-16 * 20 / h
        np.testing.assert_allclose(rate, expected, atol=2e-2 * max(1.0, np.abs(expected).max() / 10))


@pytest.mark.slow
@pytest.mark.parametrize("direction", [1.0, -1.0])
@pytest.mark.parametrize("excess", [-1e-6, 1e-6])
def test_a_wheel_breaks_away_at_the_limit_of_its_direction(direction, excess):
    """Equal wheels, heading torque only: the robot turns about the vertical once the torque passes the limit."""
    friction = replace(FRICTION, coulomb=(0.1,) * 3, stribeck=(0.04,) * 3, coulomb_asymmetry=(0.03,) * 3)
    friction = replace(friction, stribeck_asymmetry=(0.01,) * 3, load=(0.2,) * 3)
    model = Model(alten(friction))
    # T = g + mu T at the limit
    limit = (0.18 if direction > 0 else 0.10) / (1.0 - 0.2)
    torque = direction * limit * (1.0 + excess)
    end = model.advance(np.zeros(10), np.full(3, torque), 0.1)
    assert end.any() == (excess > 0)


@pytest.mark.slow
def test_gear_play_has_the_whole_law_at_its_motors():
    play = Imperfections(backlash=0.02)
    directed = SensedPlant(Model(alten(replace(FRICTION, coulomb_asymmetry=COULOMB, load=LOAD))), play)
    coulomb = tuple((np.array(FRICTION.coulomb) + np.array(LOAD) * np.abs(TORQUES)).tolist())
    plain = SensedPlant(Model(alten(replace(FRICTION, coulomb=coulomb))), play)
    ours, theirs = (one.reset(STATE, seed=3) for one in (directed, plain))
    for _ in range(40):
        ours, theirs = directed.step(TORQUES, 0.005), plain.step(TORQUES - COULOMB, 0.005)
    np.testing.assert_allclose(ours.state, theirs.state, rtol=0, atol=1e-10)


def test_identified_terms_stand_in_the_robot(tmp_path):
    """The ladder's offsets are friction by direction, as far as c; its load is the friction's load."""
    values = np.array(
        [*FRICTION.viscous, *FRICTION.coulomb, *FRICTION.stribeck, 0.6, 1.1, 0.007, *LOAD, -0.03, 0.02, 0.5]
    )
    bounds = Bounds({"load": (0.0, 1.0), "torque_offset": (-1.0, 1.0)})
    coordinates = scale_between(alten(), bounds=bounds)
    point = coordinates.scaled(values)
    sizes = 0.001 / coordinates.slopes(point)
    estimate = Uncertainty(coordinates=coordinates, point=point, covariance=np.diag(sizes**2), intervals={})
    torque = (0.0, np.zeros(len(values)))
    robot = found_robot(
        alten(Friction.none(3)), coordinates.layout, estimate, torque=torque, log_count=1, asymmetric=True
    )
    np.testing.assert_allclose(robot.friction.load, LOAD)
    np.testing.assert_allclose(robot.friction.coulomb, FRICTION.coulomb)
    np.testing.assert_allclose(robot.friction.coulomb_asymmetry, (0.03, -0.02, -0.12))
    assert robot.sources["friction.load"].startswith("identified: from 1 log")
    robot.write(tmp_path / "found.toml")
    assert Robot.load(tmp_path / "found.toml").friction == robot.friction
    # without the law, an offset is the motor's, and no friction
    motor = found_robot(alten(Friction.none(3)), coordinates.layout, estimate, torque=torque, log_count=1)
    assert motor.friction == replace(robot.friction, coulomb_asymmetry=())
