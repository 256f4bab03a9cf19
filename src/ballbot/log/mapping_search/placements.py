"""All placements of the wheels: how well every order and every choice of signs fits a log of balancing.

A placement is judged by the residual of the lean's acceleration, and by the part of the wheels' motion that is neither
lean nor heading. Both come from sums over blocks of the log, so that every placement, with each block left out in turn,
takes a small system of equations.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from ballbot.log.mapping_search.evidence import (
    CONFIDENT,
    ERRORS_WEIGHT,
    MOST,
    TINY,
    jackknife_error,
    probabilities,
)
from ballbot.log.signals import INTERVAL, Smooth
from ballbot.robot import Robot

#: windows [s] that share one weight, one over their residual's size, and that the jackknife leaves out in turn
BLOCK = 1.0
#: below this many seconds an order or a sign must fit `SHORT_MARGIN` times better than any other
SHORT_TIME, SHORT_MARGIN = 8.0, 2.0
#: share of the lean's acceleration that may be left, and at which the confidence is zero
USUAL_REST, LARGEST_REST = 0.5, 0.85
#: share of the wheels' motion that rollers and slip leave anyway
LEAST_TOGETHER = 0.003
#: weight of motion that all wheels share in a log without heading, over motion that no rolling ball allows. Four wheels
#: have both: opposite wheels exchanged and negated turn the one into the other, and change nothing else
UNKNOWN_HEADING = 0.3
#: before the log is seen: wheels in the robot's order, and in the opposite one; wheels of equal signs
OWN_ORDER, MIRRORED_ORDER, EQUAL_SIGNS = 0.55, 0.25, 0.6
#: power of the prior in the confidence: a usual order is preferred among placements that fit alike, but does not make
#: one certain
PRIOR_POWER = 0.7
#: logarithm of the ratio of two misfits from which it counts, too, and its weight for each second;
#: chosen so that of windows of 4 to 12 s of the campaign's recordings fewest are wrong with confidence
LEAST_RATIO, EACH_SECOND = 0.2, 0.6
#: placements whose wheels differ by less than this part of their angles count as one; a mapping whose wheels are off by
#: 0.03 is still right (campaigns/mapping_corpus.py)
SAME_WHEELS = 0.028
#: wheel speed (root of the sum of squares) below which the ball hardly rolls, and rolling friction has no sign [rad/s]
ROLLING = 0.2


@dataclass(frozen=True, kw_only=True)
class Placement:
    """One way in which the wheels' columns may sit on the robot, and how well the log agrees."""

    positions: tuple[int, ...]  #: for the file's wheels in turn, the robot's wheel (from 1)
    signs: tuple[int, ...]  #: of the file's wheels in turn, up to all of them
    phase: float  #: [rad], the angle of gamma
    gain: float  #: its size, over the robot's own gamma
    unexplained: float  #: share of the lean's acceleration
    together: float  #: share of the wheels' motion that is neither lean nor heading
    misfit: float  #: unexplained, times the root of together

    @property
    def mirrored(self) -> bool:
        """Whether the wheels are numbered in the direction opposite to the robot's."""
        count = len(self.positions)
        return count > 2 and self.positions == (1, *range(count, 1, -1))

    @property
    def reversed_wheels(self) -> tuple[int, ...]:
        """The file's wheels (from 1) that count against the others."""
        return tuple(i for i, sign in enumerate(self.signs, start=1) if sign < 0)

    @property
    def description(self) -> str:
        """The placement in words."""
        own = self.positions == tuple(range(1, len(self.positions) + 1))
        order = "mirrored" if self.mirrored else "as the robot's" if own else f"order {self.positions}"
        wheels = self.reversed_wheels
        if not wheels:
            return order
        return f"{order}, wheel{'s' if len(wheels) > 1 else ''} {' and '.join(map(str, wheels))} reversed"


#: the wheels' motion that is neither lean nor heading is so small a share under the right signs, and so many times as
#: large under wrong ones: on the recordings at most 0.02, and 15 times
RIGHT_TOGETHER, WRONG_TOGETHER = 0.05, 5.0


