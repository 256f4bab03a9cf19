"""The wheels' azimuths and commands, from a log of balancing: two tests of accelerations.

The azimuths need no torque. While a ball rolls, the torque between body and ball cancels in the sum of their equations.
To first order, with the lean Theta = theta + j phi in the body's frame and wheel speeds w_i at
azimuths beta_i,

    Theta_ddot = kappa Theta + gamma W_dot + rho W/|W| + offset,        W = sum_i w_i e^{j beta_i}

    gamma = b / ((a + b) (n/2) (r_b / r_w) cos alpha),      kappa = m_r g l / (a + b)

    b = r_b (r_b M_11 + M_21),   a = r_b M_12 + M_22,   M the mass matrix of (x, phi) at rest

rho is the ball's rolling friction, an external force. kappa is the robot's: a log of small leans hardly determines it,
and as a free parameter it would bias gamma. gamma is real and positive, so that the angle of the fitted one is the
angle between wheels and IMU. A log that follows the conjugate of W has its wheels numbered in the opposite direction,
or an IMU with one axis reversed. A wheel with a reversed sign fits neither, and shows twice: the lean's acceleration is
explained less well, and the sum of the wheel speeds, which only the heading changes, is as large as any other.

Which command drives which wheel, with which sign and how late, follows from the wheels' accelerations:

    w_dot = G u(t - d) + friction's terms in w

Each wheel's own command has the largest gain in its row of G: the ball transmits at most half of the others', with the
opposite sign. d is the delay at which the commands, held as logged, explain the accelerations best. (The lean is no
regressor: commands are computed from the lean, and the gain would be divided between them.)
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from ballbot.log.signals import INTERVAL, Smooth, smooth
from ballbot.robot import Robot

#: delays of the lean relative to the wheels that are tried [s]: an IMU's filter takes 15 to 20 ms. Whole rows, since
#: interpolation between them smooths, which improves the fit
LAGS = INTERVAL * np.arange(-1.0, 11.0)
#: length of the blocks [s], each with one weight, one over its residual's size; the jackknife excludes one at a time
BLOCK = 1.0
#: a block whose residual is this many times the median block's is a push, not balancing
PUSHED = 3.0
FIT_ROUNDS = 4
#: least residual of a block for its weight, relative to the median block's
LEAST_SIZE = 0.3
#: delay of the lean with which the weights are first computed [s]
USUAL_LAG = 0.0175
#: averaging time for the comparison of disturbance and gravity [s], about the time in which the robot falls
SLOW = 0.25
#: wheel speed (root of the sum of squares) below which the ball hardly rolls, and rolling friction has no sign [rad/s]
ROLLING = 0.2
#: the fewest seconds of balancing
LEAST_TIME = 3.0


@dataclass(frozen=True, kw_only=True)
class Placement:
    """One placement of the wheels' columns on the robot, and its agreement with the log."""

    mirrored: bool  #: whether the wheels are numbered in the opposite direction to the robot's
    flipped: int | None  #: the wheel (from 1) whose sign is opposite to the others'
    phase: float  #: [rad], the angle of gamma
    gain: float  #: its size, over the robot's own gamma
    unexplained: float  #: fraction of the lean's acceleration
    together: float  #: fraction of the wheels' motion in which all turn together, without that of the heading
    misfit: float  #: unexplained, times the root of together

    @property
    def description(self) -> str:
        """The placement in a few words."""
        order = "mirrored" if self.mirrored else "as the robot's"
        return order if self.flipped is None else f"{order}, wheel {self.flipped} reversed"


