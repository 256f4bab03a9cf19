"""Linear least squares with errors that depend on each other in time.

Within a block of time, errors may depend on each other in any way: the covariance V is clustered by block, as in
`ballbot.fitting.uncertainty`. For q parameters, W = p^T V^-1 p is tested as Hotelling's T^2 of G blocks,
W (G - q) / (q (G - 1)) ~ F(q, G - q), with G the number of blocks in which the least frequent of the q columns is not
zero: a rare event is known from few blocks.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from ballbot.arrays import Floats, Ints

#: least degrees of freedom (blocks less parameters) of a test
_LEAST_FREEDOM = 5


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearFit:
    """Parameters (p,) of a linear model."""

    values: Floats
    covariance: Floats  #: (p, p)
    residuals: Floats  #: (n,), measured less fitted
    blocks: Ints  #: (p,), number of blocks in which each parameter's column is not zero

    @property
    def errors(self) -> Floats:
        """Standard errors (p,)."""
        return np.sqrt(np.maximum(self.covariance.diagonal(), 0.0))

    @property
    def half_widths(self) -> Floats:
        """Half widths of the 95 % intervals (p,)."""
        return special.stdtrit(np.maximum(self.blocks - 1, 1), 0.975) * self.errors

    def p_value(self, columns: Sequence[int]) -> float:
        """Return the p-value of all parameters at `columns` being zero; NaN with too few blocks."""
        blocks = int(self.blocks[list(columns)].min())
        count, freedom = len(columns), blocks - len(columns)
        if freedom < _LEAST_FREEDOM:
            return float("nan")
        part, covariance = self.values[list(columns)], self.covariance[np.ix_(columns, columns)]
        wald = float(part @ np.linalg.pinv(covariance, hermitian=True) @ part)
        return float(special.fdtrc(count, freedom, wald * freedom / (count * (blocks - 1))))


def fit_linear(design: Floats, values: Floats, blocks: Ints) -> LinearFit:
    """Fit values (n,) by the columns of `design` (n, p), with errors clustered by `blocks` (n,)."""
    solution = np.asarray(np.linalg.lstsq(design, values, rcond=None)[0], dtype=np.float64)
    _, block = np.unique(blocks, return_inverse=True)
    count, residuals = int(block.max()) + 1, values - design @ solution
    # columns of length one, as mass, viscosity and stiffness differ by orders of magnitude
    lengths = np.linalg.norm(design, axis=0)
    lengths = np.where(lengths > 0.0, lengths, 1.0)
    scaled = design / lengths
    inverse = np.linalg.pinv(scaled.T @ scaled, hermitian=True) / np.outer(lengths, lengths)
    scores = np.column_stack([np.bincount(block, column) for column in (design * residuals[:, None]).T])
    present = [np.bincount(block, column != 0.0) for column in design.T]
    return LinearFit(
        values=solution,
        covariance=count / max(count - 1, 1) * inverse @ (scores.T @ scores) @ inverse,
        residuals=residuals,
        blocks=np.count_nonzero(present, axis=1),
    )