def reversed_wheels(placements: Sequence[Placement], confidence: float) -> tuple[int, ...]:
    """Return the wheels (from 1) in the robot's order that count against the others; none if the log leaves it open.

    Parameters
    ----------
    placements : sequence of Placement
        The best first.
    confidence : float
        In the best one. The wheels' motion by itself may decide if the lean does not.
    """
    own = [one for one in placements if one.positions == tuple(range(1, len(one.positions) + 1))]
    if placements[0] is own[0] and confidence >= CONFIDENT:
        return own[0].reversed_wheels
    best, second = sorted(own, key=lambda one: one.together)[:2]
    clear = best.together < RIGHT_TOGETHER and second.together > WRONG_TOGETHER * best.together
    return best.reversed_wheels if clear else ()


def even_azimuths(robot: Robot) -> bool:
    """Return whether turning the robot by one wheel's angle gives the same robot."""
    beta = np.asarray(robot.wheels.azimuths)
    steps = np.exp(1j * np.diff(beta))
    return bool(np.allclose(steps, np.exp(2j * np.pi / len(beta)), atol=1e-3))


def ranked_placements(
    robot: Robot,
    driven: NDArray[np.complex128],
    rolled: NDArray[np.complex128],
    wheels: Smooth,
    heading: Smooth | None,
    weights: NDArray[np.float64],
    gamma: float,
) -> tuple[list[Placement], float]:
    """Return all placements, the best first, and the confidence in the best; `rolled` is that of `each_wheel`."""
    every, ways, beta = every_placement(robot), every_way(robot), np.asarray(robot.wheels.azimuths)
    lean_sums = lean_sums_of(rolled, driven, weights)
    wheel_sums = _wheel_sums(wheels, heading, weights > 0.0)
    total = _scores(every, ways, lean_sums.sum(axis=0), wheel_sums.sum(axis=0), beta)
    blocks = np.array(
        [
            _scores(every, ways, lean_sums.sum(axis=0) - one, wheel_sums.sum(axis=0) - other, beta).score
            for one, other in zip(lean_sums, wheel_sums, strict=True)
        ]
    )
    likely, found = (_weighed(every, total.score, blocks, usual=part) for part in (1.0, PRIOR_POWER))
    ranked = list(likely)
    ranked = [ranked[0], *sorted(ranked[1:], key=lambda one: (-likely[one], total.score[one]))]
    same = [
        h
        for h in ranked[1:]
        if found[h] > TINY_PROBABILITY and _same_wheels(wheels.value, every[ranked[0]], every[h])
    ]
    explained = (LARGEST_REST - float(total.unexplained.min())) / (LARGEST_REST - USUAL_REST)
    confidence = min(found[ranked[0]] + sum(found[h] for h in same), MOST) * float(
        np.clip(explained, 0.0, 1.0)
    )
    placements = [
        Placement(
            positions=tuple(place + 1 for place in every[h][0]),
            signs=_fewest_reversed(every[h][1]),
            phase=float(np.angle(total.gain[h] * _global_sign(every[h][1]))),
            gain=float(abs(total.gain[h])) / gamma,
            unexplained=float(total.unexplained[h]),
            together=float(total.together[h]),
            misfit=float(np.exp(total.score[h])),
        )
        for h in ranked
    ]
    return placements, confidence


def _fewest_reversed(signs: tuple[int, ...]) -> tuple[int, ...]:
    return tuple(_global_sign(signs) * sign for sign in signs)


def _global_sign(signs: tuple[int, ...]) -> int:
    """Return -1 if more than half of the signs are negative."""
    return -1 if sum(signs) < 0 else 1


def placement_way(robot: Robot, placement: Placement) -> NDArray[np.complex128]:
    """Return s_i e^{j beta} (n,) of the file's wheels."""
    beta = np.asarray(robot.wheels.azimuths)[np.asarray(placement.positions) - 1]
    return np.asarray(placement.signs) * np.exp(1j * beta)


def every_placement(robot: Robot) -> list[tuple[tuple[int, ...], tuple[int, ...]]]:
    """Return every order and every choice of signs of the file's wheels, up to a turn of the robot and all signs."""
    count = robot.wheel_count
    orders = [p for p in permutations(range(count)) if p[0] == 0 or not even_azimuths(robot)]
    return [(p, (1, *s)) for p in orders for s in product((1, -1), repeat=count - 1)]


