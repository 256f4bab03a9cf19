"""The person at the robot: confirms that it may arm, and moves it by hand when asked to.

`EmulatedOperator` does the same for an emulated robot, so that every step of a bring-up can be tried without hardware.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ballbot.errors import InputError
from ballbot.log import Log
from ballbot.simulation.held_robot import CAMERA_NOISE, HeldRobot


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

    def hold_upright(self) -> None:
        """Print what to do."""
        self._say(UPRIGHT)

    def move(self, movement: Movement) -> None:
        """Print what to do."""
        self._say(movement.prompt)


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

    def hold_upright(self) -> None:
        """Bring the robot back to upright."""
        self._hand.tilt([0.0, 0.0, 0.0])

    def move(self, movement: Movement) -> None:
        """Move the robot."""
        attitude = [0.0, 0.0, 0.0]
        attitude[movement.axis] = movement.sign * _ANGLES[movement.axis]
        self._hand.tilt(attitude)


class EmulatedCamera:
    """A camera above an emulated robot that is upside down: it adds the ball's angular velocity to the log."""

    def __init__(
        self,
        hand: HeldRobot,
        *,
        clock: Callable[[], float],  # gives the robot's time [s]
        sample_time: float,  # [s]
        seed: int,  # of its noise
    ) -> None:
        self._hand, self._clock, self._step = hand, clock, sample_time
        self._random = np.random.default_rng([seed, 23])
        self._times: list[float] = []
        self._omegas: list[NDArray[np.float64]] = []
        self._began = math.inf  # time of the first row by the robot's clock [s]

    def watch(self, t: float) -> None:
        """Look at the ball, after the sample of a row's time t [s]."""
        now = self._clock()
        self._began = min(self._began, now - t)
        self._times.append(now + self._step)  # the ball is a sample further on
        self._omegas.append(self._hand.ball_omega)

    def added_to(self, log: Log) -> Log:
        """Return a log with ball_omega_x, _y and _z."""
        times, omegas = np.array(self._times), np.array(self._omegas)
        noise = CAMERA_NOISE * self._random.standard_normal((len(log), 3))
        columns = {
            f"ball_omega_{axis}": np.interp(log.t + self._began, times, omegas[:, k]) + noise[:, k]
            for k, axis in enumerate("xyz")
        }
        return log.with_columns(columns)
