"""How often a log's columns are renewed: a controller or a sensor slower than the log leaves steps of equal values."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ballbot.log import STATE_NAMES, Log
from ballbot.log.columns import torque_names

#: a column is slower than the log where it is renewed every so many rows or more on average
_SLOWER = 1.2
#: and as good as evenly: this share of the renewals no more than a row off the average
_EVENLY = 0.9
_LEAST_RENEWALS = 20


@dataclass(frozen=True, kw_only=True)
class Updates:
    """Rates [Hz] of what is renewed less often than the log has rows."""

    torques: float | None  #: the control rate
    states: dict[str, float]  #: by the state's name


def find_updates(log: Log) -> Updates:
    """Return what in a log is renewed less often than once a row, at even intervals."""
    count = log.torques.shape[1]
    torques = [rate for name in torque_names(count) if (rate := _rate(log, name)) is not None]
    states = {name: rate for name in STATE_NAMES if (rate := _rate(log, name)) is not None}
    return Updates(torques=max(torques) if len(torques) == count else None, states=states)


def _rate(log: Log, name: str) -> float | None:
    renewed = np.flatnonzero(np.diff(log[name]) != 0.0)
    if len(renewed) < _LEAST_RENEWALS:
        return None
    between = np.diff(renewed)
    average = float(between.mean())
    even = np.mean(np.abs(between - average) < 1.0)
    return 1.0 / (average * log.sample_time) if average > _SLOWER and even > _EVENLY else None
