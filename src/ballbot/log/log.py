"""`Log`: the time series of an experiment, simulated or real.

A log is a table of equally long columns of float64, named and in the units of `ballbot.log.columns`, in rows
of strictly increasing time. Row k has the measurements at t_k and the torques held from t_k to t_(k+1).

NaN marks a missing value; an infinite one, or one beyond `LARGEST_CELL`, is missing too. Reading keeps it, and
`log[name]` gives the column with it. Computations use `require`, `states`, `torques`, `wheel_speeds` or `reference`,
which refuse NaN with a message, so that it cannot spread unnoticed.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.arrays import Bools, Floats
from ballbot.errors import InputError, about
from ballbot.findings import Finding, note
from ballbot.log.columns import (
    STATE_NAMES,
    TRUE_PREFIX,
    Columns,
    mark_missing,
    missing_words,
    numbered_names,
    unit_of,
)
from ballbot.log.formats import read_columns, write_columns
from ballbot.log.mapping import LogMapping, apply_mapping, read_mapping
from ballbot.log.row_order import check_time
from ballbot.log.wrapping import continuous_headings
from ballbot.robot import RobotLike
from ballbot.summary import Plotted, Summary, counted, duration_words, range_words

if TYPE_CHECKING:
    from pandas import DataFrame, Index, Series

#: states that a reference states
_TRACKED = ("x", "y", "psi")


@dataclass(frozen=True, eq=False, repr=False)
class Log(Plotted):
    """A log in memory; read one with `Log.read`, `plot()` shows path, lean and torques over time.

    Parameters
    ----------
    columns : mapping of str to (N,) array
        The columns by name, `t` [s] among them; copied, and read-only afterwards.
    ended : str, optional
        Why a simulated run stopped early ("fallen: ..."); not kept in files, nor if rows are cut.
    changes : tuple of Finding
        What was left out or changed when the log was read: a cut last row, a heading kept within one turn. The checks
        of a log show them.

    A heading, psi or ref_psi, that is kept within one turn is continued across its jumps.

    Raises
    ------
    InputError
        If `t` is missing or does not strictly increase, a column does not hold numbers, or lengths differ.

    Examples
    --------
    >>> log = Log({"t": [0.0, 0.005, 0.01], "theta": [0.01, np.nan, 0.03]})
    >>> len(log), log.sample_time
    (3, 0.005)
    >>> log["theta"]
    array([0.01,  nan, 0.03])
    """

    columns: Mapping[str, NDArray[np.float64]]
    ended: str | None = None
    changes: tuple[Finding, ...] = ()

    def __post_init__(self) -> None:
        columns = {name: _column(name, values) for name, values in self.columns.items()}
        _check_shape(columns)
        check_time(columns["t"])
        continued, findings = continuous_headings(columns, columns["t"])
        for heading in continued.values():
            heading.flags.writeable = False
        object.__setattr__(self, "columns", MappingProxyType(columns | continued))
        object.__setattr__(self, "changes", (*self.changes, *findings))

    def __reduce__(
        self,
    ) -> tuple[type[Log], tuple[dict[str, NDArray[np.float64]], str | None, tuple[Finding, ...]]]:
        # a mappingproxy cannot be pickled, and logs go to other processes
        return (Log, (dict(self.columns), self.ended, self.changes))

    @staticmethod
    def read(
        path: str | Path,
        *,
        mapping: str | Path | LogMapping | None = None,
        robot: RobotLike | None = None,
    ) -> Log:
        """Read a log from a file (docs/logs.md) with Ballbot's column names, or, with a mapping, any names and layout.

        Parameters
        ----------
        path : str or Path
            Its suffix names the format. Cells without a value become NaN.
        mapping : str, Path or LogMapping, optional
            A TOML file or its content (see `ballbot.log.mapping`).
        robot : Robot, preset or robot file, optional
            Needed by a mapping of duties or voltages: it has the resistance of the motors.

        Returns
        -------
        Log

        Raises
        ------
        InputError
            If file or mapping cannot be read or do not make a log.

        Examples
        --------
        >>> import tempfile
        >>> folder = tempfile.TemporaryDirectory()
        >>> path = Path(folder.name) / "run.csv"
        >>> _ = path.write_text("t,theta\\n0,0.01\\n0.005,\\n")
        >>> Log.read(path)["theta"]
        array([0.01,  nan])
        """
        notes: list[str] = []
        by = None if mapping is None else read_mapping(mapping)
        layout, used = (None, None) if by is None else (by.file, by.used_columns)
        columns = read_columns(path, layout, used=used, notes=notes)
        changes = [note("file", sentence) for sentence in notes]
        with about(path):
            columns = columns if by is None else apply_mapping(by, columns, robot=robot, changes=changes)
            return Log(columns, changes=tuple(changes))

    def write(self, path: str | Path) -> None:
        """Write the log; every value reads back to the same bits.

        Parameters
        ----------
        path : str or Path
            Its suffix names the format.

        Raises
        ------
        InputError
            If no format with that suffix is written, or the file cannot be written.

        Examples
        --------
        >>> import tempfile
        >>> folder = tempfile.TemporaryDirectory()
        >>> path = Path(folder.name) / "run.csv"
        >>> Log({"t": [0.0, 0.005], "theta": [0.01, 1.0 / 3.0]}).write(path)
        >>> Log.read(path)["theta"][1] == 1.0 / 3.0
        np.True_
        """
        write_columns(path, self.columns)

    def to_pandas(self) -> DataFrame:
        """Return the log as a pandas DataFrame.

        Returns
        -------
        pandas.DataFrame
            Its index is t [s], as uneven as it was logged; `frame.attrs["units"]` has the units, that of t among them.

        Examples
        --------
        >>> frame = Log({"t": [0.0, 0.005], "theta": [0.01, 0.02]}).to_pandas()
        >>> frame.index.name, frame.attrs["units"]["theta"]
        ('t', 'rad')
        """
        import pandas

        rest = {name: values for name, values in self.columns.items() if name != "t"}
        frame = pandas.DataFrame(rest, index=pandas.Index(self.t, name="t"), copy=True)
        frame.attrs["units"] = {name: unit for name in self.names if (unit := unit_of(name)) is not None}
        return frame

    @staticmethod
    def from_pandas(
        frame: DataFrame,
        *,
        mapping: str | Path | LogMapping | None = None,
        robot: RobotLike | None = None,
    ) -> Log:
        """Return the log in a pandas DataFrame with Ballbot's column names, or, with a mapping, any names.

        Parameters
        ----------
        frame : pandas.DataFrame
            Its time is a column t [s], an index named t, or an index of dates or durations; dates count from the first
            row. Missing values become NaN.
        mapping : str, Path or LogMapping, optional
            A TOML file or its content (see `ballbot.log.mapping`).
        robot : Robot, preset or robot file, optional
            Needed by a mapping of duties or voltages.

        Returns
        -------
        Log

        Raises
        ------
        InputError
            If there is no time or it does not increase, or a column does not contain numbers.

        Examples
        --------
        >>> import pandas as pd
        >>> Log.from_pandas(pd.DataFrame({"theta": [0.01, 0.02]}, index=pd.Index([0.0, 0.005], name="t"))).names
        ('t', 'theta')
        """
        columns, changes = _columns_of(frame), list[Finding]()
        if mapping is not None:
            columns = apply_mapping(read_mapping(mapping), columns, robot=robot, changes=changes)
        elif "t" not in columns:
            raise InputError(
                "The frame has no time: it needs a column t [s], an index named t, or an index of dates or durations. "
                f"Its columns are: {', '.join(columns) or 'none'}."
            )
        return Log(columns, changes=tuple(changes))

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        """Return one column (N,), NaN included; read-only.

        Raises
        ------
        InputError
            If there is no such column.
        """
        if not isinstance(name, str):
            raise InputError(
                f"A log is indexed by the name of one column, such as log['x'], and not by a {type(name).__name__}; "
                "log.select(slice(0, 10)) has the first ten rows, log.between(0, 2) the first two seconds."
            )
        self._need([name])
        return self.columns[name]

    def __contains__(self, name: object) -> bool:
        """Return whether there is a column of that name."""
        return name in self.columns

    def __iter__(self) -> Iterator[str]:
        """Iterate over the columns' names."""
        return iter(self.columns)

    def __len__(self) -> int:
        """Return the number of rows, N."""
        return len(self.columns["t"])

    @property
    def names(self) -> tuple[str, ...]:
        """The columns' names in their order."""
        return tuple(self.columns)

    @property
    def t(self) -> NDArray[np.float64]:
        """Time (N,) [s], strictly increasing."""
        return self.columns["t"]

    @property
    def sample_time(self) -> float:
        """The median interval between rows [s]."""
        if len(self) < 2:
            raise InputError("A log of one row has no sample time; at least two rows are needed.")
        return float(np.median(np.diff(self.t)))

    @property
    def states(self) -> NDArray[np.float64]:
        """The states (N, 10), in the order of `STATE_NAMES`; NaN refused."""
        return self._table(STATE_NAMES)

    @property
    def torques(self) -> NDArray[np.float64]:
        """The wheel torques u1 .. un (N, n) [N m]; NaN refused."""
        return self._table(numbered_names(self.names, prefix="u") or ("u1",))

    @property
    def wheel_angles(self) -> NDArray[np.float64]:
        """The wheel angles wheel1 .. (N, n) [rad] of the encoders; NaN refused."""
        return self._table(numbered_names(self.names, prefix="wheel") or ("wheel1",))

    @property
    def wheel_speeds(self) -> NDArray[np.float64]:
        """The wheel speeds wheel1_dot .. (N, n) [rad/s] of the encoders; NaN refused."""
        return self._table(numbered_names(self.names, prefix="wheel", suffix="_dot") or ("wheel1_dot",))

    @property
    def reference(self) -> NDArray[np.float64]:
        """The reference (N, 10): ref_x, ref_y and ref_psi in their places in the state, zero elsewhere."""
        reference, indices = np.zeros((len(self), len(STATE_NAMES))), map(STATE_NAMES.index, _TRACKED)
        reference[:, [*indices]] = self._table([f"ref_{name}" for name in _TRACKED])
        return reference

    def require(self, *names: str) -> None:
        """Check that columns exist and are finite throughout.

        Parameters
        ----------
        *names : str
            Columns.

        Raises
        ------
        InputError
            Names the columns that are missing, or the first row with a NaN or an infinity.

        Examples
        --------
        >>> Log({"t": [0.0, 0.005], "theta": [0.01, 0.02]}).require("phi")
        Traceback (most recent call last):
        ballbot.errors.InputError: The log has no column phi. Add or rename columns, in the file or by a mapping file.
        """
        self._need(names)
        for name in names:
            bad = np.flatnonzero(~np.isfinite(self.columns[name]))
            if bad.size:
                raise InputError(
                    f"The log's column {name} has {bad.size} of {len(self)} values missing "
                    f"or not finite, the first at row {bad[0] + 1} (t = {self.t[bad[0]]:g} "
                    "s). Fill them, or use a part of the log without them."
                )

    def complete(self, *names: str) -> Log:
        """Return the rows that have a value in every one of some columns; the others become a gap in time.

        Parameters
        ----------
        *names : str
            Columns.

        Returns
        -------
        Log

        Raises
        ------
        InputError
            If one is no column, or no row is left.

        Examples
        --------
        >>> Log({"t": [0.0, 0.005, 0.01], "theta": [0.01, np.nan, 0.03]}).complete("theta").t
        array([0.  , 0.01])
        """
        self._need(names)
        values = np.column_stack([self.columns[name] for name in ("t", *names)])
        known = np.asarray(np.isfinite(values).all(axis=1), np.bool_)
        if not known.any():
            raise InputError(f"No row of the log has a value in all of {', '.join(names)}.")
        return self if known.all() else self._of_rows(known, self.ended)

    def between(self, start: float, end: float) -> Log:
        """Return a part of the log.

        Parameters
        ----------
        start, end : float
            [s]; rows with start <= t < end are kept.

        Returns
        -------
        Log

        Raises
        ------
        InputError
            If there is no such row.

        Examples
        --------
        >>> Log({"t": [0.0, 0.5, 1.0, 1.5]}).between(0.5, 1.5).t
        array([0.5, 1. ])
        """
        kept = (self.t >= start) & (self.t < end)
        if not kept.any():
            asked = f"from {start:g} to {end:g} s" if np.isfinite(end) else f"from {start:g} s on"
            raise InputError(f"The log has no row {asked}; it runs from {self.t[0]:g} to {self.t[-1]:g} s.")
        return self._of_rows(kept)

    def select(self, rows: slice) -> Log:
        """Return some rows of the log.

        Parameters
        ----------
        rows : slice
            With a positive step.

        Returns
        -------
        Log

        Raises
        ------
        InputError
            If it is no slice, or selects no row.

        Examples
        --------
        >>> Log({"t": [0.0, 0.5, 1.0, 1.5]}).select(slice(None, None, 2)).t
        array([0., 1.])
        """
        if not isinstance(rows, slice):
            raise InputError(
                "select takes rows, such as log.select(slice(0, 100)); one column is log['x'], and a part in time is "
                "log.between(0, 2)."
            )
        return self._of_rows(rows)

    def _of_rows(self, rows: slice | Bools, ended: str | None = None) -> Log:
        return Log({name: values[rows] for name, values in self.columns.items()}, ended, self.changes)

    def with_columns(self, columns: Mapping[str, ArrayLike]) -> Log:
        """Return a copy with more columns.

        Parameters
        ----------
        columns : mapping of str to array_like (N,)
            Added, or put in place of those of the same name.

        Returns
        -------
        Log

        Raises
        ------
        InputError
            If a column does not hold numbers or has another length.

        Examples
        --------
        >>> Log({"t": [0.0, 0.5]}).with_columns({"theta": [0.01, 0.02]}).names
        ('t', 'theta')
        """
        added = {name: _column(name, values) for name, values in columns.items()}
        return Log({**self.columns, **added}, self.ended, self.changes)

    def truth(self) -> Log:
        """Return the log of a simulated run with the true states in place of the measured ones.

        Returns
        -------
        Log
            The columns true_x .. true_psi_dot become x .. psi_dot; all else stays.

        Raises
        ------
        InputError
            If the log has no true states.

        Examples
        --------
        >>> true = {f"true_{name}": [0.1] for name in STATE_NAMES}
        >>> Log({"t": [0.0], "theta": [0.12], **true}).truth()["theta"]
        array([0.1])
        """
        for name in STATE_NAMES:
            if TRUE_PREFIX + name not in self.columns:
                raise InputError(
                    f"The log has no true states (no column true_{name}): only logs of simulated runs have them."
                )
        true = {name: self.columns[TRUE_PREFIX + name] for name in STATE_NAMES}
        return Log.of_checked({**self.without_truth().columns, **true}, self.ended, self.changes)

    def without_truth(self) -> Log:
        """Return the log without its true_* columns, as of a real robot.

        Returns
        -------
        Log

        Examples
        --------
        >>> Log({"t": [0.0], "theta": [0.12], "true_theta": [0.1]}).without_truth().names
        ('t', 'theta')
        """
        kept = {name: v for name, v in self.columns.items() if not name.startswith(TRUE_PREFIX)}
        return Log.of_checked(kept, self.ended, self.changes)

    @staticmethod
    def of_checked(
        columns: dict[str, NDArray[np.float64]], ended: str | None, changes: tuple[Finding, ...] = ()
    ) -> Log:
        """Return a log of columns as the class would keep them; nothing is checked or copied, for thousands of logs.

        Parameters
        ----------
        columns : dict of str to ndarray (N,)
            float64, read-only, without jumps of the heading.
        ended : str or None
            Why the run ended early.
        changes : tuple of Finding
            What was left out or changed before.

        Returns
        -------
        Log
        """
        made = object.__new__(Log)
        for name, value in (("columns", MappingProxyType(columns)), ("ended", ended), ("changes", changes)):
            object.__setattr__(made, name, value)
        return made

    def summary(self) -> Summary:
        """Return the log's length and rate, and the range of its columns by groups."""
        duration = float(self.t[-1] - self.t[0])
        rate = f" at {(len(self) - 1) / duration:.4g} Hz" if duration > 0.0 else ""
        rows = [("time", f"{self.t[0]:.6g} to {self.t[-1]:.6g} s"), *_range_rows(self)]
        missing = {name: np.count_nonzero(~np.isfinite(values)) for name, values in self.columns.items()}
        lacking = ", ".join(f"{count} of {name}" for name, count in missing.items() if count)
        rows.append(("missing values", lacking or "none"))
        if self.ended:
            rows.append(("ended early", self.ended))
        title = f"Log of {counted(len(self), 'row')}: {duration_words(duration)}{rate}"
        return Summary(title=title, rows=tuple(rows))

    def _need(self, names: Iterable[str]) -> None:
        """Raise InputError if one of these is no column."""
        if missing := [name for name in names if name not in self.columns]:
            columns = missing_words(missing, self.names)
            raise InputError(
                f"The log has no {columns}. Add or rename columns, in the file or by a mapping file."
            )

    def _table(self, names: Sequence[str]) -> NDArray[np.float64]:
        self._need(names)
        table = np.column_stack([self.columns[name] for name in names])
        if not np.isfinite(table).all():
            self.require(*names)
        return table


