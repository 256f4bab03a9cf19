"""The compiled loop against the same robot, sensors, estimator and controller called one sample at a time."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import brentq

from ballbot import Controller, InputError, Log, Model, Robot, simulate, simulate_batch
from ballbot.control.presets import nominal_controller, precise_controller
from ballbot.control.references import circle, drive
from ballbot.mechanics.friction import dry_friction_size
from ballbot.mechanics.geometry import transforms
from ballbot.robot.wheel_directions import contact_directions, rolling_directions
from ballbot.simulation.batch_result import ClosedLoopBatch
from ballbot.simulation.imperfections import (
    Imperfections,
    Later,
    Push,
    RollerContacts,
    Roughness,
    Supply,
    slope_of,
    waves_of,
)
from ballbot.simulation.inputs import draws_of, empty_outcome, inputs_of, new_commands
from ballbot.simulation.loop import STARTED, Sampling, new_memory, run_block
from ballbot.simulation.model_plant import ModelPlant
from ballbot.simulation.sensed_plant import SensedPlant
from ballbot.simulation.sensors import SensorFaults
from tests.support.control_examples import FRICTION, alten, four_wheeled

_PRESET = alten(FRICTION)
#: on windings so weak that a battery limits the torques
ROBOT = _PRESET.replace(drive=replace(_PRESET.drive, resistance=20.0))
START = np.array([0.01, -0.02, 0.02, -0.01, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0])
SENSORS = ROBOT.sensors
FAULTS = SensorFaults(gyro_bias=0.002, gyro_bias_walk=1e-4, lean_error=0.003, latency=0.01)
PLAY = np.radians(1.0)


def ran(
    controller: Controller | None,
    imperfections: Imperfections | list[Imperfections],
    *,
    robot: Robot = ROBOT,
    duration: float = SENSORS.sample_time,
    starts: NDArray[np.float64] = START,
) -> ClosedLoopBatch:
    """Return a batch of a robot around a circle, of one sample if no duration is given; None leaves its motors off."""
    one = controller or Controller(robot, np.zeros((3, 10)))
    return simulate_batch(
        Model(robot), one, circle(), duration=duration, initial_states=starts, imperfections=imperfections
    )


def assert_one_by_one(controller: Controller, imperfections: Imperfections, duration: float) -> None:
    """Check that a lane's log is that of the plant that is called one sample at a time."""
    batch = ran(controller, imperfections, robot=controller.robot, duration=duration)
    plant = SensedPlant(Model(controller.robot), imperfections, estimator=controller.estimator)
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


WEAK = Supply(internal_resistance=5.0)
NOISY = Imperfections(sensors=SENSORS, torque_noise=0.01, delay=1, sensor_faults=FAULTS)


@pytest.mark.parametrize(
    ("imperfections", "estimator"),
    [
        (replace(NOISY, speed_window=3, slope=(0.02, -0.01)), "onboard"),
        (replace(NOISY, backlash=PLAY, slope=(0.01, 0.0)), "kalman"),
    ],
    ids=["late, sloping, faulty AHRS", "all with play"],
)
def test_a_lane_is_the_plant_one_sample_at_a_time(imperfections, estimator):
    controller = precise_controller(ROBOT).with_estimator(estimator)
    assert_one_by_one(controller, replace(imperfections, seed=5), 1.0)


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


def test_a_robot_that_starts_while_another_advances_is_as_one_that_starts_beside_it():
    model, controller, lanes = (
        Model(ROBOT),
        precise_controller(ROBOT).with_estimator("kalman"),
        [NOISY, NOISY],
    )
    h, samples = controller.sample_time, 8
    inputs = inputs_of(
        [model], lanes, sample_time=h, laws=[controller], estimators=["kalman"], initial=START[None]
    )

    def block():
        draws = draws_of([(NOISY, 1), (NOISY, 2)], 2, n=3, samples=samples, sample_time=h)
        sampling = Sampling(np.zeros((samples, 10)), h, model.steps_in(h))
        memory = new_memory(inputs.loops, 2, 3, filtering=True)
        return inputs, draws, sampling, memory, new_commands(2, 0), empty_outcome(2, samples, samples, 3)

    together, later = block(), block()
    run_block(model.selected, *together, (0, 3))
    run_block(model.selected, *later, (0, 4))
    later[4].todo[1] = STARTED
    run_block(model.selected, *later, (4, 8))  # a start takes a turn of its own
    for name in ("truths", "states"):
        np.testing.assert_array_equal(getattr(later[3], name)[1], getattr(together[3], name)[1], name)


