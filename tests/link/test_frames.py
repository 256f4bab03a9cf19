"""Frames in Python: every message comes back, and each layer refuses what it should."""

from hypothesis import given, settings
from hypothesis import strategies as st

from ballbot.link.frames import LONGEST_FRAME, Frame, FrameReader, decode, encode, is_newer, message_of
from ballbot.link.messages import BODY_LENGTHS, MESSAGES, Layer, pack_body
from tests.support.link_messages import messages


@given(messages(), st.integers(0, 2**32 - 1), st.integers(0, 65535))
def test_every_message_comes_back(message, session, sequence):
    coded = encode(message, session=session, sequence=sequence)
    assert coded.count(0) == 1
    assert len(coded) <= LONGEST_FRAME + 1
    frame = decode(coded[:-1], MESSAGES)
    assert isinstance(frame, Frame)
    assert (frame.kind, frame.session, frame.sequence) == (message.TYPE, session, sequence)
    assert len(frame.body) == BODY_LENGTHS[message.TYPE]
    back = message_of(frame)
    assert not isinstance(back, Layer)
    assert pack_body(back) == pack_body(message)


@settings(max_examples=40)
@given(st.lists(messages(), max_size=4), st.data())
def test_frames_come_back_from_pieces_of_any_size(sent, data):
    stream = b"".join(encode(one, session=7, sequence=k) for k, one in enumerate(sent))
    reader, found = FrameReader(MESSAGES), []
    while stream:
        size = data.draw(st.integers(1, len(stream)))
        found += reader.feed(stream[:size])
        stream = stream[size:]
    assert [frame.kind for frame in found] == [one.TYPE for one in sent]
    assert not any([reader.counts.accepted, *reader.counts.refused])


@given(st.integers(0, 65535), st.integers(-70000, 70000))
def test_sequence_window_is_half_the_numbers(last, step):
    assert is_newer((last + step) % 65536, last) == (1 <= step % 65536 <= 32767)
