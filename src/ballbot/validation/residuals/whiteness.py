"""Whether residuals are white: a portmanteau test of each state's, and how much their memory amounts to.

The test is Ljung and Box's (Biometrika 65 (1978) 297-303) on autocorrelations studentised as by I. Lobato, J. Nankervis
and N. Savin (Journal of Econometrics 100 (2001) 23-38), so that residuals which grow and shrink with the motion do not
look coloured:

    Q = n (n + 2) sum_(j=1..m) r_j^2 / (n - j),      r_j^2 = c_j^2 / mean(e_k^2 e_(k-j)^2)     chi^2 with m if white

A long log rejects whiteness for a memory that does not matter. So a share stands beside the test: of a residual's
variance, how much the m residuals before it foretell (Yule and Walker's equations). And a cause that is none of the
model's is told apart: the noise of a measured state enters two residuals, with opposite signs, which alone makes a
correlation of down to -1/2 from one sample to the next and none beyond.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, stats

from ballbot.validation.residuals.series import autocovariance, holm, lagged

#: how many lags are looked at
LAGS = 20
#: chance that any of a white log's states is called coloured
LEVEL = 0.05
#: fewer steps are too few for the test
LEAST_STEPS = 25 * LAGS
#: a share of the variance foretold below this is no more than a trifle
_TRIFLE = 0.02
#: noise of the start: so much at one sample, so little beyond
_OF_NOISE, _BEYOND = -0.2, 0.1

Colour = Literal["white", "nearly white", "noise of the start", "coloured"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Whiteness:
    """Of each column of residuals (k,)."""

    autocorrelation: NDArray[np.float64]  #: (LAGS + 1, k)
    statistic: NDArray[np.float64]  #: Q, about `LAGS` where white
    p_value: NDArray[np.float64]  #: of the column alone
    rejected: NDArray[np.bool_]  #: with Holm's correction over the columns
    foretold: NDArray[np.float64]  #: share of the variance that the residuals before foretell

    @property
    def colours(self) -> tuple[Colour, ...]:
        """What each column is."""
        return tuple(self._colour(place) for place in range(len(self.rejected)))

    def _colour(self, place: int) -> Colour:
        memory = self.autocorrelation[1:, place]
        if not self.rejected[place]:
            return "white"
        if self.foretold[place] < _TRIFLE:
            return "nearly white"
        if memory[0] < _OF_NOISE and np.abs(memory[1:]).max() < _BEYOND:
            return "noise of the start"
        return "coloured"


def whiteness(residuals: NDArray[np.float64], segments: Sequence[int]) -> Whiteness | None:
    """Test residuals (n, k) made of `segments`, or return None where there are fewer than `LEAST_STEPS`."""
    count = len(residuals)
    if count < LEAST_STEPS:
        return None
    covariance = autocovariance(residuals, segments, lags=LAGS)
    variance = np.where(covariance[0] > 0.0, covariance[0], 1.0)
    squares = (residuals - residuals.mean(axis=0)) ** 2
    statistic = np.zeros(residuals.shape[1])
    for lag in range(1, LAGS + 1):
        together = np.nanmean(squares * lagged(squares, segments, lag=lag), axis=0)
        scale = np.where(together > 0.0, together, 1.0)
        statistic += (count + 2.0) / (count - lag) * count * covariance[lag] ** 2 / scale
    p_value = stats.chi2.sf(statistic, LAGS)
    return Whiteness(
        autocorrelation=covariance / variance,
        statistic=statistic,
        p_value=p_value,
        rejected=holm(p_value, level=LEVEL),
        foretold=np.array([_foretold(column) for column in (covariance / variance).T]),
    )


def _foretold(memory: NDArray[np.float64]) -> float:
    """Return the share of a series' variance that as many past values as there are lags foretell."""
    if memory[0] <= 0.0:
        return 0.0
    past = linalg.solve_toeplitz((memory[:-1] + np.eye(len(memory) - 1)[0] * 1e-9), memory[1:])
    return float(np.clip(past @ memory[1:], 0.0, 1.0))
