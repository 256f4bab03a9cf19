"""Test videos of a ball that turns in a known way, from any motion, with the disturbances of real ones.

The motion is given by its angular velocity, and its orientation integrated. Light is added up in linear intensities
over the exposure and over points within each pixel, then blurred by the lens, encoded with a gamma of 2.2, and noise
is added. The seam's cover of a pixel comes from the distance to the curve, from a map of its own: the tracker's table
takes no part. Videos are written with a real codec.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import chain
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from ballbot.arrays import Floats
from ballbot.vision.seam import Seam, cell_directions, octahedral, thesis_seam
from ballbot.vision.view import View


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """Angular velocity, linear between instants, and the orientation that follows."""

    t: Floats  #: (n,) [s], increasing, close enough together that it hardly changes between two
    omega: Floats  #: (n, 3) [rad/s], camera frame
    rotations: Floats  #: (n, 3, 3) ball frame to camera frame

    def omega_at(self, t: Floats) -> Floats:
        """Return the angular velocity (k, 3) [rad/s] at times (k,)."""
        return np.column_stack([np.interp(t, self.t, column) for column in self.omega.T])

    def orientation(self, t: Floats) -> Floats:
        """Return the orientation (k, 3, 3), ball frame to camera frame, at times (k,)."""
        before = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.t) - 1)
        middle = self.omega_at(0.5 * (self.t[before] + t))
        rest = Rotation.from_rotvec(middle * (t - self.t[before])[:, None])
        return (rest * Rotation.from_matrix(self.rotations[before])).as_matrix()


def motion_of(t: Floats, omega: Floats, *, start: Rotation | None = None) -> Motion:
    """Return the motion with an angular velocity (n, 3) [rad/s], camera frame, at times (n,) [s].

    Over a step the mean of its ends is taken, which errs by (w x dw) dt^2 / 12: steps of a millisecond give 1e-8 rad.
    """
    steps = Rotation.from_rotvec(0.5 * (omega[1:] + omega[:-1]) * np.diff(t)[:, None])
    turned = Rotation.concatenate([start or Rotation.identity(), steps])
    reach = 1
    while reach < len(t):  # each row becomes the product of twice as many steps
        turned = Rotation.concatenate([turned[:reach], turned[reach:] * turned[:-reach]])
        reach *= 2
    return Motion(t=t, omega=omega, rotations=turned.as_matrix())


def wandering(*, duration: float, peak: float, seed: int) -> Motion:
    """Return a motion about all three axes by sums of sines up to 1 Hz, whose speed peaks at `peak` [rad/s].

    It lasts `duration` [s]; the seed is that of the sines and of the first orientation.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(-0.1, duration + 0.1, 1e-3)
    omega = np.zeros((len(t), 3))
    for axis in range(3):
        # five frequencies: U(0.05, 1) Hz; sizes: U(0.3, 1); phases: U(0, 2 pi)
        f, size, phase = (rng.uniform(*ends, 5) for ends in ((0.05, 1.0), (0.3, 1.0), (0.0, 2 * np.pi)))
        omega[:, axis] = np.sin(2 * np.pi * np.outer(t, f) + phase) @ size
    omega *= peak / np.linalg.norm(omega, axis=1).max()
    return motion_of(t, omega, start=Rotation.from_quat(rng.normal(size=4)))


#: red, green, blue, 0 to 255, as a picture has them
Colour = tuple[int, int, int]


@dataclass(frozen=True, kw_only=True)
class Light:
    """How the scene is lit."""

    uneven: float = 0.0  #: how much darker the far corner is, as a fraction of the light
    highlight: float = 0.0  #: height of the lamp's reflection on the ball, as a fraction of full white
    #: fraction of the light that a shadow with a sharp edge takes; it moves over the ball and back
    shadow: float = 0.0
    shadow_period: float = 7.0  #: of that [s]


