"""A foreign log's mapping against the simulated robot whose log it is: order, signs, turn, units, and what is asked."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ballbot.errors import InputError
from ballbot.log import proposal as proposal_module
from ballbot.log.mapping import DutyTable, parse_mapping
from ballbot.log.mapping_search.motion import Stated, _continued
from ballbot.log.proposal import MOST_LINES, Proposal, answer_lines, evaluate, propose
from ballbot.robot import Robot
from tests.support.foreign_log_examples import (
    COURSE,
    foreign_columns,
    small_robot,
    swaying_log,
    write_foreign,
)
from tests.support.foreign_logs import Habits


def found_for(path: Path, habits: Habits = COURSE, stated: Stated | None = None) -> Proposal:
    file = write_foreign(path / "run.txt", foreign_columns(habits), habits)
    return evaluate(propose(file, small_robot(), stated or Stated(command="duty")))


@pytest.mark.parametrize(
    "habits",
    [
        {
            "order": (1, 2, 0),
            "signs": (1, -1, 1),
            "turn": 1.05,
            "wheel_unit": "counts",
            "command_scale": 255.0,
        },
        {
            "order": (0, 2, 1),
            "signs": (-1,) * 3,
            "turn": -1.57,
            "lean_unit": "rad",
            "command_signs": (-1,) * 3,
        },
    ],
)
def test_the_log_that_the_mapping_makes_is_the_robots(tmp_path, habits):
    found = found_for(tmp_path, replace(COURSE, **habits))
    assert found.refusal == ""
    log, truth = found.log, swaying_log()
    assert log is not None
    # the file's wheels are the robot's, up to counting on: compared by what does not depend on it
    speeds = np.sort(log.wheel_speeds.std(axis=0))
    inside = truth.between(float(log.t[0]), float(log.t[-1]))
    np.testing.assert_allclose(speeds, np.sort(inside.wheel_speeds.std(axis=0)), rtol=0.05)
    # size and direction of lean by the ball's path, which only right signs, order and turn give
    for a, b in (("theta", "phi"), ("x_dot", "y_dot")):
        true = np.hypot(inside[a], inside[b]).std()
        assert np.hypot(log[a], log[b]).std() == pytest.approx(true, rel=0.1)
    assert len(answer_lines(found)) <= MOST_LINES
    assert answer_lines(found)[0].startswith("run.txt: balancing")


def exchanged(*, tilts: bool, gyro: str | None = "rad/s") -> Habits:
    """Return the habits of a team whose first two encoders are exchanged and whose IMU is along the robot's axes."""
    return replace(COURSE, order=(1, 0, 2), tilts=tilts, gyro_unit=gyro)


@pytest.mark.parametrize("gyro", [None, "rad/s"])
@pytest.mark.parametrize("tilts", [False, True])
def test_tilts_that_do_not_turn_and_exchanged_wheels_are_found_without_a_turn(tmp_path, tilts, gyro):
    found = found_for(tmp_path, exchanged(tilts=tilts, gyro=gyro))
    assert found.motion
    assert found.motion.tilts.sequence == ("XYZ" if tilts else "ZYX")
    assert (found.frame.turn, found.frame.order) == (0.0, (2, 1, 3))
    log, truth = found.log, swaying_log()
    assert log is not None
    ahead = np.array([np.interp(log.t, truth.t, truth[name]) for name in ("theta", "phi", "psi")])
    lean = (log["theta"] + 1j * log["phi"]) * np.exp(-1j * log["psi"])
    true = (ahead[0] + 1j * ahead[1]) * np.exp(-1j * ahead[2])
    gain = np.vdot(true - true.mean(), lean - lean.mean()) / np.vdot(true - true.mean(), true - true.mean())
    # of a lean that is late by the sensors' delay, which the mapping does not remove, and has noise
    assert abs(gain) == pytest.approx(1.0, abs=0.1)
    assert abs(np.angle(gain)) < np.radians(3.0)


def test_a_ball_that_spins_gives_no_heading_by_the_wheels(tmp_path):
    """It turns all wheels alike, though the robot does not turn so; nothing else shows the way in which they count."""
    habits = replace(COURSE, yaw=False, gyro_unit=None)
    columns = foreign_columns(habits)
    for name in ("psi_1", "psi_2", "psi_3"):
        columns[name] += 6.0 * np.sin(0.7 * columns["t_now"])
    found = evaluate(
        propose(write_foreign(tmp_path / "run.txt", columns, habits), small_robot(), Stated(command="duty"))
    )
    assert {"[wheels] sign", "[attitude] turn"} <= {one.key for one in found.questions}


def test_tilts_without_the_yaw_that_they_need_are_asked_for(tmp_path):
    found = found_for(tmp_path, replace(COURSE, tilts=True, yaw=False))
    assert "[attitude] sequence" in [one.key for one in found.questions]
    assert found.log is None


def test_a_sequence_that_the_log_leaves_open_is_asked_for_with_both_turns(tmp_path):
    found = found_for(tmp_path, replace(COURSE, duration=5.0, noise=8e-3, tilts=True))
    (question,) = (one for one in found.questions if one.key == "[attitude] sequence")
    assert [words[:3] for words in question.answers] == ["XYZ", "ZYX"]
    assert "for the second write turn = " in question.evidence
    assert '\nsequence = "XYZ"' in found.text


