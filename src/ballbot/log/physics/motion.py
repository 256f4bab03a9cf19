"""The motion in a log of balancing, filtered for the robot's equations of motion.

All signals pass one filter (a local cubic fit with Gaussian weights), so that a linear relation between them is
kept, whatever the filter removes. Horizontal vectors are in the heading frame, which turns with psi, and are stored
as complex numbers, x + j y:

    ball velocity       v = (x_dot + j y_dot) e^{-j psi}
    upward direction    g = (-sin phi + j sin theta) e^{-j psi}
    lean rate           w = (theta_dot + j phi_dot) e^{-j psi}

g and w are kept in the parts that theta and phi (or their rates) contribute, so that a check can ask what the motion
would be with these columns exchanged or negated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.log.columns import torque_names
from ballbot.log.log import Log
from ballbot.log.proposal.signals import INTERVAL, REACH, Smooth, smooth
from ballbot.robot import Robot

#: standard deviation of the filter's weights [s]; encoder and gyro noise would hide the accelerations with less
WIDTH = 0.12
#: rows that are kept, one in this many: neighbours within the filter's width say the same
EVERY = 4
#: blocks by which the clarity of a result is judged [s]; longer than the filter's memory
BLOCK = 1.0
#: rows this near a gap, a missing value or a large lean are left out, in widths of the filter
AWAY = 2.5
LONGEST_GAP = 0.05  #: [s]
LARGEST_LEAN = 0.3  #: [rad]
LONGEST_SAMPLE_TIME = 0.03  #: [s], beyond which the filter sees too few rows
LEAST_BLOCKS = 4
#: what of a log is looked at, from its start [s]
LONGEST_LOG = 600.0

COLUMNS = ("x_dot", "y_dot", "theta", "phi", "psi", "theta_dot", "phi_dot", "psi_dot")

Complex = NDArray[np.complex128]


@dataclass(frozen=True, kw_only=True, eq=False)
class Filtered:
    """A complex signal (N,) and its rate, both filtered."""

    value: Complex
    rate: Complex


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """Filtered motion at N rows that are usable."""

    t: NDArray[np.float64]  #: (N,) [s]
    block: NDArray[np.intp]  #: (N,) number of the block that a row is in, from 0 without holes
    velocity: Filtered  #: v [m/s]
    lean: tuple[Complex, Complex]  #: sin theta e^{-j psi}, sin phi e^{-j psi}
    lean_rate: tuple[Filtered, Filtered]  #: theta_dot e^{-j psi}, phi_dot e^{-j psi} [rad/s]
    turning: NDArray[np.float64]  #: (N,) psi_dot [rad/s]
    turning_rate: NDArray[np.float64]  #: (N,) [rad/s^2]

    @property
    def blocks(self) -> int:
        """Number of blocks."""
        return int(self.block[-1]) + 1


@dataclass(frozen=True, kw_only=True, eq=False)
class Rows:
    """The rows on which signals are filtered, and which of them are usable."""

    even: NDArray[np.float64]  #: (M,) [s], at `INTERVAL`
    usable: NDArray[np.intp]  #: indices into `even`, one in `EVERY`
    known: NDArray[np.bool_]  #: rows of the log without a missing value in what is needed
    width: float = WIDTH  #: standard deviation of the filter's weights [s]

    def filtered(self, log: Log, values: NDArray[np.float64], *, late: float = 0.0) -> Smooth:
        """Return signals (len(log), c) filtered at the usable rows; `late` is when they hold after their row [s]."""
        found = smooth(self.even, log.t[self.known] + late, values[self.known], width=self.width)
        return Smooth(
            value=found.value[self.usable],
            rate=found.rate[self.usable],
            acceleration=found.acceleration[self.usable],
        )


def usable_rows(log: Log, robot: Robot) -> Rows | None:
    """Return the rows on which the physics of a log can be checked.

    Returns
    -------
    Rows or None
        None if the log lacks a column of `COLUMNS`, is sampled too slowly, or has less than `LEAST_BLOCKS` seconds
        of balancing.
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
    before = np.clip(np.searchsorted(t, even, side="right") - 1, 0, len(t) - 2)
    lean = np.hypot(log["theta"][known], log["phi"][known])
    # a lean in degrees is another check's matter, and still a lean
    leaning = lean > (LARGEST_LEAN if np.median(lean) < LARGEST_LEAN else np.degrees(LARGEST_LEAN))
    bad = (np.diff(t)[before] > LONGEST_GAP) | leaning[before]
    reach = round(AWAY * WIDTH / INTERVAL)
    near = np.convolve(bad, np.ones(2 * reach + 1), mode="same") > 0.5
    near[:reach] = near[len(near) - reach :] = True
    usable = np.flatnonzero(~near)[::EVERY]
    if len(usable) * EVERY * INTERVAL < LEAST_BLOCKS * BLOCK:
        return None
    return Rows(even=even, usable=usable, known=known)


def motion_of(log: Log, rows: Rows) -> Motion:
    """Return the filtered motion of a log at its usable rows."""
    turn = np.exp(-1j * log["psi"])
    signals = {
        "v": (log["x_dot"] + 1j * log["y_dot"]) * turn,
        "theta": np.sin(log["theta"]) * turn,
        "phi": np.sin(log["phi"]) * turn,
        "theta_dot": log["theta_dot"] * turn,
        "phi_dot": log["phi_dot"] * turn,
        "psi_dot": log["psi_dot"] + 0j,
    }
    table = np.column_stack([part for z in signals.values() for part in (z.real, z.imag)])
    found = rows.filtered(log, table)
    made = {
        name: Filtered(
            value=found.value[:, 2 * i] + 1j * found.value[:, 2 * i + 1],
            rate=found.rate[:, 2 * i] + 1j * found.rate[:, 2 * i + 1],
        )
        for i, name in enumerate(signals)
    }
    t = rows.even[rows.usable]
    _, block = np.unique(np.floor((t - t[0]) / BLOCK).astype(int), return_inverse=True)
    return Motion(
        t=t,
        block=block,
        velocity=made["v"],
        lean=(made["theta"].value, made["phi"].value),
        lean_rate=(made["theta_dot"], made["phi_dot"]),
        turning=made["psi_dot"].value.real,
        turning_rate=made["psi_dot"].rate.real,
    )


def filter_reach() -> int:
    """Return the rows on each side that the filter takes in."""
    return round(REACH * WIDTH / INTERVAL)


def as_plane(z: Complex) -> NDArray[np.float64]:
    """Return complex numbers (N,) as vectors (N, 2)."""
    return np.column_stack([z.real, z.imag])


def as_complex(vectors: NDArray[np.float64]) -> Complex:
    """Return vectors (N, 2) as complex numbers (N,)."""
    return vectors[:, 0] + 1j * vectors[:, 1]
