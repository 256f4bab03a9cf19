"""The controller of a run: the option that chooses it, and the warning that its compensation does nothing."""

from typing import Annotated

from cyclopts import Parameter

from ballbot.cli.output import notice
from ballbot.control.controller import Controller
from ballbot.control.interface import Feedback
from ballbot.control.overcompensation import has_friction

Chosen = Annotated[
    str,
    Parameter(
        help="none, full or partial (the nominal gain with that compensation), nominal, precise, a controller file, or "
        "your own in Python as FILE.py:NAME, where NAME(robot) returns the controller."
    ),
]


def warn_of_idle_compensation(name: str, controller: Feedback) -> None:
    """Print a warning if a controller compensates friction of a robot without friction."""
    if not isinstance(controller, Controller) or controller.compensation == "none":
        return
    if not has_friction((robot := controller.robot).friction):
        sentence = (
            f"{name}: {controller.compensation} compensation does nothing, because the robot {robot.name} has no "
            "friction. Identify it with `ballbot identify`, or write it into the robot file."
        )
        notice(sentence, style="yellow")
