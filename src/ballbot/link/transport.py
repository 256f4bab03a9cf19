"""Transports: bytes to and from a robot over a serial port, as /dev/ttyACM0?baud=921600.

A transport promises nothing: bytes may be lost, repeated, changed or late. Frames find that out.
"""

import os
from typing import Protocol
from urllib.parse import parse_qs

import serial

from ballbot.errors import InputError

DEFAULT_BAUD = 921600


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


class SerialTransport:
    """A serial port: "/dev/ttyACM0", "COM3" or a URL of pyserial, with "?baud=N" if it is not 921600.

    InputError if the address is not valid. LinkError if the port cannot be opened.
    """

    def __init__(self, address: str) -> None:
        port, _, query = address.partition("?")
        baud = parse_qs(query).get("baud", [str(DEFAULT_BAUD)])[0]
        if not port or not baud.isdecimal() or int(baud) == 0:
            raise InputError(f"{address!r} is no serial port; write it as /dev/ttyACM0?baud={DEFAULT_BAUD}.")
        try:
            self._port = serial.serial_for_url(port, baudrate=int(baud), timeout=0.0, write_timeout=0.1)
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
