"""Prediction errors against the horizon, from one sample to half a second, beside the error by noise alone.

The error after one step is dominated by the sensors' noise and says little about the model
(`ballbot.validation.residuals`); the error after half a second is dominated by the model.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from ballbot.arrays import Floats
from ballbot.fitting.comparison import FINEST, LEAST_RUNS, ratio_interval, verdicts
from ballbot.log import STATE_NAMES
from ballbot.validation.models import (
    RUNS,
    Case,
    Comparison,
    by_model,
    by_state,
    forecast,
    least_of,
    rows_after,
    window_starts,
)

#: horizons [s]
HORIZONS = (0.005, 0.01, 0.02, 0.035, 0.05, 0.075, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5)

#: interval between starts [s]: many starts, but with little overlap of their forecasts
_SPACING = 0.1
#: draws of the noise of each start, of which each of `RUNS` logs has one
_DRAWS = 20
#: rank of the 95 % quantile of `RUNS` values
_MOST = 190


@dataclass(frozen=True, kw_only=True, eq=False)
class Horizons(Comparison):
    """Errors of both models at each horizon, from every start in the order of time, with the scales for comparison."""

    horizons: Floats  #: (h,) [s], whole samples
    differences: Floats  #: (2, starts, h, 10), predicted less measured
    overlap: int  #: how many neighbouring forecasts share part of the log
    #: (`RUNS`, h, 10), mean square errors that the noise of start and measurement alone would cause, of so many logs
    own: Floats
    spread: Floats  #: (10,), standard deviation of the measured states

    @property
    def starts(self) -> int:
        """How many forecasts each model made."""
        return self.differences.shape[1]

    @property
    def rmse(self) -> Floats:
        """Root mean square errors (2, h, 10)."""
        return np.sqrt((self.differences**2).mean(axis=1))

    @property
    def ratio(self) -> Floats:
        """RMSE of the second model over that of the first (h, 10); above 1, the first is better."""
        first, second = np.sqrt(self._squares().mean(axis=1))
        return second / first

    @cached_property
    def ratio_interval(self) -> Floats:
        """The 95 % intervals (2, h, 10) of `ratio`, by a block bootstrap of the starts; NaN with too few."""
        shape = self.differences.shape[2:]
        if self.starts < LEAST_RUNS * self.overlap:
            return np.full((2, *shape), np.nan)
        first, second = self._squares().reshape(2, self.starts, -1)
        return ratio_interval(second, first, overlap=self.overlap, power=0.5).reshape(2, *shape)

    @property
    def noise_floor(self) -> Floats:
        """RMSE (h, 10) that the noise of start and measurement alone would cause."""
        return np.sqrt(self.own.mean(axis=0))

    @property
    def adequate_up_to(self) -> float:
        """The horizon [s] up to which the errors may be those of the first model's own logs; 0 if at none.

        At each horizon the states are counted whose error is at most the 95 % quantile of `own`, and the count is
        ranked among those of `own`, each left out in turn. The horizon ends where the least rank so far is below the
        5 % quantile of theirs.
        """
        ordered = np.sort(self.own, axis=0)
        inside = (self.rmse[0] ** 2 <= ordered[_MOST - 1]).sum(axis=-1)
        of_own = (self.own <= ordered[_MOST - 2]).sum(axis=-1)
        ranks = np.array([(of_own <= counts).sum(axis=0) for counts in (inside, *of_own)])
        least, *others = np.minimum.accumulate(ranks, axis=1)
        rejected = least < [least_of(of_horizon) for of_horizon in np.transpose(others)]
        return float(np.append(0.0, self.horizons)[np.argmax(np.append(rejected, True))])

    def _squares(self) -> Floats:
        """Return the squared errors, each at least `FINEST` squared."""
        return np.maximum(self.differences**2, FINEST**2)

    def verdict(self) -> str:
        first, intervals = self.models.first.name, self.ratio_interval
        if not np.isfinite(intervals).any():
            return f"{self.starts} forecasts are too few to show how the error grows with the horizon."
        better = [verdicts(interval).count("better") for interval in intervals.swapaxes(0, 1)]
        ahead, ratio = 1e3 * self.horizons, np.median(self.ratio, axis=1)
        most = np.flatnonzero(np.array(better) > len(STATE_NAMES) // 2)
        words = [
            f"{ahead[0]:.0f} ms ahead the model {first} is better in {better[0]} of the ten states (median ratio "
            f"{ratio[0]:.2f})"
        ]
        if most.size and 0 < most[0] < len(ahead) - 1:
            words.append(f"from {ahead[most[0]]:.0f} ms on in most")
        words.append(f"{ahead[-1]:.0f} ms ahead in {better[-1]} (median ratio {ratio[-1]:.1f})")
        return ", ".join(words) + "."

    def results(self) -> dict[str, object]:
        intervals = self.ratio_interval.swapaxes(0, 1)  # (horizons, 2, 10)
        # a constant state has no scale
        spread = np.where(self.spread > FINEST, self.spread, np.nan)
        return {
            "seconds": self.horizons,
            **by_model("rmse_", self.models, self.rmse),
            **by_model("normalised_rmse_", self.models, self.rmse / spread),
            "ratio": by_state(self.ratio),
            "ratio_interval": by_state(intervals),
            "verdict": [verdicts(interval) for interval in intervals],
            "noise_floor_rmse": by_state(self.noise_floor),
        }

    @classmethod
    def join(cls, parts: Sequence[Self]) -> Self:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Return the errors over the starts of all parts with the first part's horizons, and that part's spread."""
        alike = [part for part in parts if np.array_equal(part.horizons, parts[0].horizons)]
        # the noise of every log is drawn from the same seed
        own = [np.roll(part.own, k, axis=0) for k, part in enumerate(alike)]
        return replace(
            parts[0],
            differences=np.concatenate([part.differences for part in alike], axis=1),
            own=np.average(own, axis=0, weights=[part.starts for part in alike]),
        )


def compare_horizons(case: Case) -> Horizons:
    """Forecast from starts 0.1 s apart and compare at each horizon that fits the intervals without a gap."""
    models, log, parts = case.models, case.log, case.parts
    step = log.sample_time
    fitting = max(len(part) for part in parts) - 1
    ahead = np.unique(np.clip(np.round(np.array(HORIZONS) / step).astype(int), 1, fitting))
    samples = int(ahead[-1])
    starts = window_starts(parts, samples=samples, every=max(1, round(_SPACING / step)))
    states = forecast(models.both, log, starts, samples)
    measured = log.states[rows_after(starts, samples)]
    squares, each, model = [], np.arange(len(starts)), models.first.model
    for of_start, of_end in case.drawn_noise(_DRAWS, 2, len(starts)):
        shifted = forecast([model], log, starts, samples, initial=log.states[starts] + of_start)[0]
        squares.append((shifted + of_end[:, None] - states[0])[:, ahead - 1] ** 2)
    noise, random = np.array(squares), np.random.default_rng(case.seed)
    drawn = random.integers(_DRAWS, size=(RUNS, len(starts)))
    horizons = ahead * step
    return Horizons(
        models=models,
        horizons=horizons,
        differences=(states - measured)[:, :, ahead - 1],
        overlap=int(-(-horizons[-1] // _SPACING)),
        own=np.array([noise[draws, each].mean(axis=0) for draws in drawn]),
        spread=np.std(np.concatenate([log.states[part.start : part.stop] for part in parts]), axis=0),
    )
