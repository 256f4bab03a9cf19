"""What the momentum shows: the floor's rolling friction, and wheels that the robot file has wrong."""

import numpy as np
import pytest

from ballbot.control.controller import Controller
from ballbot.control.references import square
from ballbot.identification.odometry import WheelFrame
from ballbot.identification.rolling import RollingMotion
from ballbot.log import Log
from ballbot.mechanics.model import Model
from ballbot.simulation.batch import simulate_batch
from ballbot.simulation.imperfections import Imperfections, RollerContacts
from tests.support.validation_examples import gain, true_robot

ROLLING = 0.01


@pytest.fixture(scope="module")
def log() -> Log:
    """Return a log of the compiled loop with rollers, play and sensors."""
    robot = true_robot().replace({"friction.rolling": ROLLING})
    made = simulate_batch(
        Model(robot),
        Controller(robot, gain()),
        square(period=16.0),
        duration=48.0,
        imperfections=Imperfections(
            contacts=RollerContacts(rollers=robot.wheels.rollers),
            backlash=0.01,
            sensors=robot.sensors,
            seed=3,
        ),
    )
    return made.log(0).without_truth()


def found(log: Log, **changes: float) -> tuple[float, float]:
    robot = true_robot().replace(changes)
    motion = RollingMotion.of([log], robot)
    assert motion
    return motion.rolling(robot)


def test_rolling_friction_is_the_floors_with_rollers_play_and_sensors(log):
    value, error = found(log)
    # a fit of predicted states finds 1.5 to 2.4 times as much with them
    assert value == pytest.approx(ROLLING, rel=0.1)
    assert abs(value - ROLLING) < 1.96 * error


def test_it_stays_if_the_imu_is_turned_against_the_wheels_and_the_floor_slopes(log):
    turn = np.exp(1j * np.radians(3.0))
    lean, rate = (
        (log[first] + 1j * log[second]) * turn
        for first, second in (("theta", "phi"), ("theta_dot", "phi_dot"))
    )
    columns = {"theta": lean.real + 0.02, "phi": lean.imag, "theta_dot": rate.real, "phi_dot": rate.imag}
    # the sine of a lean 0.02 rad larger is larger by that to 2e-4, which is 1 % of its change in a sway
    assert found(log.with_columns(columns))[0] == pytest.approx(found(log)[0], rel=1e-2)


def test_it_follows_the_height_of_the_body_in_the_robot_file(log):
    robot = true_robot()
    higher = found(log, **{"body.center_of_mass": 1.05 * robot.body.center_of_mass})[0]
    # kappa, the lean that carries the friction, is what the log shows: C_rr = kappa m_r l / (m r_b) grows as l, and
    # kappa falls where the lever C of the lean's rate grows
    assert 1.0 < higher / found(log)[0] < 1.1


def test_a_log_of_few_seconds_shows_nothing(log):
    assert RollingMotion.of([log.between(0.0, 6.0)], true_robot()) is None


def test_a_ball_that_more_than_gravity_moves_shows_nothing(log):
    # as on a tether: the ball accelerates by a third of what its lean asks for
    slower = {name: log[name] / 3.0 for name in ("x_dot", "y_dot")}
    assert RollingMotion.of([log.with_columns(slower)], true_robot()) is None


def wheel_frame(log: Log, **changes: float) -> WheelFrame:
    frame = WheelFrame.of([log], true_robot().replace(changes))
    assert frame
    return frame


def test_wheels_that_are_as_in_the_robot_file_are_hardly_corrected_and_not_named(log):
    frame = wheel_frame(log)
    for number in (frame.radius, frame.turn):
        assert abs(number.correction) < 2.0 * number.error < 2.0 * number.deviation
    assert frame.findings(true_robot()) == []


def test_wheels_that_are_turned_against_the_imu_are_found(log):
    # a turn of the wheels by 3 degrees, known to a third of a degree and weighed with a degree by the mount
    turned = {name: log[name] for name in ("theta", "phi", "theta_dot", "phi_dot")}
    for first, second in (("theta", "phi"), ("theta_dot", "phi_dot")):
        pair = (log[first] + 1j * log[second]) * np.exp(1j * np.radians(3.0))
        turned |= {first: pair.real, second: pair.imag}
    frame = wheel_frame(log.with_columns(turned))
    assert np.degrees(frame.turn.own) == pytest.approx(3.0, abs=0.5)
    found = frame.corrected(true_robot())
    by = np.subtract(found.wheels.azimuths, true_robot().wheels.azimuths)
    assert np.degrees(by) == pytest.approx(3.0, abs=0.7)
    assert [finding.code for finding in frame.findings(found)] == ["geometry"]


def test_a_wheel_radius_that_the_file_has_wrong_is_found_and_weighed_with_the_files(log):
    frame = wheel_frame(log, **{"wheels.radius": true_robot().wheels.radius / 1.06})
    # 6 % is 4 deviations of lengths; gravity shows it to a percent
    assert frame.radius.own == pytest.approx(np.log(1.06), abs=2.0 * frame.radius.own_error)
    assert 0.01 < frame.radius.correction < frame.radius.own
