"""How a ball turns: angular velocity given, orientation integrated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """Angular velocity, linear between instants, and the orientation that follows."""

    t: NDArray[np.float64]  #: (n,) [s], increasing, close enough together that it hardly changes between two
    omega: NDArray[np.float64]  #: (n, 3) [rad/s], camera frame
    rotations: NDArray[np.float64]  #: (n, 3, 3) ball frame to camera frame

    def omega_at(self, t: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the angular velocity (k, 3) [rad/s] at times (k,)."""
        return np.column_stack([np.interp(t, self.t, column) for column in self.omega.T])

    def orientation(self, t: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the orientation (k, 3, 3), ball frame to camera frame, at times (k,)."""
        before = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.t) - 1)
        middle = self.omega_at(0.5 * (self.t[before] + t))
        rest = Rotation.from_rotvec(middle * (t - self.t[before])[:, None])
        return (rest * Rotation.from_matrix(self.rotations[before])).as_matrix()


def motion_of(t: NDArray[np.float64], omega: NDArray[np.float64], *, start: Rotation | None = None) -> Motion:
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


def wandering(*, duration: float, peak: float, seed: int, fastest: float = 1.0, rows: int = 1000) -> Motion:
    """Return a motion about all three axes by sums of sines, whose speed peaks at a value.

    Parameters
    ----------
    duration : float
        [s]
    peak : float
        Largest length of the angular velocity [rad/s].
    seed : int
        Of the sines and of the orientation at the start.
    fastest : float
        Highest frequency [Hz].
    rows : int
        A second.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(-0.1, duration + 0.1, 1.0 / rows)
    omega = np.zeros((len(t), 3))
    for axis in range(3):
        # five frequencies: U(0.05, fastest) Hz; sizes: U(0.3, 1); phases: U(0, 2 pi)
        f, size, phase = (
            rng.uniform(0.05, fastest, 5),
            rng.uniform(0.3, 1.0, 5),
            rng.uniform(0.0, 2 * np.pi, 5),
        )
        omega[:, axis] = np.sin(2 * np.pi * np.outer(t, f) + phase) @ size
    omega *= peak / np.linalg.norm(omega, axis=1).max()
    return motion_of(t, omega, start=Rotation.from_quat(rng.normal(size=4)))
