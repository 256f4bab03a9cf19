"""Wheel torques against the torques that the motion needs: order, sign, and torques that do not fit at all.

The rows of the equations of motion without the lean, about upright and in the heading frame, give the torque between
ball and wheels,

    r_b d/dt (M_vv v + M_vw w) = E^T tau,      M_w. (w_dot, v_dot) about the vertical = -tau_z,      tau = A^T n,

and with it n, the torque that each wheel needs for the motion. A motor supplies it and its driveline's friction:

    u_i = k n_i + f(wheel speed i)             f: dry, viscous, falling with speed; it never drives

so k is one for the right robot, and wheel i's torque follows n_i and its own speed's sign. Every logged torque is
fitted by every wheel's motion, with either sign: the order and signs that explain the log best are the right ones.

How large the torques are: `ballbot.log.checks.torque_gains`.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from ballbot.findings import Finding, error
from ballbot.log.checks.lean import (
    EVERY,
    Motion,
    Rows,
    as_complex,
    as_plane,
    block_sums,
    clarity,
)
from ballbot.log.columns import torque_names, wheel_speed_names
from ballbot.log.log import Log
from ballbot.log.signals import INTERVAL, local_fit
from ballbot.mechanics.geometry import transforms
from ballbot.mechanics.model import Model, contact_momentum
from ballbot.robot import Robot

#: fraction of a torque's variance that another wheel or sign must explain more, and in how many standard errors
CLEAR_GAIN, CLEARLY_BETTER = 0.2, 3.0
#: assignments whose explained fraction is within this of the best's are indistinguishable
AS_GOOD = 0.03
#: fraction of the torques that must be explained to conclude an order or sign: torques of another run of the same robot
#: reach 0.68, as both follow the limit cycle
EXPLAINED = 0.75
#: explained fraction below which torques are unrelated to the motion
UNRELATED = 0.15
#: a column is dead if its variance is below this fraction of the largest one
DEAD = 1e-8
#: speed at which the sign of a wheel's dry friction is nearly certain, and above which it is certain [rad/s]
SIGN, TURNING = 0.1, 0.3
#: exponent of the weight of rows by the fraction of the filter's time in which the wheel turned for certain
TURNED_POWER = 4
#: an order or sign needs this much of such turning, of all wheels together [s]
LEAST_TURNING = 5.0
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


@dataclass(frozen=True)
class Assignment:
    """Which wheel each logged torque drives, from 0, and with which sign."""

    wheels: tuple[int, ...]
    signs: tuple[int, ...]

    @property
    def fault(self) -> str:
        """The fault of the torques under this assignment; empty if they are right."""
        own = tuple(range(len(self.wheels)))
        negated = [f"u{j + 1}" for j, sign in enumerate(self.signs) if sign < 0]
        parts = []
        if self.wheels != own:
            moved = [j for j in own if self.wheels[j] != j]
            if len(moved) == 2:
                parts.append(f"u{moved[0] + 1} and u{moved[1] + 1} are swapped")
            else:
                order = ", ".join(f"u{j + 1} drives wheel {self.wheels[j] + 1}" for j in moved)
                parts.append(f"the torques are in another order ({order})")
        if len(negated) == len(own):
            parts.append("all torques have the opposite sign")
        elif negated:
            parts.append(f"{' and '.join(negated)} {'have' if len(negated) > 1 else 'has'} the opposite sign")
        return " and ".join(parts)

    @property
    def places(self) -> list[tuple[int, int, int]]:
        """For each torque its number, its wheel's, and 0 for its sign as logged or 1 for the other."""
        signed = zip(self.wheels, self.signs, strict=True)
        return [(j, wheel, int(sign < 0)) for j, (wheel, sign) in enumerate(signed)]

    @property
    def changes(self) -> int:
        """Number of separate faults."""
        moved = sum(wheel != j for j, wheel in enumerate(self.wheels))
        negated = self.signs.count(-1)
        return moved + (1 if negated == len(self.signs) else negated)


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


