"""Friction compensation, compiled: what is added to the feedback's torques, with its behaviour at standstill.

For wheel i with encoder speed w_i and the feedback's own torque u_i,

    full       b w + (c + s exp(-|w/v_s|^delta)) ramp(w)
    partial    the same, only while u_i w_i > 0: where friction works against the intended motion (thesis 5.2)

and the wheel torques that carry the rolling friction N C_rr v/|v| (partial: only while they do not oppose u).

Below the speed band the sign of a speed is a ramp, so that a wheel at rest is not compensated
at all: it sticks until the feedback alone overcomes its breakaway torque, and then jumps. `Standstill` has two cures,
each a fraction from 0 (off) to 1:

    ahead      reference blend: the speed compensated is w + ahead (w_d - w), w_d that of the motion asked for: friction
               is paid before the wheel turns, and at a fixed position there is nothing to chatter
    feed       breakaway assist: within the band, feed (1 - |ramp(w)|) (c + s) u/u_0 is added, u the feedback's own
               torque, u/u_0 limited to between -1 and 1: a wheel at rest gets its breakaway torque in the direction in
               which it is pushed
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.mechanics.engine.compiled import inlined
from ballbot.mechanics.engine.vector import dot, rotate_back, subtract
from ballbot.mechanics.equations import ball_rate, body_rates
from ballbot.mechanics.friction import dry_friction
from ballbot.mechanics.geometry import transforms
from ballbot.mechanics.parameters import Wheel
from ballbot.robot import Robot

if TYPE_CHECKING:
    from ballbot.control.controller import Controller


@dataclass(frozen=True, kw_only=True)
class Standstill:
    """How friction is compensated about zero speed.

    Raises
    ------
    InputError
        Where a share is not between 0 and 1, or the torque is not positive.
    """

    ahead: float = 0.0  #: share of the speed asked for in the speed compensated
    feed: float = 0.0  #: share of the break-away torque that a wheel at rest is given
    feed_torque: float = 0.2  #: u_0, the law's torque at which it is given in full [N m]

    def __post_init__(self) -> None:
        for name in ("ahead", "feed"):
            value = getattr(self, name)
            if not 0.0 <= value <= 1.0:
                raise InputError(f"{name} of the standstill is {value:g}; it must be from 0 to 1.")
        if not (math.isfinite(self.feed_torque) and self.feed_torque > 0.0):
            raise InputError(
                f"feed_torque of the standstill is {self.feed_torque:g} N m; it must be positive."
            )


#: numbers that `pack_standstill` returns
STANDSTILL_SIZE = 3


def pack_standstill(standstill: Standstill | None) -> list[float]:
    """Return share ahead, share fed and 1/u_0; no share of anything where there is none."""
    if standstill is None:
        return [0.0, 0.0, 1.0]
    return [standstill.ahead, standstill.feed, 1.0 / standstill.feed_torque]


class Friction(NamedTuple):
    """What the wheels share of the compensation, in compiled code."""

    inv_rb: float  #: 1/r_b [1/m]
    inv_vs: float  #: 1/v_s [s/rad]
    delta: float
    rolling: float  #: N C_rr [N]
    steepness: float  #: 1/(speed band) [s/rad]
    rolling_steepness: float  #: 1/(rolling band) [s/m]
    full: float  #: 1 where compensation is full
    partial: float  #: 1 where it is partial
    ahead: float  #: share of the speed asked for
    feed: float  #: share of the break-away torque given at rest
    feed_steepness: float  #: 1/u_0 [1/(N m)]


#: numbers that `pack_friction` returns for all wheels together, and for each: axle (3), b, c, s, share of the
#: rolling friction (2)
FRICTION_SIZE, FRICTION_PER_WHEEL = 8 + STANDSTILL_SIZE, 8


def pack_friction(controller: Controller) -> tuple[list[float], NDArray[np.float64]]:
    """Return what the wheels share (11,) and their own numbers (n, 8)."""
    robot, friction = controller.robot, controller.robot.friction
    shared = Friction(
        1.0 / robot.ball.radius,
        1.0 / friction.stribeck_speed,
        friction.stribeck_exponent,
        (robot.ball.mass + robot.body.mass) * robot.gravity * friction.rolling,
        1.0 / controller.speed_band,
        1.0 / (controller.speed_band * robot.ball.radius),
        float(controller.compensation == "full"),
        float(controller.compensation == "partial"),
        *pack_standstill(controller.parts.standstill),
    )
    own = [
        transforms(robot).T_owb,
        friction.viscous,
        friction.coulomb,
        friction.stribeck,
        rolling_fractions(robot),
    ]
    return list(shared), np.column_stack(own)


def rolling_fractions(robot: Robot) -> NDArray[np.float64]:
    """Return the wheel torques (n, 2) of least norm for a force of 1 N along x and along y of the heading frame.

    The torque T = A' u on the ball pushes it over the ground with (T_y, -T_x)/r_b near upright, so a force F
    needs T = r_b (-F_y, F_x, 0); without T_z it does not turn the robot.
    """
    r_b = robot.ball.radius
    T = r_b * np.array([[0.0, -1.0], [1.0, 0.0], [0.0, 0.0]])
    return np.linalg.pinv(transforms(robot).T_owb.T) @ T


@inlined
def load_friction(row, place):
    """Return the `Friction` at that place of a row."""
    return Friction(
        row[place],
        row[place + 1],
        row[place + 2],
        row[place + 3],
        row[place + 4],
        row[place + 5],
        row[place + 6],
        row[place + 7],
        row[place + 8],
        row[place + 9],
        row[place + 10],
    )


@inlined
def relative_rate(F, a, rates):
    """Return the ball's angular velocity relative to the body, body frame, for rates (x_dot .. psi_dot)."""
    w = body_rates(a, (rates[2], rates[3], rates[4]))
    return subtract(rotate_back(a.R, ball_rate(F, (rates[0], rates[1]))), w)


@inlined
def rolling_force(F, a, rates):
    """Return N C_rr v/|v| in the heading frame, v/|v| a ramp around zero."""
    v_x, v_y = rates[0], rates[1]
    speed = (v_x * v_x + v_y * v_y) ** 0.5
    size = F.rolling * min(1.0, speed * F.rolling_steepness) / max(speed, 1e-300)
    return size * (a.cos_psi * v_x + a.sin_psi * v_y), size * (a.cos_psi * v_y - a.sin_psi * v_x)


@inlined
def rolling_torque(row, place, force):
    """Return a wheel's part in carrying the rolling friction, its numbers at that place of the row."""
    return row[place + 6] * force[0] + row[place + 7] * force[1]


@inlined
def wheel_friction(F, row, place, relative, own, dry) -> tuple[float, float, float]:
    """Return a wheel's friction, the share compensated where the law's torque is `own`, and the wheel's speed.

    Its c and s are multiplied by `dry`.
    """
    axle = (row[place], row[place + 1], row[place + 2])
    speed = dot(axle, relative)
    wheel = Wheel(axle, row[place + 3], dry * row[place + 4], dry * row[place + 5], F.inv_vs, F.delta)
    ramp = _ramp(speed * F.steepness)
    given = F.feed * (1.0 - abs(ramp)) * (wheel.c + wheel.s) * _ramp(own * F.feed_steepness)
    friction = wheel.b * speed + dry_friction(wheel, speed) * ramp + given
    works_against = own * friction > 0.0
    return friction, F.full + (F.partial if works_against else 0.0), speed


@inlined
def _ramp(value):
    """Return a sign that is linear between -1 and 1."""
    return 1.0 if value > 1.0 else (-1.0 if value < -1.0 else value)
