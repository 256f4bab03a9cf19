"""Prediction over the delay: the augmented Riccati equation's gain, and a late plant that moves as a punctual one."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm, solve_discrete_are

from ballbot import Controller, Model, Robot
from ballbot.control.lqr import held
from ballbot.control.parts import Parts
from ballbot.control.parts.disturbance_observer import DisturbanceObserver
from ballbot.control.parts.prediction import DelayPrediction
from ballbot.control.presets import (
    NOMINAL_STATE_WEIGHTS,
    NOMINAL_TORQUE_WEIGHT,
    design_gain,
    precise_controller,
)
from ballbot.control.references import change_pose
from ballbot.simulation.batch import simulate_batch
from ballbot.simulation.imperfections import Imperfections
from ballbot.simulation.model_plant import ModelPlant
from tests.support.control_examples import alten, four_wheeled, leaning

SAMPLE = 0.005


def predicting(robot: Robot, delay: float) -> Controller:
    """Return the nominal gain with no limit to speak of, for torques that come late."""
    parts = Parts(prediction=DelayPrediction(delay=delay))
    return Controller(robot, design_gain(robot).gain, torque_limit=1e3, parts=parts)


def linear(robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    model = Model(robot).linearize()
    return np.asarray(model.A), np.asarray(model.B)


@pytest.mark.parametrize(
    ("robot", "samples"), [(alten(), 1), (alten(), 5), (four_wheeled(friction=False), 2)]
)
def test_whole_samples_give_the_gain_of_the_riccati_equation_with_the_torques_under_way(robot, samples):
    n = robot.wheel_count
    F, G = held(*linear(robot), SAMPLE)
    # state and the torques under way, the oldest first: it acts now, all move up, and the new one joins them
    size = 10 + samples * n
    A, B = np.zeros((size, size)), np.zeros((size, n))
    A[:10, :10], A[:10, 10 : 10 + n] = F, G
    A[10 : size - n, 10 + n :] = np.eye((samples - 1) * n)
    B[size - n :] = np.eye(n)
    Q, R = np.zeros((size, size)), NOMINAL_TORQUE_WEIGHT * np.eye(n)
    Q[:10, :10] = np.diag(NOMINAL_STATE_WEIGHTS)
    P = solve_discrete_are(A, B, Q, R)
    gain = np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)
    controller, random = predicting(robot, samples * SAMPLE), np.random.default_rng(samples)
    under_way = np.zeros(samples * n)
    for _ in range(samples + 3):
        state = 1e-4 * random.standard_normal(10)
        state[4] = 0.0  # the gain is that at psi = 0
        found = controller.update(0.0, state, np.zeros(10))
        wanted = -gain @ np.concatenate((state, under_way))
        # of torques of 3e-3 N m; that the heading turns meanwhile is of second order, 3e-9
        np.testing.assert_allclose(found, wanted, atol=1e-8)
        under_way = np.concatenate((under_way[n:], found))


@pytest.mark.parametrize("delay", [0.002, 0.0123])
def test_a_late_linear_robot_moves_as_a_punctual_one_from_where_it_is_when_the_first_torque_acts(delay):
    robot = alten()
    A, B = linear(robot)
    controller = predicting(robot, delay)
    K = design_gain(robot).gain
    F, G = held(A, B, SAMPLE)
    per_sample = 50  # the delay in whole parts of a sample, so that the late robot is stepped exactly
    A_part, B_part = held(A, B, SAMPLE / per_sample)
    late = round(delay / SAMPLE * per_sample)
    x, torques, when_acts = leaning(0.02, -0.03), [], []
    for k in range(200 * per_sample):
        if k % per_sample == 0:
            torques.append(controller.update(0.0, x, np.zeros(10)))
        acting = (k - late) // per_sample
        if k >= late and (k - late) % per_sample == 0:
            when_acts.append(x)
        x = A_part @ x + (B_part @ torques[acting] if acting >= 0 else 0.0)
    punctual = expm(A * delay) @ leaning(0.02, -0.03)
    for found in when_acts:
        # rounding of 1e-16, grown by the unstable pole and fed back
        np.testing.assert_allclose(found, punctual, atol=1e-10)
        punctual = (F - G @ K) @ punctual


def test_prediction_does_not_depend_on_the_heading():
    robot = alten()
    controller, psi = predicting(robot, 0.012), 2.3
    random = np.random.default_rng(4)
    states = 0.01 * random.standard_normal((6, 10))
    states[:, [4, 9]] = 0.0
    straight = [controller.update(0.0, state, np.zeros(10)) for state in states]
    controller.reset()
    c, s = np.cos(psi), np.sin(psi)
    for state, wanted in zip(states, straight, strict=True):
        turned, reference = state.copy(), np.zeros(10)
        for i in (0, 2, 5, 7):
            turned[i], turned[i + 1] = c * state[i] - s * state[i + 1], s * state[i] + c * state[i + 1]
        turned[4] = reference[4] = psi
        np.testing.assert_allclose(controller.update(0.0, turned, reference), wanted, atol=1e-12)


def test_a_moving_reference_is_followed_without_the_delays_lag():
    robot, delay = alten(), 6
    stiff = precise_controller(robot, compensation="none")
    knows = stiff.with_parts(replace(stiff.parts, prediction=DelayPrediction(delay=delay * SAMPLE)))
    ramp = change_pose(x=2.0, y=0.0, psi=0.0, at=1.0, ramp=10.0)

    def behind(controller: Controller, late: int) -> float:
        delayed = Imperfections(delay=late)
        found = simulate_batch(Model(robot), controller, ramp, duration=11.0, imperfections=delayed)
        steady = (found.t > 9.0) & (found.t < 10.9)
        asked = np.array([ramp(t)[0] for t in found.t[steady]])
        return float(np.abs(found.states[0, steady, 0] - asked).max())

    # without the lead the robot is 30 ms late at 0.2 m/s, 6 mm
    assert behind(knows, delay) < behind(stiff, 0) + 0.001


@pytest.mark.parametrize("delay", [1, 4])
def test_observer_uses_the_torque_that_acted(delay):
    """Without friction nothing is lost, however late the torques are."""
    robot = alten()
    parts = Parts(
        prediction=DelayPrediction(delay=delay * SAMPLE), disturbance_observer=DisturbanceObserver(limit=0.5)
    )
    controller = Controller(robot, design_gain(robot).gain, parts=parts)
    plant, waiting, back = ModelPlant(Model(robot)), [np.zeros(3)] * delay, 0.0
    state = plant.reset(leaning(0.05), seed=0).state
    for k in range(800):
        waiting.append(controller.update(k * SAMPLE, state, np.zeros(10)))
        state = plant.step(waiting.pop(0), SAMPLE).state
        back = max(back, float(np.abs(controller.memory["disturbance_observer"]["estimate"][0, :3]).max()))
    # of torques of 0.6 N m; a sample too late or too early makes it 0.06, and linearising leaves 0.003
    assert back < 0.01
