"""One axis: what is recorded of it, and how a file holds that.

`AxisRecord`: force and position of one axis over time, and the loop that moved it where that is known.

The axis is   M a = F - offset - friction(v)   with F held over a sample. For an axis that turns, M is an inertia
[kg m^2], forces are torques [N m] and positions angles [rad].

A file of any format of logs holds it, as columns or named variables (docs/logs.md).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import real_array, whole_number
from ballbot.errors import InputError, suggest
from ballbot.log.columns import LARGEST_CELL, Columns
from ballbot.log.formats import read_variables

#: rows that make a record too short for any of the methods
LEAST_ROWS = 200
#: a sampling interval may differ from the mean one by this share of it
LARGEST_JITTER = 0.05


@dataclass(frozen=True, kw_only=True)
class PositionVelocityLoop:
    """A position loop around a velocity loop, both proportional.

    u = k_v (k_p (reference - position) - velocity), within +-limit; force = force_per_input u

    The velocity is the position's difference over `span` samples.
    """

    position_gain: float  #: k_p [1/s]
    velocity_gain: float  #: k_v [input s/m]
    force_per_input: float  #: [N/input]
    limit: float = np.inf  #: largest |u|
    span: int = 1  #: samples that the velocity is a difference over

    def __post_init__(self) -> None:
        for name in ("position_gain", "velocity_gain", "force_per_input", "limit"):
            if not getattr(self, name) > 0.0:
                raise InputError(f"The loop's {name} is {getattr(self, name):g}; it must be above zero.")
        whole_number(self.span, "The loop's span of samples", least=1)


@dataclass(frozen=True, kw_only=True, eq=False)
class AxisRecord:
    """A record at even intervals.

    Raises
    ------
    InputError
        If lengths differ, values are missing, the axis never moves, or there are too few rows.
    """

    name: str
    sample_time: float  #: h [s]
    force: NDArray[np.float64]  #: (N,) F [N], held from each row to the next
    position: NDArray[np.float64]  #: (N,) [m]
    reference: NDArray[np.float64] | None = None  #: (N,) [m]; needed for closed loop
    loop: PositionVelocityLoop | None = None  #: needed for closed loop
    unit: Literal["m", "rad"] = "m"
    added: NDArray[np.float64] | None = None  #: (N,) the part of `force` that is not the loop's [N]

    def __post_init__(self) -> None:
        if not 0.0 < self.sample_time < np.inf:
            raise InputError(
                f"{self.name}: the sample time is {self.sample_time:g} s; it must be above zero."
            )
        for name in ("force", "position", "reference", "added"):
            if getattr(self, name) is None:
                continue
            # contiguous and writable, as compiled code takes it
            values = real_array(getattr(self, name), ("N",), f"{self.name}: {name}", finite=False)
            object.__setattr__(self, name, values)
            if values.shape != (len(self.force),):
                raise InputError(
                    f"{self.name}: {('the added force' if name == 'added' else name)} has {values.size} "
                    f"values and the force has {self.force.size}; name a column of the same length."
                )
            if not np.isfinite(values).all():
                row = int(np.flatnonzero(~np.isfinite(values))[0]) + 1
                raise InputError(
                    f"{self.name}: {name} is missing or not finite in row {row}; every row needs a value."
                )
        if len(self) < LEAST_ROWS:
            raise InputError(f"{self.name} has {len(self)} rows; at least {LEAST_ROWS} are needed.")
        if np.ptp(self.position) == 0.0:
            raise InputError(
                f"{self.name}: the position never changes, so friction cannot be identified; check its column."
            )

    def __len__(self) -> int:
        return len(self.force)

    @property
    def loop_force(self) -> NDArray[np.float64]:
        """The part of the force that its loop gives (N,) [N]."""
        return self.force if self.added is None else self.force - self.added

    @property
    def t(self) -> NDArray[np.float64]:
        """Time from the record's start (N,) [s]."""
        return self.sample_time * np.arange(len(self), dtype=np.float64)

    @property
    def force_unit(self) -> str:
        """[N], or [N m] for an axis that turns."""
        return "N" if self.unit == "m" else "N m"


def even_sample_time(name: str, t: NDArray[np.float64]) -> float:
    """Return the sample time [s] of rows at times t (N,).

    Raises
    ------
    InputError
        If time does not increase, or not by even steps.
    """
    if len(t) < 2 or not np.isfinite(t).all():
        raise InputError(f"{name}: the time has fewer than two rows or missing values.")
    steps = np.diff(t)
    mean = float(t[-1] - t[0]) / len(steps)
    if mean <= 0.0 or np.abs(steps - mean).max() > LARGEST_JITTER * mean:
        row = int(np.abs(steps - mean).argmax()) + 2
        raise InputError(
            f"{name}: time increases by {steps[row - 2]:g} s at row {row} and "
            f"by {mean:g} s on average; identify-axis needs equal intervals."
        )
    return mean


@dataclass(frozen=True, kw_only=True)
class AxisColumns:
    """The variables of a file. A number is written out, or is the name of a scalar variable."""

    time: str = "t"
    """The variable with the time, in seconds."""

    position: str = "position"
    """The variable with the position, in metres or radians."""

    force: str = "force"
    """The variable with the force, torque, current or voltage that drives the axis."""

    force_scale: str = "1"
    """Factor from that variable to newtons or newton metres: a number, or a variable of the file."""

    added_force: str | None = None
    """The variable with an additional force on the axis, in newtons (newton metres)."""

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


def read_axis_record(path: str | Path, columns: AxisColumns) -> AxisRecord:
    """Read a record.

    Raises
    ------
    InputError
        If the file cannot be read, a variable is missing or is of the wrong shape, or the rows make no record.
    """
    variables = read_variables(path)
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
        if values.size != 1:
            raise InputError(f"{name}: {text!r} has {values.size} values; it must be one number.") from None
        value = float(values[0])
    if not abs(value) <= LARGEST_CELL:
        raise InputError(f"{name}: {text!r} is {value:g}; it must be a finite number.")
    return value
