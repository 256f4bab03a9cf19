"""How the file's wheels and IMU sit on the robot, from a log of balancing, without its torques.

While a ball rolls, the torque between body and ball drops out of the sum of their equations. To first order, with the
lean Theta = theta + j phi in the body's frame and wheel speeds w_i at azimuths beta_i,

    Theta_ddot = kappa Theta + gamma W_dot + rho W/|W| + offset,        W = sum_i w_i e^{j beta_i}

    gamma = r_w / ((n/2) (r_b + C) cos alpha),      kappa = Lambda / (r_b + C)

with C and Lambda of `mechanics.model.contact_momentum`. rho is the ball's rolling friction, which acts from outside.
kappa is the robot's: in a log of small leans it is hardly seen, and a free one takes from gamma. gamma is real and
positive, so the angle of the one estimated from a log is by how much the wheels are turned against the IMU, and a log
that follows the conjugate of W has its wheels numbered in the opposite direction, or an IMU with one axis reversed.
Every order of the wheels and every choice of their signs is fitted. A wrong one shows twice: it explains the lean's
acceleration less well, and it leaves motion of the wheels that is neither lean nor heading.

Which IMU axis is reversed shows only while the heading turns. In the frame of the IMU a derivative is D = d/dt + j
sigma psi_dot, with sigma = 1 if yaw and lean have the same handedness and -1 if not:

    D^2 Theta = kappa Theta + gamma D W + ..

Every fit is made in that frame, with the sigma that explains the lean better if each wheel has a gain of its own: a
robot that turns its heading while it rolls has a D W that is as large as W_dot, and without it gamma is too small by a
third, and off by 17 degrees, in the worst of the development logs.

Where nothing measures the heading, the wheels give it, up to the direction in which all of them count: a ball that does
not spin turns them by psi_dot alike. A mirrored IMU with mirrored wheels makes
the same log then, so that the lean counts as right-handed, and sigma = -1 says that all wheels count backwards.

A placement is scored by the residual of the lean's acceleration, and by the part of the wheels' motion that is neither
lean nor heading. Both come from sums over blocks of the log, so that every placement, with each block left out in turn,
takes a small system of equations.

The sign in which the wheels count comes from the heading, which turns all wheels alike:

    sum_i w_i = n (r_b / r_w) sin(alpha) (spin of the ball - psi_dot)

seen from the body. A ball spins less than the body that turns on it, or the other way, so that the sum goes against
psi_dot. Without a heading, the frame in which the lean turns shows it. Nothing else separates a log whose wheels all
count backwards from one whose IMU is turned by half a turn.

Turned by minus the angle of gamma, the IMU's lean is the robot's. If lean and yaw have opposite handedness, one axis of
the IMU is reversed: pitch, if the wheels are then in the robot's order, else yaw.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import permutations, product
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri, stdtr

from ballbot.arrays import Bools, Floats
from ballbot.log.evidence import (
    CONFIDENT,
    ERRORS_WEIGHT,
    MOST,
    TINY,
    advantage_confidence,
    behind,
    confidence_in,
    gains_over,
    jackknife_error,
    posterior,
    vertex_with_error,
)
from ballbot.log.signals import INTERVAL, Smooth
from ballbot.log.torque_balance import Complex, block_sums, clarity
from ballbot.mechanics.model import contact_momentum
from ballbot.robot import Robot

#: lean later than wheels that is tried [s]: an IMU's filter takes 15 to 20 ms. Whole rows: between them, interpolation
#: smooths, which looks like a better fit; and the lag with which the weights are first found
LAGS, USUAL_LAG = INTERVAL * np.arange(-1.0, 11.0), 0.0175
#: windows [s] that share one weight, one over their residual's size, and that the jackknife leaves out in turn
BLOCK = 1.0
#: a block is a push, not balancing, if its residual is this many times the median block's, and this share of the lean's
#: acceleration in it: quick motion leaves more, too. The share is 0.19 to 0.94 in the blocks of hands and lifts of a
#: course robot's log, and at most 0.06 in those of undisturbed twins whose residual is large
PUSHED, PUSHED_SHARE = 3.0, 0.12
#: rounds of weighting; a block's residual counts as at least this part of the median block's
FIT_ROUNDS, LEAST_SIZE = 4, 0.3
#: over which disturbance and gravity are compared [s], about the time in which the robot falls
SLOW = 0.25
#: the fewest seconds of balancing, and the rows at its ends, where the lag looks past the log, that are not used [s]
LEAST_TIME, EDGE = 3.0, 0.3
#: below this many seconds an order or a sign must fit `SHORT_MARGIN` times better than any other
SHORT_TIME, SHORT_MARGIN = 8.0, 2.0
#: share of the lean's acceleration that may be left, and at which the confidence is zero
USUAL_REST, LARGEST_REST = 0.5, 0.85
#: share of the wheels' motion that rollers and slip leave anyway
LEAST_TOGETHER = 0.003
#: weight of motion that all wheels share in a log without heading, over motion that no rolling ball allows. Four wheels
#: have both: opposite wheels exchanged and negated turn the one into the other, and change nothing else
UNKNOWN_HEADING = 0.3
#: prior probabilities: wheels in the robot's order, and in the opposite one; wheels of equal signs
OWN_ORDER, MIRRORED_ORDER, EQUAL_SIGNS = 0.55, 0.25, 0.6
#: weight for each second of the logarithm of the ratio of two misfits (`behind`)
EACH_SECOND = 0.6
#: placements whose wheels differ by less than this part of their angles count as one; a mapping whose wheels are off by
#: 0.03 is still right (campaigns/mapping_corpus.py). Less probable ones would add little to the confidence
SAME_WHEELS, TINY_PROBABILITY = 0.028, 1e-3
#: wheel speed (root of the sum of squares) below which the ball hardly rolls, and rolling friction has no sign [rad/s]
ROLLING = 0.2


#: a heading that turns by less than this [rad], and the weight of the standard errors z of its handedness. The odds are
#: exp(z^2): one alone hardly counts, three decide. Against the truth none of 137 variants of the campaign has more than
#: one, nor a course robot's log more than a half
STILL_HEADING, STILL_WEIGHT = 0.02, 0.3
#: how far the IMU may turn in a log without a yaw, over the heading that the wheels give if the ball does not spin
BY_WHEELS = (1.0, -1.0, 0.5, -0.5, 0.0)
#: standard errors by which the lean is better explained by less than that heading: the ball spins. As many decide the
#: direction in which all wheels count: by 2.5 it was wrong once
SURELY = 3.0
#: logarithm of the odds of the largest confidence
MOST_ODDS = math.log(MOST / (1.0 - MOST))
#: a heading by the wheels that turns by less than this [rad]: both directions in which all wheels may count make nearly
#: the same log, and this is the confidence in either
TURNING_BY_WHEELS, EQUAL_DIRECTIONS = 0.1, 0.95
#: people mount IMUs at multiples of this [rad]; a turn this near to one, within its errors, is taken for it
GRID, ROUNDED, ROUNDED_ERRORS = np.pi / 6.0, np.deg2rad(6.0), 2.5


@dataclass(frozen=True, kw_only=True)
class Placement:
    """One way in which the wheels' columns may sit on the robot, and how well the log agrees."""

    positions: tuple[int, ...]  #: for the file's wheels in turn, the robot's wheel (from 1)
    signs: tuple[int, ...]  #: of the file's wheels in turn, up to all of them
    phase: float  #: [rad], the angle of gamma
    gain: float  #: its size, over the robot's own gamma
    unexplained: float  #: share of the lean's acceleration
    together: float  #: share of the wheels' motion that is neither lean nor heading
    misfit: float  #: unexplained, times the root of together

    @property
    def description(self) -> str:
        return f"places {list(self.positions)}, signs {list(self.signs)}"


