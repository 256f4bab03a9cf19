"""Messages of several topics as the columns of one table; what MCAP files and ROS 2 bags have in common.

Topics have their own times. The table has the times of the topic with the most messages, and the latest value of every
other topic at each of them: what a controller that listens to these topics would know. Before a topic's first message
its values are missing. Nothing is interpolated, so that a slow sensor still looks like one.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.log.columns import Columns

_NANOSECONDS = 1e9
#: times of files are whole nanoseconds of 63 bits
_LATEST = 2**63 - 1


@dataclass(kw_only=True)
class Topic:
    """The messages of a topic, in their order in the file."""

    name: str
    times: list[int] = field(default_factory=list[int])  #: [ns]
    messages: list[Mapping[str, float]] = field(default_factory=list[Mapping[str, float]])


def joined(topics: Iterable[Topic]) -> Columns:
    """Return one table of the messages of all topics: `t` [s] from its first row on, and `topic.field`.

    Parameters
    ----------
    topics : iterable of Topic
        Those without numbers are left out.

    Raises
    ------
    InputError
        If two fields get the same name.
    """
    tables = [_table(one) for one in topics if any(one.messages)]
    if not tables:
        return {}
    times = max((one for one, _ in tables), key=len)
    columns: Columns = {"t": (times - times[0]) / _NANOSECONDS}
    for own_times, fields in tables:
        latest = np.searchsorted(own_times, times, side="right") - 1
        for name, values in fields.items():
            if name in columns:
                raise InputError(f"two topics have a field that would be called {name[:80]!r}")
            columns[name] = np.where(latest >= 0, values[np.maximum(latest, 0)], np.nan)
    return columns


def _table(topic: Topic) -> tuple[NDArray[np.int64], Columns]:
    """Return a topic's times [ns] in ascending order and its fields, each with the topic's name before its own."""
    times = np.array(topic.times, dtype=np.int64)
    order = np.argsort(times, kind="stable")
    names = dict.fromkeys(name for message in topic.messages for name in message)
    start = topic.name.strip("/").replace("/", ".")
    fields = {
        f"{start}.{name}": np.array([message.get(name, math.nan) for message in topic.messages])[order]
        for name in names
    }
    return times[order], fields


def first_time(columns: Mapping[str, NDArray[np.float64]]) -> float:
    """Return the time [s] that a file's clock calls zero: zero, or the log's first time if that is below zero."""
    t = columns.get("t", np.zeros(1))
    return float(np.min(t, initial=0.0, where=np.isfinite(t)))


def nanoseconds(t: NDArray[np.float64], *, origin: float) -> list[int]:
    """Return times [s] as whole nanoseconds after `origin` [s], within what a file can hold; missing times as zero."""
    known = np.where(np.isfinite(t), t, origin)
    return [min(max(int(one), 0), _LATEST) for one in np.rint((known - origin) * _NANOSECONDS).tolist()]
