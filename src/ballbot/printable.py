r"""Text of others' making, as names of files, columns and robots, made fit to show: nothing in it is obeyed.

A terminal obeys control characters and escape sequences, and characters that turn the direction of writing make a name
look like another. All of them are shown as Python would write them, as in \x1b; so are the bytes of a file's name that
are no text.
"""

import json
import re
import shlex
from collections.abc import Sequence

#: control characters (C0 without tab and newline, DEL, C1), what turns or breaks lines, and what is no text
_OBEYED = "\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff"
_BLOCK = re.compile(f"[{_OBEYED}]")
_LINE = re.compile(f"[{_OBEYED}\t\n]")


def printable(text: str) -> str:
    """Return a text of one or more lines in which nothing is obeyed but tabs and newlines."""
    return _BLOCK.sub(_shown, text)


def printable_line(text: str) -> str:
    """Return a text in which nothing is obeyed, on one line."""
    return _LINE.sub(_shown, text)


def json_escaped(text: str) -> str:
    r"""Return JSON text with what a terminal would obey written as \u001b; equal to the text for those who parse it."""
    return _BLOCK.sub(lambda found: f"\\u{ord(found[0]):04x}", text)


def toml_string(text: str) -> str:
    """Return a text as a string of TOML, with a question mark for what is no Unicode."""
    return json_escaped(json.dumps(text.encode("utf-8", "replace").decode(), ensure_ascii=False))


def shell_line(words: Sequence[object]) -> str:
    """Return a command line that can be shown; a POSIX shell splits it into these words if all of them can be."""
    return printable_line(shlex.join(map(str, words)))


def _shown(found: re.Match[str]) -> str:
    character = found[0]
    code = ord(character)
    if 0xDC80 <= code <= 0xDCFF:  # a byte of a file's name, as Python holds it
        return f"\\x{code - 0xDC00:02x}"
    return (
        character.encode("unicode_escape", "backslashreplace").decode() if code < 0xD800 else f"\\u{code:04x}"
    )
