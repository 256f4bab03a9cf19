"""Logs whose units contradict, or whose columns were not read: right or refused, and their sound twins right."""

from pathlib import Path

import numpy as np
import pytest

from ballbot.cli.main import main
from ballbot.identification.axis.checks import record_findings
from ballbot.identification.axis.record import AxisColumns, read_axis_record
from ballbot.log import Log
from ballbot.log.formats.text import write_text_table
from ballbot.log.mapping_search.motion import Stated
from ballbot.log.proposal import answer_lines, evaluate, propose
from ballbot.robot import Robot
from tests.support.axis_machines import Logging, Machine, record_of
from tests.support.contradicting_logs import KINDS, outcomes
from tests.support.foreign_log_examples import foreign_columns, small_robot, write_foreign

#: kinds that take less than a second
QUICK = ("named_by_its_unit", "beside_another_unit", "without_a_factor", "axis_without_header")


@pytest.mark.parametrize("name", QUICK)
@pytest.mark.parametrize("seed", [1, 2])
def test_units_of_an_axis_are_right_or_refused_and_sound_ones_right(name, seed):
    assert outcomes(name, seed=seed, sound=False) != "wrong"
    assert outcomes(name, seed=seed, sound=True) == "right"


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in KINDS if name not in QUICK])
def test_motion_capture_and_foreign_logs_are_right_or_refused_and_sound_ones_right(name):
    assert outcomes(name, seed=1, sound=False) != "wrong"
    assert outcomes(name, seed=1, sound=True) == "right"


@pytest.fixture(scope="session")
def shared_cases() -> Path:
    """Return the folder of failing inputs beside the project, or skip the test without it."""
    folder = Path(__file__).parents[3] / "shared" / "cases"
    if not folder.is_dir():
        pytest.skip(f"no cases at {folder}")
    return folder


def test_a_column_called_rpm_is_in_rpm(shared_cases):
    columns = AxisColumns(time="time_ms", velocity="rpm", force="current_A", force_scale="0.05", unit="rad")
    read = read_axis_record(shared_cases / "axis_rpm.csv", columns)
    assert all(finding.severity != "error" for finding in record_findings(read))
    speed = np.diff(read.position) / read.sample_time
    logged = np.genfromtxt(shared_cases / "axis_rpm.csv", delimiter=",", names=True)["rpm"]
    np.testing.assert_allclose(speed.std(), logged.std() * 2.0 * np.pi / 60.0, rtol=0.02)


def test_a_roll_of_359_degrees_is_one_of_minus_one(shared_cases):
    found = propose(shared_cases / "lean_0_360.csv", Robot.load("alten"))
    assert np.abs(found.base.raw_attitude[:, :2]).max() < 2.0


def test_a_log_s_lean_of_a_full_turn_is_read_within_half_a_turn():
    lean = 0.02 * np.sin(0.1 * np.arange(300))
    theta = np.asarray(np.mod(lean, 2.0 * np.pi), np.float64)
    log = Log({"t": 0.01 * np.arange(300), "theta": theta, "phi": lean})
    np.testing.assert_allclose(log["theta"], lean, atol=1e-12)
    assert [finding.code for finding in log.changes] == ["wrap"]


def test_a_result_despite_an_accepted_unit_says_so_in_its_first_line(tmp_path, capsys):
    machine = Machine(kind="wheel", inertia=2e-3, viscous=3e-3, coulomb=0.02)
    wheel = record_of(machine, Logging(duration=5.0, rate=200.0, amplitude=6.0), 1)
    velocity = np.gradient(wheel.position, wheel.t)
    columns = {
        "t": wheel.t,
        "position": np.degrees(wheel.position),
        "velocity": velocity,
        "force": wheel.force,
    }
    write_text_table(tmp_path / "a.csv", columns)
    words = [
        "identify-axis",
        str(tmp_path / "a.csv"),
        "--unit",
        "rad",
        "--law",
        "viscous",
        "--out",
        str(tmp_path / "a"),
    ]
    assert main(words) == 2
    assert 'axis_angle = { from = "position", unit = "deg" }' in capsys.readouterr().err
    assert main([*words, "--accept", "unit"]) == 0
    shown = capsys.readouterr().out.splitlines()
    assert shown[0].startswith("error (accepted): ")
    verdict = next(line for line in shown if line.startswith("Despite"))
    assert verdict.endswith("[unit]")


@pytest.mark.slow
def test_a_lean_that_froze_is_named_with_its_own_duration(tmp_path):
    columns = foreign_columns()
    frozen = (columns["t_now"] >= 10.0) & (columns["t_now"] < 13.0)
    for name in ("theta_x", "theta_y", "theta_z"):
        columns[name] = np.where(frozen, columns[name][frozen][0], columns[name])
    path = write_foreign(tmp_path / "run.txt", columns)
    lines = answer_lines(evaluate(propose(path, small_robot(), Stated(command="duty"))))
    assert any("repeats one value for 3 s, first at t = 10" in line for line in lines)


@pytest.mark.slow
def test_magnitudes_of_commands_are_no_offset(tmp_path):
    columns = foreign_columns()
    columns |= {name: np.abs(columns[name]) for name in ("u1", "u2", "u3")}
    path = write_foreign(tmp_path / "run.txt", columns)
    found = propose(path, small_robot(), Stated(command="duty"))
    (question,) = [one for one in found.questions if one.key == "[input] zero"]
    assert question.answers[0].startswith("direction")
