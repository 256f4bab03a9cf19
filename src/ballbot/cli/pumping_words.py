"""What a command says before a run where a controller compensates more friction than is certain."""

from __future__ import annotations

from collections.abc import Mapping

from rich.console import Console

from ballbot.control.controller import Controller
from ballbot.control.interface import Feedback
from ballbot.control.pumping import pumping_warning
from ballbot.robot import Robot


def warn_of_pumping(controllers: Mapping[str, Feedback], robot: Robot, console: Console) -> None:
    """Print a sentence for each controller, by the name it goes by, that may feed the motion of this robot."""
    for name, one in controllers.items():
        sentence = pumping_warning(one, robot) if isinstance(one, Controller) else None
        if sentence:
            console.print(f"{name}: {sentence}.", style="yellow", markup=False, soft_wrap=True)
