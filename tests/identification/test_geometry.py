"""Geometry from logs: known robots, deliberately wrong files, errors that cover, and the logs of the stand-in."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ballbot import InputError, Log, Robot
from ballbot.cli.main import main
from ballbot.findings import texts
from ballbot.identification.geometry import (
    Geometry,
    GeometryQuantity,
    geometry_findings,
    mocap_run,
    robot_with_geometry,
    survey_geometry,
)
from ballbot.log.columns import STATE_NAMES
from ballbot.log.pose import wheel_speeds_of_states
from ballbot.mechanics.geometry import body_rates_matrix, transforms
from ballbot.progress import Progress
from ballbot.twin.recording import MotionCapture

ALTEN = Robot.load("alten")
COUNT = 2.0 * math.pi / (2000 * 27.6)  # an encoder's step at the wheel [rad]
CAMERA_NOISE = 0.03  # of the ball's angular velocity [rad/s]


def waves(t: np.ndarray, sizes: list[float], *, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return sums of three slow sines for each column, and their integrals from t[0]."""
    random, rates, totals = np.random.default_rng(seed), [], []
    for size in sizes:
        f, phase = 2.0 * math.pi * random.uniform(0.1, 0.7, 3), random.uniform(0.0, 6.28, 3)
        rates.append(size * np.sin(f * t[:, None] + phase).sum(axis=1))
        totals.append(size * (-np.cos(f * t[:, None] + phase) / f).sum(axis=1))
    total = np.stack(totals, axis=1)
    return np.stack(rates, axis=1), total - total[0]


def upside_down_log(
    robot: Robot, *, seed: int, duration: float = 40.0, turned: Rotation | None = None
) -> Log:
    """Return encoder angles, in counts, of a ball that turns by `waves`, and what a noisy camera sees of it."""
    t = np.arange(0.0, duration, 0.005)
    omega, total = waves(t, [3.0, 4.0, 2.5], seed=seed)
    wheels = np.round(total @ transforms(robot).T_owb.T / COUNT) * COUNT
    seen = (turned or Rotation.identity()).apply(omega)
    seen += CAMERA_NOISE * np.random.default_rng(seed + 1).standard_normal(omega.shape)
    columns = {"t": t} | {f"wheel{i + 1}": wheels[:, i] for i in range(robot.wheel_count)}
    return Log(columns | {f"ball_omega_{axis}": seen[:, i] for i, axis in enumerate("xyz")})


def balancing_run(
    robot: Robot, *, seed: int, duration: float = 60.0, imu: Rotation | None = None
) -> tuple[Log, Log]:
    """Return the log and the film of a robot that wanders, leans and turns by `waves`, without slip."""
    t = np.arange(0.0, duration, 0.005)
    rates, positions = waves(t, [0.2, 0.25, 0.02, 0.02, 0.3], seed=seed)
    states = np.hstack([positions, rates])
    speeds = wheel_speeds_of_states(states, robot)
    angles = np.vstack([np.zeros(3), np.cumsum(0.0025 * (speeds[1:] + speeds[:-1]), axis=0)])
    angles = np.round(angles / COUNT) * COUNT
    body = np.einsum("kij,kj->ki", body_rates_matrix(*positions[:, 2:].T), rates[:, 2:])
    random = np.random.default_rng(seed + 1)
    gyro = (imu or Rotation.identity()).apply(body) + 0.002 * random.standard_normal(body.shape)
    gyro += [0.004, -0.002, 0.003]
    columns = {"t": t} | {f"wheel{i + 1}": angles[:, i] for i in range(3)}
    log = Log(columns | {f"gyro_{axis}": gyro[:, i] for i, axis in enumerate("xyz")})
    truth = Log({"t": t} | {name: states[:, i] for i, name in enumerate(STATE_NAMES)})
    return log, MotionCapture.drawn(seed).record(truth, ball_radius=robot.ball.radius)


def other(**change: object) -> Robot:
    """Return alten with other wheels."""
    return ALTEN.replace(wheels=replace(ALTEN.wheels, **change))


