"""Wheel torques against the torques that the motion needs: order, sign, scale, and torques that do not fit at all.

The rows of the equations of motion without the lean, about upright and in the heading frame, give the torque between
ball and wheels,

    r_b d/dt (M_vv v + M_vw w) = E^T tau,      M_w. (w_dot, v_dot) about the vertical = -tau_z,      tau = A^T n,

and with it n, the torque that each wheel needs for the motion. A motor supplies it and its driveline's friction:

    u_i = k n_i + f(wheel speed i)             f: dry, viscous, falling with speed; it never drives

so k is one for the right robot, and wheel i's torque follows n_i and its own speed's sign. Every logged torque is
fitted by every wheel's motion, with either sign: the order and signs that explain the log best are the right ones.

Regression of a torque on the torque that the motion needs gives too small a factor, because the need is computed from
differentiated signals and has their noise. The size of each wheel's torque is therefore estimated from the acceleration
that gravity causes: gravity's part of the need depends on the lean alone,

    z = A^-T r_b E^T M_vv (-Lambda g)          (`ballbot.mechanics.contact_momentum`)

Its noise is that of another sensor, so that k = (z . u) / (z . n), both without the part that follows the wheel's
friction, has no such bias (an instrumental variable). It is 0.95 to 1.1 on logs with enough motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from ballbot.findings import Finding, Place
from ballbot.log.checks.lean import (
    EVERY,
    Motion,
    Rows,
    as_complex,
    as_plane,
    block_sums,
    clarity,
    unexplained,
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
#: fraction of the torques that must be explained to conclude a scale, and an order or sign
EXPLAINED, EXPLAINED_FOR_ORDER = 0.3, 0.45
#: explained fraction below which torques are unrelated to the motion
UNRELATED = 0.15
#: scale k that is an error, and one that is a warning; the larger the bracket (k by regression of need on torque over k
#: by regression of torque on need) the farther from one, as sticking wheels' friction follows the need
TOO_LARGE, LARGE, BRACKET_POWER = 1.25, 1.15, 0.75
#: a scale too large must be this many times larger if less than this fraction of the torques is explained: friction
#: that is fed forward, or that sticks, then follows the need
UNCLEAR_FRACTION, UNCLEAR_FACTOR = 0.8, 1.3
#: too small by the second regression, or by the first if the bracket is narrow
TOO_SMALL, TOO_SMALL_IF_NARROW, NARROW = 0.77, 0.62, 1.7
#: least scale of the first kind for the conclusion of an order or sign, and the widest bracket
LEAST_SCALE, WIDEST = 0.4, 4.5
#: a column is dead if its variance is below this fraction of the largest one
DEAD = 1e-8
SURE = 3.0
#: speed at which the sign of a wheel's dry friction is nearly certain, and above which it is certain [rad/s]
SIGN, TURNING = 0.1, 0.3
#: exponent of the weight of rows by the fraction of the filter's time in which the wheel turned for certain
TURNED_POWER = 12
#: a scale needs this much of such turning, of all wheels together [s]
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
    def changes(self) -> int:
        """Number of separate faults."""
        moved = sum(wheel != j for j, wheel in enumerate(self.wheels))
        negated = self.signs.count(-1)
        return moved + (1 if negated == len(self.signs) else negated)


@dataclass(frozen=True, kw_only=True, eq=False)
class TorqueEvidence:
    """The torques of one log compared with its motion."""

    assignments: tuple[Assignment, ...]  #: the best explanations, simplest first
    explained: float  #: fraction of the torques' variance that the best explains
    as_logged: float  #: fraction that the columns as logged explain
    clearness: float  #: advantage of the best over the columns as logged, in standard errors
    differing: float  #: mean fraction gained on the torques that the best assigns differently
    scale: tuple[float, float]  #: k by regression of torque on need, and of need on torque
    scale_error: float  #: standard error of the first
    turning: float  #: fraction of time in which wheels turned for certain


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


def torque_evidence(driving: Driving) -> TorqueEvidence:
    """Fit every logged torque by every wheel's motion with either sign, and compare the assignments."""
    n = driving.torque.shape[1]
    left = _left_unexplained(driving)
    explained = 1.0 - left.sum(axis=-1)  # [torque, wheel, sign]
    own = Assignment(tuple(range(n)), (1,) * n)
    every = _assignments(explained)
    scores = {one: _mean(explained, one) for one in every}
    best = max(scores, key=lambda one: scores[one])
    good = sorted(
        (one for one in every if scores[one] >= scores[best] - AS_GOOD),
        key=lambda one: (one.changes, -scores[one]),
    )
    chosen = good[0]
    other = [j for j in range(n) if (chosen.wheels[j], chosen.signs[j]) != (j, 1)]
    gain = np.array([left[j, j, 0] - left[j, chosen.wheels[j], _place(chosen.signs[j])] for j in other])
    scale, error = _scale(driving, chosen)
    return TorqueEvidence(
        assignments=tuple(good),
        explained=scores[chosen],
        as_logged=scores[own],
        clearness=clarity(_bounded(left, chosen, other)) if other else 0.0,
        differing=float(gain.sum(axis=1).mean()) if other else 0.0,
        scale=scale,
        scale_error=error,
        turning=float(driving.turning.mean()),
    )


