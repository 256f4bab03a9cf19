"""The person at the robot: confirms that it may arm, and moves it by hand when asked to.

`EmulatedOperator` does the same for an emulated robot, so that every step of a bring-up can be tried without hardware.
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ballbot.errors import InputError
from ballbot.firmware.records import SelfTestOutcome
from ballbot.log import Log
from ballbot.simulation.held_robot import CAMERA_NOISE, HeldRobot


@dataclass(frozen=True)
class Movement:
    """How the person is to move the robot by hand."""

    prompt: str  #: what to do, in one sentence
    words: str  #: what was done, to follow "when the robot was"
    attitude: tuple[float, float, float]  #: theta, phi, psi of the emulated robot afterwards [deg]


#: by the position that the firmware waits for; those after the first show the axes of IMU and encoders
MOVEMENTS = {
    SelfTestOutcome.HOLD_UPRIGHT: Movement(
        "Hold the robot upright and still on its ball, with a foot against the ball.",
        "upright",
        (0.0, 0.0, 0.0),
    ),
    SelfTestOutcome.TILT_FORWARD: Movement(
        "Tilt its top forward by about 15 degrees and hold it there.", "tilted forward", (0.0, 15.0, 0.0)
    ),
    SelfTestOutcome.TILT_LEFT: Movement(
        "Tilt its top to the left by about 15 degrees and hold it there.",
        "tilted to the left",
        (-15.0, 0.0, 0.0),
    ),
    SelfTestOutcome.TURN_LEFT: Movement(
        "Turn it to the left (counter-clockwise from above) by about 45 degrees and hold it there.",
        "turned to the left",
        (0.0, 0.0, 45.0),
    ),
}


#: what is typed at the terminal to let the robot arm
_CONFIRMATION = "arm"


class TerminalOperator:
    """The person at the terminal."""

    def __init__(
        self,
        say: Callable[[str], None],  # prints a line
    ) -> None:
        self._say = say

    def confirm_arming(self) -> bool:
        """Let the person type the confirmation; nobody else can give it. InputError if the input is not a terminal."""
        if not sys.stdin.isatty():
            raise InputError(
                "Arming is confirmed at a terminal, but the input of this command is not a terminal."
            )
        self._say("The motors will be enabled. Is the robot where it should be, and is nobody in its way?")
        self._say(f"Type {_CONFIRMATION} and press Enter within 10 s; anything else leaves it disarmed.")
        return sys.stdin.readline().strip() == _CONFIRMATION

    def move(self, position: SelfTestOutcome) -> None:
        """Print how to bring the robot into one of `MOVEMENTS`; do not wait for it."""
        self._say(MOVEMENTS[position].prompt)


class EmulatedOperator:
    """Does what is asked with an emulated robot, which is let go when it arms."""

    def __init__(
        self,
        hand: HeldRobot,  # the robot while it is held
    ) -> None:
        self._hand = hand

    def confirm_arming(self) -> bool:
        """Confirm."""
        return True

    def move(self, position: SelfTestOutcome) -> None:
        """Move the robot."""
        self._hand.tilt(np.radians(MOVEMENTS[position].attitude))


Operator = TerminalOperator | EmulatedOperator


class EmulatedCamera:
    """A camera above an emulated robot that is upside down: it adds the ball's angular velocity to the log."""

    def __init__(self, hand: HeldRobot, *, seed: int) -> None:
        self._hand, self._random = hand, np.random.default_rng([seed, 23])
        self._omegas = [hand.ball_omega]

    def watch(self) -> None:
        """Look at the ball after the sample of a row, by which it is a sample further on."""
        self._omegas.append(self._hand.ball_omega)

    def added_to(self, log: Log) -> Log:
        """Return a log with ball_omega_x, _y and _z."""
        seen = np.array(self._omegas[: len(log)])
        seen += CAMERA_NOISE * self._random.standard_normal(seen.shape)
        return log.with_columns({f"ball_omega_{axis}": seen[:, k] for k, axis in enumerate("xyz")})