@dataclass(frozen=True, kw_only=True)
class Camera:
    """The camera, and what it spoils."""

    size: tuple[int, int] = (480, 360)  #: width and height [pixels]
    frame_rate: float = 60.0  #: [Hz]
    distance: float = 7.0  #: from the lens to the ball's centre [ball radii]
    centre: tuple[float, float] = (246.0, 172.0)  #: of the ball in the picture [pixels]
    radius: float = 135.0  #: of the ball, as `View` has it [pixels]
    exposure: float = 0.05  #: fraction of the time between frames in which light is gathered: motion blur
    blur: float = 0.6  #: of the lens, standard deviation [pixels]
    noise: float = 1.0  #: standard deviation [grey levels of 255]


@dataclass(frozen=True, kw_only=True)
class Scene:
    """A ball, its light and the camera."""

    seam: Seam = field(default_factory=thesis_seam)
    seam_width: float = 0.07  #: [ball radii]
    seam_colour: Colour = (225, 190, 40)
    ball_colour: Colour = (62, 70, 92)
    light: Light = Light()
    camera: Camera = Camera()


_GAMMA = 2.2
#: cells along a side of the map of distances, one about 0.003 rad
_SIDE = 1024
#: up to which the map tells distances apart [ball radii]
_FAR = 0.15
#: points of a pixel and instants of an exposure: a sharp frame takes few
_SAMPLES_STILL, _SAMPLES_MOVING = 4, 10
#: an exposure below this fraction is still
_STILL = 0.2
#: darkest that the ball's shading gets at its rim, as a fraction
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
    (x, y), (width, height) = camera.centre, camera.size
    middle = (0.5 * (width - 1), 0.5 * (height - 1))
    return View(x=x, y=y, radius=camera.radius, closeness=1.0 / camera.distance, middle=middle)


def render(scene: Scene, motion: Motion, *, duration: float) -> Iterator[NDArray[np.uint8]]:
    """Yield the frames (height, width, 3) uint8, as OpenCV has them, of `duration` seconds.

    The k-th is the light of the exposure whose middle is at k / frame_rate.
    """
    camera = scene.camera
    canvas = _canvas(scene)
    count = len(canvas.rays)
    cv2.setRNGSeed(0)
    order = np.random.default_rng(0).permutation(count)  # places within a pixel must not go with instants
    for frame in range(round(duration * camera.frame_rate)):
        middle = frame / camera.frame_rate
        within = (np.arange(count) + 0.5) / count - 0.5
        instants = middle + within[order] * camera.exposure / camera.frame_rate
        yield _frame(scene, canvas, motion.orientation(instants), middle)


def _frame(scene: Scene, canvas: _Canvas, R: Floats, t: float) -> NDArray[np.uint8]:
    seam, ball = _linear(scene.seam_colour), _linear(scene.ball_colour)
    rows, columns = canvas.shading.shape
    share, seamed = np.zeros((2, rows, columns), np.float32)  # of the pixel that is ball, and that is seam
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
    if scene.camera.blur > 0.0:
        picture = np.asarray(cv2.GaussianBlur(picture, (0, 0), scene.camera.blur), np.float32)
    encoded = canvas.encode[np.clip(picture * 4095.0, 0.0, 4095.0).astype(np.uint16)]
    if scene.camera.noise > 0.0:
        deviation = np.full((4, 1), scene.camera.noise)
        noise = cv2.randn(np.empty(encoded.shape, np.int16), np.zeros((4, 1)), deviation)
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
    across = np.add.outer(np.linspace(0.0, 0.6, height), np.linspace(0.0, 0.4, width))
    return _Canvas(
        corner=(left, top),
        rays=rays,
        covered=covered,
        light=(1.0 - scene.light.uneven * across).astype(np.float32),
        shading=shading.reshape(grid.shape[:2]).astype(np.float32),
        highlight=highlight.reshape(grid.shape[:2]).astype(np.float32),
        background=_background(scene, view),
        distances=_distances(scene.seam),
        encode=np.round(255.0 * (np.arange(4096) / 4095.0) ** (1.0 / _GAMMA)).astype(np.uint8),
    )