def torque_findings(found: TorqueEvidence, *, names: tuple[str, ...]) -> list[Finding]:
    """Return findings on the torques: order, sign, scale, or that they are unrelated to the motion."""
    where = Place(columns=names)
    best, (forward, reverse) = found.assignments[0], found.scale
    coherent = forward > LEAST_SCALE and 0.0 < reverse < WIDEST * forward
    clear = found.differing > CLEAR_GAIN and found.clearness > CLEARLY_BETTER
    if best.changes and clear and coherent and found.explained > EXPLAINED_FOR_ORDER:
        return [_misplaced(found, where)]
    if found.as_logged < UNRELATED:
        sentence = (
            "The torques are unrelated to the motion: as logged they explain "
            f"{100 * max(found.as_logged, 0.0):.0f} % of the torque that the motion needs, and no other order "
            "or signs fit. They are from another log, shifted in time, or not the torques of the motors."
        )
        return [Finding(code="torque-unrelated", severity="error", text=sentence, where=where)]
    return _scale_findings(found, where) if found.explained > EXPLAINED else []


def _misplaced(found: TorqueEvidence, where: Place) -> Finding:
    """Return the finding that names every order and sign of the torques that fits as well as the best."""
    best = found.assignments[0]
    causes = [one.fault for one in found.assignments if one.changes <= best.changes + 1][:4]
    sentence = (
        f"The torques do not fit the motion as logged: {', or '.join(causes)}. With this correction "
        f"they explain {100 * found.explained:.0f} % of the torque that the motion needs, as logged "
        f"{100 * max(found.as_logged, 0.0):.0f} %. Correct the columns or the mapping."
    )
    if best.wheels == tuple(range(len(best.wheels))):
        return Finding(code="torque-sign", severity="error", text=sentence, where=where)
    return Finding(code="torque-order", severity="error", text=sentence, where=where)


def _scale_findings(found: TorqueEvidence, where: Place) -> list[Finding]:
    forward, reverse = found.scale
    margin, bracket = SURE * found.scale_error, reverse / forward if forward > 0.0 else float("inf")
    small = reverse + margin < TOO_SMALL or (bracket < NARROW and forward + margin < TOO_SMALL_IF_NARROW)
    widened = bracket**BRACKET_POWER * (UNCLEAR_FACTOR if found.explained < UNCLEAR_FRACTION else 1.0)
    large = forward - margin > LARGE * widened
    if not small and not large:
        return []
    error = small or forward - margin > TOO_LARGE * widened
    sentence = (
        f"The torques are {(forward if large else reverse):.2g} times as large as the motion of this robot "
        "needs: u1, u2 .. are scaled (torque constant, gear ratio, current or per-unit values in "
        f"place of N m), or the robot is {('heavier' if large else 'lighter')} than in the robot file."
    )
    return [
        Finding(code="torque-scale", severity="error" if error else "warning", text=sentence, where=where)
    ]


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
    """Return every order, each torque with every sign that is not clearly the worse one, and the order as logged."""
    n = len(explained)
    found = {Assignment(tuple(range(n)), (1,) * n), Assignment(tuple(range(n)), (-1,) * n)}
    for order in permutations(range(n)):
        better = [1 if explained[j, order[j], 0] >= explained[j, order[j], 1] else -1 for j in range(n)]
        found.add(Assignment(order, tuple(better)))
    return list(found)


