"""How an estimate varies from one log to another of the same robot: random effects with a prior from other robots.

Log k gives a parameter the estimate y_k, with the variance v_k that its own residuals show, and

    y_k = theta + a_k + e_k        a_k ~ N(0, tau^2),  e_k ~ N(0, v_k)

where a_k is what changes from log to log and the model lacks: the way driven, where the rollers touch, the floor, the
drift of a sensor. Little is known of tau from few logs, and nothing from one. Other robots, with two logs or more
each, give it a prior, tau^2 ~ scaled inverse chi-squared of nu degrees and scale s (`fit_prior`). It is the one under
which the other logs of each robot predict the one left out best. The error of that one is not known beforehand and
counts as the median of theirs, so tau also contains the variation of the errors from log to log. With

    w_k = 1 / (v_k + tau^2),   V = 1 / sum w_k,   m = V sum w_k y_k

and no prior knowledge of theta, the logs leave tau with

    p(tau | y) ~ p(tau) sqrt(V) prod_k sqrt(w_k) exp(-w_k (y_k - m)^2 / 2)

(A. Gelman et al., Bayesian Data Analysis, 3rd edition 2013, section 5.4), theta with a mixture of N(m, V) over it, and
the estimate from a further log of variance v with a mixture of N(m, V + tau^2 + v). Intervals are between the mixtures'
quantiles. One log and many are the same formula; with one, p(tau | y) is the prior.

If all v_k are zero this is conjugate: theta and the next estimate have Student's t with nu + K - 1 degrees. That, and
the coverage over robots drawn from the prior, which is exact, are the tests' oracles.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import log_ndtr, logsumexp, ndtr

#: of the intervals
CONFIDENCE = 0.95
#: values of tau, in even steps of its logarithm; more change an interval's ends by less than 1e-3 of its width
_GRID = 241
#: of the prior, tau / s: beyond, there is less than 1e-6 of it for nu of 2 or more
_RANGE = (0.1, 1e3)
#: least degrees of a prior that is fitted: fewer have no finite variance
_LEAST_DEGREES = 3.0
_HALVINGS = 60


@dataclass(frozen=True, kw_only=True)
class VariancePrior:
    """What other robots tell of tau^2: scaled inverse chi-squared."""

    scale: float  #: s, in the parameter's unit
    degrees: float  #: nu

    def density(self, tau: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the logarithm of the density of log tau (..., up to a constant)."""
        half = 0.5 * self.degrees
        return -self.degrees * np.log(tau / self.scale) - half * (self.scale / tau) ** 2


@dataclass(frozen=True, kw_only=True)
class Limits95:
    """A 95 % interval."""

    lower: float
    upper: float


@dataclass(frozen=True, kw_only=True)
class LogVariation:
    """A parameter over several logs of one robot, or one."""

    mean: float  #: theta: mean of its distribution
    parameter: Limits95  #: for theta, the mean over all logs of this robot
    prediction: Limits95  #: for the estimate from another log
    between: float  #: tau: median of its distribution
    between_limits: Limits95


