"""Where the wheels sit, from a log of balancing, without its torques.

While a ball rolls, the torque between body and ball drops out of the sum of their equations. To first order, with the
lean Theta = theta + j phi in the body's frame and wheel speeds w_i at azimuths beta_i,

    Theta_ddot = kappa Theta + gamma W_dot + rho W/|W| + offset,        W = sum_i w_i e^{j beta_i}

    gamma = b / ((a + b) (n/2) (r_b / r_w) cos alpha),      kappa = m_r g l / (a + b)

    b = r_b (r_b M_11 + M_21),   a = r_b M_12 + M_22,   M the mass matrix of (x, phi) at rest

rho is the ball's rolling friction, which acts from outside. kappa is the robot's: in a log of small leans it is hardly
seen, and a free one takes from gamma. gamma is real and positive, so the angle of the one estimated from a log is by
how much the wheels are turned against the IMU, and a log that follows the conjugate of W has its wheels numbered in the
opposite direction, or an IMU with one axis reversed. Every order of the wheels and every choice of their signs is
fitted. A wrong one shows twice: it explains the lean's acceleration less well, and it leaves motion of the wheels that
is neither lean nor heading.

Which IMU axis is reversed shows only while the heading turns. In the frame of the IMU a derivative is D = d/dt + j
sigma psi_dot, with sigma = 1 if yaw and lean have the same handedness and -1 if not:

    D^2 Theta = kappa Theta + gamma D W + ..

Every fit is made in that frame, with the sigma that explains the lean better if each wheel has a gain of its own: a
robot that turns its heading while it rolls has a D W that is as large as W_dot, and without it gamma is too small by a
third, and off by 17 degrees, in the worst of the development logs.

Where nothing measures the heading, the wheels give it, up to the direction in which all of them count: a ball that does
not spin turns them by psi_dot alike (`ballbot.log.mapping_search.frame`). A mirrored IMU with mirrored wheels makes
the same log then, so that the lean counts as right-handed, and sigma = -1 says that all wheels count backwards.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm
from scipy.stats import t as student

from ballbot.log.checks.lean import block_sums, clarity
from ballbot.log.mapping_search.evidence import ERRORS_WEIGHT, jackknife_error
from ballbot.log.mapping_search.placements import (
    LEAST_RATIO,
    Placement,
    block_numbers,
    each_wheel,
    lean_sums_of,
    placement_way,
    ranked_placements,
)
from ballbot.log.signals import INTERVAL, Smooth
from ballbot.robot import Robot

#: lean later than wheels that is tried [s]: an IMU's filter takes 15 to 20 ms. Whole rows: between them, interpolation
#: smooths, which looks like a better fit
LAGS = INTERVAL * np.arange(-1.0, 11.0)
#: a block is a push, not balancing, if its residual is this many times the median block's, and this share of the lean's
#: acceleration in it: quick motion leaves more, too. The share is 0.19 to 0.94 in the blocks of hands and lifts of a
#: course robot's log, and at most 0.06 in those of undisturbed twins whose residual is large
PUSHED, PUSHED_SHARE = 3.0, 0.12
FIT_ROUNDS = 4
#: a block's residual counts as at least this part of the median block's
LEAST_SIZE = 0.3
#: lean later than wheels at which the weights are first found [s]
USUAL_LAG = 0.0175
#: over which disturbance and gravity are compared [s], about the time in which the robot falls
SLOW = 0.25
#: two explanations whose residuals differ by less than this part are one: the heading stands still
ALIKE = 0.01
#: the fewest seconds of balancing
LEAST_TIME = 3.0


@dataclass(frozen=True, kw_only=True)
class LeanTest:
    """What the torque-free test found."""

    placements: tuple[Placement, ...]  #: best first
    confidence: float  #: in the best one
    phase_error: float | None  #: standard error of the best one's phase [rad]; None with too few blocks
    gain_error: float  #: standard error of the logarithm of the best one's gain
    lag: float  #: lean later than wheels [s]
    lag_error: float  #: its standard error [s]
    same_handedness: float  #: by how many standard errors sigma = 1 is better than -1; 0 without yaw
    forwards: float  #: the same with the heading that the wheels give; 0 with a yaw
    body_frame: (
        float  #: by how many standard errors lean about the body's axes fits better than about the world's
    )
    headings: float  #: standard deviation of the heading [rad]: how much the two differ; a constant is part of the turn
    disturbance: float  #: root mean square of the lean's unexplained acceleration, over gravity's share of it
    balancing: NDArray[np.bool_]  #: (N,), the even rows that were judged
    pushed: NDArray[np.bool_]  #: (N,), rows left out because something pushed the robot

    @property
    def gain(self) -> float | None:
        """Response of the lean to the wheels over the robot's, by the best placement; None if that one is in doubt."""
        return self.placements[0].gain if self.confidence > 0.5 else None

    @property
    def margin(self) -> float:
        """How many times worse the next best placement fits."""
        first, second = self.placements[:2]
        return second.misfit / max(first.misfit, 1e-12)


