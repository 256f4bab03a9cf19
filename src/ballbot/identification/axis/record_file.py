"""Axis records from files: named variables of a MATLAB file, or columns of CSV and Parquet."""

from __future__ import annotations

import difflib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.identification.axis.mat_file import Variables, read_mat
from ballbot.identification.axis.record import AxisRecord, PositionVelocityLoop, even_sample_time
from ballbot.log.columns import LARGEST_CELL
from ballbot.log.formats import read_columns


@dataclass(frozen=True, kw_only=True)
class AxisColumns:
    """Which variable of a file is what. Numbers may be written out, or be a scalar variable's name."""

    time: str = "t"
    position: str = "position"
    force: str = "force"
    force_scale: str = "1"  #: force [N] over what the file's column holds
    added_force: str | None = None  #: a force that acts beside it, in newtons already
    reference: str | None = None
    position_gain: str | None = None  #: k_p; both gains, or neither
    velocity_gain: str | None = None  #: k_v, from velocity to what the force column holds
    limit: str | None = None  #: of what the force column holds
    unit: Literal["m", "rad"] = "m"


def read_axis_record(path: str | Path, columns: AxisColumns) -> AxisRecord:
    """Read a record.

    Raises
    ------
    InputError
        Where the file cannot be read, a variable is missing or is of the wrong shape, or the rows make no record.
    """
    variables = _read_variables(Path(path))
    name = Path(path).name

    def column(wanted: str) -> NDArray[np.float64]:
        return _variable(name, variables, wanted)

    t = column(columns.time)
    scale = _number(name, variables, columns.force_scale)
    force = scale * column(columns.force)
    added = None if columns.added_force is None else column(columns.added_force)
    if added is not None and added.shape == force.shape:
        force = force + added
    reference = None if columns.reference is None else column(columns.reference)
    record = AxisRecord(
        name=name,
        sample_time=even_sample_time(name, t),
        force=force,
        position=column(columns.position),
        reference=reference,
        unit=columns.unit,
        added=added,
    )
    loop = _loop(name, variables, columns, scale)
    if loop is None:
        return record
    if reference is None:
        raise InputError(
            f"{name}: the gains of the loop need the column of the reference as well; give --reference."
        )
    return replace(record, loop=_with_span(record, reference, loop))


def _loop(name: str, variables: Variables, columns: AxisColumns, scale: float) -> PositionVelocityLoop | None:
    if columns.position_gain is None and columns.velocity_gain is None:
        return None
    if columns.position_gain is None or columns.velocity_gain is None:
        raise InputError("The loop needs both gains; give --position-gain and --velocity-gain.")
    return PositionVelocityLoop(
        position_gain=_number(name, variables, columns.position_gain),
        velocity_gain=_number(name, variables, columns.velocity_gain),
        force_per_input=scale,
        limit=np.inf if columns.limit is None else _number(name, variables, columns.limit),
    )


def _with_span(
    record: AxisRecord, reference: NDArray[np.float64], loop: PositionVelocityLoop
) -> PositionVelocityLoop:
    """Return the loop with the span, 1 to 4 samples, that reproduces the force recorded best."""

    def error(span: int) -> float:
        velocity = (record.position[span:] - record.position[:-span]) / (span * record.sample_time)
        aim = loop.position_gain * (reference - record.position)[span:]
        u = np.clip(loop.velocity_gain * (aim - velocity), -loop.limit, loop.limit)
        return float(np.std(loop.force_per_input * u - record.loop_force[span:]))

    return replace(loop, span=min(range(1, 5), key=error))


def _read_variables(path: Path) -> Variables:
    return read_mat(path) if path.suffix.lower() == ".mat" else read_columns(path)


def _variable(name: str, variables: Variables, wanted: str) -> NDArray[np.float64]:
    if wanted not in variables:
        near = difflib.get_close_matches(wanted, variables, n=1)
        hint = f"did you mean {near[0]!r}?" if near else f"it has {', '.join(variables)}."
        raise InputError(f"{name} has no variable {wanted!r}; {hint}")
    return variables[wanted]


def _number(name: str, variables: Variables, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        values = _variable(name, variables, text)
        if values.size != 1:
            raise InputError(f"{name}: {text!r} has {values.size} values; it must be one number.") from None
        value = float(values[0])
    if not abs(value) <= LARGEST_CELL:
        raise InputError(f"{name}: {text!r} is {value:g}; it must be a finite number.")
    return value
