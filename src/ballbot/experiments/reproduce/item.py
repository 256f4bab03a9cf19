"""What is said of one figure or table of the thesis, and the numbers that decide whether ours agrees."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

Verdict = Literal["agrees", "agrees in part", "does not agree", "drawn"]
#: what is said of several items with a verdict, in the order of a summary
VERDICTS: Mapping[Verdict, str] = MappingProxyType(
    {
        "agrees": "agree",
        "agrees in part": "agree in part",
        "does not agree": "do not agree",
        "drawn": "are drawings",
    }
)


@dataclass(frozen=True, kw_only=True)
class Check:
    """Something that is claimed, and the number of ours that it is held against.

    It agrees where `lowest` <= `value` <= `highest`.
    """

    claim: str  #: a clause: "without friction the ball reaches the reference"
    quantity: str  #: what is measured, in words
    value: float
    unit: str = ""
    lowest: float = -math.inf
    highest: float = math.inf

    @property
    def agrees(self) -> bool:
        """Whether the number is within the criterion; one that is not a number is not."""
        return self.lowest <= self.value <= self.highest

    @property
    def criterion(self) -> str:
        """The criterion in words."""
        unit = f" {self.unit}" if self.unit else ""
        if math.isinf(self.lowest):
            return f"at most {_digits(self.highest)}{unit}"
        if math.isinf(self.highest):
            return f"at least {_digits(self.lowest)}{unit}"
        return f"{_digits(self.lowest)} to {_digits(self.highest)}{unit}"

    @property
    def measured(self) -> str:
        """The number with its unit."""
        return f"{_digits(self.value)}{f' {self.unit}' if self.unit else ''}"


@dataclass(frozen=True, kw_only=True)
class Rows:
    """A table of texts."""

    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, kw_only=True)
class Item:
    """A figure or table of the thesis beside ours."""

    name: str  #: "Figure 5.6", "Table 4.1"
    title: str
    thesis: str  #: what the thesis shows, a sentence
    ours: str  #: what ours shows, a sentence or two
    checks: tuple[Check, ...] = ()  #: none for a drawing
    table: Rows | None = None

    @property
    def key(self) -> str:
        """The name for files: "figure_5_6"."""
        return self.name.lower().replace(" ", "_").replace(".", "_")

    @property
    def verdict(self) -> Verdict:
        """What the checks say together."""
        if not self.checks:
            return "drawn"
        agreeing = sum(check.agrees for check in self.checks)
        if agreeing == len(self.checks):
            return "agrees"
        return "agrees in part" if agreeing else "does not agree"

    @property
    def sentence(self) -> str:
        """The verdict in words, with what does not agree."""
        if self.verdict == "drawn":
            return "A drawing; there is nothing to agree or not."
        if self.verdict == "agrees":
            return "Ours agrees."
        off = "; nor that ".join(
            f"{check.claim} ({check.quantity}: {check.measured}; asked is {check.criterion})"
            for check in self.checks
            if not check.agrees
        )
        return f"Ours {self.verdict}: it does not show that {off}."


@dataclass(frozen=True, kw_only=True)
class Mistake:
    """A misprint or mistake of the thesis, with the number that shows it."""

    number: int  #: in the list of design section 10
    where: str  #: the equation or section
    thesis: str  #: what it says
    right: str  #: what it should say
    shown_by: tuple[Check, ...]  #: numbers that would not be so were the thesis right

    @property
    def proven(self) -> bool:
        """Whether every number shows it."""
        return all(check.agrees for check in self.shown_by)


def _digits(value: float) -> str:
    return f"{value:.5g}" if abs(value) >= 10.0 else f"{value:.4g}"