#: the wheels' motion that is neither lean nor heading is so small a share under the right signs, and so many times as
#: large under wrong ones: on the recordings at most 0.02, and 15 times
RIGHT_TOGETHER, WRONG_TOGETHER = 0.05, 5.0


@dataclass(frozen=True, kw_only=True)
class HeadingTest:
    """How the sum of the wheels' speeds follows the heading's rate, in the rows of balancing."""

    correlation: float  #: negative if the wheels count as the robot's do
    gain: float  #: size of the sum of the speeds over psi_dot, over that of a ball that does not pivot
    confidence: float  #: in the sign of the correlation


@dataclass(frozen=True, kw_only=True)
class LeanTest:
    """What the torque-free test found."""

    placements: tuple[Placement, ...]  #: best first
    confidence: float  #: in the best one
    phase_error: float | None  #: standard error of the best one's phase [rad]; None with too few blocks
    lag: float  #: lean later than wheels [s]
    lag_error: float  #: its standard error [s]
    #: standard errors by which sigma = 1 is better than -1, by the yaw or the wheels' heading; 0 without either
    handedness: float
    headings: float  #: standard deviation of the heading [rad]: how much the two differ; a constant is part of the turn
    disturbance: float  #: root mean square of the lean's unexplained acceleration, over gravity's share of it
    balancing: Bools  #: (N,), the even rows that were used
    pushed: Bools  #: (N,), rows left out because something pushed the robot
    heading: HeadingTest | None  #: None without a yaw

    @property
    def margin(self) -> float:
        """How many times worse the next best placement fits."""
        first, second = self.placements[:2]
        return second.misfit / max(first.misfit, 1e-12)

    @property
    def reversed_wheels(self) -> tuple[int, ...]:
        """The wheels (from 1) in the robot's order that count against the others; none if the log leaves it open.

        The wheels' motion by itself may decide if the lean does not.
        """
        likeliest = self.placements[0]
        own = [one for one in self.placements if one.positions == tuple(sorted(one.positions))]
        if likeliest is not own[0] or self.confidence < CONFIDENT:
            likeliest, second = sorted(own, key=lambda placement: placement.together)[:2]
            if likeliest.together > min(RIGHT_TOGETHER, second.together / WRONG_TOGETHER):
                return ()
        return tuple(i for i, sign in enumerate(likeliest.signs, start=1) if sign < 0)


