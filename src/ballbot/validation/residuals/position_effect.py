"""Residual torque against a wheel's position: spots where it turns harder, once or several times a turn.

Order m is what comes back m times a turn: rollers pass the contact `per_row` times a turn in each ring, an eccentric
wheel is felt once. Each order is fitted by itself, du = a cos(m angle) + b sin(m angle), and tested, the chance of any
false one over all orders and wheels being 1 % (Bonferroni).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.robot import Rollers
from ballbot.validation.residuals.regression import fit

#: chance of any false order
LEVEL = 0.01
#: a wheel that turned less than this shows no position twice [turns]
LEAST_TURNS = 1.0
#: so many orders of a wheel are told at most
_MOST_FOUND = 6
#: an amplitude of noise is below this many standard errors of its parts in 95 % of cases (Rayleigh's)
_QUANTILE = 2.45


@dataclass(frozen=True, kw_only=True, eq=False)
class PositionEffect:
    """Amplitudes of residual torque by order and wheel."""

    orders: NDArray[np.int64]  #: (m,) times a turn
    amplitudes: NDArray[np.float64]  #: (m, wheels) [N m]
    half_widths: NDArray[np.float64]  #: (m, wheels) of what noise alone makes, 95 %
    significant: NDArray[np.bool_]  #: (m, wheels)
    per_row: int  #: rollers in a ring
    turns: float  #: that the wheels covered, the one that turned least

    @property
    def found(self) -> tuple[int, ...]:
        """The orders that are significant in any wheel."""
        return tuple(self.orders[self.significant.any(axis=1)].tolist())


def position_effect(
    torques: NDArray[np.float64], angles: NDArray[np.float64], blocks: NDArray[np.int64], *, rollers: Rollers
) -> PositionEffect | None:
    """Return the orders of residual torques (n, wheels) over encoder angles (n, wheels) of one log.

    They go up to twice the rollers of a wheel. None where a wheel turned less than `LEAST_TURNS`.
    """
    turns = float(np.ptp(angles, axis=0).min()) / (2.0 * np.pi)
    if turns < LEAST_TURNS:
        return None
    orders = np.arange(1, 2 * rollers.rows * rollers.per_row + 1)
    level = LEVEL / (len(orders) * angles.shape[1])
    wheels = [
        _orders_of(torque - torque.mean(), angle, blocks, orders, level=level)
        for torque, angle in zip(torques.T, angles.T, strict=True)
    ]
    amplitudes, half_widths, significant = (np.column_stack(parts) for parts in zip(*wheels, strict=True))
    return PositionEffect(
        orders=orders,
        amplitudes=amplitudes,
        half_widths=half_widths,
        significant=significant,
        per_row=rollers.per_row,
        turns=turns,
    )


def _orders_of(
    torque: NDArray[np.float64],
    angle: NDArray[np.float64],
    blocks: NDArray[np.int64],
    orders: NDArray[np.int64],
    *,
    level: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Return amplitudes, noise and significance (m,) of one wheel's orders.

    An order that is found is taken out before the others are looked at again: over few turns, each leaks into its
    neighbours.
    """
    amplitudes, half_widths = np.zeros(len(orders)), np.zeros(len(orders))
    significant = np.zeros(len(orders), dtype=np.bool_)
    for _ in range(_MOST_FOUND):
        waves = [np.column_stack([np.cos(m * angle), np.sin(m * angle)]) for m in orders]
        fits = [fit(wave, torque, blocks) for wave in waves]
        for place in np.flatnonzero(~significant):
            amplitudes[place] = np.hypot(*fits[place].values)
            half_widths[place] = _QUANTILE * np.sqrt(0.5 * np.trace(fits[place].covariance))
        p_values = [
            1.0 if found else one.p_value((0, 1)) for one, found in zip(fits, significant, strict=True)
        ]
        surest = int(np.argmin(p_values))
        if p_values[surest] > level:
            break
        significant[surest] = True
        torque = torque - waves[surest] @ fits[surest].values
    return amplitudes, half_widths, significant
