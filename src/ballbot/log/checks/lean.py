"""The filtered motion in a log of balancing, and the lean axes against the ball's acceleration.

All signals pass one filter (a local cubic fit with Gaussian weights), so that a linear relation between them is
kept, whatever the filter removes. Horizontal vectors are in the heading frame, which turns with psi, and are stored
as complex numbers, x + j y:

    ball velocity       v = (x_dot + j y_dot) e^{-j psi}
    upward direction    g = (-sin phi + j sin theta) e^{-j psi}
    lean rate           w = (theta_dot + j phi_dot) e^{-j psi}

g and w are kept as the contributions of theta and phi (or their rates), so that a check can exchange or negate these
columns.

The law is that of the momentum about the floor's contact,

    d/dt (v + C w) = -Lambda g                    (`ballbot.mechanics.contact_momentum`)

It contains no torque and no driveline friction: the robot accelerates towards its lean whatever the motors do. It is
evaluated with the lean columns and their rates as they are, and with every exchange and change of sign of them; then
both terms get a free complex gain, whose size is a scale and whose angle is a turn about the vertical.

What else moves the ball is not independent of the lean: a controller answers a push with a lean, again and again in the
same way, so that no standard error over blocks shows it. Unless the law explains nearly everything, a scale is an error
only if a disturbance of the size of the residual, correlated with the lean by `CONFOUNDED`, could not have made it.

The significance of a comparison comes from blocks of the log, which are nearly independent; neighbouring rows are not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from ballbot.findings import Finding, error
from ballbot.log.columns import Bools, Floats, torque_names
from ballbot.log.log import Log
from ballbot.log.signals import INTERVAL, Smooth, across_a_gap, near, smooth
from ballbot.mechanics.model import contact_momentum
from ballbot.robot import Robot

Complex = NDArray[np.complex128]
#: in place of zero, the motion of a robot at rest
_TINY = float(np.finfo(float).tiny)


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


#: another reading must leave this many times less unexplained, and be better by so many standard errors
CLEARLY_LESS, CLEARLY_BETTER = 1.8, 4.0


def is_clearly_better(left: Floats, own: Floats) -> bool:
    """Return whether an explanation that leaves squares (B,) by blocks is the right one, and not the log's `own`."""
    advantage = (own - left) / np.maximum(own + left, _TINY)
    return own.sum() > CLEARLY_LESS * left.sum() and clarity(advantage) > CLEARLY_BETTER


def _unexplained(columns: Complex, values: Complex) -> Complex:
    """Return values (N,) less their least-squares fit by columns (N, m)."""
    return values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0]


#: standard deviation of the filter's weights [s]; encoder and gyro noise would hide the accelerations with less
WIDTH = 0.12
#: every so many-th row is kept; neighbours within the filter's width are redundant
EVERY = 4
#: length of the blocks for the significance of a result [s]; longer than the filter's memory
BLOCK = 1.0
#: rows this near a gap, a missing value or a large lean are excluded, in widths of the filter
AWAY = 2.5
LONGEST_GAP = 0.05  #: [s]
LARGEST_LEAN = 0.3  #: [rad]
LONGEST_SAMPLE_TIME = 0.03  #: [s], beyond which the filter sees too few rows
LEAST_BLOCKS = 4
#: part of a log that is used, from its start [s]
LONGEST_LOG = 600.0

COLUMNS = ("x_dot", "y_dot", "theta", "phi", "psi", "theta_dot", "phi_dot", "psi_dot")


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """Filtered motion at N rows that are usable."""

    t: Floats  #: (N,) [s]
    block: NDArray[np.intp]  #: (N,) number of the row's block, from 0 without gaps
    velocity: Complex  #: (N,) v [m/s]
    acceleration: Complex  #: (N,) dv/dt in the heading frame [m/s^2]
    lean: Complex  #: (2, N) sin theta e^{-j psi}, sin phi e^{-j psi}
    lean_rate: Complex  #: (2, N) theta_dot e^{-j psi}, phi_dot e^{-j psi} [rad/s]
    lean_acceleration: Complex  #: (2, N) their rates [rad/s^2]
    turning: Floats  #: (N,) psi_dot [rad/s]
    turning_rate: Floats  #: (N,) [rad/s^2]


