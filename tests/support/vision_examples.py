"""Small, short videos: of a ball that turns, and of a body that swings as a known pendulum."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp
from scipy.signal import lfilter

from ballbot.arrays import Floats
from ballbot.vision.spin import Spin
from tests.support.ball_video import Camera, Motion, Scene, render, wandering, write_video

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


def ball_video(path: Path, scene: Scene, *, duration: float, codec: str = "HFYU") -> Film:
    """Write the video of a ball that wanders at up to 10 rad/s and return it."""
    motion = wandering(duration=duration, peak=10.0, seed=3)
    frames = render(scene, motion, duration=duration)
    write_video(path, frames, frame_rate=scene.camera.frame_rate, codec=codec)
    return Film(path=path, motion=motion, scene=scene)


def pendulum(
    t: Floats, *, stiffness: float, viscous: float = 0.0, dry: float = 0.0, amplitude: float
) -> tuple[Floats, Floats]:
    """Return angle and rate (n,) of a pendulum let go at `amplitude`, half swing by half swing to 1e-10.

    angle'' = -stiffness sin(angle) - viscous angle' - dry sgn(angle'), at rest where gravity cannot overcome dry.
    """
    angles, rates = np.empty_like(t), np.zeros_like(t)
    start, angle = float(t[0]), amplitude
    while True:
        rows = t >= start
        if stiffness * abs(np.sin(angle)) <= dry:
            angles[rows], rates[rows] = angle, 0.0
            return angles, rates
        sign = -np.sign(angle)

        def slope(_: float, y: Floats, sign: float = sign) -> list[float]:
            return [y[1], -stiffness * np.sin(y[0]) - viscous * y[1] - dry * sign]

        def turns(_: float, y: Floats) -> float:
            return y[1]

        turns.terminal, turns.direction = True, -sign  # pyright: ignore[reportFunctionMemberAccess]
        # a shove of the rate's own size of rounding, so that the turn at the start is not found again
        span, begin = (start, t[-1] + 1.0), [angle, 1e-9 * sign]
        run = solve_ivp(
            slope, span, begin, method="DOP853", events=turns, rtol=1e-10, atol=1e-12, dense_output=True
        )
        ends = run.t[-1]
        now = rows & (t <= ends)
        angles[now], rates[now] = run.sol(t[now])
        if ends >= t[-1]:
            return angles, rates
        start, angle = float(ends), float(run.y[0, -1])


def sensor_noise(count: int, *, deviation: float, seed: int, memory: float = 0.0) -> Floats:
    """Return noise (count,) N(0, deviation), each value `memory` times the one before and something new."""
    white = np.random.default_rng(seed).standard_normal(count)
    return deviation * np.asarray(lfilter([np.sqrt(1.0 - memory**2)], [1.0, -memory], white))
