"""Files as others write them: clocks and dialects that are no plain table of numbers, each with a sound twin.

A kind makes, from a random generator, a file of it and its twin: a plain file that looks like it and must be read as
it stands. A file's `t` and `columns` are what Ballbot must read; a file with a `refusal` must be refused by a sentence
that has these words.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.log.formats import read_columns
from ballbot.log.mapping_search.motion import Stated
from ballbot.log.proposal import propose
from ballbot.log.row_order import rows_with_times
from ballbot.robot import Robot

Floats = NDArray[np.float64]
Random = np.random.Generator
#: names of roll, pitch, yaw, an encoder and a current, as teams write them
NAMES = (
    ("rollDeg", "pitchDeg", "yawDeg", "encoder{}", "motor_current{}_A"),
    ("imu.roll_deg", "imu.pitch_deg", "imu.yaw_deg", "motor.enc{}", "motor.cur{}_A"),
    ("RollDeg", "PitchDeg", "YawDeg", "Ticks{}", "Amps{}"),
)
#: an epoch as hosts stamp rows [s]
EPOCH = 1_700_000_000


@dataclass(frozen=True, kw_only=True, eq=False)
class Foreign:
    """A file's text, and what must be read of it."""

    text: str
    t: Floats  #: (N,) [s], from any start
    columns: dict[str, Floats]  #: by name, without the time
    refusal: str = ""
    names: tuple[str, ...] | None = None  #: given as --columns
    tolerance: float = 1e-6  #: of the times [s], beside that of the epoch


Pair = tuple[Foreign, Foreign]


def motion(random: Random, rows: int = 400) -> tuple[Floats, dict[str, Floats]]:
    """Return even times (N,) [s] and columns of a robot that sways, named by one of `NAMES`."""
    interval = random.choice([0.005, 0.008, 0.01, 0.0125])
    t = interval * np.arange(rows)
    roll, pitch, yaw, encoder, current = NAMES[random.integers(len(NAMES))]

    def swaying(size: float, digits: int) -> Floats:
        phases = random.uniform(0.0, 2.0 * np.pi, 3)
        waves = sum(np.sin(2.0 * np.pi * (0.4 + 0.5 * k) * t + phase) for k, phase in enumerate(phases))
        return np.round(size * np.asarray(waves), digits)

    columns = {roll: swaying(1.0, 3), pitch: swaying(1.0, 3), yaw: swaying(3.0, 3)}
    columns |= {encoder.format(k): swaying(3000.0, 0) for k in (1, 2, 3)}
    return t, columns | {current.format(k): swaying(0.4, 3) for k in (1, 2, 3)}


def lines_of(columns: Mapping[str, Sequence[str]], mark: str = ",") -> list[str]:
    """Return the header and the rows of columns of cells."""
    return [mark.join(columns), *map(mark.join, zip(*columns.values(), strict=True))]


def cells(values: Floats) -> list[str]:
    """Return numbers as programs print them."""
    return [f"{value:.10g}" for value in values]


def plain(
    t: Floats, columns: dict[str, Floats], time: str = "time_s", stamps: list[str] | None = None
) -> Foreign:
    """Return a plain table with a column of times, whose cells may be given."""
    table = {time: stamps or cells(t), **{name: cells(values) for name, values in columns.items()}}
    return Foreign(text="\n".join(lines_of(table)) + "\n", t=t, columns=columns)


