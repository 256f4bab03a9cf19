"""Uncertainty of a least-squares estimate with dependent residuals: clustered covariance.

Clustered covariance. The residuals of a window are one trajectory and far from independent, so the usual
s^2 (J^T J)^-1 is several times too small. With a window's score g_w = J_w^T r_w the covariance is

    H^-1 (sum_w g_w g_w^T) H^-1 W / (W - 1)          H = sum_w J_w^T J_w

(K.-Y. Liang and S. L. Zeger, Longitudinal data analysis using generalized linear models, Biometrika 73 (1986) 13-22).
The fit follows each window, so residuals are smaller than errors. Each score is corrected for this leverage,
(I - H_w H^-1)^-1 g_w, which turns the above into the jackknife that leaves out one window after another (R. Bell and
D. McCaffrey, Bias reduction in standard errors for linear regression with multi-stage samples, Survey Methodology 28
(2002) 169-181).

Errors of held-out windows and runs are compared by resamples. Where neighbours depend on each other, blocks of them
are drawn (H. Kuensch, Annals of Statistics 17 (1989) 1217-1241), round the end (D. Politis and J. Romano 1992).
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ballbot.arrays import Bools, Floats, Ints

#: a parameter has no influence if its standard error, all others known, exceeds this share of its range
NO_INFLUENCE = 0.5


@dataclass(frozen=True, eq=False)
class WindowEquations:
    """Normal equations of the scaled parameters, window by window, their states eliminated; zero for held ones."""

    matrices: Floats  #: J^T J of each window (w, p, p)
    scores: Floats  #: J^T r of each window (w, p); their sum is the gradient

    @cached_property
    def matrix(self) -> Floats:
        """The sum of the matrices, H (p, p)."""
        return self.matrices.sum(axis=0)


def covariance(equations: WindowEquations, estimated: Bools) -> Floats:
    """Return the clustered covariance (p, p) in scaled coordinates; NaN for parameters not `estimated` (p,)."""
    columns = np.flatnonzero(estimated)
    result = np.full((len(estimated), len(estimated)), np.nan)
    if len(columns):
        H = equations.matrix[np.ix_(columns, columns)]
        scales = np.outer(1.0 / np.sqrt(H.diagonal()), 1.0 / np.sqrt(H.diagonal()))
        values, vectors = np.linalg.eigh(H * scales)
        # directions that the data do not determine are very uncertain
        inverse = (vectors / np.maximum(values, 1e-13 * values[-1])) @ vectors.T * scales
        scores = equations.scores[:, columns]
        spread = np.einsum("wi,wj->ij", scores, scores, optimize=False)
        count = len(scores)
        result[np.ix_(columns, columns)] = count / (count - 1) * inverse @ spread @ inverse
    return result


def leverage_corrected(equations: WindowEquations, estimated: Bools) -> WindowEquations:
    """Return the equations with the scores of errors instead of residuals, (I - H_w H^-1)^-1 g_w.

    The scores of parameters that are not `estimated` (p,) do not change.
    """
    columns = np.flatnonzero(estimated)
    matrix, scores = equations.matrix, equations.scores.copy()
    if len(columns):
        # scaled, so that the ridge does not depend on units
        scale = 1.0 / np.sqrt(np.maximum(matrix.diagonal()[columns], np.finfo(float).tiny))
        of_window = equations.matrices[:, columns[:, None], columns] * np.outer(scale, scale)
        total = matrix[np.ix_(columns, columns)] * np.outer(scale, scale)
        # (I - H_w H^-1)^-1 = H (H - H_w)^-1; the ridge is for a window that alone determines a parameter
        rest = total - of_window + 1e-12 * np.eye(len(columns))
        scaled = np.linalg.solve(rest, (scores[:, columns] * scale)[..., None])[..., 0]
        scores[:, columns] = np.einsum("ij,wj->wi", total, scaled, optimize=False) / scale
    return replace(equations, scores=scores)


def without_influence(equations: WindowEquations) -> Bools:
    """Return which parameters (p,) hardly influence the residuals, even with all others known."""
    H = equations.matrix.diagonal()
    spread = np.sqrt((equations.scores**2).sum(axis=0))
    # H = 1: over the parameter's whole range, one residual changes by its standard deviation
    return (H < 1.0) | (spread > NO_INFLUENCE * H)


def deviations(covariance: Floats) -> Floats:
    """Return standard errors (p,); NaN if a variance is not positive, as of a short, ill-posed fit."""
    variances = covariance.diagonal()
    return np.sqrt(np.where(variances > 0.0, variances, np.nan))


def correlation(covariance: Floats) -> Floats:
    """Return the correlation matrix (p, p) of a covariance, with NaN where it has NaN."""
    deviation = deviations(covariance)
    with np.errstate(divide="ignore", invalid="ignore"):
        result = covariance / np.outer(deviation, deviation)
    block = np.ix_(*2 * (np.flatnonzero(np.isfinite(deviation)),))
    known = result[block]
    if (np.abs(known) > 1.0 + 1e-9).any():
        # errors of a thousand times the bounds' width: rounding leaves a covariance with negative eigenvalues
        values, vectors = np.linalg.eigh(known)
        known = (vectors * np.maximum(values, 0.0)) @ vectors.T
        length = np.sqrt(known.diagonal())
        known = np.clip(known / np.outer(length, length), -1.0, 1.0)
        np.fill_diagonal(known, 1.0)
        result[block] = known
    return result


def block_length(count: int) -> int:
    """Return the number of neighbours in a block: the cube root of `count`, which is optimal for a variance.

    P. Hall, J. Horowitz and B.-Y. Jing, Biometrika 82 (1995) 561-574.
    """
    return max(1, round(count ** (1.0 / 3.0)))


def resamples(count: int, *, repeats: int, seed: int) -> Floats:
    """Return how often each of `count` values is drawn in each of the repeats, (repeats, count)."""
    drawn = np.zeros((repeats, count))
    rows = np.random.default_rng(seed).integers(count, size=(repeats, count))
    np.add.at(drawn, (np.arange(repeats)[:, None], rows), 1.0)
    return drawn


def resampled_means(values: Floats, *, block: int, repeats: int, seed: int) -> Floats:
    """Return the column means (repeats, k) of rows drawn anew from `values` (n, k), whole blocks at a time."""
    ends = np.cumsum(np.vstack([np.zeros_like(values[:1]), values, values[: block - 1]]), axis=0)
    sums, count = ends[block:] - ends[:-block], len(values)
    starts = np.random.default_rng(seed).integers(count, size=(repeats, -(-count // block)))
    return np.array([sums[drawn].sum(axis=0) for drawn in starts]) / (starts.shape[1] * block)


#: shuffles of the windows; the smallest p-value is 1 / (1 + SHUFFLES)
SHUFFLES = 999


@dataclass(frozen=True, kw_only=True)
class Discrepancy:
    """Whether groups of windows disagree on the parameters."""

    ratio: float  #: of the groups' squared scores to those by chance
    p_value: float

    @property
    def significant(self) -> bool:
        """Whether chance alone gives such a ratio in less than 1 % of cases."""
        return self.p_value < 0.01

    @property
    def factor(self) -> float:
        """The factor on standard errors (R. Birge 1932); 1 if chance explains the difference between groups."""
        return float(np.sqrt(self.ratio)) if self.significant else 1.0


def discrepancy(equations: WindowEquations, groups: Ints, estimated: Bools, *, seed: int) -> Discrepancy:
    """Test whether all groups (w,) of windows, from 0, agree on the parameters `estimated` (p,), by their scores.

    At the estimate the scores of all windows sum to zero. If the model is right, so do those of any group within
    chance. With scores whitened by their own covariance the statistic is the sum over groups of |sum of scores|^2 /
    windows, and chance is the same groups with the windows shuffled.
    """
    scores = equations.scores[:, estimated]
    count, size = scores.shape
    if size == 0 or count <= size or groups.max(initial=0) == 0:
        return Discrepancy(ratio=1.0, p_value=1.0)
    values, vectors = np.linalg.eigh(scores.T @ scores / count)
    white = scores @ vectors / np.sqrt(np.maximum(values, 1e-12 * values[-1]))
    of_group = (groups[None] == np.arange(groups.max() + 1)[:, None]).astype(np.float64)
    of_group /= np.sqrt(np.maximum(of_group.sum(axis=1, keepdims=True), 1.0))
    random = np.random.default_rng(seed)
    orders = [np.arange(count), *(random.permutation(count) for _ in range(SHUFFLES))]
    statistics = np.array([((of_group @ white[order]) ** 2).sum() for order in orders])
    return Discrepancy(
        ratio=float(statistics[0] / statistics[1:].mean()),
        p_value=float((1 + (statistics[1:] >= statistics[0]).sum()) / (1 + SHUFFLES)),
    )