def torque_free_gains(robot: Robot) -> tuple[float, float]:
    """Return kappa [1/s^2] and gamma [-] of the module's text."""
    law, wheels = contact_momentum(robot), robot.wheels
    arm = float(robot.ball.radius + law.lever[0, 1])
    gamma = wheels.radius / (0.5 * robot.wheel_count * arm * math.cos(wheels.tilt))
    return float(law.pull[0, 0]) / arm, gamma


def lean_test(
    robot: Robot, lean: Smooth, wheels: Smooth, heading: Smooth | None, usable: Bools
) -> LeanTest | None:
    """Find how three wheels or more sit; None if too little of the log is balancing.

    On even rows: roll and pitch (N, 2), the wheels' angles (N, n) in the file's order and with its signs, the yaw
    (N, 1) [rad], and which rows (N,) are those of the robot moving on its ball, not falling.
    """
    usable, edge = usable.copy(), round(EDGE / INTERVAL)
    usable[:edge] = usable[-edge:] = False
    if usable.sum() * INTERVAL < LEAST_TIME:
        return None
    kappa, gamma = torque_free_gains(robot)
    law = _LeanLaw(lean=lean, wheels=wheels, heading=heading, kappa=kappa, lag=USUAL_LAG, sigma=0.0)
    weights, _ = _weights(law, usable)
    sigmas = (1.0, -1.0)
    if heading is None:  # that which the wheels give, as the likeliest placement without one has them
        ranked, _ = _ranked_placements(robot, law, None, weights, gamma)
        law, sigmas = replace(law, heading=heading_of(robot, wheels, ranked[0])), BY_WHEELS
    laws = [replace(law, sigma=sigma) for sigma in sigmas]
    law = min(laws, key=lambda law: float(law.left(weights).sum()))
    weights, _ = _weights(law, usable)
    lag, lag_error = vertex_with_error(LAGS, np.array([replace(law, lag=lag).left(weights) for lag in LAGS]))
    law = replace(law, lag=lag)
    weights, pushed = _weights(law, usable)
    usable = usable & ~pushed
    placements, confidence = _ranked_placements(robot, law, heading, weights, gamma)
    best = placements[0]
    beta = np.asarray(robot.wheels.azimuths)[np.asarray(best.positions) - 1]
    way = np.asarray(best.signs) * np.exp(1j * beta)
    law = replace(law, way=way, heading=heading or heading_of(robot, wheels, best))
    columns, driven = law.columns, law.driven
    sums = _sums(np.column_stack([columns, driven]) * weights[:, None], weights)
    gains = [_solved((sums.sum(axis=0) - block)[:-1])[0] for block in sums]
    rest = driven - columns @ _solve(columns, driven, weights)
    gravity = kappa * (lean.value[:, 0] + 1j * lean.value[:, 1])
    phase_error = float(jackknife_error(np.angle(np.array(gains) * np.exp(-1j * best.phase))))
    same, opposite, *slower = (replace(law, sigma=sigma).left(weights) for sigma in BY_WHEELS)
    turns, turns_less = min(same, opposite, key=np.sum), min(slower, key=np.sum)
    spins = heading is None and advantage(turns_less, turns, weights) > SURELY
    turned = heading and _heading_test(robot, best, wheels.rate[usable], heading.rate[usable])
    return LeanTest(
        placements=tuple(placements),
        confidence=confidence,
        phase_error=None if math.isnan(phase_error) else phase_error,
        lag=lag,
        lag_error=lag_error,
        handedness=0.0 if spins else advantage(same, opposite, weights),
        headings=float(np.std(law.heading.value[usable])) if law.heading else 0.0,
        disturbance=float(np.std(_slow(rest)[usable]) / np.std(_slow(gravity)[usable])),
        balancing=usable,
        pushed=pushed,
        heading=turned,
    )


