"""Warnings before a run: a controller compensates more friction than is certain, or there is none to compensate."""

from __future__ import annotations

from collections.abc import Mapping

from rich.console import Console

from ballbot.control.controller import Controller
from ballbot.control.interface import Feedback
from ballbot.control.overcompensation import overcompensation_warning
from ballbot.robot import Robot


def warn_of_pumping(controllers: Mapping[str, Feedback], robot: Robot, console: Console) -> None:
    """Print a sentence for each controller, by the name it goes by, that may feed the motion of this robot."""
    for name, one in controllers.items():
        sentence = overcompensation_warning(one, robot) if isinstance(one, Controller) else None
        if sentence:
            console.print(f"{name}: {sentence}.", style="yellow", markup=False, soft_wrap=True)


def warn_of_idle_compensation(controllers: Mapping[str, Feedback], console: Console) -> None:
    """Print a sentence for each controller, by its name, whose compensation does nothing for want of friction."""
    for name, one in controllers.items():
        if not isinstance(one, Controller) or one.compensation == "none":
            continue
        friction = one.robot.friction
        if any((*friction.viscous, *friction.coulomb, *friction.stribeck, friction.rolling)):
            continue
        sentence = (
            f"{name}: {one.compensation} compensation does nothing, because the robot {one.robot.name} has no "
            "friction. Identify it with `ballbot identify`, or write it into the robot file."
        )
        console.print(sentence, style="yellow", markup=False, soft_wrap=True)
