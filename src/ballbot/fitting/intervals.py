"""95 % intervals of a least-squares estimate: from clustered and bootstrap errors, and from profiles of the likelihood.

A profile (`ballbot.fitting.fit`) shows how far a parameter may go, all others following, before the fit is worse than
chance explains. It is made for parameters whose two errors disagree or reach far.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import special

from ballbot.fitting.parameter import ParameterSpace
from ballbot.fitting.uncertainty import correlation
from ballbot.results import key

CONFIDENCE = 0.95
#: half the width of a 95 % interval of a normal variable, in its deviations
HALF_WIDTH = 1.96
#: how an interval was obtained
Method = Literal["clustered", "bootstrap", "profile", "at bound", "with sweep", "between logs"]


@dataclass(frozen=True, kw_only=True)
class Interval:
    """A 95 % confidence interval of a parameter, SI units; infinite on a side that the logs do not limit."""

    lower: float
    upper: float
    method: Method = field(metadata=key("from"))

    def __contains__(self, value: float) -> bool:
        """Return whether a value lies within."""
        return self.lower <= value <= self.upper


def between(
    coordinates: ParameterSpace, place: int, lower: float | None, upper: float | None, *, method: Method
) -> Interval:
    """Return an interval in SI units from scaled limits of one parameter; None, or past its bound, is no limit.

    An amount's own limit, zero, stays one.
    """
    low = coordinates.physical_one(place, lower) if lower is not None and lower > 0.0 else -math.inf
    high = coordinates.physical_one(place, upper) if upper is not None and upper < 1.0 else math.inf
    if math.isinf(low) and coordinates.sqrt_scaled[place] and coordinates.lower[place] == 0.0:
        low = 0.0
    return Interval(lower=low, upper=high, method=method)


@dataclass(frozen=True, kw_only=True, eq=False)
class Uncertainty:
    """Of p parameters about an estimate."""

    coordinates: ParameterSpace
    point: NDArray[np.float64]  #: (p,), the estimate, scaled
    covariance: NDArray[np.float64]  #: (p, p), clustered, scaled; NaN of those without standard error
    bootstrap: NDArray[np.float64]  #: (p,), standard errors by the bootstrap, scaled
    intervals: Mapping[str, Interval]  #: of 95 %, by label

    @property
    def scaled_errors(self) -> NDArray[np.float64]:
        """Standard errors (p,) as shares of the bounds' width; NaN if a variance is not positive."""
        variances = self.covariance.diagonal()
        return np.sqrt(np.where(variances > 0.0, variances, np.nan))

    @property
    def standard_errors(self) -> NDArray[np.float64]:
        """Standard errors (p,), SI units."""
        return self.scaled_errors * self.coordinates.slopes(self.point)

    @property
    def correlation(self) -> NDArray[np.float64]:
        """The correlation matrix (p, p)."""
        return correlation(self.covariance)

    def with_variation(self, added: NDArray[np.float64]) -> Uncertainty:
        """Return an uncertainty with a further covariance (p, p), scaled; an error that is unknown stays unknown."""
        return replace(self, covariance=self.covariance + added, intervals=self.widened(added.diagonal()))

    def widened(self, added: NDArray[np.float64]) -> dict[str, Interval]:
        """Return intervals of all numbers whose distances from the estimate contain further variances (p,), scaled."""
        space, found = self.coordinates, {}
        for place, label in enumerate(space.labels):
            first = int(space.first[place])
            own = self.intervals.get(label, self.intervals.get(space.labels[first]))
            if own is None:
                continue
            ends, middle = [], self.point[first]
            more = HALF_WIDTH * np.sqrt(max(added[first], added[place], 0.0))
            for end, sign in ((own.lower, -1.0), (own.upper, 1.0)):
                reach = abs(space.scaled_one(place, end) - middle)
                ends.append(float(middle + sign * np.hypot(reach, more)) if np.isfinite(end) else None)
            found[label] = between(space, place, ends[0], ends[1], method=own.method)
        return found


#: clustered and bootstrap errors that differ by more than this factor call for a profile, and so does an interval that
#: reaches so far, as a share of the bounds' width: nothing is straight over that
LARGEST_RATIO, WIDEST = 1.5, 0.25
#: profiles cost a dozen linearisations each
MOST_PROFILES = 2


@dataclass(frozen=True, kw_only=True, eq=False)
class Errors:
    """Standard errors of parameters (p,), scaled; NaN if not estimated."""

    point: NDArray[np.float64]  #: the estimate
    clustered: NDArray[np.float64]
    bootstrap: NDArray[np.float64]
    quantile: float  #: t, Student's for 95 %

    @property
    def half_width(self) -> NDArray[np.float64]:
        """Half width of the interval (p,), by the larger error."""
        return self.quantile * np.fmax(self.clustered, self.bootstrap)

    @property
    def doubtful(self) -> NDArray[np.int64]:
        """The places of parameters whose errors disagree or reach too far or past a bound, the worst first."""
        with np.errstate(invalid="ignore", divide="ignore"):
            apart = np.abs(np.log(self.bootstrap / self.clustered)) / math.log(LARGEST_RATIO)
        worst = np.nan_to_num(np.fmax(apart, self.half_width / WIDEST), nan=0.0, posinf=np.inf)
        return np.array([i for i in np.argsort(-worst, kind="stable") if worst[i] > 1.0], dtype=np.int64)

    def intervals(
        self,
        coordinates: ParameterSpace,
        profiled: Mapping[int, tuple[float | None, float | None]],
    ) -> dict[str, Interval]:
        """Return the interval of each parameter that has errors, by its label; `profiled` has the limits of some."""
        found = {}
        for place in np.flatnonzero(np.isfinite(self.half_width)).tolist():
            half, z = float(self.half_width[place]), float(self.point[place])
            method: Method = "bootstrap" if self.bootstrap[place] > self.clustered[place] else "clustered"
            lower, upper = profiled.get(place, (z - half, z + half))
            method = "profile" if place in profiled else method
            found[coordinates.labels[place]] = between(coordinates, place, lower, upper, method=method)
        return found


#: so many deviations out, a normal tail is exponential to three parts in a thousand
_EXPONENTIAL = 30.0


def truncated_reach(beyond: float) -> float:
    """Return how far from a bound a normal variable whose middle lies beyond it reaches with 95 %, in its deviations.

    The variable is known to be on this side of the bound, so this is never zero, whatever the middle.
    """
    if beyond > _EXPONENTIAL:
        return -math.log(1.0 - CONFIDENCE) / beyond
    return -float(special.ndtri((1.0 - CONFIDENCE) * special.ndtr(-beyond))) - beyond
