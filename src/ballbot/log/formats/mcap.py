"""MCAP files: JSON messages on topics, as Foxglove and PlotJuggler show them, read and written by the library mcap.

A log is written on one topic, /log: each row is a message with `t` and the other columns, and a missing value is left
out. The topic's schema states the unit of each field; the file's metadata "ballbot" has the columns' names in their
order. Other files with JSON or ROS 2 messages are read by the times and names of these (`ballbot.log.formats.ros`).
"""

import io
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path

import numpy as np

from ballbot.arrays import Floats
from ballbot.errors import InputError
from ballbot.files import write_bytes
from ballbot.log.columns import Columns, unit_of
from ballbot.log.formats.json import flattened
from ballbot.log.formats.ros import Topics, joined, read_bag

_METADATA = "ballbot"
#: the topic of a log's rows
LOG_TOPIC = "/log"
#: times of files are whole nanoseconds of 63 bits
_LATEST = 2**63 - 1


def read_mcap(path: Path) -> Columns:
    """Return the columns of a log, or the joined topics of another file in JSON or, as of a bag, in ROS's encoding."""
    from mcap.reader import make_reader

    topics: Topics = {}
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        channels = summary.channels.values() if summary else ()
        encodings = {channel.message_encoding for channel in channels}
        if "cdr" in encodings:
            return read_bag(path)
        if encodings and "json" not in encodings:
            named = " and ".join(sorted(encodings))
            raise InputError(f"{path} cannot be read: its messages are in {named}, and JSON or cdr is read.")
        own = [record.metadata["columns"] for record in reader.iter_metadata() if record.name == _METADATA]
        for _, channel, message in reader.iter_messages(log_time_order=False):
            if channel.message_encoding == "json":
                fields = json.loads(message.data)
                times, messages = topics.setdefault(channel.topic, ([], []))
                times.append(message.log_time)
                messages.append(flattened(fields) if isinstance(fields, dict) else {})
    if not own or LOG_TOPIC not in topics:
        return joined(topics)
    rows = topics[LOG_TOPIC][1]
    return {name: np.array([row.get(name, np.nan) for row in rows]) for name in json.loads(own[0])}


def log_schema(names: Iterable[str]) -> dict[str, object]:
    """Return the JSON schema of a row's message, with the units of its columns."""
    properties = {name: {"type": "number"} for name in names}
    for name in properties:
        if unit := unit_of(name):
            properties[name] |= {"unit": unit, "description": f"[{unit}]"}
    return {"title": "log", "type": "object", "properties": properties}


def row_message(names: Iterable[str], row: Sequence[float]) -> bytes:
    """Return a row's message in JSON, without missing values."""
    values = zip(names, row, strict=True)
    return json.dumps({name: value for name, value in values if math.isfinite(value)}).encode()


def write_mcap(path: Path, columns: Mapping[str, Floats]) -> None:
    """Write columns (N,), whose t increases, to an MCAP file, whole or not at all."""
    from mcap.writer import Writer

    t = columns["t"] - min(0.0, float(columns["t"][0]))  # the file's clock has no times below zero
    times = [min(int(time), _LATEST) for time in np.rint(1e9 * t).tolist()]
    stream = io.BytesIO()
    writer = Writer(stream)
    writer.start(library=f"ballbot {version('ballbot')}")
    described = json.dumps(log_schema(columns)).encode()
    schema = writer.register_schema(name="ballbot.log", encoding="jsonschema", data=described)
    channel = writer.register_channel(LOG_TOPIC, message_encoding="json", schema_id=schema)
    for time, row in zip(times, np.column_stack(list(columns.values())).tolist(), strict=True):
        writer.add_message(channel, log_time=time, data=row_message(columns, row), publish_time=time)
    units = {name: unit_of(name) or "" for name in columns}
    writer.add_metadata(_METADATA, {"columns": json.dumps(list(columns)), "units": json.dumps(units)})
    writer.finish()
    write_bytes(path, stream.getvalue())
