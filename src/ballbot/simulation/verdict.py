"""When a lane of a batch need not be run on, because its outcome is known."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import real_array
from ballbot.errors import InputError
from ballbot.mechanics.compiled import called
from ballbot.mechanics.lanes import LANES, STEP


@dataclass(frozen=True, kw_only=True, eq=False)
class Verdict:
    """When a lane's outcome counts as known, so that it need not be run on.

    Raises
    ------
    InputError
        If the bounds are not rows of ten numbers, or a limit is not above zero.
    """

    #: rows c (m, 10): settled where |c e| <= 1 for each, e = S(psi) (r - x) the error in the heading frame;
    #: infinite numbers for what never settles
    settled: NDArray[np.float64]
    lost: float  #: lean [rad] beyond which a robot that leans further cannot come back
    grip: float = math.inf  #: friction coefficient of wheels on ball that holds; needing more ends a lane

    def __post_init__(self) -> None:
        what = "The array of bounds within which a robot counts as settled"
        rows = real_array(self.settled, ("...", 10), what, finite=False)
        if np.isnan(rows).any():
            raise InputError(f"{what} holds a value that is not a number.")
        if rows.ndim != 2:
            raise InputError(
                f"The bounds of the verdict have the shape {rows.shape}; they must be rows of ten numbers."
            )
        object.__setattr__(self, "settled", rows)
        for name in ("lost", "grip"):
            if not getattr(self, name) > 0.0:
                raise InputError(f"{name} of the verdict is {getattr(self, name)!r}; it must be above zero.")


@called
def decide(work, lane, bounds, lost, state, reference, sample, ended, settled, robot):
    """Stop a lane whose outcome is known; see `Verdict`."""
    lean = state[2] * state[2] + state[3] * state[3]
    if lean > lost * lost and state[2] * state[7] + state[3] * state[8] > 0.0:
        ended[robot] = sample
    elif _within(bounds, state, reference):
        settled[robot] = sample
    else:
        return
    work[STEP * LANES + lane] = 0.0


@called
def _within(bounds, state, reference):
    """Return whether each row's product with the heading frame's error is between -1 and 1."""
    c, s = math.cos(state[4]), math.sin(state[4])
    e = reference - state
    for i in (0, 2, 5, 7):
        e[i], e[i + 1] = c * e[i] + s * e[i + 1], c * e[i + 1] - s * e[i]
    for row in range(len(bounds)):
        size = 0.0
        for i in range(10):
            size += bounds[row, i] * e[i]
        if not abs(size) <= 1.0:
            return False
    return True