def _range_rows(log: Log) -> list[tuple[str, str]]:
    """Return the range of each column, those of wheels and axes together, and the names of all other columns."""
    groups: dict[str, list[str]] = {}
    for name in log.names:
        if name != "t" and unit_of(name) and not name.startswith(TRUE_PREFIX):
            groups.setdefault(re.sub(r"\d|_[xyz]$", "", name), []).append(name)
    rows = []
    for names in groups.values():
        values = np.concatenate([log[name] for name in names])
        rows.append((", ".join(names), range_words(values, unit_of(names[0]) or "")))
    truth = sum(name.startswith(TRUE_PREFIX) for name in log.names)
    others = [name for name in log.names if not unit_of(name)]
    rows += [("true values", counted(truth, "column"))] if truth else []
    return [*rows, ("other columns", ", ".join(others))] if others else rows


def _column(name: str, values: ArrayLike) -> NDArray[np.float64]:
    try:
        given = np.asarray(values)
        if given.dtype.kind in "cSU":  # NumPy would read text, and drop imaginary parts
            raise TypeError
        column = np.array(given, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"The log's column {name} does not contain numbers.") from None
    column = column if name == "t" else mark_missing(column)
    column.flags.writeable = False
    return column


def _check_shape(columns: Mapping[str, NDArray[np.float64]]) -> None:
    if "t" not in columns:
        runs = [name.removesuffix(".t") for name in columns if name.endswith(".t")]
        if len(runs) > 1:  # structures of a MATLAB file
            raise InputError(f"The file holds several runs: {', '.join(runs)}. Save each in its own file.")
        raise InputError(
            "A log needs the column t, the time in seconds. For a foreign "
            "file, `ballbot check-log FILE --robot ROBOT --out checked` proposes a mapping."
        )
    rows = columns["t"].shape
    if len(rows) != 1 or rows[0] == 0:
        raise InputError("The log has no rows; at least one is needed.")
    for name, column in columns.items():
        if column.shape != rows:
            raise InputError(f"The log's column {name} has the shape {column.shape}, but t has {rows}.")


