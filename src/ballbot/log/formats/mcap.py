"""MCAP files: JSON messages on topics, as Foxglove and PlotJuggler show them, read and written by the library mcap.

A log is written with a topic for each unit, such as /angle_rad or /torque_N_m. Each row of the log is a message with
`t` and the columns of that unit, and a missing value is left out. The schema of a topic states the unit of each field;
the file's metadata "ballbot" has the columns' names in their order.

Files of others are read by the times and names of their messages (`ballbot.log.formats.messages`): JSON, and ROS 2
messages (`ballbot.log.formats.ros`). Messages in other encodings are skipped.
"""

from __future__ import annotations

import io
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from operator import itemgetter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.files import write_bytes
from ballbot.log.columns import Columns, unit_of
from ballbot.log.formats.json import flattened
from ballbot.log.formats.messages import Topic, first_time, joined, nanoseconds
from ballbot.log.formats.ros import read_bag

_METADATA = "ballbot"
#: topics by the unit of their columns
_TOPICS = {
    "m": "/position_m",
    "m/s": "/velocity_m_s",
    "rad": "/angle_rad",
    "rad/s": "/angular_velocity_rad_s",
    "m/s^2": "/acceleration_m_s2",
    "N m": "/torque_N_m",
    None: "/other",
}


@dataclass(frozen=True, kw_only=True)
class Channel:
    """JSON messages to write on one topic."""

    topic: str
    schema: str  #: its name, by which Foxglove knows what to draw
    definition: Mapping[str, object]  #: JSON schema
    t: NDArray[np.float64]  #: (N,) [s], in the log's clock
    messages: Sequence[Mapping[str, object]]  #: N


def read_mcap(path: Path) -> Columns:
    """Return the columns of a log, or the joined topics of another file in JSON; of one in ROS's encoding, of a bag."""
    from mcap.reader import make_reader

    topics: dict[str, Topic] = {}
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        encodings = {one.message_encoding for one in summary.channels.values()} if summary else set[str]()
        if "cdr" in encodings:
            return read_bag(path)
        if encodings and "json" not in encodings:
            named = " and ".join(sorted(encodings))
            raise InputError(f"{path} cannot be read: its messages are in {named}, and JSON or cdr is read.")
        own = [one.metadata["columns"] for one in reader.iter_metadata() if one.name == _METADATA]
        for _, channel, message in reader.iter_messages(log_time_order=False):
            if channel.message_encoding == "json":
                fields = json.loads(message.data)
                topic = topics.setdefault(channel.topic, Topic(name=channel.topic))
                topic.times.append(message.log_time)
                topic.messages.append(flattened(fields) if isinstance(fields, dict) else {})
    return _own_columns(json.loads(own[0]), topics) if own else joined(topics.values())


def write_mcap(path: Path, columns: Mapping[str, NDArray[np.float64]]) -> None:
    """Write columns (N,) to an MCAP file, whole or not at all.

    Parameters
    ----------
    path : str or Path
    columns : mapping of str to ndarray

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    from mcap.writer import Writer

    stream = io.BytesIO()
    writer = Writer(stream)
    writer.start(library=f"ballbot {version('ballbot')}")
    origin = first_time(columns)
    messages: list[tuple[int, int, bytes]] = []
    for channel in _channels(columns):
        schema = writer.register_schema(
            name=channel.schema, encoding="jsonschema", data=json.dumps(channel.definition).encode()
        )
        number = writer.register_channel(channel.topic, message_encoding="json", schema_id=schema)
        times = nanoseconds(channel.t, origin=origin)
        texts = (json.dumps(one).encode() for one in channel.messages)
        messages += zip(times, (number,) * len(times), texts, strict=True)
    for time, number, text in sorted(messages, key=itemgetter(0)):
        writer.add_message(number, log_time=time, data=text, publish_time=time)
    units = {name: unit_of(name) or "" for name in columns}
    writer.add_metadata(_METADATA, {"columns": json.dumps(list(columns)), "units": json.dumps(units)})
    writer.finish()
    write_bytes(path, stream.getvalue())


def _channels(columns: Mapping[str, NDArray[np.float64]]) -> Iterator[Channel]:
    """Yield the topics of a log's columns."""
    count = len(next(iter(columns.values())))
    t = columns.get("t", np.arange(count, dtype=np.float64))
    clock = {"t": columns["t"]} if "t" in columns else {}
    for unit, topic in _TOPICS.items():
        named = {name: values for name, values in columns.items() if name != "t" and unit_of(name) == unit}
        if named or (unit is None and list(columns) == ["t"]):
            fields = clock | named
            properties = {name: _property(name) for name in fields}
            yield Channel(
                topic=topic,
                schema=f"ballbot.{topic[1:]}",
                definition={"title": topic[1:], "type": "object", "properties": properties},
                t=t,
                messages=_rows(fields),
            )


def _property(name: str) -> dict[str, str]:
    unit = unit_of(name)
    return (
        {"type": "number"} if unit is None else {"type": "number", "unit": unit, "description": f"[{unit}]"}
    )


def _rows(fields: Mapping[str, NDArray[np.float64]]) -> list[dict[str, object]]:
    lists = [np.asarray(values).tolist() for values in fields.values()]
    missing = [~np.isfinite(values) for values in fields.values()]
    if not any(one.any() for one in missing):
        return [dict(zip(fields, row, strict=True)) for row in zip(*lists, strict=True)]
    infinite = float("inf")
    return [
        {name: one for name, one in zip(fields, row, strict=True) if -infinite < one < infinite}
        for row in zip(*lists, strict=True)
    ]


def _own_columns(names: Sequence[str], topics: Mapping[str, Topic]) -> Columns:
    """Return the columns of a file that `write_mcap` wrote."""
    by_topic = {name: one.messages for name, one in topics.items()}
    clock = next((by_topic[topic] for topic in _TOPICS.values() if topic in by_topic), [])
    columns: Columns = {}
    for name in names:
        messages = clock if name == "t" else by_topic.get(_TOPICS[unit_of(name)], [])
        columns[name] = np.array([message.get(name, np.nan) for message in messages], dtype=np.float64)
    return columns
