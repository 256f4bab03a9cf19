"""Authenticated datagrams: one frame each, followed by a truncated HMAC-SHA-256 under the robot's key.

    frame | HMAC-SHA-256(key, direction | frame), the first 16 bytes

`direction` is one byte, so that nobody can send a robot its own frames back. A datagram that was recorded and is sent
again passes this check; its frame then fails at the session or the sequence number. The C source is
`firmware/c/link/datagram.c`.
"""

from __future__ import annotations

import hashlib
import hmac
from enum import Enum
from pathlib import Path

from ballbot.errors import InputError
from ballbot.files import read_text

#: bytes of the truncated HMAC
TAG = 16
#: bytes of the shortest and of the longest key
SHORTEST_KEY, LONGEST_KEY = 16, 64


class Direction(Enum):
    """Which way a datagram goes."""

    TO_ROBOT = b"R"
    TO_HOST = b"H"


def read_key(path: Path) -> bytes:
    """Return the key in a file: 32 to 128 hexadecimal digits.

    `python -c "import secrets; print(secrets.token_hex(32))"` makes one. The robot and the host have the same.

    Raises
    ------
    InputError
        If the file cannot be read or holds no such key.
    """
    try:
        key = bytes.fromhex(read_text(path).strip())
    except ValueError:
        key = b""
    if not SHORTEST_KEY <= len(key) <= LONGEST_KEY:
        raise InputError(
            f"{path} holds no key: it needs {2 * SHORTEST_KEY} to {2 * LONGEST_KEY} hexadecimal digits."
        )
    return key


def seal(key: bytes | None, frame: bytes, direction: Direction) -> bytes:
    """Return the datagram of a frame; without a key, the frame."""
    return frame if key is None else frame + _tag(key, frame, direction)


def unseal(key: bytes | None, datagram: bytes, direction: Direction) -> bytes | None:
    """Return the frame of a datagram, or None if it was not made with the key; without a key, the datagram."""
    if key is None:
        return datagram
    frame, tag = datagram[:-TAG], datagram[-TAG:]
    return frame if hmac.compare_digest(tag, _tag(key, frame, direction)) else None


def _tag(key: bytes, frame: bytes, direction: Direction) -> bytes:
    return hmac.new(key, direction.value + frame, hashlib.sha256).digest()[:TAG]
