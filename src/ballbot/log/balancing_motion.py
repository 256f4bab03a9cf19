"""The filtered motion in a log of balancing: ball velocity, lean and their rates, at the rows that can be used.

All signals pass one filter (a local cubic fit with Gaussian weights), so that a linear relation between them is
kept, whatever the filter removes. Horizontal vectors are in the heading frame, which turns with psi, and are stored
as complex numbers, x + j y:

    ball velocity       v = (x_dot + j y_dot) e^{-j psi}
    upward direction    g = (-sin phi + j sin theta) e^{-j psi}
    lean rate           w = (theta_dot + j phi_dot) e^{-j psi}

g and w are kept as the contributions of theta and phi (or their rates), so that a check can exchange or negate these
columns. The significance of a comparison comes from blocks of the log, which are nearly independent; neighbouring rows
are not.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import Bools, Floats
from ballbot.log.columns import torque_names
from ballbot.log.log import Log
from ballbot.log.signals import INTERVAL, across_a_gap, near, smooth
from ballbot.robot import Robot

Complex = NDArray[np.complex128]


def block_sums(values: Floats, block: NDArray[np.intp]) -> Floats:
    """Return the sums (B,) over blocks of values (N,)."""
    return np.asarray(np.bincount(block, weights=values), dtype=np.float64)


def clarity(advantage: Floats) -> float:
    """Return the mean, over its standard error, of the advantage of one explanation over another by blocks (B,)."""
    spread = float(advantage.std(ddof=1)) if len(advantage) > 1 else 0.0
    mean = float(advantage.mean())
    if spread == 0.0:
        return float(np.copysign(np.inf, mean)) if mean else 0.0
    return mean / (spread / np.sqrt(len(advantage)))


#: standard deviation of the filter's weights [s]; encoder and gyro noise would hide the accelerations with less
WIDTH = 0.12
#: every so many-th row is kept; neighbours within the filter's width are redundant
EVERY = 4
#: length of the blocks for the significance of a result [s]; longer than the filter's memory
BLOCK, LEAST_BLOCKS = 1.0, 4
#: rows this near a gap, a missing value or a large lean are excluded, in widths of the filter
AWAY = 2.5
LONGEST_GAP, LARGEST_LEAN = 0.05, 0.3  #: [s], [rad]
LONGEST_SAMPLE_TIME = 0.03  #: [s], beyond which the filter sees too few rows
#: part of a log that is used, from its start [s]
LONGEST_LOG = 600.0

COLUMNS = ("x_dot", "y_dot", "theta", "phi", "psi", "theta_dot", "phi_dot", "psi_dot")


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """Filtered motion at the N usable rows of a log, one in `EVERY` of M even ones."""

    even: Floats  #: (M,) [s], at `INTERVAL`
    usable: NDArray[np.intp]  #: (N,) indices into `even`
    known: Bools  #: rows of the log without a missing value in the needed columns
    block: NDArray[np.intp]  #: (N,) number of the row's block, from 0 without gaps
    velocity: Complex  #: (N,) v [m/s]
    acceleration: Complex  #: (N,) dv/dt in the heading frame [m/s^2]
    lean: Complex  #: (2, N) sin theta e^{-j psi}, sin phi e^{-j psi}
    lean_rate: Complex  #: (2, N) theta_dot e^{-j psi}, phi_dot e^{-j psi} [rad/s]
    lean_acceleration: Complex  #: (2, N) their rates [rad/s^2]
    turning: Floats  #: (N,) psi_dot [rad/s]
    turning_rate: Floats  #: (N,) [rad/s^2]

    def filtered(self, log: Log, values: Floats, *, late: float = 0.0) -> Floats:
        """Return signals (len(log), c) filtered at the usable rows; they are valid `late` [s] after their row."""
        return smooth(self.even, log.t[self.known] + late, values[self.known], width=WIDTH).value[self.usable]


def motion_of(log: Log, robot: Robot) -> Motion | None:
    """Return the filtered motion of a log at the rows on which its physics can be checked.

    None if the log lacks a column of `COLUMNS`, is sampled too slowly, or has too little balancing.
    """
    if not set(COLUMNS) <= set(log.names) or len(log) < 2 or log.sample_time > LONGEST_SAMPLE_TIME:
        return None
    torques = [name for name in torque_names(robot.wheel_count) if name in log]
    table = np.column_stack([log[name] for name in (*COLUMNS, *torques)])
    known = np.isfinite(table).all(axis=1) & (log.t <= log.t[0] + LONGEST_LOG)
    t = log.t[known]
    if len(t) < 2 or t[-1] - t[0] < LEAST_BLOCKS * BLOCK:
        return None
    even = np.arange(t[0], t[-1], INTERVAL)
    lean = np.hypot(log["theta"][known], log["phi"][known])
    fallen = lean[np.searchsorted(t, even, side="right") - 1] > LARGEST_LEAN
    reach = round(AWAY * WIDTH / INTERVAL)
    bad = near(across_a_gap(even, t, LONGEST_GAP) | fallen, AWAY * WIDTH)
    bad[:reach] = bad[len(bad) - reach :] = True
    usable = np.flatnonzero(~bad)[::EVERY]
    if len(usable) * EVERY * INTERVAL < LEAST_BLOCKS * BLOCK:
        return None
    angles, rates = (np.sin(log["theta"]), np.sin(log["phi"])), (log["theta_dot"], log["phi_dot"])
    signals = np.array([log["x_dot"] + 1j * log["y_dot"], *angles, *rates]) * np.exp(-1j * log["psi"])
    columns = np.vstack([signals.real, signals.imag, log["psi_dot"]]).T
    smoothed = smooth(even, t, columns[known], width=WIDTH)
    parts = (signal[usable].T for signal in (smoothed.value, smoothed.rate))
    value, rate = (part[:5] + 1j * part[5:10] for part in parts)
    passed = even[usable] - even[usable[0]]
    return Motion(
        even=even, usable=usable, known=known,
        block=np.unique(np.floor(passed / BLOCK).astype(int), return_inverse=True)[1],
        velocity=value[0], acceleration=rate[0],
        lean=value[1:3], lean_rate=value[3:], lean_acceleration=rate[3:],
        turning=smoothed.value[usable, 10], turning_rate=smoothed.rate[usable, 10],
    )  # fmt: skip


def as_plane(z: Complex) -> Floats:
    """Return complex numbers (N,) as vectors (N, 2)."""
    return np.column_stack([z.real, z.imag])


def as_complex(vectors: Floats) -> Complex:
    """Return vectors (N, 2) as complex numbers (N,)."""
    return vectors[:, 0] + 1j * vectors[:, 1]
