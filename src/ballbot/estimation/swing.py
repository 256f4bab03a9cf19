"""An attitude as a lean and a heading that are independent, as the Kalman filter has it, and the robot's state from it.

    R = Rz(psi_s) M(g)     g = R^T e_z,  psi_s = psi + 2 atan(tan(theta / 2) tan(phi / 2))

g is the upward direction in the body's frame, M(g) the shortest turn that takes it upright. Turning the robot about the
vertical changes psi_s and nothing else; of theta, phi, psi it changes all three. The firmware's C is written from this
file (`tests.support.firmware_law`).
"""

import math
from typing import NamedTuple

import numpy as np

from ballbot.estimation.kalman_model import BIAS, PSI, SHOWN_PSI, G, S, X
from ballbot.mechanics.engine.compiled import compiled, inlined
from ballbot.mechanics.engine.elementary import sine_cosine

#: least square of a cosine: beyond 90 degrees, where only noise can take a lean, it is nearly zero
_LEAST_SQUARE = 1e-6


class SwingTwist(NamedTuple):
    """An attitude as lean and heading."""

    g_x: float
    g_y: float
    heading: float  # psi_s [rad], with the turns of psi


class AttitudeAngles(NamedTuple):
    """An attitude as angles, and what their rates need of them."""

    theta: float  # [rad]
    phi: float  # [rad]
    psi: float  # [rad], with the turns of psi_s
    s2: float  # sin phi
    c2: float  # cos phi
    c2_c3: float  # cos phi cos psi
    c2_s3: float  # cos phi sin psi


@inlined
def swing_of(theta, phi, psi):
    """Return lean and heading of the angles of R = Rx(theta) Ry(phi) Rz(psi)."""
    s1, c1 = sine_cosine(theta)
    s2, c2 = sine_cosine(phi)
    s3, c3 = sine_cosine(psi)
    forward = -c1 * s2  # before the turn by psi
    heading = psi + 2.0 * math.atan2(s1 * s2, (1.0 + c1) * (1.0 + c2))
    return SwingTwist(c3 * forward + s3 * s1, c3 * s1 - s3 * forward, heading)


@inlined
def root_of(square):
    """Return the cosine with this square."""
    return max(square, _LEAST_SQUARE) ** 0.5


@inlined
def attitude_of(g_x, g_y, heading):
    """Return the angles of a lean and a heading."""
    s, c = sine_cosine(heading)
    g_z = root_of((1.0 - g_x * g_x) - g_y * g_y)
    share = 1.0 / (1.0 + g_z)
    # of R = Rz(psi_s) M: its last column is (s2, -s1 c2, c1 c2), its first row (c2 c3, -c2 s3, s2)
    s1_c2 = s * g_x + c * g_y
    s2 = s * g_y - c * g_x
    c2 = root_of((1.0 - s2) * (1.0 + s2))
    m_12 = -share * g_x * g_y
    psi = heading - 2.0 * math.atan2(s1_c2 * s2, (c2 + g_z) * (1.0 + c2))
    return AttitudeAngles(
        math.atan2(s1_c2, g_z),
        math.atan2(s2, c2),
        psi,
        s2,
        c2,
        c * (1.0 - share * g_x * g_x) - s * m_12,
        s * (1.0 - share * g_y * g_y) - c * m_12,
    )


@inlined
def lever_speed(lever, k, w_x, w_y, w_z):
    """Return C w, component k [m/s]."""
    return lever[k][0] * w_x + lever[k][1] * w_y + lever[k][2] * w_z


@inlined
def begin_filter(lever, swing, gyro, x):
    """Let a filter's state x (14) begin with an attitude, at rest: v = 0."""
    x[G], x[G + 1] = swing.g_x, swing.g_y
    x[S], x[S + 1] = (
        lever_speed(lever, 0, gyro[0], gyro[1], gyro[2]),
        lever_speed(lever, 1, gyro[0], gyro[1], gyro[2]),
    )
    x[PSI], x[SHOWN_PSI] = swing.heading, swing.heading


@inlined
def robot_state(lever, x, gyro, state):
    """Fill the state (10) that the robot is controlled by, from a filter's (14) and the gyro's reading (3) [rad/s]."""
    w_x, w_y, w_z = gyro[0] - x[BIAS], gyro[1] - x[BIAS + 1], gyro[2] - x[BIAS + 2]
    v_x, v_y = x[S] - lever_speed(lever, 0, w_x, w_y, w_z), x[S + 1] - lever_speed(lever, 1, w_x, w_y, w_z)
    a = attitude_of(x[G], x[G + 1], x[PSI])
    s, c = sine_cosine(x[PSI])
    state[0], state[1], state[2], state[3], state[4] = x[X], x[X + 1], a.theta, a.phi, a.psi
    state[5], state[6] = c * v_x - s * v_y, s * v_x + c * v_y
    state[7] = (a.c2_c3 * w_x - a.c2_s3 * w_y) / (a.c2 * a.c2)
    state[8] = (a.c2_s3 * w_x + a.c2_c3 * w_y) / a.c2
    state[9] = w_z - a.s2 * state[7]


# --- for one robot, called by Python ---


@compiled
def swing(theta, phi, psi):
    """Return the `SwingTwist` of theta, phi, psi [rad]."""
    return swing_of(theta, phi, psi)


@compiled
def turned_about_vertical(attitude, angle):
    """Return theta, phi, psi (3,) of Rz(angle) R [rad]: the same attitude, seen from a frame turned by -angle.

    With an angle of zero, they are the same to the bit.
    """
    if angle == 0.0:
        return attitude.copy()
    seen = swing_of(attitude[0], attitude[1], attitude[2])
    turned = attitude_of(seen.g_x, seen.g_y, seen.heading + angle)
    return np.array((turned.theta, turned.phi, turned.psi))


@compiled
def fill_state(lever, x, gyro, state):
    """Fill the state (10,) of a filter's (14,); see `robot_state`."""
    robot_state(lever, x, gyro, state)
