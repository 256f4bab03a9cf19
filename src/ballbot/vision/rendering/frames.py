"""Frames of a turning ball, from a scene and a motion.

Light is added up in linear intensities over the exposure and over points within each pixel, then blurred by the lens,
encoded with a gamma of 2.2, and noise is added. The seam's cover of a pixel comes from the distance to the curve,
from a map of its own: the tracker's table takes no part.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ballbot.vision.rendering.motion import Motion
from ballbot.vision.rendering.scene import Colour, Scene
from ballbot.vision.seams import Seam
from ballbot.vision.sphere_table import cell_directions, octahedral
from ballbot.vision.view import View

_GAMMA = 2.2
#: cells along a side of the map of distances, one about 0.003 rad
_SIDE = 1024
#: points of a pixel and instants of an exposure: a sharp frame takes few
_SAMPLES_STILL, _SAMPLES_MOVING = 4, 10
#: an exposure below this share is still
_STILL = 0.2
#: darkest that the ball's shading gets at its rim, as a share
_RIM = 0.35
#: width of a shadow's edge [pixels]
_PENUMBRA = 6.0


@dataclass(frozen=True, kw_only=True, eq=False)
class _Canvas:
    """All that does not change from frame to frame; colours linear, in OpenCV's order blue, green, red."""

    corner: tuple[int, int]  #: column and row of the ball's box
    rays: list[NDArray[np.float32]]  #: points of the ball (k, 3) by sample, camera frame
    covered: list[NDArray[np.bool_]]  #: (rows, columns) which pixels these are
    light: NDArray[np.float32]  #: (height, width) on the whole picture
    shading: NDArray[np.float32]  #: (rows, columns) of the ball
    highlight: NDArray[np.float32]  #: (rows, columns)
    background: NDArray[np.float32]  #: (height, width, 3)
    distances: NDArray[np.float32]  #: (side, side) to the seam [rad]
    encode: NDArray[np.uint8]  #: by linear light in 4095 steps


def view_of(scene: Scene) -> View:
    """Return the view that a scene's camera has."""
    camera = scene.camera
    middle = (0.5 * (camera.size[0] - 1), 0.5 * (camera.size[1] - 1))
    return View(
        x=camera.centre[0], y=camera.centre[1], radius=camera.radius, closeness=1.0 / camera.distance, middle=middle
    )  # fmt: skip


def render(scene: Scene, motion: Motion, *, duration: float, seed: int = 0) -> Iterator[NDArray[np.uint8]]:
    """Yield the frames (height, width, 3) uint8, as OpenCV has them, of `duration` seconds.

    The k-th is the light of the exposure whose middle is at k / frame_rate.
    """
    camera = scene.camera
    canvas = _canvas(scene)
    count = len(canvas.rays)
    rng = np.random.default_rng(seed)
    cv2.setRNGSeed(seed % 2**31)  # OpenCV takes a signed integer of 32 bits
    order = rng.permutation(count)  # so that places within a pixel do not go with instants
    for frame in range(round(duration * camera.frame_rate)):
        middle = frame / camera.frame_rate
        within = (np.arange(count) + 0.5) / count - 0.5
        instants = middle + within[order] * camera.exposure / camera.frame_rate
        yield _frame(scene, canvas, motion.orientation(instants), middle)


def _frame(scene: Scene, canvas: _Canvas, R: NDArray[np.float64], t: float) -> NDArray[np.uint8]:
    seam, ball = _linear(scene.seam_colour), _linear(scene.ball_colour)
    rows, columns = canvas.shading.shape
    share = np.zeros((rows, columns), np.float32)  # of the pixel that is ball, and that is seam
    seamed = np.zeros((rows, columns), np.float32)
    sharp = np.float32(scene.camera.radius)
    for rays, covered, rotation in zip(canvas.rays, canvas.covered, R, strict=True):
        distance = _sampled(canvas.distances, rays @ rotation.astype(np.float32))
        cover = np.clip((np.float32(0.5 * scene.seam_width) - distance) * sharp + np.float32(0.5), 0.0, 1.0)
        share[covered] += 1.0
        seamed[covered] += cover
    share /= len(canvas.rays)
    seamed /= len(canvas.rays)
    albedo = share[..., None] * ball + seamed[..., None] * (seam - ball)
    column, row = canvas.corner
    picture = canvas.background.copy()
    box = picture[row : row + rows, column : column + columns]
    box *= (1.0 - share)[..., None]
    box += albedo * canvas.shading[..., None]
    picture *= (canvas.light * _shadow(scene, t))[..., None]
    box += canvas.highlight[..., None] * share[..., None]
    return _developed(scene, canvas, picture)


def _developed(scene: Scene, canvas: _Canvas, picture: NDArray[np.float32]) -> NDArray[np.uint8]:
    if scene.camera.blur > 0.0:
        picture = np.asarray(cv2.GaussianBlur(picture, (0, 0), scene.camera.blur), np.float32)
    levels = np.clip(picture * 4095.0, 0.0, 4095.0).astype(np.uint16)
    encoded = canvas.encode[levels]
    if scene.camera.noise > 0.0:
        noise = cv2.randn(
            np.empty(encoded.shape, np.int16), np.zeros((4, 1)), np.full((4, 1), scene.camera.noise)
        )
        encoded = cv2.add(encoded, noise, dtype=cv2.CV_8U)
    return np.asarray(encoded, np.uint8)


