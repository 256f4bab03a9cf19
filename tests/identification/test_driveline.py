"""The driveline stage: known friction found in a simulated sweep, and the command on the shared one."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from ballbot import Log, Robot
from ballbot.cli.main import main
from ballbot.errors import InputError
from ballbot.identification.driveline import (
    DrivelineFit,
    Sweep,
    fit_driveline,
    friction_of,
    robot_with_friction,
    sweep_estimate,
    sweeps_of,
)
from ballbot.simulation.driveline import Driveline, simulate_driveline
from tests.support.report_pages import figure_count

TRUTH = np.array([0.012, 0.05, 0.03, 0.7, 1.0])  # b, c, s, v_s, delta
SAMPLE_TIME = 5e-3


def played_sweep(seed: int) -> Sweep:
    """Return a sweep with noise of the torque, encoder counts, and a first break-away across 6 mrad of play."""
    random = np.random.default_rng(seed)
    t = np.arange(4000) * SAMPLE_TIME
    torque = np.sin(2.0 * np.pi * t / 20.0)
    acting = (torque + 0.01 * random.standard_normal(len(t)))[:-1]
    whole, alone = (Driveline(inertia=one, friction=friction_of(TRUTH)) for one in (0.003, 0.002))
    # the motor alone until it meets its wheel, both at one speed from there
    free = simulate_driveline(alone, acting, sample_time=SAMPLE_TIME)
    meets = int(np.argmax(free.angles > 0.006))
    after = {"sample_time": SAMPLE_TIME, "initial_speed": float(free.speeds[meets]) * 2.0 / 3.0}
    rest = simulate_driveline(whole, acting[meets + 1 :], **after)
    together = free.angles[meets] + rest.angles
    angle = np.concatenate([[0.0], free.angles[: meets + 1], together])
    counted = np.floor(angle / 1e-4) * 1e-4
    speed = np.concatenate([[0.0], np.diff(counted)]) / SAMPLE_TIME
    return Sweep(wheel=1, t=t, torque=torque, speed=speed, limit=27.7, inertia=0.003, angle=counted)


@pytest.mark.slow
def test_noise_of_the_torque_and_play_do_not_bias_the_friction():
    fits = [fit_driveline(played_sweep(seed)) for seed in (1, 2)]
    inside = [
        low <= value <= high
        for fit in fits
        for value, (low, high) in zip(TRUTH, fit.intervals.tolist(), strict=True)
    ]
    # of ten 95 % intervals fewer than eight hold the truth once in ninety times
    assert sum(inside) >= 8
    for fit in fits:
        # c is known together with s and v_s only
        np.testing.assert_allclose(fit.values[:2] / TRUTH[:2], 1.0, atol=0.2)
        assert fit.rmse_without > 20.0 * fit.rmse


@pytest.mark.slow
def test_delta_is_estimated_from_a_wheel_that_often_starts_and_stops():
    t = np.arange(6000) * SAMPLE_TIME
    torque = 0.16 * np.sin(2.0 * np.pi * t / 2.1) + 0.05 * np.sin(2.0 * np.pi * t / 0.37)
    line = Driveline(inertia=0.003, friction=friction_of(np.array([0.012, 0.05, 0.04, 0.8, 2.0])))
    motion = simulate_driveline(line, torque[:-1], sample_time=SAMPLE_TIME)
    speed, angle = (np.append(0.0, column) for column in (motion.speeds, motion.angles))
    counted = np.floor(angle / 1e-4) * 1e-4
    sweep = Sweep(wheel=1, t=t, torque=torque, speed=speed, limit=100.0, inertia=0.003, angle=counted)
    fit = fit_driveline(sweep)
    # without noise but for encoder counts, to some per mille
    np.testing.assert_allclose(fit.values[2:], [0.04, 0.8, 2.0], rtol=0.01)
    assert all(finding.code != "excitation" for finding in fit.findings)


@pytest.mark.parametrize(("delta", "of_file"), [(1.0, "assumed: the sweep"), (1.4, "identified: a sweep")])
def test_a_robot_file_has_the_mean_shape_of_its_wheels_with_the_errors_of_one(delta, of_file):
    fits = [
        DrivelineFit(
            wheel=wheel,
            values=np.array([0.01 * wheel, 0.1, 0.05, v_s, delta]),
            standard_errors=np.array([1e-4, 1e-3, 0.01, 0.2, 0.5]),
            intervals=np.zeros((5, 2)),
            correlation=np.eye(5),
            predicted=np.zeros(1),
            without=np.zeros(1),
            rmse=0.0,
            rmse_without=0.0,
        )
        for wheel, v_s in ((1, 0.5), (2, 0.7), (3, 0.6))
    ]
    estimate = sweep_estimate(fits)
    assert estimate.labels[:2] + estimate.labels[-2:] == ("b1", "b2", "v_s", "delta")
    np.testing.assert_allclose(estimate.values[[0, 2, -2, -1]], [0.01, 0.03, 0.6, delta])
    np.testing.assert_allclose(estimate.errors[[0, 2, -2, -1]], [1e-4, 1e-4, 0.2, 0.5])
    robot = robot_with_friction(Robot.load("alten"), estimate, source="identified: a sweep")
    assert robot.friction.stribeck_exponent == pytest.approx(delta)
    assert robot.standard_deviations["friction.stribeck_exponent"] == pytest.approx(0.5)
    assert robot.sources["friction.stribeck_exponent"].startswith(of_file)


@pytest.mark.slow
def test_a_sweep_in_one_direction_is_refused():
    t = np.arange(4000) * SAMPLE_TIME
    torque = 0.5 + 0.1 * np.sin(2.0 * np.pi * t / 5.0)
    line = Driveline(inertia=0.003, friction=friction_of(np.array([0.02, 0.1, 0.05, 0.3, 1.0])))
    motion = simulate_driveline(line, torque[:-1], sample_time=SAMPLE_TIME, initial_speed=20.0)
    speed = np.append(20.0, motion.speeds) + 0.02 * np.random.default_rng(1).standard_normal(len(t))
    with pytest.raises(InputError, match="coulomb and offset"):
        fit_driveline(Sweep(wheel=1, t=t, torque=torque, speed=speed, limit=50.0, inertia=0.003))


def test_a_wheel_that_is_always_at_its_limit_is_refused():
    with pytest.raises(InputError, match="speed limit"):
        fit_driveline(replace(played_sweep(1), limit=1e-3))


def test_a_log_of_too_few_wheels_is_refused():
    t = np.arange(10) * SAMPLE_TIME
    log = Log({"t": t, "u1": t, "wheel1_dot": t})
    with pytest.raises(InputError, match="of 1 wheels"):
        sweeps_of(Robot.load("alten"), log)


def with_body(**columns: np.ndarray) -> Log:
    """Return a sweep of all wheels with more columns."""
    t = np.arange(400) * SAMPLE_TIME
    wheels = {f"{kind}{i}{end}": np.sin(t) for i in (1, 2, 3) for kind, end in (("u", ""), ("wheel", "_dot"))}
    return Log({"t": t} | wheels | columns)


def wave(size: float) -> np.ndarray:
    return size * np.sin(np.pi * np.arange(400) * SAMPLE_TIME)


@pytest.mark.parametrize(
    ("name", "values", "sentence"),
    [
        # a whole turn of a sine of 0.02 rad: 0.02 / sqrt(2) rad
        ("theta", wave(0.02), "sways by 0.81 degrees (root mean square of theta)"),
        ("ball_omega_y", wave(1.0), "a ball turns (ball_omega_y)"),
        ("u2", np.full(400, 0.3), "u2 is 0.3 N m throughout"),
        ("wheel3_dot", np.full(400, math.nan), "wheel3_dot has 400 of 400 values missing"),
    ],
)
def test_a_log_that_is_no_sweep_of_free_wheels_is_refused(tmp_path, capsys, name, values, sentence):
    with_body(**{name: values}).write(tmp_path / "log.csv")
    out = tmp_path / "out"
    assert main(["identify-driveline", "alten", str(tmp_path / "log.csv"), "--out", str(out)]) == 2
    told = capsys.readouterr().err
    assert sentence in told
    assert told.count("\n") == 1
    assert not out.exists()


def test_a_body_that_is_held_still_may_have_its_sensors_on():
    # attitude noise of 5 mrad, three times the preset's, about the tilt of a stand
    noise = 5e-3 * np.random.default_rng(0).standard_normal((2, 400))
    lean = with_body(theta=0.3 + noise[0], phi=noise[1], ball_omega_x=np.zeros(400))
    assert len(sweeps_of(Robot.load("alten"), lean)) == 3


@pytest.mark.sample
def test_the_shared_sweep(tmp_path, shared_data, capsys):
    log = Log.read(shared_data / "bbr" / "driveline_sweep.csv").between(0.0, 37.0)
    log.write(tmp_path / "sweep.csv")
    assert main(["identify-driveline", "alten", str(tmp_path / "sweep.csv"), "--out", str(tmp_path)]) == 0
    results = json.loads((tmp_path / "results.json").read_text(), parse_constant=pytest.fail)
    # the wheel's speed comes in encoder counts; a fit to 0.1 rad/s of 27.7 leaves little else
    assert max(results["rmse"]) < 0.1
    # without friction every wheel is at its limit or on its way there
    assert min(results["rmse_without_friction"]) > 10.0
    robot = Robot.load(tmp_path / "robot.toml")
    assert list(robot.friction.coulomb) == results["parameters"]["c"]
    page = (tmp_path / "report.html").read_text()
    assert figure_count(page) == 5
    assert "v_s" in capsys.readouterr().out
