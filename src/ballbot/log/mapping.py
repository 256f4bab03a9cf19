"""How a foreign table becomes a log, as values; `ballbot.log.apply_mapping` is what does it.

Each of Ballbot's columns comes from one of the file's, times a factor (unit, scale, sign) plus an offset, or is the
derivative of another of Ballbot's columns, or comes with others from an IMU's roll, pitch and yaw.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ballbot.log.drive_input import DriveInput
from ballbot.log.text_table import TextLayout


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
class Attitude:
    """Roll, pitch and, where the file has it, yaw of an IMU; see `ballbot.log.attitude`."""

    sources: tuple[Source, ...]
    turn: float = 0.0  #: angle of the IMU's x axis from the robot's, towards the left [rad]


@dataclass(frozen=True, kw_only=True)
class Timing:
    """Which moments the log's rows are of."""

    repair: bool = False  #: whether the encoders say when a row was sampled; see `ballbot.log.sampling_times`
    sample_time: float | None = None  #: of rows at even intervals [s]; the file's own rows where it is None
    keep: tuple[tuple[float, float], ...] | None = (
        None  #: spans of the file's clock to keep [s]; None keeps all
    )


@dataclass(frozen=True, kw_only=True)
class LogMapping:
    """How a foreign file becomes a log; see `ballbot.log.mapping_file` for its TOML form."""

    layout: TextLayout
    columns: Mapping[str, Source]  #: by Ballbot's name, t among them
    derivatives: Mapping[str, str]  #: by Ballbot's name, which of Ballbot's columns to differentiate
    motors: MotorInput | None
    attitude: Attitude | None = None
    timing: Timing = Timing()
    largest_speed: float | None = (
        None  #: [rad/s]; a wheel angle that moves faster was reset and is carried on
    )