@dataclass(frozen=True, kw_only=True, eq=False)
class Rows:
    """The rows on which signals are filtered, and which of them are usable."""

    even: Floats  #: (M,) [s], at `INTERVAL`
    usable: NDArray[np.intp]  #: indices into `even`, one in `EVERY`
    known: Bools  #: rows of the log without a missing value in the needed columns

    def filtered(self, log: Log, values: Floats, *, late: float = 0.0) -> Smooth:
        """Return signals (len(log), c) filtered at the usable rows; they are valid `late` [s] after their row."""
        found = smooth(self.even, log.t[self.known] + late, values[self.known], width=WIDTH)
        return Smooth(
            value=found.value[self.usable],
            rate=found.rate[self.usable],
            acceleration=found.acceleration[self.usable],
        )


def usable_rows(log: Log, robot: Robot) -> Rows | None:
    """Return the rows on which the physics of a log can be checked.

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
    return Rows(even=even, usable=usable, known=known)


def motion_of(log: Log, rows: Rows) -> Motion:
    """Return the filtered motion of a log at its usable rows."""
    turn = np.exp(-1j * log["psi"])
    angles, rates = (np.sin(log["theta"]), np.sin(log["phi"])), (log["theta_dot"], log["phi_dot"])
    signals = np.array([log["x_dot"] + 1j * log["y_dot"], *angles, *rates]) * turn
    found = rows.filtered(log, np.vstack([signals.real, signals.imag, log["psi_dot"]]).T)
    value, rate = (one[:, :5].T + 1j * one[:, 5:10].T for one in (found.value, found.rate))
    t = rows.even[rows.usable]
    _, block = np.unique(np.floor((t - t[0]) / BLOCK).astype(int), return_inverse=True)
    return Motion(
        t=t,
        block=block,
        velocity=value[0],
        acceleration=rate[0],
        lean=value[1:3],
        lean_rate=value[3:],
        lean_acceleration=rate[3:],
        turning=found.value[:, 10],
        turning_rate=found.rate[:, 10],
    )


def as_plane(z: Complex) -> Floats:
    """Return complex numbers (N,) as vectors (N, 2)."""
    return np.column_stack([z.real, z.imag])


def as_complex(vectors: Floats) -> Complex:
    """Return vectors (N, 2) as complex numbers (N,)."""
    return vectors[:, 0] + 1j * vectors[:, 1]


#: readings within this factor of the best are indistinguishable
AS_GOOD = 1.15
#: fraction of the ball's acceleration that the best reading must explain for a conclusion
EXPLAINED = 0.5
#: gains of gravity's term that are an error, beyond their standard error times `SURE`; correct logs have 0.9 to 1.1
GAIN_RANGE = (0.87, 1.15)
LARGEST_TURN = np.radians(12.0)
SURE = 3.0
#: correlation with the lean that a disturbance reaches through the controller: 0.47 on the logs of a robot
#: whose gain of gravity is 2.3 to 3.8 in 12 of 13 spans of 4 s, where correct logs of the twin have 0.9 to 1.1
CONFOUNDED = 0.5
#: relative standard error of gravity's gain above which nothing is concluded
KNOWN = 0.15
#: gains of gravity beyond these, or a turn that another reading of the columns would remove, are accepted only if the
#: law explains nearly everything
USUAL, BETWEEN, MOSTLY = (0.3, 3.0), np.radians(50.0), 0.85
#: ball speed below which the direction of rolling friction is unknown [m/s]
ROLLING = 0.005

_LEAN, _RATES = ("theta", "phi"), ("theta_dot", "phi_dot")


@dataclass(frozen=True)
class Reading:
    """One reading of two columns: the logged first and second, exchanged or not, with signs."""

    swapped: bool = False
    signs: tuple[int, int] = (1, 1)  #: of the first and the second quantity, after the exchange

    def fault(self, names: Sequence[str], *, with_rates: bool = False) -> str:
        """Return the fault of the columns of two names, and of their rates if they have the same."""
        first, second = names
        parts = [f"{first} and {second} are swapped"] if self.swapped else []
        if self.signs == (-1, -1):
            parts.append(f"{first} and {second} have the opposite sign")
        elif -1 in self.signs:
            # the column that is at fault: after an exchange the first quantity is logged in the second column
            at_fault = (self.signs[0] == -1) != self.swapped
            parts.append(f"{first if at_fault else second} has the opposite sign")
        single = not self.swapped and self.signs != (-1, -1)
        rates = (", with its rate" if single else ", with their rates") if with_rates else ""
        return " and ".join(parts) + rates

    @property
    def changes(self) -> int:
        """Number of separate faults."""
        return self.swapped + (-1 in self.signs)

    @property
    def weights(self) -> list[int]:
        """Factors of the first column as first and as second quantity, and of the second column likewise."""
        first, second = self.signs
        return [0, second, first, 0] if self.swapped else [first, 0, 0, second]


AS_LOGGED = Reading()
READINGS = tuple(Reading(swapped, (a, b)) for swapped, a, b in product((False, True), (1, -1), (1, -1)))


@dataclass(frozen=True, kw_only=True, eq=False)
class LeanEvidence:
    """The lean columns of one log by the law of the momentum about the contact."""

    readings: tuple[tuple[Reading, Reading], ...]  #: of the angles and their rates, the best, simplest first
    better: bool  #: whether they are clearly better than the columns as logged
    explained: float  #: fraction of the ball's acceleration that the best reading with fitted gains explains
    gravity_gain: complex  #: of the term of the lean angles; |gain| is a scale, its angle a turn [rad]
    gravity_error: float  #: standard error of the latter
    gravity_bias: float  #: largest error of its size by a disturbance that the controller answers
    #: size of the latter if the lean is regressed on the acceleration: noise of the lean lowers the gain itself and
    #: raises this one
    reverse_gain: float

    @property
    def conclusive(self) -> bool:
        """Whether the log is conclusive on the lean; slipping or shaking wheels have accelerations of their own."""
        size = abs(self.gravity_gain)
        usual = USUAL[0] < size < USUAL[1] and abs(np.angle(self.gravity_gain)) < BETWEEN
        return self.explained >= (EXPLAINED if usual else MOSTLY) and self.gravity_error < KNOWN * size

    @property
    def misread(self) -> bool:
        """Whether another reading of the columns is clearly the right one."""
        return self.conclusive and self.better and self.readings[0] != (AS_LOGGED, AS_LOGGED)


def lean_evidence(motion: Motion, robot: Robot) -> LeanEvidence:
    """Evaluate the law for every reading of the lean columns."""
    terms, block = _terms(motion, robot), motion.block
    gram = np.array([[block_sums((a.conj() * b).real, block) for b in terms] for a in terms])
    pairs = list(product(READINGS, READINGS))
    weights = np.array([[1, *rates.weights, *angles.weights] for angles, rates in pairs], dtype=np.float64)
    left = np.einsum("hi,ijb,hj->hb", weights, gram, weights)
    total = left.sum(axis=1)
    best = int(np.argmin(total))
    good = [k for k in range(len(pairs)) if total[k] <= AS_GOOD * total[best]]
    good.sort(key=lambda k: (pairs[k][0].changes + pairs[k][1].changes, total[k]))
    # the gains of both terms under the best reading
    weight, y = weights[good[0]], terms[0]
    rates, gravity = (-np.tensordot(weight[part], terms[part], axes=1) for part in (slice(1, 5), slice(5, 9)))
    gains = np.linalg.lstsq(np.column_stack([rates, gravity]), y, rcond=None)[0]
    residual = y - gains[0] * rates - gains[1] * gravity
    # gravity's gain by itself, with the rates' term removed from both sides; errors are clustered by blocks
    alone, rest = _unexplained(rates[:, None], gravity), _unexplained(rates[:, None], y)
    score = alone.conj() * residual
    scores = block_sums(score.real, block) + 1j * block_sums(score.imag, block)
    size, power, unknown = (float(np.vdot(one, one).real) for one in (alone, y, residual))
    size, common = max(size, _TINY), abs(np.vdot(alone, rest))
    return LeanEvidence(
        readings=tuple(pairs[k] for k in good),
        better=is_clearly_better(left[best], left[pairs.index((AS_LOGGED, AS_LOGGED))]),
        explained=1.0 - unknown / power if power > 0.0 else 0.0,
        gravity_gain=complex(gains[1]),
        gravity_error=float(np.linalg.norm(scores) / size),
        # a disturbance with this correlation has so large a part along the lean for the part that is left
        gravity_bias=float(CONFOUNDED / np.sqrt(1.0 - CONFOUNDED**2) * np.sqrt(unknown / size)),
        reverse_gain=float(np.vdot(rest, rest).real / common) if common > 0.0 else float("inf"),
    )


def _terms(motion: Motion, robot: Robot) -> Complex:
    """Return the law's terms (9, N): acceleration; lever of each rate in either place; pull of each angle likewise."""
    law, turning = contact_momentum(robot), 1j * motion.turning
    rates = [
        as_complex(as_plane(place * w_dot) @ law.lever[:, :2].T)
        + turning * as_complex(as_plane(place * w) @ law.lever[:, :2].T)
        for w, w_dot in zip(motion.lean_rate, motion.lean_acceleration, strict=True)
        for place in (1.0, 1j)
    ]
    # sin theta in theta's place is +j of g, in phi's place -1
    angles = [as_complex(as_plane(place * lean) @ law.pull.T) for lean in motion.lean for place in (1j, -1.0)]
    rolling = motion.velocity / np.maximum(np.abs(motion.velocity), ROLLING)
    # rolling friction, and the constant of a slope or of a lean's zero
    removed = np.column_stack([rolling, np.ones_like(rolling)])
    terms = np.column_stack([motion.acceleration + turning * motion.velocity, *rates, *angles])
    return _unexplained(removed, terms).T


