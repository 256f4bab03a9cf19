"""Small damage to the content of a file or to a command line, the same for the same random numbers.

The mutations: a number of the wrong size, unit or kind, a replaced word, lines missing, doubled or out of order, a
truncated file, bytes that are not text.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from random import Random

#: replacements of a number
NUMBERS = (
    *(
        "0",
        "-0.0",
        "-1",
        "1",
        "2",
        "3.5",
        "1e-3",
        "0.005",
        "5e-9",
        "1e-300",
        "5e-324",
        "1e308",
        "-1e308",
        "1e400",
    ),
    *("nan", "-nan", "inf", "-inf", "1.7e9", "1.7e18", "1000", "2147483647", "2147483648", "-2147483649"),
    *(
        "9223372036854775807",
        "9223372036854775808",
        "18446744073709551616",
        "9" * 30,
        "9" * 5000,
        "1e5",
        "1_000",
    ),
    *(
        "0x7fffffff",
        "0b1",
        "true",
        "false",
        '""',
        "''",
        "[]",
        "{}",
        "[[]]",
        "NaN",
        "NA",
        "None",
        "-",
        "１２",
        "1,5",
    ),
)
#: replacements of a word, or insertions
WORDS = (
    *(
        "",
        " ",
        "\t",
        "\0",
        "\x1b[31m",
        "[/x]",
        "$\\frac$",
        "%s",
        "{}",
        "\\",
        '"',
        "'",
        "#",
        "=",
        "[",
        "]",
        "[[",
    ),
    *(
        "t",
        "x",
        "u1",
        "u9",
        "true_x",
        "é",
        "日本",
        "\ufeff",
        "\u202e",
        "a" * 300,
        "nan",
        "base",
        "name",
        "-",
        "--",
    ),
)
_NUMBER = re.compile(r"(?<![\w.])[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?(?![\w.])")
_WORD = re.compile(r"[A-Za-z_][A-Za-z_0-9]*")
#: bytes of a mutated file, at most
_LARGEST = 200_000
_CHANGES = (1, 1, 1, 2, 3, 4)


def mutated(content: bytes, random: Random) -> bytes:
    """Return a file's content with one to four things changed in it."""
    for _ in range(random.choice(_CHANGES)):
        content = random.choice(_OF_TEXT if random.random() < 0.8 and _is_text(content) else _OF_BYTES)(
            content, random
        )
    return content[:_LARGEST]


def mutated_arguments(arguments: Sequence[str], values: Sequence[str], random: Random) -> list[str]:
    """Return a command line with one to three of its words changed, removed, doubled or added."""
    changed = list(arguments)
    for _ in range(random.randint(1, 3)):
        place = random.randrange(len(changed) + 1)
        word = random.choice((*values, *values, *NUMBERS, *WORDS))
        match random.randrange(6):
            case 0 | 1 | 2 if place < len(changed) and place > 0:
                changed[place] = word
            case 3 if place < len(changed):
                del changed[place]
            case 4 if place > 0:
                changed.insert(place, word)
            case 5 if 0 < place < len(changed):
                other = random.randrange(1, len(changed))
                changed[place], changed[other] = changed[other], changed[place]
    # a zero byte is in no command line of an operating system
    return [word.replace("\0", "") for word in changed]


def _is_text(content: bytes) -> bool:
    try:
        return "\0" not in content.decode()
    except UnicodeDecodeError:
        return False


def _replaced(pattern: re.Pattern[str], by: Sequence[str], content: bytes, random: Random) -> bytes:
    text = content.decode(errors="replace")
    found = list(pattern.finditer(text))
    if not found:
        return content
    one = random.choice(found)
    return (text[: one.start()] + random.choice(by) + text[one.end() :]).encode()


def _number_replaced(content: bytes, random: Random) -> bytes:
    return _replaced(_NUMBER, NUMBERS, content, random)


def _number_scaled(content: bytes, random: Random) -> bytes:
    text = content.decode(errors="replace")
    found = list(_NUMBER.finditer(text))
    if not found:
        return content
    one = random.choice(found)
    scaled = float(one[0]) * random.choice((-1.0, 0.5, 2.0, 1e3, 1e-3, 1e6, 57.3, 1.0 + 1e-12))
    return (text[: one.start()] + repr(scaled) + text[one.end() :]).encode()


def _word_replaced(content: bytes, random: Random) -> bytes:
    words = _WORD.findall(content.decode(errors="replace"))
    return _replaced(_WORD, (*WORDS, *words), content, random)


def _lines_changed(content: bytes, random: Random) -> bytes:
    lines = content.split(b"\n")
    first = random.randrange(len(lines))
    end = min(len(lines), first + random.choice((1, 1, 1, 2, 10)))
    match random.randrange(4):
        case 0:
            del lines[first:end]
        case 1:
            lines[first:first] = lines[first:end]
        case 2:
            other = random.randrange(len(lines))
            lines[first], lines[other] = lines[other], lines[first]
        case _:
            lines[first] = b""
    return b"\n".join(lines)


def _separator_changed(content: bytes, random: Random) -> bytes:
    old, new = random.choice(
        (
            (b",", b";"),
            (b",", b"\t"),
            (b"\n", b"\r\n"),
            (b"\n", b"\r"),
            (b"=", b":"),
            (b".", b","),
            (b"\n", b""),
        )
    )
    return content.replace(old, new, random.choice((1, -1)))


def _inserted(content: bytes, random: Random) -> bytes:
    place = random.randrange(len(content) + 1)
    return content[:place] + random.choice((*WORDS, *NUMBERS)).encode() + content[place:]


def _encoded_otherwise(content: bytes, random: Random) -> bytes:
    text = content.decode(errors="replace")
    return text.encode(random.choice(("utf-16", "utf-8-sig", "latin-1", "utf-32")), "replace")


def _cut(content: bytes, random: Random) -> bytes:
    return content[: random.randrange(len(content) + 1)]


def _bytes_changed(content: bytes, random: Random) -> bytes:
    changed = bytearray(content)
    for _ in range(random.choice((1, 1, 2, 8)) if changed else 0):
        changed[random.randrange(len(changed))] = random.choice(
            (0, 1, 0x7F, 0x80, 0xFF, random.randrange(256))
        )
    return bytes(changed)


def _piece_moved(content: bytes, random: Random) -> bytes:
    """Copy a piece to another place, or many times, or take it away."""
    first = random.randrange(len(content) + 1)
    piece = content[first : first + random.choice((1, 4, 8, 64, 512))]
    place = random.randrange(len(content) + 1)
    match random.randrange(3):
        case 0:
            return content[:place] + piece + content[place:]
        case 1:
            return content[:place] + piece * random.choice((2, 10, 200)) + content[place:]
        case _:
            return content[:first] + content[first + len(piece) :]


_Mutation = Callable[[bytes, Random], bytes]
_OF_BYTES: tuple[_Mutation, ...] = (_cut, _bytes_changed, _bytes_changed, _bytes_changed, _piece_moved)
_OF_TEXT: tuple[_Mutation, ...] = (
    *(_number_replaced, _number_replaced, _number_replaced, _number_scaled, _number_scaled, _word_replaced),
    *(
        _word_replaced,
        _lines_changed,
        _lines_changed,
        _separator_changed,
        _inserted,
        _encoded_otherwise,
        _cut,
    ),
    *(_bytes_changed, _piece_moved),
)
