"""Encoders that hold their angle: while their wheels turn, while friction holds them, and at rest."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from ballbot import Log
from ballbot.log.checks.kinematics import check_sampling
from ballbot.log.checks.stuck_encoders import check_stuck_encoders
from tests.support.foreign_log_examples import small_robot, swaying_log


@cache
def measured() -> Log:
    """Return a swaying run with an encoder's steps and an IMU's noise."""
    log, random = swaying_log(), np.random.default_rng(5)
    step = 2.0 * np.pi / (small_robot().sensors.encoder_counts * small_robot().drive.gear_ratio)
    lean = {name: log[name] + 5e-4 * random.standard_normal(len(log)) for name in ("theta", "phi", "psi")}
    return log.with_columns(lean | {f"wheel{i}": step * np.round(log[f"wheel{i}"] / step) for i in (1, 2, 3)})


def held(log: Log, *, wheel: int, start: float, end: float) -> Log:
    """Return a log of which an encoder holds its angle."""
    rows = (log.t >= start) & (log.t < end)
    angle = log[f"wheel{wheel}"].copy()
    angle[rows] = angle[rows][0]
    return log.with_columns({f"wheel{wheel}": angle})


@pytest.mark.parametrize(("wheel", "start", "end"), [(1, 12.0, 15.0), (2, 20.0, 30.0), (3, 0.0, 6.0)])
def test_an_encoder_that_holds_while_its_wheel_turns_is_an_error_with_its_span(wheel, start, end):
    (found,) = check_stuck_encoders(held(measured(), wheel=wheel, start=start, end=end), wheel_count=3)
    assert (found.severity, found.code, found.where.columns) == ("error", "stuck", (f"wheel{wheel}",))
    assert found.where.time == pytest.approx(start, abs=0.1)
    assert "though its wheel turns" in found.text


def test_encoders_that_turn_give_no_finding():
    assert not [*check_stuck_encoders(measured(), wheel_count=3)]


@pytest.mark.parametrize(("factor", "found"), [(1, 0), (2, 1), (4, 1)])
def test_counts_of_the_robot_file_that_the_steps_of_the_angles_contradict_are_found(factor, found):
    robot = small_robot()
    sensors = replace(robot.sensors, encoder_counts=factor * robot.sensors.encoder_counts)
    texts = [one.text for one in check_sampling(measured(), robot.replace(sensors=sensors))]
    assert len([text for text in texts if "encoder_counts" in text]) == found


def test_encoders_of_a_robot_at_rest_give_no_finding():
    log = measured()
    rest = (log.t > 10.0) & (log.t < 16.0)
    names = ("theta", "phi", "psi", "wheel1", "wheel2", "wheel3")
    still = {name: np.where(rest, log[name][rest][0], log[name]) for name in names}
    # what comes after goes on from where it stood
    for name in names:
        still[name][log.t >= 16.0] += log[name][rest][0] - log[name][rest][-1]
    assert not [*check_stuck_encoders(log.with_columns(still), wheel_count=3)]


def test_hands_that_turn_the_lean_while_a_wheel_stands_give_no_finding():
    log = held(measured(), wheel=1, start=12.0, end=16.0)
    pushed = (log.t > 12.0) & (log.t < 16.0)
    # a lean that no motion of one wheel explains
    swing, other = 0.1 * np.sin(6.0 * (log.t - 12.0)), 0.1 * np.cos(5.0 * log.t)
    moved = {"theta": log["theta"] + pushed * swing, "phi": log["phi"] + pushed * other}
    assert not [*check_stuck_encoders(log.with_columns(moved), wheel_count=3)]