def unexplained_by_readings(
    robot: Robot, readings: Sequence[tuple[float, Smooth]], wheels: Smooth, usable: Bools
) -> tuple[list[Floats], Floats]:
    """Return the squares (B,) that the wheels leave of the lean's acceleration by each reading of it, and the weights.

    A reading is sigma and roll, pitch and yaw (N, 3). The weights (N,) are common, so that the squares can be compared.
    """
    kappa, _ = torque_free_gains(robot)
    laws = []
    for sigma, angles in readings:
        lean, heading = (angles.each(itemgetter(part)) for part in (np.s_[:, :2], np.s_[:, 2:]))
        law = _LeanLaw(lean=lean, wheels=wheels, heading=heading, kappa=kappa, lag=USUAL_LAG, sigma=sigma)
        laws.append(law)
    everywhere = usable.astype(np.float64)
    weights, _ = _weights(min(laws, key=lambda law: float(law.left(everywhere).sum())), usable)
    return [law.left(weights) for law in laws], weights


@dataclass(frozen=True, kw_only=True, eq=False)
class _LeanLaw:
    """Both sides of the law of the module's text, in the frame of the IMU, which turns."""

    lean: Smooth
    wheels: Smooth
    heading: Smooth | None
    kappa: float  #: [1/s^2]
    lag: float  #: lean later than wheels [s]
    sigma: float  #: 1 if lean and yaw have one handedness, -1 if not, 0 for a frame that stands still
    #: s_i e^{j beta} (n,) of the file's wheels; None gives each wheel gains of its own
    way: Complex | None = None

    def late(self, values: Floats) -> Floats:
        """Return columns (N, k), a lag later."""
        rows = np.arange(len(values), dtype=np.float64)
        return np.column_stack([np.interp(rows + self.lag / INTERVAL, rows, column) for column in values.T])

    @property
    def turn_rate(self) -> Floats:
        """sigma psi_dot (N,) [rad/s], later by the lag as the lean is."""
        if self.heading is None:
            return np.zeros(len(self.lean.value))
        return self.sigma * self.late(self.heading.rate)[:, 0]

    @property
    def driven(self) -> Complex:
        """D^2 Theta - kappa Theta (N,), a lag later: what the wheels must explain."""
        lean = self.lean.each(lambda signal: self.late(signal) @ [1.0, 1j])
        turn, changing = self.turn_rate, 0.0
        if self.heading is not None:
            changing = self.sigma * self.late(self.heading.acceleration)[:, 0]
        return lean.acceleration + 2j * turn * lean.rate + (1j * changing - turn**2 - self.kappa) * lean.value

    @property
    def columns(self) -> Complex:
        """D W, W/|W| and ones (N, 3); without a way those of each wheel (N, 2 n + 1)."""
        speed = self.wheels.rate
        size = np.sqrt((speed**2).sum(axis=1, keepdims=True))
        # in a frame that turns, a rate of the wheels' motion has a part of its size
        parts = [self.wheels.acceleration + 1j * self.turn_rate[:, None] * speed, speed / (size + ROLLING)]
        if self.way is not None:
            parts = [part @ self.way for part in parts]
        return np.column_stack([*parts, np.ones(len(speed))]).astype(np.complex128)

    def left(self, weights: Floats) -> Floats:
        """Return the squares (B,) that a fit leaves of what is driven, weighted, by blocks."""
        columns, driven = self.columns, self.driven
        rest = np.abs((driven - columns @ _solve(columns, driven, weights)) * weights) ** 2
        return block_sums(rest, _blocks(len(rest)))


