"""The messages in C and in the document are those of the package."""

from ballbot.control.records import Schema
from ballbot.link.header import HEADER, messages_header
from ballbot.link.messages import BODY_LENGTHS, MESSAGES, SCHEMAS, TO_HOST, TO_ROBOT, Layer, Sensors
from tests.support.paths import ROOT


def test_messages_in_the_sources_are_those_of_the_package():
    assert HEADER.read_text() == messages_header(), "run: python -m ballbot.link.header"


def direction(kind: int) -> str:
    if kind in TO_ROBOT:
        return "host to robot"
    if kind in TO_HOST:
        return "robot to host"
    return "to an emulated robot" if kind == Sensors.TYPE else "from an emulated robot"


def row(kind: int) -> str:
    """Return a message's row of docs/link.md."""
    fields = []
    for name, one in SCHEMAS[kind].fields.items():
        assert not isinstance(one, Schema)
        fields.append(name + (f"[{one.shape[0]}]" if one.shape else ""))
    name = MESSAGES[kind].__name__
    return f"| {kind} | `{name}` | {direction(kind)} | {BODY_LENGTHS[kind]} | {', '.join(fields)} |"


def test_document_lists_every_message_and_layer():
    page = (ROOT / "docs/link.md").read_text(encoding="utf-8")
    rows = "\n".join(map(row, MESSAGES))
    assert rows in page, rows
    for layer in Layer:
        assert f"\n| {layer.name.lower()} |" in page
    assert f"1 of {max(BODY_LENGTHS.values()) + 1} lengths" in page
    assert f"| {len(TO_ROBOT)} of 256 for the robot |" in page
