"""What a mapping file may hold, key by key: the pydantic side of `ballbot.log.mapping_file`."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    FiniteFloat,
    NonNegativeInt,
    PositiveFloat,
    PositiveInt,
)

from ballbot.log.columns import MAX_WHEELS

Sign = Literal[1, -1]


class Table(BaseModel):
    """A TOML table whose keys are all known."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class FileTable(Table):
    """[file]: how the text is laid out."""

    separator: Literal["comma", "semicolon", "tab", "blanks"] = "comma"
    missing: tuple[str, ...] = ()
    header_lines: NonNegativeInt = 1
    names: tuple[str, ...] | None = None
    damaged_rows: Literal["refuse", "drop"] = "refuse"
    rows: tuple[PositiveInt, PositiveInt] | None = None


class TimeTable(Table):
    """[time]: which moments, and at which intervals."""

    repair: bool = False
    sample_time: PositiveFloat | None = None
    keep: tuple[tuple[FiniteFloat, FiniteFloat], ...] | None = None


class AttitudeTable(Table):
    """[attitude]: roll, pitch and yaw of an IMU."""

    sources: tuple[str, ...] = Field(alias="from", min_length=2, max_length=3)
    unit: str | None = None
    sign: Sign | tuple[Sign, ...] = 1
    turn: FiniteFloat = 0.0
    delay: FiniteFloat = 0.0


class ColumnTable(Table):
    """An entry of [columns]."""

    source: str | None = Field(None, alias="from")
    derivative_of: str | None = None
    unit: str | None = None
    counts_per_turn: PositiveFloat | None = None
    scale: FiniteFloat = 1.0
    sign: Sign = 1
    offset: FiniteFloat = 0.0
    delay: FiniteFloat = 0.0


class WheelColumnsTable(Table):
    """`angle` and `speed` of [wheels]: a column of the file for each wheel."""

    sources: tuple[str, ...] | None = Field(None, alias="from", min_length=1, max_length=MAX_WHEELS)
    derivative_of: Literal["angle"] | None = None
    unit: str | None = None
    counts_per_turn: PositiveFloat | None = None
    scale: FiniteFloat = 1.0
    delay: FiniteFloat = 0.0
    largest_speed: PositiveFloat | None = None


class WheelsTable(Table):
    """[wheels]."""

    order: tuple[int, ...] | None = None
    sign: Sign | tuple[Sign, ...] = 1
    angle: WheelColumnsTable | None = None
    speed: WheelColumnsTable | None = None


class MotorsTable(Table):
    """What every kind of [input] has."""

    sources: tuple[str, ...] = Field(alias="from", min_length=1, max_length=MAX_WHEELS)
    sign: Sign | tuple[Sign, ...] = 1
    scale: FiniteFloat = 1.0
    delay: FiniteFloat = 0.0


class TorqueTable(MotorsTable):
    """[input] of kind torque [N m at the wheel]."""

    kind: Literal["torque"]
    unit: str | None = None


class CurrentTable(MotorsTable):
    """[input] of kind current [A]."""

    kind: Literal["current"]
    torque_constant: PositiveFloat
    gear_ratio: PositiveFloat
    efficiency: float = Field(1.0, gt=0.0, le=1.0)


class DutyTable(MotorsTable):
    """[input] of kind pwm [duty, -1..1]."""

    kind: Literal["pwm"]
    supply_voltage: PositiveFloat
    torque_constant: PositiveFloat
    back_emf_constant: PositiveFloat
    resistance: PositiveFloat
    gear_ratio: PositiveFloat
    dead_band: float = Field(0.0, ge=0.0, lt=1.0)
    duty_limit: float = Field(1.0, gt=0.0, le=1.0)


def _column_table(value: object) -> object:
    return {"from": value} if isinstance(value, str) else value


class MappingTable(Table):
    """A whole mapping file."""

    file: FileTable = FileTable()
    time: TimeTable = TimeTable()
    columns: dict[str, Annotated[ColumnTable, BeforeValidator(_column_table)]]
    attitude: AttitudeTable | None = None
    wheels: WheelsTable = WheelsTable()
    input: Annotated[TorqueTable | CurrentTable | DutyTable, Field(discriminator="kind")] | None = None
