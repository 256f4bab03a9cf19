"""The tables of a mapping file as values, checked as they are read; `ballbot.log.mapping_file` shows every key."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Literal

from pydantic import (
    BeforeValidator,
    ConfigDict,
    Field,
    FiniteFloat,
    NonNegativeInt,
    PositiveFloat,
    PositiveInt,
)

from ballbot.log.columns import MAX_WHEELS
from ballbot.log.mapping import CurrentInput, DutyInput, Timing, TorqueInput

Sign = Literal[1, -1]


@dataclass(frozen=True, kw_only=True)
class FileTable:
    """[file]: the layout of the text."""

    separator: Literal["comma", "semicolon", "tab", "blanks"] = "comma"
    decimal: Literal["point", "comma"] = "point"
    missing: tuple[str, ...] = ()
    header_lines: NonNegativeInt = 1
    names: tuple[str, ...] | None = None
    damaged_rows: Literal["refuse", "drop"] = "refuse"
    repeated_rows: Literal["refuse", "drop"] = "refuse"
    unordered_rows: Literal["refuse", "drop"] = "refuse"
    rows: tuple[PositiveInt, PositiveInt] | None = None


@dataclass(frozen=True, kw_only=True)
class RatesTable:
    """`rates` of [attitude]: the gyro of the IMU."""

    sources: Annotated[tuple[str, ...], Field(alias="from", min_length=3, max_length=3)]
    unit: str | None = None
    scale: FiniteFloat = 1.0
    sign: Sign | tuple[Sign, ...] = 1
    delay: FiniteFloat = 0.0


@dataclass(frozen=True, kw_only=True)
class AttitudeTable:
    """[attitude]: roll, pitch and yaw of an IMU, or its quaternion w, x, y, z."""

    sources: Annotated[tuple[str, ...], Field(alias="from", min_length=2, max_length=4)]
    unit: str | tuple[str, ...] | None = None
    sign: Sign | tuple[Sign, ...] = 1
    turn: FiniteFloat = 0.0
    upside_down: bool = False
    delay: FiniteFloat = 0.0
    rates: RatesTable | None = None


@dataclass(frozen=True, kw_only=True)
class ColumnTable:
    """An entry of [columns]."""

    source: Annotated[str | None, Field(alias="from")] = None
    derivative_of: str | None = None
    unit: str | None = None
    counts_per_turn: PositiveFloat | None = None
    scale: FiniteFloat = 1.0
    sign: Sign = 1
    offset: FiniteFloat = 0.0
    delay: FiniteFloat = 0.0
    nanoseconds: str | None = None


@dataclass(frozen=True, kw_only=True)
class WheelColumnsTable:
    """`angle` and `speed` of [wheels]: a column of the file for each wheel."""

    sources: Annotated[tuple[str, ...] | None, Field(alias="from", min_length=1, max_length=MAX_WHEELS)] = (
        None
    )
    derivative_of: Literal["angle"] | None = None
    integral_of: Literal["speed"] | None = None
    unit: str | None = None
    counts_per_turn: PositiveFloat | None = None
    scale: FiniteFloat = 1.0
    delay: FiniteFloat = 0.0
    wrap: PositiveFloat | None = None
    largest_speed: PositiveFloat | None = None


@dataclass(frozen=True, kw_only=True)
class WheelsTable:
    """[wheels]."""

    order: tuple[int, ...] | None = None
    sign: Sign | tuple[Sign, ...] = 1
    angle: WheelColumnsTable | None = None
    speed: WheelColumnsTable | None = None


@dataclass(frozen=True, kw_only=True)
class MotorsTable:
    """The keys of every kind of [input]."""

    sources: Annotated[tuple[str, ...], Field(alias="from", min_length=1, max_length=MAX_WHEELS)]
    sign: Sign | tuple[Sign, ...] = 1
    scale: FiniteFloat = 1.0
    zero: FiniteFloat | tuple[FiniteFloat, ...] = 0.0
    direction: tuple[str, ...] = ()
    delay: FiniteFloat = 0.0


@dataclass(frozen=True, kw_only=True)
class TorqueTable(MotorsTable, TorqueInput):
    """[input] of kind torque [N m at the wheel]."""

    kind: Literal["torque"]
    unit: str | None = None


@dataclass(frozen=True, kw_only=True)
class CurrentTable(MotorsTable, CurrentInput):
    """[input] of kind current [A]."""

    kind: Literal["current"]


@dataclass(frozen=True, kw_only=True)
class DutyTable(MotorsTable, DutyInput):
    """[input] of kind duty [-1..1], or of the same by its older name pwm."""

    kind: Literal["duty", "pwm"]


@dataclass(frozen=True, kw_only=True)
class VoltageTable(MotorsTable, DutyInput):
    """[input] of kind voltage [V]: a duty of the supply's."""

    kind: Literal["voltage"]


InputTable = TorqueTable | CurrentTable | VoltageTable | DutyTable


def _column_table(value: object) -> object:
    return {"from": value} if isinstance(value, str) else value


@dataclass(frozen=True, kw_only=True)
class MappingTable:
    """A whole mapping file."""

    __pydantic_config__ = ConfigDict(extra="forbid")  # also of the tables in it

    complete: bool = True
    file: FileTable = FileTable()
    time: Timing = field(default_factory=Timing)
    columns: dict[str, Annotated[ColumnTable, BeforeValidator(_column_table)]]
    attitude: AttitudeTable | None = None
    wheels: WheelsTable = WheelsTable()
    input: Annotated[InputTable, Field(discriminator="kind")] | None = None
