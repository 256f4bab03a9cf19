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
so that no matrix is inverted. Joseph's form keeps the covariance symmetric and positive whatever the gain's rounding
(Bucy and Joseph, Filtering for Stochastic Processes with Applications to Guidance, 1968, chapter 16):

    k = P h / (h^T P h + r)        P+ = (I - k h^T) P (I - k h^T)^T + k r k^T
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.mechanics.engine.compiled import compiled, inlined
from ballbot.robot import Robot


@compiled
def propagate(P: NDArray[np.float64], F: NDArray[np.float64], Q: NDArray[np.float64]) -> None:
    """Overwrite the covariance P (m, m) by F P F^T + Q, made symmetric."""
    m = len(P)
    FP = np.zeros((m, m))
    for i in range(m):
        for k in range(m):
            if F[i, k] != 0.0:  # most are
                for j in range(m):
                    FP[i, j] += F[i, k] * P[k, j]
    spread = np.zeros((m, m))
    for j in range(m):
        for k in range(m):
            if F[j, k] != 0.0:
                for i in range(m):
                    spread[j, i] += F[j, k] * FP[i, k]
    for i in range(m):
        for j in range(i + 1):
            P[i, j] = 0.5 * (spread[i, j] + spread[j, i]) + Q[i, j]
            P[j, i] = P[i, j]


@compiled
def absorb(
    x: NDArray[np.float64],
    P: NDArray[np.float64],
    residuals: NDArray[np.float64],
    rows: NDArray[np.float64],
    variances: NDArray[np.float64],
) -> float:
    """Take in p numbers that were seen, changing the state x (m,) and its covariance P (m, m).

    Parameters
    ----------
    x, P : arrays (m,), (m, m)
        Overwritten.
    residuals : array (p,)
        Seen less expected at the x given.
    rows : array (p, m)
        What was seen, derived by x.
    variances : array (p,)
        Of each number's own error, independent of the others'.

    Returns
    -------
    float
        Sum of the squared residuals over their variances, each given those before it: chi-squared with p degrees of
        freedom where the filter's sizes are right.
    """
    m = len(x)
    change, Ph, k, half, half_h = np.zeros(m), np.zeros(m), np.zeros(m), np.zeros((m, m)), np.zeros(m)
    surprise = 0.0
    for i in range(len(residuals)):
        h = rows[i]
        for a in range(m):
            Ph[a] = _product(P[a], h)
        variance = _product(h, Ph) + variances[i]
        residual = residuals[i] - _product(h, change)
        surprise += residual * residual / variance
        for a in range(m):
            k[a] = Ph[a] / variance
            change[a] += k[a] * residual
            for b in range(m):
                half[a, b] = P[a, b] - k[a] * Ph[b]  # (I - k h^T) P
            half_h[a] = _product(half[a], h)
        for a in range(m):
            for b in range(a + 1):
                P[a, b] = half[a, b] - half_h[a] * k[b] + k[a] * variances[i] * k[b]
                P[b, a] = P[a, b]
    for a in range(m):
        x[a] += change[a]
    return surprise


@inlined
def _product(a, b):
    """Return a^T b."""
    total = 0.0
    for i in range(len(a)):
        total += a[i] * b[i]
    return total


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

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value >= 0):
                raise InputError(
                    f"{field.name} of the filter's noise is {value}; it must be a finite number, zero or more."
                )
        for name in ("rolling", "pivoting", "pivoting_time", "attitude", "lean_error_time"):
            if getattr(self, name) == 0:
                raise InputError(
                    f"{name} of the filter's noise is zero; it must be above zero, as no measurement is perfect."
                )

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


@compiled
def sample(
    x: NDArray[np.float64],
    P: NDArray[np.float64],
    model: FilterModel,
    ball_rate: NDArray[np.float64],
    gyro_before: NDArray[np.float64],
    gyro: NDArray[np.float64],
    lean: NDArray[np.float64],
    heading: float,
    pivots: bool,
) -> float:
    """Take the state x (14,) and its covariance P (14, 14) over a sample, in place.

    A ball_rate or an attitude that is NaN is missing; it corrects nothing.

    Parameters
    ----------
    ball_rate : array (3,)
        T_obw wheel_speed [rad/s], body frame: the ball's mean turning relative to the body over the sample.
    gyro_before, gyro : arrays (3,)
        At the sample's start and end [rad/s].
    lean : array (2,)
        The AHRS's g at the sample's end.
    heading : float
        The AHRS's psi at the sample's end [rad].
    pivots : bool
        Whether the ball turns on the spot, so that Omega_z = 0 does not hold.

    Returns
    -------
    float
        Omega_z as the wheels have it [rad/s].
    """
    middle = np.empty(3)
    for i in range(3):
        middle[i] = 0.5 * (gyro_before[i] + gyro[i])
    F, Q = transition(x, model, middle)
    velocity = advance(x, model, gyro_before, gyro)
    propagate(P, F, Q)
    residuals, rows = wheels_seen(x, model, ball_rate, middle, velocity)
    pivoting = residuals[2]
    used = 2 if pivots else 3
    if pivoting != pivoting:
        used = 0
    absorb(x, P, residuals[:used], rows[:used], model.wheel_variances[:used])
    residuals, rows = attitude_seen(x, lean, heading)
    if heading == heading:
        absorb(x, P, residuals, rows, model.attitude_variances)
    return pivoting


