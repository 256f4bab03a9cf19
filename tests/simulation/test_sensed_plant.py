"""The model seen through sensors: what each imperfection does, against the model, plain mechanics and the twin."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import fsolve

from ballbot import InputError, Model, Robot, simulate
from ballbot.control.presets import nominal_controller, precise_controller
from ballbot.control.references import hold
from ballbot.mechanics.engine.arrays import accelerations, wheel_speeds_at
from ballbot.mechanics.engine.lanes import AHEAD, LANES, PASSED, unpacked
from ballbot.mechanics.geometry import body_rates_matrix, rotation, rotation_to, transforms
from ballbot.robot.derived import encoder_step
from ballbot.simulation.imperfections import Imperfections, Push, Supply, packed_on_floor
from ballbot.simulation.model_plant import ModelPlant
from ballbot.simulation.sensed_plant import SensedPlant
from ballbot.twin import Scenario, Twin
from ballbot.twin.faults import CurrentLoop, Payload, Timing
from ballbot.twin.imperfections import imperfections_of, true_model
from tests.support.control_examples import FRICTION, alten, leaning

pytestmark = pytest.mark.slow  # its engine takes long to compile

SAMPLE = 0.005
FREE, STUCK = Model(alten()), Model(alten(FRICTION))
#: encoders count and samples are held, and nothing else errs
PERFECT = Imperfections(
    sensors=replace(FREE.robot.sensors, gyro_noise=0.0, attitude_noise=0.0, heading_drift=0.0)
)
NOMINAL = imperfections_of(Scenario.nominal(Robot.load("alten")))
DRIVE = FREE.robot.drive
ROTOR = DRIVE.reflected_inertia
PLAY = math.radians(1.0)
#: turns the robot about the vertical alone
TURNING = np.ones(3)


def of_wheels(plant: SensedPlant, first: int) -> np.ndarray:
    """Return a number of each wheel (n,) from the work array: its place in the play, or the torque passed on."""
    return plant._memory.work[0, first * LANES : (first + plant.robot.wheel_count) * LANES : LANES].copy()


def torques_of(seed: int, samples: int, size: float = 0.3) -> np.ndarray:
    return size * np.random.default_rng(seed).uniform(-1.0, 1.0, (samples, 3))


def run(plant, torques, start=None, seed=0):
    """Return the measurements at the start and after each sample."""
    return [plant.reset(start, seed=seed), *(plant.step(u, SAMPLE) for u in torques)]


def truths(measurements) -> np.ndarray:
    return np.array([one.truth for one in measurements])


def geared(model: Model, play: float = PLAY, sample: float = 5e-4) -> SensedPlant:
    """Return a robot with play and perfect sensors."""
    sensors = replace(model.robot.sensors, sample_time=sample)
    pivoting = {"pivoting": 100.0} if model.pivots else {}
    return SensedPlant(Model(model.robot.replace(sensors=sensors), **pivoting), Imperfections(backlash=play))


def test_without_imperfections_it_is_the_model():
    start, torques = leaning(0.02, -0.03), torques_of(1, 100)
    sensed, model = run(SensedPlant(STUCK, PERFECT), torques, start), run(ModelPlant(STUCK), torques, start)
    # the same step, compiled into another function: its vector code rounds in another order
    np.testing.assert_allclose(truths(sensed), truths(model), atol=1e-9)
    assert [one.t for one in sensed] == [one.t for one in model]
    # the lean is measured without error here
    np.testing.assert_array_equal([one.state[2:5] for one in sensed], truths(sensed)[:, 2:5])


@pytest.mark.parametrize("delay", [1, 3])
def test_late_torques_are_the_same_torques_later(delay):
    torques = torques_of(2, 60)
    late = run(SensedPlant(FREE, replace(PERFECT, delay=delay)), torques)
    shifted = np.concatenate([np.zeros((delay, 3)), torques[:-delay]])
    np.testing.assert_array_equal(truths(late), truths(run(SensedPlant(FREE, PERFECT), shifted)))


@pytest.mark.parametrize("backlash", [0.0, PLAY])
def test_encoders_count_the_motors_angles(backlash):
    plant = SensedPlant(STUCK, replace(NOMINAL, backlash=backlash))
    plant.reset(leaning(0.05), seed=2)
    start = plant.motor_angles
    count = encoder_step(STUCK.robot, NOMINAL.sensors)
    before = np.zeros(3)
    for u in torques_of(3, 40, size=2.0):
        measured = plant.step(u, SAMPLE)
        whole = np.floor((plant.motor_angles - start) / count)
        # counts are compared, so rounding of the product is far below one
        np.testing.assert_allclose(measured.wheel_angles / count, whole, atol=1e-6)
        np.testing.assert_allclose(measured.wheel_speeds, (measured.wheel_angles - before) / SAMPLE)
        before = measured.wheel_angles
    assert np.abs(plant.motor_angles - start).min() > 10 * count


def test_noise_of_torques_has_its_deviation():
    # at rest, a sample's change of the velocities is M^-1 W^T (u + noise) h; from it the noise, by least squares
    plant = SensedPlant(FREE, replace(PERFECT, torque_noise=0.05))
    W = FREE.wheel_jacobian(np.zeros(5))
    push = SAMPLE * np.linalg.solve(FREE.mass_matrix(np.zeros(5)), W.T)
    noise = []
    for seed in range(200):
        plant.reset(seed=seed)
        noise.append(np.linalg.lstsq(push, plant.step(np.zeros(3), SAMPLE).truth[5:], rcond=None)[0])
    # 600 numbers: the deviation's own is 3 %
    assert np.std(noise) == pytest.approx(0.05, rel=0.12)
    assert abs(np.mean(noise)) < 4 * 0.05 / math.sqrt(600)


def test_a_motor_at_its_highest_speed_drives_no_more_but_brakes():
    top = DRIVE.top_speed
    spinning = np.zeros(10)
    turn = FREE.wheel_jacobian(np.zeros(5)) @ np.eye(5)[4]
    spinning[9] = top / turn[0]
    plant = SensedPlant(FREE, PERFECT)
    free, driven, braked = (run(plant, [u * TURNING], spinning)[-1].truth[9] for u in (0.0, 1.0, -1.0))
    assert abs(driven - free) < 1e-9
    assert abs(braked) < abs(free) - 1e-3


# --- play ---


def test_a_motor_crosses_its_play_in_the_time_that_its_inertia_takes():
    plant, torque = geared(FREE), 0.1
    for seed in range(5):
        plant.reset(seed=seed)
        gaps = 0.5 * PLAY - of_wheels(plant, AHEAD)
        crossed = np.full(3, np.nan)
        for k in range(60):
            plant.step(torque * TURNING, 5e-4)
            place = of_wheels(plant, AHEAD)
            crossed[np.isnan(crossed) & (place >= 0.5 * PLAY - 1e-12)] = (k + 1) * 5e-4
        # the others' impacts move a wheel that is still waiting: only the first motor's crossing is its own
        first = np.argmin(gaps)
        expected = math.sqrt(2.0 * gaps[first] * ROTOR / torque)
        # steps of 0.5 ms: speed one step late or early, and the stop found at a step's end
        assert crossed[first] == pytest.approx(expected, abs=1e-3), seed


@pytest.mark.parametrize("pattern", [TURNING, np.array([1.0, -1.0, 0.0]), np.array([-1.0, 0.3, 0.6])])
def test_the_impact_at_the_stop_conserves_momentum(pattern):
    plant = geared(FREE)
    before = plant.reset(seed=1)
    for _ in range(4):
        before = plant.step(0.1 * pattern, 5e-4)
    assert np.all(before.truth == 0.0)  # nothing is transmitted in the gap
    spinning = before.wheel_speeds
    np.testing.assert_allclose(spinning, 0.1 * pattern * 4 * 5e-4 / ROTOR, rtol=1e-12)
    for _ in range(400):
        after = plant.step(np.zeros(3), 5e-4)
        if np.all(plant.model.wheel_speed(after.truth[:5], after.truth[5:]) != 0.0):
            break
    M, W = FREE.mass_matrix(np.zeros(5)), FREE.wheel_jacobian(np.zeros(5))
    wheel_side = M - ROTOR * W.T @ W
    momentum = wheel_side @ after.truth[5:] + ROTOR * W.T @ after.wheel_speeds
    # gravity's part while the body leans by the microradians that the impacts make is below a thousandth
    size = np.abs(ROTOR * W.T @ spinning).max()
    np.testing.assert_allclose(momentum, ROTOR * W.T @ spinning, atol=2e-3 * size)


@settings(max_examples=25, deadline=None)
@given(play=st.floats(1e-6, 0.2), seed=st.integers(0, 2**32 - 1), size=st.floats(0.0, 3.0))
def test_motors_stay_within_their_play_and_push_only_at_its_stops(play, seed, size):
    plant = geared(STUCK, play)
    plant.reset(seed=seed)
    for u in torques_of(seed, 20, size):
        measured = plant.step(u, 5e-4)
        if measured.ended:
            return
        place, force = of_wheels(plant, AHEAD), of_wheels(plant, PASSED)
        assert np.all(np.abs(place) <= 0.5 * play * (1 + 1e-9) + 1e-12)
        # one step: a torque that is transmitted has its motor at that side's stop (rounding of the angles aside)
        assert np.all(np.abs(force[np.abs(place) < 0.5 * play - 1e-9]) == 0.0)
        assert np.all(force * place >= 0.0)


def test_energy_is_never_gained_in_the_play():
    # without torque and friction, turning about the vertical: gravity has no part
    plant = geared(FREE)
    spinning = np.zeros(10)
    spinning[9] = 0.5
    measured = plant.reset(spinning, seed=3)
    M, W = FREE.mass_matrix(np.zeros(5)), FREE.wheel_jacobian(np.zeros(5))
    wheel_side = M - ROTOR * W.T @ W
    rng = np.random.default_rng(0)
    energies, given_energy = [], [0.0]
    for _ in range(200):
        rates = measured.truth[5:]
        energies.append(
            0.5 * rates @ wheel_side @ rates + 0.5 * ROTOR * measured.wheel_speeds @ measured.wheel_speeds
        )
        u = 0.2 * rng.uniform(-1, 1) * TURNING
        before, measured = measured.wheel_speeds, plant.step(u, 5e-4)
        given_energy.append(given_energy[-1] + 5e-4 * 0.5 * u @ (before + measured.wheel_speeds))
    lost = energies[0] + np.array(given_energy[:-1]) - energies
    # impacts and Euler's implicit step only lose, of some 0.1 J; speeds are found to about 1e-9 rad/s
    assert np.diff(lost).min() > -1e-8
    assert lost[-1] > 0.0


# --- floor, estimator, ends ---


def test_a_robot_with_integral_action_rests_on_a_slope():
    slope = (0.03, -0.02)
    model = Model(alten())
    controller = precise_controller(model.robot)
    plant = SensedPlant(model, replace(PERFECT, slope=slope, backlash=PLAY))
    log = simulate(plant, controller, hold(), duration=16.0)
    # statics to first order: the wheels' torque on the ball holds the weight on the slope, and the lean holds it
    robot = model.robot
    torque = robot.ball.radius * robot.weight * np.array([-slope[1], slope[0], 0.0])
    lean = torque[:2] / (robot.body.mass * robot.gravity * robot.body.center_of_mass)
    torques = transforms(robot).T_obw.T @ torque
    # the mean of the last 2 s: in the play it hunts about its rest, by counts of the encoder
    np.testing.assert_allclose(
        log.truth().states[-400:, 2:4].mean(axis=0), lean, atol=0.03 * np.abs(lean).max()
    )
    np.testing.assert_allclose(log.torques[-400:].mean(axis=0), torques, atol=0.05 * np.abs(torques).max())


def test_a_row_on_a_slope_has_the_wheel_speeds_and_the_rest_of_a_body_off_its_axis():
    model = Model(alten())
    one = replace(PERFECT, slope=(0.03, -0.02), imbalance=(0.3, 0.1))
    P = unpacked(model.selected, packed_on_floor(model, one).item)
    robot, body = model.robot, model.robot.body
    c = np.array(one.imbalance) / (body.mass * body.center_of_mass)
    A = transforms(robot).T_owb @ rotation_to([*c, np.sqrt(1.0 - c @ c)])

    rng = np.random.default_rng(0)
    q, q_dot = rng.uniform(-0.3, 0.3, 5), rng.uniform(-1.0, 1.0, 5)
    ball = np.array([-q_dot[1], q_dot[0], 0.0]) / robot.ball.radius
    turning = rotation(*q[2:]).T @ ball - body_rates_matrix(*q[2:]) @ q_dot[2:]
    np.testing.assert_allclose(wheel_speeds_at(model.selected, P, q, q_dot), A @ turning, rtol=1e-12)

    # statics: the wheels' torque on the ball holds the weight along the slope, and the lean the wheels' torque
    up = np.array([one.slope[0], one.slope[1], 1.0]) / np.sqrt(1.0 + one.slope[0] ** 2 + one.slope[1] ** 2)
    weight = robot.ball.radius * robot.weight * np.array([-up[1], up[0]])

    def on_ball(lean):
        return -body.mass * robot.gravity * body.center_of_mass * np.cross(rotation(*lean, 0.0)[:, 2], up)

    lean = fsolve(lambda lean: on_ball(lean)[:2] - weight, [0.0, 0.0], xtol=1e-14)
    u = np.linalg.solve(A.T, rotation(*lean, 0.0).T @ on_ball(lean))
    rest = np.array([0.0, 0.0, *lean, 0.0])
    np.testing.assert_allclose(accelerations(model.selected, P, rest, np.zeros(5), u), 0.0, atol=1e-9)
    with pytest.raises(InputError, match="imbalance is 1e\\+03 kg m"):
        packed_on_floor(model, replace(one, imbalance=(1e3, 0.0)))


def test_estimator_may_use_another_robot_than_the_plant():
    robot = alten()
    known = robot.replace(wheels=replace(robot.wheels, radius=1.1 * robot.wheels.radius))
    moving = np.zeros(10)
    moving[5] = 0.3
    own, other = (
        run(SensedPlant(FREE, replace(PERFECT, known=one)), [np.zeros(3)], moving)[-1]
        for one in (None, known)
    )
    np.testing.assert_array_equal(own.truth, other.truth)
    # v is the counts' turning by the wheels' radius; the body has hardly begun to turn
    assert other.state[5] == pytest.approx(1.1 * own.state[5], rel=2e-3)
    assert own.state[5] == pytest.approx(0.3, rel=0.02)  # of about 60 counts


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"delay": -1}, "delay is -1; it cannot be negative"),
        ({"torque_noise": -0.1}, "torque_noise"),
        ({"backlash": -1e-3}, "backlash"),
        ({"slope": (0.3, 0.0)}, r"slope of the floor is 0\.3"),
        ({"speed_window": 0}, "speed_window"),
        ({"fallen_lean": 1.3}, "fallen_lean"),
        ({"sensors": replace(PERFECT.sensors, sample_time=0.0)}, "sample_time"),
    ],
)
def test_impossible_imperfections_are_refused(change, words):
    with pytest.raises(InputError, match=words):
        replace(PERFECT, **change)


def test_models_without_encoders_wheels_or_rotors_are_refused():
    with pytest.raises(InputError, match="exact"):
        SensedPlant(Model(alten(), "thesis"), PERFECT)
    massless = alten().replace(drive=replace(DRIVE, motor_inertia=0.0, gear_inertia=0.0))
    with pytest.raises(InputError, match="no inertia"):
        SensedPlant(Model(massless), replace(PERFECT, backlash=PLAY))
    with pytest.raises(InputError, match="whole number of"):
        SensedPlant(FREE, PERFECT).step(np.zeros(3), 0.007)


# --- the twin ---


def test_a_scenarios_drive_pushes_and_timing_are_the_loops():
    push = Push(time=1.0, duration=0.1, force=(5.0, 0.0, 0.0), height=0.3)
    scenario = replace(
        Scenario.nominal(Robot.load("alten")),
        timing=Timing(delay=2, jitter=0.001),
        current_loop=CurrentLoop(bandwidth=80.0),
        supply=Supply(internal_resistance=0.15),
        payload=Payload(mass=2.0, position=(0.05, -0.02, 0.6)),
        pushes=(push,),
    )
    found = imperfections_of(scenario)
    assert (found.delay, found.jitter, found.pushes, found.supply) == (2, 0.001, (push,), scenario.supply)
    # a first-order lag of 1/(2 pi f) has 71 % left at f
    assert abs(1.0 / (1.0 + 2j * np.pi * 80.0 * found.lag)) == pytest.approx(np.sqrt(0.5))
    assert found.imbalance == pytest.approx((0.1, -0.04))


def test_a_payload_off_the_axis_leans_the_robot_as_the_twin():
    """Held on a spot, turned, on point contacts without friction or noise: mass, inertia, offset."""
    robot = Robot.load("alten")
    payload = Payload(mass=2.0, position=(0.06, -0.03, 0.5))
    scenario = replace(Scenario.ideal(robot), wheel_contact="point", payload=payload)
    model, controller = true_model(robot, scenario), nominal_controller(robot)
    psi = 1.2
    start, leans = np.zeros(10), []
    start[4] = psi
    for plant in (Twin(robot, scenario), SensedPlant(model, imperfections_of(scenario))):
        log = simulate(plant, controller, hold(psi=psi), duration=6.0, initial_state=start)
        leans.append(log.truth().states[-200:, 2:4].mean(axis=0))
    assert np.hypot(*leans[0]) > 0.01
    # what is shown of the lean is of first order in the offset, 24 mrad
    np.testing.assert_allclose(leans[1], leans[0], atol=0.01 * np.hypot(*leans[0]))