@dataclass(frozen=True, kw_only=True)
class LeanTest:
    """Results of the torque-free test."""

    placements: tuple[Placement, ...]  #: best first
    phase_error: (
        float | None
    )  #: standard error of the best one's phase [rad], by the jackknife over blocks of a second
    lag: float  #: lean later than wheels [s]
    disturbance: (
        float  #: root mean square of the lean's unexplained acceleration, over that of gravity's part
    )
    balancing: NDArray[np.bool_]  #: (N,), the even rows that were used
    pushed: NDArray[np.bool_]  #: (N,), rows excluded because something pushed the robot

    @property
    def margin(self) -> float:
        """Misfit of the next best placement over that of the best."""
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
    """Find the placement of the wheels.

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
    # not the ends, at which the lag reaches beyond the log and fits are one-sided
    usable = usable.copy()
    edge = round(0.3 / INTERVAL)
    usable[:edge] = usable[-edge:] = False
    if usable.sum() * INTERVAL < LEAST_TIME:
        return None
    kappa, gamma = torque_free_gains(robot)
    weights, pushed = _weights(_driven(lean, kappa, USUAL_LAG), wheels, usable)
    lag = _best_lag(lean, wheels, weights, kappa)
    driven = _driven(lean, kappa, lag)
    weights, pushed = _weights(driven, wheels, usable)
    usable = usable & ~pushed
    placements = _placements(robot, driven, wheels, heading, weights, gamma)
    best = placements[0]
    turning = _turning(robot, wheels, wheel_signs(robot.wheel_count, best.flipped), mirrored=best.mirrored)
    _, rest = _fit(driven, turning, weights)
    gravity = kappa * (lean.value[:, 0] + 1j * lean.value[:, 1])
    return LeanTest(
        placements=tuple(placements),
        phase_error=_phase_error(driven, turning, weights),
        lag=lag,
        disturbance=float(np.std(_slow(rest)[usable]) / np.std(_slow(gravity)[usable])),
        balancing=usable,
        pushed=pushed,
    )


def _placements(
    robot: Robot,
    driven: NDArray[np.complex128],
    wheels: Smooth,
    heading: Smooth | None,
    weights: NDArray[np.float64],
    gamma: float,
) -> list[Placement]:
    """Return all placements, the best first."""
    placements = []
    for mirrored, flipped in product((False, True), (None, *range(1, robot.wheel_count + 1))):
        signs = wheel_signs(robot.wheel_count, flipped)
        gain, rest = _fit(driven, _turning(robot, wheels, signs, mirrored=mirrored), weights)
        unexplained = _size(rest, weights) / _size(driven - np.average(driven, weights=weights**2), weights)
        together = _together(wheels, heading, signs, weights > 0.0)
        placements.append(
            Placement(
                mirrored=mirrored,
                flipped=flipped,
                phase=float(np.angle(gain)),
                gain=float(abs(gain)) / gamma,
                unexplained=unexplained,
                together=together,
                misfit=unexplained * together**0.5,
            )
        )
    return sorted(placements, key=lambda placement: placement.misfit)


def wheel_signs(count: int, flipped: int | None) -> NDArray[np.float64]:
    """Return ones (n,), with minus one for the wheel (from 1) that is flipped."""
    signs = np.ones(count)
    if flipped is not None:
        signs[flipped - 1] = -1.0
    return signs


def _turning(
    robot: Robot, wheels: Smooth, signs: NDArray[np.float64], *, mirrored: bool
) -> NDArray[np.complex128]:
    """Return W_dot, W/|W| and ones (N, 3)."""
    beta = np.asarray(robot.wheels.azimuths)
    way = signs * np.exp(1j * (-beta if mirrored else beta))
    columns = [wheels.acceleration @ way, _direction(wheels) @ way, np.ones(len(wheels.rate))]
    return np.column_stack(columns).astype(np.complex128)


def _driven(lean: Smooth, kappa: float, lag: float) -> NDArray[np.complex128]:
    """Return Theta_ddot - kappa Theta (N,) a lag later, which the wheels must explain."""
    rows = np.arange(len(lean.value), dtype=np.float64)
    driven = lean.acceleration - kappa * lean.value
    columns = [np.interp(rows + lag / INTERVAL, rows, column) for column in driven.T]
    return columns[0] + 1j * columns[1]


def _fit(
    driven: NDArray[np.complex128], turning: NDArray[np.complex128], weights: NDArray[np.float64]
) -> tuple[complex, NDArray[np.complex128]]:
    """Return the gain and the residual (N,)."""
    found = _solve(turning, driven, weights)
    return complex(found[0]), driven - turning @ found


def _solve(
    X: NDArray[np.complex128], y: NDArray[np.complex128], weights: NDArray[np.float64]
) -> NDArray[np.complex128]:
    rows = weights > 0.0
    found = np.linalg.lstsq(X[rows] * weights[rows, None], y[rows] * weights[rows], rcond=None)[0]
    return found.astype(np.complex128)


def _size(values: NDArray[np.complex128], weights: NDArray[np.float64]) -> float:
    """Return the weighted sum of squares."""
    return float(((np.abs(values) * weights) ** 2).sum())


def _slow(values: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return running means over `SLOW`, which last long enough to make the robot fall."""
    count = round(SLOW / INTERVAL)
    return np.convolve(values, np.full(count, 1.0 / count), mode="same")


