"""A run of a live robot: its log is that of the same run in simulation, and every end is one sentence."""

from dataclasses import replace

import numpy as np
import pytest

from ballbot import Robot
from ballbot.control.presets import nominal_controller
from ballbot.control.references import square
from ballbot.errors import InputError
from ballbot.firmware.build import compilers
from ballbot.firmware.export import export_controller
from ballbot.link.emulated import emulated_robot
from ballbot.link.live import FollowReference, LiveRobot, TorqueProgram, log_columns
from ballbot.link.messages import ControllerPlace
from ballbot.link.operators import EmulatedOperator
from ballbot.link.references import CourseReference
from ballbot.link.session import Session
from ballbot.link.wiring import check_turns, measure_turns
from ballbot.log import Log
from ballbot.mechanics.geometry import transforms
from ballbot.simulation.run import simulate
from ballbot.twin.scenario_file import load_scenario
from ballbot.workflows.metrics import Rules, score
from tests.support.faulty_transport import Faults, FaultyTransport

pytestmark = pytest.mark.skipif(not compilers(), reason="no C compiler (gcc, clang or the ziglang wheel)")

ROBOT = Robot.load("alten")
STEP = ROBOT.sensors.sample_time


class Connected:
    """A live robot, held until it arms, with cables in another place if a fault is given, and what it does."""

    def __init__(self, fault=None, *, hold="on_ball", imu_checked=True):
        scenario = load_scenario("nominal", ROBOT)
        self.emulated = emulated_robot(ROBOT, scenario, hold=hold, seed=1, imu_checked=imu_checked)
        self.emulated.hand = Miswired(self.emulated.hand, **(fault or {}))
        self.line = FaultyTransport(self.emulated, Faults(), seed=0)
        self.session = Session(self.line, clock=self.emulated.clock)
        self.session.connect()
        self.robot = LiveRobot(self.session)
        self.operator = EmulatedOperator(self.emulated.hand)
        self.rows = []

    def run(self, commander, *, place=ControllerPlace.ROBOT, duration=2.0, watch=lambda _: None):
        self.robot.test()
        self.robot.arm(self.operator.confirm_arming, controller=place)
        self.ending = self.robot.run(commander, duration=duration, record=self.rows.append, watch=watch)
        self.robot.disarm()
        return Log(dict(zip(log_columns(3), np.array(self.rows).T, strict=True)))


def follow(reference):
    return FollowReference(CourseReference(reference), sample_time=STEP)


@pytest.mark.slow
def test_controller_on_the_robot_follows_as_in_simulation():
    live = Connected()
    log = live.run(follow(square(period=16.0)), duration=6.0)
    assert live.ending.kind == "time"
    assert len(log) == 6.0 / STEP
    np.testing.assert_allclose(log.t, STEP * np.arange(len(log)), atol=1e-9)
    # the course, a row for each sample, from the first on
    wanted = np.array([square(period=16.0)(t)[[0, 1, 4]] for t in log.t])
    np.testing.assert_allclose(log.reference[:, [0, 1, 4]], wanted, atol=1e-6)
    plant = live.emulated.plant
    simulated = simulate(plant, nominal_controller(ROBOT), square(period=16.0), duration=6.0, seed=1)
    scores = [score(one.without_truth(), Rules(settle=2.0)).rms_position_error for one in (log, simulated)]
    # another seed of the noise: the same kind of run, not the same run
    assert 0.4 < scores[0] / scores[1] < 2.5
    assert not live.emulated.motors.armed


def test_reference_that_is_lost_is_sent_again():
    live = Connected()
    sent, send = [], live.session.set_reference

    def lossy(reference):
        sent.append(np.array(reference))
        if len(sent) > 2:
            send(reference)

    live.session.set_reference = lossy
    jump = np.array([0.05, *np.zeros(9)])
    log = live.run(follow(lambda t: jump if t > 0.1 else np.zeros(10)), duration=0.4)
    # the first asks for the pose that the robot holds anyway; the second, the jump, is lost and sent again
    assert np.ptp(log["ref_x"]) == pytest.approx(0.05, abs=1e-6)
    arrived = log.t[np.argmax(log["ref_x"] > 0.04)]
    assert 0.15 <= arrived <= 0.17
    assert len(sent) == 3


def test_sweep_of_free_wheels_gives_its_torques():
    live = Connected(hold="in_air")
    program = TorqueProgram(lambda t: np.full(3, 0.5 * np.sin(t)), sample_time=STEP)
    log = live.run(program, place=ControllerPlace.HOST, duration=1.5)
    # the first two samples come together
    np.testing.assert_allclose(log.torques[2:], 0.5 * np.sin(log.t[2:, None]) * np.ones(3), atol=1e-6)
    assert np.abs(log.wheel_angles[-1]).min() > 0.5


