"""Candidates: the controllers of a comparison, as the command line names them.

none, full, partial            the nominal gain with that compensation
precise                        the precise controller, or another of `ballbot.control.presets`
found/controller.toml          a controller file
mine.py:Mine                   a user's own: `Mine(robot)` in that file returns it (docs/python.md)
adaptive=mine.py:Mine          any of these under another name
found/controller.toml@kalman   any of these with another on-board state than the one that it is made for
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar, cast, get_args

import numpy as np

from ballbot.arrays import Floats, checked_sample_time
from ballbot.control.controller import Compensation, Controller
from ballbot.control.interface import Feedback, estimator_of
from ballbot.control.presets import KINDS, nominal_controller
from ballbot.control.source import named_controller
from ballbot.errors import InputError, suggest
from ballbot.estimation.interface import EstimatorName, checked_name
from ballbot.files import sha256_of
from ballbot.printable import shell_line
from ballbot.robot import Robot, RobotLike, as_robot
from ballbot.user_files import error_text, user_module

_Result = TypeVar("_Result")


class UserController:
    """A user's controller, made by their file; an error in it is reported in one sentence.

    A copy, in this process or in another, is made again from the file, so that runs share no state.
    """

    sample_time: float  #: [s]
    estimator: EstimatorName  #: of its on-board state; the user's `estimator`, else "onboard"

    def __init__(self, path: str, made_by: str, robot: Robot, estimator: EstimatorName | None = None) -> None:
        """Call `made_by(robot)` in the Python file at `path`; `estimator` replaces the one that it names."""
        self._path, self._made_by, self._robot = path, made_by, robot
        make: Callable[[Robot], object] | None = getattr(user_module(path), made_by, None)
        if not callable(make):
            raise InputError(
                f"{path} has no {made_by!r} to call; it must be a class or a function that takes the robot."
            )
        self._checksum = sha256_of(Path(path))
        controller = self._guarded("when it was made", lambda: make(robot))
        lacking = [name for name in ("sample_time", "reset", "update") if not hasattr(controller, name)]
        if lacking:
            raise InputError(
                f"The controller of {self._place} has no {lacking[0]}; it needs sample_time, reset() and "
                "update(t, state, reference)."
            )
        self._made = cast("Feedback", controller)
        self.sample_time = self._made.sample_time
        checked_sample_time(self.sample_time, f"the sample_time of {self._place}")
        self.estimator = estimator or estimator_of(self._made)

    def with_estimator(self, estimator: EstimatorName) -> UserController:
        """Return a new one of the same file for another on-board state."""
        return UserController(self._path, self._made_by, self._robot, estimator)

    def __reduce__(self) -> tuple[Callable[..., UserController], tuple[object, ...]]:
        return _remake, (self._path, self._made_by, self._robot, self.estimator, self._checksum)

    def reset(self) -> None:
        """Forget everything that happened so far."""
        self._guarded("in reset()", self._made.reset)

    def update(self, t: float, state: Floats, reference: Floats) -> Floats:
        """Return the wheel torques (n,) [N m]."""
        torques = self._guarded(f"at t = {t:g} s", lambda: self._made.update(t, state, reference))
        try:
            values = np.array(torques, dtype=np.float64)
        except (TypeError, ValueError):
            raise InputError(
                f"{self._place} returned {type(torques).__name__} at t = {t:g} s, but it must return an array "
                "of torques."
            ) from None
        if not np.isfinite(values).all():  # a mistake in the user's program, not a fall
            raise InputError(
                f"{self._place} returned torques {values.tolist()} at t = {t:g} s; all must be finite."
            )
        return values

    @property
    def _place(self) -> str:
        return f"{self._path}:{self._made_by}"

    def _guarded(self, moment: str, call: Callable[[], _Result]) -> _Result:
        try:
            return call()
        except InputError:
            raise
        except (Exception, SystemExit) as error:
            raise InputError(
                f"{self._place} failed {moment}: {error_text(error, Path(self._path))}."
            ) from error


def _remake(path: str, made_by: str, robot: Robot, estimator: EstimatorName, checksum: str) -> UserController:
    """Return a copy of a controller; raise InputError if its file has changed."""
    if not Path(path).is_file() or sha256_of(Path(path)) != checksum:
        raise InputError(
            f"{path} was changed while {path}:{made_by} ran; start again, so that all runs have the same controller."
        )
    return UserController(path, made_by, robot, estimator)


#: controllers that are not files
NAMED_CONTROLLERS = (*get_args(Compensation), *(name for name in KINDS if name != "nominal"))


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """A controller under a name, by what makes it."""

    name: str  #: in tables and figures
    source: str  #: one of `NAMED`, a controller file, or FILE.py:NAME
    estimator: EstimatorName | None = None  #: its on-board state, if not the one that it is made for

    def controller(self, robot: RobotLike) -> Feedback:
        """Return a new controller; raise InputError if the name is unknown, or a user's file does not make one."""
        controller = self._made(as_robot(robot))
        return controller if self.estimator is None else controller.with_estimator(self.estimator)

    def _made(self, robot: Robot) -> Controller | UserController:
        for compensation in get_args(Compensation):
            if self.source == compensation:
                return nominal_controller(robot, compensation=compensation)
        path, _, made_by = self.source.rpartition(":")
        if path.endswith(".py"):
            return UserController(path, made_by, robot)
        if self.source.endswith(".py"):
            raise InputError(
                f"{self.source} is a Python file. Name the class or function that makes the controller, as "
                f"{shell_line([f'{self.source}:NAME'])}."
            )
        if self.source not in NAMED_CONTROLLERS and not Path(self.source).exists():
            otherwise = "give a controller file, FILE.py:NAME for your own, or one of"
            hint = suggest(self.source, NAMED_CONTROLLERS, otherwise=otherwise)
            raise InputError(f"There is no controller {self.source!r}; {hint}")
        return named_controller(self.source, robot)


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
