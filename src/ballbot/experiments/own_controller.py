"""A user's own controller, from a Python file: FILE.py:NAME, where NAME(robot) makes it.

class Mine:
    sample_time = 0.005

    def __init__(self, robot: ballbot.Robot) -> None: ...
    def reset(self) -> None: ...
    def update(self, t, state, reference): return torques
"""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from ballbot.control.interface import Feedback
from ballbot.errors import InputError
from ballbot.robot import Robot

_Result = TypeVar("_Result")


class OwnController:
    """A user's controller, made by their file; what goes wrong in it is told in one sentence.

    A copy, in this process or in another, is made anew from the file: so that runs cannot remember each other.
    """

    sample_time: float  #: [s]

    def __init__(self, path: str, made_by: str, robot: Robot) -> None:
        """Make it: `made_by(robot)` in the Python file at `path`."""
        self._path, self._made_by, self._robot = path, made_by, robot
        make = _attribute(path, made_by)
        made = self._guarded("when it was made", lambda: make(robot))
        lacking = [name for name in ("sample_time", "reset", "update") if not hasattr(made, name)]
        if lacking:
            raise InputError(
                f"what {self._place} makes has no {lacking[0]}; a controller has sample_time, reset() and "
                "update(t, state, reference)."
            )
        self._made = cast("Feedback", made)
        self.sample_time = self._made.sample_time
        if not (isinstance(self.sample_time, int | float) and 0.0 < self.sample_time < np.inf):
            raise InputError(
                f"the sample_time of {self._place} is {self.sample_time!r}; it must be above zero."
            )

    def __reduce__(self) -> tuple[type[OwnController], tuple[str, str, Robot]]:
        return OwnController, (self._path, self._made_by, self._robot)

    def reset(self) -> None:
        """Forget everything that happened so far."""
        self._guarded("in reset()", self._made.reset)

    def update(
        self, t: float, state: NDArray[np.float64], reference: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the wheel torques (n,) [N m]."""
        torques = self._guarded(f"at t = {t:g} s", lambda: self._made.update(t, state, reference))
        try:
            return np.array(torques, dtype=np.float64)
        except (TypeError, ValueError):
            raise InputError(
                f"{self._place} returned {type(torques).__name__} at t = {t:g} s, which is no array of torques."
            ) from None

    @property
    def _place(self) -> str:
        return f"{self._path}:{self._made_by}"

    def _guarded(self, moment: str, call: Callable[[], _Result]) -> _Result:
        try:
            return call()
        except InputError:
            raise
        except Exception as error:
            raise InputError(f"{self._place} failed {moment}: {_told(error, Path(self._path))}.") from error


def _attribute(path: str, name: str) -> Callable[[Robot], object]:
    """Return what a Python file has under a name; the file is run once in each process, until it changes."""
    file = Path(path)
    if not file.is_file():
        raise InputError(f"there is no Python file {path!r}.")
    module_name = f"ballbot_own_{file.stat().st_mtime_ns}_{file.resolve()}"
    if module_name not in sys.modules:
        spec = importlib.util.spec_from_file_location(module_name, file)
        assert spec is not None  # its name ends in .py
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[module_name] = module  # dataclasses look their module up
        try:
            spec.loader.exec_module(module)
        except Exception as error:
            del sys.modules[module_name]
            raise InputError(f"{path} cannot be run: {_told(error, file)}.") from error
    make = getattr(sys.modules[module_name], name, None)
    if not callable(make):
        raise InputError(
            f"{path} has no {name!r} to call; it must be a class or a function that takes the robot."
        )
    return make


def _told(error: Exception, file: Path) -> str:
    """Return an error in words, with the last line of the user's file that it passed through."""
    line, step = None, error.__traceback__
    while step is not None:
        if Path(step.tb_frame.f_code.co_filename).resolve() == file.resolve():
            line = step.tb_lineno
        step = step.tb_next
    words = " ".join(f"{type(error).__name__}: {error}".split()).rstrip(".")
    return f"{words} (line {line})" if line else words
