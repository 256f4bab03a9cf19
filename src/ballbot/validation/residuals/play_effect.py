"""Residual torque against how far a wheel has turned since it last turned back: play, or friction with a memory.

In a gearbox with play the motor crosses the play after each reversal and pushes nothing; then it strikes. So the torque
along the motion, s du with s the direction, is off within the play and right beyond it. The speed is low there too, and
a friction law may be off at low speeds; so the travel's part is sought beside the speed's,

    s du = f(travel) + g(|w|)

Friction that gives way before it slips (Dahl's, LuGre's) makes the same mark, over its own length: the two are not told
apart here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ballbot.log.turning_points import turning_points
from ballbot.validation.residuals.regression import fit, indicators
from ballbot.validation.residuals.series import slices

#: [rad] ends of the travels that are told apart; beyond the last is what they are compared with
EDGES = (0.003, 0.007, 0.013, 0.025, 0.05, 0.1)
_SPEEDS = 8
#: fewer show no play
LEAST_REVERSALS = 20


@dataclass(frozen=True, kw_only=True, eq=False)
class PlayEffect:
    """Mean residual torque along the motion, by the travel since the last reversal."""

    travels: NDArray[np.float64]  #: (b,) [rad] mean of each bin
    torques: NDArray[np.float64]  #: (b,) [N m] less that far from a reversal at the same speed
    half_widths: NDArray[np.float64]  #: (b,) of the 95 % intervals
    p_value: float  #: of no torque at any travel
    reversals: int

    @property
    def clearest(self) -> int:
        """The bin whose torque is the furthest from zero, in errors."""
        return int(np.argmax(np.abs(self.torques) / self.half_widths))


def play_effect(
    torques: NDArray[np.float64],
    speeds: NDArray[np.float64],
    angles: NDArray[np.float64],
    blocks: NDArray[np.int64],
    segments: Sequence[int],
    *,
    least_turn: float,
) -> PlayEffect | None:
    """Return how the wheels' residual torques depend on the travel since the last reversal.

    Parameters
    ----------
    torques, speeds, angles : ndarray (n, wheels)
        Residual torque, speed some rows earlier (NaN where there is none), encoders' angle.
    blocks : ndarray (n,)
    segments : sequence of int
    least_turn : float
        A turn back by less is the encoder's noise [rad].

    Returns
    -------
    PlayEffect or None
        None where the wheels hardly turned back.
    """
    moved = [since_reversal(angle, segments, least_turn=least_turn) for angle in angles.T]
    travel, way = (np.concatenate(parts) for parts in zip(*moved, strict=True))
    along, speed = way * torques.T.ravel(), np.abs(speeds.T.ravel())
    known = np.isfinite(travel) & np.isfinite(speed)
    reversals = int(sum(np.count_nonzero(np.diff(w[np.isfinite(t)]) != 0.0) for t, w in moved))
    travel, along, speed = travel[known], along[known], speed[known]
    block = np.tile(blocks, angles.shape[1])[known]
    place = np.searchsorted(EDGES, travel)
    if reversals < LEAST_REVERSALS or len(np.unique(place)) <= len(EDGES):
        return None
    edges = np.quantile(speed, np.linspace(0.0, 1.0, _SPEEDS + 1))[1:-1]
    of_speed = indicators(np.searchsorted(edges, speed), _SPEEDS)
    of_travel = indicators(place, len(EDGES))
    found = fit(np.hstack([of_travel, of_speed]), along, block)
    count = len(EDGES)
    return PlayEffect(
        travels=of_travel.T @ travel / of_travel.sum(axis=0),
        torques=found.values[:count],
        half_widths=found.half_widths[:count],
        p_value=found.p_value(range(count)),
        reversals=reversals,
    )


def since_reversal(
    angle: NDArray[np.float64], segments: Sequence[int], *, least_turn: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return how far an angle (n,) has come since it last turned back, and its direction; NaN before the first time."""
    travel, way = np.full_like(angle, np.nan), np.zeros_like(angle)
    for where in slices(segments):
        turns = turning_points(angle[where], least_turn)
        for first, last in pairwise(turns[1:]):
            rows = slice(where.start + first + 1, where.start + last + 1)
            travel[rows] = np.abs(angle[rows] - angle[where.start + first])
            way[rows] = np.sign(angle[where.start + last] - angle[where.start + first])
    return travel, way