def torque_findings(driving: Driving, *, names: tuple[str, ...]) -> list[Finding]:
    """Fit every torque by every wheel's motion with either sign; return the error of order, sign or no relation."""
    left = _left_unexplained(driving)
    explained = 1.0 - left.sum(axis=-1)  # [torque, wheel, sign]
    every = _assignments(explained)
    scores = {one: float(np.mean([explained[place] for place in one.places])) for one in every}
    best = max(scores.values())
    good = sorted(
        (one for one in every if scores[one] >= best - AS_GOOD), key=lambda one: (one.changes, -scores[one])
    )
    chosen, as_logged = good[0], 100.0 * max(scores[every[0]], 0.0)
    other = [place for place, own in zip(chosen.places, every[0].places, strict=True) if place != own]
    if other:
        own, found = sum(left[j, j, 0] for j, _, _ in other), sum(left[place] for place in other)
        clear = clarity((own - found) / np.maximum(own + found, 1e-30)) > CLEARLY_BETTER
        turned = EVERY * INTERVAL * float(np.sum(driving.turning**TURNED_POWER))
        gained = float(np.sum(own - found)) / len(other)
        if clear and gained > CLEAR_GAIN and turned > LEAST_TURNING and scores[chosen] > EXPLAINED:
            causes = [one.fault for one in good if one.changes <= chosen.changes + 1][:4]
            text = (
                f"The torques do not fit the motion as logged: {', or '.join(causes)}. With this correction they "
                f"explain {100.0 * scores[chosen]:.0f} % of the torque that the motion needs, as logged "
                f"{as_logged:.0f} %. Correct the columns or the mapping."
            )
            if chosen.wheels == every[0].wheels:
                return [error("torque-sign", text, *names)]
            return [error("torque-order", text, *names)]
    if as_logged < 100.0 * UNRELATED:
        text = (
            "The torques are unrelated to the motion: as logged they explain "
            f"{as_logged:.0f} % of the torque that the motion needs, and no other order or signs fit. They are from "
            "another log, shifted in time, or not the torques of the motors."
        )
        return [error("torque-unrelated", text, *names)]
    return []


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


def _left_unexplained(driving: Driving) -> NDArray[np.float64]:
    """Return the fraction (n, n, 2, B) of each torque's variance unexplained by each wheel and sign, by blocks."""
    n, blocks = driving.torque.shape[1], int(driving.block[-1]) + 1
    left = np.ones((n, n, 2, blocks)) / blocks
    dead = DEAD * float(np.square(driving.torque - driving.torque.mean(axis=0)).sum(axis=0).max())
    for i in range(n):
        columns = np.column_stack([driving.needed[:, i], driving.friction[:, i]])
        columns = columns - columns.mean(axis=0)
        size = np.maximum(np.linalg.norm(columns, axis=0), 1e-30)
        for j in range(n):
            u = driving.torque[:, j] - driving.torque[:, j].mean()
            power = float(u @ u)
            if power <= dead:
                continue
            for place, sign in enumerate((1.0, -1.0)):
                # neither the motion's torque nor friction can be negative
                factors, _ = nnls(columns / size, sign * u)
                residual = sign * u - columns / size @ factors
                left[j, i, place] = block_sums(residual**2, driving.block) / power
    return left


def _assignments(explained: NDArray[np.float64]) -> list[Assignment]:
    """Return the order as logged, then every order, each torque with the sign that is not the worse one."""
    n = len(explained)
    own = tuple(range(n))
    found = [Assignment(own, (1,) * n), Assignment(own, (-1,) * n)]
    for order in permutations(range(n)):
        better = [1 if explained[j, i, 0] >= explained[j, i, 1] else -1 for j, i in enumerate(order)]
        found.append(Assignment(order, tuple(better)))
    return list(dict.fromkeys(found))


def gravity_need(motion: Motion, robot: Robot) -> NDArray[np.float64]:
    """Return gravity's part (N, n) [N m] of the torque that the motion needs of each wheel."""
    law, r_b = contact_momentum(robot), robot.ball.radius
    M_vv = Model(robot).mass_matrix(np.zeros(5))[:2, :2]
    g = -motion.lean[1] + 1j * motion.lean[0]
    force = as_complex(-as_plane(g) @ law.pull.T @ M_vv.T)
    tau = np.column_stack([-r_b * force.imag, r_b * force.real, np.zeros(len(force))])
    return tau @ np.linalg.pinv(transforms(robot).T_owb)