def _each_wheel(wheels: Smooth) -> NDArray[np.complex128]:
    """Return columns (N, 2 n + 1) that give every wheel gains of its own."""
    ones = np.ones(len(wheels.rate))
    return np.column_stack([wheels.acceleration, _direction(wheels), ones]).astype(np.complex128)


def _direction(wheels: Smooth) -> NDArray[np.float64]:
    """Return the wheels' speeds (N, n) over their size: the direction in which the ball rolls."""
    size = np.sqrt((wheels.rate**2).sum(axis=1, keepdims=True))
    return wheels.rate / (size + ROLLING)


def _best_lag(lean: Smooth, wheels: Smooth, weights: NDArray[np.float64], kappa: float) -> float:
    """Return the lag at which the wheels, each with a gain of its own, explain the lean best."""
    X = _each_wheel(wheels)
    left = []
    for lag in LAGS:
        y = _driven(lean, kappa, float(lag))
        left.append(_size(y - X @ _solve(X, y, weights), weights))
    return vertex(LAGS, np.array(left))


def vertex(places: NDArray[np.float64], values: NDArray[np.float64]) -> float:
    """Return the vertex of a parabola through the smallest value and its neighbours."""
    k = int(np.clip(np.argmin(values), 1, len(places) - 2))
    before, at, after = values[k - 1 : k + 2]
    curve = before - 2.0 * at + after
    shift = 0.5 * (before - after) / curve if curve > 0.0 else 0.0
    return float(places[k] + np.clip(shift, -1.0, 1.0) * (places[1] - places[0]))


