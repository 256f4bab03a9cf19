"""The Kalman filter's model of robot and sensors, compiled, with the noise it assumes and its two linear steps.

    14 states     x y      place of the ball, world frame [m]
                  psi      heading: R = Rz(psi) M(g), M the shortest turn that takes g upright [rad]
                  g        (2) x and y of the upward direction in the body's frame, its lean [-]
                  s        (2) momentum about the floor's contact as a speed, heading frame [m/s]
                  b        (3) gyro bias, body frame [rad/s]
                  d, r     the AHRS's heading error [rad] and its rate [rad/s]
                  a        (2) slow error of the AHRS's g [-]

    motion        w = gyro - b                   g_dot = g x w
                  psi_dot = w . (g + e_z) / (1 + g_z)
                  v = s - C w                    s_dot = -Lambda g - psi_dot e_z x s
                  (x, y)_dot = Rz(psi) v         a_dot = -a / tau,  d_dot = r

    the wheels    Omega = M(g) (T_obw wheel_speed + w)      the ball's angular velocity, heading frame
                  v = r_b (Omega_y, -Omega_x)    Omega_z = 0
    the AHRS      g + a,  psi + d

C and Lambda are those of `ballbot.mechanics.model.contact_momentum`. All but place and heading is in frames that turn
with the robot, so that where and which way it stands enters nothing but a fix and psi + d. With velocity or lean in the
world frame, each linearisation at another estimate would draw a little knowledge of the heading out of nothing
(tried: after three minutes the filter was sure to 0.5 degrees and wrong by 3 to 6). This psi differs from the
state's by 2 atan(tan(theta/2) tan(phi/2)), 0.035 degrees where theta and phi are both 2 degrees.

Seen numbers are taken in one after the other, each as a row h of the measurement matrix with a variance r of its own,
so that no matrix is inverted (a fix, which is rare, is taken in at once). Joseph's form keeps the covariance positive
whatever the gain's rounding (Bucy and Joseph, Filtering for Stochastic Processes with Applications to Guidance, 1968,
chapter 16). Multiplied out, with q = P h and s = h^T q + r, it is

    k = q / s        P+ = P - k q^T - (q - s k) k^T

The filter is written and compiled once, for robots side by side (`sample_code`): rows of a work array, a robot a
column, as the engine has them (`ballbot.mechanics.engine.lanes`). A single filter is a block of one. Of P only the
lower triangle is kept, and only the entries of F that are not those of the unit matrix.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from itertools import accumulate
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot.mechanics.engine.compiled import c_code, compiled
from ballbot.mechanics.engine.elementary import sine_cosine
from ballbot.mechanics.engine.lanes import entry, put, restored, stored
from ballbot.mechanics.engine.tracing import both, greatest, lanes, outside, root, traced, where
from ballbot.mechanics.engine.vector import add, dot, scale, summed
from ballbot.robot import Robot


@dataclass(frozen=True, kw_only=True)
class FilterNoise:
    """Standard deviations and densities; a density is that of an integral of white noise after one second.

    The defaults are of the size of the thesis's robot with an AHRS of the Xsens MTi 1-series. Those that are not
    a sensor's own were taken from the twin: what its rollers and its play do to A^-1's velocity, averaged over a
    second, and its rolling friction.
    """

    gyro: float  #: of each sample [rad/s]
    attitude: float  #: white part of the AHRS's angles [rad]
    heading_drift: float  #: how fast the AHRS's heading may run away [rad/s]
    heading_drift_walk: float = 1e-5  #: how that changes [rad/s/sqrt(s)]
    heading_walk: float = 1e-4  #: the AHRS's heading besides [rad/sqrt(s)]
    gyro_bias: float = math.radians(0.2)  #: at the start [rad/s]
    gyro_bias_walk: float = 1e-5  #: [rad/s/sqrt(s)]
    lean_error: float = math.radians(0.2)  #: slow part of the AHRS's lean error [rad]
    lean_error_time: float = 10.0  #: over which that forgets itself [s]
    push: float = 0.02  #: of the momentum, by what pushes from outside [m/s/sqrt(s)]
    rolling: float = 1e-3  #: of the distance by the wheels: rollers, play, slip [m/sqrt(s)]
    pivoting: float = 5e-3  #: of the ball's pivoting by the wheels [rad/sqrt(s)]
    pivoting_time: float = 0.5  #: over which that is averaged to find whether the ball pivots [s]
    pivoting_limit: float = 0.08  #: average from which it does; rollers and play make 0.02 [rad/s]
    start_position: float = 1e-3  #: of the place given at the reset [m]
    start_heading: float = 1e-3  #: of the AHRS's heading at the reset [rad]
    #: the robot stands still at the reset [m/s]; with ten times this doubt the first samples follow the motors through
    #: their play, and a stiff controller falls within a second
    start_speed: float = 0.005

    @staticmethod
    def of(robot: Robot) -> FilterNoise:
        """Return what goes with a robot's own sensors; a perfect sensor is taken as a very good one."""
        sensors = robot.sensors
        return FilterNoise(
            gyro=max(sensors.gyro_noise, 1e-5),
            attitude=max(sensors.attitude_noise, 1e-5),
            heading_drift=max(abs(sensors.heading_drift), 1e-5),
        )


