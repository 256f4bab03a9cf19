"""The control law, compiled once for the single robot and for robots in lanes.

    u = K S(psi) (r - x) + compensation,      clipped to the torque limit

S(psi) turns the pairs (x y), (theta phi) of the error and their rates by -psi into the heading frame: K is
designed at psi = 0 and the wheels turn with the body (design section 8). Compensation adds, for wheel i with
encoder speed w_i and the law's own torque u_i,

    full       b w + (c + s exp(-|w/v_s|^delta)) ramp(w)
    partial    the same, only while u_i w_i > 0: where friction works against the intended motion (thesis 5.2)

and the wheel torques that carry the rolling friction N C_rr v/|v| (partial: only while they do not oppose u).
A law is one row of numbers, so that every robot in a batch can have one of its own.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot.mechanics.compiled import compiled, inlined
from ballbot.mechanics.equations import attitude, ball_rate, body_rates
from ballbot.mechanics.friction import dry_friction
from ballbot.mechanics.geometry import transforms
from ballbot.mechanics.parameters import Wheel
from ballbot.mechanics.vector import dot, rotate_back, subtract

if TYPE_CHECKING:
    from ballbot.control.controller import Controller

_COMMON = 9  # numbers before the wheels' own
_PER_WHEEL = 18  # gain (10), axle (3), b, c, s, share of the rolling friction (2)

#: what `control_law` returns where the reference may be followed
ALLOWED = -1


class Common(NamedTuple):
    """What the wheels of a law have in common, in compiled code."""

    inv_rb: float  #: 1/r_b [1/m]
    inv_vs: float  #: 1/v_s [s/rad]
    delta: float
    rolling: float  #: N C_rr [N]
    limit: float  #: torque limit [N m]
    steepness: float  #: 1/(speed band) [s/rad]
    rolling_steepness: float  #: 1/(rolling band) [s/m]
    full: float  #: 1 where compensation is full
    partial: float  #: 1 where it is partial


def pack_law(controller: Controller) -> NDArray[np.float64]:
    """Return a controller's numbers as the row (9 + 18 n,) that compiled code reads."""
    robot, friction = controller.robot, controller.robot.friction
    A = transforms(robot).T_owb
    common = Common(
        inv_rb=1.0 / robot.ball.radius,
        inv_vs=1.0 / friction.stribeck_speed,
        delta=friction.stribeck_exponent,
        rolling=(robot.ball.mass + robot.body.mass) * robot.gravity * friction.rolling,
        limit=controller.torque_limit,
        steepness=1.0 / controller.speed_band,
        rolling_steepness=1.0 / (controller.speed_band * robot.ball.radius),
        full=float(controller.compensation == "full"),
        partial=float(controller.compensation == "partial"),
    )
    own = [
        controller.gain,
        A,
        friction.viscous,
        friction.coulomb,
        friction.stribeck,
        rolling_shares(controller),
    ]
    return np.concatenate([common, np.column_stack(own).ravel()])


def rolling_shares(controller: Controller) -> NDArray[np.float64]:
    """Return the wheel torques (n, 2) of least norm for a force of 1 N along x and along y of the heading frame.

    The torque T = A' u on the ball pushes it over the ground with (T_y, -T_x)/r_b near upright, so a force F
    needs T = r_b (-F_y, F_x, 0); without T_z it does not turn the robot.
    """
    r_b = controller.robot.ball.radius
    T = r_b * np.array([[0.0, -1.0], [1.0, 0.0], [0.0, 0.0]])
    return np.linalg.pinv(transforms(controller.robot).T_owb.T) @ T


@inlined
def _load_common(row):
    return Common(row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7], row[8])


@inlined
def _ramp(value, steepness):
    """Return the sign of a speed, made linear within the band around zero."""
    slope = value * steepness
    return 1.0 if slope > 1.0 else (-1.0 if slope < -1.0 else slope)


@inlined
def _limited(torque, limit):
    """Clip so that a NaN stays one."""
    return limit if torque > limit else (-limit if torque < -limit else torque)


