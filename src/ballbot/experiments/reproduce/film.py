"""The ball on the upside-down twin, filmed and followed (Appendix V)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ballbot.experiments.reproduce.recordings import Logs
from ballbot.robot import Robot
from ballbot.vision.comparison import WheelComparison, compare_with_wheels
from ballbot.vision.rendering import MPEG4, Scene, motion_of, render, write_video
from ballbot.vision.seam_pixels import ball_pixels, seam_finder
from ballbot.vision.spin import Spin, facing, measure_spin
from ballbot.vision.video import open_video

#: where the robot's x points in the picture [rad]
_FORWARD = 0.4
#: the renderer's motion has so many rows a second
_ROWS = 1000.0


@dataclass(frozen=True, kw_only=True, eq=False)
class FilmedBall:
    """What the film told."""

    scene: Scene
    spin: Spin
    comparison: WheelComparison  #: with T_obw times the wheels' speeds
    row: int  #: the frame that is looked at
    frame: NDArray[np.uint8]  #: (height, width, 3), as OpenCV has it
    seen: NDArray[np.float64]  #: (k, 3) unit vectors, camera frame: where the seam's colour was seen
    curve: NDArray[np.float64]  #: (m, 3) the seam's curve, fitted
    distances: NDArray[np.float64]  #: (k,) of what was seen from the curve [rad]


def filmed_ball(robot: Robot, logs: Logs, *, path: Path, seed: int) -> FilmedBall:
    """Film the ball of a bench run with a real codec, follow its seam, and set it against the wheels.

    Parameters
    ----------
    robot : Robot
    logs : mapping
        "log" and "truth" of the ball on the clamped wheels.
    path : Path
        Of the film, .mp4.
    seed : int
        Of the camera's noise.
    """
    scene, truth = Scene(), logs["truth"]
    t = np.arange(0.0, truth.t[-1], 1.0 / _ROWS)
    omega = np.column_stack([np.interp(t, truth.t, truth[f"ball_omega_{axis}"]) for axis in "xyz"])
    motion = motion_of(t, omega @ facing(_FORWARD).as_matrix())
    rate = scene.camera.frame_rate
    duration = np.floor((t[-1] - 1.0 / rate) * rate) / rate
    path.parent.mkdir(parents=True, exist_ok=True)
    write_video(path, render(scene, motion, duration=duration, seed=seed), frame_rate=rate, codec=MPEG4)
    spin = measure_spin(open_video(path))
    comparison = compare_with_wheels(spin, logs["log"], robot)
    return _looked_at(scene, spin.turned(comparison.robot_camera), comparison)


def _looked_at(scene: Scene, spin: Spin, comparison: WheelComparison) -> FilmedBall:
    """Return the film's results with what was seen in its middle frame that was followed."""
    tracked = np.flatnonzero(spin.track.tracked)
    row = int(tracked[len(tracked) // 2])
    frame = next(frame for k, (_, frame) in enumerate(spin.video.frames()) if k == row)
    finder = seam_finder(ball_pixels(spin.view, spin.video.size), spin.colour)
    seen = np.asarray(finder.find(frame)[0].p, dtype=np.float64)
    curve = spin.seam.points @ spin.track.R[row].T
    # chords are as good as arcs at these distances
    distances, _ = KDTree(curve).query(seen)
    return FilmedBall(
        scene=scene,
        spin=spin,
        comparison=comparison,
        row=row,
        frame=frame,
        seen=seen,
        curve=curve,
        distances=np.asarray(distances, dtype=np.float64),
    )
