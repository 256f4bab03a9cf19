"""Faults put into a clean log are found, named and located; clean logs are found clean."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ballbot.log import Finding, Log
from ballbot.log.checks import check
from ballbot.log.checks.kinematics import check_disturbance, wheel_agreement
from ballbot.robot import Robot
from tests.support.foreign_log_examples import small_robot, swaying_log
from tests.support.log_examples import smooth_log, with_wheels

ALTEN = Robot.load("alten")
CLEAN = smooth_log(rows=3000)
NOISY = CLEAN.with_columns(
    {
        name: CLEAN[name] + 1e-3 * np.random.default_rng(k).standard_normal(len(CLEAN))
        for k, name in enumerate(("theta", "phi", "psi", "theta_dot", "phi_dot", "psi_dot"))
    }
)
ROLLING = with_wheels(CLEAN, ALTEN)


def kinds(log: Log, *, robot: Robot | None = None) -> list[str]:
    # these logs are smooth curves, which follow no robot's lean
    ignored = ("physics",)
    found = [finding for finding in check(log, robot=robot) if finding.code not in ignored]
    return [finding.code for finding in found if finding.severity != "note"]


def only(log: Log, kind: str) -> Finding:
    found = [finding for finding in check(log) if finding.code == kind]
    assert len(found) == 1
    return found[0]


@pytest.mark.parametrize("log", [CLEAN, NOISY, ROLLING], ids=["clean", "noisy", "rolling"])
def test_a_clean_log_is_found_clean(log):
    assert kinds(log, robot=ALTEN) == []


@given(st.integers(1, 2900), st.integers(1, 50))
@settings(deadline=None, max_examples=15)
def test_a_gap_is_found_where_it_is(row, lost):
    kept = np.r_[0:row, row + lost : len(CLEAN)]
    log = Log({name: CLEAN[name][kept] for name in CLEAN})
    finding = only(log, "gap")
    assert finding.where.time == CLEAN.t[row - 1]
    assert f"after row {row} " in finding.text


def test_a_rate_is_not_compared_over_a_pause():
    """The robot turns once, while the clock is set by 50 s."""
    t = 0.005 * np.arange(3000)
    turning = np.exp(-(((t - 7.5) / 0.3) ** 2))  # [rad/s]
    psi = np.cumsum(0.005 * turning)
    pause = 50.0 * (t >= 7.5)
    log = Log({"t": t + pause, "psi": psi, "psi_dot": turning})
    assert [one.text for one in check(log) if one.severity == "error"] == []


@given(st.integers(100, 2800))
@settings(deadline=None, max_examples=8)
def test_a_fall_is_found_where_it_begins(row):
    # a lean that grows by 5 /s, the unstable pole's own pace, and stays down
    lean = np.minimum(1.4, 0.01 * np.exp(5.0 * np.maximum(0.0, CLEAN.t - CLEAN.t[row])))
    log = CLEAN.with_columns({"theta": lean, "theta_dot": np.gradient(lean, CLEAN.t), "phi": 0.0 * lean})
    fallen = np.flatnonzero(lean > 0.6)
    found = [f for f in check(log) if f.code == "fall"]
    assert [f.where.time for f in found] == ([CLEAN.t[fallen[0]]] if fallen.size else [])


@pytest.mark.parametrize(
    ("code", "name", "values", "words"),
    [
        ("saturation", "u1", np.clip(CLEAN["u1"], -0.4, 0.4), "largest value, 0.4 N m"),
        ("missing", "u1", np.where((CLEAN.t > 0.998) & (CLEAN.t < 1.013), np.nan, CLEAN["u1"]), "3 of 3000"),
        # a uniform scatter of +-a has the deviation a / sqrt(3); the check speaks from 5 % on
        ("jitter", "t", CLEAN.t + 5e-4 * np.random.default_rng(0).uniform(-1.0, 1.0, len(CLEAN)), "by 8 %"),
    ],
)
def test_a_fault_of_one_column_is_found_and_is_the_only_one(code, name, values, words):
    log = CLEAN.with_columns({name: values})
    assert kinds(log) == [code]
    assert only(log, code).where.columns == (name,)
    assert words in only(log, code).text


def test_torques_and_speeds_beyond_the_limits_of_the_robot_are_reported():
    log = ROLLING.with_columns({"u1": 100.0 * ROLLING["u1"], "wheel2_dot": 20.0 * ROLLING["wheel2_dot"]})
    assert {"torque-limit", "speed-limit"} <= set(kinds(log, robot=ALTEN))


@given(st.permutations([0, 1, 2]), st.tuples(*[st.sampled_from([1, -1])] * 3), st.floats(0.95, 1.05))
@settings(deadline=None, max_examples=12)
def test_the_mapping_that_the_wheel_check_proposes_is_the_true_one(order, signs, gain):
    truth = ROLLING.wheel_speeds
    # the file's wheel order[i] is the robot's wheel i, turned by signs[i]
    columns = {f"wheel{order[i] + 1}_dot": signs[i] * gain * truth[:, i] for i in range(3)}
    log = ROLLING.with_columns(columns)
    found = wheel_agreement(log, ALTEN)
    assert found is not None
    assert found.order == tuple(k + 1 for k in order)
    assert found.signs == signs
    np.testing.assert_allclose(found.gains, gain, rtol=1e-3)
    wrong = list(order) != [0, 1, 2] or min(signs) < 0
    errors = [f for f in check(log, robot=ALTEN) if f.severity == "error"]
    assert bool(errors) == wrong
    if wrong:
        in_files_order = [signs[list(order).index(k)] for k in range(3)]
        assert f"order = {[k + 1 for k in order]} and sign = {in_files_order}" in errors[0].text


@pytest.mark.parametrize(
    ("name", "codes"),
    [
        ("hold_soft", set()),
        ("square_soft", set()),
        ("thesis_step_soft", set()),
        ("square_stiff", {"saturation", "speed-limit", "wheels"}),  # it falls
    ],
)
def test_the_shared_balancing_logs_are_not_stopped(shared_data, name, codes):
    found = check(Log.read(shared_data / "bbr" / f"{name}.csv"), robot=ALTEN)
    assert not [one for one in found if one.severity == "error"]
    assert {one.code for one in found if one.severity == "warning"} - {"physics"} == codes


def test_continuous_pushes_are_reported():
    log = swaying_log()
    # hands that tilt the body by a degree or two at 1.5 Hz, while the wheels do what they did
    push = 0.03 * np.sin(2.0 * np.pi * 1.5 * log.t)
    found = check_disturbance(log.with_columns({"theta": log["theta"] + push}), small_robot())
    assert [finding.code for finding in found] == ["disturbance"]
    assert "closed-loop" in found[0].text
