"""The self-test on robots of 1 to 60 kg that are held, with fine and coarse encoders, fast and slow loops."""

from dataclasses import replace
from random import Random

import numpy as np
import pytest

from ballbot import Controller, Robot
from ballbot.control.safety import SafetyLimits
from ballbot.errors import InputError
from ballbot.estimation.interface import Reading
from ballbot.firmware.build import compilers
from ballbot.firmware.estimators import reading_record, whole_counts
from ballbot.firmware.records import SelfTestOutcome, parameter_record
from ballbot.robot import Friction
from ballbot.robot.components import scaled_friction
from ballbot.simulation.held_robot import HeldRobot
from tests.support.compiled_firmware import Firmware
from tests.support.control_examples import FRICTION

PASSED, SIGN = SelfTestOutcome.PASSED, SelfTestOutcome.TORQUE_SIGN
ORDER, DEAD = SelfTestOutcome.TORQUE_ORDER, SelfTestOutcome.DEAD_MOTOR


def drawn(random: Random, *, mass: float, counts: int, rate: float, breakaway: float) -> Robot:
    """Return a robot with motors for 1.5 to 4 times the torque that a lean of 8 degrees needs."""
    robot = Robot.load("alten")
    ball, height = random.uniform(0.1, 0.25), random.uniform(0.26, 1.0)
    wheel, central = ball * random.uniform(0.25, 0.6), 0.05 * mass * height**2
    motors = random.uniform(1.5, 4.0) * 0.139 * mass * 9.81 * height * wheel / (1.06 * ball)
    return robot.replace(
        ball=replace(robot.ball, radius=ball, inertia=0.5 * robot.ball.mass * ball**2),
        body=replace(
            robot.body,
            mass=mass,
            center_of_mass=height,
            inertia=(central, central, 0.4 * central, 0.0, 0.0, 0.0),
            inertia_about="center_of_mass",
        ),
        wheels=replace(robot.wheels, radius=wheel, inertia=0.1 * wheel**2),
        drive=replace(robot.drive, torque_limit=motors, gear_ratio=1.0, motor_inertia=0.1 * wheel**2),
        sensors=replace(robot.sensors, encoder_counts=counts, sample_time=1.0 / rate),
        friction=scaled_friction(FRICTION, breakaway * motors / max(FRICTION.breakaway)),
    )


def self_tested(robot: Robot, described: Robot, signs=(1, 1, 1), order=(0, 1, 2)) -> Firmware:
    """Return the firmware of a robot as described, after the self-test of the true one, wired as given."""
    controller = Controller(described, np.zeros((3, 10)))
    h = controller.sample_time
    made = Firmware(parameter_record(controller, SafetyLimits.on_robot(described, sample_time=h)))
    made.skip_imu_check()
    made.start_self_test()
    held, k = HeldRobot(robot), 0
    measured = held.reset(seed=1)
    while made.self_test is SelfTestOutcome.RUNNING:
        record = reading_record(
            Reading(
                wheel_angles=measured.wheel_angles,
                wheel_speeds=measured.wheel_speeds,
                gyro=measured.gyro,
                attitude=measured.state[2:5],
            ),
            robot=robot,
        )
        record["wheel_counts"][0, :3] = whole_counts(measured.wheel_angles, robot=robot)
        torques = np.zeros(3)
        torques[list(order)] = np.array(signs) * made.update(record, round(1e6 * k * h), None)
        measured = held.step(torques, h)
        k += 1
    return made


@pytest.mark.skipif(not compilers(), reason="no C compiler (gcc, clang or the ziglang wheel)")
@pytest.mark.parametrize(
    ("mass", "counts", "rate", "breakaway"),
    [(1.0, 50_000, 1000.0, 0.15), (1.0, 200, 100.0, 0.03), (60.0, 200, 100.0, 0.15), (60.0, 50_000, 200.0, 0.1)],
)  # fmt: skip
def test_sound_robots_pass_and_wrong_wiring_is_found(mass, counts, rate, breakaway):
    robot = drawn(Random(mass * counts), mass=mass, counts=counts, rate=rate, breakaway=breakaway)
    unknown = robot.replace(friction=Friction.none(3))
    for described in (robot, unknown):
        assert self_tested(robot, described).self_test is PASSED
    assert self_tested(robot, robot, signs=(1, -1, 1)).self_test is SIGN
    assert self_tested(robot, robot, order=(0, 2, 1)).self_test is ORDER
    dead = self_tested(robot, robot, signs=(1, 1, 0))
    assert (dead.self_test, dead.state["self_test"]["wheel"]) == (DEAD, 3)


def test_robot_whose_wheels_do_not_break_away_is_refused():
    robot = Robot.load("alten").replace(friction=scaled_friction(FRICTION, 20.0))
    with pytest.raises(InputError, match=r"wheel of alten breaks away under 3\.6 N m"):
        SafetyLimits.on_robot(robot, sample_time=0.005, torque_limit=2.0)
    limits = SafetyLimits.on_robot(robot, sample_time=0.005)
    assert max(robot.friction.breakaway) < limits.turning_torque < robot.drive.torque_limit
    with pytest.raises(InputError, match="The self-test cannot move a wheel of alten"):
        parameter_record(Controller(robot, np.zeros((3, 10))), limits)
