"""The ball's angular velocity from a video of its seam, as in the thesis's Appendix V; a picture to check it by eye.

Camera frame: x to the right of the picture, y down, z away from the camera. The camera looks down on the robot that
lies upside down, so that its z is the robot's own z, which points from the ball to the body. Robot and camera
differ by a turn about z: `forward` is the angle of the robot's x in the picture, from its right, clockwise (and by
the camera's tilt).

The picture shows the ball's outline and the fitted seam drawn over frames.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ballbot.errors import InputError
from ballbot.log import Log
from ballbot.progress import Progress, ProgressCallback, ignore_progress, part_of
from ballbot.vision.calibration import Calibration, calibrated_view
from ballbot.vision.seam import Seam, seam_table, thesis_seam
from ballbot.vision.seam_pixels import SeamColour, ball_pixels, learn_colour, seam_finder
from ballbot.vision.tracking import Track, follow, orientation_search
from ballbot.vision.velocity import Velocity, angular_velocity
from ballbot.vision.video import LEAST_FRAMES, Video, frame_times
from ballbot.vision.view import (
    ASSUMED_CLOSENESS,
    View,
    check_distance,
    circle_points,
    find_outline,
    view_of_outline,
)


@dataclass(frozen=True, kw_only=True)
class Setup:
    """What is known of the recording; what is None is found."""

    seam: Seam | None = None  #: the thesis's where None
    colour: tuple[int, int, int] | None = None  #: the seam's, red green blue
    circle: tuple[float, float, float] | None = None  #: x, y, radius of the ball's outline [pixels]
    distance: float | None = None  #: from the lens to the ball's centre [ball radii]
    known_rate: bool = False  #: that the video's frame rate is the camera's, whatever times the file states


@dataclass(frozen=True, kw_only=True, eq=False)
class Spin:
    """What a video tells of its ball."""

    video: Video
    seam: Seam
    colour: SeamColour
    calibration: Calibration
    calibrated: bool  #: whether the seam told of the view, or the outline alone
    t: NDArray[np.float64]  #: (n,) of the frames [s]
    track: Track
    velocity: Velocity  #: camera frame
    robot_camera: Rotation  #: camera frame to robot frame, by which `log` is turned

    @property
    def view(self) -> View:
        """How the camera saw the ball."""
        return self.calibration.view

    @property
    def known(self) -> NDArray[np.bool_]:
        """At which frames (n,) there is a velocity."""
        return np.isfinite(self.velocity.omega[:, 0])

    @property
    def omega(self) -> NDArray[np.float64]:
        """The angular velocity (n, 3) [rad/s], robot frame; NaN where it is not known."""
        return self.velocity.omega @ self.robot_camera.as_matrix().T

    @property
    def errors(self) -> NDArray[np.float64]:
        """The standard errors (n, 3) of `omega` [rad/s]."""
        R = self.robot_camera.as_matrix()
        return np.sqrt(np.einsum("ij,kjl,il->ki", R, self.velocity.covariance, R))

    def log(self) -> Log:
        """Return t, tracked (0 or 1), ball_omega_x .. z and their standard errors ball_omega_x_error .. z."""
        columns = {"t": self.t, "tracked": self.track.tracked.astype(np.float64)}
        for axis, name in enumerate("xyz"):
            columns[f"ball_omega_{name}"] = self.omega[:, axis]
        for axis, name in enumerate("xyz"):
            columns[f"ball_omega_{name}_error"] = self.errors[:, axis]
        return Log(columns)

    def turned(self, robot_camera: Rotation) -> Spin:
        """Return the same with another rotation, camera frame to robot frame."""
        return replace(self, robot_camera=robot_camera)


def facing(forward: float) -> Rotation:
    """Return the rotation, camera frame to robot frame, of a robot whose x is at that angle in the picture [rad]."""
    return Rotation.from_rotvec([0.0, 0.0, -forward])


def measure_spin(
    video: Video, setup: Setup = Setup(), *, progress: ProgressCallback = ignore_progress
) -> Spin:
    """Return the angular velocity of the ball in a video, camera frame.

    Parameters
    ----------
    video : Video
        From `open_video`.
    setup : Setup
    progress : callable, optional
        Called with the stage and the share of the whole.

    Raises
    ------
    InputError
        Where no ball or no seam is found, the circle or the distance cannot be, the seam is not of that kind, or it is
        never followed long enough.
    """
    if setup.distance is not None:
        check_distance(setup.distance)
    seam = setup.seam or thesis_seam()
    progress(Progress(stage="looking", done=0.0, total=1.0))
    samples = video.samples()
    points = find_outline(samples) if setup.circle is None else circle_points(setup.circle, video.size)
    closeness = ASSUMED_CLOSENESS if setup.distance is None else 1.0 / setup.distance
    view = view_of_outline(points, size=video.size, closeness=closeness)
    pixels = ball_pixels(view, video.size)
    colour = learn_colour(
        [pixels.box(frame) for frame in samples], pixels.inside, radius=view.radius, colour=setup.colour
    )
    table = seam_table(seam)
    calibration = calibrated_view(
        video, points, closeness, samples, colour=colour, table=table, found=setup.circle is None,
        distance=setup.distance, progress=part_of(progress, 0.0, 0.1, stage="calibrating"),
    )  # fmt: skip
    calibrated = calibration is not None
    if calibration is None:
        calibration = Calibration(view=view, errors=np.full(4, np.nan))
    pixels = ball_pixels(calibration.view, video.size)
    stated: list[float] = []
    track = follow(
        _pictures(video, stated), seam_finder(pixels, colour), orientation_search(table, pixels),
        frame_count=video.stated_frames, progress=part_of(progress, 0.1, 1.0),
    )  # fmt: skip
    if not track.tracked.any():
        raise InputError(
            f"{video.path}: the seam was seen but never fits the curve {seam.name!r}; "
            "check the kind of seam (--seam) and the circle of the ball (--circle)."
        )
    t = frame_times(np.array(stated), frame_rate=video.frame_rate, known=setup.known_rate)
    return Spin(
        video=video, seam=seam, colour=colour, calibration=calibration, calibrated=calibrated, t=t, track=track,
        velocity=_velocity(video, t, track), robot_camera=facing(0.0),
    )  # fmt: skip


def _velocity(video: Video, t: NDArray[np.float64], track: Track) -> Velocity:
    velocity = angular_velocity(t, track)
    if not np.isfinite(velocity.omega).any():
        raise InputError(
            f"{video.path}: the seam was never tracked for {LEAST_FRAMES} successive frames, which "
            "a velocity needs; the ball may turn too fast for the frame rate, or be covered."
        )
    return velocity


def _pictures(video: Video, stated: list[float]) -> Iterator[NDArray[np.uint8]]:
    """Yield the pictures, and append their times."""
    for t, frame in video.frames():
        stated.append(t)
        yield frame


#: frames shown, and their width [pixels]
_SHOWN, _WIDTH = 6, 360
_SEAM, _OUTLINE, _LOST = (255, 0, 255), (0, 255, 0), (0, 0, 255)


def overlay(spin: Spin) -> bytes:
    """Return a PNG of six frames, spread evenly, outline and seam drawn over the ball; red about one that was lost."""
    wanted = set(np.linspace(0, len(spin.t) - 1, _SHOWN).astype(int).tolist())
    drawn = []
    for row, (_, frame) in enumerate(spin.video.frames()):
        if row in wanted:
            drawn.append(_drawn(spin, row, frame))
        if row >= max(wanted):
            break
    while len(drawn) % 3:
        drawn.append(np.full_like(drawn[0], 255))
    sheet = np.vstack([np.hstack(drawn[k : k + 3]) for k in range(0, len(drawn), 3)])
    return bytes(cv2.imencode(".png", sheet)[1])


def _drawn(spin: Spin, row: int, frame: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the ball's surroundings in a frame, enlarged to a common width, with what was found drawn over."""
    view = spin.view
    reach = 1.15 * view.radius
    height, width = frame.shape[:2]
    left, top = max(0, int(view.x - reach)), max(0, int(view.y - reach))
    right, bottom = min(width, int(view.x + reach) + 1), min(height, int(view.y + reach) + 1)
    factor = _WIDTH / max(right - left, bottom - top)
    cut = cv2.resize(frame[top:bottom, left:right], None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    picture = np.full((_WIDTH, _WIDTH, 3), 255, np.uint8)
    picture[: cut.shape[0], : cut.shape[1]] = cut[:_WIDTH, :_WIDTH]
    corner = np.array([left, top])
    _line(picture, (view.outline() - corner + 0.5) * factor - 0.5, _OUTLINE, closed=True)
    if spin.track.tracked[row]:
        for curve in spin.seam.curves:
            places, facing = view.project(curve[::8] @ spin.track.R[row].T)
            for part in np.split(np.arange(len(places)), np.flatnonzero(np.diff(facing > 0.0)) + 1):
                if facing[part[0]] > 0.0:
                    _line(picture, (places[part] - corner + 0.5) * factor - 0.5, _SEAM, closed=False)
    else:
        cv2.rectangle(picture, (0, 0), (_WIDTH - 1, _WIDTH - 1), _LOST, 4)
    cv2.putText(
        picture,
        f"{spin.t[row]:.2f} s",
        (8, _WIDTH - 10),
        cv2.FONT_HERSHEY_SIMPLEX,
        0.5,
        (0, 0, 0),
        1,
        cv2.LINE_AA,
    )
    return picture


def _line(
    picture: NDArray[np.uint8], places: NDArray[np.float64], colour: tuple[int, int, int], *, closed: bool
) -> None:
    fine = np.round(places * 16.0).astype(np.int32)[:, None]  # sixteenths of a pixel
    cv2.polylines(picture, [fine], closed, colour, 1, cv2.LINE_AA, 4)