class Miswired:
    """A plant with cables in another place."""

    def __init__(self, plant, *, motors=(0, 1, 2), signs=(1, 1, 1), gyro=(0, 1, 2), imu=None):
        self._plant, self.robot = plant, plant.robot
        self._motors, self._signs, self._gyro = [*motors], np.array(signs), [*gyro]
        self._imu = np.eye(3) if imu is None else imu

    def reset(self, initial_state=None, *, seed=0):
        return self._seen(self._plant.reset(initial_state, seed=seed))

    def step(self, torques, duration):
        return self._seen(self._plant.step(torques[self._motors], duration))

    def tilt(self, attitude):
        self._plant.tilt(attitude)

    @property
    def is_tilting(self):
        return self._plant.is_tilting

    def _seen(self, one):
        attitude, gyro = self._imu @ one.attitude, (self._imu @ one.gyro)[self._gyro]
        angles, speeds = self._signs * one.wheel_angles, self._signs * one.wheel_speeds
        return replace(one, attitude=attitude, wheel_angles=angles, wheel_speeds=speeds, gyro=gyro)


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ({"motors": (1, 0, 2)}, "motor 1 .* cables are in the wrong order"),
        ({"signs": (1, -1, 1)}, "motor 2 .* wrong sign"),
    ],
)
def test_self_test_names_the_wheel(fault, words):
    live = Connected(fault)
    with pytest.raises(InputError, match=words):
        live.robot.test()


def turned(fault=None):
    live = Connected(fault, imu_checked=False)
    return measure_turns(live.robot, live.operator, watch=lambda _: None)


def test_wiring_of_a_right_robot_passes_and_a_wrong_encoder_is_named():
    turns, ball_from_wheels = turned(), transforms(ROBOT).T_obw
    check = check_turns(turns, ball_from_wheels)
    assert check.passed
    # the encoders' resolution and the noise of the attitude, 1 mrad in 0.26 rad
    np.testing.assert_allclose(check.wheel_scales, 1.0, atol=0.03)
    attitudes = np.array([one.attitude for one in check.turns])
    np.testing.assert_allclose(attitudes, np.radians([[0, 15, 0], [-15, 0, 0], [0, 0, 45]]), atol=0.01)
    for order, factors, words in (
        # motors and encoders exchanged together, which the self-test cannot find
        ([1, 0, 2], [1, 1, 1], "Encoder 1 turned as wheel 2 must"),
        ([0, 1, 2], [1, 1, -1], "Encoder 3 counts backward"),
        ([0, 1, 2], [1, 2, 1], "Encoder 2 turned 2 times as far"),
        ([0, 1, 2], [0, 1, 1], "Encoder 1 did not count"),
    ):
        wrong = [replace(one, wheels=(factors * one.wheels)[order]) for one in turns]
        check = check_turns(wrong, ball_from_wheels)
        assert not check.passed
        assert any(words in one.text for one in check.findings)


def test_wiring_check_ends_with_a_wrong_imu():
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    with pytest.raises(InputError, match=r"tilted forward, .* It turned to the left about x"):
        turned({"imu": quarter})


def test_silent_robot_ends_the_run_in_one_sentence():
    live = Connected()

    def silence(sample):
        live.line.dead = sample.t > 0.5

    log = live.run(follow(square()), watch=silence)
    assert live.ending.kind == "link"
    assert "silent" in live.ending.text
    assert log.t[-1] == pytest.approx(0.505, abs=1e-6)


@pytest.mark.slow
def test_new_robot_is_moved_by_hand_before_it_arms():
    live = Connected(imu_checked=False)
    with pytest.raises(InputError, match="upright and still"):
        live.robot.test()  # nobody is there to move it
    with pytest.raises(InputError, match="self-test has not passed"):
        live.robot.arm(live.operator.confirm_arming, controller=ControllerPlace.ROBOT)
    began = live.emulated.clock()
    live.robot.test(live.operator)
    assert live.emulated.clock() - began > 3.0
    live.run(follow(square()), duration=0.1)
    assert live.ending.kind == "time"
    # other parameters need the test of motors and encoders again, and the IMU stays checked
    live.robot.use_parameters(export_controller(nominal_controller(ROBOT), lean=0.3).parameters)
    live.robot.test()


def test_new_robot_with_wrong_axes_does_not_arm():
    live = Connected({"gyro": (1, 0, 2)}, imu_checked=False)
    with pytest.raises(InputError, match="tilted forward, the gyro's turn was not the attitude's"):
        live.robot.test(live.operator)
    with pytest.raises(InputError, match="self-test has not passed"):
        live.robot.arm(live.operator.confirm_arming, controller=ControllerPlace.ROBOT)