def every_way(robot: Robot) -> NDArray[np.complex128]:
    """Return s_i e^{j beta} (H, n) of the file's wheels in each of `every_placement`."""
    beta = np.asarray(robot.wheels.azimuths)
    return np.array([np.array(s) * np.exp(1j * beta[list(p)]) for p, s in every_placement(robot)])


def _usual(order: tuple[int, ...], signs: tuple[int, ...], count: int) -> float:
    """Return the logarithm of how usual a placement is among `count`."""
    n = len(order)
    own, mirrored = order == tuple(range(n)), order == (0, *range(n - 1, 0, -1))
    p = (
        OWN_ORDER
        if own
        else MIRRORED_ORDER
        if mirrored
        else (1.0 - OWN_ORDER - MIRRORED_ORDER) / max(count, 1)
    )
    return math.log(p * (EQUAL_SIGNS if len(set(signs)) == 1 else (1.0 - EQUAL_SIGNS) / (2 ** (n - 1) - 1)))


def _weighed(
    every: list[tuple[tuple[int, ...], tuple[int, ...]]],
    score: NDArray[np.float64],
    blocks: NDArray[np.float64],
    *,
    usual: float,
) -> dict[int, float]:
    """Return the probability of each placement, by its place in `every`, the likeliest first.

    `usual` is the power of the prior. A placement is behind the best by the jackknife of the best's gain, or by so much
    that few seconds are enough.
    """
    best, seconds = int(np.argmin(score)), len(blocks) * BLOCK
    weights = {}
    for other, (order, signs) in enumerate(every):
        gained = float(score[other] - score[best])
        error = jackknife_error(blocks[:, other] - blocks[:, best])
        z = ERRORS_WEIGHT * min(gained / error, 60.0) if error > 0.0 else 0.0
        if seconds < SHORT_TIME and gained < math.log(SHORT_MARGIN):
            z = min(z, 1.0)
        behind = max(0.5 * z**2, EACH_SECOND * seconds * max(gained - LEAST_RATIO, 0.0))
        weights[other] = usual * _usual(order, signs, len({order for order, _ in every})) - behind
    return probabilities(weights)


#: less probable placements are not compared with the best: they would add little to its confidence
TINY_PROBABILITY = 1e-3


