"""A run with known motion, log and cameras with known clocks, frames, flips and faults, to be aligned."""

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from ballbot.arrays import Floats
from ballbot.log import Log

_QUATERNION = ("qw", "qx", "qy", "qz")


@dataclass(frozen=True, kw_only=True)
class Setup:
    """What is true of a log and its motion capture."""

    seed: int = 0
    duration: float = 40.0
    offset: float = 3.0
    rate: float = 0.0
    camera_world: Rotation = field(default_factory=Rotation.identity)
    body_marker: Rotation = field(default_factory=Rotation.identity)
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    lever: tuple[float, float, float] = (0.0, 0.0, 0.0)  #: marker frame [m]
    heading_drift: float = 0.0  #: [rad/s]
    wheel_scale: float = 1.0  #: of the log's distances
    angle_delay: float = 0.0  #: of theta, phi, psi behind the gyro [s]
    noise: float = 1e-3  #: of the cameras' orientation [rad]
    spin: float = 0.0  #: mean rate of the heading [rad/s]
    period: float | None = None  #: after which the motion repeats itself [s]


class Run:
    """A motion that can be asked for at any time: sums of sines, drawn by a seed."""

    def __init__(self, setup: Setup) -> None:
        random = np.random.default_rng([setup.seed, 6])
        # sway 0.2 to 1.2 Hz, as a balancing robot's; amplitudes of 0.01 to 0.03 rad, 0.05 to 0.15 rad of heading
        self.frequency = random.uniform(0.2, 1.2, (5, 6))
        if setup.period is not None:
            self.frequency = np.ceil(self.frequency * setup.period) / setup.period
        self.phase = random.uniform(0.0, 2.0 * np.pi, (5, 6))
        size = np.array([0.1, 0.1, 0.02, 0.02, 0.1])[:, None]
        self.amplitude = size * random.uniform(0.5, 1.5, (5, 6))
        self.spin = setup.spin

    def pose(self, t: Floats) -> Floats:
        """Return x, y, theta, phi, psi (n, 5) at times (n,)."""
        swings = self.amplitude * np.sin(2.0 * np.pi * self.frequency * t[:, None, None] + self.phase)
        pose = swings.sum(axis=2)
        pose[:, 4] += self.spin * t
        return pose

    def gyro(self, t: Floats) -> Floats:
        """Return the body's angular velocity (n, 3) in its own frame, by central differences of rotations."""
        h = 1e-4
        before, after = (Rotation.from_euler("XYZ", self.pose(one)[:, 2:]) for one in (t - h, t + h))
        return (before.inv() * after).as_rotvec() / (2.0 * h)


def record(setup: Setup) -> tuple[Log, Log]:
    """Return the log, 200 Hz, and the motion capture, 120 Hz, of a run."""
    run, random = Run(setup), np.random.default_rng([setup.seed, 7])
    t = np.arange(int(200 * setup.duration)) / 200.0
    pose = run.pose(t)
    gyro = run.gyro(t) + 2e-3 * random.standard_normal((len(t), 3)) + [2e-3, -1e-3, 1e-3]
    drift = setup.heading_drift * t
    # position integrated along the wrong heading
    steps = setup.wheel_scale * np.diff(pose[:, :2], axis=0)
    c, s = np.cos(drift[:-1]), np.sin(drift[:-1])
    turned = np.column_stack([c * steps[:, 0] - s * steps[:, 1], s * steps[:, 0] + c * steps[:, 1]])
    place = np.concatenate([np.zeros((1, 2)), np.cumsum(turned, axis=0)])
    angles = run.pose(t - setup.angle_delay)[:, 2:] + np.outer(drift, [0.0, 0.0, 1.0])
    columns = {"t": t, "x": place[:, 0], "y": place[:, 1]}
    columns |= dict(zip(("theta", "phi", "psi"), angles.T, strict=True))
    columns |= dict(zip(("gyro_x", "gyro_y", "gyro_z"), gyro.T, strict=True))
    return Log(columns), _film(setup, run, random)


def _film(setup: Setup, run: Run, random: np.random.Generator) -> Log:
    # from a second before the log to a second after
    t = -1.0 + np.arange(int(120 * (setup.duration + 2.0))) / 120.0
    pose = run.pose(t)
    bodies = setup.camera_world * Rotation.from_euler("XYZ", pose[:, 2:])
    wobble = Rotation.from_rotvec(setup.noise * random.standard_normal((len(t), 3)))
    markers = bodies * setup.body_marker * wobble
    start = run.pose(np.zeros(1))[0, :2]
    centers = np.column_stack([pose[:, :2] - start, np.zeros(len(t))])
    places = setup.camera_world.apply(centers) + setup.origin + markers.apply(setup.lever)
    places += 2e-4 * random.standard_normal(places.shape)
    columns = {"t": setup.offset + (1.0 + setup.rate) * t}
    columns |= dict(zip("xyz", places.T, strict=True))
    return Log(columns | dict(zip(_QUATERNION, markers.as_quat(scalar_first=True).T, strict=True)))


def flipped(film: Log, *, start: float, end: float, flip: Rotation) -> Log:
    """Return motion capture whose marker frame is another from `start` to `end` of its clock [s]."""
    quaternions = np.column_stack([film[name] for name in _QUATERNION])
    rows = (film.t >= start) & (film.t < end)
    turned = Rotation.from_quat(quaternions[rows], scalar_first=True) * flip
    quaternions[rows] = turned.as_quat(scalar_first=True)
    return film.with_columns(dict(zip(_QUATERNION, quaternions.T, strict=True)))


def unseen(film: Log, *, start: float, end: float) -> Log:
    """Return motion capture that saw nothing from `start` to `end` of its clock [s]."""
    rows = (film.t >= start) & (film.t < end)
    return film.with_columns({name: np.where(rows, np.nan, film[name]) for name in film.names if name != "t"})
