"""The adaptive controller: any controller's compensation made to follow the floor and the drivelines."""

from __future__ import annotations

from dataclasses import replace

from ballbot.control.controller import Controller
from ballbot.control.driveline_adaptation import DrivelineAdaptation
from ballbot.control.floor_adaptation import FloorAdaptation
from ballbot.control.torque_balance import TorqueBalance


def adaptive(controller: Controller) -> Controller:
    """Return a copy with those adaptations that it can have; one that it has stays as it is.

    Parameters
    ----------
    controller : Controller
        With integral action and shaped references it follows the floor, with a compensation the drivelines.
    """
    parts = controller.parts
    floor, drivelines = parts.floor_adaptation, parts.driveline_adaptation
    if floor is None and parts.integral is not None and parts.shaping is not None:
        floor = FloorAdaptation()
    if drivelines is None and controller.compensation != "none":
        drivelines = DrivelineAdaptation(balance=TorqueBalance.of(controller.robot))
    return controller.with_parts(replace(parts, floor_adaptation=floor, driveline_adaptation=drivelines))