STATES = 14
#: where each state, or the first of its numbers, lies
X, PSI, G, S, BIAS, HEADING_ERROR, DRIFT, LEAN_ERROR = 0, 2, 3, 5, 7, 10, 11, 12


class FilterModel(NamedTuple):
    """A robot and its noise as numbers."""

    sample_time: float  #: h [s]
    radius: float  #: r_b [m]
    lever: NDArray[np.float64]  #: (2, 3) C [m]
    pull: NDArray[np.float64]  #: (2, 2) Lambda [m/s^2]
    memory: float  #: exp(-h / tau) of the slow lean error
    gyro_variance: float  #: of a sample [rad^2/s^2]
    walk: NDArray[np.float64]  #: (14,) variance that each state gains in a sample by itself
    wheel_variances: NDArray[np.float64]  #: (3,) of v [m^2/s^2] and Omega_z [rad^2/s^2]
    attitude_variances: NDArray[np.float64]  #: (3,) of g and psi

    def row(self) -> NDArray[np.float64]:
        """Return the numbers as rows of the work array have them, (MODEL_SIZE,)."""
        return np.concatenate([np.ravel(one) for one in self])


#: the entries of F besides the unit matrix's: row and column; of the last four the diagonal is not one
_ENTRIES = (
    *((X + i, j) for i in (0, 1) for j in (PSI, S, S + 1, BIAS, BIAS + 1, BIAS + 2)),
    *((PSI, j) for j in (G, G + 1, BIAS, BIAS + 1, BIAS + 2)),
    *((G, j) for j in (G + 1, BIAS + 1, BIAS + 2)),
    *((G + 1, j) for j in (G, BIAS, BIAS + 2)),
    *((S, j) for j in (S + 1, G, G + 1, BIAS + 2)),
    *((S + 1, j) for j in (S, G, G + 1, BIAS + 2)),
    (HEADING_ERROR, DRIFT),
    *((i, i) for i in (G, G + 1, LEAN_ERROR, LEAN_ERROR + 1)),
)
#: the states that each seen number depends on: v_x, v_y and Omega_z by the wheels, g_x, g_y and psi by the AHRS
_SEEN = (
    (S, BIAS, BIAS + 1, BIAS + 2, G + 1),
    (S + 1, BIAS, BIAS + 1, BIAS + 2, G),
    (BIAS, BIAS + 1, BIAS + 2, G, G + 1),
    (G, LEAN_ERROR),
    (G + 1, LEAN_ERROR + 1),
    (PSI, HEADING_ERROR),
)
_SEEN_FIRST = [0, *accumulate(len(states) for states in _SEEN)]
_PIVOTING_SEEN = 2  # Omega_z, which is not zero where the ball pivots


def _triangle(i: int, j: int) -> int:
    """Return where an entry of a symmetric matrix is in its lower triangle, row by row."""
    return max(i, j) * (max(i, j) + 1) // 2 + min(i, j)


_TRIANGLE_SIZE = _triangle(STATES - 1, STATES - 1) + 1
#: rows and columns of its entries, in their order
LOWER_TRIANGLE = np.tril_indices(STATES)

