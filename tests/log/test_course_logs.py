"""The course robots' own logs: what `check-log` must find in them."""

import numpy as np
import pytest

from ballbot.cli.check_log import check_log
from ballbot.log import Log
from ballbot.log.mapping_search.motion import Stated
from ballbot.log.proposal import answer_lines, evaluate, propose
from ballbot.robot import Robot

#: where wheel 1 stands against the IMU's x axis [deg], with the wheels counting as heading says: the course puts its
#: first wheel on the y axis (lab10); the other team's controller mixes its commands for wheels at 120, 240 and 0
FIRST_WHEEL = {"main_control_1": 120.0, "main_control_autotune_1": 120.0, "lab10_data_trial_408": 90.0}


#: logs without a gyro whose heading does not show whether an axis of the IMU is reversed, which is asked for
OPEN_AXES = "main_control_autotune_1", "lab10_data_trial_408"


@pytest.mark.sample
@pytest.mark.parametrize("name", FIRST_WHEEL)
def test_a_real_log_is_mapped_once_its_command_is_stated(shared_data, name):
    robot = Robot.load("rob311")
    found = evaluate(propose(shared_data / "rob311" / f"{name}.txt", robot, Stated(command="duty")))
    proposal = found
    assert [one.key for one in proposal.questions] == ["[attitude] sign"] * (name in OPEN_AXES)
    assert (found.log is None) == (name in OPEN_AXES)
    assert proposal.what == "balancing"
    assert proposal.frame.order == (1, 2, 3)
    assert proposal.frame.signs == (-1, -1, -1)
    first = np.degrees(robot.wheels.azimuths[0] - proposal.frame.measured_turn)
    assert abs((first - FIRST_WHEEL[name] + 180.0) % 360.0 - 180.0) < 5.0
    # the trial's firmware counts its duties the other way
    assert proposal.drive is not None
    assert proposal.drive.assigned is not None
    assert set(proposal.drive.assigned.signs) == {-1 if name.startswith("lab10") else 1}
    assert proposal.drive.scale == 1.0
    # the trial's: 9 to 14 ms, of which half a message's interval depends on the clock
    assert 0.005 < proposal.drive.delay < 0.0165
    assert proposal.motion is not None
    assert proposal.motion.noise is not None
    assert proposal.motion.noise[1] < 0.25


def test_a_free_wheel_sweep_is_recognised(shared_data):
    robot = Robot.load("rob311")
    file = shared_data / "rob311" / "Test-Results_test_motors_1.txt"
    found = evaluate(propose(file, robot, Stated(command="duty")))
    assert found.refusal == ""
    assert answer_lines(found)[0].endswith("free wheels, 6 s; usable for identify-driveline.")
    assert found.drive is not None
    assert found.drive.scale == 1.0
    assert found.drive.assigned is not None
    assert set(found.drive.assigned.signs) == {1}


@pytest.mark.sample
def test_the_command_writes_a_log_that_identification_can_use(shared_data, tmp_path):
    file = shared_data / "rob311" / "main_control_1.txt"
    check_log(file, robot="rob311", command="duty", out=tmp_path)
    log = Log.read(tmp_path / "log.csv")
    log.require("t", "u1", "u2", "u3", "x", "y", "theta", "phi", "psi", "wheel1_dot")
    # rows by the mapping alone are those of the log written
    again = Log.read(file, mapping=tmp_path / "mapping.toml", robot="rob311")
    np.testing.assert_allclose(again["theta"], log["theta"])
