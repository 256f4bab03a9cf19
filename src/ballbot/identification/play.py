"""Wheels that swing to and fro within the gearbox's play: there a model without play errs, and more so with friction.

A stiff gain makes motors chatter: they cross the play, strike, and are turned back before ball and body have followed.
The encoder, on the motor's side, sees swings about as long as the play. Friction's sign then follows the motor and
averages out over a swing (as dither does), whereas a model that fixes motor to wheel holds the ball by c + s. On such
windows friction found elsewhere predicts the lean worse than none, and a fit to them alone finds none.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.identification.wheel_speeds import measured_wheel_speeds
from ballbot.log import Log
from ballbot.log.turning_points import turning_points
from ballbot.robot import Robot

#: a swing is within the play where it is this many times as long: at its end a blow turns the wheel a little
WITHIN = (0.3, 2.0)
#: a turn back by less than this share of the play is the encoder's noise
LEAST_TURN = 0.1
#: a log whose wheels are within the play for more than this share of the time is said to chatter
CHATTER = 0.3


@dataclass(frozen=True, kw_only=True)
class Chatter:
    """How much a log's wheels swing within the play."""

    share: float  #: of the time, the wheels' mean
    swing: float  #: median length of the swings within the play [rad]; NaN where there is none

    @property
    def matters(self) -> bool:
        """Whether predictions with friction are not to be trusted there."""
        return self.share > CHATTER


def chatter(log: Log, robot: Robot) -> Chatter:
    """Return how much the wheels swing within the robot's play."""
    play = robot.drive.backlash
    if not play > 0.0:
        return Chatter(share=0.0, swing=math.nan)
    speeds = np.nan_to_num(measured_wheel_speeds(log, robot))
    angles = np.cumsum(speeds[:-1] * np.diff(log.t)[:, None], axis=0)
    lengths, rows = (
        np.concatenate(parts)
        for parts in zip(*(_swings(angle, LEAST_TURN * play) for angle in angles.T), strict=True)
    )
    within = (lengths > WITHIN[0] * play) & (lengths < WITHIN[1] * play)
    swing = float(np.median(lengths[within])) if within.any() else math.nan
    return Chatter(share=float(rows[within].sum() / rows.sum()), swing=swing)


def chatter_remark(found: Chatter, robot: Robot, name: str) -> str:
    """Return what to say of a log that chatters."""
    return (
        f"In {name} the wheels oscillate by {math.degrees(found.swing):.1f} deg for {100 * found.share:.0f} % "
        f"of the time, within the gearbox's play of {math.degrees(robot.drive.backlash):.1f} deg: the motors "
        "strike the stops while ball and body hardly follow. The model has no play, so friction there makes "
        "its predictions worse, first those of the lean. Validate friction on logs of a softer gain."
    )


def _swings(angle: NDArray[np.float64], least: float) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return how far an angle (N,) travels from one turning point to the next, and for how many rows."""
    turns = turning_points(angle, least)
    return np.abs(np.diff(angle[turns])), np.diff(turns)
