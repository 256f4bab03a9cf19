"""Balancing by the equations of motion: a log's filtered motion, the torque that each wheel needs, what drives which.

Motion. All signals pass one filter (a local cubic fit with Gaussian weights), so that a linear relation between them
is kept, whatever the filter removes. Horizontal vectors are in the heading frame, which turns with psi, and are stored
as complex numbers, x + j y:

    ball velocity       v = (x_dot + j y_dot) e^{-j psi}
    upward direction    g = (-sin phi + j sin theta) e^{-j psi}
    lean rate           w = (theta_dot + j phi_dot) e^{-j psi}

g and w are kept as the contributions of theta and phi (or their rates), so that a check can exchange or negate these
columns. The significance of a comparison comes from blocks of the log, which are nearly independent; neighbouring rows
are not.

Torques. The rows of the equations of motion without the lean, about upright and in the heading frame, give the torque
between ball and wheels,

    r_b d/dt (M_vv v + M_vw w) = E^T tau,      M_w. (w_dot, v_dot) about the vertical = -tau_z,      tau = A^T n,

and with it n, the torque that each wheel needs for the motion. A motor supplies it and its driveline's friction:

    u_i = s_i (k n_i + f(wheel speed i))    f: dry, viscous, falling with speed; it never drives

so k is one for the right robot, s_i for the right scale, and wheel i's torque follows n_i and its own speed's sign.

The gains are solved from one set of products per motor and second, weighted by the fraction of time in which the wheel
turned for certain: the friction of a sticking wheel is unknown. Regression of a torque on the torque that the motion
needs gives too small a factor, because the need is computed from differentiated signals and has their noise. The factor
is therefore that of the part of the need that gravity causes: its noise is that of another sensor, an instrumental
variable. Its error has three parts: the scatter of the seconds; what friction's three terms miss, a fraction of the
friction that grows with the part of it that goes along with the need; and a floor. A log in which friction is most of
the torque hardly bounds the scale; a finding then reports the bounds.

Order. Commands d_j may be of unknown order, sign, kind and scale (`assign`):

    s_j d_j = a n_i + b w_i + h mean(w) + friction's terms in the sign of w_i        w_i speed of the wheel [rad/s]

Every order and every choice of signs is tried; those that explain all commands best, with one a and one b, are the
answer. The commands are on the left: commands that sum to zero are no difficulty there, while a regression of all
wheels on all commands would be collinear, and a wheel's sign would be decided by noise.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from ballbot.arrays import Bools, Floats
from ballbot.log.columns import torque_names
from ballbot.log.evidence import MOST, TINY, behind, gains_over, posterior
from ballbot.log.log import Log
from ballbot.log.pose import measured_wheel_speeds
from ballbot.log.signals import INTERVAL, across_a_gap, near, smooth, smooth_at
from ballbot.mechanics.geometry import transforms
from ballbot.mechanics.model import Model, contact_momentum
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


#: speed at which the sign of a wheel's dry friction is nearly certain, above which it is certain, and at which the
#: falling part of friction has fallen to 37 % [rad/s]
SIGN, TURNING, FALLING = 0.1, 0.3, 0.6
#: exponent of the weight of rows by the fraction of the filter's time in which the wheel turned for certain
TURNED_POWER = 4


@dataclass(frozen=True, kw_only=True, eq=False)
class Driving:
    """Torques, needed torques and friction terms of each wheel, at the rows of `Motion`."""

    torque: Floats  #: (N, n) u as logged, filtered [N m]
    needed: Floats  #: (N, n) n, the torque that the motion needs of each wheel [N m]
    pulled: Floats  #: (N, n) gravity's part of it [N m]
    friction: Floats  #: (N, n, 3) sign, speed and falling sign of each wheel's speed, filtered
    turning: Floats  #: (N, n) fraction of the filter's time in which the wheel turned for certain
    block: NDArray[np.intp]  #: (N,)
    azimuths: Floats  #: (n,) of the wheels [rad]


def driving_of(log: Log, motion: Motion, robot: Robot) -> Driving | None:
    """Return the torques of a log and those that its motion needs; None without every wheel's torque."""
    names = torque_names(robot.wheel_count)
    if not set(names) <= set(log.names):
        return None
    speed = smoothed_wheel_speeds(log, robot)
    sign = np.tanh(speed / SIGN)
    parts = (sign, speed, sign * np.exp(-np.abs(speed) / FALLING), (np.abs(speed) > TURNING).astype(float))
    terms = motion.filtered(log, np.hstack(parts)).reshape(len(motion.block), 4, -1)
    torques = np.column_stack([log[name] for name in names])
    needed, pulled = _needed(motion, robot)
    return Driving(
        torque=motion.filtered(log, torques, late=0.5 * log.sample_time), needed=needed, pulled=pulled,
        friction=np.moveaxis(terms[:, :3], 1, -1), turning=np.clip(terms[:, 3], 0.0, 1.0),
        block=motion.block, azimuths=np.asarray(robot.wheels.azimuths),
    )  # fmt: skip


