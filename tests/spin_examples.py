"""Videos of a turning ball that tests of `ballbot spin` share: small and short."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ballbot.vision.rendering import Camera, Motion, Scene, render, wandering, write_video
from ballbot.vision.spin import Spin

#: pictures of 200 x 160 pixels: a ball of 66 pixels radius is less than any camera would give
SMALL = Camera(size=(200, 160), centre=(104.0, 77.0), radius=66.0)


@dataclass(frozen=True, kw_only=True)
class Film:
    """A video and what is true of it."""

    path: Path
    motion: Motion
    scene: Scene

    def error(self, spin: Spin) -> float:
        """Return the rms length of the velocity's error over the peak of the velocity."""
        true = self.motion.omega_at(spin.t)
        off = np.sum((spin.velocity.omega - true) ** 2, axis=1)
        return float(np.sqrt(np.nanmean(off)) / np.linalg.norm(true, axis=1).max())


def film(
    path: Path, scene: Scene, *, duration: float, codec: str = "HFYU", peak: float = 10.0, seed: int = 3
) -> Film:
    """Write the video of a ball that wanders and return it."""
    motion = wandering(duration=duration, peak=peak, seed=seed)
    write_video(
        path, render(scene, motion, duration=duration), frame_rate=scene.camera.frame_rate, codec=codec
    )
    return Film(path=path, motion=motion, scene=scene)