def _place(sign: int) -> int:
    return 0 if sign > 0 else 1


def _mean(explained: NDArray[np.float64], one: Assignment) -> float:
    return float(
        np.mean(
            [explained[j, i, _place(s)] for j, (i, s) in enumerate(zip(one.wheels, one.signs, strict=True))]
        )
    )


def _bounded(left: NDArray[np.float64], one: Assignment, torques: list[int]) -> NDArray[np.float64]:
    """Return the advantage (B,) of an assignment over the columns as logged, by blocks, from -1 to 1."""
    own = sum(left[j, j, 0] for j in torques)
    best = sum(left[j, one.wheels[j], _place(one.signs[j])] for j in torques)
    return np.asarray((own - best) / np.maximum(own + best, 1e-30))


def enough_turning(driving: Driving) -> bool:
    """Return whether the wheels turn for certain long enough to estimate the torques' scale."""
    return EVERY * INTERVAL * float(np.sum(driving.turning**TURNED_POWER)) >= LEAST_TURNING


def _scale(driving: Driving, one: Assignment) -> tuple[tuple[float, float], float]:
    """Return k by regression of torque on need, and of need on torque, and the first's standard error.

    Rows are weighted by the fraction of time in which the wheel turned for certain: the friction of a sticking wheel is
    unknown.
    """
    xx, xy, yy = (np.zeros(int(driving.block[-1]) + 1) for _ in range(3))
    for j, (i, sign) in enumerate(zip(one.wheels, one.signs, strict=True)):
        weight = driving.turning[:, i] ** TURNED_POWER
        columns = np.column_stack([driving.friction[:, i], np.ones(len(weight))]) * weight[:, None]
        x = unexplained(columns, driving.needed[:, i] * weight)
        y = unexplained(columns, sign * driving.torque[:, j] * weight)
        for sums, product in ((xx, x * x), (xy, x * y), (yy, y * y)):
            sums += block_sums(product, driving.block)
    if not enough_turning(driving) or not (xx.sum() > 0.0 and yy.sum() > 0.0 and xy.sum() > 0.0):
        return (0.0, float("inf")), float("inf")
    k = xy.sum() / xx.sum()
    error = float(np.sqrt(np.sum((xy - k * xx) ** 2)) / xx.sum())
    return (float(k), float(yy.sum() / xy.sum())), error


GAIN_SURE = 3.0
#: standard error above which nothing is concluded, relative to the factor; for one torque, relative to the larger of
#: its own and the others' median
KNOWN = 0.08
#: seconds of motion above which one torque is checked by itself: of 42 intervals of 12 s of correct logs of the twin
#: one still gets the error, of 14 and 16 s none
LEAST_SECONDS = 14
#: factor of all torques that is an error; sticking friction follows the need and adds up to a half to it
GAIN_TOO_LARGE = 1.55
#: one torque's factor over the others' median that is an error
ONE_TOO_LARGE, ONE_TOO_SMALL = 1.55, 0.62


@dataclass(frozen=True, kw_only=True, eq=False)
class Gains:
    """Factors of the torques relative to those that the motion needs."""

    all: float
    all_error: float  #: standard error
    each: NDArray[np.float64]  #: (n,)
    each_error: NDArray[np.float64]  #: (n,) standard errors
    #: (n, 2) smallest and largest factor with any one second excluded: one reversal can dominate, and then the standard
    #: error is too small
    each_without_one: NDArray[np.float64]
    seconds: int  #: of motion

    @property
    def known(self) -> bool:
        """Whether the log determines them."""
        return bool(np.isfinite(self.each).all()) and self.all_error < KNOWN * self.all


