"""The adaptive controller: any controller's compensation made to follow the floor and the drivelines."""

from __future__ import annotations

from dataclasses import replace

from ballbot.control.controller import Controller
from ballbot.control.driveline_adaptation import DrivelineAdaptation
from ballbot.control.floor_adaptation import FloorAdaptation
from ballbot.control.torque_balance import TorqueBalance


def adaptive(controller: Controller) -> Controller:
    """Return a copy with those adaptations that it can have, as they are made.

    Parameters
    ----------
    controller : Controller
        With an integral action it follows the floor, with a compensation the drivelines; without either it is
        returned as it is.
    """
    floor = FloorAdaptation() if controller.parts.integral is not None else None
    compensates = controller.compensation != "none"
    drivelines = DrivelineAdaptation(balance=TorqueBalance.of(controller.robot)) if compensates else None
    return controller.with_parts(
        replace(controller.parts, floor_adaptation=floor, driveline_adaptation=drivelines)
    )
