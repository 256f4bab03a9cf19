"""Whole logs among runs of the models: logs that the loop itself made, and numbers of known swings."""

import numpy as np
import pytest

from ballbot.control.controller import Controller
from ballbot.control.references import square
from ballbot.log import STATE_NAMES
from ballbot.mechanics.model import Model
from ballbot.robot import Sensors
from ballbot.simulation.batch import simulate_batch
from ballbot.simulation.imperfections import Imperfections, RollerContacts
from ballbot.simulation.run import initial_state_of
from ballbot.validation.closed_loop import recover_gain
from ballbot.validation.models import RUNS, Case, ModelPair, Trajectories, least_of, stretches
from ballbot.validation.whole_log import WholeLog, _numbers, compare_whole_log
from tests.support.validation_examples import gain, true_robot

SENSORS = Sensors(
    encoder_counts=4096, gyro_noise=2e-3, attitude_noise=1.7e-3, heading_drift=0.0, sample_time=0.005
)


def _beside_own_model(*, logs: int, duration: float) -> list[WholeLog]:
    """Return comparisons of logs that the loop made of the robot with its play and rollers, through its sensors."""
    robot = true_robot().replace(sensors=SENSORS)
    models = ModelPair.by_friction(Model(robot))
    made = simulate_batch(
        models.first.model,
        Controller(robot, gain(), estimator="onboard"),
        square(period=8.0),
        duration=duration,
        initial_states=np.array([initial_state_of(seed) for seed in range(logs)]),
        imperfections=Imperfections(
            sensors=SENSORS,
            backlash=robot.drive.backlash,
            contacts=RollerContacts(rollers=robot.wheels.rollers),
            seed=5,
        ),
    )
    found = []
    for seed in range(logs):
        log = made.log(seed).without_truth()
        recovered = recover_gain(log)
        found.append(
            compare_whole_log(
                Case(models=models, log=log, parts=stretches(log), seed=seed),
                Controller(robot, recovered.gain, sample_time=log.sample_time),
                delay=recovered.delay,
            )
        )
    return found


@pytest.mark.slow
def test_a_log_lies_within_its_own_model_s_range_and_outside_that_without_friction():
    found = _beside_own_model(logs=4, duration=16.0)
    inside = np.mean([one.sides == 0 for one in found], axis=0)  # (model, quantity, state)
    # nominally 95 % of 120 numbers; those of a log depend on each other, so that they scatter like those of four logs
    # with a few independent numbers each. 24 logs of 32 s, seeds of their own: 96.7 %
    assert 0.85 <= inside[0].mean() <= 0.995
    # the sticky robot's limit cycle: its heading swings, which nothing without friction does
    heading = STATE_NAMES.index("psi")
    assert inside[1, :2, heading].max() == 0.0
    assert np.mean([one.sides[1, 0] for one in found]) > 0.5  # friction makes deviations larger: above
    least = np.array([least_of(one.own_inside) for one in found])
    # of 24 logs, seeds of their own, none is below
    assert np.all((np.array([one.sides[0] for one in found]) == 0).sum(axis=(1, 2)) >= least)
    assert np.all((np.array([one.sides[1] for one in found]) == 0).sum(axis=(1, 2)) < least)


def test_a_model_rejects_5_percent_of_its_own_runs_and_those_of_another():
    random = np.random.default_rng(2)
    # thirty numbers that depend on each other, of 150 logs and their models' runs; some runs end early
    numbers = random.normal(size=(150, RUNS + 1, 3, 10)) + 2.0 * random.normal(size=(150, RUNS + 1, 1, 1))
    numbers[random.random((150, RUNS + 1)) < 0.02] = np.inf
    below = {}
    for name, shift in (("its own", 0.0), ("another's", -12.0)):
        logs = [_whole_log(of_log[0] + shift, of_log[1:]) for of_log in numbers]
        below[name] = np.mean([(one.sides[0] == 0).sum() < least_of(one.own_inside) for one in logs])
    assert below["its own"] <= 0.05 + 3.0 * np.sqrt(0.05 * 0.95 / 150)
    assert below["another's"] > 0.9


def _whole_log(measured: np.ndarray, runs: np.ndarray) -> WholeLog:
    nothing = Trajectories(t=np.zeros(0), **dict.fromkeys(("measured", "first", "second"), np.zeros((0, 10))))
    return WholeLog(
        models=ModelPair.by_friction(Model(true_robot())),
        duration=16.0,
        measured=measured,
        runs=np.array([runs, runs]),
        fell=(0, 0),
        example=nothing,
    )


def test_swings_of_a_noisy_sine_have_its_amplitude_and_period():
    t = 0.02 * np.arange(3000)
    noise = 0.05 * np.random.default_rng(3).normal(size=(3000, 10))
    deviation = (0.3 + 0.5 * np.sin(2.0 * np.pi * t / 4.0))[:, None] + noise
    rms, amplitude, period = _numbers(deviation, 0.02)
    np.testing.assert_allclose(rms, np.sqrt(0.3**2 + 0.5**2 / 2.0 + 0.05**2), rtol=0.01)
    # the farthest of a swing's 100 points is about two deviations of the noise beyond the sine
    np.testing.assert_allclose(amplitude, 0.5 + 2.0 * 0.05, rtol=0.05)
    np.testing.assert_allclose(period, 4.0, rtol=0.01)