def _turns(robot: Robot) -> float:
    """Return the sum of the wheels' speeds over the heading's rate, of a ball that does not spin."""
    wheel = robot.wheels
    return robot.wheel_count * robot.ball.radius / wheel.radius * math.sin(wheel.tilt)


def heading_of(robot: Robot, wheels: Smooth, placement: Placement) -> Smooth:
    """Return the heading (N, 1) [rad] by the wheels of a ball that does not spin, if they count as the robot's do."""
    way = -np.asarray(placement.signs, dtype=np.float64)[:, None] / _turns(robot)
    return wheels.each(lambda signal: signal @ way)


def _heading_test(robot: Robot, placement: Placement, speeds: Floats, rate: Floats) -> HeadingTest:
    """Compare the sum of the wheels' speeds (N, n) with the heading's rate (N, 1)."""
    total = (speeds @ np.asarray(placement.signs, dtype=np.float64))[:, None]
    correlation, confidence = (float(each[0, 0]) for each in confidence_in(total, rate))
    gain = abs(correlation) * float(np.std(total)) / max(float(np.std(rate)), TINY) / _turns(robot)
    return HeadingTest(correlation=correlation, gain=gain, confidence=confidence)


def advantage(better: Floats, other: Floats, weights: Floats) -> float:
    """Return by how many standard errors the first of two explanations is better, from what they leave by blocks (B,).

    Either the difference repeats in every block, or it is so large that few blocks are enough. The spread of few blocks
    is itself not well known: Student's t, taken for the normal deviate of the same probability.
    """
    used = np.bincount(_blocks(len(weights)), weights=weights) > 0.0
    gained = (other - better)[used] / float((better + other)[used].mean())
    if len(gained) < 3:
        return 0.0
    repeated = -float(ndtri(stdtr(len(gained) - 1, -abs(clarity(gained)))))
    ratio = math.log(float(other[used].sum()) / float(better[used].sum()))
    odds = behind(np.array(repeated), np.array(abs(ratio)), len(gained), each_second=0.5)
    return math.copysign(math.sqrt(2.0 * float(odds)) / ERRORS_WEIGHT, ratio)


def _solve(X: Complex, y: Complex, weights: Floats) -> Complex:
    # by the normal equations: as there are few columns and many rows, much faster than by an SVD
    weighted = X * weights[:, None]
    return _solved(weighted.conj().T @ np.column_stack([weighted, y * weights]))


def _solved(sums: Complex) -> Complex:
    """Return the coefficients (k,) of normal equations [A b] (k, k + 1), each column scaled to its size."""
    size = np.sqrt(np.abs(np.diag(sums))) + 1e-12
    scaled = sums[:, :-1] / np.outer(size, size)
    return (np.linalg.lstsq(scaled, sums[:, -1] / size, rcond=1e-9)[0] / size).astype(np.complex128)


def _slow(values: Complex) -> Complex:
    """Return running means over `SLOW`: what has time to make the robot fall."""
    count = round(SLOW / INTERVAL)
    return np.convolve(values, np.full(count, 1.0 / count), mode="same")


def _blocks(count: int) -> NDArray[np.intp]:
    """Return the number of the block (N,) that each of `count` even rows is in."""
    return np.arange(count) // round(BLOCK / INTERVAL)


def _sums(table: Complex, weights: Floats) -> Complex:
    """Return products of columns (B, k, k) by the blocks that have a weight."""
    blocks = _blocks(len(weights))
    rows = [table[blocks == block] for block in np.unique(blocks[weights > 0.0])]
    return np.array([block.conj().T @ block for block in rows])


