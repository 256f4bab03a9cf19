"""The messages in C and in the document are those of the package."""

from tests.support.link_header import HEADER, messages_header


def test_messages_in_the_sources_are_those_of_the_package():
    assert HEADER.read_text() == messages_header(), "run: python -m tests.support.link_header"
