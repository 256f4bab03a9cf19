"""Errors of two models: the thesis's (4.1), the RMSE, the normalised RMSE, and a 95 % interval on their ratio.

(4.1) divides the norm of the differences by their number n, not by its root:

    e = |x - x_hat| / n,      RMSE = |x - x_hat| / sqrt(n) = e sqrt(n)

so that e shrinks with the length of what is compared. Both are given; ratios of equally long runs are the same. The
normalised RMSE is over the standard deviation of what was measured: 1 is no better than a constant.

The interval is a block bootstrap of the runs. Neighbouring runs share the same stretch of floor and the same swing of
the limit cycle, so blocks of neighbours are drawn (`ballbot.block_bootstrap`), both models' errors of a run together.
With r* the ratio of a draw,

    log r  +-  t  s*,     s* = std(log r*) sqrt(m / (m - 1)),     m = runs / block,   t Student's with m - 1

On log-normal errors of 10 to 100 independent runs this held the truth in 95 to 96 % of cases, and in 86 to 92 % where
neighbours correlated by 0.5; the percentiles of r* themselves in 86 to 93 % and 65 to 92 %
(tests/validation/test_errors.py checks a sample).

The blocks are as long as their mean wants (P. Hall, J. Horowitz and B.-Y. Jing, Biometrika 82 (1995) 561-574) for the
correlation rho of neighbours, taken as a first-order process: (1.5 (2 rho / (1 - rho^2))^2 runs)^(1/3), and at least
runs^(1/3) and twice the runs that overlap.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from ballbot.fitting.uncertainty import block_length, resampled_means

#: resamples; they give the standard error to 1 / sqrt(2 * 2000) = 1.6 %
_REPEATS = 2000
#: blocks are at most so long that this many fit
_LEAST_BLOCKS = 4


def ratio_interval(
    numerator: NDArray[np.float64],
    denominator: NDArray[np.float64],
    *,
    overlap: int = 1,
    seed: int = 0,
    power: float = 1.0,
) -> NDArray[np.float64]:
    """Return the ends (2, k) of the interval on (mean of numerator / mean of denominator)^power.

    Parameters
    ----------
    numerator, denominator : array (runs, k)
        Positive, in the order of time.
    overlap : int
        How many neighbouring runs share some of the log.
    seed : int
    power : float
        One half for ratios of root mean squares, given squares.
    """
    runs, trifle = len(numerator), np.finfo(float).tiny  # an error of exactly zero has no logarithm
    numerator, denominator = numerator + trifle, denominator + trifle
    above, below = numerator.mean(axis=0), denominator.mean(axis=0)
    block = _bootstrap_block(numerator / above - denominator / below, overlap)
    means = resampled_means(np.hstack([numerator, denominator]), block=block, repeats=_REPEATS, seed=seed)
    logs = np.log(means[:, : len(above)] / means[:, len(above) :])
    blocks = runs / block
    half = stats.t.ppf(0.975, blocks - 1.0) * np.sqrt(blocks / (blocks - 1.0)) * logs.std(axis=0, ddof=1)
    return np.exp(power * (np.log(above / below) + np.array([-half, half])))


def _bootstrap_block(influence: NDArray[np.float64], overlap: int) -> int:
    """Return the length of a block for columns (runs, k) of each run's pull on the ratio."""
    runs = len(influence)
    products = np.sum(influence[1:] * influence[:-1], axis=0)
    squares = np.sum(influence**2, axis=0)
    # the columns' median, which chance moves little, less its bias (M. Kendall, Biometrika 41 (1954) 403-404)
    seen = float(np.median(products / np.where(squares > 0.0, squares, 1.0)))
    rho = float(np.clip(seen + (1.0 + 3.0 * seen) / runs, 0.0, 0.9))
    wanted = (1.5 * (2.0 * rho / (1.0 - rho**2)) ** 2 * runs) ** (1.0 / 3.0)
    longest = max(1, runs // _LEAST_BLOCKS)
    return min(longest, max(block_length(runs), 2 * overlap if overlap > 1 else 1, round(wanted)))


#: drawing from fewer runs says nothing about their scatter
LEAST_RUNS = 8

#: of the first model against the second: only a whole interval of the ratio above or below one is a verdict
Verdict = Literal["better", "worse", "undecided"]


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


def verdicts(interval: NDArray[np.float64]) -> tuple[Verdict, ...]:
    """Return what intervals (2, k) on ratios say: better where wholly above one, worse where wholly below."""
    return tuple(
        "better" if lower > 1.0 else "worse" if upper < 1.0 else "undecided" for lower, upper in interval.T
    )


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
