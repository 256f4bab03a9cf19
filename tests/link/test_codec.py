"""Frames and messages: Python's come back whole, and C has the same bytes, frames, refusals and structs.

Python's COBS and CRC are those of libraries.
"""

import ctypes
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ballbot.firmware.build import compile_sources, compilers, source_files
from ballbot.link.frames import (
    LONGEST_FRAME,
    LONGEST_PAYLOAD,
    FrameReader,
    LayerCounts,
    encode,
    message_of,
)
from ballbot.link.messages import LAYERS, MESSAGES, Layer, pack_body
from tests.support.link_header import HEADER, messages_header
from tests.support.link_messages import faulty_streams, messages

needs_compiler = pytest.mark.skipif(not compilers(), reason="no C compiler (gcc, clang or the ziglang wheel)")
NUMBERS = [(name, "<u4") for name in ("type", "session", "sequence", "length")]
FOUND = np.dtype([*NUMBERS, ("body", "u1", LONGEST_PAYLOAD)])


@pytest.fixture(scope="module")
def codec(tmp_path_factory) -> ctypes.CDLL:
    """Return the codec in C, compiled."""
    path = tmp_path_factory.mktemp("codec") / "codec.so"
    sources = [*source_files(), Path(__file__).parent / "codec.c"]
    compile_sources(path, sources, flags=("-O2", "-fPIC", "-shared"))
    functions = ctypes.CDLL(str(path))
    for name in ("decode_stream", "encode_frame"):
        getattr(functions, name).restype = ctypes.c_size_t
    return functions


def test_messages_in_the_sources_are_those_of_the_package():
    assert HEADER.read_text() == messages_header(), "run: python -m tests.support.link_header"


@given(st.lists(messages(), max_size=4), st.integers(0, 2**32 - 1), st.data())
def test_messages_come_back_from_pieces_of_any_size(sent, session, data):
    coded = [encode(message, session=session, sequence=65534 + k) for k, message in enumerate(sent)]
    assert all(frame.count(0) == 1 and len(frame) <= LONGEST_FRAME + 1 for frame in coded)
    stream, reader, frames = b"".join(coded), FrameReader(MESSAGES), []
    while stream:
        length = data.draw(st.integers(1, len(stream)))
        frames += reader.feed(stream[:length])
        stream = stream[length:]
    assert [(frame.kind, frame.session, frame.sequence) for frame in frames] == [
        (message.TYPE, session, (65534 + k) % 65536) for k, message in enumerate(sent)
    ]
    assert [pack_body(message_of(frame)) for frame in frames] == [pack_body(message) for message in sent]
    assert not any([reader.counts.accepted, *reader.counts.refused])


def size(count: int) -> ctypes.c_size_t:
    return ctypes.c_size_t(count)


@needs_compiler
@given(messages(), st.integers(0, 2**32 - 1), st.integers(0, 65535))
def test_frame_in_c_is_the_frame_in_python(codec, message, session, sequence):
    room, body = ctypes.create_string_buffer(LONGEST_FRAME + 1), pack_body(message)
    count = codec.encode_frame(message.TYPE, ctypes.c_uint32(session), sequence, body, size(len(body)), room)
    assert room.raw[:count] == encode(message, session=session, sequence=sequence)


@needs_compiler
@settings(max_examples=100)
@given(st.one_of(faulty_streams(), st.binary(max_size=2000)))
def test_receiver_in_c_finds_and_refuses_what_python_does(codec, stream):
    found, refused = np.zeros(200, FOUND), np.zeros(LAYERS, dtype=np.uint32)
    # more frames than that would be too short for their bytes
    assert len(stream) < 200 * 13
    places = (ctypes.c_void_p(array.ctypes.data) for array in (found, refused))
    count = codec.decode_stream(stream, size(len(stream)), *places)
    counts = LayerCounts()
    assert not FrameReader({}, counts).feed(stream)  # no type is taken: what passes is refused there
    assert refused[: Layer.TYPE].tolist() == counts.refused[: Layer.TYPE]
    assert count == counts.refused[Layer.TYPE]
