"""The resolution of a log: errors no larger than what rounding its numbers causes are evidence for no model.

A column of decimals or of an encoder's counts lies on a grid of some step; a column of full precision is rounded far
below what any sensor of a robot resolves, and counts as resolved to `FINEST`. What that rounding causes in a forecast
is found by rounding the log once more, at random: the forecasts from both logs differ by it, however far ahead they
look and however fast the robot falls. An error below this floor counts as the floor before any ratio is formed.

A model that predicts all ten states to this floor at every horizon simulated the log itself, because no robot follows
its model so far. Such a log shows nothing about the other model either, and neither does a log that does not move.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ballbot.fitting.comparison import HorizonErrors
from ballbot.log import STATE_NAMES, Log
from ballbot.log.columns import torque_names
from ballbot.validation.models import ModelPair, forecast, rows_after

#: columns count as resolved to no better than this, in m, rad, N m and their rates, or as part of the largest value:
#: a thousandth of what the finest sensors of a robot resolve, and a million times the rounding of a double, so that
#: neither a sensor nor another order of the same sums falls on the wrong side
FINEST = 1e-9
#: a column has a grid if it has so many values, and all are whole steps apart within this part of one
_LEAST_VALUES, _OFF_GRID = 8, 0.01
#: a model is at the floor within this factor: rounding alone stays within 1.5 of it on as few starts as are compared
_AT_FLOOR = 2.0


def column_resolution(values: NDArray[np.float64]) -> float:
    """Return the step of the grid on which a column's values lie, at least `FINEST`."""
    different = np.unique(values[np.isfinite(values)])
    largest = float(np.abs(different).max(initial=0.0))
    finest = FINEST * max(1.0, largest)
    if len(different) < _LEAST_VALUES:
        return finest
    gaps = np.diff(different)
    steps = gaps / gaps.min()
    on_grid = np.abs(steps - np.round(steps)).max() < _OFF_GRID
    return max(finest, float(gaps.min())) if on_grid else finest


def rounded_again(log: Log, *, seed: int = 0) -> Log:
    """Return a log whose states and torques differ from those of `log` by the rounding of their own grids."""
    random = np.random.default_rng(seed)
    names = (*STATE_NAMES, *torque_names(log.torques.shape[1]))
    steps = {name: column_resolution(log[name]) for name in names}
    return log.with_columns(
        {name: log[name] + step * random.uniform(-0.5, 0.5, len(log)) for name, step in steps.items()}
    )


def rounding_errors(
    models: ModelPair,
    log: Log,
    starts: NDArray[np.int64],
    states: NDArray[np.float64],
    *,
    seed: int = 0,
) -> NDArray[np.float64]:
    """Return the errors of forecasts that rounding alone causes.

    Parameters
    ----------
    models : ModelPair
    log : Log
    starts : array (starts,)
        Rows that the forecasts start from.
    states : array (2, starts, samples, 10)
        The forecasts of both models.
    seed : int
        Of the rounding.

    Returns
    -------
    array (2, starts, samples, 10)
    """
    samples = states.shape[2]
    again, rows = rounded_again(log, seed=seed), rows_after(starts, samples)
    moved = forecast(models.both, again, starts, samples) - states
    # a forecast without a value has no rounding either
    return np.nan_to_num(moved - (again.states - log.states)[rows])


def no_evidence(models: ModelPair, log: Log, parts: Sequence[range], errors: HorizonErrors) -> str | None:
    """Return why a log cannot show which model is better, if a model predicts all of it to its resolution."""
    assert errors.floor is not None
    exact = [bool(np.all(rmse <= _AT_FLOOR * errors.floor)) for rmse in errors.rmse]
    if not any(exact):
        return None
    states = np.concatenate([log.states[part.start : part.stop] for part in parts])
    if np.all(np.ptp(states, axis=0) <= FINEST * np.maximum(1.0, np.abs(states).max(axis=0))):
        return "The log does not move, so it cannot show which model is better. Use a log in which the robot moves."
    if all(exact):
        return (
            "Both models predict this log to the resolution of its numbers, so it cannot show which is better. Use a "
            "log in which the robot moves more."
        )
    own = models.names[exact.index(True)]
    return (
        f"This log was simulated by the model {own} itself, which predicts it to the resolution of its numbers, so it "
        "cannot show which model is better. Use a log of the robot, or of the twin (`ballbot record`)."
    )