@inlined
def _forbidden(reference):
    """Return the first place at which A r is not 0 (lean or a rate), else `ALLOWED`."""
    for i in (2, 3, 5, 6, 7, 8, 9):
        if reference[i] != 0.0:
            return i
    return ALLOWED


@inlined
def _heading_error(a, state, reference):
    """Return S(psi) (r - x)."""
    e = reference - state
    c, s = a.cos_psi, a.sin_psi
    return (
        c * e[0] + s * e[1],
        c * e[1] - s * e[0],
        c * e[2] + s * e[3],
        c * e[3] - s * e[2],
        e[4],
        c * e[5] + s * e[6],
        c * e[6] - s * e[5],
        c * e[7] + s * e[8],
        c * e[8] - s * e[7],
        e[9],
    )


@inlined
def _feedback(row, place, e):
    return (
        row[place] * e[0]
        + row[place + 1] * e[1]
        + row[place + 2] * e[2]
        + row[place + 3] * e[3]
        + row[place + 4] * e[4]
        + row[place + 5] * e[5]
        + row[place + 6] * e[6]
        + row[place + 7] * e[7]
        + row[place + 8] * e[8]
        + row[place + 9] * e[9]
    )


@inlined
def _wheel_friction(L, row, place, relative) -> tuple[float, float]:
    """Return a wheel's encoder speed and the friction there, its sign a ramp around zero."""
    axle = (row[place + 10], row[place + 11], row[place + 12])
    speed = dot(axle, relative)
    wheel = Wheel(axle, row[place + 13], row[place + 14], row[place + 15], L.inv_vs, L.delta)
    return speed, wheel.b * speed + dry_friction(wheel, speed) * _ramp(speed, L.steepness)


@inlined
def _rolling_force(L, a, v):
    """Return N C_rr v/|v| in the heading frame, v/|v| a ramp around zero."""
    speed = (v[0] * v[0] + v[1] * v[1]) ** 0.5
    size = L.rolling * min(1.0, speed * L.rolling_steepness) / max(speed, 1e-300)
    return size * (a.cos_psi * v[0] + a.sin_psi * v[1]), size * (a.cos_psi * v[1] - a.sin_psi * v[0])


@inlined
def _compensate(L, row, a, state, torques):
    """Add the friction's compensation to the law's torques."""
    v = (state[5], state[6])
    w = body_rates(a, (state[7], state[8], state[9]))
    relative = subtract(rotate_back(a.R, ball_rate(L, v)), w)
    F_x, F_y = _rolling_force(L, a, v)
    agreement = 0.0  # u . rolling
    for i in range(len(torques)):
        place = _COMMON + _PER_WHEEL * i
        agreement += torques[i] * (row[place + 16] * F_x + row[place + 17] * F_y)
    rolling = L.full + (L.partial if agreement > 0.0 else 0.0)
    for i in range(len(torques)):
        place = _COMMON + _PER_WHEEL * i
        speed, friction = _wheel_friction(L, row, place, relative)
        weight = L.full + (L.partial if torques[i] * speed > 0.0 else 0.0)
        torques[i] += weight * friction + rolling * (row[place + 16] * F_x + row[place + 17] * F_y)


@compiled
def control_law(row, state, reference, torques):
    """Fill `torques` (n,) and return `ALLOWED`, or the place in the reference at which A r is not 0.

    Parameters
    ----------
    row : ndarray (9 + 18 n,)
        From `pack_law`.
    state, reference : ndarray (10,)
    torques : ndarray (n,)
        [N m]
    """
    L = _load_common(row)
    a = attitude((state[2], state[3], state[4]))
    e = _heading_error(a, state, reference)
    for i in range(len(torques)):
        torques[i] = _feedback(row, _COMMON + _PER_WHEEL * i, e)
    if L.full + L.partial > 0.0:
        _compensate(L, row, a, state, torques)
    for i in range(len(torques)):
        torques[i] = _limited(torques[i], L.limit)
    return _forbidden(reference)
