"""Rows of a run, as a Foxglove client gets them, and a robot that does not wait for it."""

import json
import socket
import struct
import time
from contextlib import contextmanager
from threading import Event
from typing import Any

import numpy as np
import pytest
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from ballbot.errors import InputError
from ballbot.link.foxglove_server import FoxgloveServer
from ballbot.link.live import log_columns
from ballbot.link.stream import BACKLOG, LiveStream, StreamAddress, stream_address
from ballbot.log.columns import unit_of
from ballbot.robot import Robot

PATIENCE = 60.0  #: for what takes milliseconds [s]
ALTEN = Robot.load("alten")
COLUMNS = log_columns(3)


def row(t: float, columns: tuple[str, ...] = COLUMNS) -> list[float]:
    """Return a row that leans and has no gyro."""
    numbers = dict.fromkeys(columns, -1.2345678901234567e-101)
    return list((numbers | {"t": t, "x": 0.3, "theta": 0.1, "psi": 0.2, "gyro_x": np.nan}).values())


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@contextmanager
def foxglove_client(port: int):
    """Hold a connection that has subscribed to every channel, and the channels by their subscription's number."""
    with connect(f"ws://127.0.0.1:{port}", subprotocols=[Subprotocol("foxglove.sdk.v1")]) as client:
        channels: dict[str, dict[str, Any]] = {}
        while len(channels) < 4:
            message = json.loads(client.recv(PATIENCE))
            channels |= {one["topic"]: one for one in message.get("channels", ())}
        wanted = [{"id": one["id"], "channelId": one["id"]} for one in channels.values()]
        client.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
        yield client, channels


def test_a_foxglove_client_gets_rows_poses_a_picture_and_events():
    port = free_port()
    with (
        LiveStream(StreamAddress("127.0.0.1", port), COLUMNS, ALTEN) as stream,
        foxglove_client(port) as (client, channels),
    ):
        topics = {one["id"]: topic for topic, one in channels.items()}
        assert channels["/log"]["encoding"] == "json"
        properties = json.loads(channels["/log"]["schema"])["properties"]
        assert {name: one.get("unit") for name, one in properties.items()} == {n: unit_of(n) for n in COLUMNS}
        names = [channels[topic]["schemaName"] for topic in ("/events", "/tf", "/scene")]
        assert names == ["foxglove.Log", "foxglove.FrameTransforms", "foxglove.SceneUpdate"]
        received: dict[str, list[tuple[int, bytes]]] = {topic: [] for topic in channels}
        end, k = time.monotonic() + PATIENCE, 0
        while not all(len(received[topic]) > (topic in ("/log", "/tf")) for topic in received):
            assert time.monotonic() < end
            stream.append(row(0.005 * k))
            stream.append("The robot is armed.")
            k += 1
            try:
                message = client.recv(0.01)
            except TimeoutError:  # it has not subscribed yet
                continue
            assert isinstance(message, bytes)
            kind, number, stamp = struct.unpack("<BIQ", message[:13])
            assert kind == 1
            received[topics[number]].append((stamp, message[13:]))
        rows = [json.loads(content) for _, content in received["/log"]]
        assert rows[0].keys() == set(COLUMNS) - {"gyro_x"}
        assert (rows[0]["theta"], rows[0]["psi"]) == (0.1, 0.2)
        elapsed = 1e-9 * (received["/log"][1][0] - received["/log"][0][0])
        assert elapsed == pytest.approx(rows[1]["t"] - rows[0]["t"], abs=1e-6)
        assert b"The robot is armed." in received["/events"][0][1]
        frames = received["/tf"][0][1]
        assert struct.pack("<d", 0.3) in frames  # x
        assert struct.pack("<d", ALTEN.ball.radius) in frames
        # the scalar part of Rx(theta) Rz(psi)
        assert struct.pack("<d", np.cos(0.05) * np.cos(0.1))[3:] in frames
        assert struct.pack("<d", 2.0 * ALTEN.ball.radius) in received["/scene"][0][1]


def test_a_stream_that_cannot_send_never_delays_the_robot(monkeypatch):
    answers = Event()
    monkeypatch.setattr(FoxgloveServer, "send_row", lambda *_: answers.wait(PATIENCE))
    with LiveStream(StreamAddress("127.0.0.1", free_port()), COLUMNS, None) as stream:
        for k in range(3 * BACKLOG):
            stream.append(row(0.005 * k))  # or this would wait for ever
        assert len(stream._waiting) == BACKLOG
        began = time.monotonic()
        stream.__exit__()
        assert time.monotonic() - began < PATIENCE / 2.0
        answers.set()


def test_addresses():
    assert stream_address("foxglove") == ("127.0.0.1", 8765)
    assert stream_address("ws://[::1]:9000/") == ("::1", 9000)
    for text in (
        "plotjuggler",
        "ws://10.0.0.1",
        "http://a:80",
        "ws://a:70000",
        "ws://a:80/path",
        "udp://a:1",
    ):
        with pytest.raises(InputError, match=r"is no address: give foxglove, or ws://HOST:PORT"):
            stream_address(text)


def test_an_address_that_cannot_be_opened_is_refused_in_a_sentence():
    port = free_port()
    with (
        LiveStream(StreamAddress("127.0.0.1", port), COLUMNS, None),
        pytest.raises(InputError, match=rf"server at ws://127.0.0.1:{port} cannot be opened: Address alr"),
    ):
        LiveStream(StreamAddress("127.0.0.1", port), COLUMNS, None)
