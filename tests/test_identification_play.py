"""Wheels that chatter within the gearbox's play, and what is said of them."""

from dataclasses import replace

import numpy as np
import pytest
from control_examples import alten

from ballbot import Log
from ballbot.identification.excitation import chatter, chatter_finding

PLAY = alten().drive.backlash


def log_of(angle: np.ndarray) -> Log:
    """Return a log at 200 Hz of three wheels at that angle."""
    speed = np.gradient(angle, 0.005)
    return Log({"t": 0.005 * np.arange(len(angle))} | {f"wheel{i}_dot": speed for i in (1, 2, 3)})


def test_swings_as_long_as_the_play_are_chatter():
    t = 0.005 * np.arange(2000)
    found = chatter(log_of(0.5 * PLAY * np.sin(2 * np.pi * 10 * t)), alten())
    assert found.share > 0.98
    assert found.swing == pytest.approx(PLAY, rel=0.05)  # twenty samples a turn miss its ends by 1 %
    assert found.matters


@pytest.mark.parametrize("amplitude", [0.1 * PLAY, 5.0 * PLAY])
def test_swings_much_shorter_or_longer_are_not(amplitude):
    t = 0.005 * np.arange(2000)
    assert chatter(log_of(amplitude * np.sin(2 * np.pi * 2 * t)), alten()).share < 0.05


def test_a_robot_without_play_does_not_chatter():
    robot = alten()
    rigid = robot.replace(drive=replace(robot.drive, backlash=0.0))
    t = 0.005 * np.arange(2000)
    assert chatter(log_of(0.5 * PLAY * np.sin(2 * np.pi * 10 * t)), rigid).share == 0.0


def test_the_stiff_log_chatters_and_the_soft_ones_do_not(shared_data):
    found = {
        name: chatter(Log.read(shared_data / "bbr" / f"{name}.csv"), alten())
        for name in ("square_soft", "hold_soft", "thesis_step_soft", "square_stiff")
    }
    assert [name for name, one in found.items() if one.matters] == ["square_stiff"]
    said = chatter_finding(found["square_stiff"], alten(), "square_stiff")
    assert "by 1.0 deg for 89 % of the time" in said