def _needed(motion: Motion, robot: Robot) -> tuple[Floats, Floats]:
    """Return the torques (N, n) [N m] that the motion needs of each wheel, and gravity's part of them."""
    M, r_b, pull = Model(robot).mass_matrix(np.zeros(5)), robot.ball.radius, contact_momentum(robot).pull
    v, v_dot = as_plane(motion.velocity), as_plane(motion.acceleration)
    lean_rate, lean_acceleration = (a + 1j * b for a, b in (motion.lean_rate, motion.lean_acceleration))
    w = np.column_stack([as_plane(lean_rate), motion.turning])
    w_dot = np.column_stack([as_plane(lean_acceleration), motion.turning_rate])
    momentum, change = (as_complex(a @ M[:2, :2].T + b @ M[:2, 2:].T) for a, b in ((v, w), (v_dot, w_dot)))
    force = change + 1j * motion.turning * momentum
    g = -motion.lean[1] + 1j * motion.lean[0]
    of_gravity = as_complex(-as_plane(g) @ pull.T @ M[:2, :2].T)
    tau_z = -(w_dot @ M[4, 2:] + v_dot @ M[4, :2])
    # tau (N, 3) between ball and wheels about the heading frame's axes, as torques of the wheels
    needed, pulled = (
        np.column_stack([-r_b * f.imag, r_b * f.real, z]) @ np.linalg.pinv(transforms(robot).T_owb)
        for f, z in ((force, tau_z), (of_gravity, np.zeros(len(g))))
    )
    return needed, pulled


def smoothed_wheel_speeds(log: Log, robot: Robot) -> Floats:
    """Return each wheel's speed (len(log), n) [rad/s], smoothed; by the states where it is not logged.

    It is missing in rows that lack the states as well.
    """
    speeds = measured_wheel_speeds(log, robot)
    known = np.isfinite(speeds).all(axis=1)
    smoothed = np.full_like(speeds, np.nan)
    smoothed[known] = smooth_at(log.t[known], speeds[known], width=max(0.007, log.sample_time))[0]
    return smoothed


#: fewest seconds in which a wheel turns for certain for the gain of a motor
LEAST_TURNING = 2.0
#: relative error of every gain, and of the friction that the three terms give: with these, the largest of 724 gains of
#: sound recordings of the development halves of campaigns/mapping_recordings.py is 3.2 standard errors from one
FLOOR, FRICTION_ERROR = 0.03, 0.03
#: standard deviation of the logarithm of the gain of all torques, before a log is seen
USUAL = 0.15
#: standard errors of a gain that is wrong (of 400 sound logs of robots that set nothing, 2 are beyond 3.5), and the
#: factor of one torque over the others that is
SURE, UNLIKE = 5.0, 1.25
#: gains nearer to zero than this part of the middle one are as good as zero
ZERO = 0.05


