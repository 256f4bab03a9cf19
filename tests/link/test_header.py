"""The messages in C and in the document are those of the package."""

import re

from ballbot.link.messages import MESSAGES, TO_HOST, TO_ROBOT, Layer
from tests.support.link_header import HEADER, messages_header
from tests.support.paths import ROOT


def test_messages_in_the_sources_are_those_of_the_package():
    assert HEADER.read_text() == messages_header(), "run: python -m tests.support.link_header"


def test_document_includes_every_message_and_layer():
    page = (ROOT / "docs/link.md").read_text(encoding="utf-8")
    found = re.search(
        r"```\{literalinclude\} (\S+)\n:language: c\n:start-at: \"(.+)\"\n:end-before: \"(.+)\"\n```", page
    )
    assert found
    path, start, end = found.groups()
    assert (ROOT / "docs" / path).resolve() == HEADER.resolve()
    shown = start + HEADER.read_text().partition(start)[2].partition(end)[0]
    for one in MESSAGES.values():
        assert (
            f"BALLBOT_MESSAGE_{re.sub(r'(?<!^)(?=[A-Z])', '_', one.__name__).upper()} = {one.TYPE}" in shown
        )
    for layer in Layer:
        assert f"BALLBOT_LAYER_{layer.name} = {layer.value}" in shown
    assert all((kind < 32) == (kind in TO_ROBOT) and (kind > 33) == (kind in TO_HOST) for kind in MESSAGES)
