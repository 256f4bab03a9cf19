"""Transports: bytes to and from a robot over a serial port or UDP.

    /dev/ttyACM0?baud=921600     a serial port
    udp://127.0.0.1:5005         a robot, or a bridge to one, that listens for datagrams

A transport promises nothing: bytes may be lost, repeated, changed or late. Frames find that out.

UDP goes to this computer itself unless a key is given. With a key every datagram carries a truncated HMAC-SHA-256, and
one without it is dropped; see `ballbot.link.datagram`.
"""

from __future__ import annotations

import ipaddress
import os
import select
import socket
from typing import Protocol
from urllib.parse import parse_qs, urlsplit

import serial

from ballbot.errors import InputError
from ballbot.link.datagram import Direction, seal, unseal

DEFAULT_BAUD = 921600
#: for the other end of a stream to take bytes, before it counts as gone [s]
_WRITE_PATIENCE = 20.0
_LARGEST_READ = 65536


class Transport(Protocol):
    """Bytes to and from a robot."""

    def read(self, timeout: float) -> bytes:
        """Return what has come; wait for it at most `timeout` [s], then return b""."""
        ...

    def write(self, data: bytes) -> None:
        """Send bytes."""
        ...

    def close(self) -> None:
        """Close the connection."""
        ...


class LinkError(InputError):
    """The link to a robot failed; the text is one sentence."""


def open_transport(address: str, *, key: bytes | None = None) -> Transport:
    """Open the transport of an address.

    Parameters
    ----------
    address : str
        "udp://HOST:PORT", or a serial port with "?baud=N" if it is not 921600.
    key : bytes, optional
        That this robot's datagrams are signed with; needed for UDP to another computer.

    Raises
    ------
    InputError
        If the address is not valid, or UDP to another computer has no key.
    LinkError
        If the transport cannot be opened.
    """
    if urlsplit(address).scheme == "udp":
        host, port = _host_and_port(address)
        return UdpTransport(host, port, key=key)
    path, _, query = address.partition("?")
    baud = parse_qs(query).get("baud", [str(DEFAULT_BAUD)])[0]
    if not path or not baud.isdecimal() or int(baud) == 0:
        raise InputError(f"{address!r} is no serial port; write it as /dev/ttyACM0?baud={DEFAULT_BAUD}.")
    return SerialTransport(path, baud=int(baud))


def _host_and_port(address: str) -> tuple[str, int]:
    parts = urlsplit(address)
    try:
        host, port = parts.hostname, parts.port
    except ValueError:
        host, port = None, None
    if not host or not port:
        raise InputError(f"{address!r} needs a host and a port, as in udp://127.0.0.1:5005.")
    return host, port


class SerialTransport:
    """A serial port.

    Parameters
    ----------
    port : str
        "/dev/ttyACM0", "COM3", or a URL of pyserial.
    baud : int
        Bits a second.

    Raises
    ------
    LinkError
        If the port cannot be opened.
    """

    def __init__(self, port: str, *, baud: int = DEFAULT_BAUD) -> None:
        try:
            self._port = serial.serial_for_url(port, baudrate=baud, timeout=0.0, write_timeout=0.1)
        except (serial.SerialException, ValueError) as problem:
            reason = os.strerror(problem.errno) if isinstance(problem, OSError) and problem.errno else problem
            raise LinkError(f"The serial port {port} cannot be opened: {reason}.") from None

    def read(self, timeout: float) -> bytes:
        """Return what has come; wait for it at most `timeout` [s], then return b""."""
        try:
            if self._port.timeout != timeout:
                self._port.timeout = timeout  # looks at all of the port's settings
            first = self._port.read(1) if timeout > 0.0 and not self._port.in_waiting else b""
            return first + self._port.read(self._port.in_waiting)
        except (serial.SerialException, OSError) as problem:
            raise LinkError(f"The serial port has gone: {problem}") from None

    def write(self, data: bytes) -> None:
        """Send bytes."""
        try:
            self._port.write(data)
        except serial.SerialTimeoutException:
            return  # what does not fit is lost, as on any link
        except (serial.SerialException, OSError) as problem:
            raise LinkError(f"The serial port has gone: {problem}") from None

    def close(self) -> None:
        """Close the port."""
        self._port.close()


class SocketTransport:
    """A connected stream of bytes, such as one end of a pair of sockets.

    Parameters
    ----------
    connected : socket.socket
    name : str
        What is connected, for messages.
    """

    def __init__(self, connected: socket.socket, *, name: str = "connection") -> None:
        self._socket, self._name = connected, name
        self._socket.settimeout(_WRITE_PATIENCE)

    def read(self, timeout: float) -> bytes:
        """Return what has come; wait for it at most `timeout` [s], then return b""."""
        if not _readable(self._socket, timeout):
            return b""
        try:
            data = self._socket.recv(_LARGEST_READ)
        except OSError as problem:
            raise LinkError(f"The {self._name} has gone: {problem}") from None
        if not data:
            raise LinkError(f"The {self._name} has gone: it has closed the line.")
        return data

    def write(self, data: bytes) -> None:
        """Send bytes."""
        try:
            self._socket.sendall(data)
        except OSError as problem:
            raise LinkError(f"The {self._name} has gone: {problem}") from None

    def close(self) -> None:
        """Close the connection."""
        self._socket.close()


class UdpTransport:
    """Datagrams to and from one robot; those of other addresses are dropped by the system.

    Parameters
    ----------
    host : str
    port : int
    key : bytes, optional
        Signs every datagram; needed unless the host is this computer.

    Raises
    ------
    InputError
        If the host is another computer and there is no key.
    LinkError
        If the host is not known.
    """

    def __init__(self, host: str, port: int, *, key: bytes | None = None) -> None:
        self._socket, peer = datagram_socket(host, port, key=key)
        self._key = key
        self.refused = 0  #: datagrams that the key did not sign
        self._socket.connect(peer)

    def read(self, timeout: float) -> bytes:
        """Return what has come; wait for it at most `timeout` [s], then return b""."""
        if not _readable(self._socket, timeout):
            return b""
        try:
            datagram = self._socket.recv(_LARGEST_READ)
        except OSError:
            return b""  # nobody listens at the other end, yet
        frame = unseal(self._key, datagram, Direction.TO_HOST)
        self.refused += frame is None
        return frame or b""

    def write(self, data: bytes) -> None:
        """Send bytes, a whole frame, as one datagram."""
        try:
            self._socket.send(seal(self._key, data, Direction.TO_ROBOT))
        except OSError:
            return  # lost, as any datagram may be

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


def datagram_socket(host: str, port: int, *, key: bytes | None) -> tuple[socket.socket, tuple[object, ...]]:
    """Return a socket for datagrams that never waits, and the address of a host, which it is not bound or connected to.

    Raises
    ------
    InputError
        If the address is not loopback and there is no key.
    LinkError
        If the host is not known.
    """
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
    except OSError as problem:
        raise LinkError(f"The host {host!r} is not known: {problem}") from None
    if key is None and not is_loopback(str(address[0])):
        raise InputError(
            f"{host} is not this computer alone: its datagrams must be signed. Give the robot's key."
        )
    found = socket.socket(family, kind, protocol)
    found.setblocking(False)
    return found, address


def is_loopback(address: str) -> bool:
    """Return whether a numerical address is this computer's own."""
    return ipaddress.ip_address(address.partition("%")[0]).is_loopback


def _readable(one: socket.socket, timeout: float) -> bool:
    """Return whether there is something to read within `timeout` [s]."""
    return bool(select.select([one], [], [], timeout)[0])
