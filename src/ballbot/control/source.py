"""Controllers by what a user gives, the same for every command and function.

none, full, partial       the nominal gain with that compensation
nominal, precise          a ready-made controller (`ballbot.control.presets`)
found/controller.toml     a controller file
mine.py:Mine              a user's own: `Mine(robot)` in that file returns one of these
an object, a function     see `Feedback` and `Law`
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar, cast, get_args

from ballbot.arrays import Floats, checked_sample_time, real_array
from ballbot.control.controller import Compensation, Controller
from ballbot.control.file import read_controller, warn_if_unsuited
from ballbot.control.interface import Feedback, estimator_of
from ballbot.control.presets import KINDS, nominal_controller
from ballbot.errors import InputError, about, either, suggest
from ballbot.estimation.interface import EstimatorName
from ballbot.files import sha256_of
from ballbot.printable import shell_line
from ballbot.robot import Robot, RobotLike, as_robot
from ballbot.user_files import error_text, user_module

#: u = f(t, x, r): wheel torques (n,) [N m] from the time [s], the state (10,) and the reference (10,)
Law = Callable[[float, Floats, Floats], Floats]
#: a controller, a function, the name of a ready-made one, the path of a controller file, or FILE.py:NAME
ControllerLike = Feedback | Law | str | Path
_Result = TypeVar("_Result")

#: controllers that are not files
NAMED_CONTROLLERS = (*get_args(Compensation), *KINDS)


@dataclass(frozen=True, kw_only=True)
class FunctionController:
    """A controller that is a function without memory."""

    law: Law
    sample_time: float  #: [s]

    def reset(self) -> None:
        """Do nothing: there is no memory."""

    def update(self, t: float, state: Floats, reference: Floats) -> Floats:
        """Return the wheel torques (n,) [N m]; see `Feedback`."""
        return self.law(t, state, reference)


class UserController:
    """A user's controller, made by their file; an error in it is reported in one sentence.

    A copy, in this process or in another, is made again from the file, so that runs share no state.
    """

    sample_time: float  #: [s]
    estimator: EstimatorName  #: of its on-board state; the user's `estimator`, else "onboard"

    def __init__(self, path: str, made_by: str, robot: Robot, estimator: EstimatorName | None = None) -> None:
        """Call `made_by(robot)` in the Python file at `path`; `estimator` replaces the one that it names."""
        self.path, self.made_by, self._robot = path, made_by, robot
        make: Callable[[Robot], object] | None = getattr(user_module(path), made_by, None)
        if not callable(make):
            raise InputError(
                f"{path} has no {made_by!r} to call; it must be a class or a function that takes the robot."
            )
        self._checksum = sha256_of(Path(path))
        made = self._guarded("when it was made", lambda: make(robot))
        with about(self._place):
            self.made = as_controller(cast("ControllerLike", made), robot)
        self.sample_time = self.made.sample_time
        self.estimator = estimator or estimator_of(self.made)

    def with_estimator(self, estimator: EstimatorName) -> UserController:
        """Return a new one of the same file for another on-board state."""
        return UserController(self.path, self.made_by, self._robot, estimator)

    def __reduce__(self) -> tuple[Callable[..., UserController], tuple[object, ...]]:
        return _remake, (self.path, self.made_by, self._robot, self.estimator, self._checksum)

    def reset(self) -> None:
        """Forget everything that happened so far."""
        self._guarded("in reset()", self.made.reset)

    def update(self, t: float, state: Floats, reference: Floats) -> Floats:
        """Return the wheel torques (n,) [N m]."""
        torques = self._guarded(f"at t = {t:g} s", lambda: self.made.update(t, state, reference))
        # not finite is a mistake in the user's program, not a fall
        return real_array(torques, ("wheels",), f"What {self._place} returned at t = {t:g} s")

    @property
    def _place(self) -> str:
        return f"{self.path}:{self.made_by}"

    def _guarded(self, moment: str, call: Callable[[], _Result]) -> _Result:
        try:
            return call()
        except InputError:
            raise
        except (Exception, SystemExit) as error:
            raise InputError(
                f"{self._place} failed {moment}: {error_text(error, Path(self.path))}."
            ) from error


def _remake(path: str, made_by: str, robot: Robot, estimator: EstimatorName, checksum: str) -> UserController:
    """Return a copy of a controller; raise InputError if its file has changed."""
    if not Path(path).is_file() or sha256_of(Path(path)) != checksum:
        raise InputError(
            f"{path} was changed while {path}:{made_by} ran; start again, so that all runs have the same controller."
        )
    return UserController(path, made_by, robot, estimator)


def as_controller(source: ControllerLike, robot: RobotLike) -> Feedback:
    """Return the controller itself, or the one of a name or file for a robot.

    A function f(t, x, r) is called at the sample time of the robot's sensors. InputError if it is none of these, or the
    file describes a controller of another robot.
    """
    if isinstance(source, Feedback):
        checked_sample_time(source.sample_time, "The controller's sample time")
        return source
    if callable(source) and not isinstance(source, type):
        return FunctionController(law=source, sample_time=as_robot(robot).sensors.sample_time)
    if not isinstance(source, str | Path):
        raise InputError(
            f"A controller is given as an object of type {type(source).__name__}; give a Controller, an object with "
            f"sample_time, reset() and update(t, state, reference), a function f(t, x, r), "
            f"{either(map(repr, NAMED_CONTROLLERS))}, the path of a controller file, or FILE.py:NAME."
        )
    return read_source(source, robot)


def read_source(source: str | Path, robot: RobotLike) -> Controller | UserController:
    """Return a robot's controller of that name, the one in that controller file, or FILE.py:NAME; else InputError."""
    word, described = str(source), as_robot(robot)
    if word in get_args(Compensation):
        return nominal_controller(described, compensation=cast("Compensation", word))
    if word in KINDS:
        made = KINDS[word].made(described)
        warn_if_unsuited(made, described, name=f"the {word} controller")
        return made
    path, _, made_by = word.rpartition(":")
    if path.endswith(".py"):
        own = UserController(path, made_by, described)
        return own.made if isinstance(own.made, Controller) else own
    if word.endswith(".py"):
        raise InputError(
            f"{word} is a Python file. Name the class or function that makes the controller, as "
            f"{shell_line([f'{word}:NAME'])}."
        )
    if not Path(word).exists():
        otherwise = "give a controller file, FILE.py:NAME for your own, or one of"
        raise InputError(
            f"There is no controller {word!r}; {suggest(word, NAMED_CONTROLLERS, otherwise=otherwise)}"
        )
    return read_controller(word, robot)


def named_controller(source: str | Path, robot: RobotLike) -> Controller:
    """Return the controller that a name or a file means, if a controller file can hold it.

    Parameters
    ----------
    source : str or Path
        The name of a ready-made controller, a controller file or FILE.py:NAME.
    robot : Robot, preset or robot file
        That it is to drive.

    Returns
    -------
    Controller

    Raises
    ------
    InputError
        If there is no such controller, or it is a user's own that no controller file can hold.

    Examples
    --------
    >>> named_controller("nominal", "alten").compensation
    'none'
    """
    return designed(read_source(source, robot), name=str(source))


def designed(controller: Feedback, *, name: str) -> Controller:
    """Return a controller that a controller file can hold; InputError with its name for any other."""
    if isinstance(controller, Controller):
        return controller
    raise InputError(
        f"{name} is a controller of your own, which only compare, simulate, record, validate and view can run; here it "
        "must be a ballbot.Controller."
    )
