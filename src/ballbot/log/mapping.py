"""How a foreign table becomes a log: `LogMapping`, and its application.

Each of Ballbot's columns comes from one of the file's, times a factor (unit, scale, sign) plus an offset, or
is the derivative of another of Ballbot's columns. Delays are undone: a sensor's value that reached the log
`delay` late describes the time t - delay, and a command logged at t acts at t + delay, held until the next.
Rows at the ends for which a delayed column then has no value are cut off. The order is: scale, shift, cut,
differentiate, torque.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.log.drive_input import DriveInput, DutyInput
from ballbot.log.text_table import TextLayout

#: [s] by which rounding may move a delayed row past the one it belongs to
_ROUNDING = 1e-9

Columns = dict[str, NDArray[np.float64]]


@dataclass(frozen=True, kw_only=True)
class Source:
    """A column of the file: value = factor * cell + offset, in Ballbot's unit."""

    column: str  #: its name in the file
    factor: float = 1.0  #: unit, scale and sign in one
    offset: float = 0.0  #: in Ballbot's unit
    delay: float = 0.0  #: [s]


@dataclass(frozen=True, kw_only=True)
class MotorInput:
    """The motors' columns of the file, one for each wheel in Ballbot's order, and what they mean."""

    sources: tuple[Source, ...]
    drive: DriveInput


@dataclass(frozen=True, kw_only=True)
class LogMapping:
    """How a foreign file becomes a log; see `ballbot.log.mapping_file` for its TOML form."""

    layout: TextLayout
    columns: Mapping[str, Source]  #: by Ballbot's name, t among them
    derivatives: Mapping[str, str]  #: by Ballbot's name, which of Ballbot's columns to differentiate
    motors: MotorInput | None


def apply_mapping(mapping: LogMapping, table: Mapping[str, NDArray[np.float64]]) -> Columns:
    """Return the log's columns (N,) from the file's.

    Parameters
    ----------
    mapping : LogMapping
        What comes from where.
    table : mapping of str to (M,) array
        The file's columns by the file's names.

    Returns
    -------
    dict of str to (N,) array
        In Ballbot's names and units; N <= M, as rows at the ends are cut where a delay asks for it.

    Raises
    ------
    InputError
        Where the file lacks a column that the mapping names, or its time does not increase.
    """
    t = _scaled("t", mapping.columns["t"], table)
    wrong = np.flatnonzero(~(np.diff(t) > 0.0))
    if wrong.size:
        raise InputError(
            f"Time does not increase at row {wrong[0] + 2} (t = {t[wrong[0] + 1]:.9g} s); it must."
        )
    columns = {"t": t}
    for name, source in mapping.columns.items():
        if name != "t":
            columns[name] = _measured_at(t, _scaled(name, source, table), source.delay)
    commands = mapping.motors.sources if mapping.motors else ()
    for i, source in enumerate(commands, start=1):
        columns[f"u{i}"] = _acting_at(t, _scaled(f"u{i}", source, table), source.delay)
    columns = _cut(columns, [*mapping.columns.values()], [*commands])
    for name, origin in mapping.derivatives.items():
        columns[name] = _derivative(columns["t"], columns[origin], origin)
    return columns | (_torques(mapping.motors, columns) if mapping.motors else {})


def _scaled(name: str, source: Source, table: Mapping[str, NDArray[np.float64]]) -> NDArray[np.float64]:
    if source.column not in table:
        near = difflib.get_close_matches(source.column, table, n=1)
        hint = f"; did you mean {near[0]!r}?" if near else f"; it has {', '.join(table)}."
        raise InputError(
            f"The mapping takes {name} from the column {source.column!r}, which is not there{hint}"
        )
    return source.factor * table[source.column] + source.offset


def _measured_at(t: NDArray[np.float64], values: NDArray[np.float64], delay: float) -> NDArray[np.float64]:
    """Return what a sensor will have reported `delay` after t (linear in between)."""
    return np.interp(t + delay, t, values) if delay else values


def _acting_at(t: NDArray[np.float64], values: NDArray[np.float64], delay: float) -> NDArray[np.float64]:
    """Return the command that acts at t: the last one logged at t - delay or before."""
    if not delay:
        return values
    latest = np.searchsorted(t, t - delay + _ROUNDING, side="right") - 1
    return values[np.maximum(latest, 0)]


def _cut(columns: Columns, measured: list[Source], commanded: list[Source]) -> Columns:
    """Return the rows for which every delayed column had a value in the file."""
    t = columns["t"]
    ahead = [source.delay for source in measured] + [-source.delay for source in commanded]
    kept = (t + min(ahead) >= t[0] - _ROUNDING) & (t + max(ahead) <= t[-1] + _ROUNDING)
    if not kept.any():
        raise InputError("The mapping's delays are longer than the log; delays are in seconds.")
    return {name: values[kept] for name, values in columns.items()}


def _derivative(t: NDArray[np.float64], values: NDArray[np.float64], origin: str) -> NDArray[np.float64]:
    if len(t) < 2:
        raise InputError(f"The derivative of {origin} needs at least two rows.")
    return np.gradient(values, t)


def _torques(motors: MotorInput, columns: Columns) -> Columns:
    torques: Columns = {}
    for i in range(1, len(motors.sources) + 1):
        speed = columns.get(f"wheel{i}_dot")
        if speed is None and isinstance(motors.drive, DutyInput):
            raise InputError(f"Torque from PWM duty needs the wheel's speed: map the column wheel{i}_dot.")
        command = columns[f"u{i}"]
        torques[f"u{i}"] = motors.drive.torque(command, np.zeros_like(command) if speed is None else speed)
    return torques
