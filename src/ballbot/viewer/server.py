"""The server of a live view: one page and one web socket on this computer, for whoever has the token of its address.

One loop simulates and serves: a frame each 20 ms to every page, and requests in between.

    GET /?token=...          the page; it is one file, and loads nothing
    GET /live?token=...      the web socket: frames (binary) and statuses (JSON) to the page, requests (JSON) from it

Every request needs the random token of the address, and a Host header that names this machine: a name that somebody
else's DNS lets point here (DNS rebinding) is refused. The web socket also needs the page's own Origin, so that no other
page that is open in the same browser reaches it.
"""

import asyncio
import logging
import secrets
import time
from collections.abc import Callable
from contextlib import suppress
from urllib.parse import parse_qs, urlsplit

import numpy as np
from websockets.asyncio.server import ServerConnection, broadcast, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed, WebSocketException
from websockets.http11 import Request as HttpRequest
from websockets.http11 import Response

from ballbot.errors import InputError
from ballbot.viewer.live import World, read_request
from ballbot.viewer.motion import INTERVAL
from ballbot.viewer.page import LivePage

LOOPBACK = "127.0.0.1"
_LOOPBACK_NAMES = frozenset({"127.0.0.1", "localhost", "::1"})
#: of a message from a page [bytes]
_LARGEST_MESSAGE = 2_000
#: real time [s] by which the simulation may be late before it gives up catching up
_LATEST = 0.2
_SECURITY_HEADERS = {
    "Cache-Control": "no-store",
    "Content-Type": "text/html; charset=utf-8",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}


def _is_loopback(host: str) -> bool:
    """Return whether a Host header names this computer by a loopback name."""
    try:
        return (urlsplit(f"//{host}").hostname or "").lower() in _LOOPBACK_NAMES
    except ValueError:
        return False


def refusal(token: str, path: str, headers: Headers) -> tuple[int, str] | None:
    """Return the HTTP status and the sentence with which a request is refused, or None."""
    hosts, origins = headers.get_all("Host"), headers.get_all("Origin")
    if len(hosts) != 1 or not _is_loopback(hosts[0]):
        return 403, "This server is reached by its own address only."
    address = f"http://{hosts[0]}"
    route, _, query = path.partition("?")  # urlsplit would read "//..." as a host, which may be invalid
    upgrading = headers.get("Upgrade", "").lower() == "websocket"
    if route not in ("/", "/live"):
        return 404, "There is nothing here."
    given = parse_qs(query).get("token", [])
    if len(given) != 1 or not secrets.compare_digest(given[0].encode(), token.encode()):
        return 403, "The address lacks its token. Open the one that the terminal shows."
    if (route == "/live") != upgrading:
        return 400, "The page is at /, the web socket at /live."
    if any(origin != address for origin in origins) or (upgrading and len(origins) != 1):
        return 403, "Another page's requests are refused."
    return None


async def serve_live(
    page: LivePage,
    world: World,
    *,
    token: str,  # that every request needs
    port: int = 0,  # to listen on; a free one by default
    ready: Callable[[str], None],  # called with the page's address
    until: asyncio.Event | None = None,  # ends it when it is set
) -> None:
    """Simulate a world in real time, and serve its page and its frames.

    InputError if the port cannot be listened on.
    """
    pages = _Pages(world)
    # log errors of this program only, not visitors that hang up or speak no HTTP
    logger = logging.getLogger("ballbot.viewer.server")
    logger.setLevel(logging.ERROR)
    logger.addFilter(_is_own_mistake)

    def answer(connection: ServerConnection, request: HttpRequest) -> Response | None:
        refused = refusal(token, request.path, request.headers)
        if refused is not None:
            return connection.respond(*refused)
        if request.path.partition("?")[0] == "/live":
            return None
        response = connection.respond(200, page.html)
        del response.headers["Content-Type"]
        response.headers.update(_SECURITY_HEADERS)
        response.headers["Content-Security-Policy"] = (
            f"{page.policy}; connect-src ws://{request.headers['Host']}; frame-ancestors 'none'"
        )
        return response

    try:
        server = await serve(
            pages.handle,
            LOOPBACK,
            port,
            process_request=answer,
            compression=None,
            max_size=_LARGEST_MESSAGE,
            logger=logger,
        )
    except OSError as error:
        raise InputError(f"The live view cannot listen on port {port}: {error.strerror or error}.") from None
    async with server:
        ready(f"http://{LOOPBACK}:{next(iter(server.sockets)).getsockname()[1]}/?token={token}")
        await pages.simulate(until)


def _is_own_mistake(record: logging.LogRecord) -> bool:
    error = record.exc_info[1] if record.exc_info else None
    return not isinstance(error, WebSocketException | EOFError | OSError)


class _Pages:
    """The pages that are connected."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._open: set[ServerConnection] = set()

    async def simulate(self, until: asyncio.Event | None) -> None:
        """Simulate in real time until the view ends; every page gets each frame, and each status that is new."""
        world, status, rate = self._world, "", 1.0
        due = last = time.monotonic()
        while until is None or not until.is_set():
            world.tick()
            if world.status() != status:
                status = world.status()
                broadcast(self._open, status)
            broadcast(self._open, np.array(world.frame(rate), dtype="<f4").tobytes())
            due = max(due + INTERVAL, time.monotonic() - _LATEST)
            await asyncio.sleep(max(0.0, due - time.monotonic()))
            now = time.monotonic()
            # what the last second or so should have taken, over what it took
            rate += INTERVAL * (INTERVAL / (now - last) - rate)
            last = now

    async def handle(self, connection: ServerConnection) -> None:
        """Serve one page."""
        with suppress(ConnectionClosed):
            await connection.send(self._world.status())
            self._open.add(connection)
            try:
                async for message in connection:
                    self._world.take(read_request(message))
            except InputError:
                await connection.close(1008, "an invalid request")
            finally:
                self._open.discard(connection)
