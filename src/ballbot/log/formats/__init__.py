"""File formats of logs: each is one file here and one line in `FORMATS`, and every command reads and writes through it.

A table of text is read by its `TextLayout`, which a mapping states or its lines show (`text`).
"""

from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from ballbot.arrays import Floats, check_table, format_bytes
from ballbot.errors import InputError, either, nearest
from ballbot.files import LARGEST_TABLE, check_regular
from ballbot.log.clock import with_fractions
from ballbot.log.columns import Columns, check_column_names, has_native_names, mark_missing, native_columns
from ballbot.log.formats.dialects import read_long_table
from ballbot.log.formats.json import read_json_table
from ballbot.log.formats.mat import read_mat, write_mat
from ballbot.log.formats.mcap import read_mcap, write_mcap
from ballbot.log.formats.parquet import read_parquet_table, write_parquet_table
from ballbot.log.formats.ros import read_bag
from ballbot.log.formats.text import (
    ForeignTable,
    TextLayout,
    infer_text_table,
    read_head,
    read_own_table,
    read_text_table,
    write_text_table,
)
from ballbot.log.row_order import rows_with_times
from ballbot.printable import printable_line


@dataclass(frozen=True)
class LogFormat:
    """How files of one kind are read and written.

    `read` takes a path and returns every numeric variable of the file by name, as one row of numbers (N,), float64,
    with NaN for missing values; what is not a real number, such as a column of text, is skipped or refused by its name.
    The file's size, whether names can be printed, whether there are numbers, how many, and which of them are too large
    to be values are checked here for every format, and what a library raises on a damaged file becomes InputError.

    `write` takes a path and columns (N,) of equal length, whose names can be printed. The file is whole or not there,
    and `read` returns the same names in the same order, and the same bits. InputError if the format cannot hold a name.
    """

    name: str  #: in messages
    suffixes: tuple[str, ...]  #: of the names of its files; a written file has the first
    read: Callable[[Path], Columns]
    write: Callable[[Path, Mapping[str, Floats]], None] | None = None  #: None: only read


#: the one whose layout a mapping file may give
_TEXT = LogFormat("CSV", (".csv", ".txt", ".tsv", ".dat", ".log"), read_own_table, write_text_table)
#: also how a folder is read, whatever its name
_BAG = LogFormat("ROS 2 bag", (".db3",), read_bag)
#: every format; adding one takes a file beside this one and a line here
FORMATS: tuple[LogFormat, ...] = (
    _TEXT,
    LogFormat("Parquet", (".parquet",), read_parquet_table, write_parquet_table),
    LogFormat("JSON", (".json", ".jsonl", ".ndjson"), read_json_table),
    LogFormat("MATLAB", (".mat",), read_mat, write_mat),
    LogFormat("MCAP", (".mcap",), read_mcap, write_mcap),
    _BAG,
    LogFormat("ROS 1 bag", (".bag",), read_bag),
)
_OF_SUFFIX = {suffix: form for form in FORMATS for suffix in form.suffixes}
_COMPRESSED = (".gz", ".zst", ".xz", ".bz2", ".zip")
#: suffixes of the files that are written, the default first
WRITTEN_SUFFIXES = tuple(form.suffixes[0] for form in FORMATS if form.write)


def is_bag_folder(path: str | Path) -> bool:
    """Return whether a path is a folder with the metadata of a ROS 2 bag."""
    return (Path(path) / "metadata.yaml").is_file()


def is_log_file(path: str | Path) -> bool:
    """Return whether a file's name has the suffix of a log, or it is the folder of a ROS 2 bag."""
    return Path(path).suffix.lower() in _OF_SUFFIX or is_bag_folder(path)


def is_foreign(path: str | Path) -> bool:
    """Return whether a file can be read and is no log with Ballbot's own column names: t, and most of the others.

    A file that Ballbot's own reader refuses, but whose header has these names, is a damaged log and not foreign.
    """
    if not Path(path).exists():
        return False
    form = _format_of(path, otherwise=_TEXT)
    return not has_native_names(read_head(path).names if form is _TEXT else _read(form, path))


def read_columns(
    path: str | Path,
    layout: TextLayout | None = None,
    *,
    used: Collection[str] | None = None,
    notes: list[str] | None = None,
) -> Columns:
    """Read a log's columns (N,) by name, equally long: of a file's variables those as long as t, or as most others.

    The layout of a table of text is inferred if it is not given. `used` are the columns that must consist of numbers,
    see `read_text_table`; Ballbot's own without a layout. `notes` gets a sentence for each omission. InputError if the
    file has none of the `FORMATS` or holds no table.
    """
    form, notes = _format_of(path), [] if notes is None else notes
    if form is not _TEXT:
        columns = _of_one_length(_read(form, path), path)
    elif layout is None:
        columns = read_own_table(path, notes)
    else:
        columns = read_text_table(path, layout, used=used, notes=notes)
    columns = with_fractions(columns, notes)
    if layout is not None:
        return columns
    own = native_columns(columns)
    for name, (bare, factor, unit) in own.items():
        notes.append(f"{name} is read as {bare}{f', and converted from {unit}' if factor != 1.0 else ''}.")
        columns[name] = columns[name] * factor
    columns = {own[name][0] if name in own else name: values for name, values in columns.items()}
    return rows_with_times(columns, "t", notes) if "t" in columns else columns


