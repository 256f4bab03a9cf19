"""Friction compensation, compiled: what is added to the feedback's torques.

For wheel i with encoder speed w_i and the feedback's own torque u_i,

    full       b w + (c + s exp(-|w/v_s|^delta)) ramp(w)
    partial    the same, only while u_i w_i > 0: where friction works against the intended motion (thesis 5.2)

and the wheel torques that carry the rolling friction N C_rr v/|v| (partial: only while they do not oppose u).

Under a registered friction law a table (`ballbot.control.friction_table`) stands for c + s exp(..).

Friction that depends on direction is compensated for the direction of the speed. The load of a drive is estimated by
the torque about to be commanded, the feedback's plus the compensation without the load term: with full compensation
slightly less than the final command, and never more.

Within the speed band the sign of the speed is a ramp, so that a wheel at rest is not compensated: it sticks until the
feedback alone overcomes its breakaway torque.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot.control.friction_table import SPEEDS, friction_table
from ballbot.control.parts.part import LawSettings, Pair, clipped, turned
from ballbot.control.tuning import compensated_share
from ballbot.mechanics.engine.compiled import inlined
from ballbot.mechanics.engine.elementary import sine_cosine
from ballbot.mechanics.floor import rolling_brake
from ballbot.mechanics.friction import decay, friction_terms, with_stribeck
from ballbot.mechanics.geometry import transforms
from ballbot.records import MAX_WHEELS, number
from ballbot.robot import Robot


@dataclass(frozen=True, kw_only=True, eq=False)
class CompensationRecord:
    """The friction that is compensated, and the mode of compensation."""

    inv_rb: float = field(metadata=number("1/m"))
    inv_vs: float = field(metadata=number("s/rad"))
    delta: float = field(metadata=number("1"))
    #: N C_rr
    rolling: float = field(metadata=number("N"))
    #: 1/(speed band), of a wheel and of the ball
    steepness: float = field(metadata=number("s/rad"))
    rolling_steepness: float = field(metadata=number("s/m"))
    #: 1 if compensation is full, or partial
    full: float = field(metadata=number("1"))
    partial: float = field(metadata=number("1"))
    axles: NDArray[np.float64] = field(metadata=number("1", MAX_WHEELS, 3))
    viscous: NDArray[np.float64] = field(metadata=number("N m s/rad", MAX_WHEELS))
    coulomb: NDArray[np.float64] = field(metadata=number("N m", MAX_WHEELS))
    stribeck: NDArray[np.float64] = field(metadata=number("N m", MAX_WHEELS))
    #: 1 if the friction has one of the next three terms
    directed: float = field(metadata=number("1"))
    coulomb_asymmetry: NDArray[np.float64] = field(metadata=number("N m", MAX_WHEELS))
    stribeck_asymmetry: NDArray[np.float64] = field(metadata=number("N m", MAX_WHEELS))
    load: NDArray[np.float64] = field(metadata=number("1", MAX_WHEELS))
    #: 1 if the friction is by a registered law, and its table: sizes at speeds
    tabulated: float = field(metadata=number("1"))
    table_speeds: NDArray[np.float64] = field(metadata=number("rad/s", SPEEDS))
    table_sizes: NDArray[np.float64] = field(metadata=number("N m", MAX_WHEELS, SPEEDS))
    #: torque for a force of 1 N along x, and along y
    for_rolling: NDArray[np.float64] = field(metadata=number("m", MAX_WHEELS, 2))


def compensation_record(settings: LawSettings) -> CompensationRecord:
    """Return the friction of a controller's robot as compiled code reads it."""
    robot, friction = settings.robot, settings.robot.friction
    d, e, mu = friction_terms(friction).T
    table, none = None, np.zeros(robot.wheel_count)
    if friction.own_law and settings.compensation != "none":
        table = friction_table(robot)
        mu = table.load
    law = friction.own_law is not None
    return CompensationRecord(
        inv_rb=1.0 / robot.ball.radius,
        inv_vs=1.0 / friction.stribeck_speed,
        delta=friction.stribeck_exponent,
        rolling=robot.rolling_force,
        steepness=1.0 / settings.speed_band,
        rolling_steepness=1.0 / (settings.speed_band * robot.ball.radius),
        full=float(settings.compensation == "full"),
        partial=float(settings.compensation == "partial"),
        axles=transforms(robot).T_owb,
        viscous=np.asarray(friction.viscous),
        coulomb=none if law else np.asarray(friction.coulomb),
        stribeck=none if law else np.asarray(friction.stribeck),
        directed=float(bool(d.any() or e.any() or mu.any())),
        coulomb_asymmetry=d,
        stribeck_asymmetry=e,
        load=mu,
        tabulated=float(table is not None),
        table_speeds=table.speeds if table else np.zeros(SPEEDS),
        table_sizes=table.sizes if table else np.zeros((robot.wheel_count, SPEEDS)),
        for_rolling=rolling_torques(robot),
    )


