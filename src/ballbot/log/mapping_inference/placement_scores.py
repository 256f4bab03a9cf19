"""How well every order of the wheels and every choice of their signs fits a log of balancing.

What is left of the lean's acceleration, and how much of the wheels' motion is neither lean nor heading, both from sums
over blocks of the log, so that every placement, with each block left out in turn, takes a small system of equations.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.log.mapping_inference.evidence import MOST, jackknife_error, probabilities
from ballbot.log.signals import INTERVAL, Smooth

#: windows [s] that share one weight, one over their residual's size, and that the jackknife leaves out in turn
BLOCK = 1.0
#: below this many seconds an order or a sign must fit `SHORT_MARGIN` times better than any other
SHORT_TIME, SHORT_MARGIN = 8.0, 2.0
#: share of the lean's acceleration that may be left, and at which nothing is believed
USUAL_REST, LARGEST_REST = 0.5, 0.85
#: share of the wheels' motion that rollers and slip leave anyway
LEAST_TOGETHER = 0.003
#: before the log is seen: wheels in the robot's order, and in the opposite one; wheels of equal signs
OWN_ORDER, MIRRORED_ORDER, EQUAL_SIGNS = 0.55, 0.25, 0.6
#: part of the standard errors by which a placement is behind the best that is believed
BELIEVED_ERRORS = 0.6


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


def ranked_placements(
    every: list[tuple[tuple[int, ...], tuple[int, ...]]],
    score: NDArray[np.float64],
    blocks: NDArray[np.float64],
    unexplained: float,
) -> tuple[NDArray[np.intp], float]:
    """Return the placements, the likeliest first, and the confidence in that, by the jackknife of what it gains."""
    best, seconds = int(np.argmin(score)), len(blocks) * BLOCK
    weights = {}
    for other, (order, signs) in enumerate(every):
        gained = float(score[other] - score[best])
        error = jackknife_error(blocks[:, other] - blocks[:, best])
        z = BELIEVED_ERRORS * min(gained / error, 60.0) if error > 0.0 else 0.0
        if seconds < SHORT_TIME and gained < math.log(SHORT_MARGIN):
            z = min(z, 1.0)
        weights[other] = _usual(order, signs, len({order for order, _ in every})) - 0.5 * z**2
    found = probabilities(weights)
    ranked = list(found)
    rest = sorted(ranked[1:], key=lambda one: (-found[one], score[one]))
    believed = float(np.clip((LARGEST_REST - unexplained) / (LARGEST_REST - USUAL_REST), 0.0, 1.0))
    return np.array([ranked[0], *rest]), min(found[ranked[0]], MOST) * believed


@dataclass(frozen=True, kw_only=True, eq=False)
class _Scores:
    """Of every placement (H,)."""

    gain: NDArray[np.complex128]
    unexplained: NDArray[np.float64]
    together: NDArray[np.float64]
    score: NDArray[np.float64]


def scores(
    every: list[tuple[tuple[int, ...], tuple[int, ...]]],
    ways: NDArray[np.complex128],
    lean_sums: NDArray[np.complex128],
    wheel_sums: NDArray[np.float64],
    beta: NDArray[np.float64],
) -> _Scores:
    """Return how well placements fit sums over rows, as `_lean_sums` and `_wheel_sums` make them."""
    n, H = ways.shape[1], len(ways)
    C = np.zeros((H, 2 * n + 1, 3), dtype=np.complex128)
    C[:, :n, 0], C[:, n : 2 * n, 1], C[:, 2 * n, 2] = ways, ways, 1.0
    G, r, y = lean_sums[:-1, :-1], lean_sums[:-1, -1], float(lean_sums[-1, -1].real)
    left = C.conj().transpose(0, 2, 1)
    normal, right = left @ G @ C, left @ r
    normal = normal + 1e-12 * np.trace(normal, axis1=1, axis2=2).real[:, None, None] * np.eye(3)
    found = np.linalg.solve(normal, right[..., None])[..., 0].astype(np.complex128)
    offset = float(abs(r[-1]) ** 2 / max(float(G[-1, -1].real), 1e-300))
    rest = y - np.einsum("hi,hi->h", right.conj(), found).real
    unexplained = np.maximum(rest, 1e-300) / max(y - offset, 1e-300)
    together = np.array([_together(order, signs, wheel_sums, beta) for order, signs in every])
    score = np.log(unexplained) + 0.5 * np.log(together + LEAST_TOGETHER)
    return _Scores(gain=found[:, 0], unexplained=unexplained, together=together, score=score)


def block_numbers(count: int) -> NDArray[np.intp]:
    return np.arange(count) // round(BLOCK / INTERVAL)


def lean_sums_of(
    X: NDArray[np.complex128], driven: NDArray[np.complex128], weights: NDArray[np.float64]
) -> NDArray[np.complex128]:
    """Return [X y]^H [X y] (B, k + 1, k + 1), weighted, by blocks that have a weight."""
    table = np.column_stack([X, driven]) * weights[:, None]
    blocks = block_numbers(len(weights))
    kept = np.unique(blocks[weights > 0.0])
    return np.array([table[blocks == b].conj().T @ table[blocks == b] for b in kept])


def wheel_sums_of(wheels: Smooth, heading: Smooth | None, usable: NDArray[np.bool_]) -> NDArray[np.float64]:
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
    total = float(ones @ G @ ones) - (float(ones @ with_rate) ** 2 / rate if rate > 0.0 else 0.0)
    return max(outside + total, 0.0) / max(float(np.trace(G)), 1e-300)