def motors(**drive: float) -> Robot:
    return small_robot().replace(drive=replace(small_robot().drive, **drive))


def test_torques_of_another_motor_name_the_resistance_that_would_fit(tmp_path):
    """By a file of half their resistance the torques are twice those that the motion needs."""
    true = small_robot().drive.resistance
    file = write_foreign(tmp_path / "run.txt", foreign_columns())
    found = evaluate(propose(file, motors(resistance=0.5 * true), Stated(command="duty")))
    (said,) = (one.text for one in found.findings if one.code == "scale")
    fits = float(said.partition("a resistance of ")[2].partition(" ohm")[0])
    # as much as masses and friction leave of the scale in such a log
    assert fits == pytest.approx(true, rel=0.15)


def test_duties_of_motors_of_unknown_resistance_are_refused_with_one_that_would_fit(tmp_path):
    file = write_foreign(tmp_path / "run.txt", foreign_columns())
    found = evaluate(propose(file, motors(resistance=0.0), Stated(command="duty")))
    assert found.log is None
    assert "under [drive] of the robot file" in found.refusal
    assert any("a resistance of " in one.text for one in found.findings)


@pytest.mark.parametrize(("period", "step"), [(256.0, 1.0), (360.0, 0.01), (2.0 * np.pi, 0.01)])
def test_angles_that_begin_again_after_a_turn_are_continued_and_their_period_is_found(period, step):
    angle = np.column_stack([2.5 * period * np.sin(0.01 * k * np.arange(2000)) for k in (1, 2, 3)])
    angle = step * np.round(angle / step)
    found, wrap = _continued(np.mod(angle, period), of_speeds=False)
    assert wrap == pytest.approx(period)
    np.testing.assert_allclose(found - found[0], angle - angle[0], atol=1e-9)


def test_a_kind_that_nobody_states_is_asked_for_with_every_alternative(tmp_path):
    found = found_for(tmp_path, stated=Stated())
    assert [one.key for one in found.questions] == ["[input] kind"]
    assert found.log is None
    assert "complete = false" in found.text
    (question,) = found.questions
    assert question.answers == ("torque", "current", "voltage", "duty")
    assert "--command" in question.evidence


def test_a_heading_that_contradicts_the_stated_kind_is_refused(tmp_path):
    columns = foreign_columns()
    named = {name.replace("u", "tau") + "_Nm" if name[:1] == "u" else name: v for name, v in columns.items()}
    file = write_foreign(tmp_path / "run.txt", named)
    with pytest.raises(InputError, match="has the unit N m"):
        propose(file, small_robot(), Stated(command="duty"))


def test_a_lean_that_the_wheels_do_not_explain_is_held_by_hand(tmp_path):
    columns = foreign_columns()
    t, random = columns["t_now"], np.random.default_rng(0)
    for name in ("theta_x", "theta_y"):
        columns[name] = np.zeros(len(t))
        for rate in (2.1, 3.7, 5.3):
            columns[name] += np.degrees(0.05) * np.sin(rate * t + random.uniform(0.0, 6.0))
    file = write_foreign(tmp_path / "run.txt", columns)
    found = evaluate(propose(file, small_robot(), Stated(command="duty")))
    assert found.what == "held by hand"
    assert found.refusal


def test_a_log_of_another_robot_is_refused_with_the_reason(tmp_path):
    robot = small_robot()
    other = robot.replace(wheels=replace(robot.wheels, radius=0.15))
    file = write_foreign(tmp_path / "run.txt", foreign_columns())
    found = evaluate(propose(file, other, Stated(command="duty")))
    assert found.log is None
    assert "the lean responds to the wheels" in found.refusal


def test_commands_that_chatter_faster_than_rows_show_are_refused(tmp_path):
    columns = foreign_columns()
    for k, name in enumerate(("u1", "u2", "u3")):
        # eight rows a period, twice as large as the duties themselves
        columns[name] = columns[name] + 0.4 * np.sin(2.0 * np.pi * (columns["t_now"] / 0.08 + k / 3.0))
    file = write_foreign(tmp_path / "run.txt", columns)
    found = evaluate(propose(file, small_robot(), Stated(command="duty")))
    assert "a row every 10 ms" in found.refusal


def test_a_dead_band_that_matters_is_asked_for_with_an_estimate(tmp_path, monkeypatch):
    monkeypatch.setattr(proposal_module, "LARGEST_BAND", 0.0)
    found = found_for(tmp_path)
    assert [one.key for one in found.questions] == ["[input] dead_band"]
    assert found.log is None
    (at,) = (k for k, line in enumerate(found.text.splitlines()) if line.startswith("dead_band = "))
    question = found.text.splitlines()[at - 1]
    assert question.startswith("# cannot determine: dead band of the firmware (")
    assert "% of their size, because wheels turn against their duties" in question
    # as the firmware's author answers it
    stated = found.text.replace("complete = false", "#")
    assert isinstance(parse_mapping(stated, source="the mapping").input, DutyTable)
