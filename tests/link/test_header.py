"""The messages' header in the sources is that of the messages."""

from ballbot.link.header import HEADER, messages_header


def test_messages_in_the_sources_are_those_of_the_package():
    assert HEADER.read_text() == messages_header(), "run: python -m ballbot.link.header"
