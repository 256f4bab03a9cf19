"""The person at the robot: confirms that it may arm, and moves it by hand when asked to.

`EmulatedOperator` does the same for an emulated robot, so that every step of a bring-up can be tried without hardware.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

from ballbot.simulation.held_robot import HeldRobot


@dataclass(frozen=True, kw_only=True)
class Movement:
    """How the person is to move the robot by hand, and the turn that it is from upright."""

    prompt: str  #: what to do, in one sentence
    axis: int  #: of the turn: 0, 1, 2 for x, y, z
    sign: int  #: of the turn about that axis
    words: str  #: what was done, to follow "when the robot was"


#: the body's movements from upright that show the axes of IMU and encoders
MOVEMENTS = (
    Movement(
        prompt="Tilt its top forward by about 15 degrees and hold it there.",
        axis=1,
        sign=1,
        words="tilted forward",
    ),
    Movement(
        prompt="Tilt its top to the left by about 15 degrees and hold it there.",
        axis=0,
        sign=-1,
        words="tilted to the left",
    ),
    Movement(
        prompt="Turn it to the left (counter-clockwise from above) by about 45 degrees and hold it there.",
        axis=2,
        sign=1,
        words="turned to the left",
    ),
)
UPRIGHT = "Hold the robot upright and still on its ball, with a foot against the ball."


class Operator(Protocol):
    """The person at the robot."""

    def confirm_arming(self) -> bool:
        """Ask whether the robot may arm, and return the answer."""
        ...

    def hold_upright(self) -> None:
        """Ask to hold the robot upright and still; do not wait for it."""
        ...

    def move(self, movement: Movement) -> None:
        """Ask for a movement from upright; do not wait for it."""
        ...


#: angle of the emulated operator's movements about x, y and z [rad]
_ANGLES = (math.radians(15.0), math.radians(15.0), math.radians(45.0))


class EmulatedOperator:
    """Does what is asked with an emulated robot, which is let go when it arms.

    Parameters
    ----------
    hand : HeldRobot
        The robot while it is held.
    """

    def __init__(self, hand: HeldRobot) -> None:
        self._hand = hand

    def confirm_arming(self) -> bool:
        """Confirm."""
        return True

    def hold_upright(self) -> None:
        """Bring the robot back to upright."""
        self._hand.tilt([0.0, 0.0, 0.0])

    def move(self, movement: Movement) -> None:
        """Move the robot."""
        attitude = [0.0, 0.0, 0.0]
        attitude[movement.axis] = movement.sign * _ANGLES[movement.axis]
        self._hand.tilt(attitude)
