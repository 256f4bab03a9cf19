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
from ballbot.validation.forecast import ModelPair, forecast
from ballbot.validation.windows import rows_after, window_starts

#: how far ahead [s]
HORIZONS = (0.005, 0.01, 0.02, 0.035, 0.05, 0.075, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5)

#: starts are this far apart [s]: enough of them, and not so near that they repeat each other
_SPACING = 0.1


@dataclass(frozen=True, kw_only=True, eq=False)
class HorizonErrors:
    """Root mean square errors at each horizon, over all starts."""

    horizons: NDArray[np.float64]  #: (h,) [s], whole samples
    with_friction: NDArray[np.float64]  #: (h, 10)
    without_friction: NDArray[np.float64]  #: (h, 10)
    noise_floor: NDArray[np.float64]  #: (h, 10) what the noise of start and measurement alone would cause
    starts: int

    @property
    def ratio(self) -> NDArray[np.float64]:
        """Error without friction over the one with it (h, 10)."""
        return self.without_friction / self.with_friction


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
    noisy = forecast([models.with_friction], log, starts, samples, initial=log.states[starts] + noise[0])[0]
    floor = noisy + noise[1][:, None] - states[0]
    return HorizonErrors(
        horizons=ahead * step,
        with_friction=_root_mean_square(states[0] - measured)[ahead - 1],
        without_friction=_root_mean_square(states[1] - measured)[ahead - 1],
        noise_floor=_root_mean_square(floor)[ahead - 1],
        starts=len(starts),
    )


def join_horizons(parts: Sequence[HorizonErrors]) -> HorizonErrors:
    """Return the errors over the starts of all `parts` of the first one's horizons."""
    alike = [part for part in parts if np.array_equal(part.horizons, parts[0].horizons)]
    weights = [part.starts for part in alike]

    def together(errors: list[NDArray[np.float64]]) -> NDArray[np.float64]:
        return np.sqrt(np.average(np.square(errors), axis=0, weights=weights))

    return HorizonErrors(
        horizons=parts[0].horizons,
        with_friction=together([part.with_friction for part in alike]),
        without_friction=together([part.without_friction for part in alike]),
        noise_floor=together([part.noise_floor for part in alike]),
        starts=sum(weights),
    )


def _root_mean_square(difference: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the root mean square (samples, 10) over the starts of `difference` (starts, samples, 10)."""
    return np.sqrt(np.mean(np.square(difference), axis=0))
