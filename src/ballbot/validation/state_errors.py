"""How far a model's states are from the measured ones: the thesis's (4.1) and the RMSE, with and without friction.

(4.1) divides the norm of the differences by their number n, not by its root:

    e = |x - x_hat| / n,      RMSE = |x - x_hat| / sqrt(n) = e sqrt(n)

so that e shrinks with the length of what is compared. Both are given; ratios of equally long runs are the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

#: resamplings behind an interval; 2000 settle the ends of a 95 % interval to about 2 % of its width
_RESAMPLINGS = 2000
#: drawing from fewer runs says nothing about their scatter
LEAST_RUNS = 5


def thesis_error(difference: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return e of (4.1) for each column of `difference` (n, states) = measured - modelled."""
    return np.linalg.norm(difference, axis=0) / len(difference)


@dataclass(frozen=True, kw_only=True, eq=False)
class StateErrors:
    """One model's errors over several runs beside the measurement, state by state in the log's order and units."""

    by_run: NDArray[np.float64]  #: (runs, 10) e of (4.1) for each run
    samples: NDArray[np.int64]  #: (runs,) n, the samples of each run

    @property
    def error(self) -> NDArray[np.float64]:
        """The mean of (4.1) over the runs (10,)."""
        return self.by_run.mean(axis=0)

    @property
    def rmse(self) -> NDArray[np.float64]:
        """The root mean square of the error over all samples of all runs (10,)."""
        # a run's sum of squares is (e n)^2
        squares = (self.by_run * self.samples[:, None]) ** 2
        return np.sqrt(squares.sum(axis=0) / self.samples.sum())

    @staticmethod
    def of_runs(differences: Sequence[NDArray[np.float64]]) -> StateErrors:
        """Return the errors of runs given as measured minus modelled states, each (n, 10) of its own length."""
        return StateErrors(
            by_run=np.array([thesis_error(difference) for difference in differences]),
            samples=np.array([len(difference) for difference in differences]),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class ErrorPair:
    """The errors of two models over the same runs: one with friction and one without."""

    with_friction: StateErrors
    without_friction: StateErrors

    @property
    def runs(self) -> int:
        """How many runs were compared."""
        return len(self.with_friction.samples)

    @property
    def ratio(self) -> NDArray[np.float64]:
        """Error (4.1) without friction over the one with it (10,): above one, friction helps."""
        return self.without_friction.error / self.with_friction.error

    def ratio_interval(self, *, confidence: float = 0.95, seed: int = 0) -> NDArray[np.float64]:
        """Return the lower and upper ends (2, 10) of a bootstrap interval on `ratio`.

        Whole runs are drawn with replacement, and both models' errors of a run go together (B. Efron and
        R. Tibshirani, An Introduction to the Bootstrap, 1993, section 13.3). With fewer than `LEAST_RUNS` it is NaN.
        """
        if self.runs < LEAST_RUNS:
            return np.full((2, self.with_friction.by_run.shape[1]), np.nan)
        random = np.random.default_rng(seed)
        drawn = random.integers(self.runs, size=(_RESAMPLINGS, self.runs))
        ratios = self.without_friction.by_run[drawn].mean(axis=1) / self.with_friction.by_run[drawn].mean(
            axis=1
        )
        tail = (1.0 - confidence) / 2.0
        return np.quantile(ratios, [tail, 1.0 - tail], axis=0)


def join_pairs(pairs: Sequence[ErrorPair]) -> ErrorPair:
    """Return the errors over the runs of all `pairs`."""
    return ErrorPair(
        with_friction=_join([pair.with_friction for pair in pairs]),
        without_friction=_join([pair.without_friction for pair in pairs]),
    )


def _join(errors: Sequence[StateErrors]) -> StateErrors:
    return StateErrors(
        by_run=np.concatenate([part.by_run for part in errors]),
        samples=np.concatenate([part.samples for part in errors]),
    )
