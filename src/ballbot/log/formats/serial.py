"""Text as the Arduino IDE shows and saves it: a clock before each line, and labels before the numbers.

    12:04:01.234 -> 10,0.03,-0.01        the serial monitor with time stamps
    roll:0.03 pitch:-0.01 enc1:12        the serial plotter, with blanks, commas or tabs between the pairs
    DATA roll=0.03 pitch=-0.01 enc1=12   the same with equal signs, or a word before the first label

`plain` removes the clock, which is when the computer received the line, and makes rows of numbers of the pairs. It
decides by a file's first lines; other text stays as it is. Lines stay lines, so that messages name the file's own.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from itertools import islice

_STAMP = re.compile(r"\s*\d{1,2}:\d\d:\d\d(?:[.,]\d+)?\s*->[ ]?")
_NUMBER = r"[-+]?(?:(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|nan|inf)"
_PAIR = re.compile(rf"""([^\W\d][^\s:=,;"']*)[ ]?[:=][ \t]*({_NUMBER})(?=[\s,;]|$)""", re.IGNORECASE)
#: a word of its own before the first label, as of a kind of message
_WORD = re.compile(r"[$#]?\w+[\s,;]+(?=[^\W\d][^\s:=,;]*[ ]?[:=])")
_BETWEEN = re.compile(r"[\s,;]*")
#: lines that decide, and the share of them that must be so: others are a sketch's first words
_EXAMINED, _MOST = 200, 0.5


@dataclass(frozen=True, kw_only=True)
class PlainText:
    """Lines without what the Arduino IDE adds."""

    lines: list[str]
    labels: tuple[str, ...] = ()  #: of the pairs of which the rows of numbers were made


def plain(lines: list[str]) -> PlainText:
    """Return lines without time stamps, and rows of numbers, separated by commas, of lines of labels and numbers."""
    if _mostly(lines, lambda line: bool(_STAMP.match(line))):
        lines = [_STAMP.sub("", line, count=1) for line in lines]
    if not _mostly(lines, lambda line: len(_pairs(line)) > 1):
        return PlainText(lines=lines)
    found = [_pairs(line) for line in lines]
    labels, _ = Counter(tuple(label for label, _ in one) for one in found if one).most_common(1)[0]
    rows = [
        ",".join(value for _, value in one) if tuple(label for label, _ in one) == labels else line
        for one, line in zip(found, lines, strict=True)
    ]
    return PlainText(lines=rows, labels=labels)


def _mostly(lines: list[str], fits: Callable[[str], bool]) -> bool:
    """Return whether most of the first lines that are not empty fit."""
    first = list(islice((line for line in lines if line.strip()), _EXAMINED))
    return bool(first) and sum(map(fits, first)) >= _MOST * len(first)


def _pairs(line: str) -> list[tuple[str, str]]:
    """Return the labels and numbers of which a line consists; none if it has anything else."""
    found, place = [], 0
    line = _WORD.sub("", line.strip(), count=1) if _WORD.match(line.strip()) else line.strip()
    while place < len(line):
        pair = _PAIR.match(line, place)
        if pair is None:
            return []
        found.append((pair.group(1), pair.group(2)))
        between = _BETWEEN.match(line, pair.end())
        place = between.end() if between else pair.end()
    return found