def test_the_log_of_a_fall_ends_before_it():
    limp = Controller(ROBOT, np.zeros((3, 10)))
    imperfections = Imperfections(sensors=SENSORS, fallen_lean=0.4)
    batch = simulate_batch(ROBOT, limp, circle(), duration=5.0, imperfections=imperfections)
    log = simulate(SensedPlant(Model(ROBOT), imperfections), limp, circle(), duration=5.0)
    assert_same(batch.log(0), log, atol=1e-8)
    assert batch.log(0).ended == log.ended
    assert str(log.ended).startswith("fallen: lean past 0.4 rad at t = ")
    with pytest.raises(InputError, match="every sample"):
        simulate_batch(ROBOT, limp, circle(), duration=1.0, every=2).log(0)


@pytest.mark.sample  # compiles the loop of four wheels with play
def test_four_wheels_with_play_are_the_plant_one_sample_at_a_time():
    robot = four_wheeled(friction=True)
    controller = nominal_controller(robot, compensation="full")
    imperfections = Imperfections(sensors=robot.sensors, torque_noise=0.01, backlash=PLAY)
    assert_one_by_one(controller, replace(imperfections, seed=3), 0.5)


#: an imperfection at a time, beside what is on in the robots that lack it
IMPERFECTIONS = {
    "sensor faults": {"sensor_faults": FAULTS},
    "delay": {"delay": 2},
    "jitter": {"jitter": 0.001},
    "torque noise": {"torque_noise": 0.05},
    "lag": {"lag": 0.002},
    "supply": {"supply": WEAK},
    "rollers": {
        "contacts": RollerContacts(rollers=ROBOT.wheels.rollers, give=2e-6, creep=3e4, relaxation=0.0)
    },
    "load dependence": {"load_dependence": 0.5},
    "slope": {"slope": (0.02, -0.01)},
    "imbalance": {"imbalance": (0.05, 0.02)},
    "pushes": {"pushes": (Push(time=0.05, duration=0.05, force=(20.0, 0.0, 0.0), height=0.4),)},
    "missing samples": {"missing": 5, "missing_from": 10},
    "known robot": {"known": ROBOT.replace(wheels=replace(ROBOT.wheels, radius=0.07))},
}


@pytest.mark.parametrize(
    ("name", "backlash"),
    [
        *((name, 0.0) for name in IMPERFECTIONS),
        *((name, PLAY) for name in ("lag", "rollers", "load dependence")),
    ],
)
def test_an_imperfection_that_is_off_leaves_the_loop_without_it(name, backlash):
    """Bit for bit, beside robots that have it; the first and the last of a block, where vector code begins and ends."""
    without = Imperfections(sensors=SENSORS, backlash=backlash, seed=3)
    having = replace(without, **IMPERFECTIONS[name])

    def states(imperfections: list[Imperfections]) -> NDArray[np.float64]:
        return ran(precise_controller(ROBOT), imperfections, duration=0.2).states

    # the number of lanes is the same: vector code and the scalar code for those that remain round differently
    beside, alone = states([without, *[having] * 14, without]), states([without] * 16)
    np.testing.assert_array_equal(beside[[0, 15]], alone[[0, 15]])
    assert not np.array_equal(beside[7], alone[7])


def test_a_push_changes_the_velocities_by_its_impulse():
    """Against `ModelPlant.push`: 0.05 s at 12 N along x, 0.4 m above the ball's centre, is 0.6 N s and 0.24 N m s."""
    push = Push(time=0.0, duration=0.005, force=(12.0, 0.0, 0.0), height=0.4)
    batch = ran(None, Imperfections(pushes=(push,)), starts=np.zeros(10))
    plant = ModelPlant(Model(ROBOT))
    plant.reset()
    plant.push([12.0 * 0.005, 0.0, 0.0, 0.4 * 12.0 * 0.005, 0.0])  # upright, phi turns the top forward
    expected = plant.step(np.zeros(3), 0.005).truth
    np.testing.assert_allclose(batch.finals[0], expected, atol=1e-12)


