"""How sure an estimate is: errors clustered by window and from a block bootstrap, profiles where they do not do."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from ballbot.identification.bootstrap import bootstrap
from ballbot.identification.checkpoint import Recall, afresh
from ballbot.identification.coordinates import Coordinates
from ballbot.identification.intervals import Errors, Interval, between, intervals
from ballbot.identification.problem import Problem
from ballbot.identification.profile import Profile, profile
from ballbot.identification.starts import Finished
from ballbot.identification.uncertainty import correlation, covariance, unleveraged

CONFIDENCE = 0.95
#: profiles cost a dozen linearisations each
MOST_PROFILES = 2


@dataclass(frozen=True, kw_only=True, eq=False)
class Uncertainty:
    """Of p parameters; NaN for those without standard error."""

    scaled_errors: NDArray[np.float64]  #: (p,), clustered, as shares of the bounds' width
    standard_errors: NDArray[np.float64]  #: (p,), clustered, SI units
    bootstrap_errors: NDArray[np.float64]  #: (p,), SI units
    correlation: NDArray[np.float64]  #: (p, p)
    intervals: dict[str, Interval]  #: of 95 %, by label


def assess(
    problem: Problem,
    finished: Finished,
    *,
    estimated: NDArray[np.bool_],
    at_bound: NDArray[np.bool_],
    seed: int,
    most_profiles: int = MOST_PROFILES,
    recall: Recall = afresh,
) -> Uncertainty:
    """Return how sure the estimate is.

    Parameters
    ----------
    problem : Problem
    finished : Finished
        The estimate.
    estimated : ndarray (p,)
        Which parameters get a standard error.
    at_bound : ndarray (p,)
        Which of the others stand at a bound; they get an interval on one side.
    seed : int
        Of the bootstrap.
    most_profiles : int
        How many parameters are profiled, where the errors are doubtful.
    recall : callable, optional
        Answers for each profile.
    """
    coordinates, point = problem.coordinates, finished.point
    normal = finished.equations.normal
    windows = finished.equations
    clustered = covariance(unleveraged(windows.matrices, windows.scores, estimated), estimated)
    variances = clustered.diagonal()  # not positive where a short, ill-posed fit tells nothing
    scaled_errors = np.sqrt(np.where(variances > 0.0, variances, np.nan))
    resampled = bootstrap(finished.equations, estimated, seed=seed).errors
    errors = Errors(
        point=point,
        clustered=scaled_errors,
        bootstrap=resampled,
        quantile=_quantile(len(normal.scores), int(estimated.sum())),
    )

    def profile_of(place: int) -> Profile:
        others = np.linalg.pinv(normal.matrix[np.ix_(estimated, estimated)], hermitian=True).diagonal()
        independent = others[np.flatnonzero(estimated) == place][0]
        rise = clustered[place, place] / independent * errors.quantile**2

        def answer() -> list[NDArray[np.float64]]:
            one = profile(
                problem,
                finished,
                place,
                free=estimated | at_bound,
                error=float(errors.half_width[place]),
                rise=float(rise),
            )
            return [np.array([one.lower, one.upper], dtype=float)]  # None becomes NaN

        (limits,) = recall("profile", np.array([float(place), float(rise)]), answer)
        lower, upper = (float(one) if np.isfinite(one) else None for one in limits)
        return Profile(place=place, lower=lower, upper=upper)

    found = intervals(coordinates, errors, profile_of, most_profiles=most_profiles)
    slopes = coordinates.slopes(point)
    return Uncertainty(
        scaled_errors=scaled_errors,
        standard_errors=scaled_errors * slopes,
        bootstrap_errors=resampled * slopes,
        correlation=correlation(clustered),
        intervals=found | _at_bounds(coordinates, finished, estimated, at_bound),
    )


def _quantile(windows: int, parameters: int) -> float:
    return float(student.ppf(0.5 + 0.5 * CONFIDENCE, max(windows - parameters, 1)))


def _at_bounds(
    coordinates: Coordinates, finished: Finished, estimated: NDArray[np.bool_], at_bound: NDArray[np.bool_]
) -> dict[str, Interval]:
    """Return the intervals of parameters that stand at a bound: that about where the equations, unbounded, lead."""
    found = {}
    normal = finished.equations.normal
    for i in np.flatnonzero(at_bound & (normal.matrix.diagonal() > 0.0)):
        places = np.flatnonzero(estimated | (np.arange(len(estimated)) == i))
        mine = int(np.flatnonzero(places == i)[0])
        matrix = normal.matrix[np.ix_(places, places)]
        step = -np.linalg.lstsq(matrix, normal.scores[:, places].sum(axis=0), rcond=1e-13)[0][mine]
        wanted = np.zeros(len(estimated), dtype=bool)
        wanted[places] = True
        error = float(np.sqrt(covariance(normal, wanted)[i, i]))
        half = _quantile(len(normal.scores), len(places)) * error
        middle = float(finished.point[i] + step)
        place = int(i)
        found[coordinates.labels[place]] = _reaching(coordinates, place, middle, half, finished.point[i])
    return found


def _reaching(coordinates: Coordinates, place: int, middle: float, half: float, stands: float) -> Interval:
    """Return middle -+ half, stretched so that it has the bound that the parameter stands at within."""
    lower, upper = min(middle - half, float(stands)), max(middle + half, float(stands))
    return between(coordinates, place, lower, upper, method="at bound")
