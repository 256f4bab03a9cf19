"""Frames: messages to bytes and back, with every check that a frame must pass.

On the wire a frame is COBS(payload) and a zero byte. The payload is, little-endian,

    version u8 | type u8 | session u32 | sequence u16 | body | CRC-32 of all before u32

The C sources are `firmware/c/link/cobs.c`, `crc32.c` and `frames.c`; they refuse the same bytes at the same layers.
COBS and CRC-32 (the one of zlib, ISO-HDLC) come from the libraries cobs and fastcrc.
"""

import struct
from collections.abc import Mapping
from dataclasses import dataclass, field

from cobs import cobs
from fastcrc import crc32

from ballbot.link.messages import (
    BODY_LENGTHS,
    LAYERS,
    VERSION,
    Layer,
    Message,
    finite,
    pack_body,
    unpack_body,
)

_HEADER = struct.Struct("<BBIH")
_CRC = struct.Struct("<I")
#: bytes of a payload without a body
OVERHEAD = _HEADER.size + _CRC.size
#: of the longest payload
LONGEST_PAYLOAD = OVERHEAD + max(BODY_LENGTHS.values())
#: of the longest frame without its zero: COBS adds a byte to each 254
LONGEST_FRAME = LONGEST_PAYLOAD + LONGEST_PAYLOAD // 254 + 1
#: how many sequence numbers after the last are newer than it
SEQUENCE_WINDOW = 32767


@dataclass(frozen=True, kw_only=True)
class Frame:
    """A frame that has passed all layers up to the length of its type."""

    kind: int  #: type of the message
    session: int
    sequence: int
    body: bytes


@dataclass
class LayerCounts:
    """How many frames were accepted, and how many each layer refused."""

    accepted: int = 0
    refused: list[int] = field(default_factory=lambda: [0] * LAYERS)

    def refuse(self, layer: Layer) -> None:
        """Count a frame that a layer refuses."""
        self.refused[layer] += 1


def encode(
    message: Message,
    *,
    session: int,  # from 0 to 2^32 - 1
    sequence: int,  # modulo 2^16
) -> bytes:
    """Return the frame of a message, with its zero byte."""
    payload = _HEADER.pack(VERSION, message.TYPE, session, sequence % 65536) + pack_body(message)
    return cobs.encode(payload + _CRC.pack(crc32.iso_hdlc(payload))) + b"\0"


def decode(
    coded: bytes,  # without the zero
    kinds: Mapping[int, object],  # the types that this side takes
) -> Frame | Layer:
    """Return the frame in the bytes between two zeros, or the layer that refuses it."""
    try:
        payload = cobs.decode(coded)
    except cobs.DecodeError:
        return Layer.FRAMING
    if not OVERHEAD <= len(payload) <= LONGEST_PAYLOAD:
        return Layer.LENGTH
    (crc,) = _CRC.unpack(payload[-_CRC.size :])
    if crc32.iso_hdlc(payload[: -_CRC.size]) != crc:
        return Layer.CHECKSUM
    version, kind, session, sequence = _HEADER.unpack_from(payload)
    if version != VERSION:
        return Layer.VERSION
    if kind not in kinds:
        return Layer.TYPE
    body = payload[_HEADER.size : -_CRC.size]
    if len(body) != BODY_LENGTHS[kind]:
        return Layer.BODY
    return Frame(kind=kind, session=session, sequence=sequence, body=body)


class FrameReader:
    """Bytes in, frames out; keeps the beginning of a frame until its zero comes."""

    def __init__(
        self,
        kinds: Mapping[int, object],  # the types that this side takes
        counts: LayerCounts | None = None,  # in which refused frames are counted
    ) -> None:
        self.kinds = kinds
        self.counts = counts or LayerCounts()
        self._kept = bytearray()
        self._too_long = False

    def feed(self, data: bytes) -> list[Frame]:
        """Take bytes and return the frames that they complete."""
        frames = []
        *whole, rest = bytes(data).split(b"\0")
        for part in whole:
            frame = self._complete(part)
            if isinstance(frame, Frame):
                frames.append(frame)
            elif frame is not None:
                self.counts.refuse(frame)
        self._keep(rest)
        return frames

    def _keep(self, part: bytes) -> None:
        """Keep the bytes of a frame, unless it is too long already."""
        self._too_long = self._too_long or len(self._kept) + len(part) > LONGEST_FRAME
        self._kept += b"" if self._too_long else part

    def _complete(self, part: bytes) -> Frame | Layer | None:
        """Return the frame whose last bytes these are, or the layer that refuses it; None if it is empty."""
        self._keep(part)
        coded, too_long = bytes(self._kept), self._too_long
        self._kept, self._too_long = bytearray(), False
        if too_long:
            return Layer.LENGTH
        return decode(coded, self.kinds) if coded else None


def is_newer(sequence: int, last: int) -> bool:
    """Return whether a sequence number comes after the last one: by 1 to `SEQUENCE_WINDOW`, modulo 2^16."""
    return 1 <= (sequence - last) % 65536 <= SEQUENCE_WINDOW


def message_of(frame: Frame) -> Message | Layer:
    """Return the message of a frame, or `Layer.VALUES` if a number is not finite."""
    message = unpack_body(frame.kind, frame.body)
    return message if finite(message) else Layer.VALUES
