"""Records of one axis from files: which column or variable is what, and what has to be done to the rows.

A file of any format of logs holds a record, as columns or named variables (docs/logs.md). Rows at uneven times are kept
with their times. Rows with a missing value are left out, so that a gap remains. A position that wraps is unwrapped. An
axis whose velocity is recorded and not its position has the position that the velocity gives by integration.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.identification.axis.file_columns import (
    AxisColumns,
    AxisFile,
    check_names,
    check_units,
)
from ballbot.identification.axis.record import (
    EVEN,
    NO_WRAPS,
    AxisRecord,
    KnownLoad,
    PositionVelocityLoop,
    Wraps,
)
from ballbot.log.columns import LARGEST_CELL, Columns
from ballbot.log.formats import read_units, read_variables
from ballbot.log.signals import unwrapped

TURN, DEGREES = 2.0 * np.pi, 360.0
_BITS = (8, 10, 12, 13, 14, 15, 16, 17, 18, 20, 24, 32)
#: an ordinary step is at most this share of the period; a jump differs from the period by no more than such a step
_LARGEST_STEP = 0.25
#: noise and rounding let a position that wraps cover so much more than its period, and a jump that much more, too
_BEYOND = 0.01
#: a record in which more rows than this share lack a value is refused
MOST_MISSING = 0.2
_GRAVITY = 9.81
#: a force beyond so many times its limit exceeds it by more than noise
_BEYOND_LIMIT = 1.02


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
            records = f"{count} record{'s' if count > 1 else ''}"
            raise InputError(
                f"{option} has {len(parts)} values for {records}; give one for all, or one for each."
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
    file = AxisFile(name=Path(path).name, variables=read_variables(path), columns=columns)
    check_names(file)
    check_units(file, read_units(path))
    t = file.factor("time_scale", negative=False) * _times(file)
    scale = file.factor("force_scale")
    driving = _driving_force(file, len(t))
    limit = np.inf if columns.limit is None else file.factor("limit", negative=False)
    # a force beyond the limit was demanded and does not act
    force = scale * np.clip(driving, -limit, limit)
    beyond = float(np.mean(np.abs(driving) > _BEYOND_LIMIT * limit))
    added = file.optional("added_force")
    if added is not None:
        added = file.factor("added_force_scale") * added
        force = force + added if added.shape == force.shape else force
    position, reference, wraps = _measured_motion(file, t)
    rows = {
        "time": t,
        "force": force,
        "position": position,
        "reference": reference,
        "the added force": added,
        "temperature": file.optional("temperature"),
        "load": file.optional("load"),
    }
    kept = _complete(file.name, {key: values for key, values in rows.items() if values is not None})
    t, force, position, reference, added, temperature, load = (
        None if values is None else values[kept] for values in rows.values()
    )
    assert t is not None and force is not None and position is not None  # noqa: PT018 (for types)
    sample_time, times = sampling(file.name, t)
    record = AxisRecord(
        name=file.name,
        sample_time=sample_time,
        force=force,
        position=position,
        reference=reference,
        unit=columns.unit,
        added=added,
        times=times,
        temperature=temperature,
        load=load,
        known_load=_known_load(file),
        beyond_limit=beyond,
        wraps=wraps,
    )
    loop = _loop(file, scale, limit)
    if loop is None:
        return record
    if reference is None:
        raise InputError(
            f"{file.name}: the gains of the loop need the column of the reference as well; give --reference."
        )
    if not record.even:
        raise InputError(
            f"{file.name}: rows come at uneven times, and the closed loop is simulated at even ones; "
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
            f"{name}, row {row}: time does not increase ({t[row - 1]:.12g} after {t[row - 2]:.12g} s). "
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


def _times(file: AxisFile) -> NDArray[np.float64]:
    """Return the time of each row (N,): a variable, or rows at the interval that is given instead."""
    times = file.variables.get(file.columns.time)
    if times is not None and times.size != 1:
        return times
    try:
        interval = float(file.columns.time if times is None else times[0])
    except ValueError:
        return file.column("time")
    if not 0.0 < interval <= LARGEST_CELL:
        raise InputError(
            f"{file.name}: --time is {interval:g}; give the variable with the time, or the time between rows, a number "
            "above zero."
        )
    positions = "position" if file.columns.velocity is None or file.columns.position else "velocity"
    return interval * np.arange(len(file.column(positions, default="position")), dtype=np.float64)


def _driving_force(file: AxisFile, rows: int) -> NDArray[np.float64]:
    if file.columns.force not in file.variables:
        try:
            value = float(file.columns.force)
        except ValueError:
            return file.column("force")
        if abs(value) <= LARGEST_CELL:
            return np.full(rows, value)
    return file.column("force")


def _position(file: AxisFile, t: NDArray[np.float64]) -> NDArray[np.float64]:
    if file.columns.position is not None or file.columns.velocity is None:
        return file.column("position", default="position")
    velocity = file.column("velocity")
    if len(velocity) != len(t):
        raise InputError(
            f"{file.name}: the velocity has {len(velocity)} values and the time has {len(t)}; "
            "name a column of the same length."
        )
    known = np.isfinite(velocity) & np.isfinite(t)
    if known.sum() < 2:
        raise InputError(f"{file.name}: the velocity has fewer than two values.")
    whole = np.interp(np.arange(len(t)), np.flatnonzero(known), velocity[known])
    clock = np.interp(np.arange(len(t)), np.flatnonzero(known), t[known])
    travelled = np.append(0.0, np.cumsum(0.5 * (whole[1:] + whole[:-1]) * np.diff(clock)))
    return np.where(known, travelled, np.nan)


def _measured_motion(
    file: AxisFile, t: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64] | None, Wraps]:
    """Return position and reference (N,) unwrapped, and how often the position wrapped."""
    scale = file.factor("position_scale")
    position, reference = scale * _position(file, t), file.optional("reference")
    reference = None if reference is None else scale * reference
    period = wrapping_period(position, scale)
    if not period:
        return position, reference, NO_WRAPS
    position, count = without_wraps(position, period)
    if reference is not None and wrapping_period(reference, scale) == period:
        reference, _ = without_wraps(reference, period)
        if reference.shape == position.shape:
            # both may begin in different turns
            reference = reference - period * np.round(np.nanmedian(reference - position) / period)
    return position, reference, Wraps(count=count, period=period)


def _known_load(file: AxisFile) -> KnownLoad:
    mass = file.number("load_mass")
    if mass < 0.0:
        raise InputError(f"{file.name}: --load-mass is {mass:g}; it must be zero or more.")
    if mass == 0.0:
        return KnownLoad()
    if file.columns.unit == "m":
        return KnownLoad(inertia=mass)
    arm = file.number("load_arm")
    if not arm > 0.0:
        raise InputError(
            f"{file.name}: a load on an axis that turns needs a distance from it above zero, not {arm:g} m; "
            "give --load-arm."
        )
    return KnownLoad(inertia=mass * arm**2, weight=mass * _GRAVITY * arm, hanging=file.number("hanging"))


def _loop(file: AxisFile, scale: float, limit: float) -> PositionVelocityLoop | None:
    columns = file.columns
    if columns.position_gain is None and columns.velocity_gain is None:
        return None
    if columns.position_gain is None or columns.velocity_gain is None:
        raise InputError("The loop needs both gains; give --position-gain and --velocity-gain.")
    if scale < 0.0:
        raise InputError(
            f"{file.name}: --force-scale is {scale:g}; with the gains of a loop it must be above zero. "
            "Negate the force in the file, or leave out the gains."
        )
    return PositionVelocityLoop(
        position_gain=file.factor("position_gain", negative=False),
        velocity_gain=file.factor("velocity_gain", negative=False),
        force_per_input=scale,
        limit=limit,
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


def wrapping_period(position: NDArray[np.float64], scale: float) -> float:
    """Return the period after which a position (N,) begins again; zero for one that does not.

    Parameters
    ----------
    position : ndarray (N,)
        May contain NaN.
    scale : float
        Factor that was applied to the position as it was recorded.
    """
    known = position[np.isfinite(position)]
    if len(known) < 2:
        return 0.0
    travel, steps = float(np.ptp(known)), np.abs(np.diff(known))
    counters = [2.0**bits * abs(scale) for bits in _BITS]
    # of a jump of two periods' size only the right one is within an ordinary step
    for period in (TURN, DEGREES, *counters):
        if not 0.5 * period < travel <= (1.0 + _BEYOND) * period:
            continue
        jumps = steps > 0.5 * period
        usual = float(steps[~jumps].max(initial=0.0))
        if not jumps.any() or usual > _LARGEST_STEP * period:
            continue
        # the axis moves on during the step in which it wraps
        if np.abs(steps[jumps] - period).max() <= 2.0 * usual + _BEYOND * period:
            return period
    return 0.0


def without_wraps(position: NDArray[np.float64], period: float) -> tuple[NDArray[np.float64], int]:
    """Return a position (N,) unwrapped, NaN where it is NaN, and how often it wraps."""
    found = unwrapped(position, period=period)
    turns = np.round((found - position) / period)
    return found, int(np.count_nonzero(np.diff(turns[np.isfinite(turns)])))