def lean_findings(found: LeanEvidence) -> list[Finding]:
    """Return findings on the lean columns: signs, exchange, scale, a turn of the IMU."""
    if not found.conclusive:
        return []
    if found.misread:
        return [_misread(found)]
    size, turn = abs(found.gravity_gain), float(np.angle(found.gravity_gain))
    low, high = GAIN_RANGE
    # if the law explains nearly everything, nothing else moves the ball
    margin = SURE * found.gravity_error + (0.0 if found.explained >= MOSTLY else found.gravity_bias)
    if found.reverse_gain + margin < low or size - margin > high:
        text = (
            f"The ball accelerates {size:.3g} times as much as the lean implies: x, y, x_dot and y_dot are scaled "
            "(wheel radius, ball radius, gear ratio or encoder counts per turn), the height of the centre of mass "
            f"differs from the robot file, theta and phi are scaled by {1.0 / size:.3g}, or t is stretched."
        )
        return [error("lean-scale", text, *_LEAN, "x", "y", "x_dot", "y_dot")]
    if abs(turn) - SURE * found.gravity_error / size > LARGEST_TURN:
        text = (
            f"The ball accelerates {abs(np.degrees(turn)):.0f} degrees to the {'left' if turn > 0.0 else 'right'} of "
            "the lean: the IMU is mounted turned about the vertical, or psi has another zero than x and y. Rotate the "
            "lean ([attitude] turn in a mapping)."
        )
        return [error("lean-axes", text, *_LEAN)]
    return []


def _misread(found: LeanEvidence) -> Finding:
    """Return the finding that names every simplest reading that explains the motion as well as the best."""
    fewest = min(a.changes + r.changes for a, r in found.readings)
    causes, columns = [], set[str]()
    for angles, rates in (one for one in found.readings if one[0].changes + one[1].changes == fewest):
        parts = [angles.fault(_LEAN), rates.fault(_RATES)]
        causes.append(
            angles.fault(_LEAN, with_rates=True) if angles == rates else " and ".join(filter(None, parts))
        )
        columns |= {name for name in (*_LEAN, *_RATES) if any(name in part.split() for part in parts)}
    text = (
        f"The lean does not fit the ball's acceleration: {', or '.join(causes)}. With this correction the ball "
        "accelerates towards the lean, as under every balancing robot (the same mistake in x_dot, y_dot and the wheels "
        "would look the same). Correct the columns or the mapping."
    )
    return error("lean-axes", text, *sorted(columns))
