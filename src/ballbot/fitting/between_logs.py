"""How an estimate varies from one log to another of the same robot: joint random effects with a prior.

Log k gives p parameters the estimates y_k, with the covariance C_k that its own residuals show, and

    y_k = theta + a_k + e_k        a_k ~ N(0, tau^2 D),  e_k ~ N(0, C_k)

where a_k is what changes from log to log and the model lacks: the way driven, where the rollers touch, the floor, the
drift of a sensor. D is diagonal, and small beside C_k in the directions in which parameters make up for one another: so
each of them keeps its large error, and what they give together gets one of the size of D. Little is known of tau from
few logs, and nothing from one. Other robots, with two logs each, give D its sizes and tau a prior, tau^2 ~ scaled
inverse chi-squared of nu degrees and scale 1 (`campaigns.between_logs`). With

    W_k = (C_k + tau^2 D)^-1,   V = (sum W_k)^-1,   m = V sum W_k y_k

and no prior knowledge of theta, the logs leave tau with

    p(tau | y) ~ p(tau) sqrt(|V|) prod_k sqrt(|W_k|) exp(-(y_k - m)^T W_k (y_k - m) / 2)

(A. Gelman et al., Bayesian Data Analysis, 3rd edition 2013, section 5.4). The covariance of theta is the mean of V over
it. One log and many are the same formula; with one, p(tau | y) is the prior and the covariance C_1 + E(tau^2) D.

If all C_k are zero this is conjugate: tau^2 has nu + (K - 1) p degrees. That, and the coverage over robots drawn from
the prior, which is exact, are the tests' oracles.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, logsumexp

from ballbot.fitting.intervals import Uncertainty
from ballbot.fitting.uncertainty import WindowEquations, leverage_corrected

#: values of tau, in even steps of its logarithm
_TAU = np.geomspace(0.05, 50.0, 121)
#: of a covariance's diagonal
_RIDGE = 1e-10


@dataclass(frozen=True, kw_only=True, eq=False)
class LogSpread:
    """What logs of one robot tell of tau, and of theta."""

    factor: float  #: root of the mean of tau^2
    covariance: NDArray[np.float64]  #: of theta (p, p)
    #: of theta, beyond that without variation between logs (p, p)
    added: NDArray[np.float64]
    p_value: float  #: how likely estimates differ as much by chance alone (Cochran's Q); one for a single log


def spread(
    estimates: NDArray[np.float64],
    covariances: NDArray[np.float64],
    sizes: NDArray[np.float64],
    *,
    degrees: float,
) -> LogSpread:
    """Return how a robot's parameters vary between its logs.

    There is an estimate (k, p) of each log, k of 1 or more, with the covariances (k, p, p) within each. The sizes (p,)
    are roots of the diagonal of D, and the degrees are nu.
    """
    unit = np.where(sizes > 0.0, sizes, 1.0)  # in units of D's sizes all matrices are well scaled
    y, C = estimates / unit, covariances / np.outer(unit, unit)
    D = np.diag((sizes > 0.0).astype(float))
    (alike, differing, _), (V_at, _, likelihood) = _given(np.zeros(1), y, C, D), _given(_TAU, y, C, D)
    weights = _prior(degrees) + likelihood
    weights = np.exp(weights - np.asarray(logsumexp(weights)))
    V = np.einsum("g,gij->ij", weights, V_at)
    back = np.outer(unit, unit)
    apart = (len(y) - 1) * y.shape[1]
    return LogSpread(
        factor=float(np.sqrt(weights @ _TAU**2)),
        covariance=V * back,
        added=(V - alike[0]) * back,
        p_value=float(chdtrc(apart, differing[0])) if apart else 1.0,
    )


def log_evidence(
    y: NDArray[np.float64], C: NDArray[np.float64], D: NDArray[np.float64], *, degrees: float
) -> float:
    """Return the logarithm of the likelihood of a robot's logs, estimates (k, p) with (k, p, p), up to a constant."""
    return float(np.asarray(logsumexp(_prior(degrees) + _given(_TAU, y, C, D)[2])))


