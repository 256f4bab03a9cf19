"""Logs as functions take them: one or several, in memory or in files.

A function that takes logs takes `LogsLike` and gives it to `as_logs`, which returns them by the names of messages:

    a log               without a name
    a file              by its stem, and log.csv, which every command writes, by its folder
    several             in memory "log 1", "log 2", ..; in files as one, but with their folders if names recur
    a mapping           by its keys
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from ballbot.errors import InputError
from ballbot.log.log import Log

#: a log, or the file that it is read from
LogLike = Log | str | Path
#: a log, several, or several by name
LogsLike = LogLike | Iterable[LogLike] | Mapping[str, LogLike]


def as_log(source: LogLike) -> Log:
    """Return the log itself, or the one in that file; InputError if it is neither, or cannot be read.

    >>> log = Log({"t": [0.0, 0.005], "theta": [0.01, 0.02]})
    >>> as_log(log) is log
    True
    """
    if isinstance(source, Log):
        return source
    if isinstance(source, str | Path):
        return Log.read(source)
    raise InputError(
        f"A log is given as an object of type {type(source).__name__}; give a Log or the path of a log file. "
        "Log({'t': .., 'theta': ..}) makes a log of arrays, Log.from_pandas(frame) one of a DataFrame."
    )


def as_logs(sources: LogsLike) -> dict[str, Log]:
    """Return logs by the names that messages use.

    InputError if there is no log, one is not a log or is named twice, or a file cannot be read.

    >>> log = Log({"t": [0.0, 0.005], "theta": [0.01, 0.02]})
    >>> list(as_logs([log, log.select(slice(1))]))
    ['log 1', 'log 2']
    >>> list(as_logs({"square": log}))
    ['square']
    """
    if isinstance(sources, Mapping):
        named = list(sources.items())
    else:
        # tables iterate over their columns, and are refused as logs
        alone = isinstance(sources, Log | str | Path) or hasattr(sources, "__array__")
        listed = list(sources) if isinstance(sources, Iterable) and not alone else [sources]
        files = [Path(source) for source in listed if isinstance(source, str | Path)]
        names, named = iter(named_files(files) if files else ()), []
        for number, source in enumerate(listed, start=1):
            of_memory = f"log {number}" if len(listed) > 1 else ""
            named.append((next(names) if isinstance(source, str | Path) else of_memory, source))
    logs: dict[str, Log] = {}
    for name, source in named:
        if not isinstance(name, str):
            raise InputError(f"A log is named {name!r}; the names of logs are texts, such as 'square'.")
        if name in logs:
            raise InputError(f"Two logs are called {name!r}; name them in a dict.")
        logs[name] = as_log(source)  # pyright: ignore[reportArgumentType] - which refuses a table
    if not logs:
        raise InputError("No log is given; give one or more.")
    return logs


def named_files(paths: Sequence[Path]) -> dict[str, Path]:
    """Return logs' files by their stems, a log.csv by its folder; by their paths if names recur.

    Files whose paths differ only in the format, such as run/log.csv and run/log.mcap, keep their whole paths.
    InputError if no log is given, or one is named twice.
    """
    if not paths:
        raise InputError("No log is given. Name one or more log files after the robot.")
    whole = [path.resolve() for path in paths]
    for number, path in enumerate(paths):
        if whole[number] in whole[:number]:
            raise InputError(f"The log {path} is given twice. Name each file once.")
    by_stem = [path.parent.name or path.stem if path.stem == "log" else path.stem for path in whole]
    by_path = [str(path.with_suffix("")) for path in paths]
    by_file = [str(path) for path in paths]
    names = next(names for names in (by_stem, by_path, by_file) if len(set(names)) == len(names))
    return dict(zip(names, paths, strict=True))
