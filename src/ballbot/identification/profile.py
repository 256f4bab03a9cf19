"""Profile likelihood: how far a parameter may go, all others following, before the fit is worse than chance explains.

The cost of n_s states over N residuals each is, up to a constant, minus the logarithm of a likelihood over N n_s.
Residuals within a window are not independent, so the doubled rise is no chi-squared variable but, for one
parameter, one times

    lambda = (clustered variance) / [H^-1]_ii

(L. Pace, A. Salvan and N. Sartori, Adjusting composite likelihood ratio statistics, Statistica Sinica 21 (2011)
129-148). A limit lies where 2 N n_s (cost - least cost) = lambda t^2, t being Student's quantile.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.identification.problem import Problem
from ballbot.identification.starts import Finished, compared, descend

#: fits of the other parameters on one side, and steps of each
_MOST_FITS, _STEPS = 6, 3
#: a limit is found where the rise is that near to the one sought, as a share of it
_NEAR = 0.1


@dataclass(frozen=True, kw_only=True)
class Profile:
    """The 95 % limits of one parameter, scaled; None where the logs set none before its bound."""

    place: int  #: which parameter
    lower: float | None
    upper: float | None


def profile(
    problem: Problem,
    finished: Finished,
    place: int,
    *,
    free: NDArray[np.bool_],
    error: float,
    rise: float,
) -> Profile:
    """Walk a parameter away from the estimate on both sides.

    Parameters
    ----------
    place : int
        Which parameter.
    free : ndarray (p,)
        Those that the estimate moved.
    error : float
        Half the width expected, scaled, for the first step.
    rise : float
        lambda t^2, see the module's text.
    """
    lower, upper = (
        _limit(problem, finished, place, free=free, step=sign * error, rise=rise) for sign in (-1.0, 1.0)
    )
    return Profile(place=place, lower=lower, upper=upper)


def _limit(
    problem: Problem,
    finished: Finished,
    place: int,
    *,
    free: NDArray[np.bool_],
    step: float,
    rise: float,
) -> float | None:
    origin, least = finished.point[place], finished.cost
    others = free & (np.arange(len(free)) != place)
    scale = 2.0 * compared(problem) * int(problem.cost.counted.sum())
    point, starts = finished.point, finished.starts
    inside, outside = (
        (origin, 0.0),
        None,
    )  # (where, root of the rise), of the farthest below and the nearest above
    target = origin + step
    for _ in range(_MOST_FITS):
        target = float(np.clip(target, 0.0, 1.0))
        moved = np.zeros(len(point))
        moved[place] = target - point[place]
        point, starts, history = descend(
            problem, point, starts, free=others, most_steps=_STEPS, report=_silent, moved=moved
        )
        root = float(np.sqrt(max(scale * (history[-1] - least), 0.0)))
        if root**2 < rise:
            inside = (target, root)
            if target in (0.0, 1.0):
                return None
        else:
            outside = (target, root)
        if abs(root**2 / rise - 1.0) < _NEAR:
            return target
        target = _next(inside, outside, np.sqrt(rise), origin, step)
    return target if outside else None


def _next(
    inside: tuple[float, float],
    outside: tuple[float, float] | None,
    root: float,
    origin: float,
    step: float,
) -> float:
    """Return where to look next: the root of the rise is nearly straight in the distance."""
    if outside is not None:
        share = (root - inside[1]) / (outside[1] - inside[1])
        return inside[0] + share * (outside[0] - inside[0])
    reached = inside[0] - origin
    longer = 2.0 if inside[1] <= 0.5 * root else root / inside[1] * 1.05
    return origin + longer * (reached if reached else step)


def _silent(step: int, cost: float) -> None:
    """Report nothing."""