def read_variables(path: str | Path, *, names: Sequence[str] | None = None) -> ForeignTable:
    """Read all variables of a file of any format by name, of any length; of text in any layout, whatever its suffix.

    The `names` of a text's columns are given if it has none. InputError if the file has no numbers.
    """
    form = _format_of(path, otherwise=_TEXT)
    if form is _TEXT:
        table = infer_text_table(path, given_names=names)
    elif names is not None:
        raise InputError(f"{path} has names of its own; --columns is for tables of text.")
    else:
        table = ForeignTable(columns=_read(form, path))
    notes = list(table.notes)
    return replace(table, columns=with_fractions(table.columns, notes), notes=tuple(notes))


def read_foreign_table(path: str | Path, *, names: Sequence[str] | None = None) -> ForeignTable:
    """Read a file as `read_variables`, without the variables that are not as long as t, or as most others."""
    table = read_variables(path, names=names)
    return replace(table, columns=_of_one_length(table.columns, path))


def write_columns(path: str | Path, columns: Mapping[str, Floats]) -> None:
    """Write columns (N,) in the format of the suffix of `path`; InputError if none is written so."""
    form = written_format(path)
    check_column_names(columns, source=str(path))
    with _needing(form):
        if form.write:
            form.write(Path(path), columns)


def written_format(path: str | Path) -> LogFormat:
    """Return the format in which a log is written to `path`, by its suffix; InputError if there is none."""
    suffix = Path(path).suffix.lower()
    if suffix not in WRITTEN_SUFFIXES:
        raise InputError(
            f"{path} cannot be written: a log's file name must end in {either(WRITTEN_SUFFIXES)}."
        )
    return _OF_SUFFIX[suffix]


def _format_of(path: str | Path, *, otherwise: LogFormat | None = None) -> LogFormat:
    """Return the format of a file by its suffix, or `otherwise`; InputError if it is compressed, or of no format."""
    suffix = Path(path).suffix.lower()
    form = _BAG if Path(path).is_dir() else _OF_SUFFIX.get(suffix, otherwise)
    packed = suffix in _COMPRESSED and form is not _BAG
    if packed or form is None:
        check_regular(path)
    if packed:
        raise InputError(f"{path} is compressed; unpack it first.")
    if suffix == ".npz":  # logs of earlier versions
        raise InputError(
            f"{path} is of NumPy, whose logs are no longer read. Convert it in Python: "
            f"ballbot.Log(dict(numpy.load({str(path)!r}))).write({str(Path(path).with_suffix('.csv'))!r})"
        )
    if form is None:
        near = nearest(suffix, _OF_SUFFIX)
        hint = f"did you mean {near[0]}? Its name must end" if near else "give a file that ends"
        raise InputError(f"{path} is not a log that Ballbot reads; {hint} in {either(_OF_SUFFIX)}.")
    long = read_long_table(path) if form is _TEXT else None
    return form if long is None else LogFormat("CSV", (), lambda _: long)


def _read(form: LogFormat, path: str | Path) -> Columns:
    """Return a file's variables, checked as `LogFormat` promises."""
    size = 0 if form is _BAG and is_bag_folder(path) else check_regular(path)
    if size > LARGEST_TABLE:
        raise InputError(f"{path} has {format_bytes(size)}; at most {format_bytes(LARGEST_TABLE)} are read.")
    with _needing(form, reading=path):
        variables = form.read(Path(path))
    if not any(map(len, variables.values())):
        raise InputError(f"{path} is empty; a log needs columns and rows of numbers.")
    check_column_names(variables, source=str(path))
    return {name: mark_missing(values) for name, values in variables.items()}


@contextmanager
def _needing(form: LogFormat, *, reading: str | Path | None = None) -> Iterator[None]:
    """Raise InputError if a package is missing that the format needs, or on what a library raises while reading."""
    try:
        yield
    except ModuleNotFoundError as error:
        words = f"{form.name} files need {error.name}: pip install 'ballbot[formats]'. Or use CSV."
        raise InputError(words) from None
    except InputError:
        raise
    except Exception as error:  # of a damaged file
        if reading is None:
            raise
        reason = printable_line(f"{type(error).__name__}: {error}")
        raise InputError(
            f"{reading} cannot be read: it is not a complete {form.name} file ({reason})."
        ) from None


def _of_one_length(variables: Columns, path: str | Path) -> Columns:
    """Return the variables of the log's table, which are equally long; the file may also have constants."""
    counts = Counter(map(len, variables.values()))
    length = len(variables["t"]) if "t" in variables else max(counts, key=lambda n: (counts[n], n))
    columns = {name: values for name, values in variables.items() if len(values) == length}
    check_table(length, len(columns), source=str(path))
    return columns
