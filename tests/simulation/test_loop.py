"""The compiled loop against the same robot, sensors, estimator and controller called one sample at a time."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from ballbot import Controller, InputError, Log, Model, simulate, simulate_batch
from ballbot.control.presets import nominal_controller, precise_controller
from ballbot.control.references import circle
from ballbot.simulation.imperfections import Imperfections, Push, Supply
from ballbot.simulation.model_plant import ModelPlant
from ballbot.simulation.sensed_plant import SensedPlant
from ballbot.simulation.sensors import SensorFaults
from tests.support.control_examples import FRICTION, alten, four_wheeled

ROBOT = alten(FRICTION)
START = np.array([0.01, -0.02, 0.02, -0.01, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0])
SENSORS = ROBOT.sensors
FAULTS = SensorFaults(gyro_bias=0.002, gyro_bias_walk=1e-4, lean_error=0.003, latency=0.01)
PLAY = np.radians(1.0)


def assert_one_by_one(controller: Controller, imperfections: Imperfections, duration: float) -> None:
    """Check that a lane's log is that of the plant that is called one sample at a time."""
    model = Model(controller.robot)
    batch = simulate_batch(
        model,
        controller,
        circle(),
        duration=duration,
        initial_states=START,
        imperfections=imperfections,
    )
    plant = SensedPlant(model, imperfections, estimator=controller.estimator)
    log = simulate(
        plant, controller, circle(), duration=duration, initial_state=START, seed=imperfections.seed
    )
    # vector code rounds in another order; in a second sticking and play multiply that by some 1e4
    assert_same(batch.log(0), log, atol=1e-9)


def assert_same(one: Log, other: Log, *, atol: float) -> None:
    assert set(one.names) == set(other.names)
    assert one.ended == other.ended
    for name in one.names:
        np.testing.assert_allclose(one[name], other[name], atol=atol, err_msg=name)


@pytest.mark.parametrize(
    ("imperfections", "estimator"),
    [
        pytest.param(Imperfections(sensors=SENSORS), "onboard", id="on-board state"),
        pytest.param(Imperfections(sensors=SENSORS, torque_noise=0.01), "kalman", id="kalman filter"),
        pytest.param(
            Imperfections(sensors=SENSORS, speed_window=3), "onboard", id="speeds over three samples"
        ),
        pytest.param(
            Imperfections(sensors=SENSORS, delay=1, slope=(0.02, -0.01)), "kalman", id="delay and slope"
        ),
        pytest.param(Imperfections(sensors=SENSORS, sensor_faults=FAULTS), "kalman", id="faults of the AHRS"),
        pytest.param(
            Imperfections(
                sensors=SENSORS,
                # so weak that it limits the torques
                supply=Supply(winding_resistance=20.0, internal_resistance=5.0),
                imbalance=(0.05, -0.02),
                slope=(0.0, 0.01),
            ),
            "onboard",
            id="battery and a body off its axis",
        ),
        pytest.param(
            Imperfections(
                sensors=SENSORS,
                torque_noise=0.01,
                delay=1,
                backlash=PLAY,
                slope=(0.01, 0.0),
                sensor_faults=FAULTS,
            ),
            "kalman",
            id="all with play",
        ),
    ],
)
def test_a_lane_is_the_plant_one_sample_at_a_time(imperfections, estimator):
    controller = precise_controller(ROBOT).with_estimator(estimator)
    assert_one_by_one(controller, replace(imperfections, seed=5), 1.0)


def test_a_lane_with_perfect_sensors_is_the_model_one_sample_at_a_time():
    controller = nominal_controller(ROBOT)
    batch = simulate_batch(ROBOT, controller, circle(), duration=1.0, initial_states=START)
    log = simulate(ROBOT, controller, circle(), duration=1.0, initial_state=START)
    assert_same(batch.log(0), log, atol=1e-9)


def test_a_heading_that_begins_again_after_a_turn_is_unwrapped_as_by_simulate():
    def turning(t: float) -> NDArray[np.float64]:
        wanted = np.zeros(10)
        wanted[4] = (2.0 + 4.0 * t + np.pi) % (2.0 * np.pi) - np.pi  # jumps from pi to -pi at 0.29 s
        return wanted

    controller = nominal_controller(ROBOT)
    batch = simulate_batch(ROBOT, controller, turning, duration=0.6, initial_states=START)
    log = simulate(ROBOT, controller, turning, duration=0.6, initial_state=START)
    assert np.diff(batch.references[:, 4]) == pytest.approx(0.02)
    assert_same(batch.log(0), log, atol=1e-9)


def test_the_log_of_a_fall_ends_before_it():
    limp = Controller(ROBOT, np.zeros((3, 10)))
    imperfections = Imperfections(sensors=SENSORS, fallen_lean=0.4)
    batch = simulate_batch(ROBOT, limp, circle(), duration=5.0, imperfections=imperfections)
    log = simulate(SensedPlant(Model(ROBOT), imperfections), limp, circle(), duration=5.0)
    assert_same(batch.log(0), log, atol=1e-8)
    assert batch.log(0).ended == log.ended != None  # noqa: E711
    with pytest.raises(InputError, match="every sample"):
        simulate_batch(ROBOT, limp, circle(), duration=1.0, every=2).log(0)