def _weights(
    driven: NDArray[np.complex128], wheels: Smooth, usable: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return weights (N,), one over a block's residual, and the rows of blocks that the wheels do not explain.

    Rows that are not usable, and those pushed, have weight zero.
    """
    X = _each_wheel(wheels)
    blocks = np.arange(len(usable)) // round(BLOCK / INTERVAL)
    count = np.bincount(blocks, weights=usable)
    weights, pushed = usable.astype(np.float64), np.zeros_like(usable)
    for _ in range(FIT_ROUNDS):
        rest = np.abs(driven - X @ _solve(X, driven, weights)) ** 2
        size = np.sqrt(np.bincount(blocks, weights=rest * usable) / np.maximum(count, 1.0))
        usual = float(np.median(size[count > 0]))
        pushed = usable & (size > PUSHED * usual)[blocks]
        weights = np.where(usable & ~pushed, usual / np.maximum(size, LEAST_SIZE * usual)[blocks], 0.0)
    return weights, pushed


def _together(
    wheels: Smooth, heading: Smooth | None, signs: NDArray[np.float64], usable: NDArray[np.bool_]
) -> float:
    """Return the fraction of the wheels' motion in their sum, without heading; 1 if all wheels turn alike."""
    speeds = wheels.rate[usable]
    total = speeds @ signs
    total = total - total.mean()
    if heading is not None:
        rate = heading.rate[usable, 0]
        rate = rate - rate.mean()
        total = total - rate * (rate @ total) / max(float(rate @ rate), 1e-12)
    return float((total @ total) / max(float(((speeds - speeds.mean(axis=0)) ** 2).sum()), 1e-12))


def _phase_error(
    driven: NDArray[np.complex128], turning: NDArray[np.complex128], weights: NDArray[np.float64]
) -> float | None:
    """Return the standard error of the gain's angle [rad] by the jackknife over blocks; None with too few of them."""
    X = turning * weights[:, None]
    y = driven * weights
    blocks = np.arange(len(weights)) // round(BLOCK / INTERVAL)
    normals, rights = [], []
    for block in np.unique(blocks[weights > 0.0]):
        rows = blocks == block
        normals.append(X[rows].conj().T @ X[rows])
        rights.append(X[rows].conj().T @ y[rows])
    normal, right = np.sum(normals, axis=0), np.sum(rights, axis=0)
    if len(normals) < 3:
        return None
    angles = np.array(
        [
            np.angle(np.linalg.lstsq(normal - one, right - other, rcond=None)[0][0])
            for one, other in zip(normals, rights, strict=True)
        ]
    )
    turned = np.angle(np.exp(1j * (angles - angles[0])))  # no jump at half a turn
    count = len(angles)
    return float(np.sqrt((count - 1) / count * ((turned - turned.mean()) ** 2).sum()))


#: command delays that are tried [s], whole rows as in `lean_test`
DELAYS = INTERVAL * np.arange(-1.0, 13.0)
#: narrower than for the lean: an encoder has less noise than an IMU, and delays show in fast motion
COMMAND_WIDTH = 0.01
#: scale of the smoothed sign of dry friction [rad/s]
SIGN_SPEED = 0.3
#: ridge of the normal equations, relative to the signals' size
RIDGE = 1e-3
#: explained fraction below which the commands do not drive these wheels
LEAST_EXPLAINED = 0.2


@dataclass(frozen=True, kw_only=True)
class CommandTest:
    """The command that drives each wheel."""

    order: tuple[int, ...]  #: for the file's wheels in turn, which command (from 1) drives it
    signs: tuple[int, ...]  #: whether that command turns it forward
    gains: tuple[tuple[float, ...], ...]  #: G [rad/s^2 a unit of command], by wheel and command
    delay: float  #: d [s]
    explained: float  #: explained fraction of the accelerations
    #: the gains' sum in this order over that in the next best; None if all commands are alike
    margin: float | None


def held_commands(
    rows: NDArray[np.float64], t: NDArray[np.float64], commands: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the commands (M, n) logged at t, held until the next, on other times (N,)."""
    latest = np.searchsorted(t, rows, side="right") - 1
    return commands[np.maximum(latest, 0)]


def command_test(
    rows: NDArray[np.float64],
    wheels: Smooth,
    commands: NDArray[np.float64],
    usable: NDArray[np.bool_],
) -> CommandTest | None:
    """Find which command drives which wheel.

    Parameters
    ----------
    rows : ndarray (N,)
        [s], even.
    wheels : Smooth (N, n)
        Of width `COMMAND_WIDTH`; all counting in the same direction.
    commands : ndarray (N, n)
        As `held_commands` returns them.
    usable : ndarray (N,)

    Returns
    -------
    CommandTest or None
        None if the commands do not explain the wheels.
    """
    if usable.sum() * INTERVAL < 1.0 or not np.all(commands[usable].std(axis=0) > 0.0):
        return None
    alike = np.allclose(commands, commands[:, :1])
    smoothed = smooth(rows, rows, commands[:, :1] if alike else commands, width=COMMAND_WIDTH).value
    y = wheels.acceleration[usable]
    total = float(((y - y.mean(axis=0)) ** 2).sum())
    left = [_gains_and_rest(smoothed, wheels, usable, delay)[1] / total for delay in DELAYS]
    delay = vertex(DELAYS, np.array(left))
    gains, rest = _gains_and_rest(smoothed, wheels, usable, delay)
    explained = 1.0 - rest / total
    if explained < LEAST_EXPLAINED:
        return None
    G = np.repeat(gains, wheels.rate.shape[1], axis=1) if alike else gains
    order, margin = _best_command_order(G) if not alike else (tuple(range(len(G))), None)
    return CommandTest(
        order=tuple(place + 1 for place in order),
        signs=tuple(1 if G[wheel, place] > 0.0 else -1 for wheel, place in enumerate(order)),
        gains=tuple(tuple(row) for row in G.tolist()),
        delay=delay,
        explained=explained,
        margin=margin,
    )


def _gains_and_rest(
    commands: NDArray[np.float64],
    wheels: Smooth,
    usable: NDArray[np.bool_],
    delay: float,
) -> tuple[NDArray[np.float64], float]:
    """Return the gains (n, k) and the sum of squares left at a delay."""
    places = np.arange(len(commands), dtype=np.float64)
    late = np.column_stack([np.interp(places - delay / INTERVAL, places, column) for column in commands.T])
    speed = wheels.rate
    X = np.column_stack([late, speed, np.tanh(speed / SIGN_SPEED), np.ones(len(late))])[usable]
    y = wheels.acceleration[usable]
    # commands that sum to nearly zero are nearly dependent: with a ridge their common part gets no gain
    size = np.sqrt((X**2).mean(axis=0)) + 1e-12
    normal = (X / size).T @ (X / size) + RIDGE * len(X) * np.eye(X.shape[1])
    found = np.linalg.solve(normal, (X / size).T @ y) / size[:, None]
    return found[: commands.shape[1]].T, float(((y - X @ found) ** 2).sum())


def _best_command_order(G: NDArray[np.float64]) -> tuple[tuple[int, ...], float]:
    count = len(G)
    sums = {
        order: abs(sum(float(G[wheel, place]) for wheel, place in enumerate(order)))
        for order in permutations(range(count))
    }
    ranked = sorted(sums, key=lambda order: -sums[order])
    return ranked[0], sums[ranked[0]] / max(sums[ranked[1]], 1e-12)
