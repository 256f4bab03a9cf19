"""Alignment with motion capture: on runs whose clocks, frames, flips and faults are known."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ballbot.errors import InputError
from ballbot.findings import texts
from ballbot.identification.turning import Clock
from ballbot.log import Log
from ballbot.validation.alignment import align, alignment_findings
from tests.support.alignment_examples import Setup, flipped, record, unseen

ANGLE = st.floats(-3.1, 3.1)
#: required: 1 ms and 0.1 degrees. Cameras to 1 mrad a frame and 40 s of sway of 0.1 rad give a tenth of the first
ONE_MILLISECOND, TENTH_OF_A_DEGREE = 1e-3, np.radians(0.1)


def off(found: Rotation, true: Rotation) -> float:
    return float((found.inv() * true).magnitude())


@pytest.mark.slow
@settings(max_examples=2, deadline=None)
@given(
    seed=st.integers(0, 1000),
    offset=st.floats(-50.0, 1000.0),
    rate=st.floats(-5e-3, 5e-3),
    world=st.tuples(ANGLE, ANGLE, ANGLE),
    marker=st.tuples(ANGLE, ANGLE, ANGLE),
)
def test_any_clock_and_any_frames_are_found(seed, offset, rate, world, marker):
    camera_world, body_marker = (Rotation.from_euler("XYZ", angles) for angles in (world, marker))
    setup = Setup(
        seed=seed, offset=offset, rate=rate, camera_world=camera_world, body_marker=body_marker, origin=(1.0, -2.0, 0.5)
    )  # fmt: skip
    found = align(*record(setup))
    # at both ends of the log, so that offset and rate are both right
    ends = np.array([0.0, setup.duration])
    true = Clock(offset=offset, rate=rate).to_cameras(ends)
    np.testing.assert_allclose(found.motion.clock.to_cameras(ends), true, rtol=0.0, atol=ONE_MILLISECOND)
    assert off(found.motion.body_marker, body_marker) < TENTH_OF_A_DEGREE
    assert found.frame is not None
    # the world's heading is the log's over two seconds, whose marker frame is known to a tenth of a degree
    assert off(found.frame.camera_world, camera_world) < 1.5 * TENTH_OF_A_DEGREE
    assert found.frame.origin is not None
    np.testing.assert_allclose(found.frame.origin, setup.origin, rtol=0.0, atol=2e-3)


@pytest.mark.slow
def test_alignment_intervals_cover_the_truth_in_95_percent():
    inside = []
    for seed in range(7):
        setup = Setup(seed=seed, duration=20.0, offset=5.0, rate=1e-4)
        motion = align(*record(setup)).motion
        turned = motion.body_marker.as_rotvec()
        inside += [
            abs(motion.clock.offset - 5.0) < motion.offset_half_width,
            abs(motion.clock.rate - 1e-4) < motion.rate_half_width,
            *(np.abs(turned) < motion.rotation_half_width),
        ]
    # 35 intervals, five a run and hardly related: 0.95 +- 0.037; three times that below
    assert np.mean(inside) > 0.84


#: the markers of a body may be confused in the ways that a cube can be turned
TURNS = [one for one in Rotation.create_group("O") if one.magnitude() > 0.1]


@pytest.mark.slow
@settings(max_examples=2, deadline=None)
@given(flip=st.sampled_from(TURNS), start=st.floats(8.0, 20.0), seed=st.integers(0, 99))
def test_poses_of_confused_markers_are_not_used(flip, start, seed):
    setup = Setup(seed=seed)
    log, film = record(setup)
    film = flipped(film, start=start, end=start + 4.0, flip=flip)
    film = flipped(film, start=start + 6.0, end=start + 6.001, flip=flip)
    found = align(log, film)
    # 4 s of 40, and to two poses of the log's beside the single frame's
    assert found.unseen == pytest.approx(0.1, abs=0.003)
    assert off(found.motion.body_marker, setup.body_marker) < TENTH_OF_A_DEGREE
    assert found.sensors is not None
    # the cameras' own noise is 1 mrad
    assert all(found.sensors.of[name].rms < 2e-3 for name in ("theta", "phi", "psi"))


def test_markers_confused_out_of_view_are_refused_with_their_time():
    log, film = record(Setup())
    film = flipped(film, start=30.0, end=100.0, flip=Rotation.from_euler("Z", 90.0, degrees=True))
    with pytest.raises(InputError, match=r"at 27\.\d+ s of the log"):  # the cameras' clock is 3 s ahead
        align(log, unseen(film, start=29.0, end=30.5))


def test_a_motion_that_repeats_itself_has_a_rival():
    # whole multiples of 0.25 Hz: every 4 s the same
    log, film = record(Setup(period=4.0))
    found = align(log, film.between(3.0, 31.0))
    # of the clocks 4 s apart, the ones with the most in common; which of them, no one can say
    periods = (found.motion.clock.offset - 3.0) / 4.0
    assert abs(periods - round(periods)) < ONE_MILLISECOND / 4.0
    assert found.rival_clock is not None
    assert any("repeats itself" in sentence for sentence in texts(alignment_findings(found)))


def test_the_aligned_log_is_the_robots_truth():
    turn = Rotation.from_euler("XYZ", [0.3, -0.5, 2.0])
    log, film = record(Setup(camera_world=turn, body_marker=turn.inv(), origin=(3.0, 1.0, 2.0), spin=0.5))
    found = align(log, film).log
    for name, tolerance in (("theta", 5e-3), ("phi", 5e-3), ("psi", 5e-3), ("x", 3e-3), ("y", 3e-3)):
        # five times the noise of a frame, 1 mrad and 0.2 mm, and what the frame's 0.1 degrees make of the path
        np.testing.assert_allclose(found[f"mocap_{name}"], log[name], rtol=0.0, atol=tolerance)
    np.testing.assert_allclose(found["mocap_z"], 0.0, atol=3e-3)


def test_findings_report_the_thesis_heading_drift():
    drift = np.radians(5.3) / 60.0
    found = align(*record(Setup(heading_drift=drift, spin=0.1)))
    assert found.sensors is not None
    psi, position = found.sensors.of["psi"], found.sensors.position
    assert abs(psi.drift - drift) < 0.02 * drift
    # nothing but the heading's error is in the position, so that it explains all but the cameras' noise
    assert position is not None
    assert position.by_heading > 0.95
    heading = alignment_findings(found)[0].text
    written = re.match(r"Heading drifts ([\d.]+) ± [\d.]+ degrees a minute", heading)
    assert written is not None
    assert float(written[1]) == pytest.approx(5.3, rel=0.02)  # as the drift above
    assert "position error follows it" in heading


def test_a_wheel_radius_that_is_wrong_is_no_drift():
    found = align(*record(Setup(wheel_scale=1.03)))
    assert found.sensors is not None
    position, path = found.sensors.position, found.path
    assert position is not None
    assert path is not None
    assert position.by_heading < 0.2
    assert abs(path.scale - 1.03) < 2e-3
    sentences = texts(alignment_findings(found))
    assert sentences[0].startswith("Heading does not drift")
    assert any("% too long" in sentence for sentence in sentences)


def test_delayed_angles_are_separated_from_the_clock_offset():
    found = align(*record(Setup(angle_delay=0.02)))
    assert found.sensors is not None
    assert abs(found.motion.clock.offset - 3.0) < ONE_MILLISECOND
    for name in ("theta", "phi", "psi"):
        assert found.sensors.of[name].delay == pytest.approx(0.02, abs=2e-3)
    assert sum("behind the gyro" in sentence for sentence in texts(alignment_findings(found))) == 3


def test_the_lever_arm_is_found_and_taken_off():
    lever = (0.05, -0.1, 0.9)
    found = align(*record(Setup(lever=lever)))
    assert found.path is not None
    # a lean of 0.05 rad over 0.9 m is 45 mm; the cameras see 0.2 mm and the frame is known to 0.1 degrees
    np.testing.assert_allclose(found.path.used, lever, rtol=0.0, atol=0.01)
    log = found.log
    np.testing.assert_allclose(log["mocap_x"], log["x"], rtol=0.0, atol=4e-3)


def test_clock_comes_from_angles_without_gyro_and_from_gyro_without_angles():
    setup = Setup(body_marker=Rotation.from_euler("Z", 90.0, degrees=True))
    log, film = record(setup)
    angles = Log({name: log[name] for name in ("t", "theta", "phi", "psi")})
    gyro = Log({name: log[name] for name in ("t", "gyro_x", "gyro_y", "gyro_z")})
    by_angles, by_gyro = align(angles, film), align(gyro, film)
    for found in (by_angles, by_gyro):
        assert abs(found.motion.clock.offset - 3.0) < ONE_MILLISECOND
        assert off(found.motion.body_marker, setup.body_marker) < TENTH_OF_A_DEGREE
    assert by_angles.sensors is not None
    assert by_angles.sensors.position is None
    assert by_gyro.frame is None


def test_turning_about_one_axis_is_refused():
    log, film = record(Setup())
    random = np.random.default_rng(1)
    heading = 0.5 * np.sin(film.t + np.sin(0.3 * film.t))
    rate = 0.5 * np.cos(film.t + np.sin(0.3 * film.t)) * (1.0 + 0.3 * np.cos(0.3 * film.t))
    # cameras to 1 mrad, a gyro to 1 mrad/s
    wobble = Rotation.from_rotvec(1e-3 * random.standard_normal((len(film), 3)))
    q = (Rotation.from_rotvec(np.outer(heading, [0.0, 0.0, 1.0])) * wobble).as_quat()
    film = film.with_columns({"qw": q[:, 3], "qx": q[:, 0], "qy": q[:, 1], "qz": q[:, 2]})
    gyro = 1e-3 * random.standard_normal((len(log), 3))
    gyro[:, 2] += np.interp(log.t + 3.0, film.t, rate)
    with pytest.raises(InputError, match="turn about one axis only"):
        align(Log({"t": log.t} | {f"gyro_{a}": gyro[:, i] for i, a in enumerate("xyz")}), film)


def test_motion_capture_of_another_run_is_refused():
    log, _ = record(Setup(seed=1))
    _, film = record(Setup(seed=2))
    with pytest.raises(InputError, match="do not turn alike"):
        align(log, film)


def test_missing_columns_are_reported():
    log, film = record(Setup(duration=10.0))
    with pytest.raises(InputError, match="no poses"):
        align(log, film.with_columns({"qw": np.full(len(film), np.nan)}))
    with pytest.raises(InputError, match="theta, phi, psi"):
        align(Log({"t": log.t, "x": log["x"]}), film)