def torque_free_gains(robot: Robot) -> tuple[float, float]:
    """Return kappa [1/s^2] and gamma [-] of the module's text."""
    from ballbot.mechanics.model import Model

    M = Model(robot).mass_matrix(np.zeros(5))
    r_b, body = robot.ball.radius, robot.body
    b = r_b * (r_b * M[0, 0] + M[3, 0])
    a = r_b * M[0, 3] + M[3, 3]
    wheels = 0.5 * robot.wheel_count * r_b / robot.wheels.radius * np.cos(robot.wheels.tilt)
    kappa = body.mass * robot.gravity * body.center_of_mass / (a + b)
    return float(kappa), float(b / ((a + b) * wheels))


def lean_test(
    robot: Robot,
    lean: Smooth,
    wheels: Smooth,
    heading: Smooth | None,
    usable: NDArray[np.bool_],
) -> LeanTest | None:
    """Find how the wheels sit.

    Parameters
    ----------
    robot : Robot
        Three wheels or more.
    lean : Smooth (N, 2)
        Roll and pitch [rad].
    wheels : Smooth (N, n)
        Angles [rad], in the file's order and with its signs.
    heading : Smooth (N, 1), optional
        Yaw [rad].
    usable : ndarray (N,)
        Rows of the robot moving on its ball, not falling.

    Returns
    -------
    LeanTest or None
        None if too little of the log is balancing.
    """
    # rows at the ends, where the lag looks past the log and fits have one side
    usable = usable.copy()
    edge = round(0.3 / INTERVAL)
    usable[:edge] = usable[-edge:] = False
    if usable.sum() * INTERVAL < LEAST_TIME:
        return None
    kappa, gamma = torque_free_gains(robot)
    law = _Law(lean=lean, wheels=wheels, heading=heading, kappa=kappa, lag=USUAL_LAG, sigma=0.0)
    law = _turning_by_wheels(robot, law, usable, gamma) if heading is None else _turning(law, usable)
    weights, pushed = _weights(law, usable)
    lag, lag_error = _best_lag(law, weights)
    law = replace(law, lag=lag)
    weights, pushed = _weights(law, usable)
    balanced, usable = usable, usable & ~pushed
    driven = law.driven
    placements, confidence = ranked_placements(robot, driven, law.rolled, wheels, heading, weights, gamma)
    best = placements[0]
    turned_to = _heading_of(robot, wheels, best) if heading is None else heading
    turning = law.turning(robot, best)
    gains = _block_gains(turning, driven, weights)
    rest = driven - turning @ _solve(turning, driven, weights)
    gravity = kappa * (lean.value[:, 0] + 1j * lean.value[:, 1])
    turned = np.angle(gains * np.exp(-1j * best.phase))
    phase_error = jackknife_error(turned)
    return LeanTest(
        placements=tuple(placements),
        confidence=confidence,
        phase_error=None if math.isnan(phase_error) else phase_error,
        gain_error=jackknife_error(np.log(np.abs(gains))),
        lag=lag,
        lag_error=lag_error,
        same_handedness=0.0 if heading is None else _handedness(robot, law, best, weights),
        forwards=_handedness(robot, replace(law, heading=turned_to), best, weights)
        if heading is None
        else 0.0,
        body_frame=0.0 if heading is None else _body_frame(robot, law, best, weights),
        # with the rows of pushes: a lean about other axes looks like one where the heading is away from its mean
        headings=float(np.std(turned_to.value[balanced])),
        disturbance=float(np.std(_slow(rest)[usable]) / np.std(_slow(gravity)[usable])),
        balancing=usable,
        pushed=pushed,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Law:
    """Both sides of the law of the module's text, in the frame of the IMU, which turns."""

    lean: Smooth
    wheels: Smooth
    heading: Smooth | None
    kappa: float  #: [1/s^2]
    lag: float  #: lean later than wheels [s]
    sigma: float  #: 1 if lean and yaw have one handedness, -1 if not, 0 for a frame that stands still

    @property
    def turn_rate(self) -> NDArray[np.float64]:
        """sigma psi_dot (N,) [rad/s], later by the lag as the lean is."""
        if self.heading is None or not self.sigma:
            return np.zeros(len(self.lean.value))
        return self.sigma * _later(np.repeat(self.heading.rate, 2, axis=1), self.lag).real

    @property
    def accelerated(self) -> NDArray[np.complex128]:
        """D^2 Theta (N,)."""
        value, rate, acceleration = (
            _later(part, self.lag) for part in (self.lean.value, self.lean.rate, self.lean.acceleration)
        )
        if self.heading is None or not self.sigma:
            return acceleration
        turn = self.turn_rate
        changing = self.sigma * _later(np.repeat(self.heading.acceleration, 2, axis=1), self.lag).real
        return acceleration + 2j * turn * rate + (1j * changing - turn**2) * value

    @property
    def driven(self) -> NDArray[np.complex128]:
        """D^2 Theta - kappa Theta (N,), a lag later: what the wheels must explain."""
        return self.accelerated - self.kappa * _later(self.lean.value, self.lag)

    @property
    def rolled(self) -> NDArray[np.complex128]:
        """The columns (N, 2 n + 1) of `each_wheel`."""
        return each_wheel(self.wheels, self.turn_rate)

    def turning(self, robot: Robot, placement: Placement) -> NDArray[np.complex128]:
        """Return D W, W/|W| and ones (N, 3)."""
        way, n = placement_way(robot, placement), self.wheels.rate.shape[1]
        rolled = self.rolled
        return np.column_stack([rolled[:, :n] @ way, rolled[:, n : 2 * n] @ way, rolled[:, -1]])

    def left(
        self, columns: NDArray[np.complex128], driven: NDArray[np.complex128], weights: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the squares (B,) that a fit of columns leaves of what is driven, weighted, by blocks."""
        rest = np.abs((driven - columns @ _solve(columns, driven, weights)) * weights) ** 2
        return block_sums(rest, block_numbers(len(rest)))


def _turning(law: _Law, usable: NDArray[np.bool_], sigmas: Sequence[float] = (1.0, -1.0)) -> _Law:
    """Return the law with the sigma with which wheels that have gains of their own explain the lean better."""
    weights, _ = _weights(law, usable)
    turned = [replace(law, sigma=sigma) for sigma in sigmas]
    return min(turned, key=lambda one: float(one.left(one.rolled, one.driven, weights).sum()))


def _turning_by_wheels(robot: Robot, law: _Law, usable: NDArray[np.bool_], gamma: float) -> _Law:
    """Return the law with the heading that the wheels give, as the likeliest placement without one has them."""
    weights, _ = _weights(law, usable)
    ranked, _ = ranked_placements(robot, law.driven, law.rolled, law.wheels, None, weights, gamma)
    return _turning(replace(law, heading=_heading_of(robot, law.wheels, ranked[0])), usable, (0.0, 1.0, -1.0))


def _heading_of(robot: Robot, wheels: Smooth, placement: Placement) -> Smooth:
    """Return the heading (N, 1) [rad] by the wheels of a ball that does not spin, if they count as the robot's do."""
    wheel = robot.wheels
    turns = robot.wheel_count * robot.ball.radius / wheel.radius * math.sin(wheel.tilt)
    way = -np.asarray(placement.signs, dtype=np.float64)[:, None] / turns
    return Smooth(value=wheels.value @ way, rate=wheels.rate @ way, acceleration=wheels.acceleration @ way)


def _block_gains(
    turning: NDArray[np.complex128], driven: NDArray[np.complex128], weights: NDArray[np.float64]
) -> NDArray[np.complex128]:
    """Return gamma (B,) with each block left out."""
    sums = lean_sums_of(turning, driven, weights)
    total = sums.sum(axis=0)
    return np.array([_solved(total - one)[0] for one in sums])


def _solved(sums: NDArray[np.complex128]) -> NDArray[np.complex128]:
    return np.linalg.lstsq(sums[:-1, :-1], sums[:-1, -1], rcond=None)[0].astype(np.complex128)


def _handedness(robot: Robot, law: _Law, best: Placement, weights: NDArray[np.float64]) -> float:
    """Return by how many standard errors yaw and lean of the same handedness fit better."""
    same, opposite = (
        one.left(one.turning(robot, best), one.driven, weights)
        for one in (replace(law, sigma=1.0), replace(law, sigma=-1.0))
    )
    return _advantage(same, opposite, weights)


def _advantage(one: NDArray[np.float64], other: NDArray[np.float64], weights: NDArray[np.float64]) -> float:
    """Return by how many standard errors the first of two explanations is better, from what they leave by blocks (B,).

    Either the difference repeats in every block, or it is so large that few blocks are enough
    (`ballbot.log.mapping_search.placements`). The spread of few blocks is itself not well known: Student's t, taken
    for the normal deviate of the same probability.
    """
    used = np.bincount(block_numbers(len(weights)), weights=weights) > 0.0
    gained = (other - one)[used] / float((one + other)[used].mean())
    if len(gained) < 3:
        return 0.0
    repeated = float(norm.isf(student.sf(abs(clarity(gained)), len(gained) - 1)))
    ratio = math.log(float(other[used].sum()) / float(one[used].sum()))
    large = math.sqrt(len(gained) * max(abs(ratio) - LEAST_RATIO, 0.0)) / ERRORS_WEIGHT
    return math.copysign(max(repeated, large), ratio)


def _body_frame(robot: Robot, law: _Law, best: Placement, weights: NDArray[np.float64]) -> float:
    """Return by how many standard errors a lean about the body's axes fits better than one about the world's.

    A lean about the world's axes is that about the body's, turned by the heading. Where the heading stands still, both
    fit alike, and the IMU's turn contains the heading.
    """
    if law.heading is None:
        return 0.0
    body = law.left(law.turning(robot, best), law.driven, weights)
    still = replace(law, sigma=0.0).driven
    worlds = []
    for sigma in (1.0, -1.0):
        turned = still * np.exp(-1j * sigma * law.heading.value[:, 0])
        worlds.append(law.left(replace(law, sigma=sigma).turning(robot, best), turned, weights))
    world = min(worlds, key=lambda one: float(one.sum()))
    if abs(float(world.sum() / body.sum()) - 1.0) < ALIKE:
        return 0.0
    return _advantage(body, world, weights)


def _later(values: NDArray[np.float64], lag: float) -> NDArray[np.complex128]:
    """Return columns (N, 2), a lag later, as one complex number."""
    rows = np.arange(len(values), dtype=np.float64)
    first, second = (np.interp(rows + lag / INTERVAL, rows, column) for column in values.T)
    return first + 1j * second


def _solve(
    X: NDArray[np.complex128], y: NDArray[np.complex128], weights: NDArray[np.float64]
) -> NDArray[np.complex128]:
    # by the normal equations, columns scaled: as there are few columns and many rows, twenty times as fast as by an SVD
    weighted = X * weights[:, None]
    scale = np.sqrt(np.maximum((weighted.real**2 + weighted.imag**2).sum(axis=0), np.finfo(float).tiny))
    weighted /= scale
    adjoint = weighted.conj().T
    found = np.linalg.lstsq(adjoint @ weighted, adjoint @ (y * weights), rcond=1e-12)[0]
    return (found / scale).astype(np.complex128)


def _slow(values: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return running means over `SLOW`: what has time to make the robot fall."""
    count = round(SLOW / INTERVAL)
    return np.convolve(values, np.full(count, 1.0 / count), mode="same")


def _best_lag(law: _Law, weights: NDArray[np.float64]) -> tuple[float, float]:
    """Return the lag at which the wheels, each with a gain of its own, explain the lean best, and its error."""
    left = []
    for lag in LAGS:
        one = replace(law, lag=float(lag))
        left.append(one.left(one.rolled, one.driven, weights))
    return vertex_with_error(LAGS, np.array(left))


def _weights(law: _Law, usable: NDArray[np.bool_]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return weights (N,), one over a block's residual, and the rows of blocks that the wheels do not explain.

    Rows that are not usable, and those pushed, have weight zero.
    """
    X, driven = law.rolled, law.driven
    blocks = block_numbers(len(usable))
    count = np.bincount(blocks, weights=usable)
    weights, pushed = usable.astype(np.float64), np.zeros_like(usable)
    swings = np.abs(driven - np.average(driven, weights=weights)) ** 2
    for _ in range(FIT_ROUNDS):
        rest = np.abs(driven - X @ _solve(X, driven, weights)) ** 2
        size = np.sqrt(np.bincount(blocks, weights=rest * usable) / np.maximum(count, 1.0))
        usual = float(np.median(size[count > 0]))
        whole = np.sqrt(np.bincount(blocks, weights=swings * usable) / np.maximum(count, 1.0))
        pushed = usable & (size > np.maximum(PUSHED * usual, math.sqrt(PUSHED_SHARE) * whole))[blocks]
        weights = np.where(usable & ~pushed, usual / np.maximum(size, LEAST_SIZE * usual)[blocks], 0.0)
    return weights, pushed


def vertex_with_error(places: NDArray[np.float64], by_block: NDArray[np.float64]) -> tuple[float, float]:
    """Return where the sum over blocks of values (K, B) at K places is least, and its standard error; inf at an end."""
    total = by_block.sum(axis=1)
    if np.argmin(total) in (0, len(total) - 1):
        return vertex(places, total), math.inf  # it may lie beyond
    used = by_block.sum(axis=0) > 0.0
    each = np.array([vertex(places, total - one) for one in by_block.T[used]])
    return vertex(places, total), jackknife_error(each)


def vertex(places: NDArray[np.float64], values: NDArray[np.float64]) -> float:
    """Return where a parabola through the least of the values and its neighbours has its vertex."""
    k = int(np.clip(np.argmin(values), 1, len(places) - 2))
    before, at, after = values[k - 1 : k + 2]
    curve = before - 2.0 * at + after
    shift = 0.5 * (before - after) / curve if curve > 0.0 else 0.0
    return float(places[k] + np.clip(shift, -1.0, 1.0) * (places[1] - places[0]))
