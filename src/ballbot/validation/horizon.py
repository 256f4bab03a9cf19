"""The forecast's error against how far ahead it looks, from one sample to half a second.

One step alone is bound by the noise of the sensors and says little about the model; half a second is governed by the
model. The curve between them tells which of the two an error comes from.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.log import Log
from ballbot.validation.contenders import ModelPair
from ballbot.validation.forecast import forecast
from ballbot.validation.ratio_interval import ratio_interval
from ballbot.validation.state_errors import LEAST_RUNS
from ballbot.validation.windows import rows_after, window_starts

#: how far ahead [s]
HORIZONS = (0.005, 0.01, 0.02, 0.035, 0.05, 0.075, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5)

#: starts are this far apart [s]: enough of them, and not so near that they repeat each other
_SPACING = 0.1


@dataclass(frozen=True, kw_only=True, eq=False)
class HorizonErrors:
    """Errors of both models at each horizon, from every start in the order of time."""

    horizons: NDArray[np.float64]  #: (h,) [s], whole samples
    first_squares: NDArray[np.float64]  #: (starts, h, 10) of the first model
    second_squares: NDArray[np.float64]  #: (starts, h, 10) of the second
    noise_floor: NDArray[
        np.float64
    ]  #: (h, 10) RMSE that the noise of start and measurement alone would cause
    spread: NDArray[np.float64]  #: (10,) standard deviation of what was measured

    @property
    def starts(self) -> int:
        """How many forecasts were compared."""
        return len(self.first_squares)

    @property
    def first(self) -> NDArray[np.float64]:
        """RMSE of the first model (h, 10)."""
        return np.sqrt(self.first_squares.mean(axis=0))

    @property
    def second(self) -> NDArray[np.float64]:
        """RMSE of the second model (h, 10)."""
        return np.sqrt(self.second_squares.mean(axis=0))

    @property
    def ratio(self) -> NDArray[np.float64]:
        """RMSE of the second model over that of the first (h, 10): above one, the first is nearer."""
        return self.second / self.first

    def ratio_interval(self, *, seed: int = 0) -> NDArray[np.float64]:
        """Return the lower and upper ends (2, h, 10) of 95 % intervals on `ratio`, by a bootstrap of blocks of starts.

        NaN where there are too few starts.
        """
        shape = self.first_squares.shape[1:]
        overlap = -(-self.horizons[-1] // _SPACING)
        if self.starts < LEAST_RUNS * overlap:
            return np.full((2, *shape), np.nan)
        second, first = (
            squares.reshape(self.starts, -1) for squares in (self.second_squares, self.first_squares)
        )
        ends = ratio_interval(second, first, overlap=int(overlap), seed=seed, power=0.5)
        return ends.reshape(2, *shape)


def horizon_errors(
    models: ModelPair,
    log: Log,
    parts: Sequence[range],
    *,
    start_covariance: NDArray[np.float64],
    seed: int = 0,
) -> HorizonErrors:
    """Forecast from starts 0.1 s apart and compare at each horizon that fits the log's stretches.

    Parameters
    ----------
    models : ModelPair
    log : Log
    parts : sequence of range
        Rows that count.
    start_covariance : array (10, 10)
        Covariance of a measured state's noise.
    seed : int
        Of the noise drawn for the noise floor.
    """
    step = log.sample_time
    fitting = max(len(part) for part in parts) - 1
    ahead = np.unique(np.clip(np.round(np.array(HORIZONS) / step).astype(int), 1, fitting))
    samples = int(ahead[-1])
    starts = window_starts(parts, samples=samples, every=max(1, round(_SPACING / step)))
    states = forecast(models.both, log, starts, samples)
    measured = log.states[rows_after(starts, samples)]

    random = np.random.default_rng(seed)
    noise = random.multivariate_normal(np.zeros(10), start_covariance, size=(2, len(starts)), method="eigh")
    noisy = forecast([models.first.model], log, starts, samples, initial=log.states[starts] + noise[0])[0]
    floor = (noisy + noise[1][:, None] - states[0])[:, ahead - 1]
    first, second = np.square(states - measured)[:, :, ahead - 1]
    return HorizonErrors(
        horizons=ahead * step,
        first_squares=first,
        second_squares=second,
        noise_floor=np.sqrt(np.mean(floor**2, axis=0)),
        spread=np.std(np.concatenate([log.states[part.start : part.stop] for part in parts]), axis=0),
    )


def join_horizons(parts: Sequence[HorizonErrors]) -> HorizonErrors:
    """Return the errors over the starts of all `parts` of the first one's horizons; the spread is that one's."""
    alike = [part for part in parts if np.array_equal(part.horizons, parts[0].horizons)]
    weights = [part.starts for part in alike]
    floors = np.array([part.noise_floor for part in alike])
    return HorizonErrors(
        horizons=parts[0].horizons,
        first_squares=np.concatenate([part.first_squares for part in alike]),
        second_squares=np.concatenate([part.second_squares for part in alike]),
        noise_floor=np.sqrt(np.average(floors**2, axis=0, weights=weights)),
        spread=parts[0].spread,
    )
