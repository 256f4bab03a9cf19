"""Uncertainty and 95 % intervals of a least-squares estimate, by clustered errors or by a likelihood's profile."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from scipy import special

from ballbot.arrays import Floats
from ballbot.fitting.parameter import ParameterSpace
from ballbot.fitting.uncertainty import correlation, deviations
from ballbot.results import key

CONFIDENCE = 0.95
#: half width of a 95 % interval of a normal variable, in standard deviations
HALF_WIDTH = 1.96
#: how an interval was obtained
Method = Literal["clustered", "profile", "at bound", "between logs", "momentum"]


@dataclass(frozen=True, kw_only=True)
class Interval:
    """A 95 % confidence interval of a parameter, SI units; infinite on a side that the data do not limit."""

    lower: float
    upper: float
    method: Method = field(metadata=key("from"))


def between(
    coordinates: ParameterSpace, index: int, lower: float | None, upper: float | None, *, method: Method
) -> Interval:
    """Return the interval in SI units from the scaled limits of one parameter.

    None, or a limit beyond the parameter's bound, means that the data set no limit; but an amount is never below zero.
    """
    low = coordinates.physical_one(index, lower) if lower is not None and lower > 0.0 else -math.inf
    high = coordinates.physical_one(index, upper) if upper is not None and upper < 1.0 else math.inf
    if math.isinf(low) and coordinates.nonnegative[index] and coordinates.lower[index] == 0.0:
        low = 0.0
    return Interval(lower=low, upper=high, method=method)


@dataclass(frozen=True, kw_only=True, eq=False)
class Uncertainty:
    """Uncertainty of p estimated parameters."""

    coordinates: ParameterSpace
    point: Floats  #: (p,), the estimate, scaled
    covariance: Floats  #: (p, p), clustered, scaled; NaN for parameters without a standard error
    intervals: Mapping[str, Interval]  #: of 95 %, by label

    @property
    def scaled_errors(self) -> Floats:
        """Standard errors (p,), scaled; NaN if a variance is not positive."""
        return deviations(self.covariance)

    @property
    def standard_errors(self) -> Floats:
        """Standard errors (p,), SI units."""
        return self.scaled_errors * self.coordinates.slopes(self.point)

    @property
    def correlation(self) -> Floats:
        """The correlation matrix (p, p)."""
        return correlation(self.covariance)

    def with_variation(self, added: Floats) -> Uncertainty:
        """Return the uncertainty with an added covariance (p, p), scaled; an unknown error stays unknown."""
        return replace(self, covariance=self.covariance + added, intervals=self.widened(added.diagonal()))

    def widened(self, added: Floats) -> dict[str, Interval]:
        """Return all intervals, widened about the estimate by added variances (p,), scaled."""
        space, intervals = self.coordinates, {}
        for index, label in enumerate(space.labels):
            first = int(space.first[index])
            own = self.intervals.get(label, self.intervals.get(space.labels[first]))
            if own is None:
                continue
            ends, middle = [], self.point[first]
            more = HALF_WIDTH * np.sqrt(max(added[first], added[index], 0.0))
            for end, sign in ((own.lower, -1.0), (own.upper, 1.0)):
                reach = abs(space.scaled_one(index, end) - middle)
                ends.append(float(middle + sign * np.hypot(reach, more)) if np.isfinite(end) else None)
            intervals[label] = between(space, index, ends[0], ends[1], method=own.method)
        return intervals


#: beyond so many standard deviations, a normal tail is exponential to three parts in a thousand
_EXPONENTIAL = 30.0


def truncated_reach(beyond: float) -> float:
    """Return the 95 % quantile of the distance from a bound, in standard deviations.

    It is that of a normal variable whose mean lies `beyond` the bound by so many standard deviations, truncated there.
    """
    if beyond > _EXPONENTIAL:
        return -math.log(1.0 - CONFIDENCE) / beyond
    return -float(special.ndtri((1.0 - CONFIDENCE) * special.ndtr(-beyond))) - beyond
