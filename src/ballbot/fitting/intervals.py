"""95 % intervals of a least-squares estimate: from clustered and bootstrap errors, and from profiles of the likelihood.

A profile shows how far a parameter may go, all others following, before the fit is worse than chance explains. It is
made for parameters whose two errors disagree or reach far.

The cost of n_s states over N residuals each is, up to a constant, minus the logarithm of a likelihood over N n_s.
Residuals within a window are not independent, so the doubled rise is no chi-squared variable but, for one
parameter, one times

    lambda = (clustered variance) / [H^-1]_ii

(L. Pace, A. Salvan and N. Sartori, Adjusting composite likelihood ratio statistics, Statistica Sinica 21 (2011)
129-148). A limit lies where 2 N n_s (cost - least cost) = lambda t^2, t being Student's quantile.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import special

from ballbot.fitting.parameter import ParameterSpace
from ballbot.fitting.run import DEFAULT_RUN, Run
from ballbot.fitting.uncertainty import (
    WindowEquations,
    bootstrap,
    correlation,
    covariance,
    leverage_corrected,
)
from ballbot.progress import Progress
from ballbot.results import key


class Repeated(Protocol):
    """Result of a repeated fit."""

    @property
    def point(self) -> NDArray[np.float64]:
        """The parameters (p,), scaled."""
        ...

    @property
    def cost(self) -> float:
        """The cost there."""
        ...

    def repeated(
        self,
        *,
        moved: NDArray[np.float64],
        free: NDArray[np.bool_],
        most_steps: int,
        target: float = np.inf,
        run: Run = DEFAULT_RUN,
    ) -> Repeated:
        """Fit again from here, after moving the parameters by `moved` (p,), those marked in `free` (p,).

        It may end early where the cost will clearly not come below `target`.
        """
        ...


class RepeatableFit(Repeated, Protocol):
    """A least-squares estimate, with its normal equations, that can be fitted again with parameters moved."""

    @property
    def coordinates(self) -> ParameterSpace:
        """Its parameters."""
        ...

    @property
    def equations(self) -> WindowEquations:
        """The normal equations of each window at the estimate."""
        ...

    @property
    def residual_count(self) -> int:
        """How many residuals the cost counts."""
        ...


#: fits of the other parameters on one side, and steps of each
_MOST_FITS, _STEPS = 4, 3
#: a limit is found if the rise is this near to lambda t^2, as a share of it: lambda is not known better
_NEAR = 0.2


@dataclass(frozen=True, kw_only=True)
class Profile:
    """The 95 % limits of one parameter, scaled; None if the logs set none before its bound."""

    place: int  #: which parameter
    lower: float | None
    upper: float | None


def profile(
    fit: RepeatableFit,
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
    lower, upper = (_limit(fit, place, free=free, step=sign * error, rise=rise) for sign in (-1.0, 1.0))
    return Profile(place=place, lower=lower, upper=upper)


def _limit(
    fit: RepeatableFit,
    place: int,
    *,
    free: NDArray[np.bool_],
    step: float,
    rise: float,
) -> float | None:
    origin, least = fit.point[place], fit.cost
    others = free & (np.arange(len(free)) != place)
    scale = 2.0 * fit.residual_count
    # each fit begins from the farthest one below the limit: windows that have come to stick do not find back
    nearest: Repeated = fit
    # where and the root of the rise there: the farthest below the limit, and the nearest above it
    inside, outside = (origin, 0.0), None
    target = origin + step
    for _ in range(_MOST_FITS):
        target = float(np.clip(target, 0.0, 1.0))
        moved = np.zeros(len(free))
        moved[place] = target - nearest.point[place]
        at = nearest.repeated(moved=moved, free=others, most_steps=_STEPS)
        root = float(np.sqrt(max(scale * (at.cost - least), 0.0)))
        if root**2 < rise:
            inside, nearest = (target, root), at
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


#: how an interval was obtained
Method = Literal["clustered", "bootstrap", "profile", "at bound", "with sweep", "between logs"]

#: clustered and bootstrap errors that differ by more than this factor call for a profile
LARGEST_RATIO = 1.5
#: and so does an interval that reaches so far, as a share of the bounds' width: nothing is straight over that
WIDEST = 0.25


#: half the width of a 95 % interval of a normal variable, in its deviations
HALF_WIDTH = 1.96


@dataclass(frozen=True, kw_only=True)
class Interval:
    """A 95 % confidence interval of a parameter, SI units; infinite on a side that the logs do not limit."""

    lower: float
    upper: float
    method: Method = field(metadata=key("from"))

    @property
    def deviation(self) -> float:
        """Standard deviation of a normal variable with an interval of this width; NaN if a side is infinite."""
        width = self.upper - self.lower
        return width / (2.0 * HALF_WIDTH) if math.isfinite(width) else math.nan

    def __contains__(self, value: float) -> bool:
        """Return whether a value lies within."""
        return self.lower <= value <= self.upper


def profile_ends(
    intervals: Mapping[str, Interval], labels: Sequence[str]
) -> list[tuple[float, float] | None]:
    """Return the ends of those that are a profile's, which take the place of standard errors; None for others."""
    found = [intervals.get(label) for label in labels]
    return [None if one is None or one.method != "profile" else (one.lower, one.upper) for one in found]


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
        far = self.half_width / WIDEST
        worst = np.nan_to_num(np.fmax(apart, far), nan=0.0, posinf=np.inf)
        return np.array([i for i in np.argsort(-worst, kind="stable") if worst[i] > 1.0], dtype=np.int64)


