"""What a check found in a log, as a value."""

from dataclasses import dataclass
from typing import Literal

Severity = Literal["error", "warning", "note"]


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One thing found in a log.

    An error makes results from the log wrong; a warning is to be known before it is used; a note is a fact.
    """

    severity: Severity
    kind: str  #: a word to sort by: gap, jitter, missing, constant, stuck, saturation, degrees, sign, ...
    sentence: str  #: what is wrong, where, and what would be right
    columns: tuple[str, ...] = ()  #: the columns it is about
    time: float | None = None  #: [s], where it is or begins, if at one place