@dataclass(frozen=True, kw_only=True, eq=False)
class Gains:
    """Factors of each torque over the one that its wheel needs."""

    factors: Floats  #: (n,); nan if the log does not show it
    errors: Floats  #: (n,) relative standard errors

    def common(self, but: int | None = None) -> tuple[float, float]:
        """Return the factor of all torques, or of all but one, and its relative standard error."""
        shown = self.factors[np.isfinite(self.factors)]
        known = self.factors > ZERO * max(float(np.median(shown)), 0.0) if shown.size else self.factors > 0.0
        known = known & (np.arange(len(known)) != but)
        weights = 1.0 / np.square(self.errors[known])
        precision = float(weights.sum())
        if precision == 0.0:
            return 1.0, float("inf")
        return float(np.exp(weights @ np.log(self.factors[known]) / precision)), precision**-0.5

    def unlike(self) -> tuple[Floats, Floats]:
        """Return the factor (n,) of each torque over that of the others, and its relative standard error.

        The others' is known by what is usual, too, unless the log contradicts that.
        """
        others, errors = np.array([self.common(i) for i in range(len(self.factors))]).T
        precision = errors**-2 + USUAL**-2
        usual = np.abs(np.log(others)) < 3.0 * np.hypot(errors, USUAL)
        others = np.where(usual, others ** (errors**-2 / precision), others)
        errors = np.where(usual, precision**-0.5, errors)
        return np.maximum(self.factors / others, ZERO), np.hypot(self.errors, errors)


def gains_of(driving: Driving) -> Gains:
    """Return the gain of each motor."""
    factors = np.array([_gain(driving, i) for i in range(driving.torque.shape[1])])
    return Gains(factors=factors[:, 0], errors=factors[:, 1])


def _gain(driving: Driving, i: int) -> tuple[float, float]:
    """Return the factor of a motor and its relative standard error; (nan, inf) if the log has none."""
    weight = driving.turning[:, i] ** TURNED_POWER
    friction = np.column_stack([driving.friction[:, i], np.ones(len(weight))])
    rest = np.column_stack([driving.needed[:, i], driving.pulled[:, i], driving.torque[:, i]])
    friction, rest = friction * weight[:, None], rest * weight[:, None]
    of_friction, crossed = friction.T @ friction, friction.T @ rest
    size = np.diag(of_friction)
    tiny = np.diag(1e-9 * size + 1e-12 * size.sum() + 1e-300)  # terms may be collinear, or zero
    explained = np.linalg.solve(of_friction + tiny, crossed)
    left = rest - friction @ explained  # of the need, gravity's part of it and the torque
    of_need, of_torque = (np.bincount(driving.block, weights=left[:, 1] * left[:, k]) for k in (0, 2))
    common = float(of_need.sum())
    if EVERY * INTERVAL * float(weight.sum()) < LEAST_TURNING or common <= 0.0:
        return float("nan"), float("inf")
    k = float(of_torque.sum()) / common
    scatter = float(np.linalg.norm(of_torque - k * of_need)) / common
    own = explained[:, 2] - k * explained[:, 0]
    # what the terms miss, at its worst goes along with gravity's need
    missed = FRICTION_ERROR * np.sqrt(own @ of_friction @ own * np.vdot(left[:, 1], left[:, 1])) / common
    return k, float(np.hypot(np.hypot(scatter, missed) / max(abs(k), ZERO), FLOOR))


# --- which command drives which wheel ---

#: assignments whose torques differ by less than this part of their size count as one: with another error of 0.09 of it
#: torques are still off by no more than they may be, 0.2. A wheel's counts as at least this part of all wheels' (root
#: mean square)
SAME_TORQUES, LEAST_TORQUE = 0.18, 0.5
#: before the log is seen, motors are numbered as encoders, and have usual signs, with these probabilities
OWN_ORDER, EQUAL_SIGNS = 0.9, 0.75
#: weight for each second of the logarithm of the ratio of squared errors, twice that of rolling and once that of
#: turning (`behind`), set on half of the robots of the campaign (135 logs); of the 121 logs of the others 97 % then
#: have an order with confidence, and none a wrong one
EACH_SECOND = 1.0
#: shares of the commands' power that are left anyway: of rolling and turning, and of what does neither
LEAST_LEFT, LEAST_IDLE = 1e-3, 3e-4
#: share of the commands that must be explained, and from which on nothing is in doubt. Commands that are torques about
#: axes are mixtures of all wheels': single ones leave 0.38 of them, and at most 0.35 where they are right, of robots
#: whose wheels mostly stick (campaigns/mapping_corpus.py)
LEAST_EXPLAINED, ALL_EXPLAINED = 0.55, 0.65