#: what is true, and nobody's file says
TRUE = replace(
    ALTEN,
    ball=replace(ALTEN.ball, radius=0.1115),
    wheels=replace(
        ALTEN.wheels, radius=0.0612, tilt=math.radians(46.2), azimuths=tuple(np.radians([0.7, 119.1, 241.4]))
    ),
)


def named(geometry: Geometry, name: str) -> GeometryQuantity:
    return next(quantity for quantity in (*geometry.measured, *geometry.others) if quantity.name == name)


class TestKnownRobots:
    def test_a_wrong_file_is_found_out_in_every_number(self):
        shown: list[Progress] = []
        found = survey_geometry(
            ALTEN,
            upside_down=[upside_down_log(TRUE, seed=1)],
            balancing=[balancing_run(TRUE, seed=2), balancing_run(TRUE, seed=3)],
            progress=shown.append,
        )
        assert [(one.done, one.total) for one in shown] == [(0, 4), (1, 4), (2, 4), (3, 4)]
        truth = {
            "ball.radius": 0.1115,
            "wheels.radius": 0.0612,
            "wheels.tilt": TRUE.wheels.tilt,
            "ball.radius / wheels.radius": 0.1115 / 0.0612,
            "wheels.radius / cos(wheels.tilt)": 0.0612 / math.cos(TRUE.wheels.tilt),
        } | {f"wheels.azimuths[{i}]": TRUE.wheels.azimuths[i] for i in range(3)}
        for one in found.measured:
            assert abs(one.value - truth.get(one.name, 0.0)) < 4.0 * one.standard_error, one
        assert named(found, "ball.radius").standard_error < 2e-4  # a tape measure has a millimetre
        assert named(found, "wheels.tilt").standard_error < math.radians(0.05)
        findings = " ".join(texts(geometry_findings(found)))
        for name in ("ball.radius", "wheels.radius", "wheels.tilt", "wheels.azimuths[1]"):
            assert f"{name} is " in findings
        assert "IMU" not in findings
        leaning = named(found, "leaning seen")
        assert leaning.value == pytest.approx(1.0, abs=4.0 * leaning.standard_error)

    def test_upside_down_alone_says_what_it_cannot_tell(self):
        found = survey_geometry(other(radius=0.0605), upside_down=[upside_down_log(ALTEN, seed=6)])
        findings = texts(geometry_findings(found))
        assert "would show which of the two radii" in findings[0]
        assert "need a balancing run" in findings[-1]
        assert "ball.radius" not in {quantity.name for quantity in found.measured}

    def test_a_turned_camera_is_not_taken_for_turned_wheels(self):
        turned = Rotation.from_rotvec(np.radians([1.5, -2.0, 3.0]))
        found = survey_geometry(ALTEN, upside_down=[upside_down_log(ALTEN, seed=8, turned=turned)])
        findings = " ".join(texts(geometry_findings(found)))
        assert "All azimuths are turned by" in findings
        assert "camera tilt about x is " in findings
        assert "wheels.azimuths[" not in findings
        assert "wheels.tilt is" not in findings
        straight = robot_with_geometry(ALTEN, found)
        np.testing.assert_allclose(straight.wheels.azimuths, ALTEN.wheels.azimuths, atol=math.radians(0.2))

    def test_one_larger_wheel_is_named(self):
        log = upside_down_log(ALTEN, seed=9)
        found = survey_geometry(ALTEN, upside_down=[log.with_columns({"wheel2": 0.97 * log["wheel2"]})])
        assert any(sentence.startswith("Wheel 2 turns -") for sentence in texts(geometry_findings(found)))

    @pytest.mark.parametrize("degrees", [[2.0, -1.0, 4.0], [180.0, 0.0, 0.0]])
    def test_the_imus_mounting_and_the_cameras_clock(self, degrees: list[float]):
        imu = Rotation.from_rotvec(np.radians(degrees))
        log, film = balancing_run(ALTEN, seed=10, imu=imu)
        motion = mocap_run(log, film).motion
        off = (motion.body_marker * imu.inv()).magnitude()
        assert off < 5.0 * np.linalg.norm(motion.rotation_errors)
        assert math.degrees(off) < 0.5
        np.testing.assert_allclose(motion.bias, [0.004, -0.002, 0.003], atol=5e-4)
        setup = MotionCapture.drawn(10)
        expected = (1.0 + setup.clock_rate) * log.t + setup.clock_offset
        # a tenth of the cameras' interval
        np.testing.assert_allclose(motion.clock.to_cameras(log.t), expected, atol=8e-4)

    def test_gaps_and_falls_are_left_out(self):
        log, film = balancing_run(ALTEN, seed=11)
        names = ("x", "y", "z", "qw", "qx", "qy", "qz")
        lost = {name: film[name].copy() for name in names}
        for name in names:
            lost[name][2000:2400] = np.nan  # out of view
        lying = Rotation.from_euler("x", 1.2).as_quat()[[3, 0, 1, 2]]
        for name, value in zip(names[3:], lying, strict=True):
            lost[name][-600:] = value  # fallen
        gone = np.where((log.t > 5.0) & (log.t < 6.0), np.nan, log["wheel1"])
        found = survey_geometry(
            ALTEN, balancing=[(log.with_columns({"wheel1": gone}), film.with_columns(lost))]
        )
        length = named(found, "wheels.radius / cos(wheels.tilt)")
        assert abs(length.deviation) < 4.0