def intervals(
    coordinates: ParameterSpace,
    errors: Errors,
    profiles: Callable[[int], Profile] | None,
    *,
    most_profiles: int,
) -> dict[str, Interval]:
    """Return the interval of each parameter that has errors, by its label.

    Parameters
    ----------
    coordinates : ParameterSpace
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
    coordinates: ParameterSpace, place: int, lower: float | None, upper: float | None, *, method: Method
) -> Interval:
    """Return an interval in SI units from scaled limits of one parameter; None, or past its bound, is no limit.

    An amount's own limit, zero, stays one.
    """
    low = _in_si_units(coordinates, place, lower) if lower is not None and lower > 0.0 else -math.inf
    high = _in_si_units(coordinates, place, upper) if upper is not None and upper < 1.0 else math.inf
    if math.isinf(low) and coordinates.sqrt_scaled[place] and coordinates.lower[place] == 0.0:
        low = 0.0
    return Interval(lower=low, upper=high, method=method)


def _in_si_units(coordinates: ParameterSpace, place: int, scaled: float) -> float:
    point = np.zeros(len(coordinates.lower))
    point[place] = scaled
    return float(coordinates.physical(point)[place])


CONFIDENCE = 0.95
#: profiles cost a dozen linearisations each
MOST_PROFILES = 2
#: so many deviations out, a normal tail is exponential to three parts in a thousand
_EXPONENTIAL = 30.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Uncertainty:
    """Of p parameters; NaN for those without standard error."""

    scaled_errors: NDArray[np.float64]  #: (p,), clustered, as shares of the bounds' width
    standard_errors: NDArray[np.float64]  #: (p,), clustered, SI units
    bootstrap_errors: NDArray[np.float64]  #: (p,), SI units
    correlation: NDArray[np.float64]  #: (p, p)
    intervals: dict[str, Interval]  #: of 95 %, by label


def assess(
    fit: RepeatableFit,
    *,
    estimated: NDArray[np.bool_],
    at_bound: NDArray[np.bool_],
    most_profiles: int = MOST_PROFILES,
    widen: float = 1.0,
    run: Run = DEFAULT_RUN,
) -> Uncertainty:
    """Return the uncertainty of an estimate.

    Parameters
    ----------
    fit : RepeatableFit
    estimated : ndarray (p,)
        Which parameters get a standard error.
    at_bound : ndarray (p,)
        Which of the others are at a bound; they get an interval on one side.
    most_profiles : int
        How many parameters are profiled, if their errors are doubtful.
    widen : float
        What all errors are multiplied by, as a discrepancy of the residuals asks for.
    run : Run, optional
        Its seed is the bootstrap's; the stage "intervals" is reported after each profile.
    """
    coordinates = fit.coordinates
    normal = fit.equations.normal
    clustered, errors = _errors(fit, estimated, widen=widen, seed=run.seed)
    profiled: list[int] = []

    def profile_of(place: int) -> Profile:
        others = np.linalg.pinv(normal.matrix[np.ix_(estimated, estimated)], hermitian=True).diagonal()
        independent = others[np.flatnonzero(estimated) == place][0]
        rise = clustered[place, place] / independent * errors.quantile**2

        one = profile(
            fit,
            place,
            free=estimated | at_bound,
            error=float(errors.half_width[place]),
            rise=float(rise),
        )
        profiled.append(place)
        most = min(len(errors.doubtful), most_profiles)
        run.progress(Progress(stage="intervals", done=len(profiled), total=most))
        return one

    found = intervals(coordinates, errors, profile_of, most_profiles=most_profiles)
    slopes = coordinates.slopes(fit.point)
    return Uncertainty(
        scaled_errors=errors.clustered,
        standard_errors=errors.clustered * slopes,
        bootstrap_errors=errors.bootstrap * slopes,
        correlation=correlation(clustered),
        intervals=found | _intervals_at_bounds(coordinates, fit, estimated, at_bound, widen),
    )


def _errors(
    fit: RepeatableFit, estimated: NDArray[np.bool_], *, widen: float, seed: int
) -> tuple[NDArray[np.float64], Errors]:
    """Return the clustered covariance (p, p), scaled, and the errors."""
    windows = fit.equations
    corrected = leverage_corrected(windows.matrices, windows.scores, estimated)
    clustered = widen**2 * covariance(corrected, estimated)
    variances = clustered.diagonal()  # not positive if a short, ill-posed fit has no information
    errors = Errors(
        point=fit.point,
        clustered=np.sqrt(np.where(variances > 0.0, variances, np.nan)),
        bootstrap=widen * bootstrap(windows, estimated, seed=seed).errors,
        quantile=_quantile(len(windows.scores), int(estimated.sum())),
    )
    return clustered, errors


def _quantile(windows: int, parameters: int) -> float:
    return float(special.stdtrit(max(windows - parameters, 1), 0.5 + 0.5 * CONFIDENCE))


def _intervals_at_bounds(
    coordinates: ParameterSpace,
    fit: RepeatableFit,
    estimated: NDArray[np.bool_],
    at_bound: NDArray[np.bool_],
    widen: float,
) -> dict[str, Interval]:
    """Return the intervals of parameters at a bound, about the point that the unbounded equations lead to."""
    found = {}
    normal = fit.equations.normal
    for i in np.flatnonzero(at_bound & (normal.matrix.diagonal() > 0.0)):
        places = np.flatnonzero(estimated | (np.arange(len(estimated)) == i))
        mine = int(np.flatnonzero(places == i)[0])
        matrix = normal.matrix[np.ix_(places, places)]
        step = -np.linalg.lstsq(matrix, normal.scores[:, places].sum(axis=0), rcond=1e-13)[0][mine]
        wanted = np.zeros(len(estimated), dtype=bool)
        wanted[places] = True
        error = widen * float(np.sqrt(covariance(normal, wanted)[i, i]))
        half = _quantile(len(normal.scores), len(places)) * error
        middle, place, at = float(fit.point[i] + step), int(i), float(fit.point[i])
        beyond = abs(middle - at) / error if error > 0.0 else 0.0
        reach = error * truncated_reach(beyond)
        lower, upper = (
            (min(middle - half, at), max(middle + half, at + reach))
            if at <= 0.5
            else (min(middle - half, at - reach), max(middle + half, at))
        )
        found[coordinates.labels[place]] = between(coordinates, place, lower, upper, method="at bound")
    return found


def truncated_reach(beyond: float) -> float:
    """Return how far from a bound a normal variable whose middle lies beyond it reaches with 95 %, in its deviations.

    The variable is known to be on this side of the bound, so this is never zero, whatever the middle.
    """
    if beyond > _EXPONENTIAL:
        return -math.log(1.0 - CONFIDENCE) / beyond
    return -float(special.ndtri((1.0 - CONFIDENCE) * special.ndtr(-beyond))) - beyond
