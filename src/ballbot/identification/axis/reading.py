"""Records of one axis from files: which column or variable is what, and what has to be done to the rows.

A file of any format of logs holds a record, as columns or named variables (docs/logs.md). Rows at uneven times are kept
with their times. Rows with a missing value are left out, so that a gap remains. An axis whose velocity is recorded and
not its position has the position that the velocity gives by integration.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError, suggest
from ballbot.identification.axis.record import EVEN, AxisRecord, KnownLoad, PositionVelocityLoop
from ballbot.log.columns import LARGEST_CELL, Columns
from ballbot.log.formats import read_variables

#: a record in which more rows than this share lack a value is refused
MOST_MISSING = 0.2
_GRAVITY = 9.81


@dataclass(frozen=True, kw_only=True)
class AxisColumns:
    """The variables of a file. A number is written out, or is the name of a variable or of a constant column."""

    time: str = "t"
    """The variable with the time, in seconds."""

    time_scale: str = "1"
    """Factor from that variable to seconds, such as 0.001 for milliseconds: a number, or a variable of the file."""

    position: str | None = None
    """The variable with the position, in metres or radians; "position" if neither it nor the velocity is given."""

    velocity: str | None = None
    """The variable with the velocity, in metres or radians per second, for a file without a position."""

    position_scale: str = "1"
    """Factor from the position, the velocity and the reference to metres or radians: a number, or a variable."""

    force: str = "force"
    """The variable with the force, torque, current or voltage that drives the axis, or a number such as 0."""

    force_scale: str = "1"
    """Factor from that variable to newtons or newton metres: a number, or a variable of the file."""

    added_force: str | None = None
    """The variable with an additional force on the axis, such as a measured disturbance, in newtons (newton metres)."""

    added_force_scale: str = "1"
    """Factor from that variable to newtons or newton metres, -1 if it acts the other way: a number, or a variable."""

    reference: str | None = None
    """The variable with the reference of the position; with both gains, the closed loop is simulated as well, in
    the example with: --reference qg --position-gain kp --velocity-gain kv."""

    position_gain: str | None = None
    """Position gain of the loop, in 1/s: a number, or a variable of the file."""

    velocity_gain: str | None = None
    """Velocity gain of the loop, from velocity to the force variable: a number, or a variable of the file."""

    limit: str | None = None
    """Limit of the force variable: a number, or a variable of the file."""

    unit: Literal["m", "rad"] = "m"
    """Unit of positions: m for a sliding mass, rad for a rotating inertia."""

    temperature: str | None = None
    """The variable with a temperature, which residuals are tested against."""

    load: str | None = None
    """The variable with what loads the bearings, which residuals are tested against."""

    load_mass: str = "0"
    """Known mass of a load, in kg: a number or a variable; one for each record, separated by commas, if they differ."""

    load_arm: str = "0"
    """Distance of the load from an axis that turns, in metres: a number or a variable, or one for each record."""

    hanging: str = "0"
    """The angle at which that load hangs straight down, in radians: a number or a variable."""


def read_axis_records(paths: Sequence[str | Path], columns: AxisColumns) -> list[AxisRecord]:
    """Read records that have the same columns; numbers given for each are taken in the records' order.

    Raises
    ------
    InputError
        If a file cannot be read, a variable is missing or is of the wrong shape, or the rows make no record.
    """
    return [
        read_axis_record(path, _columns_of(columns, place, len(paths))) for place, path in enumerate(paths)
    ]


def _columns_of(columns: AxisColumns, place: int, count: int) -> AxisColumns:
    """Return the columns of the record at `place`."""

    def own(text: str, option: str) -> str:
        parts = [part.strip() for part in text.split(",")]
        if len(parts) == 1:
            return text
        if len(parts) != count:
            raise InputError(
                f"{option} has {len(parts)} values for {count} records; give one for all, or one for each."
            )
        return parts[place]

    return replace(
        columns,
        load_mass=own(columns.load_mass, "--load-mass"),
        load_arm=own(columns.load_arm, "--load-arm"),
    )


def read_axis_record(path: str | Path, columns: AxisColumns) -> AxisRecord:
    """Read a record.

    Raises
    ------
    InputError
        If the file cannot be read, a variable is missing or is of the wrong shape, or the rows make no record.
    """
    variables = read_variables(path)
    name = Path(path).name

    def column(wanted: str | None) -> NDArray[np.float64] | None:
        return None if wanted is None else _variable(name, variables, wanted)

    t = _number(name, variables, columns.time_scale) * _variable(name, variables, columns.time)
    scale = _number(name, variables, columns.force_scale)
    driving = _force(name, variables, columns.force, len(t))
    force = scale * driving
    added = column(columns.added_force)
    if added is not None:
        added = _number(name, variables, columns.added_force_scale) * added
        force = force + added if added.shape == force.shape else force
    travel = _number(name, variables, columns.position_scale)
    position = travel * _position(name, variables, columns, t)
    reference = column(columns.reference)
    reference = None if reference is None else travel * reference
    rows = {
        "time": t,
        "force": force,
        "position": position,
        "reference": reference,
        "the added force": added,
        "temperature": column(columns.temperature),
        "load": column(columns.load),
    }
    kept = _complete(name, {key: values for key, values in rows.items() if values is not None})
    t, force, position, reference, added, temperature, load = (
        None if values is None else values[kept] for values in rows.values()
    )
    assert t is not None and force is not None and position is not None  # noqa: PT018 (for types)
    sample_time, times = sampling(name, t)
    record = AxisRecord(
        name=name,
        sample_time=sample_time,
        force=force,
        position=position,
        reference=reference,
        unit=columns.unit,
        added=added,
        times=times,
        temperature=temperature,
        load=load,
        known_load=_known_load(name, variables, columns),
    )
    loop = _loop(name, variables, columns, scale)
    if loop is None:
        return record
    if reference is None:
        raise InputError(
            f"{name}: the gains of the loop need the column of the reference as well; give --reference."
        )
    if not record.even:
        raise InputError(
            f"{name}: rows come at uneven times, and the closed loop is simulated at even ones; "
            "leave out the gains."
        )
    return replace(record, loop=_with_span(record, reference, loop))


def sampling(name: str, t: NDArray[np.float64]) -> tuple[float, NDArray[np.float64] | None]:
    """Return the sample time [s] of rows at times t (N,), and the times themselves if they are uneven.

    Raises
    ------
    InputError
        If time does not increase from row to row.
    """
    if len(t) < 2:
        raise InputError(f"{name}: the time has fewer than two rows.")
    steps = np.diff(t)
    if steps.min() <= 0.0:
        row = int(np.argmin(steps)) + 2
        raise InputError(
            f"{name}, row {row}: time does not increase ({t[row - 1]:g} after {t[row - 2]:g} s). "
            "Sort the rows, leave out repeated ones, or split the file."
        )
    mean = float(t[-1] - t[0]) / len(steps)
    if np.abs(steps - mean).max() <= EVEN * mean:
        return mean, None
    return float(np.median(steps)), t


def _complete(name: str, columns: Columns) -> NDArray[np.bool_]:
    """Return which rows have all values (N,)."""
    rows = len(columns["time"])
    for key, values in columns.items():
        if len(values) != rows:
            raise InputError(
                f"{name}: {key} has {len(values)} values and the time has {rows}; name a column of the same length."
            )
    kept = np.logical_and.reduce([np.isfinite(values) for values in columns.values()])
    missing = rows - int(kept.sum())
    if missing > MOST_MISSING * rows:
        worst = max(columns, key=lambda key: np.count_nonzero(~np.isfinite(columns[key])))
        row = int(np.flatnonzero(~np.isfinite(columns[worst]))[0]) + 1
        raise InputError(
            f"{name}: {worst} is missing or not finite in row {row}; {missing} of {rows} rows lack a value, "
            f"and at most {100.0 * MOST_MISSING:.0f} % may."
        )
    return kept


def _force(name: str, variables: Columns, text: str, rows: int) -> NDArray[np.float64]:
    if text not in variables:
        try:
            value = float(text)
        except ValueError:
            return _variable(name, variables, text)
        if abs(value) <= LARGEST_CELL:
            return np.full(rows, value)
    return _variable(name, variables, text)


def _position(
    name: str, variables: Columns, columns: AxisColumns, t: NDArray[np.float64]
) -> NDArray[np.float64]:
    if columns.position is not None or columns.velocity is None:
        return _variable(name, variables, columns.position or "position")
    velocity = _variable(name, variables, columns.velocity)
    if len(velocity) != len(t):
        raise InputError(
            f"{name}: the velocity has {len(velocity)} values and the time has {len(t)}; "
            "name a column of the same length."
        )
    known = np.isfinite(velocity) & np.isfinite(t)
    if known.sum() < 2:
        raise InputError(f"{name}: the velocity has fewer than two values.")
    whole = np.interp(np.arange(len(t)), np.flatnonzero(known), velocity[known])
    clock = np.interp(np.arange(len(t)), np.flatnonzero(known), t[known])
    travelled = np.append(0.0, np.cumsum(0.5 * (whole[1:] + whole[:-1]) * np.diff(clock)))
    return np.where(known, travelled, np.nan)


def _known_load(name: str, variables: Columns, columns: AxisColumns) -> KnownLoad:
    mass = _number(name, variables, columns.load_mass)
    if mass == 0.0:
        return KnownLoad()
    if columns.unit == "m":
        return KnownLoad(inertia=mass)
    arm = _number(name, variables, columns.load_arm)
    if not arm > 0.0:
        raise InputError(f"{name}: a load on an axis that turns needs its distance from it; give --load-arm.")
    hanging = _number(name, variables, columns.hanging)
    return KnownLoad(inertia=mass * arm**2, weight=mass * _GRAVITY * arm, hanging=hanging)


def _loop(name: str, variables: Columns, columns: AxisColumns, scale: float) -> PositionVelocityLoop | None:
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


def _variable(name: str, variables: Columns, wanted: str) -> NDArray[np.float64]:
    if wanted not in variables:
        raise InputError(
            f"{name} has no variable {wanted!r}; {suggest(wanted, variables, otherwise='it has')}"
        )
    return variables[wanted]


def _number(name: str, variables: Columns, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        values = _variable(name, variables, text)
        if values.size == 0 or np.ptp(values) != 0.0:
            raise InputError(
                f"{name}: {text!r} has {values.size} different values; it must be one number."
                if values.size
                else f"{name}: {text!r} is empty; it must be one number."
            ) from None
        value = float(values[0])
    if not abs(value) <= LARGEST_CELL:
        raise InputError(f"{name}: {text!r} is {value:g}; it must be a finite number.")
    return value
