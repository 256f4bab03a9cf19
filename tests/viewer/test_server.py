"""The server of a live view: who comes in, what a page may ask for, and what becomes of everything else."""

import asyncio
import json

import pytest
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed

from ballbot.viewer.live import Request
from ballbot.viewer.page import LivePage
from ballbot.viewer.server import serve_live

TOKEN = "correct-horse"
PAGE = LivePage(html="<!doctype html><title>robot</title>", policy="default-src 'none'")
#: [s] for what a test waits for, on a busy machine
PATIENCE = 60.0


class Simulation:
    """A world that notes the requests."""

    def __init__(self):
        self.requests: list[Request] = []

    def tick(self):
        pass

    def status(self):
        return "{}"

    def frame(self, rate):
        return [rate]

    def take(self, request):
        self.requests.append(request)


def served(visit):
    """Return what a visitor, who gets the port, finds on a server; and the requests that reached the simulation."""
    source = Simulation()

    async def run():
        until, address = asyncio.Event(), asyncio.get_running_loop().create_future()
        server = asyncio.create_task(
            serve_live(PAGE, source, token=TOKEN, ready=address.set_result, until=until)
        )
        port = int((await asyncio.wait_for(address, PATIENCE)).rpartition(":")[2].partition("/")[0])
        try:
            return await asyncio.wait_for(visit(port), PATIENCE)
        finally:
            until.set()
            await asyncio.wait_for(server, PATIENCE)

    return asyncio.run(run()), source.requests


UPGRADE = (
    "Upgrade: websocket",
    "Connection: Upgrade",
    "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
    "Sec-WebSocket-Version: 13",
)
OWN = "127.0.0.1:{port}"


async def answer(port, path, *, host=OWN, origin=None, upgrade=False):
    """Return the status and the head of the answer to a request."""
    lines = [f"GET {path} HTTP/1.1", f"Host: {host}", *(UPGRADE if upgrade else ())]
    lines += [] if origin is None else [f"Origin: {origin}"]
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write("\r\n".join((*lines, "", "")).format(port=port).encode("latin-1"))
    head = (await reader.readuntil(b"\r\n\r\n")).decode("latin-1")
    writer.close()
    return int(head.split()[1]), head


def test_page_comes_with_its_policy_to_whoever_has_the_token():
    (status, head), _ = served(lambda port: answer(port, f"/?token={TOKEN}"))
    assert status == 200
    assert "Content-Security-Policy: default-src 'none'; connect-src ws://127.0.0.1:" in head
    assert "frame-ancestors 'none'" in head
    for line in (
        "Cache-Control: no-store",
        "Referrer-Policy: no-referrer",
        "X-Content-Type-Options: nosniff",
    ):
        assert line in head


@pytest.mark.parametrize(
    "path",
    ["/", "/?token=", "/?token=wrong", f"/?token={TOKEN}&token={TOKEN}", "/?token=%FF"],
)
def test_page_needs_the_token_once(path):
    assert served(lambda port: answer(port, path))[0][0] == 403


def test_path_that_is_no_address_is_answered(caplog):
    assert served(lambda port: answer(port, "//[?x"))[0][0] == 404
    assert not caplog.records


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:80", "127.0.0.1.evil.example", "", "[::1", "0.0.0.0"]
)
@pytest.mark.parametrize("path", ["/", "/live"])
def test_host_of_another_name_is_refused(host, path):
    asked = {"host": host, "origin": f"http://{host}", "upgrade": path == "/live"}
    (status, _), requests = served(lambda port: answer(port, f"{path}?token={TOKEN}", **asked))
    assert status == 403
    assert requests == []


@pytest.mark.parametrize(
    ("path", "origin", "status"),
    [
        (f"/live?token={TOKEN}", f"http://{OWN}", 101),
        (f"/live?token={TOKEN}", "http://localhost:{port}", 403),  # another name than its Host
        (f"/live?token={TOKEN}", f"https://{OWN}", 403),
        (f"/live?token={TOKEN}", "http://127.0.0.1:1", 403),  # another program of this computer
        *((f"/live?token={TOKEN}", origin, 403) for origin in ("http://evil.example", "null", None)),
        ("/live", f"http://{OWN}", 403),
        ("/live?token=wrong", f"http://{OWN}", 403),
        (f"/?token={TOKEN}", f"http://{OWN}", 400),
        (f"/other?token={TOKEN}", f"http://{OWN}", 404),
    ],
)
def test_web_socket_needs_the_pages_own_origin_the_token_and_its_path(path, origin, status):
    assert served(lambda port: answer(port, path, origin=origin, upgrade=True))[0][0] == status


def test_server_survives_bytes_that_are_no_http():
    async def visit(port):
        nasty = b"GET /\xff?token=\xff HTTP/1.1\r\nHost: \xff\r\n\r\n"
        for text in (b"\0\xff\r\n\r\n", nasty, b"GET " + b"a" * 99_999):
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            writer.write(text + b"\r\n\r\n")
            await reader.read(100_000)
            writer.close()
        return await answer(port, f"/?token={TOKEN}")

    assert served(visit)[0][0] == 200


def talk(*messages):
    """Return the code with which the server closes after messages, and the requests that it took."""

    async def visit(port):
        address, origin = f"ws://127.0.0.1:{port}/live?token={TOKEN}", f"http://127.0.0.1:{port}"
        async with connect(address, origin=origin, max_size=None) as socket:
            first = [await socket.recv(), await socket.recv()]
            assert {type(one) for one in first} == {str, bytes}  # the status and a frame
            try:
                for message in messages:
                    await socket.send(message)
            except ConnectionClosed:
                pass
            await socket.wait_closed()
            return socket.protocol.close_code

    return served(visit)


def test_requests_before_a_wrong_one_reach_the_simulation():
    code, requests = talk('{"change": {"friction": 2.0}}', '{"reset": true}', "stop")
    assert code == 1008
    assert requests == [Request(change={"friction": 2.0}), Request(reset=True)]


@pytest.mark.parametrize(
    ("message", "code"),
    [
        ("[" * 1000, 1008),
        ('{"change": {"controller": "mine.py:Mine"}}', 1008),
        (json.dumps({"change": {"friction": 1.0}}) + " " * 3000, 1009),  # too long
    ],
)
def test_any_other_message_ends_the_connection(message, code):
    found, requests = talk(message)
    assert found == code
    assert requests == []