def rolling_torques(robot: Robot) -> NDArray[np.float64]:
    """Return the wheel torques (n, 2) of least norm for a force of 1 N along x and along y of the heading frame.

    The torque T = A' u on the ball pushes it over the ground with (T_y, -T_x)/r_b near upright, so a force F
    needs T = r_b (-F_y, F_x, 0); without T_z it does not turn the robot.
    """
    r_b = robot.ball.radius
    T = r_b * np.array([[0.0, -1.0], [1.0, 0.0], [0.0, 0.0]])
    return np.linalg.pinv(transforms(robot).T_owb.T) @ T


class _Relative(NamedTuple):
    """The ball's angular velocity relative to the body, body frame."""

    x: float  # [rad/s]
    y: float
    z: float


@inlined
def compensate(law, memory, now, torques, n):
    """Add the friction's compensation to the feedback's torques."""
    own, added = law.compensation, memory.history.friction_compensation
    relative, force = _relative_rate(own, now), _rolling_force(own, now)
    agreement = 0.0  # u . rolling
    for i in range(n):
        agreement += torques[i] * _rolling_torque(own, i, force)
    rolls, share = own.full + (own.partial if agreement > 0.0 else 0.0), compensated_share(memory)
    for i in range(n):
        friction = _wheel_friction(own, i, relative, torques[i])
        works_against = torques[i] * friction > 0.0
        fraction = own.full + (own.partial if works_against else 0.0)
        more = share * (fraction * friction + rolls * _rolling_torque(own, i, force))
        torques[i] += more
        added[0, i] = more


@inlined
def _relative_rate(own, now):
    """Return R^T Omega - w, with the ball's Omega = (-v_y, v_x, 0)/r_b and the body's w."""
    state = now.state
    sin_theta, cos_theta = sine_cosine(state.theta)
    sin_phi, cos_phi = sine_cosine(state.phi)
    # after the turns by -theta and -phi, before that by -psi
    Omega_x, Omega_y = -state.y_dot * own.inv_rb, state.x_dot * own.inv_rb
    x = cos_phi * (Omega_x - state.theta_dot) + sin_phi * sin_theta * Omega_y
    y = cos_theta * Omega_y - state.phi_dot
    z = sin_phi * (Omega_x - state.theta_dot) - cos_phi * sin_theta * Omega_y - state.psi_dot
    horizontal = turned(now.a, x, y)
    return _Relative(horizontal.x, horizontal.y, z)


@inlined
def _rolling_force(own, now):
    """Return N C_rr v/|v| in the heading frame, v/|v| a ramp around zero."""
    v_x, v_y = now.state.x_dot, now.state.y_dot
    speed = (v_x * v_x + v_y * v_y) ** 0.5
    size = rolling_brake(own.rolling * min(1.0, speed * own.rolling_steepness), speed)
    v = turned(now.a, v_x, v_y)
    return Pair(size * v.x, size * v.y)


@inlined
def _rolling_torque(own, i, force):
    """Return a wheel's part in carrying the rolling friction."""
    return own.for_rolling[i, 0] * force.x + own.for_rolling[i, 1] * force.y


@inlined
def _wheel_friction(own, i, relative, torque):
    """Return a wheel's friction where the feedback's torque is `torque`."""
    axle = own.axles[i]
    speed = axle[0] * relative.x + axle[1] * relative.y + axle[2] * relative.z
    ramp, E = clipped(speed * own.steepness, 1.0), decay(abs(speed) * own.inv_vs, own.delta)
    friction = own.viscous[i] * speed + with_stribeck(own.coulomb[i], own.stribeck[i], E) * ramp
    if own.tabulated > 0.0:
        friction += _tabulated(own, i, abs(speed)) * ramp
    if own.directed > 0.0:
        # the difference to the mean of both directions: added forward, subtracted backward
        friction += with_stribeck(own.coulomb_asymmetry[i], own.stribeck_asymmetry[i], E) * abs(ramp)
        friction += own.load[i] * abs(torque + friction) * ramp
    return friction


@inlined
def _tabulated(own, i, speed):
    """Return a wheel's friction by the table, at a speed of zero or more."""
    index, width = 0, SPEEDS // 2
    while width > 0:
        if index + width < SPEEDS - 1 and own.table_speeds[index + width] <= speed:
            index += width
        width //= 2
    first, second = own.table_speeds[index], own.table_speeds[index + 1]
    share = min((speed - first) / (second - first), 1.0)
    return own.table_sizes[i, index] + share * (own.table_sizes[i, index + 1] - own.table_sizes[i, index])
