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
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import special

from ballbot.fitting.experiment import At
from ballbot.fitting.fit import Descended, Fit, descend
from ballbot.fitting.parameter import ParameterSpace
from ballbot.fitting.run import DEFAULT_RUN, Run
from ballbot.fitting.uncertainty import bootstrap, correlation, covariance, leverage_corrected
from ballbot.progress import Progress
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
        """Return intervals whose distances from the estimate contain further variances (p,), scaled."""
        found = {}
        for place, label in enumerate(self.coordinates.labels):
            one = self.intervals.get(label)
            if one is None:
                continue
            ends, middle = [], self.point[place]
            for end, sign in ((one.lower, -1.0), (one.upper, 1.0)):
                reach = abs(self.coordinates.scaled_one(place, end) - middle)
                wide = middle + sign * np.hypot(reach, HALF_WIDTH * np.sqrt(max(added[place], 0.0)))
                ends.append(float(wide) if np.isfinite(end) else None)
            found[label] = between(self.coordinates, place, ends[0], ends[1], method=one.method)
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


def assess(
    fit: Fit[At], *, most_profiles: int = MOST_PROFILES, widen: float = 1.0, run: Run = DEFAULT_RUN
) -> Uncertainty:
    """Return the uncertainty of an estimate.

    Parameters
    ----------
    fit : Fit
    most_profiles : int
        How many parameters are profiled, if their errors are doubtful, the worst first.
    widen : float
        What all errors are multiplied by, as a discrepancy of the residuals asks for.
    run : Run, optional
        Its seed is the bootstrap's; the stage "intervals" is reported after each profile.
    """
    finished, estimated = fit.finished, fit.estimated
    coordinates, blocks = finished.experiment.coordinates, finished.equations
    corrected = leverage_corrected(blocks.matrices, blocks.scores, estimated)
    clustered = widen**2 * covariance(corrected, estimated)
    variances = clustered.diagonal()  # not positive if a short, ill-posed fit has no information
    errors = Errors(
        point=finished.point,
        clustered=np.sqrt(np.where(variances > 0.0, variances, np.nan)),
        bootstrap=widen * bootstrap(blocks, estimated, seed=run.seed).errors,
        quantile=_quantile(len(blocks.scores), int(estimated.sum())),
    )
    chosen = errors.doubtful[:most_profiles].tolist()
    profiled = {}
    for done, place in enumerate(chosen, start=1):
        within = np.flatnonzero(estimated)
        inverse = np.linalg.pinv(blocks.normal.matrix[np.ix_(within, within)], hermitian=True)
        independent = inverse.diagonal()[within == place][0]
        profiled[place] = profile(
            finished,
            place,
            free=estimated | fit.at_bound,
            error=float(errors.half_width[place]),
            rise=float(clustered[place, place] / independent * errors.quantile**2),
        )
        run.progress(Progress(stage="intervals", done=done, total=len(chosen)))
    return Uncertainty(
        coordinates=coordinates,
        point=finished.point,
        covariance=clustered,
        bootstrap=errors.bootstrap,
        intervals=errors.intervals(coordinates, profiled) | _intervals_at_bounds(fit, widen),
    )


def _quantile(windows: int, parameters: int) -> float:
    return float(special.stdtrit(max(windows - parameters, 1), 0.5 + 0.5 * CONFIDENCE))


#: fits of the other parameters on one side, and steps of each
_MOST_FITS, _STEPS = 4, 3
#: a limit is found if the rise is this near to lambda t^2, as a share of it: lambda is not known better
_NEAR = 0.2


def profile(
    fit: Descended[At], place: int, *, free: NDArray[np.bool_], error: float, rise: float
) -> tuple[float | None, float | None]:
    """Return the 95 % limits of one parameter, scaled; None if the logs set none before its bound.

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
    others = free & (np.arange(len(free)) != place)
    # each fit begins from the farthest one below the limit: windows that have come to stick do not find back
    nearest = [fit, fit]

    def fitted(target: float, side: int) -> float:
        """Return the root of the rise with the parameter there."""
        moved = np.zeros(len(free))
        moved[place] = target - nearest[side].point[place]
        at = descend(fit.experiment, nearest[side].end, free=others, most_steps=_STEPS, moved=moved)
        root = float(np.sqrt(max(2.0 * fit.experiment.residual_count * (at.cost - fit.cost), 0.0)))
        if root**2 < rise:
            nearest[side] = at
        return root

    origin = float(fit.point[place])
    lower, upper = (
        _limit(lambda target, side=side: fitted(target, side), origin, step=sign * error, rise=rise)
        for side, sign in ((0, -1.0), (1, 1.0))
    )
    return lower, upper


def _limit(root_of: Callable[[float], float], origin: float, *, step: float, rise: float) -> float | None:
    """Return where the root of the rise reaches that of `rise`: it is nearly straight in the distance."""
    wanted = np.sqrt(rise)
    # where and the root of the rise there: the farthest below the limit, and the nearest above it
    inside, outside = (origin, 0.0), None
    target = origin + step
    for _ in range(_MOST_FITS):
        target = float(np.clip(target, 0.0, 1.0))
        root = root_of(target)
        if root**2 < rise:
            inside = (target, root)
            if target in (0.0, 1.0):
                return None
        else:
            outside = (target, root)
        if abs(root**2 / rise - 1.0) < _NEAR:
            return target
        if outside is not None:
            share = (wanted - inside[1]) / (outside[1] - inside[1])
            target = inside[0] + share * (outside[0] - inside[0])
        else:
            longer = 2.0 if inside[1] <= 0.5 * wanted else wanted / inside[1] * 1.05
            target = origin + longer * ((inside[0] - origin) or step)
    return target if outside else None


def _intervals_at_bounds(fit: Fit[At], widen: float) -> dict[str, Interval]:
    """Return the intervals of parameters at a bound, about the point that the unbounded equations lead to."""
    found = {}
    coordinates, normal = fit.finished.experiment.coordinates, fit.finished.equations.normal
    for i in np.flatnonzero(fit.at_bound & (normal.matrix.diagonal() > 0.0)).tolist():
        wanted = fit.estimated | (np.arange(len(fit.estimated)) == i)
        places = np.flatnonzero(wanted)
        matrix, score = normal.matrix[np.ix_(places, places)], normal.scores[:, places].sum(axis=0)
        step = -np.linalg.lstsq(matrix, score, rcond=1e-13)[0][places == i][0]
        error = widen * float(np.sqrt(covariance(normal, wanted)[i, i]))
        half = _quantile(len(normal.scores), len(places)) * error
        at = float(fit.finished.point[i])
        middle = float(at + step)
        reach = error * truncated_reach(abs(middle - at) / error if error > 0.0 else 0.0)
        lower, upper = (
            (min(middle - half, at), max(middle + half, at + reach))
            if at <= 0.5
            else (min(middle - half, at - reach), max(middle + half, at))
        )
        found[coordinates.labels[i]] = between(coordinates, i, lower, upper, method="at bound")
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