def _canvas(scene: Scene) -> _Canvas:
    camera, view = scene.camera, view_of(scene)
    width, height = camera.size
    reach = camera.radius * 1.2 + 4.0
    left, top = max(0, int(view.x - reach)), max(0, int(view.y - reach))
    right, bottom = min(width, int(view.x + reach) + 1), min(height, int(view.y + reach) + 1)
    grid = np.stack(np.meshgrid(np.arange(left, right), np.arange(top, bottom)), axis=-1).astype(np.float64)
    rays, covered = [], []
    for offset in _offsets(_SAMPLES_STILL if camera.exposure < _STILL else _SAMPLES_MOVING):
        points, facing = view.points((grid + offset).reshape(-1, 2))
        hit = np.isfinite(facing)
        rays.append(points[hit].astype(np.float32))
        covered.append(hit.reshape(grid.shape[:2]))
    points, facing = view.points(grid.reshape(-1, 2))
    facing = np.nan_to_num(facing)
    lamp = np.array([-0.35, -0.45, -0.82])  # where the lamp is from the ball, camera frame
    lit = np.clip(np.nan_to_num(points) @ lamp, 0.0, 1.0)
    shading = _RIM + (1.0 - _RIM) * (0.5 * facing + 0.5 * lit)
    highlight = scene.light.highlight * np.exp(-(1.0 - lit) / 0.006)
    return _Canvas(
        corner=(left, top),
        rays=rays,
        covered=covered,
        light=_light(scene),
        shading=shading.reshape(grid.shape[:2]).astype(np.float32),
        highlight=highlight.reshape(grid.shape[:2]).astype(np.float32),
        background=_background(scene, view),
        distances=_distances(scene.seam),
        encode=np.round(255.0 * (np.arange(4096) / 4095.0) ** (1.0 / _GAMMA)).astype(np.uint8),
    )


def _offsets(count: int) -> NDArray[np.float64]:
    """Return places (count, 2) within a pixel, spread evenly: the plastic number's sequence."""
    k = np.arange(count)[:, None] + 0.5
    places = (k * np.array([0.7548776662466927, 0.5698402909980532])) % 1.0
    return places - places.mean(axis=0)


def _light(scene: Scene) -> NDArray[np.float32]:
    width, height = scene.camera.size
    across = np.add.outer(np.linspace(0.0, 0.6, height), np.linspace(0.0, 0.4, width))
    return (1.0 - scene.light.uneven * across).astype(np.float32)


def _shadow(scene: Scene, t: float) -> NDArray[np.float32] | np.float32:
    """Return the share of light (height, width) that a shadow leaves: a slanting band that swings across the ball."""
    light, camera = scene.light, scene.camera
    if light.shadow == 0.0:
        return np.float32(1.0)
    width, height = camera.size
    swing = np.sin(2.0 * np.pi * t / light.shadow_period)
    along = np.add.outer(0.35 * np.arange(height), np.arange(width)).astype(np.float32)
    edge = camera.centre[0] + 0.35 * camera.centre[1] + (0.7 * swing - 0.3) * camera.radius
    within = np.clip((along - np.float32(edge)) / np.float32(_PENUMBRA) + np.float32(0.5), 0.0, 1.0)
    within *= np.clip(
        (np.float32(edge + 0.8 * camera.radius) - along) / np.float32(_PENUMBRA) + np.float32(0.5), 0.0, 1.0
    )
    return np.float32(1.0) - np.float32(light.shadow) * within


def _background(scene: Scene, view: View) -> NDArray[np.float32]:
    """Return a table top with the robot's plate, three wheels and some clutter."""
    width, height = scene.camera.size
    picture = np.empty((height, width, 3), np.float32)
    picture[:] = _linear((168, 160, 150))
    centre, radius = (round(view.x), round(view.y)), view.radius
    _disc(picture, centre, 1.32 * radius, (120, 122, 126))
    for azimuth in np.radians([20.0, 140.0, 260.0]):
        place = np.array(centre) + 1.12 * radius * np.array([np.cos(azimuth), np.sin(azimuth)])
        box = (
            (float(place[0]), float(place[1])),
            (0.5 * radius, 0.2 * radius),
            float(np.degrees(azimuth)) + 90.0,
        )
        cv2.fillPoly(picture, [cv2.boxPoints(box).astype(np.int32)], _linear((40, 40, 44)).tolist())
        _disc(picture, (round(place[0]), round(place[1])), 0.05 * radius, (150, 60, 50))
    cv2.line(picture, (0, height // 5), (width, height // 8), _linear((90, 110, 150)).tolist(), 3)
    return picture


def _disc(picture: NDArray[np.float32], centre: tuple[int, int], radius: float, colour: Colour) -> None:
    cv2.circle(picture, centre, round(radius), _linear(colour).tolist(), -1)


def _linear(colour: Colour) -> NDArray[np.float32]:
    return ((np.array(colour[::-1]) / 255.0) ** _GAMMA).astype(np.float32)


def _distances(seam: Seam) -> NDArray[np.float32]:
    chord = KDTree(seam.points).query(cell_directions(_SIDE))[0]
    return (2.0 * np.arcsin(0.5 * chord)).astype(np.float32).reshape(_SIDE, _SIDE)


def _sampled(table: NDArray[np.float32], q: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the table's values (k,), interpolated, at directions (k, 3)."""
    u, v = octahedral(q)
    half = np.float32(0.5 * _SIDE)
    # OpenCV's maps have at most 32767 rows
    shape = (-1, 512)
    spare = -len(u) % shape[1]
    column = np.pad(u * half + (half - np.float32(0.5)), (0, spare)).reshape(shape)
    row = np.pad(v * half + (half - np.float32(0.5)), (0, spare)).reshape(shape)
    values = cv2.remap(table, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(values, np.float32).ravel()[: len(u)]
