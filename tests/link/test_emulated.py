"""The emulated robot: the firmware in lock-step with a plant, from the handshake to a new controller."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from ballbot import Model, Robot
from ballbot.control.presets import nominal_controller, precise_controller
from ballbot.control.safety import SafetyLimits, StopReason
from ballbot.errors import InputError
from ballbot.firmware.build import compilers
from ballbot.firmware.export import export_controller
from ballbot.firmware.records import SelfTestOutcome, parameter_record
from ballbot.link.emulated import CompiledRobot, EmulatedRobot, emulated_robot
from ballbot.link.messages import AnswerResult, Capability, ControllerPlace, State
from ballbot.link.session import Session, stop_reason
from ballbot.link.transport import LinkError
from ballbot.robot.components import scaled_friction
from ballbot.simulation.imperfections import Imperfections, Later
from ballbot.simulation.sensed_plant import SensedPlant
from ballbot.twin.scenario_file import load_scenario
from tests.support.compiled_firmware import weights_of
from tests.support.control_examples import FRICTION, alten, linear_policy

pytestmark = pytest.mark.skipif(not compilers(), reason="no C compiler (gcc, clang or the ziglang wheel)")

ROBOT, H = alten(FRICTION), 0.005


@cache
def parameters() -> np.ndarray:
    """Return the parameters of the precise controller."""
    return parameter_record(precise_controller(ROBOT), SafetyLimits.on_robot(ROBOT, sample_time=H))


def emulated(
    *, capabilities: int = 0, starts: int = 0, robot: Robot = ROBOT, seed: int = 0, weights: str = ""
) -> EmulatedRobot:
    """Return an emulated robot with the sensors that its file has."""
    plant = SensedPlant(Model(robot), Imperfections(sensors=robot.sensors))
    firmware = CompiledRobot(parameters(), capabilities=capabilities, starts=starts, weights=weights)
    return EmulatedRobot(plant, firmware, sample_time=H, seed=seed)


def connected(robot) -> Session:
    session = Session(robot, clock=robot.clock)
    session.connect()
    return session


def balancing(robot, **options) -> Session:
    """Return a session with a robot that is armed."""
    session = connected(robot)
    assert session.self_test() is SelfTestOutcome.PASSED
    assert session.arm(lambda: True, **options) is AnswerResult.OK
    return session


def states(session: Session, seconds: float) -> list[State]:
    """Return the states of the next seconds."""
    found = []
    end = session.clock() + seconds
    while session.clock() < end:
        found += [one for one in session.poll(H) if isinstance(one, State)]
    return found


def session_number(*, starts: int) -> int:
    """Return the session of a robot; its sensors give the same at each start."""
    return connected(emulated(starts=starts)).welcome.session


def test_sessions_after_a_reset_differ_by_the_number_of_the_start_alone(monkeypatch):
    monkeypatch.setattr("ballbot.link.session.secrets.randbelow", lambda most: most // 3)
    sessions = [session_number(starts=starts) for starts in (0, 1, 2**32 - 1, 1)]
    assert len(set(sessions)) == 3
    assert sessions[1] == sessions[3]  # nothing else differs
    monkeypatch.setattr("ballbot.link.session.secrets.randbelow", lambda most: most // 5)
    assert session_number(starts=1) not in sessions  # as it does by the host's number alone


def test_arming_needs_the_person_at_the_host():
    session = connected(emulated())
    session.self_test()
    assert session.arm(lambda: False) is AnswerResult.CONFIRM
    assert not any(one.armed for one in states(session, 0.1))


def test_arming_needs_the_robots_button_if_it_has_one():
    robot = emulated(capabilities=Capability.BUTTON)
    session = connected(robot)
    session.self_test()
    assert session.arm(lambda: True) is AnswerResult.BUTTON

    def press() -> bool:
        robot.firmware.press_button()
        return True

    robot.firmware.press_button()  # before it was asked for: it does not count
    assert session.arm(lambda: True) is AnswerResult.BUTTON
    assert session.arm(press) is AnswerResult.OK


def test_controller_on_the_host_balances_through_the_robots_safety_layer():
    controller = nominal_controller(ROBOT, compensation="partial")
    robot = emulated()
    session = balancing(robot, controller=ControllerPlace.HOST)
    reference = None
    for _ in range(150):
        for one in session.poll(H):
            if isinstance(one, State):
                estimate = one.estimate.astype(np.float64)
                if reference is None:
                    reference = np.where(np.isin(range(10), (0, 1, 4)), estimate, 0.0)
                session.set_torques(controller.update(one.time * 1e-6, estimate, reference))
    assert session.state.armed
    assert session.state.controller == ControllerPlace.HOST
    session.set_torques(np.full(3, 1e9))
    found = states(session, 0.02)
    assert max(np.abs(one.torques).max() for one in found) <= parameters()["law"]["torque_limit"][0]
    found = states(session, 0.5)  # the torques above hold: the robot falls, or its controller is missed
    assert stop_reason(found[-1]) in (StopReason.LEAN, StopReason.LINK)
    assert not found[-1].torques.any()


def test_parameters_are_read_and_written_while_disarmed_only():
    robot = emulated()
    session = connected(robot)
    assert session.read_parameters().tobytes() == parameters().tobytes()
    changed = parameters().copy()
    changed["law"]["torque_limit"] *= 0.9
    assert session.self_test() is SelfTestOutcome.PASSED
    assert session.arm(lambda: True) is AnswerResult.OK
    with pytest.raises(LinkError, match="armed or its self-test runs"):
        session.write_parameters(changed)
    session.disarm()
    session.write_parameters(changed)
    assert session.read_parameters().tobytes() == changed.tobytes()
    assert session.arm(lambda: True) is AnswerResult.SELF_TEST  # once more, with the new numbers


def test_refused_parameters_are_named_with_value_and_bound():
    session, changed = connected(emulated()), parameters().copy()
    changed["safety"]["turning_torque"] = 99.0
    with pytest.raises(
        LinkError, match=r"safety\.turning_torque is 99; it must be at most .*law\.torque_limit"
    ):
        session.write_parameters(changed)
    changed = parameters().copy()
    changed["sample_time"] = 0.01
    with pytest.raises(LinkError, match="another number of wheels or another sample time"):
        session.write_parameters(changed)


@pytest.mark.parametrize("mass", [1.7194, 2.5])
def test_robot_of_little_grip_takes_its_controller_and_finds_a_wheel_that_sticks(mass):
    """The controller's torque limit is an eighth of the motors'; from standing, the integral pushes the wheel."""
    robot = Robot.load("rob311")
    robot = robot.replace(body=replace(robot.body, mass=mass))
    controller = precise_controller(robot)
    assert controller.torque_limit < 0.125 * robot.drive.torque_limit
    true = scaled_friction(FRICTION, 0.1)
    jammed = replace(true, coulomb=(100.0, *true.coulomb[1:]))
    later = (Later(time=1.0, model=Model(robot.replace(friction=jammed))),)
    plant = SensedPlant(
        Model(robot.replace(friction=true)), Imperfections(sensors=robot.sensors, later=later)
    )
    record = export_controller(controller).parameters
    firmware = CompiledRobot(export_controller(nominal_controller(robot)).parameters)
    session = connected(EmulatedRobot(plant, firmware, sample_time=H))
    session.write_parameters(record)
    assert session.self_test() is SelfTestOutcome.PASSED
    assert session.arm(lambda: True) is AnswerResult.OK
    assert all(state.armed for state in states(session, 1.0)[-100:])
    found = states(session, 3.0)[-1]
    assert stop_reason(found) is StopReason.STUCK
    assert found.stop_wheel == 1


def test_policy_alone_balances_a_robot_whose_firmware_has_its_weights_and_no_other():
    learned = linear_policy(nominal_controller(ROBOT))
    record = parameter_record(learned, SafetyLimits.on_robot(ROBOT, sample_time=H))
    with pytest.raises(LinkError, match="a learned policy's need a firmware with its weights"):
        connected(emulated()).write_parameters(record)
    robot = emulated(weights=weights_of(learned))
    connected(robot).write_parameters(record)
    found = states(balancing(robot), 2.0)[-300:]  # without those of the self-test
    assert all(one.armed for one in found)
    assert all(np.any(one.torques) for one in found[-10:])
    assert max(np.abs(one.estimate[2:4]).max() for one in found) < 0.05


def test_torque_limit_of_a_controller_on_the_host_rises_from_zero_after_arming():
    limit = float(parameters()["law"]["torque_limit"][0])
    session = balancing(emulated(), controller=ControllerPlace.HOST, ramp=0.5)
    found = [one for one in session.poll(H) if isinstance(one, State) and one.armed]
    while len(found) < 160:
        session.set_torques(np.full(3, 0.3 * limit))
        found += [one for one in session.poll(H) if isinstance(one, State)]
    for one in found:
        passed = 1e-6 * (one.time - found[0].time)
        # the limit of the sample, and one sample before the first one that was seen
        assert np.abs(one.torques).max() <= limit * min(1.0, (passed + H) / 0.5) * (1.0 + 1e-6)
    assert found[-1].torques[0] == pytest.approx(0.3 * limit)


def test_ramp_that_is_negative_or_too_long_is_refused():
    session = connected(emulated())
    for ramp in (-1.0, 61.0, np.nan):
        with pytest.raises(InputError, match="torque ramp"):
            session.arm(lambda: True, ramp=ramp)


def test_a_scenario_whose_imu_repeats_itself_is_refused_before_the_firmware_stops_for_it():
    with pytest.raises(InputError, match="IMU has no noise, so that its values repeat"):
        emulated_robot(ROBOT, load_scenario("ideal", ROBOT))
