"""The messages as a header of the firmware, `firmware/c/link/ballbot_messages.h`: structs, numbers and names.

If a message changes, the C code that reads it must change too. Then write the header anew:

    python -m tests.support.link_header
"""

from dataclasses import replace
from enum import IntEnum

from ballbot.control.tuning import ROUNDING
from ballbot.files import write_text
from ballbot.firmware.header import SOURCES
from ballbot.link.frames import LONGEST_FRAME, LONGEST_PAYLOAD, OVERHEAD, SEQUENCE_WINDOW
from ballbot.link.messages import (
    BODY_LENGTHS,
    CONFIRMATION_TIME,
    LAYERS,
    LONGEST_RAMP,
    LONGEST_STATE_INTERVAL,
    MESSAGE_DIGEST,
    MESSAGE_WORDS,
    MESSAGES,
    PARAMETER_WORDS,
    SCHEMAS,
    TO_ROBOT,
    VERSION,
    WATCHDOG,
    AnswerResult,
    Capability,
    ControllerPlace,
    Layer,
)
from ballbot.records import Schema
from tests.support.firmware_headers import struct_text

HEADER = SOURCES / "link" / "ballbot_messages.h"
#: lengths that have a name in the header; a friction table's is as large as that of a part of the parameters
_NAMED = {
    "[BALLBOT_TABLE_SPEEDS]": "[BALLBOT_PARAMETER_WORDS]",
    "[9]": "[BALLBOT_LAYERS]",
    "weights[3]": "weights[BALLBOT_MAX_GAINS]",
}
_MICROSECONDS = 1e6


def messages_header() -> str:
    """Return the text of ballbot_messages.h."""
    structs = "\n".join(_struct(schema) for schema in SCHEMAS.values() if schema.fields)
    lengths = ", ".join(str(BODY_LENGTHS.get(kind, -1)) for kind in range(max(TO_ROBOT) + 1))
    types = _names("message", {one.__name__: kind for kind, one in MESSAGES.items()})
    return f"""\
/* What robot and host send each other.
 *
 * Generated from the messages of the Python package by `python -m tests.support.link_header`; do not edit.
 * A body has the bytes of its struct on a little-endian processor. A message without a struct has no body.
 * Units are SI and stand behind each member; [1] is a number without a unit.
 */
#ifndef BALLBOT_MESSAGES_H
#define BALLBOT_MESSAGES_H

#include "ballbot_types.h"

/* Version of the protocol, in every frame. */
#define BALLBOT_LINK_VERSION {VERSION}u
/* SHA-256 of types, names, order, lengths and units of all messages, as numbers of 31 bits. */
#define BALLBOT_MESSAGE_WORDS {{ {", ".join(map(str, MESSAGE_WORDS))} }}
/* {MESSAGE_DIGEST} */

/* Longest time without a valid frame [us]. */
#define BALLBOT_LINK_WATCHDOG {_MICROSECONDS * WATCHDOG:.0f}u
/* How long the number of the first step of arming is valid [us]. */
#define BALLBOT_LINK_CONFIRMATION {_MICROSECONDS * CONFIRMATION_TIME:.0f}u
/* Longest time between two states that a host can ask for [s]. */
#define BALLBOT_LINK_STATE_INTERVAL {LONGEST_STATE_INTERVAL:g}f
/* Longest ramp of the torque limit after arming [s]. */
#define BALLBOT_LINK_LONGEST_RAMP {LONGEST_RAMP:.1f}f
/* By how much the sum of a setting's weights may be off. */
#define BALLBOT_LINK_ROUNDING {ROUNDING:g}f
/* Bytes of a payload without a body, of the longest payload, and of its frame without the zero. */
#define BALLBOT_FRAME_OVERHEAD {OVERHEAD}u
#define BALLBOT_LONGEST_PAYLOAD {LONGEST_PAYLOAD}u
#define BALLBOT_LONGEST_FRAME {LONGEST_FRAME}u
/* How many sequence numbers after the last are newer than it. */
#define BALLBOT_SEQUENCE_WINDOW {SEQUENCE_WINDOW}u
/* Words that one message of parameters carries. */
#define BALLBOT_PARAMETER_WORDS {PARAMETER_WORDS}
/* Bytes of the body of each type that a host sends, from type 0 on; -1 is none. */
#define BALLBOT_BODY_LENGTHS {{ {lengths} }}
/* Checks of a frame that count what they refuse. */
#define BALLBOT_LAYERS {LAYERS}

/* Types of messages. */
{types}
/* Checks that a frame must pass, in order. */
{_names("layer", _members(Layer))}
/* Answers to a command. */
{_names("result", _members(AnswerResult))}
/* Which controller an armed robot obeys: its own or the host's. */
{_names("controller", _members(ControllerPlace))}
/* Bits of a robot's capabilities. */
{_names("capability", _members(Capability))}
{structs}
#endif
"""


def _struct(schema: Schema) -> str:
    """Return a message's struct, as ballbot_message_hello."""
    text = struct_text(replace(schema, name=f"Message{schema.name}"))
    for length, name in _NAMED.items():
        text = text.replace(length, name)
    return text


def _members(kind: type[IntEnum]) -> dict[str, int]:
    return {one.name: one.value for one in kind}


def _names(kind: str, values: dict[str, int]) -> str:
    """Return an enumeration, with names as BALLBOT_LAYER_FRAMING."""
    lines = ",\n".join(f"    BALLBOT_{kind.upper()}_{_upper(name)} = {one}" for name, one in values.items())
    return f"enum ballbot_{kind} {{\n{lines}\n}};\n"


def _upper(name: str) -> str:
    """Return a class's or an enumeration's name in capitals, words apart."""
    if name.isupper():
        return name
    return "".join(f"_{letter}" if letter.isupper() else letter.upper() for letter in name).lstrip("_")


if __name__ == "__main__":
    write_text(HEADER, messages_header())