def _weights(law: _LeanLaw, usable: Bools) -> tuple[Floats, Bools]:
    """Return weights (N,), one over a block's residual, and the rows of blocks that the wheels do not explain.

    Rows that are not usable, and those pushed, have weight zero.
    """
    X, driven = law.columns, law.driven
    blocks = _blocks(len(usable))
    count = np.bincount(blocks, weights=usable)
    weights, pushed = usable.astype(np.float64), np.zeros_like(usable)
    swings = np.abs(driven - np.average(driven, weights=weights)) ** 2
    for _ in range(FIT_ROUNDS):
        rest = np.abs(driven - X @ _solve(X, driven, weights)) ** 2
        powers = (np.bincount(blocks, weights=rows * usable) for rows in (rest, swings))
        size, whole = (np.sqrt(power / np.maximum(count, 1.0)) for power in powers)
        usual = float(np.median(size[count > 0]))
        pushed = usable & (size > np.maximum(PUSHED * usual, math.sqrt(PUSHED_SHARE) * whole))[blocks]
        weights = np.where(usable & ~pushed, usual / np.maximum(size, LEAST_SIZE * usual)[blocks], 0.0)
    return weights, pushed


#: the robot's wheel (from 0) of the file's wheels in turn, and their signs
_Arrangement = tuple[tuple[int, ...], tuple[int, ...]]


def _evenly_spaced(robot: Robot) -> bool:
    beta, step = np.asarray(robot.wheels.azimuths), 2j * np.pi / robot.wheel_count
    return np.allclose(np.exp(1j * np.diff(beta)), np.exp(step), atol=1e-3)


def _every_arrangement(robot: Robot) -> list[_Arrangement]:
    """Return every order and every choice of signs of the file's wheels, up to a turn of the robot and all signs."""
    n, even = robot.wheel_count, _evenly_spaced(robot)
    orders = [p for p in permutations(range(n)) if p[0] == 0 or not even]
    # the fewest wheels are reversed; of half of them, not the first
    signs = [s for s in product((1, -1), repeat=n) if 2 * sum(s) + s[0] > 0]
    return list(product(orders, signs))


def _ranked_placements(
    robot: Robot, law: _LeanLaw, heading: Smooth | None, weights: Floats, gamma: float
) -> tuple[list[Placement], float]:
    """Return all placements, the best first, and the confidence in the best; `law` gives each wheel its own gains.

    A placement is behind the best by the jackknife of the best's gain, or by so much that few seconds are enough.
    """
    every, wheels, n = _every_arrangement(robot), law.wheels, robot.wheel_count
    lean_sums = _sums(np.column_stack([law.columns, law.driven]) * weights[:, None], weights)
    rate = np.zeros(len(weights)) if heading is None else heading.rate[:, 0]
    table = np.column_stack([wheels.rate, rate])
    table = np.where(weights[:, None] > 0.0, table - table[weights > 0.0].mean(axis=0), 0.0)
    wheel_sums = _sums(table.astype(np.complex128), weights).real
    of_lean, of_wheels = lean_sums.sum(axis=0), wheel_sums.sum(axis=0)
    gain, unexplained, together, score = _scores(robot, every, of_lean, of_wheels)
    gained, z = gains_over(score, _scores(robot, every, of_lean - lean_sums, of_wheels - wheel_sums)[-1])
    seconds = len(lean_sums) * BLOCK
    if seconds < SHORT_TIME:
        z = np.where(gained < math.log(SHORT_MARGIN), np.minimum(z, 1.0 / ERRORS_WEIGHT), z)
    usual = {tuple(range(n)): OWN_ORDER, (0, *range(n - 1, 0, -1)): MIRRORED_ORDER}
    rare = (1.0 - OWN_ORDER - MIRRORED_ORDER) / len({order for order, _ in every})
    of_signs = (1.0 - EQUAL_SIGNS) / (2 ** (n - 1) - 1), EQUAL_SIGNS
    prior = [usual.get(order, rare) * of_signs[len(set(signs)) == 1] for order, signs in every]
    probability = posterior(prior, behind(z, gained, seconds, each_second=EACH_SECOND))
    ranked = sorted(probability, key=lambda h: (-probability[h], score[h]))
    likely, first = [h for h in ranked if probability[h] > TINY_PROBABILITY], every[ranked[0]]
    shown = sum(probability[h] for h in likely if _same_wheels(wheels.value, first, every[h]))
    explained = (LARGEST_REST - float(unexplained.min())) / (LARGEST_REST - USUAL_REST)
    placements = [
        Placement(
            positions=tuple(wheel + 1 for wheel in every[h][0]),
            signs=every[h][1],
            phase=float(np.angle(gain[h])),
            gain=float(abs(gain[h])) / gamma,
            unexplained=float(unexplained[h]),
            together=float(together[h]),
            misfit=float(np.exp(score[h])),
        )
        for h in ranked
    ]
    return placements, min(shown, MOST) * min(max(explained, 0.0), 1.0)