def _offsets(count: int) -> Floats:
    """Return places (count, 2) within a pixel, spread evenly: the plastic number's sequence."""
    k = np.arange(count)[:, None] + 0.5
    places = (k * np.array([0.7548776662466927, 0.5698402909980532])) % 1.0
    return places - places.mean(axis=0)


def _shadow(scene: Scene, t: float) -> NDArray[np.float32] | np.float32:
    """Return the fraction of light (height, width) left by a shadow: a slanting band that moves across the ball."""
    light, camera = scene.light, scene.camera
    if light.shadow == 0.0:
        return np.float32(1.0)
    width, height = camera.size
    swing = np.sin(2.0 * np.pi * t / light.shadow_period)
    along = np.add.outer(0.35 * np.arange(height), np.arange(width)).astype(np.float32)
    edge = camera.centre[0] + 0.35 * camera.centre[1] + (0.7 * swing - 0.3) * camera.radius
    before, after = along - np.float32(edge), np.float32(edge + 0.8 * camera.radius) - along
    within = [np.clip(away / np.float32(_PENUMBRA) + np.float32(0.5), 0.0, 1.0) for away in (before, after)]
    return np.float32(1.0) - np.float32(light.shadow) * (within[0] * within[1])


def _background(scene: Scene, view: View) -> NDArray[np.float32]:
    """Return a table top with the robot's plate, three wheels and some clutter."""
    width, height = scene.camera.size
    picture = np.empty((height, width, 3), np.float32)
    picture[:] = _linear((168, 160, 150))
    centre, radius = (round(view.x), round(view.y)), view.radius
    _disc(picture, centre, 1.32 * radius, (120, 122, 126))
    for azimuth in np.radians([20.0, 140.0, 260.0]):
        place = np.array(centre) + 1.12 * radius * np.array([np.cos(azimuth), np.sin(azimuth)])
        box = (tuple(place.tolist()), (0.5 * radius, 0.2 * radius), float(np.degrees(azimuth)) + 90.0)
        cv2.fillPoly(picture, [cv2.boxPoints(box).astype(np.int32)], _linear((40, 40, 44)).tolist())
        _disc(picture, (round(place[0]), round(place[1])), 0.05 * radius, (150, 60, 50))
    cv2.line(picture, (0, height // 5), (width, height // 8), _linear((90, 110, 150)).tolist(), 3)
    return picture


def _disc(picture: NDArray[np.float32], centre: tuple[int, int], radius: float, colour: Colour) -> None:
    cv2.circle(picture, centre, round(radius), _linear(colour).tolist(), -1)


def _linear(colour: Colour) -> NDArray[np.float32]:
    return ((np.array(colour[::-1]) / 255.0) ** _GAMMA).astype(np.float32)


@lru_cache(maxsize=4)  # a second each
def _distances(seam: Seam) -> NDArray[np.float32]:
    # farther than half of any seam's width it does not matter how far
    chord = KDTree(seam.points).query(cell_directions(_SIDE), distance_upper_bound=_FAR)[0]
    return (2.0 * np.arcsin(0.5 * np.minimum(chord, _FAR))).astype(np.float32).reshape(_SIDE, _SIDE)


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


#: fourcc by suffix: lossless, and the two lossy codecs that every build of OpenCV can write
LOSSLESS, MPEG4, MOTION_JPEG = "HFYU", "mp4v", "MJPG"


def write_video(
    path: str | Path, frames: Iterable[NDArray[np.uint8]], *, frame_rate: float, codec: str = LOSSLESS
) -> None:
    """Write frames (height, width, 3) as a video: .mp4 for mp4v, else .avi."""
    frames = iter(frames)
    first = next(frames)
    height, width, _ = first.shape
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*codec), frame_rate, (width, height))
    assert writer.isOpened(), f"{path} cannot be written with the codec {codec}"
    for frame in chain([first], frames):
        writer.write(frame)
    writer.release()
