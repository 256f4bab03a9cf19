"""Logs that are evidence for no model, by the resolution of their numbers.

A column of decimals or of an encoder's counts lies on a grid of some step; a column of full precision counts as
resolved to `FINEST`.

A model that predicts all ten states of the next row to this floor simulated the log itself, because no robot follows
its model so far. Such a log shows nothing about the other model either, and neither does a log that does not move.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ballbot.log import STATE_NAMES, Log
from ballbot.validation.models import FINEST, ErrorPair, ModelPair

#: a column has a grid if it has so many values, and all are whole steps apart within this part of one
_LEAST_VALUES, _OFF_GRID = 8, 0.01
#: a model is at the floor within this factor, as the torques and the other states are rounded, too
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


def rounding_floor(log: Log) -> NDArray[np.float64]:
    """Return the RMS error (10,) that the rounding of the states makes of a perfect prediction of them.

    A forecast's start and its end are rounded, each by up to half a step of the grid either way.
    """
    return np.sqrt(2.0 / 12.0) * np.array([column_resolution(log[name]) for name in STATE_NAMES])


def no_evidence(models: ModelPair, log: Log, parts: Sequence[range], one_step: ErrorPair) -> str | None:
    """Return why a log cannot show which model is better, if a model predicts each row to its resolution."""
    floor = _AT_FLOOR * rounding_floor(log)
    exact = [bool(np.all(one.rmse <= floor)) for one in (one_step.first, one_step.second)]
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