@dataclass(frozen=True, kw_only=True)
class CommandOrder:
    """Which wheel each command drives."""

    wheels: tuple[int, ...]  #: for the file's commands in turn, the robot's wheel (from 0)
    signs: tuple[int, ...]  #: of the file's commands in turn
    explained: float  #: share of the commands' variance
    advantage: float  #: over the next best assignment, in standard errors over blocks of a second
    next_best: str  #: in words
    confidence: float

    @property
    def description(self) -> str:
        """The assignment in words."""
        return f"for wheels {[wheel + 1 for wheel in self.wheels]}, signs {list(self.signs)}"


_Order = tuple[tuple[int, ...], tuple[int, ...]]  #: wheels and signs of an `CommandOrder`


def assign(driving: Driving, counted: Sequence[int]) -> CommandOrder:
    """Return the likeliest order and signs of the commands: by what the motion leaves of them, and by what is usual.

    That which fits best is likelier than what is less usual; what is more usual does not make up for a worse fit. Those
    that make nearly the same torques, as opposite wheels of four do while the heading stands still, are one, and the
    most usual of them is taken. `counted` are the signs with which the encoders count, of the robot's wheels in turn.
    """
    left = _unexplained_shares(driving)
    every, totals = list(left), np.array(list(left.values())).sum(axis=2)
    floors = np.array([LEAST_LEFT, LEAST_LEFT, LEAST_IDLE])[: totals.shape[1]]
    weights = np.array([2.0, 1.0, 1.0])[: len(floors)]
    score = np.log(totals + floors) @ weights
    without = totals[None] - np.moveaxis(np.array(list(left.values())), 2, 0)
    gained, z = gains_over(score, np.log(np.maximum(without, 0.0) + floors) @ weights)
    usual, least = [_usual(order, counted) for order in every], int(np.argmin(score))
    odds = behind(z, gained, len(without), each_second=EACH_SECOND)
    probability = posterior([min(probability_of_order, usual[least]) for probability_of_order in usual], odds)
    torques = {h: by_wheel(driving.torque, every[h]) for h, p in probability.items() if p > 1e-3}
    likeliest = next(iter(torques.values()))
    size = SAME_TORQUES * sizes_of(likeliest - _by_speed(driving, likeliest))
    alike = [h for h, u in torques.items() if np.all(np.std(u - likeliest, axis=0) <= size)]
    best = max(alike, key=lambda h: usual[h])
    other = next((h for h in probability if h not in alike), best)
    explained = 1.0 - float(totals[best, :2].sum())
    enough = min(max((explained - LEAST_EXPLAINED) / (ALL_EXPLAINED - LEAST_EXPLAINED), 0.0), 1.0)
    (wheels, signs), (next_wheels, next_signs) = every[best], every[other]
    return CommandOrder(
        wheels=wheels,
        signs=signs,
        explained=explained,
        advantage=float(z[other] - z[best]),
        next_best=f"for wheels {[i + 1 for i in next_wheels]}, signs {list(next_signs)}",
        confidence=min(sum(probability[h] for h in alike), MOST) * enough,
    )


def sizes_of(torques: Floats) -> Floats:
    """Return the size (n,) of each wheel's torque (N, n), of which an error of it is a part."""
    return np.maximum(torques.std(axis=0), LEAST_TORQUE * np.sqrt(torques.var(axis=0).mean()))


def _by_speed(driving: Driving, u: Floats) -> Floats:
    """Return what of the wheels' commands (N, n) goes with their speeds: of duties, mostly the back-EMF."""
    speed = driving.friction[:, :, 1]
    terms = np.column_stack([speed.ravel(), driving.needed.ravel(), driving.friction[:, :, 0].ravel()])
    return max(float(np.linalg.lstsq(terms, u.ravel(), rcond=None)[0][0]), 0.0) * speed


