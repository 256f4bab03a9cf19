"""Measure the ball's velocity from rendered videos of a minute with a known rotation.

.venv/bin/python -m campaigns.evidence spin
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time

import cv2
import numpy as np

from ballbot.processes import worker_pool
from ballbot.vision.seam import basketball_seam, seam_named
from ballbot.vision.spin import measure_spin
from ballbot.vision.video import open_video
from campaigns.section import Section
from tests.support.ball_video import (
    LOSSLESS,
    MOTION_JPEG,
    MPEG4,
    Camera,
    Light,
    Scene,
    render,
    wandering,
    write_video,
)

MINUTE = 60.0  # [s]
PEAK = 10.0  # [rad/s]

#: a small picture, for rendering takes most of the time: a ball of 76 pixels radius
CAMERA = Camera(size=(240, 180), centre=(124.0, 87.0), radius=76.0)


@dataclass(frozen=True, kw_only=True)
class Kind:
    """A kind of video."""

    scene: Scene
    codec: str = LOSSLESS
    duration: float = MINUTE


@dataclass(frozen=True, kw_only=True)
class Score:
    """How well the ball of a video was followed."""

    peak: float  #: of the true velocity's length [rad/s]
    error: float  #: rms length of the velocity's error, as a share of the peak
    claimed: float  #: the same by the standard errors that were given
    inside: float  #: share of components within two standard errors
    tracked: float  #: share of the frames
    stretches: int
    frames_per_second: float  #: of one core's time, all included


BASKETBALL = Scene(
    camera=CAMERA,
    seam=basketball_seam(),
    seam_width=0.05,
    seam_colour=(30, 28, 28),
    ball_colour=(200, 98, 40),
)
TENNIS = Scene(
    camera=CAMERA,
    seam=seam_named("tennis"),
    seam_width=0.09,
    seam_colour=(235, 235, 225),
    ball_colour=(190, 205, 60),
)
#: what each is for is in its name
KINDS: Mapping[str, Kind] = {
    "plain": Kind(scene=Scene(camera=CAMERA)),
    "noise, 12 grey levels": Kind(scene=Scene(camera=replace(CAMERA, noise=12.0))),
    "blur: lens 1.5 pixels, exposure half the frame": Kind(
        scene=Scene(camera=replace(CAMERA, blur=1.5, exposure=0.5))
    ),
    "uneven light and a highlight": Kind(scene=Scene(camera=CAMERA, light=Light(uneven=0.6, highlight=0.5))),
    "shadow that moves and takes 60 %": Kind(scene=Scene(camera=CAMERA, light=Light(shadow=0.6))),
    "compressed, MPEG-4": Kind(scene=Scene(camera=CAMERA), codec=MPEG4),
    "compressed, Motion JPEG": Kind(scene=Scene(camera=CAMERA), codec=MOTION_JPEG),
    "at the side of a near camera's picture": Kind(
        scene=Scene(camera=replace(CAMERA, size=(360, 280), centre=(84.0, 82.0), distance=4.0))
    ),
    "basketball": Kind(scene=BASKETBALL),
    "tennis ball": Kind(scene=TENNIS),
    "all of it at once, MPEG-4": Kind(
        scene=Scene(
            camera=replace(CAMERA, noise=5.0, blur=1.0, exposure=0.5),
            light=Light(uneven=0.4, shadow=0.5, highlight=0.4),
        ),
        codec=MPEG4,
    ),
    "plain, 1920 x 1080, 10 s, MPEG-4": Kind(
        scene=Scene(camera=replace(CAMERA, size=(1920, 1080), centre=(950.0, 545.0), radius=400.0)),
        codec=MPEG4,
        duration=10.0,
    ),
}


def score(kind: Kind, *, seed: int, duration: float | None = None) -> Score:
    """Return how well the ball of one rendered video is followed."""
    cv2.setNumThreads(1)
    length = duration or kind.duration
    motion = wandering(duration=length, peak=PEAK, seed=seed)
    with TemporaryDirectory() as folder:
        path = Path(folder) / ("video.mp4" if kind.codec == MPEG4 else "video.avi")
        rate = kind.scene.camera.frame_rate
        write_video(path, render(kind.scene, motion, duration=length), frame_rate=rate, codec=kind.codec)
        started = process_time()
        spin = measure_spin(open_video(path), seam=kind.scene.seam)
        seconds = process_time() - started
    true = motion.omega_at(spin.t)
    known = spin.known
    off, errors = (spin.velocity.omega - true)[known], spin.errors[known]
    peak = float(np.linalg.norm(true, axis=1).max())
    return Score(
        peak=peak,
        error=float(np.sqrt(np.mean(np.sum(off**2, axis=1)))) / peak,
        claimed=float(np.sqrt(np.mean(np.sum(errors**2, axis=1)))) / peak,
        inside=float(np.mean(np.abs(off) < 2.0 * errors)),
        tracked=float(np.mean(spin.track.tracked)),
        stretches=int(spin.track.stretch.max()) + 1,
        frames_per_second=len(spin.t) / seconds,
    )


def campaign() -> Section:
    """Return the scores of all kinds."""
    with worker_pool(2) as pool:
        waiting = {
            name: pool.submit(score, kind, seed=21 + number)
            for number, (name, kind) in enumerate(KINDS.items())
        }
        scores = {name: future.result() for name, future in waiting.items()}
    rows = [
        [
            name,
            f"{score.peak:.1f}",
            f"**{100 * score.error:.2f}**",
            f"{100 * score.claimed:.2f}",
            f"{100 * score.inside:.0f} %",
            f"{100 * score.tracked:.1f} %",
            f"{score.stretches}",
            f"{score.frames_per_second:.0f}",
        ]
        for name, score in scores.items()
    ]
    return Section(
        title="The ball's velocity from video",
        before="Rendered videos of a minute, 60 frames a second, 240 x 180 pixels with a ball of 76 pixels radius "
        "unless stated; the ball turns about all three axes by sums of sines up to 1 Hz. Only the kind of seam is "
        "given: circle, colour and the camera's distance are found. The error is the RMS length of the velocity error "
        "in % of the peak, with targets of 2 on the plain video and 5 on the hard ones; the next columns are the "
        "error expected from the standard errors, and the fraction of components within two of them. The last column "
        "counts one core's time, including finding the ball and calibrating.",
        columns=(
            "video",
            "peak [rad/s]",
            "error [% of peak]",
            "claimed",
            "within 2 s.e.",
            "tracked",
            "stretches",
            "frames/s, one core",
        ),
        rows=rows,
        after="A share below 95 % within two standard errors means that these are too small, above that they are too "
        "large: they are for errors that change as the ball turns (light, blur, the view), which differ from video to "
        "video.",
    )