def vary(
    estimates: NDArray[np.float64],
    errors: NDArray[np.float64],
    *,
    prior: VariancePrior,
    next_error: float,
) -> LogVariation:
    """Return the distribution of a parameter over logs of one robot, from the estimates of some.

    Parameters
    ----------
    estimates : ndarray (k,)
        One of each log, k of 1 or more.
    errors : ndarray (k,)
        Standard errors within each log, zero or more.
    prior : VariancePrior
    next_error : float
        Standard error within the log predicted.
    """
    tau = _taus(prior, estimates)
    middle, spread, log_likelihood = _given(tau, estimates, errors)
    weights = _normalized(prior.density(tau) + log_likelihood)
    ahead = np.sqrt(spread**2 + tau**2 + next_error**2)
    return LogVariation(
        mean=float(weights @ middle),
        parameter=_mixture_limits(weights, middle, spread),
        prediction=_mixture_limits(weights, middle, ahead),
        between=_quantile(tau, weights, 0.5),
        between_limits=Limits95(
            lower=_quantile(tau, weights, 0.5 - 0.5 * CONFIDENCE),
            upper=_quantile(tau, weights, 0.5 + 0.5 * CONFIDENCE),
        ),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class RobotLogs:
    """Estimates from the logs of one robot, k of 2 or more."""

    estimates: NDArray[np.float64]  #: (k,)
    errors: NDArray[np.float64]  #: (k,), standard errors within each log
    #: (k,), 1 if the estimate ended at its upper bound, so that it is that or more, -1 at the lower one, else 0
    beyond: NDArray[np.int64]


def fit_prior(robots: Sequence[RobotLogs], *, most_degrees: float) -> VariancePrior:
    """Return the prior under which the other logs of each robot predict the one left out best.

    That is the largest product of predictive densities; an estimate at a bound has the probability of all beyond it (J.
    Tobin, Estimation of relationships for limited dependent variables, Econometrica 26 (1958) 24-36).

    Parameters
    ----------
    robots : sequence of RobotLogs
    most_degrees : float
        Of the prior: no more than there are independent robots, which determine a variance no better.
    """
    limits = (_LEAST_DEGREES, max(most_degrees, _LEAST_DEGREES))
    variances = [np.var(one.estimates, ddof=1) for one in robots]
    typical = max(float(np.sqrt(np.mean(variances))), float(np.finfo(float).tiny))
    tau = typical * np.exp(np.linspace(np.log(1e-3), np.log(1e2), 2 * _GRID))
    parts = [_left_out(tau, one, k) for one in robots for k in range(len(one.estimates))]
    of_others, ahead = (np.stack(part) for part in zip(*parts, strict=True))

    def prior_of(numbers: NDArray[np.float64]) -> VariancePrior:
        degrees = float(np.exp(np.clip(numbers[1], *np.log(limits))))
        return VariancePrior(scale=float(typical * np.exp(np.clip(numbers[0], -7.0, 5.0))), degrees=degrees)

    def loss(numbers: NDArray[np.float64]) -> float:
        weights = of_others + prior_of(numbers).density(tau)
        return -float(np.sum(_log_sums(weights + ahead) - _log_sums(weights)))

    starts = [np.array([scale, degrees]) for scale in (-2.0, -0.5) for degrees in np.log((4.0, 12.0))]
    found = min((minimize(loss, start, method="Nelder-Mead") for start in starts), key=lambda one: one.fun)
    return prior_of(found.x)


def _log_sums(logs: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the logarithms (n,) of sums over rows (n, g) that are given by their logarithms."""
    return np.asarray(logsumexp(logs, axis=1))


def _left_out(
    tau: NDArray[np.float64], robot: RobotLogs, k: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the logarithms at each tau (g,) of the other logs' likelihood, and of the density of log k by them."""
    others = np.arange(len(robot.estimates)) != k
    middle, spread, log_likelihood = _given(tau, robot.estimates[others], robot.errors[others])
    deviation = np.sqrt(spread**2 + tau**2 + np.median(robot.errors[others]) ** 2)
    off = (robot.estimates[k] - middle) / deviation
    if robot.beyond[k]:
        return log_likelihood, log_ndtr(-robot.beyond[k] * off)
    return log_likelihood, -np.log(deviation) - 0.5 * off**2


def interval_score(limits: Limits95, value: float) -> float:
    """Return the width of an interval, and 2 / 0.05 times the distance by which it misses a value; small is good.

    T. Gneiting and A. Raftery, Strictly proper scoring rules, Journal of the American Statistical Association 102
    (2007) 359-378, equation (43).
    """
    missed = max(limits.lower - value, 0.0) + max(value - limits.upper, 0.0)
    return limits.upper - limits.lower + 2.0 / (1.0 - CONFIDENCE) * missed


def _taus(prior: VariancePrior, estimates: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a grid of tau (g,): the prior's range, extended well beyond the range of the estimates."""
    lowest, highest = _RANGE[0] * prior.scale, _RANGE[1] * prior.scale
    highest = max(highest, 10.0 * float(np.ptp(estimates)))
    return np.exp(np.linspace(np.log(lowest), np.log(highest), _GRID))


def _given(
    tau: NDArray[np.float64], estimates: NDArray[np.float64], errors: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return m, sqrt(V) and the logarithm of the likelihood at each tau (g,)."""
    w = 1.0 / (errors**2 + tau[:, None] ** 2)
    V = 1.0 / w.sum(axis=1)
    m = V * (w * estimates).sum(axis=1)
    squares = (w * (estimates - m[:, None]) ** 2).sum(axis=1)
    log_likelihood = 0.5 * (np.log(V) + np.log(w).sum(axis=1) - squares)
    return m, np.sqrt(V), log_likelihood


def _normalized(logs: NDArray[np.float64]) -> NDArray[np.float64]:
    weights = np.exp(logs - logs.max())
    return weights / weights.sum()


def _mixture_limits(
    weights: NDArray[np.float64], middle: NDArray[np.float64], spread: NDArray[np.float64]
) -> Limits95:
    """Return the quantiles of a mixture of normal distributions, by halving."""
    ends = []
    for share in (0.5 - 0.5 * CONFIDENCE, 0.5 + 0.5 * CONFIDENCE):
        low, high = float((middle - 40.0 * spread).min()), float((middle + 40.0 * spread).max())
        for _ in range(_HALVINGS):
            at = 0.5 * (low + high)
            below = float(weights @ ndtr((at - middle) / spread)) < share
            low, high = (at, high) if below else (low, at)
        ends.append(0.5 * (low + high))
    return Limits95(lower=ends[0], upper=ends[1])


def _quantile(values: NDArray[np.float64], weights: NDArray[np.float64], share: float) -> float:
    return float(np.interp(share, np.cumsum(weights) - 0.5 * weights, values))
