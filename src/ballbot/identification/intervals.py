"""From errors to 95 % intervals: which of two errors, a profile where they will not do, and what bounds have to say."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ballbot.identification.coordinates import Coordinates
from ballbot.identification.profile import Profile

#: how an interval was obtained
Method = Literal["clustered", "bootstrap", "profile", "at bound", "with sweep"]

#: clustered and bootstrap errors that differ by more than this factor call for a profile
LARGEST_RATIO = 1.5
#: and so does an interval that reaches so far, as a share of the bounds' width: nothing is straight over that
WIDEST = 0.25


@dataclass(frozen=True, kw_only=True)
class Interval:
    """Where a parameter is with a confidence of 95 %, SI units; infinite on a side that the logs do not limit."""

    lower: float
    upper: float
    method: Method

    def __contains__(self, value: float) -> bool:
        """Return whether a value lies within."""
        return self.lower <= value <= self.upper

    def to_dict(self) -> dict[str, object]:
        """Return what results.json holds; a side without limit is None."""
        return {
            "lower": self.lower if math.isfinite(self.lower) else None,
            "upper": self.upper if math.isfinite(self.upper) else None,
            "from": self.method,
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class Errors:
    """Of parameters (p,), scaled; NaN where there is none."""

    point: NDArray[np.float64]  #: the estimate
    clustered: NDArray[np.float64]
    bootstrap: NDArray[np.float64]
    quantile: float  #: t, Student's for 95 %

    @property
    def half_width(self) -> NDArray[np.float64]:
        """What lies on either side of the estimate (p,), by the larger error."""
        return self.quantile * np.fmax(self.clustered, self.bootstrap)

    @property
    def doubtful(self) -> NDArray[np.int64]:
        """The places of parameters whose errors disagree or reach too far or past a bound, the worst first."""
        with np.errstate(invalid="ignore", divide="ignore"):
            apart = np.abs(np.log(self.bootstrap / self.clustered)) / math.log(LARGEST_RATIO)
        far = self.half_width / WIDEST
        worst = np.nan_to_num(np.fmax(apart, far), nan=0.0, posinf=np.inf)
        return np.array([i for i in np.argsort(-worst, kind="stable") if worst[i] > 1.0], dtype=np.int64)


def intervals(
    coordinates: Coordinates, errors: Errors, profiles: Callable[[int], Profile] | None, *, most_profiles: int
) -> dict[str, Interval]:
    """Return the interval of each parameter that has errors, by its label.

    Parameters
    ----------
    coordinates : Coordinates
    errors : Errors
    profiles : callable, optional
        From a parameter's place to its profile.
    most_profiles : int
        How many of the doubtful parameters are profiled, the worst first; the others keep the larger error.
    """
    profiled = {int(i): profiles(int(i)) for i in errors.doubtful[:most_profiles]} if profiles else {}
    found = {}
    for i in np.flatnonzero(np.isfinite(errors.half_width)):
        place, label = int(i), coordinates.labels[i]
        if place in profiled:
            one = profiled[place]
            found[label] = between(coordinates, place, one.lower, one.upper, method="profile")
            continue
        half, z = float(errors.half_width[i]), float(errors.point[i])
        larger: Method = "bootstrap" if errors.bootstrap[i] > errors.clustered[i] else "clustered"
        found[label] = between(coordinates, place, z - half, z + half, method=larger)
    return found


def between(
    coordinates: Coordinates, place: int, lower: float | None, upper: float | None, *, method: Method
) -> Interval:
    """Return an interval in SI units from scaled limits of one parameter; None, or past its bound, is no limit.

    An amount's own limit, zero, stays one.
    """
    low = _physical(coordinates, place, lower) if lower is not None and lower > 0.0 else -math.inf
    high = _physical(coordinates, place, upper) if upper is not None and upper < 1.0 else math.inf
    if math.isinf(low) and coordinates.amounts[place] and coordinates.lower[place] == 0.0:
        low = 0.0
    return Interval(lower=low, upper=high, method=method)


def _physical(coordinates: Coordinates, place: int, scaled: float) -> float:
    point = np.zeros(len(coordinates.lower))
    point[place] = scaled
    return float(coordinates.physical(point)[place])