# Rows of a block's work array: a filter's model, its state and covariance, a sample's inputs, and results on the way
MODEL_SIZE = 34
STATE = MODEL_SIZE
COVARIANCE = STATE + STATES
GYRO_BEFORE = COVARIANCE + _TRIANGLE_SIZE  #: at the sample's start [rad/s]
GYRO = GYRO_BEFORE + 3  #: at its end
BALL_RATE = (
    GYRO + 3
)  #: mean turning of the ball relative to the body, T_obw wheel_speed; NaN if missing [rad/s]
LEAN = BALL_RATE + 3  #: the AHRS's g at the sample's end; NaN if missing
HEADING = LEAN + 2  #: its psi
PIVOTS = HEADING + 1  #: 1 if the ball turns on the spot, so that Omega_z = 0 does not hold, else 0
PIVOTING = PIVOTS + 1  #: result: Omega_z as the wheels have it [rad/s]
_F = PIVOTING + 1
_ROWS_SEEN = _F + len(_ENTRIES)  # h, the entries of `_SEEN`
_RESIDUAL = _ROWS_SEEN + _SEEN_FIRST[-1]
_CHANGE = _RESIDUAL + len(_SEEN)
ROWS = _CHANGE + STATES


class _Numbers(NamedTuple):
    """A filter's model in compiled code: `FilterModel` as tuples."""

    sample_time: float
    radius: float
    lever: tuple
    pull: tuple
    memory: float
    gyro_variance: float


_THREE, _TWO = (0.0, 0.0, 0.0), (0.0, 0.0)
_MODEL_SHAPE = _Numbers(0.0, 0.0, (_THREE, _THREE), (_TWO, _TWO), 0.0, 0.0)
_WALK = 14  # rows of the model after `_Numbers`
_VARIANCES = _WALK + STATES
_STATE_SHAPE = (0.0,) * STATES


@traced
def upright_part(lean):
    """Return g_z; a lean that noise has taken past level counts as nearly level."""
    return root(greatest(1.0 - lean[0] * lean[0] - lean[1] * lean[1], 1e-6))


def lean_rate(lean, w):
    """Return x and y of g x w."""
    g_z = upright_part(lean)
    return (lean[1] * w[2] - g_z * w[1], g_z * w[0] - lean[0] * w[2])


def heading_rate(lean, w):
    """Return psi_dot = w . (g + e_z) / (1 + g_z) [rad/s]."""
    return w[2] + (w[0] * lean[0] + w[1] * lean[1]) / (1.0 + upright_part(lean))


def _momentum_rate(momentum, lean, turning, pull):
    """Return s_dot."""
    return (
        turning * momentum[1] - (pull[0][0] * lean[0] + pull[0][1] * lean[1]),
        -turning * momentum[0] - (pull[1][0] * lean[0] + pull[1][1] * lean[1]),
    )


def _less(a, b):
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def _mean(a, b):
    return (0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), 0.5 * (a[2] + b[2]))


def _ahead(a, rate, h):
    return (a[0] + h * rate[0], a[1] + h * rate[1])


def _turned(rows, first, second):
    return add(scale(rows[0], first), scale(rows[1], second))


def _tilt(g):
    """Return M(g), the shortest turn that takes the direction g, given by x and y, upright, by its rows."""
    g_z = upright_part(g)
    share = 1.0 / (1.0 + g_z)
    return (
        (1.0 - share * g[0] * g[0], -share * g[0] * g[1], -g[0]),
        (-share * g[0] * g[1], 1.0 - share * g[1] * g[1], -g[1]),
        (g[0], g[1], g_z),
    )


def advanced_state(model, x, gyro_before, gyro):
    """Return the state a sample later, and the mean of v (2) [m/s] over the sample."""
    h, lever, b = model.sample_time, model.lever, (x[7], x[8], x[9])
    at_start, at_end = _less(gyro_before, b), _less(gyro, b)
    w, g, s = _mean(at_start, at_end), (x[3], x[4]), (x[5], x[6])
    # second order: the rates at the sample's middle
    lean = _ahead(g, lean_rate(g, w), 0.5 * h)
    turning = heading_rate(lean, w)
    momentum = _ahead(s, _momentum_rate(s, g, turning, model.pull), 0.5 * h)
    g = _ahead(g, lean_rate(lean, w), h)
    after = _ahead(s, _momentum_rate(momentum, lean, turning, model.pull), h)
    v = (
        0.5 * (s[0] - dot(lever[0], at_start) + after[0] - dot(lever[0], at_end)),
        0.5 * (s[1] - dot(lever[1], at_start) + after[1] - dot(lever[1], at_end)),
    )
    s3, c3 = sine_cosine(x[2] + 0.5 * h * turning)
    x_y = (x[0] + h * (c3 * v[0] - s3 * v[1]), x[1] + h * (s3 * v[0] + c3 * v[1]))
    errors = (x[10] + h * x[11], x[11], model.memory * x[12], model.memory * x[13])
    return x_y + (x[2] + h * turning,) + g + after + b + errors, v


