"""What a reference asks of a robot, against the closed loop that then does it on the exact model."""

import json
from dataclasses import replace

import numpy as np
import pytest
from control_examples import FRICTION, alten

from ballbot import InputError, Model, simulate
from ballbot.cli.main import main
from ballbot.control.margins import reference_margins
from ballbot.control.precise import precise_controller
from ballbot.control.references import change_pose, hold, square

STEP = change_pose(ramp=0.0, at=0.5)


def test_the_margins_are_what_the_closed_loop_then_takes():
    robot = alten(FRICTION)
    asked = reference_margins(robot, STEP, duration=10.0)
    log = simulate(Model(robot), precise_controller(robot), STEP, duration=10.0)
    lean = np.hypot(log["theta"], log["phi"]).max()
    speed = np.abs(Model(robot).wheel_speed(log.states[:, :5], log.states[:, 5:])).max()
    power = np.sum(log.torques * Model(robot).wheel_speed(log.states[:, :5], log.states[:, 5:]), axis=1).max()
    # a linear feed-forward of a robot that moves and turns at once; feedback does the rest
    assert asked.lean.most == pytest.approx(lean, rel=0.25)
    assert asked.speed.most == pytest.approx(speed, rel=0.1)
    assert asked.torque.most == pytest.approx(np.abs(log.torques).max(), rel=0.35)
    assert asked.power == pytest.approx(power, rel=0.35)
    assert asked.refusals == ()


def test_a_weak_drive_is_told_what_it_lacks():
    robot = alten(FRICTION)
    slow = robot.replace(drive=replace(robot.drive, supply_voltage=6.0, torque_limit=0.4))
    torque, speed = reference_margins(slow, STEP, duration=10.0).refusals
    assert "of torque at a wheel" in torque
    assert "of speed of a wheel" in speed
    assert "feedback needs the rest" in torque


def test_check_tells_them(tmp_path, capsys):
    assert main(["check", "alten", "--reference", "change-pose", "--out", str(tmp_path)]) == 0
    assert "The robot can follow this reference." in capsys.readouterr().out
    motion = json.loads((tmp_path / "results.json").read_text())["motion"]
    assert motion["torque"]["most"] < motion["torque"]["limit"] == 6.0
    assert motion["refusals"] == []


def test_rest_asks_for_nothing():
    asked = reference_margins(alten(FRICTION), hold(), duration=1.0)
    assert asked.lean.most == asked.torque.most == asked.speed.most == asked.power == 0.0


def test_wrong_input_is_told():
    with pytest.raises(InputError, match=r"duration is 0 s; it must be at least one sample of 0\.005 s"):
        reference_margins(alten(), square(), duration=0.0)
