"""Errors of two models: the thesis's (4.1), the RMSE, the normalised RMSE, and a 95 % interval on their ratio.

(4.1) divides the norm of the differences by their number n, not by its root:

    e = |x - x_hat| / n,      RMSE = |x - x_hat| / sqrt(n) = e sqrt(n)

so that e shrinks with the length of what is compared. Both are given; ratios of equally long runs are the same. The
normalised RMSE is over the standard deviation of what was measured: 1 is no better than a constant.

The interval is that of `ballbot.fitting.comparison`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.fitting.comparison import LEAST_RUNS, Verdict, ratio_interval, verdicts


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
    """The errors of two models over the same runs, in the order of time."""

    first: StateErrors
    second: StateErrors
    means: NDArray[np.float64]  #: (runs, 10) of what was measured
    squares: NDArray[np.float64]  #: (runs, 10) its mean squares
    overlap: int = 1  #: how many neighbouring runs share some of the log

    @staticmethod
    def of_runs(
        measured: Sequence[NDArray[np.float64]],
        first: Sequence[NDArray[np.float64]],
        second: Sequence[NDArray[np.float64]],
        *,
        overlap: int = 1,
    ) -> ErrorPair:
        """Return the errors of runs given as measured states and both models', each (n, 10) of its own length."""

        def errors(modelled: Sequence[NDArray[np.float64]]) -> StateErrors:
            return StateErrors.of_runs([x - x_hat for x, x_hat in zip(measured, modelled, strict=True)])

        return ErrorPair(
            first=errors(first),
            second=errors(second),
            means=np.array([run.mean(axis=0) for run in measured]),
            squares=np.array([np.mean(run**2, axis=0) for run in measured]),
            overlap=overlap,
        )

    @property
    def runs(self) -> int:
        """How many runs were compared."""
        return len(self.first.samples)

    @property
    def ratio(self) -> NDArray[np.float64]:
        """Error (4.1) of the second model over that of the first (10,): above one, the first is nearer."""
        return self.second.error / self.first.error

    @property
    def spread(self) -> NDArray[np.float64]:
        """Standard deviation (10,) of what was measured, over all samples of all runs."""
        weights = self.first.samples
        mean = np.average(self.means, axis=0, weights=weights)
        return np.sqrt(np.maximum(np.average(self.squares, axis=0, weights=weights) - mean**2, 0.0))

    @property
    def normalised_rmse(self) -> NDArray[np.float64]:
        """RMSE of the first and the second over `spread` (2, 10); NaN for a state that was constant."""
        spread = self.spread
        rmse = np.array([self.first.rmse, self.second.rmse])
        return np.where(spread > 0.0, rmse / np.where(spread > 0.0, spread, 1.0), np.nan)

    def ratio_interval(self, *, seed: int = 0) -> NDArray[np.float64]:
        """Return the lower and upper ends (2, 10) of the 95 % interval on `ratio`; NaN below `LEAST_RUNS` runs.

        Whole runs are drawn, in blocks of neighbours, and both models' errors of a run go together.
        """
        if self.runs < LEAST_RUNS:
            return np.full((2, self.first.by_run.shape[1]), np.nan)
        return ratio_interval(self.second.by_run, self.first.by_run, overlap=self.overlap, seed=seed)

    def verdicts(self) -> tuple[Verdict, ...]:
        """Return what the interval on each state's ratio says of the first model."""
        return verdicts(self.ratio_interval())


def join_pairs(pairs: Sequence[ErrorPair]) -> ErrorPair:
    """Return the errors over the runs of all `pairs`."""
    return ErrorPair(
        first=_join_errors([pair.first for pair in pairs]),
        second=_join_errors([pair.second for pair in pairs]),
        means=np.concatenate([pair.means for pair in pairs]),
        squares=np.concatenate([pair.squares for pair in pairs]),
        overlap=max(pair.overlap for pair in pairs),
    )


def _join_errors(errors: Sequence[StateErrors]) -> StateErrors:
    return StateErrors(
        by_run=np.concatenate([part.by_run for part in errors]),
        samples=np.concatenate([part.samples for part in errors]),
    )