def transition(model, x, gyro):
    """Return the `_ENTRIES` of F: `advanced_state` derived by the state, to first order in h."""
    h, lever, pull = model.sample_time, model.lever, model.pull
    w, g, g_z = _less(gyro, (x[7], x[8], x[9])), (x[3], x[4]), upright_part((x[3], x[4]))
    turning, over, rise = heading_rate(g, w), h / (1.0 + g_z), 1.0 / g_z
    s3, c3 = sine_cosine(x[2])
    v_x, v_y = x[5] - dot(lever[0], w), x[6] - dot(lever[1], w)
    along, across = _turned(lever, c3, -s3), _turned(lever, s3, c3)
    return (
        (-h * (s3 * v_x + c3 * v_y), h * c3, -h * s3, h * along[0], h * along[1], h * along[2])
        + (h * (c3 * v_x - s3 * v_y), h * s3, h * c3, h * across[0], h * across[1], h * across[2])
        + (over * w[0], over * w[1], -over * g[0], -over * g[1], -h)
        + (h * (w[2] + w[1] * g[1] * rise), h * g_z, -h * g[1])
        + (-h * (w[2] + w[0] * g[0] * rise), -h * g_z, h * g[0])
        + (h * turning, -h * pull[0][0], -h * pull[0][1], -h * x[6])
        + (-h * turning, -h * pull[1][0], -h * pull[1][1], h * x[5])
        + (h,)
        + (1.0 + h * w[1] * g[0] * rise, 1.0 - h * w[0] * g[1] * rise, model.memory, model.memory)
    )


def wheels_seen(model, x, ball_rate, gyro, velocity):
    """Return residuals (3) and entries of h (15) of v_x - r_b Omega_y = 0, v_y + r_b Omega_x = 0, -Omega_z = 0.

    To first order in the lean. `gyro` is its mean over the sample, and `velocity` that of v as the states have it.
    """
    r_b, lever, M = model.radius, model.lever, _tilt((x[3], x[4]))
    z = (ball_rate[0] + gyro[0] - x[7], ball_rate[1] + gyro[1] - x[8], ball_rate[2] + gyro[2] - x[9])
    residuals = (r_b * dot(M[1], z) - velocity[0], -r_b * dot(M[0], z) - velocity[1], dot(M[2], z))
    # Omega by the lean: [[-z_z, 0], [0, -z_z], [z_x, z_y]]
    forward = (
        1.0,
        lever[0][0] + r_b * M[1][0],
        lever[0][1] + r_b * M[1][1],
        lever[0][2] + r_b * M[1][2],
        r_b * z[2],
    )
    left = (
        1.0,
        lever[1][0] - r_b * M[0][0],
        lever[1][1] - r_b * M[0][1],
        lever[1][2] - r_b * M[0][2],
        -r_b * z[2],
    )
    return residuals, forward + left + (M[2][0], M[2][1], M[2][2], -z[0], -z[1])


@traced
def _motion(work, width):
    """Move the states on by a sample; leave F, and what the wheels show."""
    for lane in lanes(0, width):
        model, x = restored(_MODEL_SHAPE, work, 0, lane), restored(_STATE_SHAPE, work, STATE, lane)
        before, gyro = restored(_THREE, work, GYRO_BEFORE, lane), restored(_THREE, work, GYRO, lane)
        middle = _mean(before, gyro)
        stored(work, _F, lane, transition(model, x, middle))
        x, velocity = advanced_state(model, x, before, gyro)
        stored(work, STATE, lane, x)
        rate = restored(_THREE, work, BALL_RATE, lane)
        known = rate[0] + rate[1] + rate[2] < math.inf
        residuals, entries = wheels_seen(model, x, where(known, rate, _THREE), middle, velocity)
        residuals = where(known, residuals, (math.nan,) * 3)
        stored(work, _RESIDUAL, lane, residuals)
        stored(work, _ROWS_SEEN, lane, entries + (1.0, 1.0, 1.0, 1.0, 1.0, 1.0))
        put(work, PIVOTING, lane, residuals[2])


