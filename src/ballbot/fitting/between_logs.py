"""The variation of an estimate between logs of one robot: random effects with a prior.

Log k gives estimates y_k of p parameters, with the covariance C_k from its own residuals, and

    y_k = theta + a_k + e_k        a_k ~ N(0, tau^2 D),  e_k ~ N(0, C_k)

where a_k is the effect of what changes from log to log and the model lacks: the path driven, the contacts of the
rollers, the floor, the drift of a sensor. D is diagonal, and small beside C_k in the directions in which parameters
compensate for each other: each of these keeps its large error, and their combined effect gets one of the size of D. A
few logs determine tau poorly, and one log not at all. Other robots, with two logs each, give D, and a prior of tau:
tau^2 is scaled inverse chi-squared with nu degrees and scale 1 (`campaigns.between_logs`). With

    W_k = (C_k + tau^2 D)^-1,   V = (sum W_k)^-1,   m = V sum W_k y_k

and a flat prior of theta, the posterior of tau is

    p(tau | y) ~ p(tau) sqrt(|V|) prod_k sqrt(|W_k|) exp(-(y_k - m)^T W_k (y_k - m) / 2)

(A. Gelman et al., Bayesian Data Analysis, 3rd edition 2013, section 5.4). The covariance of theta is the mean of V over
it. With one log, p(tau | y) is the prior and the covariance is C_1 + E(tau^2) D.

If all C_k are zero this is conjugate: tau^2 has nu + (K - 1) p degrees. The tests check that, and the coverage over
robots drawn from the prior, which is exact.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, logsumexp

from ballbot.arrays import Floats, Ints
from ballbot.fitting.intervals import Uncertainty
from ballbot.fitting.uncertainty import WindowEquations, leverage_corrected

#: grid of tau, logarithmic
_TAU = np.geomspace(0.05, 50.0, 121)
#: ridge, as a share of a covariance's diagonal
_RIDGE = 1e-10


@dataclass(frozen=True, kw_only=True, eq=False)
class LogSpread:
    """Posterior of tau and theta from the logs of one robot."""

    factor: float  #: root of the mean of tau^2
    covariance: Floats  #: of theta (p, p)
    #: of theta, less the covariance without variation between logs (p, p)
    added: Floats
    p_value: float  #: of differences as large by chance alone (Cochran's Q); 1 for a single log


def spread(estimates: Floats, covariances: Floats, sizes: Floats, *, degrees: float) -> LogSpread:
    """Return the variation of a robot's parameters between its k logs, one or more.

    `estimates` (k, p) have the covariances (k, p, p) within each log. `sizes` (p,) are the square roots of the diagonal
    of D, and `degrees` is nu.
    """
    unit = np.where(sizes > 0.0, sizes, 1.0)  # in these units all matrices are well scaled
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


def log_evidence(y: Floats, C: Floats, D: Floats, *, degrees: float) -> float:
    """Return the log-likelihood of a robot's logs, up to a constant; y is (k, p) and C (k, p, p)."""
    return float(np.asarray(logsumexp(_prior(degrees) + _given(_TAU, y, C, D)[2])))


def _prior(degrees: float) -> Floats:
    """Return the logarithm of the prior probability of each tau on the grid."""
    density = -degrees * np.log(_TAU) - 0.5 * degrees / _TAU**2
    return density - np.asarray(logsumexp(density))


def _given(tau: Floats, y: Floats, C: Floats, D: Floats) -> tuple[Floats, Floats, Floats]:
    """Return V (g, p, p), the sum of (y_k - m)^T W_k (y_k - m) and the log likelihood (g,) at each value of tau."""
    # with fewer windows than parameters C_k is singular; the ridge makes it invertible
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
    """The estimate from each of k logs by itself, scaled, with its covariance within that log."""

    points: Floats  #: (k, p)
    covariances: Floats  #: (k, p, p); NaN for parameters without a standard error


def log_estimates(
    within: Uncertainty, equations: WindowEquations, block_log: Ints, *, widen: float
) -> LogEstimates:
    """Return the estimate from each log by itself, to first order about the estimate from all logs.

    With one log, that is the estimate itself. A parameter at a bound stays there in every log. `within` is the
    uncertainty of the estimate from all logs, and `equations` are the equations there; `block_log` (w,) has the log of
    each window; errors within a log are multiplied by `widen`, as those of `within` are.
    """
    estimated = np.isfinite(within.scaled_errors)
    logs, columns = np.unique(block_log), np.flatnonzero(estimated)
    points = np.tile(within.point, (len(logs), 1))
    covariances = np.tile(within.covariance, (len(logs), 1, 1))
    if len(logs) > 1 and len(columns):
        common, _ = _step(equations, columns)
        own, inverses = equations.scores.copy(), []
        for k, log in enumerate(logs):
            rows = block_log == log
            mine = WindowEquations(equations.matrices[rows], equations.scores[rows])
            step, inverse = _step(mine, columns)
            points[k, columns] += step - common
            # about the log's own estimate; otherwise its difference from the others counts as noise within it
            own[rows] += np.einsum("wij,j->wi", mine.matrices[:, :, columns], step, optimize=False)
            inverses.append(inverse)
        scores = leverage_corrected(replace(equations, scores=own), estimated).scores[:, columns]
        of_window = widen**2 * np.einsum("wi,wj->ij", scores, scores, optimize=False) / (len(scores) - 1)
        for k, (log, inverse) in enumerate(zip(logs, inverses, strict=True)):
            within_log = inverse @ ((block_log == log).sum() * of_window) @ inverse
            covariances[k][np.ix_(columns, columns)] = within_log
    return LogEstimates(points=points, covariances=covariances)


def _step(equations: WindowEquations, columns: NDArray[np.intp]) -> tuple[Floats, Floats]:
    """Return the Gauss-Newton step of the parameters at `columns`, and the inverse of its matrix."""
    H = equations.matrices[:, columns[:, None], columns].sum(axis=0)
    scale = 1.0 / np.sqrt(np.maximum(H.diagonal(), np.finfo(float).tiny))
    # a log may have no window that determines a parameter; the ridge makes its equations soluble
    scales = np.outer(scale, scale)
    inverse = np.linalg.inv(H * scales + 1e-12 * np.eye(len(columns))) * scales
    return -inverse @ equations.scores[:, columns].sum(axis=0), inverse
