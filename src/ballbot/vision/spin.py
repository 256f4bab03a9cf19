"""The ball's angular velocity from a video of its seam (the thesis's Appendix V), and its comparison with the wheels.

Camera frame: x to the right of the picture, y down, z away from the camera. The camera looks down on the robot, which
lies upside down, so that its z is the robot's z, which points from the ball to the body. Robot and camera differ by a
rotation about z: `forward` is the angle of the robot's x in the picture, from its right, clockwise (and by
the camera's tilt).

The picture shows the ball's outline and the fitted seam drawn over frames.

Video and log are on clocks of their own, and the camera's orientation relative to the robot is unknown. Both are
estimated as for motion capture (`ballbot.identification.turning`), from the ball's rotation over half a second by
either.
The findings say how well the ball was tracked and whether the wheels agree with the video.
"""

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ballbot.arrays import Bools, Floats
from ballbot.errors import InputError
from ballbot.findings import Finding, note
from ballbot.identification.turning import Clock, MotionFit, Turning, fit_in_blocks, match_turning
from ballbot.log import Log
from ballbot.mechanics.geometry import transforms
from ballbot.progress import Progress, ProgressCallback, ignore_progress, in_stage
from ballbot.results import key, left_out, reported
from ballbot.robot import Robot
from ballbot.rounding import digits, percent, plus_minus
from ballbot.vision.calibration import calibrated_view
from ballbot.vision.seam import Seam, seam_table, thesis_seam
from ballbot.vision.seam_pixels import SeamColour, SeamFinder, ball_pixels, learn_colour
from ballbot.vision.tracking import Track, Velocity, angular_velocity, follow
from ballbot.vision.video import LEAST_FRAMES, Video, frame_times
from ballbot.vision.view import ASSUMED_CLOSENESS, View, circle_points, find_outline, view_of_outline


@dataclass(frozen=True, kw_only=True, eq=False)
class Spin:
    """The ball's motion measured from a video."""

    video: Video
    seam: Seam
    colour: SeamColour
    view: View  #: how the camera saw the ball
    t: Floats  #: (n,) of the frames [s]
    track: Track
    velocity: Velocity  #: camera frame
    robot_camera: (
        Rotation  #: camera frame to robot frame, by which `log` is turned; none until the wheels give it
    )

    @property
    def known(self) -> Bools:
        """Whether the velocity is known at each frame (n,)."""
        return np.isfinite(self.velocity.omega[:, 0])

    @property
    def omega(self) -> Floats:
        """The angular velocity (n, 3) [rad/s], robot frame; NaN where it is not known."""
        return self.velocity.omega @ self.robot_camera.as_matrix().T

    @property
    def errors(self) -> Floats:
        """The standard errors (n, 3) of `omega` [rad/s]."""
        R = self.robot_camera.as_matrix()
        return np.sqrt(np.einsum("ij,kjl,il->ki", R, self.velocity.covariance, R))

    @property
    def peak(self) -> float:
        """The largest length of `omega` [rad/s]."""
        return float(np.nanmax(np.linalg.norm(self.omega, axis=1)))

    def log(self) -> Log:
        """Return t, tracked (0 or 1), ball_omega_x .. z and their standard errors ball_omega_x_error .. z."""
        names = [f"ball_omega_{axis}" for axis in "xyz"]
        return Log(
            {"t": self.t, "tracked": self.track.tracked.astype(np.float64)}
            | dict(zip(names, self.omega.T, strict=True))
            | dict(zip((f"{name}_error" for name in names), self.errors.T, strict=True))
        )


def measure_spin(
    video: Video,
    *,
    seam: Seam | None = None,
    circle: tuple[float, float, float] | None = None,
    progress: ProgressCallback = ignore_progress,
) -> Spin:
    """Return the angular velocity of the ball in a video, camera frame.

    The seam is the thesis's by default. The `circle` x, y, radius of the ball's outline [pixels] is found if it is not
    given. InputError if no ball or no seam is found, the circle is impossible, the seam is not of that kind, or it is
    not tracked long enough.
    """
    seam = seam or thesis_seam()
    progress(Progress(stage="looking"))
    samples = video.samples()
    points = find_outline(samples) if circle is None else circle_points(circle, video.size)
    view = view_of_outline(points, size=video.size, closeness=ASSUMED_CLOSENESS)
    pixels = ball_pixels(view, video.size)
    colour = learn_colour([pixels.box(frame) for frame in samples], pixels.inside, radius=view.radius)
    table = seam_table(seam)
    calibrating = in_stage(progress, "calibrating")
    view = calibrated_view(video, view, points, colour=colour, table=table, progress=calibrating)
    finder = SeamFinder(pixels=ball_pixels(view, video.size), colour=colour)
    track = follow(video.frames(), finder, table, frame_count=video.stated_frames, progress=progress)
    t = frame_times(track.stated, video)
    velocity = angular_velocity(t, track)
    if not np.isfinite(velocity.omega).any():
        raise InputError(
            f"{video.path}: the seam was never tracked for {LEAST_FRAMES} successive frames, which "
            "a velocity needs; the ball may turn too fast for the frame rate, or be covered."
        )
    return Spin(
        video=video, seam=seam, colour=colour, view=view, t=t, track=track, velocity=velocity,
        robot_camera=Rotation.identity(),
    )  # fmt: skip


