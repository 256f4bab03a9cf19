"""The controller of a run: the options that choose it, and warnings about its compensation."""

from collections.abc import Mapping
from dataclasses import dataclass

from cyclopts import Parameter

from ballbot.cli.output import notice
from ballbot.control.controller import Compensation, Controller
from ballbot.control.interface import Feedback
from ballbot.control.overcompensation import has_friction
from ballbot.control.source import UserController, read_source
from ballbot.errors import InputError
from ballbot.robot import Robot


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class ControllerOptions:
    """The controller of a run."""

    controller: str | None = None
    """none, full or partial (the nominal gain with that compensation), nominal, precise, a controller file, or your
    own in Python as FILE.py:NAME, where NAME(robot) returns the controller; nominal if not given."""

    compensation: Compensation | None = None
    """How the nominal controller compensates the friction in the robot's file: none, full or partial; none if not
    given."""

    def read(self, robot: Robot) -> Controller | UserController:
        """Return the controller for a robot; warn if its compensation does nothing."""
        name = self.controller or "nominal"
        if name != "nominal" and self.compensation is not None:
            raise InputError(
                f"--compensation is for the nominal controller, but --controller is {name}; leave one of them out."
            )
        controller = read_source(self.compensation or name, robot)
        warn_of_idle_compensation({self.controller or "nominal controller": controller})
        return controller


#: the nominal controller, without compensation
NOMINAL = ControllerOptions()


def warn_of_idle_compensation(controllers: Mapping[str, Feedback]) -> None:
    """Print a warning for each controller, by its name, that compensates friction of a robot without friction."""
    for name, controller in controllers.items():
        if not isinstance(controller, Controller) or controller.compensation == "none":
            continue
        if not has_friction((robot := controller.robot).friction):
            sentence = (
                f"{name}: {controller.compensation} compensation does nothing, because the robot {robot.name} has no "
                "friction. Identify it with `ballbot identify`, or write it into the robot file."
            )
            notice(sentence, style="yellow")