def _same_wheels(angles: Floats, first: _Arrangement, second: _Arrangement) -> bool:
    """Return whether two placements give the robot's wheels the same angles, up to a turn of the robot and all signs.

    With four wheels and a heading that stands still, opposite wheels have opposite angles.
    """
    n = angles.shape[1]
    moved = angles - angles.mean(axis=0)
    mine, others = ((moved * signs)[:, np.argsort(order)] for order, signs in (first, second))
    allowed = SAME_WHEELS * np.maximum(mine.std(axis=0), 1e-9)
    turned = [sign * np.roll(others, turn, axis=1) for turn in range(n) for sign in (1.0, -1.0)]
    return any(bool(np.all(np.std(mine - angles, axis=0) < allowed)) for angles in turned)


def _scores(
    robot: Robot, every: Sequence[_Arrangement], lean_sums: Complex, wheel_sums: Floats
) -> tuple[Complex, Floats, Floats, Floats]:
    """Return gain, what is unexplained and together, and the score (.., H) of every placement.

    They are by products of columns (.., k, k): each wheel's and the lean's; the wheels' and the heading's.
    """
    orders, signs = (np.array(part) for part in zip(*every, strict=True))
    angles = np.asarray(robot.wheels.azimuths)[orders]
    ways, (H, n) = signs * np.exp(1j * angles), signs.shape
    C = np.zeros((H, 2 * n + 1, 3), dtype=np.complex128)
    C[:, :n, 0], C[:, n : 2 * n, 1], C[:, 2 * n, 2] = ways, ways, 1.0
    G, r, y = lean_sums[..., None, :-1, :-1], lean_sums[..., :-1, -1], lean_sums[..., -1, -1].real[..., None]
    left = C.conj().transpose(0, 2, 1)
    normal, right = left @ G @ C, (left @ r[..., None, :, None])[..., 0]
    size = np.trace(normal, axis1=-2, axis2=-1).real[..., None, None]
    solution = np.linalg.solve(normal + 1e-12 * size * np.eye(3), right[..., None])[..., 0]
    offset = np.abs(r[..., -1:]) ** 2 / np.maximum(G[..., -1, -1].real, TINY)
    rest = y - np.sum(right.conj() * solution, axis=-1).real
    unexplained = np.maximum(rest, TINY) / np.maximum(y - offset, TINY)
    together = _together(signs, angles, wheel_sums)
    score = np.log(unexplained) + 0.5 * np.log(together + LEAST_TOGETHER)
    return solution[..., 0].astype(np.complex128), unexplained, together, score


def _together(signs: NDArray[np.intp], angles: Floats, sums: Floats) -> Floats:
    """Return the share (.., H) of the wheels' motion that is neither lean nor, together, heading.

    By the signs and azimuths (H, n) of placements, and products (.., n + 1, n + 1) of wheels and heading.
    """
    n = signs.shape[1]
    columns = np.stack([np.full_like(angles, n**-0.5), np.cos(angles), np.sin(angles)], axis=-1)
    basis = np.linalg.qr(columns)[0] * signs[..., None]  # of what all share, and of the lean
    G, crossed, rate = sums[..., None, :n, :n], sums[..., None, :n, n:], sums[..., n, n, None]
    shared, *leans = np.moveaxis(np.sum(basis * (G @ basis), axis=-2), -1, 0)
    of_heading = np.sum(basis[..., :1] * crossed, axis=(-2, -1)) ** 2 / np.maximum(rate, TINY)
    without = (1.0 - UNKNOWN_HEADING) * shared if n > 3 else 0.0
    whole = np.trace(G, axis1=-2, axis2=-1)
    left = whole - sum(leans) - np.where(rate > 0.0, of_heading, without)
    return np.maximum(left, 0.0) / np.maximum(whole, TINY)