#: frames shown, and their width [pixels]
_SHOWN, _WIDTH = 6, 360
_SEAM, _OUTLINE, _LOST = (255, 0, 255), (0, 255, 0), (0, 0, 255)


def overlay(spin: Spin) -> bytes:
    """Return a PNG of six frames, spread evenly, with outline and seam drawn; lost frames have a red border."""
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
    """Return the ball's surroundings in a frame, enlarged to a common width, with outline and seam drawn over."""
    view = spin.view
    reach = 1.15 * view.radius
    corner = np.array([view.x - reach, view.y - reach])
    factor = 0.5 * _WIDTH / reach
    enlarged = np.column_stack([factor * np.eye(2), (0.5 - corner) * factor - 0.5])
    picture = np.asarray(
        cv2.warpAffine(frame, enlarged, (_WIDTH, _WIDTH), borderValue=(255, 255, 255)), np.uint8
    )
    _line(picture, (view.outline() - corner + 0.5) * factor - 0.5, _OUTLINE, closed=True)
    if spin.track.tracked[row]:
        for curve in spin.seam.curves:
            points, facing = view.project(curve[::8] @ spin.track.R[row].T)
            for part in np.split(np.arange(len(points)), np.flatnonzero(np.diff(facing > 0.0)) + 1):
                if facing[part[0]] > 0.0:
                    _line(picture, (points[part] - corner + 0.5) * factor - 0.5, _SEAM, closed=False)
    else:
        cv2.rectangle(picture, (0, 0), (_WIDTH - 1, _WIDTH - 1), _LOST, 4)
    # black with a white rim reads on any frame
    for colour, thickness in (((255, 255, 255), 6), ((0, 0, 0), 2)):
        origin, font = (8, _WIDTH - 12), cv2.FONT_HERSHEY_SIMPLEX
        cv2.putText(picture, f"{spin.t[row]:.2f} s", origin, font, 1.1, colour, thickness, cv2.LINE_AA)
    return picture


def _line(picture: NDArray[np.uint8], points: Floats, colour: tuple[int, int, int], *, closed: bool) -> None:
    fine = np.round(points * 16.0).astype(np.int32)[:, None]  # sixteenths of a pixel
    cv2.polylines(picture, [fine], closed, colour, 1, cv2.LINE_AA, 4)


#: fraction of the rotation that video and log must share to be of the same run
_LEAST_SHARE = 0.8


@dataclass(frozen=True, kw_only=True, eq=False)
class WheelComparison:
    """Video against wheels, on the video's rows."""

    #: the clock, t_video = offset + (1 + rate) t_log, and `body_marker`, camera frame to robot frame
    motion: MotionFit = field(metadata=left_out)
    #: (n, 3) T_obw times wheel speeds [rad/s], robot frame; NaN outside the log
    wheels: Floats = field(metadata=left_out)
    difference: Floats = field(metadata=left_out)  #: (n, 3) video less wheels [rad/s]
    rms: Floats = field(metadata=key("rms_difference"))  #: (3,) of that
    peak: float  #: largest length of `wheels` [rad/s]
    gain: Floats  #: (3,) video over wheels about each axis
    gain_half_width: Floats  #: (3,) 95 %, by blocks of time

    @reported
    def rms_difference_of_peak(self) -> float:
        """The RMS length of the difference over the peak."""
        return float(np.linalg.norm(self.rms)) / self.peak

    @reported
    def forward(self) -> float:
        """The angle of the robot's x in the picture, from its right, clockwise [rad]."""
        R = self.motion.body_marker.as_matrix()
        return float(np.arctan2(R[0, 1] - R[1, 0], R[0, 0] + R[1, 1]))

    @reported
    def camera_tilt(self) -> float:
        """The angle between the camera's axis and the robot's z [rad]."""
        return float(np.arccos(np.clip(self.motion.body_marker.as_matrix()[2, 2], -1.0, 1.0)))


