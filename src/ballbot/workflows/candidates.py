"""Controllers as `compare`, `limits` and `view` name them on the command line; a study's are in `controller_choice`.

found/controller.toml          a controller as `ballbot.control.source` reads it
adaptive=mine.py:Mine          any under another name
found/controller.toml@kalman   any with another on-board state than the one that it is made for
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ballbot.control.controller import Controller
from ballbot.control.source import UserController, read_source
from ballbot.errors import InputError
from ballbot.estimation.interface import EstimatorName, checked_name
from ballbot.robot import RobotLike


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """A controller under a name, by what makes it."""

    name: str  #: in tables and figures
    source: str  #: see `ballbot.control.source`
    estimator: EstimatorName | None = None  #: its on-board state, if not the one that it is made for

    def controller(self, robot: RobotLike) -> Controller | UserController:
        """Return a new controller; raise InputError if the name is unknown, or a user's file does not make one."""
        controller = read_source(self.source, robot)
        return controller if self.estimator is None else controller.with_estimator(self.estimator)


def parse_candidates(words: Sequence[str]) -> tuple[Candidate, ...]:
    """Return the candidates that words of the command line name; InputError if they name none, or two alike."""
    if not words:
        raise InputError("There is nothing to compare: at least one controller is needed.")
    short = [Path(word).name for word in words]
    by_name: dict[str, Candidate] = {}
    for word, ending in zip(words, short, strict=True):
        name, equals, source = word.partition("=")
        if not equals:  # by its file's name, if that is unique
            name, source = ending if short.count(ending) == 1 else word, word
        before, at, estimator = source.rpartition("@")
        if not at or "/" in estimator:
            before, estimator = source, ""
        if not (name and before):
            raise InputError(f"The controller {word!r} lacks its name or its source; write NAME=SOURCE.")
        if name in by_name:
            raise InputError(f"Two controllers are called {name!r}; rename one with NAME=SOURCE.")
        known = checked_name(estimator) if estimator else None
        by_name[name] = Candidate(name=name, source=before, estimator=known)
    return tuple(by_name.values())
