"""Motion capture of a run: the ball's centre and the body's orientation, in the cameras' frame and time.

    t_camera = (1 + clock_rate) t + clock_offset
    p_camera = R_camera_world p + origin
    q_camera_body = q_camera_world q_world_body

The frame, the clock and the noise follow from a seed; the setup says what they were, so that whoever aligns
log and cameras can be told how well it was done. Where too few cameras see the robot there is nothing: NaN.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ballbot.errors import InputError
from ballbot.log import Log


@dataclass(frozen=True, kw_only=True)
class MotionCapture:
    """A motion-capture system: its rate, frame, clock and noise."""

    seed: int
    rate: float  #: [Hz]
    origin: tuple[float, float, float]  #: the world frame's origin in the cameras' frame [m]
    rotation_wxyz: tuple[float, float, float, float]  #: unit quaternion, world to cameras
    clock_offset: float  #: the cameras' time at the log's zero [s]
    clock_rate: float  #: how much faster the cameras' clock runs [s/s]
    position_noise: float  #: standard deviation of each coordinate [m]
    orientation_noise: float  #: standard deviation about each axis [rad]
    gap_rate: float = 0.0  #: how often the robot is lost from view [1/s]
    gap_duration: float = 0.3  #: for how long on the average [s]

    def __post_init__(self) -> None:
        for name, least in (("rate", "above 0 Hz"), ("gap_duration", "above 0 s")):
            if not getattr(self, name) > 0:
                raise InputError(
                    f"{name} of the motion capture is {getattr(self, name)}; it must be {least}."
                )
        if not self.gap_rate >= 0:
            raise InputError(f"gap_rate of the motion capture is {self.gap_rate}; it must be 0/s or more.")

    @staticmethod
    def drawn(seed: int) -> MotionCapture:
        """Return a system set up as chance will have it: 120 Hz, cameras somewhere, nearly level."""
        random = np.random.default_rng([seed, 120])  # not the stream of the twin with that seed
        tilt_x, tilt_y = random.normal(0.0, 0.01, 2)  # frame's tilt: N(0, 0.01 rad) about each level axis
        heading = random.uniform(-np.pi, np.pi)  # frame's heading: U(-pi, pi)
        rotation = Rotation.from_euler("XYZ", [tilt_x, tilt_y, heading])
        origin = random.uniform(-2.0, 2.0, 3)  # place: U(-2 m, 2 m) along each axis
        return MotionCapture(
            seed=seed,
            rate=120.0,
            origin=(float(origin[0]), float(origin[1]), float(origin[2])),
            rotation_wxyz=_wxyz(rotation),
            clock_offset=float(random.uniform(2.0, 6.0)),  # cameras started first: U(2 s, 6 s)
            clock_rate=float(random.normal(0.0, 2e-5)),  # two quartz clocks: N(0, 20 ppm)
            position_noise=2e-4,
            orientation_noise=1e-3,
        )

    def film(self, truth: Log, *, ball_radius: float) -> Log:
        """Return what the cameras record of a run.

        Parameters
        ----------
        truth : Log
            Needs t, x, y, theta, phi, psi as they were; between its samples they are taken as straight lines.
        ball_radius : float
            Height of the ball's centre above the floor [m].

        Returns
        -------
        Log
            t [s]; x y z [m], the ball's centre; qw qx qy qz, body to cameras' frame, without jumps of sign. NaN
            but for t where the robot is out of view.
        """
        truth.require("x", "y", "theta", "phi", "psi")
        start, end = float(truth.t[0]), float(truth.t[-1])
        t = start + np.arange(int((end - start) * self.rate) + 1) / self.rate
        pose = {name: np.interp(t, truth.t, truth[name]) for name in ("x", "y", "theta", "phi", "psi")}
        random = np.random.default_rng([self.seed, 121])
        w, *xyz = self.rotation_wxyz
        camera_world = Rotation.from_quat([*xyz, w])
        centers = np.column_stack((pose["x"], pose["y"], np.full(len(t), ball_radius)))
        centers = camera_world.apply(centers) + self.origin
        centers += self.position_noise * random.standard_normal(centers.shape)
        angles = np.column_stack((pose["theta"], pose["phi"], pose["psi"]))
        wobble = Rotation.from_rotvec(self.orientation_noise * random.standard_normal(centers.shape))
        quaternions = _continuous((camera_world * Rotation.from_euler("XYZ", angles) * wobble).as_quat())
        columns = {"t": (1.0 + self.clock_rate) * t + self.clock_offset}
        columns |= dict(zip("xyz", centers.T, strict=True))
        columns |= {name: quaternions[:, i] for name, i in (("qw", 3), ("qx", 0), ("qy", 1), ("qz", 2))}
        lost = self._lost(t)
        return Log(
            {
                name: values if name == "t" else np.where(lost, np.nan, values)
                for name, values in columns.items()
            }
        )

    def _lost(self, t: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return at which times (N,) the robot is out of view."""
        lost = np.zeros(len(t), dtype=bool)
        random = np.random.default_rng([self.seed, 122])
        begin = t[0]
        while self.gap_rate > 0 and begin <= t[-1]:
            begin += random.exponential(1.0 / self.gap_rate)  # from one loss to the next: Exp(gap_rate)
            lost |= (t >= begin) & (
                t < begin + random.exponential(self.gap_duration)
            )  # Exp(1 / gap_duration)
        return lost


def _wxyz(rotation: Rotation) -> tuple[float, float, float, float]:
    x, y, z, w = rotation.as_quat().tolist()
    return w, x, y, z


def _continuous(quaternions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return quaternions (N, 4) with the sign of each next to its predecessor's."""
    turned = np.where(np.sum(quaternions[1:] * quaternions[:-1], axis=1) < 0.0, -1.0, 1.0)
    return quaternions * np.concatenate(([1.0], np.cumprod(turned)))[:, None]