def test_a_lag_is_the_first_order_filter_of_the_torques():
    """A robot that cannot move shows its torques' mean by its speed: the filter's mean over the first sample."""
    controller = nominal_controller(alten())
    batch = [ran(controller, Imperfections(lag=lag), robot=alten()).finals[0] for lag in (0.0, 1e-9, 0.002)]
    still = ran(None, Imperfections(), robot=alten()).finals[0]
    np.testing.assert_allclose(batch[1], batch[0], atol=1e-9)
    share = (batch[2] - still)[7:9] / (batch[0] - still)[7:9]
    # mean of 1 - exp(-t/2 ms) over 5 ms; the motion within the sample changes it by some 1e-3
    np.testing.assert_allclose(share, 1.0 - 0.4 * (1.0 - np.exp(-2.5)), atol=0.01)


@pytest.mark.parametrize(
    ("model", "imperfections", "words"),
    [
        (Model(ROBOT), Imperfections(sensors=replace(SENSORS, sample_time=0.01)), r"every 0\.01 s and"),
        (Model(ROBOT), [Imperfections(backlash=PLAY), Imperfections()], "of a batch have play or none"),
        (Model(ROBOT, "thesis"), Imperfections(sensors=SENSORS), "'thesis'"),
        (
            Model(ROBOT),
            [Imperfections(later=(Later(time=t, model=Model(ROBOT)),)) for t in (0.1, 0.2)],
            "different times",
        ),
    ],
)
def test_what_a_batch_cannot_run_is_refused(model, imperfections, words):
    with pytest.raises(InputError, match=words):
        simulate_batch(model, precise_controller(ROBOT), circle(), duration=1.0, imperfections=imperfections)


#: rollers of two rings on contacts that hardly give way
ROLLERS = RollerContacts(rollers=ROBOT.wheels.rollers, give=1e-9, creep=3e4, relaxation=0.0)


def torques_behind(robot, change):
    """Return the wheel torques (robots, n) of changes of the velocities (robots, 5) over a sample, near upright."""
    model, upright = Model(robot), np.zeros(5)
    response = 0.005 * np.linalg.solve(model.mass_matrix(upright), model.wheel_jacobian(upright).T)
    return np.linalg.lstsq(response, change.T, rcond=None)[0].T


def test_rollers_turn_a_wheel_by_the_force_of_the_robot_on_them():
    """Torques of wheels at random angles, against the distance at which an ellipse and the ball touch."""
    robot = alten()
    rollers, r_w, r_b = robot.wheels.rollers, robot.wheels.radius, robot.ball.radius
    found = torques_behind(
        robot,
        ran(None, Imperfections(contacts=ROLLERS), robot=robot, starts=np.zeros((400, 10))).finals[:, 5:],
    )

    phase = np.linspace(-1.3, 1.3, 40_001)
    ellipse = np.stack([np.sqrt(r_w * rollers.radius) * np.sin(phase), rollers.radius * np.cos(phase)])

    def gap(x: float, distance: float) -> float:
        ball = [[distance * np.sin(x)], [distance * np.cos(x) - (r_w - rollers.radius)]]
        return np.sqrt(((ellipse - ball) ** 2).sum(0).min()) - r_b

    half = np.pi / (rollers.rows * rollers.per_row)
    angles = np.linspace(-half, half, 61)
    distances = [brentq(lambda d, x=x: gap(x, d), r_w + r_b - 1e-3, r_w + r_b + 1e-4) for x in angles]
    weight = robot.body.mass * robot.gravity / (3.0 * np.cos(robot.wheels.tilt))
    expected = weight * np.abs(np.gradient(distances, angles))
    # 1,200 wheels at random angles: a quantile's error is 1.5 % of them, 5 % of these torques; the fourth power is 6 %
    np.testing.assert_allclose(
        np.quantile(np.abs(found), [0.5, 0.75, 0.9]), np.quantile(expected, [0.5, 0.75, 0.9]), rtol=0.1
    )
    assert abs(found.mean()) < 3.0 * found.std() / np.sqrt(found.size)


