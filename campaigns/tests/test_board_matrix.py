"""The presets' way from a robot to its board; `make evidence` runs drawn robots and both compilers."""

import math

import pytest

from ballbot import Robot
from ballbot.firmware.build import compilers
from ballbot.robot.plausibility import robot_findings
from ballbot.twin.scenario import Scenario, check_scenario
from campaigns import board_matrix
from campaigns.board_matrix import Case, judged_case, recovered_push
from campaigns.drawn_robots import DrawnRobot, drawn_robots


def test_drawn_robots_are_plausible_and_within_the_rule():
    drawn = drawn_robots(1, 20)
    assert drawn[3].robot == drawn_robots(1, 4)[3].robot
    for one in drawn:
        robot = one.robot
        assert [str(found) for found in robot_findings(robot) if found.severity != "note"] == []
        assert 1.0 <= robot.body.mass <= 60.0
        assert 0.1 <= robot.ball.radius < robot.body.center_of_mass <= 1.0
        counts = robot.sensors.encoder_counts * robot.drive.gear_ratio
        assert 200.0 - robot.drive.gear_ratio <= counts <= 50_000.0 + robot.drive.gear_ratio
        assert 0.0 <= one.delay <= 1.5 * robot.sensors.sample_time
        assert math.isclose(1e6 * robot.sensors.sample_time, round(1e6 * robot.sensors.sample_time))


@pytest.mark.board
@pytest.mark.slow
@pytest.mark.skipif(not compilers(), reason="no C compiler (gcc, clang or the ziglang wheel)")
@pytest.mark.parametrize("kind", ["nominal", "precise"])
@pytest.mark.parametrize("name", Robot.presets())
def test_preset_goes_from_its_design_to_a_stop_on_its_board(name, kind, monkeypatch):
    monkeypatch.setattr(board_matrix, "COMPILERS", tuple(compilers())[:1])
    monkeypatch.setattr(board_matrix, "BALANCE", 3.0)
    scenario = Scenario.nominal(name)
    robot = Robot.load(name).replace(friction=scenario.friction)
    check_scenario(scenario, robot)
    drawn = DrawnRobot(robot=robot, input="torque", delay=0.0, scenario=scenario)
    result = judged_case(Case(number=1, drawn=drawn, kind=kind), 0.5 * recovered_push(1, drawn))
    assert result.end == "passed", result.sentence
    assert result.push > 0.0
