"""The Kalman filter's model of robot and sensors, compiled.

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

C and Lambda are those of `ballbot.mechanics.contact_momentum`. All but place and heading is in frames that turn with
the robot, so that where and which way it stands enters nothing but a fix and psi + d. With velocity or lean in the
world frame, each linearisation at another estimate would draw a little knowledge of the heading out of nothing
(tried: after three minutes the filter was sure to 0.5 degrees and wrong by 3 to 6). This psi differs from the
state's by 2 atan(tan(theta/2) tan(phi/2)), 0.07 degrees where both lean by 2.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot.estimation.linear_update import absorb, propagate
from ballbot.mechanics.compiled import compiled

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
    middle = 0.5 * (gyro_before + gyro)
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
    h = model.sample_time
    b = x[BIAS : BIAS + 3]
    w = 0.5 * (gyro_before + gyro) - b
    before = x[S : S + 2] - np.dot(model.lever, gyro_before - b)
    # second order: the rates at the sample's middle
    at_start = lean_rate(x[G : G + 2], w)
    lean = x[G : G + 2] + 0.5 * h * at_start
    turning = heading_rate(lean, w)
    momentum = x[S : S + 2] + 0.5 * h * _momentum_rate(x[S : S + 2], x[G : G + 2], turning, model.pull)
    x[G : G + 2] += h * lean_rate(lean, w)
    x[S : S + 2] += h * _momentum_rate(momentum, lean, turning, model.pull)
    velocity = 0.5 * (before + x[S : S + 2] - np.dot(model.lever, gyro - b))
    s3, c3 = math.sin(x[PSI] + 0.5 * h * turning), math.cos(x[PSI] + 0.5 * h * turning)
    x[X] += h * (c3 * velocity[0] - s3 * velocity[1])
    x[X + 1] += h * (s3 * velocity[0] + c3 * velocity[1])
    x[PSI] += h * turning
    x[HEADING_ERROR] += h * x[DRIFT]
    x[LEAN_ERROR : LEAN_ERROR + 2] *= model.memory
    return velocity


@compiled
def transition(
    x: NDArray[np.float64], model: FilterModel, gyro: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return F (14, 14), `advance` derived by the state to first order in h, and the noise Q (14, 14) of a sample.

    A sample's gyro noise does what a bias of one sample would, hence Q's part F_b F_b^T.
    """
    h = model.sample_time
    w = gyro - x[BIAS : BIAS + 3]
    g_x, g_y = x[G], x[G + 1]
    g_z = upright_part(x[G : G + 2])
    turning = heading_rate(x[G : G + 2], w)
    s_x, s_y = x[S], x[S + 1]
    s3, c3 = math.sin(x[PSI]), math.cos(x[PSI])
    v_x, v_y = x[S : S + 2] - np.dot(model.lever, w)
    F = np.eye(STATES)
    F[X, PSI], F[X + 1, PSI] = -h * (s3 * v_x + c3 * v_y), h * (c3 * v_x - s3 * v_y)
    turn = h * np.array([[c3, -s3], [s3, c3]])
    F[X : X + 2, S : S + 2] = turn
    F[X : X + 2, BIAS : BIAS + 3] = np.dot(turn, model.lever)
    F[PSI, G], F[PSI, G + 1] = h * w[0] / (1.0 + g_z), h * w[1] / (1.0 + g_z)
    F[PSI, BIAS], F[PSI, BIAS + 1], F[PSI, BIAS + 2] = -h * g_x / (1.0 + g_z), -h * g_y / (1.0 + g_z), -h
    F[G, G] += h * w[1] * g_x / g_z
    F[G, G + 1] = h * (w[2] + w[1] * g_y / g_z)
    F[G + 1, G] = -h * (w[2] + w[0] * g_x / g_z)
    F[G + 1, G + 1] -= h * w[0] * g_y / g_z
    F[G, BIAS + 1], F[G, BIAS + 2] = h * g_z, -h * g_y
    F[G + 1, BIAS], F[G + 1, BIAS + 2] = -h * g_z, h * g_x
    F[S : S + 2, G : G + 2] = -h * model.pull
    F[S, S + 1], F[S + 1, S] = h * turning, -h * turning
    F[S, BIAS + 2], F[S + 1, BIAS + 2] = -h * s_y, h * s_x
    F[HEADING_ERROR, DRIFT] = h
    F[LEAN_ERROR, LEAN_ERROR], F[LEAN_ERROR + 1, LEAN_ERROR + 1] = model.memory, model.memory
    by_gyro = np.ascontiguousarray(F[:, BIAS : BIAS + 3])
    by_gyro[BIAS : BIAS + 3] = 0.0
    Q = model.gyro_variance * np.dot(by_gyro, by_gyro.T)
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
    z = ball_rate + gyro - x[BIAS : BIAS + 3]
    Omega = np.dot(M, z)
    by_lean = np.array([[-z[2], 0.0], [0.0, -z[2]], [z[0], z[1]]])
    rows = np.zeros((3, STATES))
    rows[0, S], rows[1, S + 1] = 1.0, 1.0
    rows[:2, BIAS : BIAS + 3] = model.lever
    rows[0, BIAS : BIAS + 3] += r_b * M[1]
    rows[1, BIAS : BIAS + 3] -= r_b * M[0]
    rows[2, BIAS : BIAS + 3] = M[2]
    rows[0, G : G + 2] = -r_b * by_lean[1]
    rows[1, G : G + 2] = r_b * by_lean[0]
    rows[2, G : G + 2] = -by_lean[2]
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
    return np.array([turning * momentum[1], -turning * momentum[0]]) - np.dot(pull, lean)
