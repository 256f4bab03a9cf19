"""Controllers by what a user gives: an object, a function, the name of a ready-made one, or a controller file."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import checked_sample_time
from ballbot.control.controller import Controller
from ballbot.control.file import read_controller, warn_if_unsuited
from ballbot.control.interface import Feedback
from ballbot.control.presets import KINDS
from ballbot.errors import InputError, either, suggest
from ballbot.robot import RobotLike, as_robot

#: u = f(t, x, r): wheel torques (n,) [N m] from the time [s], the state (10,) and the reference (10,)
Law = Callable[[float, NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]
#: a controller, a function, the name of a ready-made one, or the path of a controller file
ControllerLike = Feedback | Law | str | Path


@dataclass(frozen=True, kw_only=True)
class FunctionController:
    """A controller that is a function without memory."""

    law: Law
    sample_time: float  #: [s]

    def reset(self) -> None:
        """Do nothing: there is no memory."""

    def update(
        self, t: float, state: NDArray[np.float64], reference: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the wheel torques (n,) [N m]; see `Feedback`."""
        return self.law(t, state, reference)


def as_controller(source: ControllerLike, robot: RobotLike) -> Feedback:
    """Return the controller itself, or for a robot the ready-made one of that name or the one in that file.

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
            f"{either(map(repr, KINDS))}, or the path of a controller file."
        )
    return named_controller(source, robot)


def named_controller(source: str | Path, robot: RobotLike) -> Controller:
    """Return a robot's ready-made controller of that name, or the one in that file; InputError if it is neither."""
    if source in KINDS:
        made, described = KINDS[str(source)].made(robot), as_robot(robot)
        warn_if_unsuited(made, described, name=f"the {source} controller")
        return made
    if not Path(source).exists():
        hint = suggest(str(source), KINDS, otherwise="the ready-made ones are")
        raise InputError(f"There is no controller file or ready-made controller {str(source)!r}; {hint}")
    return read_controller(source, robot)