def _same_wheels(
    angles: NDArray[np.float64],
    one: tuple[tuple[int, ...], tuple[int, ...]],
    other: tuple[tuple[int, ...], tuple[int, ...]],
) -> bool:
    """Return whether two placements give the robot's wheels the same angles, up to a turn of the robot and all signs.

    With four wheels and a heading that stands still, opposite wheels have opposite angles.
    """
    n = angles.shape[1]
    moved = angles - angles.mean(axis=0)
    mine, others = (
        np.column_stack([moved[:, place] * signs[place] for place in np.argsort(order)])
        for order, signs in (one, other)
    )
    size = np.maximum(mine.std(axis=0), 1e-9)
    return any(
        float((np.std(mine - sign * np.roll(others, turn, axis=1), axis=0) / size).max()) < SAME_WHEELS
        for turn in range(n)
        for sign in (1.0, -1.0)
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Scores:
    """Of every placement (H,)."""

    gain: NDArray[np.complex128]
    unexplained: NDArray[np.float64]
    together: NDArray[np.float64]
    score: NDArray[np.float64]


def _scores(
    every: list[tuple[tuple[int, ...], tuple[int, ...]]],
    ways: NDArray[np.complex128],
    lean_sums: NDArray[np.complex128],
    wheel_sums: NDArray[np.float64],
    beta: NDArray[np.float64],
) -> _Scores:
    """Return how well placements fit sums over rows, as `lean_sums_of` and `_wheel_sums` make them."""
    n, H = ways.shape[1], len(ways)
    C = np.zeros((H, 2 * n + 1, 3), dtype=np.complex128)
    C[:, :n, 0], C[:, n : 2 * n, 1], C[:, 2 * n, 2] = ways, ways, 1.0
    G, r, y = lean_sums[:-1, :-1], lean_sums[:-1, -1], float(lean_sums[-1, -1].real)
    left = C.conj().transpose(0, 2, 1)
    normal, right = left @ G @ C, left @ r
    normal = normal + 1e-12 * np.trace(normal, axis1=1, axis2=2).real[:, None, None] * np.eye(3)
    found = np.linalg.solve(normal, right[..., None])[..., 0].astype(np.complex128)
    offset = float(abs(r[-1]) ** 2 / max(float(G[-1, -1].real), TINY))
    rest = y - np.einsum("hi,hi->h", right.conj(), found).real
    unexplained = np.maximum(rest, TINY) / max(y - offset, TINY)
    together = np.array([_together(order, signs, wheel_sums, beta) for order, signs in every])
    score = np.log(unexplained) + 0.5 * np.log(together + LEAST_TOGETHER)
    return _Scores(gain=found[:, 0], unexplained=unexplained, together=together, score=score)


def block_numbers(count: int) -> NDArray[np.intp]:
    """Return the number of the block (N,) that each of `count` even rows is in."""
    return np.arange(count) // round(BLOCK / INTERVAL)


def lean_sums_of(
    X: NDArray[np.complex128], driven: NDArray[np.complex128], weights: NDArray[np.float64]
) -> NDArray[np.complex128]:
    """Return [X y]^H [X y] (B, k + 1, k + 1), weighted, by blocks that have a weight."""
    table = np.column_stack([X, driven]) * weights[:, None]
    blocks = block_numbers(len(weights))
    kept = np.unique(blocks[weights > 0.0])
    return np.array([table[blocks == b].conj().T @ table[blocks == b] for b in kept])


def _wheel_sums(wheels: Smooth, heading: Smooth | None, usable: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return products (B, n + 1, n + 1) of the wheels' speeds and the heading's rate, less their means, by blocks."""
    rate = np.zeros(len(usable)) if heading is None else heading.rate[:, 0]
    table = np.column_stack([wheels.rate, rate])
    table = np.where(usable[:, None], table - table[usable].mean(axis=0), 0.0)
    blocks = block_numbers(len(usable))
    return np.array([table[blocks == b].T @ table[blocks == b] for b in np.unique(blocks[usable])])


def _together(
    order: tuple[int, ...], signs: tuple[int, ...], sums: NDArray[np.float64], beta: NDArray[np.float64]
) -> float:
    """Return the share of the wheels' motion that is neither lean nor, together, heading."""
    n, s, angles = len(order), np.asarray(signs, dtype=np.float64), beta[list(order)]
    G = sums[:n, :n] * np.outer(s, s)
    with_rate, rate = sums[:n, n] * s, float(sums[n, n])
    ones = np.full(n, n**-0.5)
    basis, _ = np.linalg.qr(np.column_stack([ones, np.cos(angles), np.sin(angles)]))
    outside = float(np.trace(G) - np.trace(basis.T @ G @ basis))
    total = float(ones @ G @ ones)
    if rate > 0.0:
        total -= float(ones @ with_rate) ** 2 / rate
    elif n > 3:
        total *= UNKNOWN_HEADING
    return max(outside + total, 0.0) / max(float(np.trace(G)), TINY)


def each_wheel(wheels: Smooth, turning: NDArray[np.float64] | float = 0.0) -> NDArray[np.complex128]:
    """Return columns (N, 2 n + 1) that give every wheel gains of its own.

    `turning` is the rate (N,) [rad/s] at which the frame of the lean turns: in that frame a rate of the wheels'
    motion W has the part j `turning` W.
    """
    ones = np.ones(len(wheels.rate))
    moved = wheels.acceleration + 1j * np.broadcast_to(turning, len(ones))[:, None] * wheels.rate
    return np.column_stack([moved, rolling_direction(wheels), ones]).astype(np.complex128)


def rolling_direction(wheels: Smooth) -> NDArray[np.float64]:
    """Return the wheels' speeds (N, n) over their size: the direction in which the ball rolls."""
    size = np.sqrt((wheels.rate**2).sum(axis=1, keepdims=True))
    return wheels.rate / (size + ROLLING)