@pytest.mark.slow
def test_four_wheels_with_play_are_the_plant_one_sample_at_a_time():
    robot = four_wheeled(friction=True)
    controller = nominal_controller(robot, compensation="full")
    imperfections = Imperfections(sensors=robot.sensors, torque_noise=0.01, backlash=PLAY)
    assert_one_by_one(controller, replace(imperfections, seed=3), 0.5)


@pytest.mark.slow
def test_friction_by_direction_with_play_is_the_plant_one_sample_at_a_time():
    robot = ROBOT.replace(friction=replace(FRICTION, coulomb_asymmetry=(0.02, -0.01, 0.0)))
    imperfections = Imperfections(sensors=SENSORS, torque_noise=0.01, backlash=PLAY)
    assert_one_by_one(nominal_controller(robot), replace(imperfections, seed=3), 0.5)


def test_lanes_do_not_notice_each_other():
    """Seeds, robots and controllers of one lane, whatever runs beside it: a robot that falls, or a state of NaN."""
    precise, none = precise_controller(ROBOT), Controller(ROBOT, np.zeros((3, 10)), estimator="kalman")
    imperfections = Imperfections(sensors=SENSORS, torque_noise=0.01, backlash=PLAY, fallen_lean=0.6)
    # in the same lanes: vector code and the scalar code for the remaining lanes round differently
    alike = simulate_batch(
        Model(ROBOT),
        precise,
        circle(),
        duration=0.5,
        initial_states=START,
        imperfections=[replace(imperfections, seed=7)] * 12,
    )
    beside = simulate_batch(
        Model(ROBOT),
        [none, precise, precise] * 4,
        circle(),
        duration=0.5,
        initial_states=START,
        imperfections=[replace(imperfections, seed=seed) for seed in (1, 7, 2) * 4],
    )
    np.testing.assert_array_equal(beside.states[1], alike.states[1])
    np.testing.assert_array_equal(beside.states[10], alike.states[10])
    assert not np.array_equal(beside.states[2], alike.states[2])


def test_a_push_changes_the_velocities_by_its_impulse():
    """Against `ModelPlant.push`: 0.05 s at 12 N along x, 0.4 m above the ball's centre, is 0.6 N s and 0.24 N m s."""
    controller = Controller(ROBOT, np.zeros((3, 10)))
    push = Push(time=0.0, duration=0.005, force=(12.0, 0.0, 0.0), height=0.4)
    batch = simulate_batch(
        Model(ROBOT),
        controller,
        circle(),
        duration=0.005,
        initial_states=np.zeros(10),
        imperfections=Imperfections(pushes=(push,)),
    )
    plant = ModelPlant(Model(ROBOT))
    plant.reset()
    plant.push([12.0 * 0.005, 0.0, 0.0, 0.4 * 12.0 * 0.005, 0.0])  # upright, phi turns the top forward
    expected = plant.step(np.zeros(3), 0.005).truth
    np.testing.assert_allclose(batch.finals[0], expected, atol=1e-12)


def test_a_lag_is_the_first_order_filter_of_the_torques():
    """A robot that cannot move shows its torques' mean by its speed: the filter's mean over the first sample."""
    controller = nominal_controller(alten())
    batch = [
        simulate_batch(
            Model(alten()),
            controller,
            circle(),
            duration=0.005,
            initial_states=START,
            imperfections=Imperfections(lag=lag),
        ).finals[0]
        for lag in (0.0, 1e-9, 0.002)
    ]
    still = simulate_batch(
        Model(alten()),
        Controller(alten(), np.zeros((3, 10))),
        circle(),
        duration=0.005,
        initial_states=START,
        imperfections=Imperfections(),
    ).finals[0]
    np.testing.assert_allclose(batch[1], batch[0], atol=1e-9)
    share = (batch[2] - still)[7:9] / (batch[0] - still)[7:9]
    # mean of 1 - exp(-t/2 ms) over 5 ms; the motion within the sample changes it by some 1e-3
    np.testing.assert_allclose(share, 1.0 - 0.4 * (1.0 - np.exp(-2.5)), atol=0.01)


def test_what_a_batch_cannot_run_is_refused():
    controller = precise_controller(ROBOT)
    slow = Imperfections(sensors=replace(SENSORS, sample_time=0.01))
    with pytest.raises(InputError, match=r"every 0\.01 s and the controllers every 0\.005 s"):
        simulate_batch(Model(ROBOT), controller, circle(), duration=1.0, imperfections=slow)
    with pytest.raises(InputError, match="all lanes of a batch have play or none"):
        simulate_batch(
            Model(ROBOT),
            controller,
            circle(),
            duration=1.0,
            imperfections=[Imperfections(backlash=PLAY), Imperfections()],
        )
    with pytest.raises(InputError, match="'thesis'"):
        simulate_batch(
            Model(ROBOT, "thesis"),
            controller,
            circle(),
            duration=1.0,
            imperfections=Imperfections(sensors=SENSORS),
        )
