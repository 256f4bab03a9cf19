"""Wheel torques against the torques that the motion needs: order, sign, and torques that do not fit at all.

The rows of the equations of motion without the lean, about upright and in the heading frame, give the torque between
ball and wheels,

    r_b d/dt (M_vv v + M_vw w) = E^T tau,      M_w. (w_dot, v_dot) about the vertical = -tau_z,      tau = A^T n,

and with it n, the torque that each wheel needs for the motion. A motor supplies it and its driveline's friction:

    u_i = k n_i + f(wheel speed i)             f: dry, viscous, falling with speed; it never drives

so k is one for the right robot, and wheel i's torque follows n_i and its own speed's sign. Every logged torque is
fitted by every wheel's motion, with either sign (`ballbot.log.mapping_search.commands`): the order and signs that
explain the log best are the right ones.

How large the torques are: `ballbot.log.checks.torque_gains`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.log.checks.lean import (
    Motion,
    Rows,
    as_complex,
    as_plane,
)
from ballbot.log.columns import torque_names, wheel_speed_names
from ballbot.log.log import Log
from ballbot.log.signals import local_fit
from ballbot.mechanics.geometry import transforms
from ballbot.mechanics.model import Model, contact_momentum
from ballbot.robot import Robot

#: speed at which the sign of a wheel's dry friction is nearly certain, and above which it is certain [rad/s]
SIGN, TURNING = 0.1, 0.3
#: exponent of the weight of rows by the fraction of the filter's time in which the wheel turned for certain
TURNED_POWER = 4
#: speed at which the falling part of friction has fallen to 37 % [rad/s]
FALLING = 0.6


@dataclass(frozen=True, kw_only=True, eq=False)
class Driving:
    """Torques, needed torques and friction terms of each wheel, at the rows of `Motion`."""

    torque: NDArray[np.float64]  #: (N, n) u as logged, filtered [N m]
    needed: NDArray[np.float64]  #: (N, n) n, the torque that the motion needs of each wheel [N m]
    friction: NDArray[np.float64]  #: (N, n, 3) sign, speed and falling sign of each wheel's speed, filtered
    #: (N, n) fraction of the filter's time in which the wheel turned for certain
    turning: NDArray[np.float64]
    block: NDArray[np.intp]  #: (N,)


def driving_of(log: Log, rows: Rows, motion: Motion, robot: Robot) -> Driving | None:
    """Return the torques of a log and those that its motion needs; None without every wheel's torque."""
    names = torque_names(robot.wheel_count)
    if not set(names) <= set(log.names):
        return None
    torque = rows.filtered(
        log, np.column_stack([log[name] for name in names]), late=0.5 * log.sample_time
    ).value
    speed = smoothed_wheel_speeds(log, robot)
    sign = np.tanh(speed / SIGN)
    parts = (sign, speed, sign * np.exp(-np.abs(speed) / FALLING), (np.abs(speed) > TURNING).astype(float))
    found = rows.filtered(log, np.hstack(parts)).value
    n = robot.wheel_count
    return Driving(
        torque=torque,
        needed=_needed(motion, robot) @ np.linalg.pinv(transforms(robot).T_owb),
        friction=np.stack([found[:, k * n : (k + 1) * n] for k in range(3)], axis=-1),
        turning=np.clip(found[:, 3 * n :], 0.0, 1.0),
        block=motion.block,
    )


def _needed(motion: Motion, robot: Robot) -> NDArray[np.float64]:
    """Return tau (N, 3) [N m], about the heading frame's axes, that the motion needs between ball and wheels."""
    M, r_b = Model(robot).mass_matrix(np.zeros(5)), robot.ball.radius
    (theta, phi), v = motion.lean_rate, motion.velocity
    w, w_dot = as_plane(theta.value + 1j * phi.value), as_plane(theta.rate + 1j * phi.rate)
    w, w_dot = np.column_stack([w, motion.turning]), np.column_stack([w_dot, motion.turning_rate])
    momentum = as_complex(as_plane(v.value) @ M[:2, :2].T + w @ M[:2, 2:].T)
    change = as_complex(as_plane(v.rate) @ M[:2, :2].T + w_dot @ M[:2, 2:].T)
    force = change + 1j * motion.turning * momentum
    about_vertical = w_dot @ M[4, 2:] + as_plane(v.rate) @ M[4, :2]
    return np.column_stack([-r_b * force.imag, r_b * force.real, -about_vertical])


def smoothed_wheel_speeds(log: Log, robot: Robot) -> NDArray[np.float64]:
    """Return each wheel's speed (len(log), n) [rad/s], smoothed; by the states where it is not logged.

    It is missing in rows that lack the states as well.
    """
    from ballbot.log.checks.kinematics import wheel_speeds_of_states

    names = wheel_speed_names(robot.wheel_count)
    logged = set(names) <= set(log.names)
    speeds = np.column_stack([log[name] if logged else np.full(len(log), np.nan) for name in names])
    if not np.isfinite(speeds).all():
        rates = ("x_dot", "y_dot", "theta_dot", "phi_dot", "psi_dot")
        zero = np.zeros(len(log))
        state = [zero, zero, *(log[name] for name in ("theta", "phi", "psi", *rates))]
        by_states = wheel_speeds_of_states(np.column_stack(state), robot)
        speeds = np.where(np.isfinite(speeds), speeds, by_states)
    known = np.isfinite(speeds).all(axis=1)
    rows = max(2, round(0.015 / log.sample_time))
    smooth = np.full_like(speeds, np.nan)
    smooth[known] = local_fit(log.t[known], speeds[known], rows=rows)[0]
    return smooth


def gravity_need(motion: Motion, robot: Robot) -> NDArray[np.float64]:
    """Return gravity's part (N, n) [N m] of the torque that the motion needs of each wheel."""
    law, r_b = contact_momentum(robot), robot.ball.radius
    M_vv = Model(robot).mass_matrix(np.zeros(5))[:2, :2]
    g = -motion.lean[1] + 1j * motion.lean[0]
    force = as_complex(-as_plane(g) @ law.pull.T @ M_vv.T)
    tau = np.column_stack([-r_b * force.imag, r_b * force.real, np.zeros(len(force))])
    return tau @ np.linalg.pinv(transforms(robot).T_owb)