@traced
def _propagate(work, width):
    """Overwrite the covariances by F P F^T + Q.

    A sample's gyro noise does what a bias of one sample would, hence Q's part F_b F_b^T.
    """
    for lane in lanes(0, width):
        f = restored((0.0,) * len(_ENTRIES), work, _F, lane)
        p = restored((0.0,) * _TRIANGLE_SIZE, work, COVARIANCE, lane)
        noise = entry(work, _GYRO_VARIANCE, lane)
        rows = [{k: f[n] for n, (r, k) in enumerate(_ENTRIES) if r == i} for i in range(STATES)]
        m = [
            [_product_of(i, rows[i], [p[_triangle(k, j)] for k in range(STATES)]) for j in range(STATES)]
            for i in range(STATES)
        ]
        for i in range(STATES):
            for j in range(i + 1):
                found = _product_of(j, rows[j], m[i])
                for b in range(BIAS, BIAS + 3):
                    if i < BIAS and b in rows[i] and b in rows[j]:  # rows below have no gyro in them
                        found = found + noise * (rows[i][b] * rows[j][b])
                if i == j:
                    found = found + entry(work, _WALK + i, lane)
                put(work, COVARIANCE + _triangle(i, j), lane, found)


def _product_of(place: int, row: dict, column: list):
    """Return the product of a row of F, one on the diagonal but for the entries given, with a column."""
    own = [] if place in row else [column[place]]
    return summed([*own, *(number * column[k] for k, number in row.items())])


_GYRO_VARIANCE = 13


def _absorb(work, width, numbers):
    """Take in the seen numbers, known when compiling, one after another."""
    for lane in lanes(0, width):
        stored(work, _CHANGE, lane, _STATE_SHAPE)
    for number in numbers:
        for lane in lanes(0, width):
            _take_in(work, lane, number)
    for lane in lanes(0, width):
        x, change = restored(_STATE_SHAPE, work, STATE, lane), restored(_STATE_SHAPE, work, _CHANGE, lane)
        stored(work, STATE, lane, add(x, change))


def _take_in(work, lane, number):
    """Correct a lane's state and covariance by a seen number, unless it is missing or does not count."""
    p = restored((0.0,) * _TRIANGLE_SIZE, work, COVARIANCE, lane)
    h = restored((0.0,) * len(_SEEN[number]), work, _ROWS_SEEN + _SEEN_FIRST[number], lane)
    change = restored(_STATE_SHAPE, work, _CHANGE, lane)
    q = tuple(
        summed([p[_triangle(i, state)] * one for state, one in zip(_SEEN[number], h, strict=True)])
        for i in range(STATES)
    )
    s, residual = entry(work, _VARIANCES + number, lane), entry(work, _RESIDUAL + number, lane)
    for state, one in zip(_SEEN[number], h, strict=True):
        s, residual = s + one * q[state], residual - one * change[state]
    taken = residual == residual
    if number == _PIVOTING_SEEN:
        taken = both(taken, entry(work, PIVOTS, lane) == 0.0)
    k = scale(q, where(taken, 1.0 / s, 0.0))
    stored(work, _CHANGE, lane, add(change, scale(k, where(taken, residual, 0.0))))
    rest = [one - s * gain for one, gain in zip(q, k, strict=True)]
    for i in range(STATES):
        for j in range(i + 1):
            place = _triangle(i, j)
            put(work, COVARIANCE + place, lane, p[place] - k[i] * q[j] - rest[i] * k[j])


@traced
def _see_wheels(work, width):
    _absorb(work, width, range(3))


@traced
def _see_attitudes(work, width):
    for lane in lanes(0, width):
        x = restored(_STATE_SHAPE, work, STATE, lane)
        seen = restored(_THREE, work, LEAN, lane)  # and the heading
        expected = (x[G] + x[LEAN_ERROR], x[G + 1] + x[LEAN_ERROR + 1], x[PSI] + x[HEADING_ERROR])
        stored(work, _RESIDUAL + 3, lane, _less(seen, expected))
    _absorb(work, width, range(3, len(_SEEN)))


@cache
def sample_code() -> int:
    """Return the address of the code for `sample_block`; the first call compiles, or reads what was compiled."""

    @c_code("void(CPointer(float64), int64)")
    def address(work, width):
        _motion(work, width)
        _propagate(work, width)
        _see_wheels(work, width)
        _see_attitudes(work, width)

    return address


@traced
def sample_block(code, work, width):
    """Take the filters of the first lanes over a sample; see the rows `GYRO_BEFORE` to `PIVOTING` for the inputs."""
    outside(code, work, width)


@compiled
def _sample(code, work):
    sample_block(code, work, 1)


def sample(work: NDArray[np.float64]) -> None:
    """Take a single filter, the first lane of a block's work array, over a sample."""
    _sample(sample_code(), work)
