"""Where the wheels sit and which command drives which wheel, from a log of balancing: two tests by accelerations.

The places of the wheels take no torque. While a ball rolls, the torque between body and ball drops out of the sum of
their equations. To first order, with the lean Theta = theta + j phi in the body's frame and wheel speeds w_i at
azimuths beta_i,

    Theta_ddot = kappa Theta + gamma W_dot + rho W/|W| + offset,        W = sum_i w_i e^{j beta_i}

    gamma = b / ((a + b) (n/2) (r_b / r_w) cos alpha),      kappa = m_r g l / (a + b)

    b = r_b (r_b M_11 + M_21),   a = r_b M_12 + M_22,   M the mass matrix of (x, phi) at rest

rho is the ball's rolling friction, which acts from outside. kappa is taken from the robot: in a log of small leans it
is hardly seen, and left free it takes from gamma. gamma is real and positive, so the angle of the one found from a log
is by how much the wheels are turned against the IMU, and a log that follows the conjugate of W has its wheels numbered
the other way round, or an IMU with one axis reversed. A wheel whose sign is reversed fits neither, and gives itself
away twice: the lean's acceleration is explained less well, and the sum of the wheel speeds, which only heading moves,
is as large as any other.

Which command drives which wheel, with which sign and how late, follows from the wheels' accelerations:

    w_dot = G u(t - d) + friction's terms in w

Each wheel's own command has the largest gain in its row of G: the ball carries the others' push over, at most half of
it and against it. d is where the commands, held as the log says, explain the accelerations best. (The lean is not among
what explains them: commands are made of the lean, and would share its gain.)
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from ballbot.log.signals import INTERVAL, Smooth, smooth
from ballbot.robot import Robot

#: lean later than wheels that is tried [s]: an IMU's filter takes 15 to 20 ms. Whole rows: between them, interpolation
#: smooths, which looks like a better fit
LAGS = INTERVAL * np.arange(-1.0, 11.0)
#: windows [s] that share one weight, one over their residual's size, and that the jackknife leaves out in turn
BLOCK = 1.0
#: a block whose residual is this many times the median block's is a push, not balancing
PUSHED = 3.0
FIT_ROUNDS = 4
#: a block's residual counts as at least this part of the median block's
LEAST_SIZE = 0.3
#: lean later than wheels at which the weights are first found [s]
USUAL_LAG = 0.0175
#: over which disturbance and gravity are compared [s], about the time in which the robot falls
SLOW = 0.25
#: wheel speed (root of the sum of squares) below which the ball hardly rolls, and rolling friction has no sign [rad/s]
ROLLING = 0.2
#: the fewest seconds of balancing
LEAST_TIME = 3.0


@dataclass(frozen=True, kw_only=True)
class Placement:
    """One way in which the wheels' columns may sit on the robot, and how well the log agrees."""

    mirrored: bool  #: whether the wheels are numbered the other way round than the robot's
    flipped: int | None  #: the wheel (from 1) whose sign is against the others'
    phase: float  #: [rad], the angle of gamma
    gain: float  #: its size, over the robot's own gamma
    unexplained: float  #: share of the lean's acceleration
    together: float  #: share of the wheels' motion that is all wheels turning together, apart from heading
    misfit: float  #: unexplained, times the root of together

    @property
    def words(self) -> str:
        """The placement in words."""
        order = "mirrored" if self.mirrored else "as the robot's"
        return order if self.flipped is None else f"{order}, wheel {self.flipped} reversed"


@dataclass(frozen=True, kw_only=True)
class LeanTest:
    """What the torque-free test found."""

    placements: tuple[Placement, ...]  #: best first
    phase_error: (
        float | None
    )  #: standard error of the best one's phase [rad], from leaving out blocks of a second
    lag: float  #: lean later than wheels [s]
    disturbance: (
        float  #: root mean square of the lean's acceleration left over, over that of gravity's share of it
    )
    balancing: NDArray[np.bool_]  #: (N,), the even rows that were judged
    pushed: NDArray[np.bool_]  #: (N,), rows left out because something pushed the robot

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
        None where too little of the log is balancing.
    """
    # rows at the ends, where the lag looks past the log and fits have one side
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
    """Return Theta_ddot - kappa Theta (N,) a lag later: what the wheels must explain."""
    rows = np.arange(len(lean.value), dtype=np.float64)
    driven = lean.acceleration - kappa * lean.value
    columns = [np.interp(rows + lag / INTERVAL, rows, column) for column in driven.T]
    return columns[0] + 1j * columns[1]


def _fit(
    driven: NDArray[np.complex128], turning: NDArray[np.complex128], weights: NDArray[np.float64]
) -> tuple[complex, NDArray[np.complex128]]:
    """Return the gain and what is left over (N,)."""
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
    """Return running means over `SLOW`: what has time to make the robot fall."""
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
    """Return where a parabola through the least of the values and its neighbours has its vertex."""
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
    """Return the share of the wheels' motion that is their sum, less what follows the heading; 1 if all alike."""
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
#: narrower than for the lean: an encoder is quieter than an IMU, and delays show in what is quick
COMMAND_WIDTH = 0.01
#: the speed at which dry friction's sign is half turned over [rad/s]
SIGN_SPEED = 0.3
#: part of the signals' own size that is added to the normal equations
RIDGE = 1e-3
#: below this share explained the commands do not drive these wheels
LEAST_EXPLAINED = 0.2


@dataclass(frozen=True, kw_only=True)
class CommandTest:
    """What drives the wheels."""

    order: tuple[int, ...]  #: for the file's wheels in turn, which command (from 1) drives it
    signs: tuple[int, ...]  #: whether that command turns it forward
    gains: tuple[tuple[float, ...], ...]  #: G [rad/s^2 a unit of command], by wheel and command
    delay: float  #: d [s]
    explained: float  #: share of the accelerations
    #: the gains' sum in this order over that in the next best; None where all commands are alike
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
        Of width `WIDTH`; all counting the same way round.
    commands : ndarray (N, n)
        As `held` gives them.
    usable : ndarray (N,)

    Returns
    -------
    CommandTest or None
        None where the commands do not explain the wheels.
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
    # commands that sum to nearly zero are nearly dependent: a ridge gives their common part no gain of its own
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
