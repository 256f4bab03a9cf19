"""Who takes part: a controller by its word on the command line.

none, full, partial            the nominal gain with that compensation
precise                        the precise controller (`ballbot.control.presets`)
found/controller.toml          a controller file
mine.py:Mine                   a user's own: `Mine(robot)` in that file returns it
adaptive=mine.py:Mine          any of these under another name
found/controller.toml@kalman   any of these with another on-board state than the one that it is made for
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

from ballbot.control.controller import Compensation, Controller
from ballbot.control.file import read_controller
from ballbot.control.interface import Feedback
from ballbot.control.presets import nominal_controller, precise_controller
from ballbot.errors import InputError
from ballbot.estimation.interface import EstimatorName, checked_name
from ballbot.experiments.own_controller import OwnController
from ballbot.printable import shell_line
from ballbot.robot import Robot

#: controllers that are not files
NAMED = (*get_args(Compensation), "precise")


@dataclass(frozen=True, kw_only=True)
class Entrant:
    """A controller under a name, by what makes it."""

    name: str  #: in tables and figures
    source: str  #: one of `NAMED`, a controller file, or FILE.py:NAME
    estimator: EstimatorName | None = (
        None  #: the on-board state it is given; by default the one it is made for
    )

    def controller(self, robot: Robot) -> Feedback:
        """Return it, new.

        Raises
        ------
        InputError
            If there is no such controller, or a user's file does not make one.
        """
        made = self._made(robot)
        return made if self.estimator is None else made.with_estimator(self.estimator)

    def _made(self, robot: Robot) -> Controller | OwnController:
        for compensation in get_args(Compensation):
            if self.source == compensation:
                return nominal_controller(robot, compensation=compensation)
        if self.source == "precise":
            return precise_controller(robot)
        path, _, made_by = self.source.rpartition(":")
        if path.endswith(".py"):
            return OwnController(path, made_by, robot)
        if self.source.endswith(".py"):
            raise InputError(
                f"{self.source} is a Python file. Name the class or function that makes the controller, as "
                f"{shell_line([f'{self.source}:NAME'])}."
            )
        if not Path(self.source).exists():
            raise InputError(
                f"There is no controller {self.source!r}; give a controller file, FILE.py:NAME for your own, or "
                f"{', '.join(NAMED)}."
            )
        return read_controller(self.source, robot)

    @property
    def file(self) -> Path | None:
        """The file it comes from, or None."""
        if self.source in NAMED:
            return None
        path, _, _ = self.source.rpartition(":")
        return Path(path if path.endswith(".py") else self.source)


def entrants_of(words: Sequence[str]) -> tuple[Entrant, ...]:
    """Return those whom words of the command line name.

    Each gets the on-board state that it is made for unless its word names another.

    Raises
    ------
    InputError
        Where there is none, two have one name, or there is no such estimator.
    """
    if not words:
        raise InputError("There is nothing to compare: at least one controller is needed.")
    short = [Path(word).name for word in words]
    found: dict[str, Entrant] = {}
    for word, ending in zip(words, short, strict=True):
        name, equals, source = word.partition("=")
        if not equals:  # by its file's name, where that tells it apart
            name, source = ending if short.count(ending) == 1 else word, word
        source, estimator = _parted(source)
        one = Entrant(name=name, source=source, estimator=estimator)
        if not (one.name and one.source):
            raise InputError(f"The controller {word!r} lacks its name or its source; write NAME=SOURCE.")
        if one.name in found:
            raise InputError(f"Two controllers are called {one.name!r}; rename one with NAME=SOURCE.")
        found[one.name] = one
    return tuple(found.values())


def _parted(source: str) -> tuple[str, EstimatorName | None]:
    """Return the source and the estimator, if one is named, of SOURCE or SOURCE@ESTIMATOR."""
    before, at, after = source.rpartition("@")
    if at and "/" not in after:
        return before, checked_name(after)
    return source, None
