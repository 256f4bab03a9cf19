"""Messages of the link drawn at random, and streams of frames with faults, for property tests."""

import numpy as np
from cobs import cobs
from fastcrc import crc32
from hypothesis import strategies as st

from ballbot.link.frames import encode
from ballbot.link.messages import MESSAGES, SCHEMAS, Message
from ballbot.records import Number

_WHOLE = st.integers(-(2**31), 2**31 - 1)
_REAL = st.floats(width=32, allow_nan=False, allow_infinity=False)


@st.composite
def messages(draw) -> Message:
    """Draw any message, with numbers of any size that its types hold."""
    kind = draw(st.sampled_from(sorted(MESSAGES)))
    values = {}
    for name, one in SCHEMAS[kind].fields.items():
        assert isinstance(one, Number)
        size = int(np.prod(one.shape))
        drawn = draw(st.lists(_WHOLE if one.whole else _REAL, min_size=size, max_size=size))
        dtype = np.int32 if one.whole else np.float32
        values[name] = np.array(drawn, dtype=dtype).reshape(one.shape) if one.shape else drawn[0]
    return MESSAGES[kind](**values)


@st.composite
def faulty_streams(draw) -> bytes:
    """Draw frames, some of them cut, changed, repeated, or with other bytes between them."""
    stream = b""
    for number, message in enumerate(draw(st.lists(messages(), max_size=6))):
        frame = bytearray(encode(message, session=draw(st.integers(0, 2**32 - 1)), sequence=number))
        fault = draw(st.sampled_from(["none", "flip", "cut", "noise", "insert", "repeat", "resealed"]))
        place = draw(st.integers(0, len(frame) - 1))
        if fault == "flip":
            frame[place] ^= 1 << draw(st.integers(0, 7))
        elif fault == "cut":
            del frame[place : place + draw(st.integers(1, 300))]
        elif fault == "insert":
            frame[place:place] = draw(st.binary(min_size=1, max_size=300))
        elif fault == "noise":
            frame += draw(st.binary(max_size=300))
        elif fault == "repeat":
            frame += bytes(frame)
        elif fault == "resealed":  # one byte changed under a CRC-32 that fits: the layers after it
            changed = bytearray(cobs.decode(bytes(frame[:-1]))[:-4])
            changed[place % len(changed)] = draw(st.integers(0, 255))
            payload = bytes(changed)
            frame = bytearray(cobs.encode(payload + crc32.iso_hdlc(payload).to_bytes(4, "little")) + b"\0")
        stream += bytes(frame)
    return stream
