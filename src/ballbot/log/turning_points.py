"""Where a signal turns back: its peaks and troughs, small wiggles passed over."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def turning_points(values: NDArray[np.float64], least_turn: float) -> list[int]:
    """Return the first row of a signal (n,), the rows where it turns back by more than `least_turn`, and the last."""
    turns, highest, lowest, rising = [0], 0, 0, 0
    listed = values.tolist()
    for row, value in enumerate(listed):
        highest = row if value > listed[highest] else highest
        lowest = row if value < listed[lowest] else lowest
        if rising >= 0 and value < listed[highest] - least_turn:
            turns.append(highest)
            rising, lowest = -1, row
        elif rising <= 0 and value > listed[lowest] + least_turn:
            turns.append(lowest)
            rising, highest = 1, row
    # a signal that sets out at once has turned nowhere yet
    first = 2 if len(turns) > 1 and turns[1] == 0 else 1
    return [0, *turns[first:], len(listed) - 1]
