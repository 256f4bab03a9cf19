"""Which command drives which wheel, with which sign and how late, by the wheels' accelerations.

    w_dot = G u(t - d) + friction's terms in w

Each wheel's own command has the largest gain in its row of G: the ball carries the others' push over, at most half of
it and against it. d is where the commands, held as the log says, explain the accelerations best.
(The lean is not among what explains them: commands are made of the lean, and would share its gain.)
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from ballbot.log.proposal.lean_test import vertex
from ballbot.log.proposal.signals import INTERVAL, Smooth, smooth

#: command delays that are tried [s], whole rows as in `lean_test`
DELAYS = INTERVAL * np.arange(-1.0, 13.0)
#: narrower than for the lean: an encoder is quieter than an IMU, and delays show in what is quick
WIDTH = 0.01
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
    explained: float  #: share of the accelerations
    #: the gains' sum in this order over that in the next best; None where all commands are alike
    margin: float | None


def held(
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
) -> CommandTest | None:
    """Find which command drives which wheel.

    Parameters
    ----------
    rows : ndarray (N,)
        [s], even.
    wheels : Smooth (N, n)
        Of width `WIDTH`; all counting the same way round.
    commands : ndarray (N, n)
        As `held` gives them.
    usable : ndarray (N,)

    Returns
    -------
    CommandTest or None
        None where the commands do not explain the wheels.
    """
    if usable.sum() * INTERVAL < 1.0 or not np.all(commands[usable].std(axis=0) > 0.0):
        return None
    alike = np.allclose(commands, commands[:, :1])
    smoothed = smooth(rows, rows, commands[:, :1] if alike else commands, width=WIDTH).value
    y = wheels.acceleration[usable]
    total = float(((y - y.mean(axis=0)) ** 2).sum())
    left = [_rest(smoothed, wheels, usable, delay)[1] / total for delay in DELAYS]
    delay = vertex(DELAYS, np.array(left))
    gains, rest = _rest(smoothed, wheels, usable, delay)
    explained = 1.0 - rest / total
    if explained < LEAST_EXPLAINED:
        return None
    G = np.repeat(gains, wheels.rate.shape[1], axis=1) if alike else gains
    order, margin = _best_order(G) if not alike else (tuple(range(len(G))), None)
    return CommandTest(
        order=tuple(place + 1 for place in order),
        signs=tuple(1 if G[wheel, place] > 0.0 else -1 for wheel, place in enumerate(order)),
        gains=tuple(tuple(row) for row in G.tolist()),
        delay=delay,
        explained=explained,
        margin=margin,
    )


def _rest(
    commands: NDArray[np.float64],
    wheels: Smooth,
    usable: NDArray[np.bool_],
    delay: float,
) -> tuple[NDArray[np.float64], float]:
    """Return the gains (n, k) and the sum of squares left at a delay."""
    places = np.arange(len(commands), dtype=np.float64)
    late = np.column_stack([np.interp(places - delay / INTERVAL, places, column) for column in commands.T])
    speed = wheels.rate
    X = np.column_stack([late, speed, np.tanh(speed / SIGN_SPEED), np.ones(len(late))])[usable]
    y = wheels.acceleration[usable]
    # commands that sum to nearly zero are nearly dependent: a ridge gives their common part no gain of its own
    size = np.sqrt((X**2).mean(axis=0)) + 1e-12
    normal = (X / size).T @ (X / size) + RIDGE * len(X) * np.eye(X.shape[1])
    found = np.linalg.solve(normal, (X / size).T @ y) / size[:, None]
    return found[: commands.shape[1]].T, float(((y - X @ found) ** 2).sum())


def _best_order(G: NDArray[np.float64]) -> tuple[tuple[int, ...], float]:
    count = len(G)
    sums = {
        order: abs(sum(float(G[wheel, place]) for wheel, place in enumerate(order)))
        for order in permutations(range(count))
    }
    ranked = sorted(sums, key=lambda order: -sums[order])
    return ranked[0], sums[ranked[0]] / max(sums[ranked[1]], 1e-12)