def torque_gains(driving: Driving, motion: Motion, robot: Robot) -> Gains | None:
    """Return the factors of a log's torques; None if its wheels turn too little."""
    if not enough_turning(driving):
        return None
    pulled = gravity_need(motion, robot)
    of_need, of_torque = [], []
    for i in range(driving.torque.shape[1]):
        weight = driving.turning[:, i] ** TURNED_POWER
        columns = np.column_stack([driving.friction[:, i], np.ones(len(weight))]) * weight[:, None]
        z, n, u = (
            unexplained(columns, signal[:, i] * weight) for signal in (pulled, driving.needed, driving.torque)
        )
        of_need.append(block_sums(z * n, driving.block))
        of_torque.append(block_sums(z * u, driving.block))
    pairs = list(zip(of_need, of_torque, strict=True))
    factors = [_factor(zn, zu) for zn, zu in pairs]
    together, error = _factor(np.sum(of_need, axis=0), np.sum(of_torque, axis=0))
    return Gains(
        all=together,
        all_error=error,
        each=np.array([factor for factor, _ in factors]),
        each_error=np.array([one for _, one in factors]),
        each_without_one=np.array([_without_one(zn, zu) for zn, zu in pairs]),
        seconds=len(of_need[0]),
    )


def gain_findings(found: Gains, torque: TorqueEvidence, *, names: tuple[str, ...]) -> list[Finding]:
    """Return the error of one torque that is scaled unlike the others, or of all that are too large."""
    if not found.known:
        return []
    # with four wheels, the needed torques are not unique
    if len(names) == 3 and found.seconds >= LEAST_SECONDS:
        for j in range(len(names)):
            if findings := _one_unlike_the_others(found, j, names[j]):
                return findings
    too_large = GAIN_TOO_LARGE * (UNCLEAR_FACTOR if torque.explained < UNCLEAR_FRACTION else 1.0)
    if found.all - GAIN_SURE * found.all_error > too_large:
        sentence = (
            f"The torques are {found.all:.2g} times as large as the motion of this robot needs: "
            f"{names[0]}, {names[1]} .. are scaled (torque constant, gear ratio, current or "
            "per-unit values in place of N m), or the robot is heavier than in the robot file."
        )
        return [Finding(code="torque-scale", severity="error", text=sentence, where=Place(columns=names))]
    return []


def _one_unlike_the_others(found: Gains, j: int, name: str) -> list[Finding]:
    factor, error, rest = found.each[j], found.each_error[j], np.delete(found.each, j)
    others = float(np.median(rest))
    if rest.min() <= 0.0 or not error < KNOWN * max(factor, others):
        return []
    least, most = found.each_without_one[j]
    too_large = min(factor - GAIN_SURE * error, least) > ONE_TOO_LARGE * others
    too_small = max(factor + GAIN_SURE * error, most) < ONE_TOO_SMALL * others
    if not (too_large or too_small):
        return []
    sentence = (
        f"{name} is {factor / others:.2g} times as large as the other torques, relative to the torque that "
        "the motion of its wheel needs: its torque constant, gear ratio or unit differs, or "
        "its motor gives less than the command. Correct the scale of the column in a mapping."
    )
    return [Finding(code="torque-scale", severity="error", text=sentence, where=Place(columns=(name,)))]


def _factor(zn: NDArray[np.float64], zu: NDArray[np.float64]) -> tuple[float, float]:
    """Return (z . u) / (z . n) and its standard error, by blocks; infinite if undetermined."""
    total = float(np.sum(zn))
    if total == 0.0:
        return float("inf"), float("inf")
    k = float(np.sum(zu)) / total
    return k, float(np.sqrt(np.sum((zu - k * zn) ** 2)) / abs(total))


def _without_one(zn: NDArray[np.float64], zu: NDArray[np.float64]) -> tuple[float, float]:
    """Return the smallest and the largest (z . u) / (z . n) with one block excluded."""
    with np.errstate(divide="ignore", invalid="ignore"):
        factors = (zu.sum() - zu) / (zn.sum() - zn)
    return float(factors.min()), float(factors.max())


def gravity_need(motion: Motion, robot: Robot) -> NDArray[np.float64]:
    """Return gravity's part (N, n) [N m] of the torque that the motion needs of each wheel."""
    law, r_b = contact_momentum(robot), robot.ball.radius
    M_vv = Model(robot).mass_matrix(np.zeros(5))[:2, :2]
    g = -motion.lean[1] + 1j * motion.lean[0]
    force = as_complex(-as_plane(g) @ law.pull.T @ M_vv.T)
    tau = np.column_stack([-r_b * force.imag, r_b * force.real, np.zeros(len(force))])
    return tau @ np.linalg.pinv(transforms(robot).T_owb)
