"""What is found in a foreign log, and what its user says of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ballbot.findings import Finding
from ballbot.log.columns import Columns
from ballbot.log.formats.inference import ForeignTable
from ballbot.log.mapping_search.commands import Assignment, Response
from ballbot.log.mapping_search.frame import Frame, HeadingTest
from ballbot.log.mapping_search.names import InputKind
from ballbot.log.mapping_search.placement import LeanTest
from ballbot.log.mapping_search.roles import Roles
from ballbot.log.mapping_search.units import Unit
from ballbot.log.signals import Smooth

KINDS: tuple[InputKind, ...] = ("torque", "current", "voltage", "duty")
What = Literal["balancing", "held by hand", "free wheels", "IMU only"]


@dataclass(frozen=True, kw_only=True)
class Stated:
    """What the user says of the firmware that wrote the log."""

    command: InputKind | None = None
    full_scale: float | None = None  #: the file's number for full duty
    counts_per_turn: float | None = None  #: of a wheel's encoder
    columns: Sequence[str] | None = None  #: names in the file's order


@dataclass(frozen=True, kw_only=True)
class Question:
    """What the log and its user leave open."""

    key: str  #: where the answer stands: "[input] kind"
    name: str  #: "kind of the command"
    answers: tuple[str, ...]  #: the likeliest first
    evidence: str

    @property
    def text(self) -> str:
        """The question with its alternatives."""
        return f"{self.name} ({' or '.join(self.answers)}): {self.evidence}"


@dataclass(frozen=True, kw_only=True)
class Gyro:
    """How the columns of a gyro belong to roll, pitch and yaw."""

    order: tuple[int, ...]  #: for x, y, z in turn, the place of its column (from 0) among the gyro's
    signs: tuple[int, ...]
    unit: Unit
    correlations: tuple[float, ...]  #: with the rates of the angles


@dataclass(frozen=True, kw_only=True)
class Drive:
    """What the commands are."""

    assigned: Assignment | None  #: None if the motion cannot be compared with them
    response: Response | None
    kind: InputKind | None  #: None if nobody states it
    scale: float  #: what turns the file's number into N m, A, V or a duty
    reason: str
    #: by kind, the likeliest scale and how many times as large as the motion needs the torques then are
    ratios: dict[InputKind, tuple[float, float]]
    delay: float  #: [s]
    delay_error: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Signals:
    """A file's signals on even rows."""

    rows: NDArray[np.float64]  #: (N,) [s]
    wheels: Smooth
    lean: Smooth | None
    heading: Smooth | None
    usable: NDArray[np.bool_]  #: moving and not fallen


@dataclass(frozen=True, kw_only=True)
class Continued:
    """How the times and angles of the file are repaired."""

    #: noise of the speeds [rad/s] with the file's times and with those of the encoders, if these are taken
    noise: tuple[float, float] | None = None
    largest_speed: float | None = None  #: [rad/s], if an encoder was reset
    wrap: float | None = None  #: period of the wheel angles in the file's numbers


@dataclass(frozen=True, kw_only=True, eq=False)
class Proposal:
    """What a foreign log is; `ballbot.log.mapping_search.text` writes its mapping."""

    file: Path
    table: ForeignTable
    roles: Roles
    cut: Columns  #: the rows that are taken
    rows: tuple[int, int] | None  #: first and last row to take, from 1; None for all
    repeated: bool
    unordered: bool
    time: Unit
    wheel: Unit
    lean: Unit | None
    heading_unit: Unit | None
    gyro: Gyro | None
    continued: Continued
    tested: LeanTest | None
    heading: HeadingTest | None
    frame: Frame
    drive: Drive | None
    keep: tuple[tuple[float, float], ...] | None  #: spans of balancing [s]
    sample_time: float  #: of even rows [s]
    what: What
    questions: tuple[Question, ...]
    contradiction: str  #: why it is not this robot's log, in a sentence; empty if nothing says so
    findings: tuple[Finding, ...]
    stated: Stated