def compare_with_wheels(spin: Spin, log: Log, robot: Robot) -> WheelComparison:
    """Compare the ball's velocity by video, camera frame, with that by a log's wheel speeds.

    The log is of the clamped robot in the same run. InputError if log and video overlap too little, or show different
    motions.
    """
    speeds = log.wheel_speeds
    if speeds.shape[1] != robot.wheel_count:
        raise InputError(
            f"The log has the speeds of {speeds.shape[1]} wheels; {robot.name} has {robot.wheel_count} wheels."
        )
    by_wheels = speeds @ transforms(robot).T_obw.T
    logged, seen = Turning.of_rates(log.t, by_wheels), Turning.of_rates(spin.t, spin.velocity.omega)
    motion, _ = match_turning(logged, seen, least_share=_LEAST_SHARE)
    at = motion.clock.to_log(spin.t)
    inside = (at >= log.t[0]) & (at <= log.t[-1])
    wheels = np.column_stack([np.interp(at, log.t, column) for column in by_wheels.T])
    wheels = np.where(inside[:, None], wheels, np.nan)
    by_video = spin.velocity.omega @ motion.body_marker.as_matrix().T
    difference = by_video - wheels
    both = np.isfinite(difference).all(axis=1)
    gains = [
        fit_in_blocks(wheels[both, axis, None, None], by_video[both, axis, None], spin.t[both])
        for axis in range(3)
    ]
    return WheelComparison(
        motion=motion,
        wheels=wheels,
        difference=difference,
        rms=np.sqrt(np.mean(difference[both] ** 2, axis=0)),
        peak=float(np.linalg.norm(wheels[both], axis=1).max()),
        gain=np.array([gain[0] for gain, _ in gains]),
        gain_half_width=np.array([half[0] for _, half in gains]),
    )


def log_with_spin(log: Log, spin: Spin, clock: Clock) -> Log:
    """Return a log with ball_omega_x .. z on its own rows, robot frame; NaN where the ball is not tracked."""
    t = clock.to_cameras(log.t)
    known = spin.known
    after = np.clip(np.searchsorted(spin.t, t), 1, len(spin.t) - 1)
    near = known[after] & known[after - 1] & (t >= spin.t[0]) & (t <= spin.t[-1])
    omega = np.where(known[:, None], spin.omega, 0.0)
    columns = {
        f"ball_omega_{name}": np.where(near, np.interp(t, spin.t, omega[:, axis]), np.nan)
        for axis, name in enumerate("xyz")
    }
    return log.with_columns(columns)


#: median quality up to which the seam may be of another kind
_POOR = 0.85
#: largest number of intervals of lost frames that are named
_NAMED = 3


def spin_findings(spin: Spin, comparison: WheelComparison) -> tuple[Finding, ...]:
    """Return the findings on velocity, tracking, the seam and the agreement with the wheels."""
    typical = ", ".join(digits(value, 2) for value in np.median(spin.errors[spin.known], axis=0))
    words = [
        f"The ball turned at up to {digits(spin.peak)} rad/s; the standard error of its velocity about x, y, z is "
        f"{typical} rad/s (median).",
        tracking_words(spin),
    ]
    quality = float(np.median(spin.track.quality[spin.track.tracked]))
    if quality <= _POOR:
        words.append(
            f"The seam fits the curve {spin.seam.name!r} poorly, by {percent(quality)} in the "
            "median frame: it may be of another kind (--seam), and the velocity may be wrong."
        )
    off = np.abs(comparison.gain - 1.0) > np.maximum(2.0 * comparison.gain_half_width, 0.02)
    gains = ", ".join(map(plus_minus, comparison.gain, comparison.gain_half_width))
    words.append(
        f"Video and T_obw times wheel speeds {'do not match' if off.any() else 'match'}: they differ by "
        f"{percent(comparison.rms_difference_of_peak)} of the peak (RMS), and video is {gains} times the wheels "
        "about x, y, z."
    )
    return tuple(note("spin", sentence) for sentence in words)


def tracking_words(spin: Spin) -> str:
    """Return how long the seam was tracked, and where it was lost."""
    whole = f"{spin.t[-1] - spin.t[0]:.1f} s ({len(spin.t)} frames)"
    lost = ~spin.track.tracked
    if not lost.any():
        return f"The seam was tracked throughout, {whole}."
    edges = np.flatnonzero(np.diff(np.concatenate([[False], lost, [False]]))).reshape(-1, 2)
    spans = [f"{spin.t[first]:.2f} to {spin.t[end - 1]:.2f} s" for first, end in edges]
    named = ", ".join(spans[:_NAMED]) + (f" and {len(spans) - _NAMED} more" if len(spans) > _NAMED else "")
    return f"Of {whole} the seam was lost in {lost.sum()} frames: {named}."
