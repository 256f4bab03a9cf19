"""Text that is no plain table of numbers, and times that are no plain numbers, and how they become such.

Labelled rows, `roll:0.3,pitch:0.1`, as sketches print for a plotter, lose their labels, which are the names. A long
table has one value in a row, with a time and a topic; each topic becomes a column. A clock printed as two whole
numbers, "%d.%d", is no decimal number: 12.5000000 is 12 s and 5,000,000 ns, 12.005 s.
"""

import io
import re
from collections import Counter
from datetime import UTC, datetime
from importlib.metadata import version
from itertools import takewhile
from pathlib import Path
from typing import Literal

import numpy as np

from ballbot.arrays import Floats
from ballbot.errors import InputError
from ballbot.files import LARGEST_TABLE, read_text
from ballbot.log.columns import Columns

#: how pandas reads numbers to the last bit; since 3.1 without this option, which is deprecated
EXACT: Literal["round_trip"] | None = (
    "round_trip" if tuple(map(int, version("pandas").split(".")[:2])) < (3, 1) else None
)
#: lines examined for labels
_EXAMINED = 200
#: a name before a number; it begins with a letter, so that a time of day has none
_LABEL = re.compile(r"(?<![^\s,;])([^\W\d_][^,;\t:=]*?)\s*[:=]\s*(?=[-+.\d]|nan)")
#: the stamp that a serial monitor puts before a line, and whether a number follows
_STAMP = re.compile(r"^(\d\d:\d\d:\d\d\.\d+) -> (?=\s*([-+.\d]?))")
#: a number and the unit of a duration
_DURATION = re.compile(r"[-+]?[\d.]+ ?(s|secs?|seconds?|ms|us|µs|ns|mins?|hrs?|days?)\b")
#: columns of a long table: times, topic and value, and others such as a type
_LONG_WIDTHS = range(3, 9)


def without_labels(lines: list[str]) -> tuple[list[str], tuple[str, ...]]:
    """Return lines without the labels that most of the first ones have in common, and these; none of a plain table.

    The stamps of a serial monitor, 14:59:20.005 -> 1,2, become a column "time".
    """
    if 2 * sum(map(bool, map(_STAMP.match, lines[:_EXAMINED]))) > len(lines[:_EXAMINED]):
        mark = max(",;\t ", key=_STAMP.sub("", lines[min(len(lines), _EXAMINED) // 2]).count)
        lines = [_STAMP.sub(lambda stamp: (stamp[1] if stamp[2] else "time") + mark, line) for line in lines]
    seen = Counter(tuple(_LABEL.findall(line)) for line in lines[:_EXAMINED] if line.strip())
    labels, count = seen.most_common(1)[0] if seen else ((), 0)
    if len(labels) < 2 or len(set(labels)) < len(labels) or 2 * count <= seen.total():
        return lines, ()
    bare = [_LABEL.sub("", line) if tuple(_LABEL.findall(line)) == labels else line for line in lines]
    return bare, labels


def read_long_table(path: str | Path) -> Columns | None:
    """Return each topic of a long table as a column, at the times of the topic with the most values.

    The others have their latest value there. None if the text is not a long table.

    InputError if a topic has two values at one time.
    """
    text = read_text(path, largest=LARGEST_TABLE)
    first, second = [*text.split("\n", 2), ""][:2]
    mark = max(",;\t", key=first.count)
    if first.count(mark) + 1 not in _LONG_WIDTHS or not re.search(r"[^\W\d_]{2}", second):
        return None  # numbers alone
    from pandas import DataFrame, errors, read_csv

    try:
        decimal = "," if mark == ";" and "," in second else "."
        frame = read_csv(
            io.StringIO(text), sep=mark, decimal=decimal, float_precision=EXACT, low_memory=False
        )
    except errors.ParserError:
        return None
    for name in frame:
        if len(frame) and seconds_of(str(frame[name].iloc[0])) is not None:
            frame[name] = [seconds_of(str(cell)) for cell in frame[name]]
    *times, value = [*frame.select_dtypes("number")] or [""]
    words = {name: len(set(frame[name].dropna())) for name in frame.select_dtypes(exclude="number")}
    topic = min(
        (name for name in words if 1 < words[name] <= len(frame) / 3), key=words.__getitem__, default=None
    )
    if topic is None or not times or np.any(frame.groupby(topic)[times].diff().to_numpy() < 0.0):
        return None
    # in turns, or one after another, where the time starts again; a state has one value after the other
    changes = np.flatnonzero(frame[topic].to_numpy()[1:] != frame[topic].to_numpy()[:-1])
    if 2 * len(changes) < len(frame) and not np.all(np.diff(frame[times[0]])[changes] < 0.0):
        return None
    twice = np.flatnonzero(frame.duplicated([*times, topic]))
    if twice.size:
        raise InputError(
            f"{path} has a row for each value, and in row {twice[0] + 1} a second value of {frame[topic][twice[0]]} "
            "at the same time: export one run, with all digits of its times."
        )
    wide = DataFrame(
        frame.pivot(index=times, columns=topic, values=value), columns=frame[topic].dropna().unique()
    )
    most = wide.notna().to_numpy().sum(axis=0).argmax()
    # a path that all topics have in common is no part of their names
    parts = zip(*(re.split(r"(?<=[./])", str(name)) for name in wide.columns), strict=False)
    common = "".join(part[0] for part in takewhile(lambda part: len({*part}) == 1, parts))
    wide.columns = [str(name).removeprefix(common) for name in wide.columns]
    wide = wide.ffill().loc[wide.iloc[:, most].notna()].reset_index()
    return {str(name): wide[name].to_numpy(np.float64) for name in wide}


def unpadded_times(cells: list[str]) -> Floats | None:
    """Return the seconds (N,) of a clock that prints seconds, a point and a fraction as two whole numbers.

    The fraction is in ms, us or ns by its most digits; other cells become NaN. None if these are most, time goes back,
    or no second passes.
    """
    parts = [re.fullmatch(r"(\d+)\.(\d{1,9})", cell) for cell in cells]
    unit = 10.0 ** (3 * -(-max((len(part[2]) for part in parts if part), default=0) // 3))
    times = np.array([int(part[1]) + int(part[2]) / unit if part else np.nan for part in parts])
    known = times[np.isfinite(times)]
    passes = (
        2 * len(known) > len(cells) and bool((np.diff(known) >= 0.0).all()) and known[-1] >= known[0] // 1 + 1
    )
    return times if passes else None


def seconds_of(cell: str) -> float | None:
    """Return the seconds of a duration with its unit, of a date since 1970, or of a time since midnight; else None.

    Durations are as MATLAB and pandas write them: 0.010 sec, 0 days 00:00:00.01. Dates and times are as in ISO 8601,
    UTC without an offset: 2026-05-03 14:59:50.005 and 14:59:50.005.
    """
    if _DURATION.match(cell):
        from pandas import Timedelta

        try:
            return float(Timedelta(cell).total_seconds())
        except ValueError:
            return None
    if cell.count(":") < 2:
        return None
    try:
        moment = datetime.fromisoformat(cell if "-" in cell else f"1970-01-01T{cell.rjust(8, '0')}")
    except ValueError:  # such as a 13th month
        return None
    return moment.replace(tzinfo=moment.tzinfo or UTC).timestamp()
