"""Parameters that act through others only: v_s and delta say how s fades, and nothing where there is no s.

Where s is zero, a fit still ends somewhere, with some s of the size of chance and v_s and delta that suit it; their
standard errors, taken there, are worthless (R. Davies, Hypothesis testing when a nuisance parameter is present only
under the alternative, Biometrika 64 (1977) 247-254). So s has to earn them: the fit with it must be better than the
best one without by more than chance explains, 2 N n_s (cost without - cost with) > lambda q, where N n_s counts the
residuals, lambda corrects for their dependence as in `ballbot.identification.profile`, and q is the chi-squared
quantile of as many parameters as the fit with s has more.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from ballbot.identification.checkpoint import Recall, afresh
from ballbot.identification.problem import Problem
from ballbot.identification.starts import Finished, compared, descend
from ballbot.identification.uncertainty import covariance

#: how sure it has to be, as a number without a meaning is worse than none
CONFIDENCE = 0.999
#: a fit without is not made where the errors alone put it so many times past the limit
PLAIN = 4.0


@dataclass(frozen=True, kw_only=True)
class Dependence:
    """Quantities that act through another's numbers."""

    through: str
    dependent: tuple[str, ...]


#: of the friction laws
DEPENDENCES = (Dependence(through="stribeck", dependent=("stribeck_speed", "stribeck_exponent")),)


@dataclass(frozen=True, kw_only=True, eq=False)
class Dormant:
    """What a fit does without."""

    dependent: NDArray[np.bool_]  #: (p,), free parameters without influence, as what they act through is zero
    through: NDArray[np.bool_]  #: (p,), what they act through


def dormant(problem: Problem, finished: Finished, *, most_steps: int, recall: Recall = afresh) -> Dormant:
    """Return which free parameters act through others that do not differ from zero; `recall` answers for each step."""
    coordinates = problem.coordinates
    names = np.array(coordinates.names)
    found, origin = np.zeros(len(names), dtype=bool), np.zeros(len(names), dtype=bool)
    for one in DEPENDENCES:
        dependent = np.isin(names, one.dependent) & coordinates.free
        through = (names == one.through) & coordinates.free
        if (
            dependent.any()
            and through.any()
            and not _earned(problem, finished, through, dependent, most_steps, recall)
        ):
            found, origin = found | dependent, origin | through
    return Dormant(dependent=found, through=origin)


def _earned(
    problem: Problem,
    finished: Finished,
    through: NDArray[np.bool_],
    dependent: NDArray[np.bool_],
    most_steps: int,
    recall: Recall,
) -> bool:
    point, free = finished.point, problem.coordinates.free
    amounts = point * through
    if not amounts.any():
        return False
    limit = float(chi2.ppf(CONFIDENCE, int(through.sum() + dependent.sum())))
    moved = through | (free & (point > 0.0))
    spread = covariance(finished.equations.normal, moved)[np.ix_(through, through)]
    if amounts[through] @ np.linalg.lstsq(spread, amounts[through], rcond=1e-13)[0] > PLAIN * limit:
        return True
    _, _, history = descend(
        problem,
        point,
        finished.starts,
        free=free & ~through & ~dependent,
        most_steps=most_steps,
        report=_silent,
        moved=-amounts,
        recall=recall,
    )
    rise = 2.0 * compared(problem) * int(problem.cost.counted.sum()) * (history[-1] - finished.cost)
    return rise > limit * _dependence(finished, moved, through, spread)


def _dependence(
    finished: Finished,
    moved: NDArray[np.bool_],
    through: NDArray[np.bool_],
    spread: NDArray[np.float64],
) -> float:
    """Return lambda: the clustered covariance over that of independent residuals, on average over the numbers."""
    H = finished.equations.normal.matrix[np.ix_(moved, moved)]
    independent = np.linalg.pinv(H, hermitian=True)[np.ix_(through[moved], through[moved])]
    return float(np.trace(np.linalg.lstsq(independent, spread, rcond=1e-13)[0])) / len(spread)


def _silent(step: int, cost: float) -> None:
    """Report nothing."""