@pytest.mark.sample
def test_intervals_cover_the_truth():
    """Of 200 logs, 95 % intervals must hold each true value 190 times, to three binomial deviations (3.1)."""
    truth = np.array([0.1115 / 0.0612, TRUE.wheels.tilt, *TRUE.wheels.azimuths])
    held = np.zeros(5)
    for seed in range(200):
        found = survey_geometry(TRUE, upside_down=[upside_down_log(TRUE, seed=3 * seed)]).measured[:5]
        held += [
            abs(one.value - value) < 1.96 * one.standard_error
            for one, value in zip(found, truth, strict=True)
        ]
    assert (np.abs(held - 190) < 3.0 * 3.1).all(), held


class TestStandIn:
    @pytest.mark.usefixtures("undrawn")
    def test_wrong_file_by_the_command(self, shared_data, tmp_path, capsys):
        folder = shared_data / "bbr"
        other(radius=0.0615, azimuths=tuple(np.radians([0, 122, 240]))).write(tmp_path / "wrong.toml")
        command = ["identify-geometry", str(tmp_path / "wrong.toml")]
        command += ["--upside-down", str(folder / "upside_down.csv")]
        command += ["--balancing", str(folder / "square_soft.csv")]
        command += ["--motion-capture", str(folder / "square_soft_mocap.csv"), "--out", str(tmp_path / "out")]
        assert main(command) == 0
        printed = capsys.readouterr().out
        assert "wheels.radius is 0.0628" in printed
        assert "wheels.azimuths[1] is 119.87 deg" in printed
        results = json.loads((tmp_path / "out" / "results.json").read_text())
        assert {one["name"] for one in results["measured"]} >= {"ball.radius", "IMU rotation about z"}
        robot = Robot.load(tmp_path / "out" / "robot.toml")
        # slip, a soft ball and two rows of rollers leave half a percent
        assert robot.wheels.radius == pytest.approx(0.063, rel=5e-3)
        assert robot.ball.radius == pytest.approx(0.11, rel=5e-3)
        assert robot.standard_deviations["wheels.radius"] == pytest.approx(
            0.006 * robot.wheels.radius, rel=0.1
        )
        assert robot.sources["wheels.radius"].startswith("identified")


class TestRefusals:
    def test_a_short_log(self):
        with pytest.raises(InputError, match="log for longer"):
            survey_geometry(ALTEN, upside_down=[upside_down_log(ALTEN, seed=22, duration=6.0)])

    def test_a_ball_that_turns_about_one_axis_only(self):
        log = upside_down_log(ALTEN, seed=23)
        t = log.t
        angle = 4.0 * np.sin(t)
        wheels = angle[:, None] * transforms(ALTEN).T_owb[:, 2]
        columns = {f"wheel{i + 1}": wheels[:, i] for i in range(3)}
        columns |= {"ball_omega_x": 0.0 * t, "ball_omega_y": 0.0 * t, "ball_omega_z": 4.0 * np.cos(t)}
        with pytest.raises(InputError, match="does not determine"):
            survey_geometry(ALTEN, upside_down=[log.with_columns(columns)])
