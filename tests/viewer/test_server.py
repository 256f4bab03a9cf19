"""The server of a live view: who comes in, what a page may ask for, and what becomes of everything else."""

import asyncio
import json

import pytest
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed

from ballbot.viewer.live import Request
from ballbot.viewer.page import LivePage
from ballbot.viewer.server import Access, serve_live

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


def served(visit, host="127.0.0.1"):
    """Return what a visitor, who gets the port, finds on a server; and the requests that reached the simulation."""
    source = Simulation()

    async def run():
        until, address = asyncio.Event(), asyncio.get_running_loop().create_future()
        access = Access(host=host, token=TOKEN)
        server = asyncio.create_task(
            serve_live(PAGE, source, access=access, ready=address.set_result, until=until)
        )
        port = int((await asyncio.wait_for(address, PATIENCE)).rpartition(":")[2].partition("/")[0])
        try:
            return await asyncio.wait_for(visit(port), PATIENCE)
        finally:
            until.set()
            await asyncio.wait_for(server, PATIENCE)

    return asyncio.run(run()), source.requests


async def answer(port, path, *headers):
    """Return the whole answer to a request with these header lines."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write("\r\n".join((f"GET {path} HTTP/1.1", *headers, "", "")).encode("latin-1"))
    head = (await reader.readuntil(b"\r\n\r\n")).decode("latin-1")
    writer.close()
    return head


def status_of(head):
    return int(head.split()[1])


UPGRADE = (
    "Upgrade: websocket",
    "Connection: Upgrade",
    "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
    "Sec-WebSocket-Version: 13",
)


def test_page_comes_with_its_policy_to_whoever_has_the_token():
    head, _ = served(lambda port: answer(port, f"/?token={TOKEN}", f"Host: 127.0.0.1:{port}"))
    assert status_of(head) == 200
    assert "Content-Security-Policy: default-src 'none'; connect-src ws://127.0.0.1:" in head
    assert "frame-ancestors 'none'" in head
    for line in (
        "Cache-Control: no-store",
        "Referrer-Policy: no-referrer",
        "X-Content-Type-Options: nosniff",
    ):
        assert line in head


@pytest.mark.parametrize(
    "path", ["/", "/?token=", "/?token=wrong", f"/?token={TOKEN}&token={TOKEN}", "/?token=%FF"]
)
def test_page_needs_the_token_once(path):
    head, _ = served(lambda port: answer(port, path, f"Host: 127.0.0.1:{port}"))
    assert status_of(head) == 403


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:80", "127.0.0.1.evil.example", "", "[::1", "0.0.0.0"]
)
@pytest.mark.parametrize("path", ["/", "/live"])
def test_host_of_another_name_is_refused(host, path):
    lines = (f"Host: {host}", f"Origin: http://{host}", *(UPGRADE if path == "/live" else ()))
    head, requests = served(lambda port: answer(port, f"{path}?token={TOKEN}", *lines))
    assert status_of(head) == 403
    assert requests == []


@pytest.mark.parametrize(
    ("origin", "status"),
    [
        ("http://127.0.0.1:{port}", 101),
        ("http://localhost:{port}", 403),  # another name than its Host
        ("https://127.0.0.1:{port}", 403),
        ("http://127.0.0.1:1", 403),  # another program of this computer
        ("http://evil.example", 403),
        ("null", 403),
        (None, 403),
    ],
)
def test_web_socket_needs_the_pages_own_origin(origin, status):
    def visit(port):
        lines = [f"Host: 127.0.0.1:{port}", *UPGRADE]
        lines += [] if origin is None else [f"Origin: {origin.format(port=port)}"]
        return answer(port, f"/live?token={TOKEN}", *lines)

    head, _ = served(visit)
    assert status_of(head) == status


def test_web_socket_needs_the_token_and_its_path():
    async def visit(port):
        own = (f"Host: 127.0.0.1:{port}", f"Origin: http://127.0.0.1:{port}", *UPGRADE)
        paths = ("/live", "/live?token=wrong", f"/?token={TOKEN}", f"/other?token={TOKEN}")
        return [status_of(await answer(port, path, *own)) for path in paths]

    assert served(visit)[0] == [403, 403, 400, 404]


def test_server_survives_bytes_that_are_no_http():
    async def visit(port):
        for text in (
            b"\0\xff\r\n\r\n",
            b"GET /\xff?token=\xff HTTP/1.1\r\nHost: \xff\r\n\r\n",
            b"GET " + b"a" * 99_999,
        ):
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            writer.write(text + b"\r\n\r\n")
            await reader.read(100_000)
            writer.close()
        return await answer(port, f"/?token={TOKEN}", f"Host: 127.0.0.1:{port}")

    assert status_of(served(visit)[0]) == 200


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
        ("no JSON", 1008),
        ("[" * 1000, 1008),
        ('{"arm": true}', 1008),
        ('{"change": {"controller": "mine.py:Mine"}}', 1008),
        ('{"change": {"friction": 1e9}}', 1008),
        ('{"change": {"friction": NaN}}', 1008),
        ('{"push": {"force": [1, 2, 3], "height": 0.1}}', 1008),
        ('{"reset": 1}', 1008),
        (json.dumps({"change": {"friction": 1.0}}) + " " * 3000, 1009),  # too long
    ],
)
def test_any_other_message_ends_the_connection(message, code):
    found, requests = talk(message)
    assert found == code
    assert requests == []