def _prior(degrees: float) -> NDArray[np.float64]:
    """Return the logarithm of the prior's weight of each tau."""
    density = -degrees * np.log(_TAU) - 0.5 * degrees / _TAU**2
    return density - np.asarray(logsumexp(density))


def _given(
    tau: NDArray[np.float64], y: NDArray[np.float64], C: NDArray[np.float64], D: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return V (g, p, p), the sum of (y_k - m)^T W_k (y_k - m) and the log likelihood (g,) at each value of tau."""
    # fewer windows than parameters leave a C_k without full rank: a small ridge keeps it invertible
    ridge = _RIDGE * np.eye(y.shape[1]) * np.diagonal(C, axis1=1, axis2=2)[:, None]
    total = C + ridge + tau[:, None, None, None] ** 2 * D
    W = np.linalg.inv(total)
    V = np.linalg.inv(W.sum(axis=1))
    m = np.einsum("gij,gkjl,kl->gi", V, W, y)
    apart = y - m[:, None]
    squares = np.einsum("gki,gkij,gkj->g", apart, W, apart)
    determinants = np.linalg.slogdet(V)[1] - np.linalg.slogdet(total)[1].sum(axis=1)
    return V, squares, 0.5 * (determinants - squares)


@dataclass(frozen=True, kw_only=True, eq=False)
class LogEstimates:
    """The estimates of each of k logs, scaled, and their covariances within that log."""

    points: NDArray[np.float64]  #: (k, p)
    covariances: NDArray[np.float64]  #: (k, p, p); NaN for parameters without a standard error


def log_estimates(
    within: Uncertainty, equations: WindowEquations, block_log: NDArray[np.int64], *, widen: float
) -> LogEstimates:
    """Return what each log by itself leads to, to first order about the estimate from all of them.

    One log leads to the estimate itself, with its errors. A parameter at a bound stays there in every log. `within` is
    of the estimate from all logs, and `equations` are there; `block_log` (w,) is the log of each window; errors within
    a log are multiplied by `widen`, as those of `within` are.
    """
    estimated = np.isfinite(within.scaled_errors)
    logs, places = np.unique(block_log), np.flatnonzero(estimated)
    points = np.tile(within.point, (len(logs), 1))
    covariances = np.tile(within.covariance, (len(logs), 1, 1))
    if len(logs) > 1 and len(places):
        common, _ = _step(equations, places)
        own, inverses = equations.scores.copy(), []
        for k, log in enumerate(logs):
            rows = block_log == log
            mine = WindowEquations(matrices=equations.matrices[rows], scores=equations.scores[rows])
            step, inverse = _step(mine, places)
            points[k, places] += step - common
            # about the log's own estimate, or what it differs from the others by would count as noise within it
            own[rows] += np.einsum("wij,j->wi", mine.matrices[:, :, places], step, optimize=False)
            inverses.append(inverse)
        scores = leverage_corrected(replace(equations, scores=own), estimated).scores[:, places]
        of_window = widen**2 * np.einsum("wi,wj->ij", scores, scores, optimize=False) / (len(scores) - 1)
        for k, (log, inverse) in enumerate(zip(logs, inverses, strict=True)):
            covariances[k][np.ix_(places, places)] = (
                inverse @ ((block_log == log).sum() * of_window) @ inverse
            )
    return LogEstimates(points=points, covariances=covariances)


def _step(
    equations: WindowEquations, places: NDArray[np.intp]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the Gauss-Newton step of the parameters at `places`, and the inverse of its matrix."""
    H = equations.matrices[:, places[:, None], places].sum(axis=0)
    scale = 1.0 / np.sqrt(np.maximum(H.diagonal(), np.finfo(float).tiny))
    # a log may lack every window that determines a parameter: a small ridge keeps its equations soluble
    inverse = np.linalg.inv(H * np.outer(scale, scale) + 1e-12 * np.eye(len(places))) * np.outer(scale, scale)
    return -inverse @ equations.scores[:, places].sum(axis=0), inverse