def two_columns(random: Random) -> Pair:
    """Whole seconds and their fraction; the twin has the duration of each loop in the fraction's unit."""
    t, columns = motion(random)
    start = EPOCH + random.uniform(0.0, 1.0)
    names = [("secs", "nsecs"), ("header.stamp.secs", "header.stamp.nsecs"), ("tv_sec", "tv_usec"),
             ("sec", "nanosec"), ("time_s", "time_us"), ("sec", "msec")][random.integers(6)]  # fmt: skip
    digits = {"n": 9, "u": 6, "m": 3}[names[1].rpartition(".")[2].replace("stamp_", "").split("_")[-1][0]]
    counted = [round((start + moment) * 10**digits) for moment in t]
    seconds = [str(count // 10**digits) for count in counted]
    file = plain(t, columns, names[0], seconds)
    fractions = [str(count % 10**digits) for count in counted]
    rows = [line.split(",", 1) for line in file.text.splitlines()]
    text = "\n".join(
        f"{first},{part},{rest}" for (first, rest), part in zip(rows, [names[1], *fractions], strict=True)
    )
    loop = np.round(random.uniform(3.0, 5.0, len(t)))
    return replace(file, text=text, tolerance=1.1 * 10.0**-digits), plain(t, columns | {"loop_ms": loop})


def unpadded(random: Random) -> Pair:
    """Seconds, a point and a whole number of ns, us or ms; the twin has the leading zeros."""
    t, columns = motion(random)
    digits = int(random.choice([3, 6, 9]))
    counted = [round((EPOCH + 0.4 + moment) * 10**digits) for moment in t]
    bare, padded = (
        [f"{count // 10**digits}.{count % 10**digits:0{width}d}" for count in counted]
        for width in (1, digits)
    )
    tolerance = 1.1 * 10.0**-digits
    return tuple(replace(plain(t, columns, "stamp", one), tolerance=tolerance) for one in (bare, padded))  # pyright: ignore


def bursts(random: Random) -> Pair:
    """Rows stamped as they arrive, several at a time; the twin has runs with pauses between them."""
    t, columns = motion(random)
    h, size = t[1], int(random.integers(4, 16))
    t, columns = (
        t[: 400 // size * size],
        {name: values[: 400 // size * size] for name, values in columns.items()},
    )
    of_burst = np.arange(len(t)) // size
    late = random.uniform(0.0, 0.3 * size * h, of_burst[-1] + 1)
    arrival = (
        (of_burst + 1) * size * h
        + late[of_burst]
        + np.arange(len(t)) % size * random.choice([0.0, 5e-5, 2e-4])
    )
    come = of_burst != (random.integers(2, of_burst[-1] - 2) if random.integers(2) else -1)  # one may be lost
    file = plain(
        t[come], {name: values[come] for name, values in columns.items()}, "time_s", cells(arrival[come])
    )
    file = replace(file, tolerance=0.5 * size * h)
    moments, moving = motion(random, 400 * int(random.integers(8, 20)))
    recorded = np.arange(len(moments)) // size % (len(moments) // 400) == 0
    return file, plain(moments[recorded], {name: values[recorded] for name, values in moving.items()})


def few_digits(random: Random) -> Pair:
    """The time since 1970 in 32 bits, or printed with six digits; the twin has all digits."""
    t, columns = motion(random)
    stamps = EPOCH + t
    lost = (
        [f"{one:.10g}" for one in stamps.astype(np.float32)]
        if random.integers(2)
        else [f"{one:g}" for one in stamps]
    )
    file = replace(plain(t, columns, "timestamp", lost), refusal="digits were lost")
    return file, plain(t, columns, "timestamp", [f"{one:.6f}" for one in stamps])


def misnamed(random: Random) -> Pair:
    """Microseconds or milliseconds in a column named _s; the twin is named after its unit."""
    t, columns = motion(random)
    unit, scale = [("us", 1e6), ("ms", 1e3)][random.integers(2)]
    stamps = [f"{one:.0f}" if unit == "us" else f"{one:.1f}" for one in scale * (t + 5.0)]
    file = replace(plain(t, columns, "time_s", stamps), refusal=f'unit = "{unit}"')
    return file, plain(t, columns, f"time_{unit}", stamps)


def durations(random: Random) -> Pair:
    """Durations with their unit in each cell; the twin has a number, and a word in each row."""
    t, columns = motion(random)
    form = int(random.integers(4))
    stamps = [
        (f"{one:.4f} sec", f"{1e3 * one:.1f} ms", f"0 days 00:00:{one:09.6f}", f"00:00:{one:07.4f}")[form]
        for one in t
    ]
    twin = plain(t, columns)
    lines = twin.text.splitlines()
    text = "\n".join(
        [f"{lines[0]},state", *(f"{line},{random.choice(['3 laps', 'idle'])}" for line in lines[1:])]
    )
    return plain(t, columns, "Time", stamps), replace(twin, text=text)


def few_of_a_run(random: Random) -> Pair:
    """A clock that starts again all the time; the twin starts again once, and its longer run is read."""
    t, columns = motion(random)
    size = int(random.integers(12, 40))
    again = np.arange(len(t)) % size * t[1] + 0.5
    first = int(random.integers(60, 150))
    run = np.concatenate([t[:first], t[: len(t) - first]])
    file = replace(plain(t, columns, "time_s", cells(again)), refusal="are one run")
    twin = plain(run, columns)
    longer = {name: values[first:] for name, values in columns.items()}
    return file, replace(twin, t=run[first:], columns=longer)


def labelled(random: Random) -> Pair:
    """The names before the numbers in every row; the twin has a time of day and names with a colon."""
    t, columns = motion(random)
    mark, sign = [(",", ":"), ("\t", ":"), (" ", "="), (", ", ": "), (";", "=")][random.integers(5)]
    table = {"time_s": t, **columns}
    rows = zip(*map(cells, table.values()), strict=True)
    lines = [mark.join(f"{name}{sign}{cell}" for name, cell in zip(table, row, strict=True)) for row in rows]
    begun = ["Connected to COM3", ""][: random.integers(3)]
    file = Foreign(text="\n".join([*begun, *lines]) + "\n", t=t, columns=columns)
    stamps = [f"14:59:{one + 20.0:09.6f}" for one in t]
    of_robot = {f"imu:{name}" if "." not in name else name: values for name, values in columns.items()}
    return file, plain(t, of_robot, "time", stamps)


def two_labels(random: Random) -> Pair:
    """Labelled rows of an IMU and of motors in turns; the twin has one kind of rows."""
    t, columns = motion(random)
    table = {"time_s": t, **columns}
    groups = [["time_s", *list(columns)[:3]], ["time_s", *list(columns)[3:]]]
    rows = [
        " ".join(f"{name}:{table[name][k]:.10g}" for name in group) for k in range(len(t)) for group in groups
    ]
    file = Foreign(text="\n".join(rows), t=t, columns=columns, refusal="labels")
    whole = [" ".join(f"{name}:{values[k]:.10g}" for name, values in table.items()) for k in range(len(t))]
    return file, Foreign(text="\n".join(whole), t=t, columns=columns)


def stamped(random: Random) -> Pair:
    """Rows that a serial monitor has stamped, 14:59:20.005 -> 1,2; the twin has an arrow in the first line alone."""
    t, columns = motion(random)
    header, *rows = lines_of({name: cells(values) for name, values in columns.items()})
    stamps = [f"14:59:{20.0 + one:06.3f}" for one in np.round(t, 3)]
    lines = [header, *(f"{stamp} -> {row}" for stamp, row in zip(stamps, rows, strict=True))]
    lines[0] = f"14:59:19.990 -> {header}"
    file = Foreign(text="\n".join(lines), t=t, columns=columns, tolerance=6e-4)
    twin = plain(t, columns)
    return file, replace(twin, text=f"14:59:19 -> connected\n{twin.text}")


def long(random: Random) -> Pair:
    """A row for each value, with its topic, in turns or one topic after the other; the twin has a state in words."""
    t, columns = motion(random)
    columns = {name.replace("imu.", "").replace("motor.", ""): values for name, values in columns.items()}
    path = str(random.choice(["", "/log.", "/robot/state/"]))
    slow = list(columns)[2] if random.integers(2) else ""
    rows = [
        (k, f"{t[k]:.10g},{EPOCH + t[k]:.4f},{path}{name},{values[k]:.10g}")
        for name, values in columns.items()
        for k in range(len(t))
        if name != slow or k % 4 == 0
    ]
    if random.integers(2):
        rows.sort(key=lambda row: row[0])
    header = ("time,received,signal,data", "t,log time,name,number", "stamp,host_time,topic_name,val")[
        random.integers(3)
    ]
    file = Foreign(text="\n".join([header, *(row for _, row in rows)]), t=t, columns=columns)
    if slow:
        latest = columns[slow][np.arange(len(t)) // 4 * 4]
        file = replace(file, columns=columns | {slow: latest})
    few = dict(list(columns.items())[:6])
    lines = plain(t, few).text.splitlines()
    states = ["IDLE" if k < 40 else "BALANCE" for k in range(len(t))]
    text = "\n".join(
        [f"state,{lines[0]}", *(f"{state},{line}" for state, line in zip(states, lines[1:], strict=True))]
    )
    return file, Foreign(text=text, t=t, columns=few)


def described(random: Random) -> Pair:
    """Comments that describe the columns, and no header; the twin's last comment is the header."""
    t, columns = motion(random)
    mark = str(random.choice(["%", "#", "//"]))
    prose = [
        f"{mark} log of robot 5",
        f"{mark}  1   time, every 0.005 s",
        f"{mark}  2 3 4   angles of the IMU in degrees",
    ]
    header, *rows = plain(t, columns).text.replace(",", " ").splitlines()
    file = Foreign(text="\n".join([*prose, *rows]), t=t, columns=columns, refusal="--columns")
    named = f"{mark if mark != '//' else '#'} {header}"
    return file, replace(file, text="\n".join([*prose, named, *rows]), refusal="")


def headless(random: Random) -> Pair:
    """Rows of a serial monitor without a header, with given names; the twin has the header."""
    t, columns = motion(random)
    header, *rows = plain(t, columns).text.splitlines()
    greeting = ["--- Terminal on /dev/ttyUSB0 | 115200 8-N-1", "I (312) main: start"][: random.integers(3)]
    names = tuple(header.split(","))
    file = Foreign(text="\n".join([*greeting, *rows]), t=t, columns=columns, names=names)
    return file, replace(file, text="\n".join([header, *rows]), names=None)


def stacked(random: Random) -> Pair:
    """Names that lines above distinguish; the twin has a title and a note above its names."""
    t, columns = motion(random)
    groups = {name: "Lean" if k < 3 else "Encoder" if k < 6 else "Current" for k, name in enumerate(columns)}
    own = ["roll_deg", "pitch_deg", "yaw_deg", "1", "2", "3", "1", "2", "3"]
    letters = dict(zip(columns, [*own[:3], *"ABC", *"ABC"], strict=True))
    rows = plain(t, columns).text.splitlines()[1:]
    above = [
        "Format,1.2,Rate,100",
        "",
        ",".join(["", *("Robot" for _ in columns)]),
        ",".join(["", *groups.values()]),
    ]
    text = "\n".join([*above, ",".join(["Time (s)", *letters.values()]), *rows])
    renamed = {f"{groups[name]}.{letters[name]}": values for name, values in columns.items()}
    twin = plain(t, columns)
    return (
        Foreign(text=text, t=t, columns=renamed),
        replace(twin, text="\n".join(["Run 7", "recorded in the hall", twin.text])),
    )


KINDS: dict[str, Callable[[Random], Pair]] = {
    kind.__name__: kind
    for kind in (
        two_columns, unpadded, bursts, few_digits, misnamed, durations, few_of_a_run, labelled, two_labels, stamped,
        long, described, headless, stacked,
    )
}  # fmt: skip
ROBOT = Robot.load("alten")


def pair_of(kind: str, seed: int) -> Pair:
    """Return the file of a kind and its twin by a seed."""
    return KINDS[kind](np.random.default_rng([70, *map(ord, kind), seed]))


def outcome(file: Foreign, path: Path) -> tuple[Literal["right", "refused", "wrong"], str]:
    """Write a file, let `check-log` read it, and return the result: what was refused, or what is wrong."""
    path.write_text(file.text)
    try:
        read = propose(path, ROBOT, Stated(columns=list(file.names) if file.names else None)).base
    except InputError as error:
        return "refused", str(error)
    t = read.t - read.t[0]
    if len(t) != len(file.t):
        return "wrong", f"{len(t)} of {len(file.t)} rows"
    # of times since 1970 the last bit is 0.24 us
    if (off := float(np.abs(t - (file.t - file.t[0])).max())) > file.tolerance + 6e-7:
        return "wrong", f"times differ by {off:.3g} s"
    for name, values in file.columns.items():
        if name not in read.cut or not np.array_equal(read.cut[name], values):
            return "wrong", name
    # as the mapping's layout reads the file again
    again = rows_with_times(read_columns(path, read.layout, used=[*file.columns]), read.roles.time, [])
    if any(not np.array_equal(again[name], read.cut[name]) for name in (read.roles.time, *file.columns)):
        return "wrong", "by the mapping"
    return "right", ""