def test_the_rings_of_rollers_touch_the_ball_off_the_wheels_middle():
    """A robot that turns on the spot: the speeds of wheels that push the ball along t_i off its great circle."""
    robot = alten()
    turning = np.zeros(10)
    turning[9] = 1.0
    batch = ran(
        None, Imperfections(contacts=ROLLERS), robot=robot, duration=0.01, starts=np.tile(turning, (40, 1))
    )
    rollers, tilt = robot.wheels.rollers, robot.wheels.tilt
    off = 0.5 * rollers.row_spacing / (robot.ball.radius + rollers.radius) * np.array([-1.0, 1.0])
    # the contact is that angle nearer to the zenith, or further from it; the wheel's axle keeps its distance
    expected = -robot.ball.radius / robot.wheels.radius * np.sin(tilt + off)
    # the rollers' torque changes the speeds by up to 0.7 % in a sample, the rings by 5 %
    near = np.abs(batch.wheel_speeds[:, 1, :, None] / expected - 1.0)
    assert near.min(axis=2).max() < 1e-2
    assert set(near.argmin(axis=2).ravel()) == {0, 1}


def test_rollers_of_both_rings_brake_a_turning_ball():
    """As soft as can be, the further ring bears 5/16 in the mean; it slips, 3 mm from the wheel's middle."""
    robot = alten()
    turning = np.zeros(10)
    turning[9] = 1.0
    softest = RollerContacts(rollers=robot.wheels.rollers, give=1.0, grip=0.0, creep=1e9, relaxation=0.0)
    starts = np.tile(turning, (400, 1))
    braked, free = (
        ran(None, Imperfections(contacts=replace(softest, grip=grip)), robot=robot, starts=starts)
        .finals[:, 5:]
        .mean(axis=0)
        for grip in (0.4, 0.0)
    )
    ball, wheels = robot.ball.radius, robot.wheels
    arm = 0.5 * wheels.rollers.row_spacing * ball / (ball + wheels.rollers.radius)
    # all wheels together press with m g / cos(tilt), and turn by its cosine about the vertical
    moment = 2.0 * 0.4 * 5.0 / 16.0 * robot.body.mass * robot.gravity * arm
    change = Model(robot).mass_matrix(np.zeros(5)) @ (braked - free) / 0.005
    # 1,200 wheels at random angles: 1.6 % of deviation
    np.testing.assert_allclose(change[4], -moment, rtol=0.05)


def test_friction_follows_the_force_on_the_wheels():
    """A robot that accelerates forward, against the forces that its motion takes."""
    tipping = np.zeros(10)
    tipping[7], tipping[8] = 1.5, -1.2
    plain, follows = (
        ran(None, Imperfections(load_dependence=share), starts=tipping[None]).finals[:, 5:]
        for share in (0.0, 0.5)
    )
    model, friction, mass = Model(ROBOT), ROBOT.friction, ROBOT.body.mass
    speeds = model.wheel_speed(np.zeros(5), tipping[5:])
    dry = dry_friction_size(speeds, friction) * np.sign(speeds)
    v_dot, w_dot = np.split((plain[0] - tipping[5:]) / 0.005, [2])
    along = ROBOT.body.center_of_mass * np.array([w_dot[1], -w_dot[0], -(1.5**2 + 1.2**2)])
    azimuths = ROBOT.wheels.azimuths
    n, t = contact_directions(azimuths, ROBOT.wheels.tilt), rolling_directions(azimuths)
    # what is left of the friction's torques on the wheels pushes the ball
    drive, A = ROBOT.drive, transforms(ROBOT).T_owb
    spins = A @ (
        np.array([-v_dot[1], v_dot[0], 0.0]) / ROBOT.ball.radius
        - (1.0 + ROBOT.wheels.radius / ROBOT.ball.radius) * w_dot
    )
    rotor = drive.reflected_inertia
    turned = A @ (np.array([-v_dot[1], v_dot[0], 0.0]) / ROBOT.ball.radius - w_dot)
    lost = np.multiply(friction.viscous, speeds) + dry
    pushes = (-lost - ROBOT.wheels.inertia * spins - rotor * turned) / ROBOT.wheels.radius
    needed = mass * (np.append(v_dot, ROBOT.gravity) + along) + t.T @ pushes
    at_rest = mass * ROBOT.gravity / (3.0 * np.cos(ROBOT.wheels.tilt))
    share = 0.5 * (np.linalg.solve(n.T, needed) / at_rest - 1.0)
    assert np.abs(share).min() > 0.02
    # over 5 ms speeds and forces change by a tenth
    np.testing.assert_allclose(torques_behind(ROBOT, follows - plain)[0], -share * dry, rtol=0.15)


