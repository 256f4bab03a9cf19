"""The robot in its team's hands, against the plants that it is put together from."""

import numpy as np
import pytest

from ballbot import Robot
from ballbot.mechanics.geometry import transforms
from ballbot.robot.derived import encoder_step
from ballbot.simulation.driveline import Driveline, simulate_driveline
from ballbot.simulation.held_robot import HeldRobot
from ballbot.simulation.upside_down import ClampedBall, simulate_balls
from ballbot.twin.imperfections import true_model
from ballbot.twin.scenario_file import load_scenario

STEP = 0.005


def held(hold):
    robot = Robot.load("alten")
    return HeldRobot(true_model(robot, load_scenario("nominal", robot)).robot, hold=hold)


def test_wheels_in_the_air_are_free_drivelines():
    plant = held("in_air")
    torques = np.sin(0.1 * np.arange(400))[:, None] * [0.6, -0.5, 0.4]  # slower than the supply lets them be
    found = np.array([plant.step(one, STEP).wheel_angles for one in torques])
    wanted = [
        simulate_driveline(Driveline.of_wheel(plant.robot, i), torques[:, i], sample_time=STEP).angles
        for i in range(3)
    ]
    # a count of the encoder, and what a sample by itself rounds differently
    np.testing.assert_allclose(found.T, wanted, atol=1.01 * encoder_step(plant.robot))


@pytest.mark.slow
def test_upside_down_the_ball_turns_as_on_clamped_wheels():
    plant = held("upside_down")
    robot = plant.robot
    torques = 0.5 * np.random.default_rng(1).standard_normal((200, 3))
    found = []
    for one in torques:
        measured = plant.step(one, STEP)
        found.append(plant.ball_omega)
    wanted = simulate_balls(
        ClampedBall.of_robot(robot),
        friction=robot.friction,
        initial=np.zeros((1, 3)),
        torques=torques[None],
        sample_time=STEP,
    )[0]
    np.testing.assert_allclose(found, wanted, atol=1e-12)
    assert abs(measured.state[2] - np.pi) < 0.1


@pytest.mark.parametrize(("axis", "angle"), [(0, 0.25), (1, -0.2), (2, 1.0)])
def test_tilted_body_turns_the_wheels_the_other_way(axis, angle):
    plant = held("on_ball")
    target = np.zeros(3)
    target[axis] = angle
    plant.tilt(target)
    turned, gone = np.zeros(3), 0.0
    while plant.is_tilting:
        measured = plant.step(np.zeros(3), STEP)
        turned += STEP * measured.gyro
        gone += STEP
    noise = 6.0 * plant.robot.sensors.gyro_noise * STEP * np.sqrt(gone / STEP)
    # one angle after the other is a turn about one axis of the body; a sum of rates over samples has the first order
    np.testing.assert_allclose(turned, target, atol=noise + 0.02 * abs(angle))
    np.testing.assert_allclose(
        measured.wheel_angles, -transforms(plant.robot).T_owb @ target, atol=1.01 * encoder_step(plant.robot)
    )
    np.testing.assert_allclose(measured.truth[2:5], target, atol=1e-12)