@compiled
def advance(
    x: NDArray[np.float64],
    model: FilterModel,
    gyro_before: NDArray[np.float64],
    gyro: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Move the state x (14,) on by a sample, in place; return the mean of v (2,) [m/s] over it."""
    h, b = model.sample_time, x[BIAS : BIAS + 3]
    g, s = x[G : G + 2], x[S : S + 2]
    w, at_start, at_end = np.empty(3), np.empty(3), np.empty(3)
    for i in range(3):
        at_start[i], at_end[i] = gyro_before[i] - b[i], gyro[i] - b[i]
        w[i] = 0.5 * (at_start[i] + at_end[i])
    velocity, momentum, lean = np.empty(2), np.empty(2), np.empty(2)
    for i in range(2):
        velocity[i] = 0.5 * (s[i] - _product(model.lever[i], at_start))
    # second order: the rates at the sample's middle
    rate = lean_rate(g, w)
    for i in range(2):
        lean[i] = g[i] + 0.5 * h * rate[i]
    turning = heading_rate(lean, w)
    rate = _momentum_rate(s, g, turning, model.pull)
    for i in range(2):
        momentum[i] = s[i] + 0.5 * h * rate[i]
    lean_rates, momentum_rates = lean_rate(lean, w), _momentum_rate(momentum, lean, turning, model.pull)
    for i in range(2):
        g[i] += h * lean_rates[i]
        s[i] += h * momentum_rates[i]
        velocity[i] += 0.5 * (s[i] - _product(model.lever[i], at_end))
        x[LEAN_ERROR + i] *= model.memory
    s3, c3 = math.sin(x[PSI] + 0.5 * h * turning), math.cos(x[PSI] + 0.5 * h * turning)
    x[X] += h * (c3 * velocity[0] - s3 * velocity[1])
    x[X + 1] += h * (s3 * velocity[0] + c3 * velocity[1])
    x[PSI] += h * turning
    x[HEADING_ERROR] += h * x[DRIFT]
    return velocity


@compiled
def transition(
    x: NDArray[np.float64], model: FilterModel, gyro: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return F (14, 14), `advance` derived by the state to first order in h, and the noise Q (14, 14) of a sample.

    A sample's gyro noise does what a bias of one sample would, hence Q's part F_b F_b^T.
    """
    h, lever = model.sample_time, model.lever
    w = np.empty(3)
    for i in range(3):
        w[i] = gyro[i] - x[BIAS + i]
    g_x, g_y = x[G], x[G + 1]
    g_z = upright_part(x[G : G + 2])
    turning = heading_rate(x[G : G + 2], w)
    s_x, s_y = x[S], x[S + 1]
    s3, c3 = math.sin(x[PSI]), math.cos(x[PSI])
    v_x, v_y = s_x - _product(lever[0], w), s_y - _product(lever[1], w)
    F, Q = np.zeros((STATES, STATES)), np.zeros((STATES, STATES))
    for i in range(STATES):
        F[i, i] = 1.0
    F[X, PSI], F[X + 1, PSI] = -h * (s3 * v_x + c3 * v_y), h * (c3 * v_x - s3 * v_y)
    F[X, S], F[X, S + 1], F[X + 1, S], F[X + 1, S + 1] = h * c3, -h * s3, h * s3, h * c3
    for i in range(3):
        F[X, BIAS + i] = h * (c3 * lever[0, i] - s3 * lever[1, i])
        F[X + 1, BIAS + i] = h * (s3 * lever[0, i] + c3 * lever[1, i])
    F[PSI, G], F[PSI, G + 1] = h * w[0] / (1.0 + g_z), h * w[1] / (1.0 + g_z)
    F[PSI, BIAS], F[PSI, BIAS + 1], F[PSI, BIAS + 2] = -h * g_x / (1.0 + g_z), -h * g_y / (1.0 + g_z), -h
    F[G, G] += h * w[1] * g_x / g_z
    F[G, G + 1] = h * (w[2] + w[1] * g_y / g_z)
    F[G + 1, G] = -h * (w[2] + w[0] * g_x / g_z)
    F[G + 1, G + 1] -= h * w[0] * g_y / g_z
    F[G, BIAS + 1], F[G, BIAS + 2] = h * g_z, -h * g_y
    F[G + 1, BIAS], F[G + 1, BIAS + 2] = -h * g_z, h * g_x
    for i in range(2):
        for j in range(2):
            F[S + i, G + j] = -h * model.pull[i, j]
    F[S, S + 1], F[S + 1, S] = h * turning, -h * turning
    F[S, BIAS + 2], F[S + 1, BIAS + 2] = -h * s_y, h * s_x
    F[HEADING_ERROR, DRIFT] = h
    F[LEAN_ERROR, LEAN_ERROR], F[LEAN_ERROR + 1, LEAN_ERROR + 1] = model.memory, model.memory
    for i in range(BIAS):  # rows below have no gyro in them
        for j in range(BIAS):
            Q[i, j] = model.gyro_variance * _product(F[i, BIAS : BIAS + 3], F[j, BIAS : BIAS + 3])
    for i in range(STATES):
        Q[i, i] += model.walk[i]
    return F, Q


@compiled
def wheels_seen(
    x: NDArray[np.float64],
    model: FilterModel,
    ball_rate: NDArray[np.float64],
    gyro: NDArray[np.float64],
    velocity: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return residuals (3,) and rows (3, 14) of v_x - r_b Omega_y = 0, v_y + r_b Omega_x = 0, -Omega_z = 0.

    Rows are to first order in the lean.

    Parameters
    ----------
    ball_rate, gyro : arrays (3,)
        As in `sample`; the gyro's mean over the sample [rad/s].
    velocity : array (2,)
        Mean of v over the sample as the states have it [m/s].
    """
    r_b = model.radius
    M = tilt(x[G : G + 2])
    z, Omega = np.empty(3), np.empty(3)
    for i in range(3):
        z[i] = ball_rate[i] + gyro[i] - x[BIAS + i]
    for i in range(3):
        Omega[i] = _product(M[i], z)
    rows = np.zeros((3, STATES))
    rows[0, S], rows[1, S + 1] = 1.0, 1.0
    for i in range(3):
        rows[0, BIAS + i] = model.lever[0, i] + r_b * M[1, i]
        rows[1, BIAS + i] = model.lever[1, i] - r_b * M[0, i]
        rows[2, BIAS + i] = M[2, i]
    # Omega by the lean: [[-z_z, 0], [0, -z_z], [z_x, z_y]]
    rows[0, G + 1] = r_b * z[2]
    rows[1, G] = -r_b * z[2]
    rows[2, G], rows[2, G + 1] = -z[0], -z[1]
    residuals = np.array([r_b * Omega[1] - velocity[0], -r_b * Omega[0] - velocity[1], Omega[2]])
    return residuals, rows


@compiled
def attitude_seen(
    x: NDArray[np.float64], lean: NDArray[np.float64], heading: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return residuals (3,) and rows (3, 14) of the AHRS's g (2,) and psi [rad]."""
    rows = np.zeros((3, STATES))
    rows[0, G], rows[0, LEAN_ERROR] = 1.0, 1.0
    rows[1, G + 1], rows[1, LEAN_ERROR + 1] = 1.0, 1.0
    rows[2, PSI], rows[2, HEADING_ERROR] = 1.0, 1.0
    residuals = np.array(
        [
            lean[0] - x[G] - x[LEAN_ERROR],
            lean[1] - x[G + 1] - x[LEAN_ERROR + 1],
            heading - x[PSI] - x[HEADING_ERROR],
        ]
    )
    return residuals, rows


@compiled
def tilt(lean: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return M(g) (3, 3), the shortest turn that takes the direction g, given by x and y, upright."""
    g_x, g_y = lean
    g_z = upright_part(lean)
    share = 1.0 / (1.0 + g_z)
    return np.array(
        [
            [1.0 - share * g_x * g_x, -share * g_x * g_y, -g_x],
            [-share * g_x * g_y, 1.0 - share * g_y * g_y, -g_y],
            [g_x, g_y, g_z],
        ]
    )


@compiled
def upright_part(lean: NDArray[np.float64]) -> float:
    """Return g_z; a lean that noise has taken past level counts as nearly level."""
    return math.sqrt(max(1.0 - lean[0] ** 2 - lean[1] ** 2, 1e-6))


@compiled
def lean_rate(lean: NDArray[np.float64], w: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return x and y of g x w (2,)."""
    g_z = upright_part(lean)
    return np.array([lean[1] * w[2] - g_z * w[1], g_z * w[0] - lean[0] * w[2]])


@compiled
def heading_rate(lean: NDArray[np.float64], w: NDArray[np.float64]) -> float:
    """Return psi_dot = w . (g + e_z) / (1 + g_z) [rad/s]."""
    return w[2] + (w[0] * lean[0] + w[1] * lean[1]) / (1.0 + upright_part(lean))


@compiled
def _momentum_rate(
    momentum: NDArray[np.float64], lean: NDArray[np.float64], turning: float, pull: NDArray[np.float64]
) -> NDArray[np.float64]:
    return np.array(
        [turning * momentum[1] - _product(pull[0], lean), -turning * momentum[0] - _product(pull[1], lean)]
    )
