"""Files that are read: regular, of a bounded size, decoded; TOML and JSON of a bounded depth, with numbers that fit.

Every loader reads through here. A pipe or a device is refused before it is opened, a file's size is known before it
is read, and what a parser would drown in is counted before it is parsed.
"""

from __future__ import annotations

import codecs
import json
import os
import re
import stat
import tomllib
from pathlib import Path

from ballbot.errors import InputError
from ballbot.sizes import size_words

#: bytes of the largest table; as text it takes about six times as much memory
LARGEST_TABLE = 500_000_000
#: bytes of the largest file of settings (TOML) and of results (JSON)
LARGEST_SETTINGS, LARGEST_RESULTS = 1_000_000, 10_000_000
#: tables and lists within one another
DEEPEST = 32
#: parts of a dotted key, above what a sentence in a comment has
_LONGEST_KEY = 100
#: whole numbers of TOML are those of 64 bits
_LARGEST_WHOLE = 2**63
#: read of a file that does not say its size, as those in /proc [bytes]
_UNSAID = 1_000_000
_UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


def check_regular(path: str | Path) -> int:
    """Return the size of a regular file [bytes].

    Raises
    ------
    InputError
        If it is not there, or is a folder, a pipe or a device.
    """
    try:
        status = os.stat(path)
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}.") from None
    except ValueError:
        raise InputError(f"{str(path)!r} contains a zero byte and cannot be a file name.") from None
    if stat.S_ISDIR(status.st_mode):
        raise InputError(f"{path} cannot be read: Is a directory.")
    if not stat.S_ISREG(status.st_mode):
        kind = "a pipe" if stat.S_ISFIFO(status.st_mode) else "a device"
        raise InputError(f"{path} is {kind}, which may have no end; copy its content into a file first.")
    return status.st_size


def read_bytes(path: str | Path, *, largest: int = LARGEST_TABLE) -> bytes:
    """Return the content of a regular file.

    Raises
    ------
    InputError
        If it cannot be read or has more than `largest` bytes.
    """
    size = check_regular(path)
    if size <= largest:
        try:
            with open(path, "rb") as stream:
                content = stream.read(min(max(size, _UNSAID), largest) + 1)
        except OSError as error:
            raise InputError(f"{path} cannot be read: {error.strerror or error}.") from None
        if len(content) <= largest:
            return content
    raise InputError(f"{path} has {size_words(size)}; at most {size_words(largest)} are read.")


def read_text(path: str | Path, *, largest: int = LARGEST_TABLE) -> str:
    """Return the text of a file in UTF-8, without the mark that some editors set before it.

    Line ends are those of the file made "\\n".

    Raises
    ------
    InputError
        As `read_bytes`, and if it is no text in UTF-8.
    """
    return decoded(read_bytes(path, largest=largest), source=str(path))


def decoded(content: bytes, *, source: str, errors: str = "strict") -> str:
    """Return bytes as text in UTF-8, as `read_text` does; a refusal names `source`."""
    if content.startswith(_UTF_16):
        raise InputError(f"{source} is not a text file in UTF-8 but in UTF-16; save it as UTF-8.")
    try:
        text = content.decode("utf-8-sig", errors)
    except UnicodeDecodeError:
        raise InputError(f"{source} is not a text file in UTF-8.") from None
    return text.replace("\r\n", "\n").replace("\r", "\n")


def read_toml(path: str | Path) -> dict[str, object]:
    """Return the tables of a TOML file.

    Raises
    ------
    InputError
        As `read_text`, and as `parse_toml`.
    """
    return parse_toml(read_text(path, largest=LARGEST_SETTINGS), source=str(path))


def parse_toml(text: str, *, source: str) -> dict[str, object]:
    """Return the tables of a text in TOML; a refusal names `source`.

    Raises
    ------
    InputError
        If it is not TOML, is nested too deeply, or holds a whole number that does not fit 64 bits.
    """
    too_deep = f"{source} is nested too deeply; at most {DEEPEST} levels of tables or lists are read."
    if _longest_key(text) > _LONGEST_KEY:  # the parser's time grows with the square of a dotted key's parts
        raise InputError(too_deep)
    try:
        tree = tomllib.loads(text)
    except RecursionError:
        raise InputError(too_deep) from None
    except ValueError as error:  # TOMLDecodeError, or a whole number of thousands of digits
        raise InputError(f"{source} is not valid TOML: {_short(error)}.") from None
    _check_tree(tree, source)
    return tree


def read_json(path: str | Path) -> object:
    """Return what a JSON file holds.

    Raises
    ------
    InputError
        As `read_text`, and if it is not JSON or is nested too deeply.
    """
    text = read_text(path, largest=LARGEST_RESULTS)
    try:
        tree = json.loads(text)
    except RecursionError:
        raise InputError(f"{path} is nested too deeply to be read.") from None
    except ValueError as error:
        raise InputError(f"{path} is not valid JSON: {_short(error)}.") from None
    _check_tree(tree, str(path))
    return tree


def _longest_key(text: str) -> int:
    """Return how many parts the longest dotted key has, or what looks like one."""
    words = re.split(r"[\n,=\[\]{}#]", text.replace(" ", "").replace("\t", ""))
    return max((sum(map(bool, word.split("."))) for word in words if "." in word), default=0)


def _check_tree(tree: object, source: str) -> None:
    """Refuse depth and whole numbers beyond what the rest reckons with."""
    level = [("", tree)]
    for _ in range(DEEPEST + 1):
        below = []
        for place, value in level:
            if isinstance(value, dict):
                below += [(f"{place}.{key}" if place else str(key), one) for key, one in value.items()]
            elif isinstance(value, list):
                below += [(place, one) for one in value]
            elif isinstance(value, int) and abs(value) >= _LARGEST_WHOLE:
                raise InputError(f"{source}: {_short(place)} is a whole number too large for 64 bits.")
        level = below
    if level:
        raise InputError(
            f"{source} is nested too deeply; at most {DEEPEST} levels of tables or lists are read."
        )


def _short(words: object) -> str:
    text = str(words) if str(words).isprintable() else repr(str(words))
    return text if len(text) <= 200 else f"{text[:200]}..."