def test_payload_and_floor_that_change_are_those_of_the_plant_called_one_sample_at_a_time():
    """Between two steps of a sample and in the middle of sticking, with play and a Kalman filter."""
    heavy = ROBOT.replace({"body.mass": 11.0, "friction.rolling": 0.02})
    later = (Later(time=0.1, model=Model(heavy), imbalance=(0.1, 0.05)), Later(time=0.3, model=Model(ROBOT)))
    bumpy = Roughness(height=5e-4, wavelength=0.1, seed=1)
    imperfections = replace(
        NOISY, backlash=PLAY, slope=(0.01, 0.0), known=ROBOT, later=later, roughness=bumpy
    )
    controller = precise_controller(ROBOT).with_estimator("kalman")
    assert_one_by_one(controller, imperfections, 0.5)
    plain = ran(controller, replace(imperfections, later=()), duration=0.5)
    assert (
        np.abs(plain.states[0, -1] - ran(controller, imperfections, duration=0.5).states[0, -1]).max() > 1e-3
    )


def test_robot_on_a_long_wave_leans_as_on_a_slope():
    """A body at rest has its centre of mass above the contact: m_r l theta = M r_b s, whatever makes the slope s."""
    waves = Roughness(height=10.0, wavelength=1e4, seed=3)
    slope = slope_of(waves_of(waves), np.zeros(2))
    assert 1e-3 < np.hypot(*slope) < 0.02
    leans = []
    for imperfections in (
        Imperfections(roughness=waves),
        Imperfections(slope=(float(slope[0]), float(slope[1]))),
    ):
        batch = ran(precise_controller(ROBOT), imperfections, duration=8.0, starts=np.zeros(10))
        leans.append(batch.states[0, -200:, 2:4].mean(axis=0))
    mass, moment = ROBOT.ball.mass + ROBOT.body.mass, ROBOT.body.mass * ROBOT.body.center_of_mass
    expected = mass * ROBOT.ball.radius / moment * np.array([slope[1], -slope[0]])
    # while it follows the circle, friction's compensation leaves a few percent of the lean
    np.testing.assert_allclose(leans[0], leans[1], atol=0.1 * np.abs(expected).max())


def test_a_carpet_takes_its_power():
    """At a steady speed v, more rolling friction takes M g (C' - C) v more of the motors."""
    rough = ROBOT.replace({"friction.rolling": ROBOT.friction.rolling + 0.014})
    batch = simulate_batch(
        Model(ROBOT),
        precise_controller(ROBOT),
        drive(speed=0.25),
        duration=16.0,
        initial_states=np.zeros(10),
        imperfections=Imperfections(later=(Later(time=10.0, model=Model(rough)),)),
    )
    states = batch.states[0]
    power = (batch.torques[0] * Model(ROBOT).wheel_speed(states[:, :5], states[:, 5:])).sum(axis=1)
    steady = [slice(1400, 2000), slice(2600, 3200)]
    speed = states[steady[1], 5].mean()
    weight = (ROBOT.ball.mass + ROBOT.body.mass) * ROBOT.gravity
    assert speed == pytest.approx(0.25, rel=0.02)
    # the same speed and leans before and after to a few percent of what the carpet takes
    assert power[steady[1]].mean() - power[steady[0]].mean() == pytest.approx(
        weight * 0.014 * speed, rel=0.03
    )
