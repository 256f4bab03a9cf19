"""The parts of `ballbot spin`: seams, view, the table of the sphere, motions, frames, times and the smoother."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ballbot.vision.seam import SEAMS, seam_named, seam_table, thesis_seam
from ballbot.vision.tracking import Track, angular_velocity
from ballbot.vision.video import Video, frame_times
from ballbot.vision.view import View, view_of_outline
from tests.support.ball_video import wandering

#: a ball whose rim is at most 70 degrees from the optical axis
VIEWS = st.builds(
    lambda aside, below, radius, closeness: View(
        x=199.5 + aside * radius,
        y=149.5 + below * radius,
        radius=radius,
        closeness=closeness,
        middle=(199.5, 149.5),
    ),
    aside=st.floats(-0.9, 0.9),
    below=st.floats(-0.9, 0.9),
    radius=st.floats(20.0, 300.0),
    closeness=st.floats(0.01, 0.45),
)
VECTOR = st.tuples(*[st.floats(-1.0, 1.0)] * 3).map(np.array).filter(lambda v: np.linalg.norm(v) > 0.1)


@given(a=st.floats(0.51, 0.99))
def test_the_mended_seam_lies_on_the_sphere_and_the_printed_ones_leave_it(a):
    np.testing.assert_allclose(np.linalg.norm(thesis_seam(a).points, axis=1), 1.0, rtol=0.0, atol=1e-12)
    t, b = np.linspace(0.0, 2.0 * np.pi, 1000), 1.0 - a
    x, z = a * np.cos(t) + b * np.cos(3 * t), np.sin(2 * t)
    printed = np.column_stack([x, a * np.sin(t) - b * np.cos(3 * t), 2.0 * np.sqrt(a * b) * z])
    small_c = np.column_stack([x, a * np.sin(t) - b * np.sin(3 * t), np.sqrt(a * b) * z])
    # at t = 0 the printed second component is -b where it should be 0; at t = pi/4, c is half of what it should be
    assert np.ptp(np.linalg.norm(printed, axis=1)) > b**2 / 4.0
    assert np.ptp(np.linalg.norm(small_c, axis=1)) > a * b


@pytest.mark.parametrize("name", SEAMS)
def test_seams_are_closed_and_have_a_half_turn(name):
    seam = seam_named(name)
    for curve in seam.curves:
        steps = np.linalg.norm(curve - np.roll(curve, 1, axis=0), axis=1)
        assert steps.max() < 4e-3
    # a half turn about z is one of the seam's symmetries, for which several orientations look alike
    turned = seam.points * [-1.0, -1.0, 1.0]
    nearest = np.min(np.linalg.norm(turned[::97, None] - seam.points[None], axis=2), axis=1)
    assert nearest.max() < 4e-3


@settings(max_examples=30)
@given(view=VIEWS, direction=VECTOR)
def test_a_point_is_seen_where_it_projects_to(view, direction):
    point = direction / np.linalg.norm(direction)
    place, facing = view.project(point[None])
    if facing[0] < 0.02:
        return
    found, cosine = view.points(place)
    # near the rim a millionth of a pixel is a thousandth of the ball
    np.testing.assert_allclose(found[0], point, rtol=0.0, atol=1e-9 / facing[0])
    np.testing.assert_allclose(cosine, facing, rtol=0.0, atol=1e-7)


@settings(max_examples=50)
@given(view=VIEWS)
def test_outline_is_where_rays_graze_the_ball_and_determines_the_view(view):
    outline = view.outline(100)
    rays = view.rays(outline)
    # the distance of the ball's centre from each ray is the ball's radius
    away = np.linalg.norm(np.cross(rays, view.distance * view.axis), axis=1)
    np.testing.assert_allclose(away, 1.0, rtol=0.0, atol=1e-9)
    found = view_of_outline(outline, size=(400, 300), closeness=view.closeness)
    # a tenth of the accuracy of an outline in a picture
    np.testing.assert_allclose(
        [found.x, found.y, found.radius], [view.x, view.y, view.radius], rtol=0.0, atol=0.02
    )


def test_the_table_gives_the_distance_from_the_curve():
    seam = thesis_seam()
    rng = np.random.default_rng(0)
    q = rng.normal(size=(400, 3))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    brute = np.arccos(np.clip(np.max(q @ seam.points.T, axis=1), -1.0, 1.0))
    table = seam_table(seam)
    found = np.arcsin(np.abs(np.sum(table.normals_at(q.astype(np.float32)) * q, axis=1)))
    # nearer, the distance from the next of the curve's points is not the curve's
    near = (brute > 0.02) & (brute < 0.3)
    # a cell is 0.006 rad across and the curve bends by at most 4 a radian: 4 * 0.006^2
    assert near.sum() > 100
    np.testing.assert_allclose(found[near], brute[near], rtol=0.0, atol=3e-4)


def test_frame_times_are_even_where_a_container_rounded_them():
    video = Video(path=Path("a.mp4"), size=(4, 4), frame_rate=60.0, rate_given=False, stated_frames=0)
    k = np.arange(200)
    np.testing.assert_allclose(frame_times(np.round(k / 60.0, 3), video), k / 60.0, atol=2e-4)
    slow_motion = frame_times(k / 30.0, replace(video, frame_rate=240.0, rate_given=True))
    np.testing.assert_allclose(slow_motion, k / 240.0, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(frame_times(np.zeros(200), video), k / 60.0, atol=1e-12)
    uneven = np.cumsum(np.where(k % 7 == 0, 0.05, 0.0167))
    np.testing.assert_allclose(frame_times(uneven, video), uneven - uneven[0], atol=1e-12)


def made_track(*, seed: int, noise: float, blind: bool) -> tuple[np.ndarray, Track, np.ndarray]:
    """Return times, a track with known noise and the true velocity; `blind` frames contain nothing about one axis."""
    motion = wandering(duration=6.0, peak=8.0, seed=seed)
    rng = np.random.default_rng(seed)
    t = np.arange(360) / 60.0
    sizes = np.tile([noise, noise, noise], (360, 1))
    information = np.tile(np.eye(3), (360, 1, 1))
    if blind:
        rows = np.arange(360) % 60 < 12
        sizes[rows, 2] = 0.02  # whatever the tracker says of a turn about z then
        information[rows] = np.diag([1.0, 1.0, 0.0])
    R = Rotation.from_rotvec(rng.normal(size=(360, 3)) * sizes).as_matrix() @ motion.orientation(t)
    # as if each point erred by 1 rad, where it errs by 0.03
    track = Track(
        stated=t, R=R, information=0.03**2 * information / noise**2, bias=np.zeros((360, 3, 3)), quality=np.ones(360),
        stretch=np.zeros(360, np.int64),
    )  # fmt: skip
    return t, track, motion.omega_at(t)


def test_smoother_errors_match_its_covariance():
    inside, errors = [], []
    for seed in range(3):
        t, track, true = made_track(seed=seed, noise=2e-3, blind=seed > 0)
        found = angular_velocity(t, track)
        size = np.sqrt(np.einsum("kii->ki", found.covariance))
        inside.append(np.abs(found.omega - true) < 2.0 * size)
        errors.append(found.omega - true)
    # 95.4 %; errors go together over some ten frames, so that 3240 are like 300: +- 1.2 %, and the jerk is not white
    assert 0.90 < np.mean(inside) < 0.99
    # a central difference over two frames has 2e-3 / sqrt(2) * 60 = 0.085
    assert np.sqrt(np.mean(np.square(errors))) < 0.06
