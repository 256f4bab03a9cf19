"""What a long identification tells while it runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Progress:
    """How far an identification has come."""

    generation: int  #: generations of the evolution and, after them, steps of the polish that are done
    of: int  #: how many there will be at most
    cost: float  #: the best cost so far; see `ballbot.identification.prediction.Cost`


Report = Callable[[Progress], None]