@dataclass(frozen=True, kw_only=True)
class SensorFrame:
    """How the file's wheels and IMU sit on the robot."""

    order: tuple[int, ...]  #: for the robot's wheels in turn, the file's wheel (from 1)
    signs: tuple[int, ...]  #: of the file's wheels, in the file's order
    turn: float  #: of the IMU's x axis from the robot's [rad], rounded to `GRID` if it is near
    measured_turn: float  #: [rad], as the log has it
    axis_signs: tuple[int, int, int] = (1, 1, 1)  #: of roll, pitch and yaw
    direction: float = 0.5  #: confidence in the direction in which all wheels count
    handedness: float = 1.0  #: confidence that no other axis of the IMU is reversed


def frame_of(robot: Robot, tested: LeanTest | None, shows: float = 0.0) -> SensorFrame:
    """Return the likeliest frame; the robot's own if there is no lean to test.

    `shows` is the logarithm of the odds, by the gyro or the tilts, that lean and yaw have one handedness. A robot of
    evenly spaced wheels that is turned by the angle between two of them, with its wheels renamed, makes the same log,
    and so does its mirror image with another axis reversed: the most usual frame of these is the answer (`_unusual`).
    """
    count = robot.wheel_count
    own = tuple(range(1, count + 1))
    if tested is None:
        return SensorFrame(order=own, signs=(1,) * count, turn=0.0, measured_turn=0.0)
    best, heading, beta = tested.placements[0], tested.heading, robot.wheels.azimuths
    z = (STILL_WEIGHT if tested.headings < STILL_HEADING else 1.0) * tested.handedness
    shown = math.copysign(z**2, z) + shows if heading else 0.0
    same = 1.0 / (1.0 + math.exp(-max(min(shown, MOST_ODDS), -MOST_ODDS)))
    turns = range(count if _evenly_spaced(robot) else 1)
    forms = [((1, 1, 1), best.positions, best.phase)]
    if same < 1.0 - CONFIDENT:  # one handedness is usual, and is taken if the log leaves it open
        mirrored = tuple((1 - position) % count + 1 for position in best.positions)
        forms = [((1, 1, -1), best.positions, best.phase)]
        forms += [((1, -1, 1), mirrored, -best.phase - 2.0 * beta[0])] if len(turns) > 1 else []
    known = heading is not None and heading.confidence >= CONFIDENT
    seen = float(advantage_confidence(np.array(abs(tested.handedness)))) if heading is None else 0.5
    by_wheels = max(seen, EQUAL_DIRECTIONS)
    if tested.headings > TURNING_BY_WHEELS:
        by_wheels = seen if abs(tested.handedness) > SURELY else 0.5
    error = tested.phase_error if tested.phase_error is not None else ROUNDED
    frames = list[SensorFrame]()
    # without a heading both directions in which all wheels count make nearly the same log
    counts = -heading.correlation if heading and known else tested.handedness if seen >= CONFIDENT else 0.0
    for (axes, positions, phase), k, way in product(forms, turns, (1, -1)):
        if way * counts * (axes[2] if known else 1) < 0.0:
            continue
        turn = -float(np.angle(way * np.exp(1j * (phase - 2.0 * np.pi * k / count))))
        near = GRID * round(turn / GRID)
        rounded = abs(turn - near) <= min(ROUNDED, ROUNDED_ERRORS * error + np.deg2rad(1.0))
        moved = [(position - 1 + k) % count + 1 for position in positions]
        frame = SensorFrame(
            order=tuple(moved.index(position) + 1 for position in own),
            signs=tuple(way * sign for sign in best.signs),
            turn=float(near if rounded else turn),
            measured_turn=turn,
            axis_signs=axes,
            direction=by_wheels if heading is None else heading.confidence,
            # without a heading that turns, the other handedness gives the same log
            handedness=max(same, 1.0 - same) if known else 0.97,
        )
        frames.append(frame)
    return min(frames, key=_unusual)


def _unusual(frame: SensorFrame) -> tuple[object, ...]:
    """Return what is unusual in a frame, the weightiest first: a turn, renamed wheels, a large turn, reversed signs."""
    renamed = frame.order != tuple(sorted(frame.order))
    # a turn to either side counts as one but for its rounding
    return frame.turn != 0.0, renamed, round(abs(frame.turn), 3), sum(frame.signs) < 0, frame.order