def _usual(wheels: _Order, counted: Sequence[int]) -> float:
    """Return the probability of an order before the motion is seen.

    Motors are numbered as encoders, and turn all alike or as these count, in most robots.
    """
    order, signs = wheels
    n, relative = len(order), {sign * counted[wheel] for wheel, sign in zip(order, signs, strict=True)}
    own, even = order == tuple(range(n)), len(set(signs)) == 1 or len(relative) == 1
    p = OWN_ORDER if own else (1.0 - OWN_ORDER) / (math.factorial(n) - 1)
    return p * (EQUAL_SIGNS / 2.0 if even else (1.0 - EQUAL_SIGNS) / (2**n - 2))


def by_wheel(commands: Floats, wheels: _Order) -> Floats:
    """Return the commands (N, n) of the robot's wheels in turn, by the wheels (from 0) and signs of the file's."""
    order, signs = wheels
    return (commands * np.asarray(signs, dtype=np.float64))[:, np.argsort(order)]


def _unexplained_shares(driving: Driving) -> dict[_Order, Floats]:
    """Return the shares (k, B) of the commands' power that each order and choice of signs leaves, by seconds.

    They are those of what rolls the ball, of what turns it, and, of four wheels or more, of what does neither. Of the
    last nothing is explained: a controller has no reason to command it. The first two are fitted together.

    The motors are alike: a and b are common to all wheels, and only dry friction is each wheel's own. None of them can
    be negative. A controller damps the turning of the heading, which something else drives: commands alike have a part
    that goes against the wheels' common speed, and would pass for friction of motors with the opposite sign. It is
    fitted, with either sign. A motor weaker than the others by more than a third can be taken for another if the robot
    moves along one line.
    """
    u, speed = driving.torque - driving.torque.mean(axis=0), driving.friction[:, :, 1]
    n = u.shape[1]
    heading = np.broadcast_to(speed.mean(axis=1, keepdims=True), u.shape)
    dry = np.einsum("tik,ij->tijk", driving.friction[:, :, [0, 2]], np.eye(n)).reshape(len(u), n, -1)
    # (N, n, k), the terms of each wheel
    terms = np.concatenate([np.stack([driving.needed, speed, heading, -heading], axis=-1), dry], axis=-1)
    terms, count = terms - terms.mean(axis=0), terms.shape[-1]
    plane = np.column_stack([np.ones(n), np.cos(driving.azimuths), np.sin(driving.azimuths)])
    basis = np.linalg.qr(plane, mode="complete")[0]
    parts = np.einsum("im,tik->mtk", basis[:, :3], terms)
    parts = parts / np.maximum(np.sqrt(np.square(parts).sum(axis=(0, 1))), 1e-30)
    table = np.concatenate([u, *parts], axis=1)
    seconds = [table[driving.block == b] for b in range(int(driving.block[-1]) + 1)]
    products = np.array([rows.T @ rows for rows in seconds])
    power = products[:, :n, :n]
    crossed = products[:, :n, n:].reshape(-1, n, 3, count)
    own = np.array([products[:, k : k + count, k : k + count] for k in range(n, n + 3 * count, count)])
    whole, together = float(np.trace(power.sum(axis=0))), crossed.sum(axis=0)
    # the same sums of squares, by a triangular matrix in place of all rows
    root = np.linalg.cholesky(own.sum(axis=(0, 1)) + 1e-9 * np.eye(count)).T
    unexplained = {}
    for order in permutations(range(n)):
        for signs in product((1, -1), repeat=n):
            way = basis[list(order)].T * np.asarray(signs)  # parts of each command
            right = np.einsum("mj,jmk->k", way[:3], together)
            factors, _ = nnls(root, np.linalg.solve(root.T, right))
            left = np.einsum("mj,bjl,ml->mb", way, power, way)
            left[:3] -= 2.0 * np.einsum("mj,bjmk,k->mb", way[:3], crossed, factors)
            left[:3] += np.einsum("k,mbkl,l->mb", factors, own, factors)
            left = np.maximum(left, 0.0) / max(whole, TINY)
            idle = [left[3:].sum(axis=0)] if n > 3 else []
            unexplained[order, signs] = np.array([left[1] + left[2], left[0], *idle])
    return unexplained
