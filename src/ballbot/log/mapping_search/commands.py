"""Which command drives which wheel, with which sign, and how the wheels answer.

Ball and wheels pass each other the torques that the motion needs (`ballbot.log.checks.torque_balance`): about upright,
wheel i needs n_i. What drives it is a command d_j of unknown order, sign, kind and scale:

    s_j d_j = a n_i + b w_i + friction's terms in the sign of w_i        w_i speed of the wheel [rad/s]

Every order and every choice of signs is tried; those that explain all commands best, with one a and one b, are the
answer. The commands are on the left: commands that sum to zero are no difficulty there, while a regression of all
wheels on all commands would be collinear, and a wheel's sign would be decided by noise.

A dead band that the firmware adds is counted as less dry friction, which is the same while a wheel turns the way its
duty drives it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from ballbot.log.checks.lean import clarity
from ballbot.log.checks.torque_balance import TURNED_POWER, Driving
from ballbot.log.mapping_search.evidence import (
    ERRORS_WEIGHT,
    MOST,
    jackknife_error,
    probabilities,
    solved,
)
from ballbot.log.mapping_search.placement import vertex_with_error
from ballbot.log.signals import INTERVAL, Smooth


@dataclass(frozen=True, kw_only=True)
class Assignment:
    """Which wheel each command drives."""

    wheels: tuple[int, ...]  #: for the file's commands in turn, the robot's wheel (from 0)
    signs: tuple[int, ...]  #: of the file's commands in turn
    explained: float  #: share of the commands' variance
    advantage: float  #: over the next best assignment, in standard errors over blocks of a second
    next_best: str  #: in words
    confidence: float


def assign(driving: Driving, expected: Sequence[tuple[int, int]]) -> Assignment:
    """Return the order and signs of the commands that the motion explains best.

    Parameters
    ----------
    driving : Driving
        The commands are its torques.
    expected : sequence of tuple of int
        For the file's commands in turn, the robot's wheel (from 0) and the sign of the file's wheel of the same number:
        most teams number motors and encoders alike.
    """
    totals = _left(driving)
    least = min(totals.values(), key=lambda one: float(one.sum()))
    odds = {one: -_log_odds(total, least) for one, total in totals.items()}
    found = probabilities({one: _usual(one, expected) + odd for one, odd in odds.items()})
    seen = probabilities(odds)  # what is usual is preferred among what fits alike, but makes nothing certain
    (wheels, signs), (other, other_signs) = list(found)[:2]
    explained = 1.0 - float(totals[wheels, signs].sum())
    # commands that are torques about axes are mixtures of all wheels': single ones leave 0.38 of them, and at most 0.18
    # on the development halves where they are right
    enough = min(max((explained - 0.5) / 0.2, 0.0), 1.0)
    return Assignment(
        wheels=wheels,
        signs=signs,
        explained=explained,
        advantage=clarity(totals[other, other_signs] - totals[wheels, signs]),
        next_best=f"commands for wheels {tuple(i + 1 for i in other)} with signs {other_signs}",
        confidence=min(_probability((wheels, signs), seen, driving.torque), MOST) * enough,
    )


#: assignments whose torques differ by less than this part of their size are one: half of what torques may be off
SAME_TORQUES = 0.1


def _probability(
    best: tuple[tuple[int, ...], tuple[int, ...]],
    found: dict[tuple[tuple[int, ...], tuple[int, ...]], float],
    commands: NDArray[np.float64],
) -> float:
    """Return the probability of the best assignment and of those that make nearly the same torques.

    With four wheels and a still heading, opposite wheels have opposite commands.
    """
    own = _by_wheel(commands, best)
    size = float(np.std(own))
    return sum(
        p
        for one, p in found.items()
        if p > 1e-3 and float(np.std(_by_wheel(commands, one) - own, axis=0).max()) < SAME_TORQUES * size
    )


def _by_wheel(
    commands: NDArray[np.float64], one: tuple[tuple[int, ...], tuple[int, ...]]
) -> NDArray[np.float64]:
    order, signs = one
    return (commands * np.asarray(signs, dtype=np.float64))[:, np.argsort(order)]


#: logarithm of the ratio of two squared errors from which it counts, too, and its weight for each second;
#: chosen so that of windows of 4 to 12 s of the campaign's recordings fewest are wrong with confidence
LEAST_RATIO, EACH_SECOND = 0.15, 1.5
#: probability that motors are numbered as encoders; that each motor turns for a positive command as its encoder counts,
#: or all motors turn alike, whatever an encoder counts; the rest is for any signs. Chosen, not measured
SAME_ORDER, AS_ENCODERS, ALL_ALIKE = 0.8, 0.5, 0.3


def _log_odds(total: NDArray[np.float64], least: NDArray[np.float64]) -> float:
    """Return by how much (logarithm of odds) an assignment is less likely than the best, from what both leave.

    Either the difference repeats in every block of a second, or it is so large that few blocks are enough.
    """
    z = ERRORS_WEIGHT * min(max(clarity(total - least), 0.0), 60.0)
    ratio = math.log(max(float(total.sum()), 1e-12) / max(float(least.sum()), 1e-12))
    return max(0.5 * z**2, EACH_SECOND * len(total) * max(ratio - LEAST_RATIO, 0.0))


def _usual(one: tuple[tuple[int, ...], tuple[int, ...]], expected: Sequence[tuple[int, int]]) -> float:
    """Return the logarithm of how usual an order and signs are."""
    order, signs = one
    n = len(order)
    same_order = order == tuple(wheel for wheel, _ in expected)
    by_wheel = dict(expected)
    relative = {sign * by_wheel[wheel] for wheel, sign in zip(order, signs, strict=True)}
    p = SAME_ORDER if same_order else (1.0 - SAME_ORDER) / (math.factorial(n) - 1)
    usual = 0.5 * (AS_ENCODERS * (len(relative) == 1) + ALL_ALIKE * (len(set(signs)) == 1))
    return math.log(p * (usual + (1.0 - AS_ENCODERS - ALL_ALIKE) / 2**n))


def _left(driving: Driving) -> dict[tuple[tuple[int, ...], tuple[int, ...]], NDArray[np.float64]]:
    """Return the share (B,) of the commands' variance that each order and choice of signs leaves, by blocks.

    The motors are alike: a and b are common to all wheels, and only dry friction is each wheel's own. None of them can
    be negative. A motor weaker than the others by more than a third can be taken for another if the robot moves along
    one line.
    """
    n, blocks = driving.torque.shape[1], int(driving.block[-1]) + 1
    u = driving.torque - driving.torque.mean(axis=0)
    terms = np.zeros((n, len(u), 2 + 2 * n))  # the terms of each wheel
    for i in range(n):
        terms[i, :, 0], terms[i, :, 1] = driving.needed[:, i], driving.friction[:, i, 1]
        terms[i, :, 2 + 2 * i], terms[i, :, 3 + 2 * i] = driving.friction[:, i, 0], driving.friction[:, i, 2]
    terms = terms - terms.mean(axis=1, keepdims=True)
    terms = terms / np.maximum(np.sqrt(np.square(terms).sum(axis=(0, 1))), 1e-30)
    rows = [driving.block == b for b in range(blocks)]
    products = np.array([np.einsum("ink,inl->kl", terms[:, one], terms[:, one]) for one in rows])
    with_commands = np.array([np.einsum("ink,nj->ijk", terms[:, one], u[one]) for one in rows])
    power = np.array([float(np.square(u[one]).sum()) for one in rows])
    whole = float(power.sum())
    # the same sums of squares, by a triangular matrix in place of all rows
    root = np.linalg.cholesky(products.sum(axis=0) + 1e-9 * np.eye(terms.shape[2])).T
    found = {}
    for order in permutations(range(n)):
        each = with_commands[:, order, range(n)]
        for signs in product((1, -1), repeat=n):
            right = np.asarray(signs, dtype=np.float64) @ each
            factors, _ = nnls(root, np.linalg.solve(root.T, right.sum(axis=0)))
            fitted = np.einsum("k,bkl,l->b", factors, products, factors)
            left = np.maximum(power - 2.0 * right @ factors + fitted, 0.0)
            found[order, signs] = left / whole if whole > 0.0 else np.full(blocks, 1.0 / blocks)
    return found


def gain_of(driving: Driving, assigned: Assignment, pulled: NDArray[np.float64]) -> tuple[float, float]:
    """Return the command a of 1 N m of need (nan if the log does not show it), and its logarithm's standard error.

    Parameters
    ----------
    driving : Driving
        The commands are its torques.
    assigned : Assignment
    pulled : ndarray (N, n)
        Gravity's part of the need, by wheel [N m]: the instrument, which noise of the accelerations is not part of.
    """
    n = driving.torque.shape[1]
    u = _by_wheel(driving.torque, (assigned.wheels, assigned.signs))
    rows = np.arange(n)
    own = np.zeros((len(u), n, 3 * n))  # sign, falling sign and offset of each wheel
    for part, values in enumerate((driving.friction[:, :, 0], driving.friction[:, :, 2], np.ones_like(u))):
        own[:, rows, 3 * rows + part] = values
    speed, weight = driving.friction[:, :, 1, None], driving.turning[..., None] ** TURNED_POWER
    X = np.concatenate([driving.needed[..., None], speed, own, u[..., None]], axis=-1)
    Z = np.concatenate([pulled[..., None], speed, own], axis=-1) * weight
    sums = np.array(
        [
            np.einsum("nwi,nwj->ij", Z[driving.block == b], X[driving.block == b])
            for b in range(int(driving.block[-1]) + 1)
        ]
    )

    def log_gain(of_sums: NDArray[np.float64]) -> float:
        a = solved(of_sums)[0]
        return math.log(a) if a > 0.0 else math.nan

    total = sums.sum(axis=0)
    return math.exp(log_gain(total)), jackknife_error(np.array([log_gain(total - one) for one in sums]))


#: delays of the commands that are tried [s], and the filter of the wheels for it [s]: delays show in what is quick
DELAYS, DELAY_WIDTH = INTERVAL * np.arange(-1.0, 9.0), 0.02
#: part of the signals' own size that is added to the normal equations: commands sum to nearly zero
RIDGE = 1e-3
#: a delay is accepted if the commands explain this share of the wheels' accelerations
LEAST_EXPLAINED = 0.4


def command_delay(
    wheels: Smooth, commands: NDArray[np.float64], usable: NDArray[np.bool_], driven: NDArray[np.float64]
) -> tuple[float, float]:
    """Return how late the wheels (N, n) answer to commands (N, k) [s], and its standard error; nan, inf if unknown.

    The lean is not among what explains them: commands are made of it, and would share its gain. Commands that chatter
    fit half a period later, too, with all signs turned: `driven` (k, n), 1 or -1 where a command drives a wheel and 0
    elsewhere, tells the two apart.
    """
    if usable.sum() * INTERVAL < 3.0:
        return math.nan, math.inf
    y = wheels.acceleration[usable] - wheels.acceleration[usable].mean(axis=0)
    blocks = (np.arange(len(usable)) // round(1.0 / INTERVAL))[usable]
    places, left = np.arange(len(usable), dtype=np.float64), []
    for delay in DELAYS:
        late = np.column_stack([np.interp(places - delay / INTERVAL, places, one) for one in commands.T])
        speed = wheels.rate
        X = np.column_stack([late, speed, np.tanh(speed / 0.3), np.ones(len(late))])[usable]
        size = np.sqrt((X**2).mean(axis=0)) + 1e-12
        normal = (X / size).T @ (X / size) + RIDGE * len(X) * np.eye(X.shape[1])
        factors = np.linalg.solve(normal, (X / size).T @ y)
        backwards = float((factors[: len(driven)] / size[: len(driven), None] * driven).sum()) <= 0.0
        rest = y if backwards else y - X / size @ factors
        left.append(np.bincount(blocks, weights=(rest**2).sum(axis=1)) / float((y**2).sum()))
    if 1.0 - min(float(one.sum()) for one in left) < LEAST_EXPLAINED:
        return math.nan, math.inf
    return vertex_with_error(DELAYS, np.array(left))
