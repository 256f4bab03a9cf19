"""MCAP files: JSON messages on topics, as Foxglove and PlotJuggler show them, read and written by the library mcap.

A log is written with a topic for each unit, such as /angle_rad or /torque_N_m. Each row of the log is a message with
`t` and the columns of that unit, and a missing value is left out. The schema of a topic states the unit of each field;
the file's metadata "ballbot" has the columns' names in their order. `replay` topics may be added: the scene of
`ballbot.viewer.foxglove`.

Files of others are read by the times and names of their messages (`ballbot.log.formats.messages`): JSON, and ROS 2
messages of standard types (`ballbot.log.formats.ros`). Messages in other encodings are skipped. A chunk is unpacked
only as far as `ballbot.files` allows.
"""

from __future__ import annotations

import io
import json
import struct
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import format_bytes
from ballbot.errors import InputError
from ballbot.files import LARGEST_TABLE, read_bytes, write_bytes
from ballbot.log.columns import Columns, unit_of
from ballbot.log.formats.json import flattened
from ballbot.log.formats.messages import Topic, first_time, nanoseconds
from ballbot.log.formats.ros import RosMessage, ros_columns

if TYPE_CHECKING:
    from mcap.records import Chunk, McapRecord

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


def read_mcap(path: str | Path) -> Columns:
    """Return the columns of a log, or the joined topics of another file.

    Raises
    ------
    InputError
        If the file cannot be read, is damaged, unpacks to too much, or has no messages that can be read.
    """
    content = read_bytes(path)
    try:
        return mcap_columns(mcap_messages(content))
    except (struct.error, ArithmeticError, LookupError, MemoryError, RecursionError, RuntimeError, TypeError,
            ValueError, AttributeError) as error:  # fmt: skip
        reason = f": {error}" if isinstance(error, InputError) else ""
        raise InputError(f"{path} cannot be read: it is not a complete MCAP file{reason}.") from None


def write_mcap(
    path: str | Path, columns: Mapping[str, NDArray[np.float64]], replay: Sequence[Channel] = ()
) -> None:
    """Write columns (N,) to an MCAP file, whole or not at all.

    Parameters
    ----------
    path : str or Path
    columns : mapping of str to ndarray
    replay : sequence of Channel
        Further topics.

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
    for channel in (*_channels(columns), *replay):
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


class McapContent(NamedTuple):
    """The messages of a file, or of several that are read as one."""

    own: list[str] | None  #: the columns of a log that `write_mcap` wrote
    topics: dict[str, Topic]  #: messages in JSON
    ros: list[RosMessage]  #: messages in ROS's encoding
    others: set[str]  #: other encodings, whose messages are left out
    size: int  #: of all messages, unpacked [bytes]


def mcap_messages(content: bytes) -> McapContent:
    """Return the messages of a file; ValueError or another of Python's own exceptions if it is damaged."""
    from mcap.exceptions import McapError

    try:
        return _messages(content)
    except McapError as error:
        raise ValueError(str(error)) from None


def _messages(content: bytes) -> McapContent:
    topics: dict[str, Topic] = {}
    ros: list[RosMessage] = []
    own: list[str] | None = None
    others: set[str] = set()
    size = 0
    schemas: dict[int, str] = {}
    channels: dict[int, tuple[str, str, int]] = {}
    from mcap.records import Channel as ChannelRecord
    from mcap.records import Message, Metadata, Schema

    for record in _records(content):
        if isinstance(record, Schema):
            schemas[record.id] = record.name
        elif isinstance(record, ChannelRecord):
            channels[record.id] = (record.topic, record.message_encoding, record.schema_id)
        elif isinstance(record, Metadata) and record.name == _METADATA:
            own = [str(name) for name in json.loads(record.metadata["columns"])]
        elif isinstance(record, Message):
            topic, encoding, schema = channels[record.channel_id]
            size += len(record.data)
            if encoding == "json":
                fields = json.loads(record.data)
                here = topics.setdefault(topic, Topic(name=topic))
                here.times.append(record.log_time)
                here.messages.append(flattened(fields) if isinstance(fields, dict) else {})
            elif encoding == "cdr":
                ros.append(RosMessage(topic, schemas.get(schema, ""), record.log_time, record.data))
            else:
                others.add(encoding)
    return McapContent(own, topics, ros, others, size)


def mcap_columns(found: McapContent) -> Columns:
    """Return the columns of a log, or the joined topics of other messages; raise as `mcap_messages` if damaged."""
    if found.own is not None:
        return _own_columns(found.own, found.topics.values())
    columns = ros_columns(found.ros, [one for one in found.topics.values() if one.messages])
    if not columns and found.others:
        raise InputError(f"its messages are in {' and '.join(sorted(found.others))}, and JSON or cdr is read")
    return columns


def _own_columns(names: Sequence[str], topics: Iterable[Topic]) -> Columns:
    """Return the columns of a file that `write_mcap` wrote."""
    by_topic = {one.name: one.messages for one in topics}
    clock = next((by_topic[topic] for topic in _TOPICS.values() if topic in by_topic), [])
    columns: Columns = {}
    for name in names:
        messages = clock if name == "t" else by_topic.get(_TOPICS[unit_of(name)], [])
        columns[name] = np.array([message.get(name, np.nan) for message in messages], dtype=np.float64)
    return columns


def _records(content: bytes) -> Iterator[McapRecord]:
    """Yield the records of a file, those in chunks among them."""
    from dataclasses import replace

    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader, breakup_chunk

    left = LARGEST_TABLE
    reader = StreamReader(
        io.BytesIO(content), emit_chunks=True, validate_crcs=True, record_size_limit=LARGEST_TABLE
    )
    for record in reader.records:
        if not isinstance(record, Chunk):
            yield record
            continue
        unpacked = _unpacked(record, left)
        left -= len(unpacked)
        if left < 0:
            raise InputError(f"it unpacks to more than {format_bytes(LARGEST_TABLE)}")
        yield from breakup_chunk(replace(record, compression="", data=unpacked), validate_crc=True)


def _unpacked(chunk: Chunk, most: int) -> bytes:
    """Return the content of a chunk, or one byte more than `most` of it; what it claims of its size is not trusted."""
    if chunk.compression == "zstd":
        import zstandard

        reader = zstandard.ZstdDecompressor().stream_reader(chunk.data)
        try:
            return reader.read(most + 1)
        except zstandard.ZstdError as error:
            raise ValueError(str(error)) from None
    if chunk.compression == "lz4":
        import lz4.frame

        return lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=most + 1)
    if chunk.compression:
        raise InputError(f"its compression {chunk.compression[:20]!r} is not zstd or lz4")
    return chunk.data
