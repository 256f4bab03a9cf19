"""Which parameters and which models the measurements support.

Parameters that act through others only: v_s and delta say how s fades, and nothing where there is no s.

Where s is zero, a fit still ends somewhere, with some s of the size of chance and v_s and delta that suit it; their
standard errors, taken there, are worthless (R. Davies, Hypothesis testing when a nuisance parameter is present only
under the alternative, Biometrika 64 (1977) 247-254). So s has to earn them: the fit with it must be better than the
best one without by more than chance explains, 2 N n_s (cost without - cost with) > lambda q, where N n_s counts the
residuals, lambda corrects for their dependence as in `ballbot.fitting.intervals`, and q is the chi-squared
quantile of as many parameters as the fit with s has more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from ballbot.fitting.intervals import RepeatableFit
from ballbot.fitting.run import DEFAULT_RUN, Run
from ballbot.fitting.uncertainty import covariance
from ballbot.progress import ignore_progress

#: how sure it has to be, as a number without a meaning is worse than none
EFFECT_CONFIDENCE = 0.999
#: a fit without is not made where the errors alone put it so many times past the limit
PLAIN = 4.0


@dataclass(frozen=True, kw_only=True)
class Dependence:
    """Quantities that act through another's numbers."""

    through: str
    dependent: tuple[str, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class Unidentifiable:
    """What a fit does without."""

    dependent: NDArray[np.bool_]  #: (p,), free parameters without influence, as what they act through is zero
    through: NDArray[np.bool_]  #: (p,), what they act through


def unidentifiable(
    fit: RepeatableFit,
    dependences: Sequence[Dependence],
    *,
    most_steps: int,
    run: Run = DEFAULT_RUN,
) -> Unidentifiable:
    """Return which free parameters act through others that do not differ from zero."""
    coordinates = fit.coordinates
    names = np.array(coordinates.names)
    found, origin = np.zeros(len(names), dtype=bool), np.zeros(len(names), dtype=bool)
    for one in dependences:
        dependent = np.isin(names, one.dependent) & coordinates.free
        through = (names == one.through) & coordinates.free
        if dependent.any() and through.any() and not _earned(fit, through, dependent, most_steps, run):
            found, origin = found | dependent, origin | through
    return Unidentifiable(dependent=found, through=origin)


def _earned(
    fit: RepeatableFit,
    through: NDArray[np.bool_],
    dependent: NDArray[np.bool_],
    most_steps: int,
    run: Run,
) -> bool:
    point, free = fit.point, fit.coordinates.free
    amounts = point * through
    if not amounts.any():
        return False
    limit = float(chi2.ppf(EFFECT_CONFIDENCE, int(through.sum() + dependent.sum())))
    moved = through | (free & (point > 0.0))
    spread = covariance(fit.equations.normal, moved)[np.ix_(through, through)]
    if amounts[through] @ np.linalg.lstsq(spread, amounts[through], rcond=1e-13)[0] > PLAIN * limit:
        return True
    without = fit.repeated(
        moved=-amounts,
        free=free & ~through & ~dependent,
        most_steps=most_steps,
        run=replace(run, progress=ignore_progress),
    )
    rise = 2.0 * fit.residual_count * (without.cost - fit.cost)
    return rise > limit * _dependence(fit, moved, through, spread)


def _dependence(
    fit: RepeatableFit,
    moved: NDArray[np.bool_],
    through: NDArray[np.bool_],
    spread: NDArray[np.float64],
) -> float:
    """Return lambda: the clustered covariance over that of independent residuals, on average over the numbers."""
    H = fit.equations.normal.matrix[np.ix_(moved, moved)]
    independent = np.linalg.pinv(H, hermitian=True)[np.ix_(through[moved], through[moved])]
    return float(np.trace(np.linalg.lstsq(independent, spread, rcond=1e-13)[0])) / len(spread)
