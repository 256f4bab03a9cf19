"""What is found in a foreign log."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from ballbot.findings import Finding
from ballbot.log.formats.inference import ForeignTable
from ballbot.log.mapping_search.commands import Assignment
from ballbot.log.mapping_search.frame import Frame
from ballbot.log.mapping_search.motion import Columned, Motion
from ballbot.log.mapping_search.names import InputKind
from ballbot.log.mapping_search.placement import LeanTest
from ballbot.log.mapping_search.roles import Roles
from ballbot.log.mapping_search.units import Unit

KINDS: tuple[InputKind, ...] = ("torque", "current", "voltage", "duty")
What = Literal["balancing", "held by hand", "free wheels", "IMU only"]


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
class Drive:
    """What the commands are."""

    assigned: Assignment | None  #: None if the motion cannot be compared with them
    kind: InputKind | None  #: None if nobody states it
    scale: float  #: what turns the file's number into N m, A, V or a duty
    scales: tuple[str, ...]  #: names of scales that fit alike, the likeliest first; empty if one is clear
    #: by kind, the likeliest scale and how many times as large as the motion needs the torques then are
    ratios: dict[InputKind, tuple[float, float]]
    delay: float  #: [s]
    delay_error: float

    @property
    def ratio(self) -> float:
        """How many times as large as the motion needs the torques are; nan if that is not known."""
        return self.ratios[self.kind][1] if self.kind in self.ratios else float("nan")


@dataclass(frozen=True, kw_only=True, eq=False)
class Proposal:
    """What a foreign log is; `ballbot.log.mapping_search.text` writes its mapping."""

    table: ForeignTable
    base: Columned
    rows: tuple[int, int] | None  #: first and last row to take, from 1; None for all
    repeated: bool
    unordered: bool
    time: Unit
    lean: Unit | None
    motion: Motion | None  #: None without wheels
    frame: Frame
    keep: tuple[tuple[float, float], ...] | None  #: spans of balancing [s]
    what: What
    drive: Drive | None = None
    questions: tuple[Question, ...] = ()
    contradiction: str = ""  #: why it is not this robot's log, in a sentence; empty if nothing says so
    findings: tuple[Finding, ...] = ()

    @property
    def file(self) -> Path:
        return self.base.path

    @property
    def roles(self) -> Roles:
        return self.base.roles

    @property
    def tested(self) -> LeanTest | None:
        return self.motion.tested if self.motion else None
