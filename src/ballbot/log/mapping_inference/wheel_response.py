"""How the wheels answer to the commands, by their accelerations: how late, and how much the commands explain.

    w_dot = G u(t - d) + friction's terms in w

d is the delay at which the commands, held as the log has them, explain the accelerations best. The lean is not among
what explains them: commands are made of the lean, and would share its gain. G shows which command drives which wheel if
the wheels turn free. While the robot balances, commands sum to nearly zero and G is collinear: its rows are compared
without their mean, and order and signs come from `ballbot.log.mapping_inference.commands`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from ballbot.log.mapping_inference.evidence import jackknife_error
from ballbot.log.signals import INTERVAL, Smooth, smooth

#: command delays that are tried [s], whole rows: between them, interpolation smooths, which looks like a better fit
DELAYS = INTERVAL * np.arange(-1.0, 13.0)
#: narrower than for the lean: an encoder is quieter than an IMU, and delays show in what is quick
COMMAND_WIDTH = 0.01
#: of rows with inaccurate times
WIDER = 0.02
#: the speed at which dry friction's sign is half turned over [rad/s]
SIGN_SPEED = 0.3
#: part of the signals' own size that is added to the normal equations
RIDGE = 1e-3
#: below this share explained the commands do not drive these wheels
LEAST_EXPLAINED = 0.2


@dataclass(frozen=True, kw_only=True)
class CommandTest:
    """What drives the wheels."""

    order: tuple[int, ...]  #: for the file's wheels in turn, which command (from 1) drives it
    signs: tuple[int, ...]  #: whether that command turns it forward
    gains: tuple[tuple[float, ...], ...]  #: G [rad/s^2 a unit of command], by wheel and command
    delay: float  #: d [s]
    delay_error: float  #: its standard error [s]
    explained: float  #: share of the accelerations
    #: the gains' sum in this order over that in the next best; None if all commands are alike
    margin: float | None


def held_commands(
    rows: NDArray[np.float64], t: NDArray[np.float64], commands: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the commands (M, n) logged at t, held until the next, on other times (N,)."""
    latest = np.searchsorted(t, rows, side="right") - 1
    return commands[np.maximum(latest, 0)]


def command_test(
    rows: NDArray[np.float64],
    wheels: Smooth,
    commands: NDArray[np.float64],
    usable: NDArray[np.bool_],
    *,
    width: float = COMMAND_WIDTH,
) -> CommandTest | None:
    """Find which command drives which wheel.

    Parameters
    ----------
    rows : ndarray (N,)
        [s], even.
    wheels : Smooth (N, n)
        All counting the same way round.
    commands : ndarray (N, n)
        As `held_commands` gives them.
    usable : ndarray (N,)
    width : float
        Standard deviation of the filter that the wheels passed [s].

    Returns
    -------
    CommandTest or None
        None if the commands do not explain the wheels.
    """
    if usable.sum() * INTERVAL < 1.0 or not np.all(commands[usable].std(axis=0) > 0.0):
        return None
    alike = np.allclose(commands, commands[:, :1])
    smoothed = smooth(rows, rows, commands[:, :1] if alike else commands, width=width).value
    y = wheels.acceleration[usable]
    squares = (y - y.mean(axis=0)) ** 2
    total = float(squares.sum())
    blocks = (np.arange(len(rows)) // round(1.0 / INTERVAL))[usable]
    left = [
        np.bincount(blocks, weights=_gains_and_rest(smoothed, wheels, usable, delay)[1]) / total
        for delay in DELAYS
    ]
    delay, error = vertex_with_error(DELAYS, np.array(left))
    gains, rest = _gains_and_rest(smoothed, wheels, usable, delay)
    explained = 1.0 - float(rest.sum()) / total
    if explained < LEAST_EXPLAINED:
        return None
    G = np.repeat(gains, wheels.rate.shape[1], axis=1) if alike else gains
    order, margin = _best_command_order(G) if not alike else (tuple(range(len(G))), None)
    compared = G if alike or _independent(commands[usable]) else G - G.mean(axis=1, keepdims=True)
    return CommandTest(
        order=tuple(place + 1 for place in order),
        signs=tuple(1 if compared[wheel, place] > 0.0 else -1 for wheel, place in enumerate(order)),
        gains=tuple(tuple(row) for row in G.tolist()),
        delay=delay,
        delay_error=error,
        explained=explained,
        margin=margin,
    )


#: smallest singular value of the commands over the largest, from which each has a gain of its own
INDEPENDENT = 0.15


def _independent(commands: NDArray[np.float64]) -> bool:
    """Return whether no combination of the commands (N, n) is nearly zero throughout."""
    values = np.linalg.svd(commands - commands.mean(axis=0), compute_uv=False)
    return bool(values[-1] > INDEPENDENT * values[0])


def _gains_and_rest(
    commands: NDArray[np.float64],
    wheels: Smooth,
    usable: NDArray[np.bool_],
    delay: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the gains (n, k) and the squares (N,) left at a delay."""
    places = np.arange(len(commands), dtype=np.float64)
    late = np.column_stack([np.interp(places - delay / INTERVAL, places, column) for column in commands.T])
    speed = wheels.rate
    X = np.column_stack([late, speed, np.tanh(speed / SIGN_SPEED), np.ones(len(late))])[usable]
    y = wheels.acceleration[usable]
    # commands that sum to nearly zero are nearly dependent: a ridge gives their common part no gain of its own
    size = np.sqrt((X**2).mean(axis=0)) + 1e-12
    normal = (X / size).T @ (X / size) + RIDGE * len(X) * np.eye(X.shape[1])
    found = np.linalg.solve(normal, (X / size).T @ y) / size[:, None]
    return found[: commands.shape[1]].T, ((y - X @ found) ** 2).sum(axis=1)


def _best_command_order(G: NDArray[np.float64]) -> tuple[tuple[int, ...], float]:
    count = len(G)
    sums = {
        order: abs(sum(float(G[wheel, place]) for wheel, place in enumerate(order)))
        for order in permutations(range(count))
    }
    ranked = sorted(sums, key=lambda order: -sums[order])
    return ranked[0], sums[ranked[0]] / max(sums[ranked[1]], 1e-12)


def vertex_with_error(places: NDArray[np.float64], by_block: NDArray[np.float64]) -> tuple[float, float]:
    """Return where the sum over blocks of values (K, B) at K places is least, and its standard error; inf at an end."""
    total = by_block.sum(axis=1)
    if np.argmin(total) in (0, len(total) - 1):
        return vertex(places, total), math.inf  # it may lie beyond
    used = by_block.sum(axis=0) > 0.0
    each = np.array([vertex(places, total - one) for one in by_block.T[used]])
    return vertex(places, total), jackknife_error(each)


def vertex(places: NDArray[np.float64], values: NDArray[np.float64]) -> float:
    """Return where a parabola through the least of the values and its neighbours has its vertex."""
    k = int(np.clip(np.argmin(values), 1, len(places) - 2))
    before, at, after = values[k - 1 : k + 2]
    curve = before - 2.0 * at + after
    shift = 0.5 * (before - after) / curve if curve > 0.0 else 0.0
    return float(places[k] + np.clip(shift, -1.0, 1.0) * (places[1] - places[0]))