def _columns_of(frame: DataFrame) -> Columns:
    """Return a frame's columns as float64, its index among them if it is named or counts time."""
    import pandas

    if not isinstance(frame, pandas.DataFrame):
        kind = type(frame).__name__
        raise InputError(f"A log is made of a pandas DataFrame; an object of type {kind} is given.")
    index, names = frame.index, frame.columns.tolist()
    if len(set(names)) < len(names) or not all(isinstance(name, str) for name in names):
        raise InputError("The frame's columns must have a name each, a text that no other has.")
    key = "t" if index.dtype.kind in "mM" and "t" not in names else index.name
    before = [(key, index)] if isinstance(key, str) and key not in names else []
    return {str(name): _numbers(str(name), values) for name, values in [*before, *frame.items()]}


def _numbers(name: str, values: Series | Index) -> Floats:
    """Return values as numbers, dates and durations as seconds; dates count from the first row."""
    import pandas

    kind = values.dtype.kind
    if kind in "mM":
        moments = pandas.Index(values)
        durations = pandas.TimedeltaIndex(moments if kind == "m" else moments - moments[0])
        return durations.total_seconds().to_numpy(dtype=np.float64)
    if kind not in "fiub":
        raise InputError(
            f"The frame's column {name!r} does not contain numbers (its type is {values.dtype}). Convert it, or leave "
            f"it out: frame.drop(columns={name!r})."
        )
    return values.to_numpy(dtype=np.float64, na_value=np.nan)
