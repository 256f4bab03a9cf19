"""Firmware on a line as the controller of a plant, in lock-step with it.

with QemuBoard(image) as board:
    estimator = ReadingTap(KalmanFilter(robot, sample_time=0.005))
    controller = FirmwareController(BoardLine(board), estimator, robot=robot, sample_time=0.005)
    log = simulate(Twin(robot, estimator=estimator), controller, reference, duration=60.0)
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.errors import InputError
from ballbot.estimation.interface import Estimator, Reading
from ballbot.link.lock_step import LockStep, no_sensors, sensors_of
from ballbot.link.messages import Result
from ballbot.link.session import Session, reason
from ballbot.link.transport import LinkError, Transport
from ballbot.robot import Robot

#: samples from one state to the next: the least often that a robot sends it
_STATE_EVERY = 4


class ReadingTap:
    """An estimator that also keeps the last reading, for the firmware that estimates by itself."""

    def __init__(self, estimator: Estimator) -> None:
        self.reading: Reading | None = None
        self._estimator = estimator

    def reset(self, *, position: tuple[float, float] = (0.0, 0.0)) -> None:
        """Reset the estimator."""
        self.reading = None
        self._estimator.reset(position=position)

    def update(self, reading: Reading) -> NDArray[np.float64]:
        """Keep the reading and return the estimator's state (10,)."""
        self.reading = reading
        return self._estimator.update(reading)


class FirmwareController:
    """Firmware on the line of an emulated robot, as a controller of a plant.

    It sees the readings that the plant's estimator gets, and neither the state nor the truth. Before the first one a
    session is opened and the robot armed, with sensors that show nothing yet, so that estimator and control law begin
    with the plant. Nobody is asked whether to arm, because nothing can move.

    Parameters
    ----------
    line : Transport
        Of an emulated robot whose wiring counts as known, just started.
    tap : ReadingTap
        The estimator of the plant.
    robot : Robot
    sample_time : float
        Of the firmware [s].
    """

    def __init__(self, line: Transport, tap: ReadingTap, *, robot: Robot, sample_time: float) -> None:
        self.sample_time = sample_time
        self.robot_line = LockStep(line, sample_time=sample_time)
        self.session = Session(self.robot_line, clock=self.robot_line.clock)
        self._tap, self._robot = tap, robot
        self._reference: NDArray[np.float64] | None = None

    def reset(self) -> None:
        """Do nothing before the first sample.

        Raises
        ------
        InputError
            If there was one: an estimator on a robot cannot be reset. Start another emulated robot.
        """
        if self.session.connected:
            raise InputError("The firmware has run already; start another emulated robot for another run.")

    def update(
        self,
        t: float,  # noqa: ARG002 (the firmware has its own clock)
        state: ArrayLike,  # noqa: ARG002
        reference: ArrayLike,
    ) -> NDArray[np.float64]:
        """Let the robot take a sample and return the torques (n,) [N m] that it commands.

        Raises
        ------
        InputError
            If the plant has not read its sensors through the tap.
        LinkError
            If the robot does not answer, or refuses to arm.
        """
        if self._tap.reading is None:
            raise InputError("The plant's estimator must be the firmware controller's tap.")
        wanted = np.asarray(reference, dtype=np.float64)
        if self._reference is None:
            self._begin()
        self.robot_line.sensors = sensors_of(self._tap.reading, robot=self._robot)
        if self._reference is None or not np.array_equal(wanted, self._reference):
            self.session.set_reference(wanted)
            self._reference = wanted.copy()
        motors = self.robot_line.step()
        self.session.poll()
        return motors.torques[: self._robot.wheel_count].astype(np.float64)

    def _begin(self) -> None:
        """Open a session and arm; the robot may lack its sensors for two samples after it."""
        self.robot_line.sensors = no_sensors()
        self.session.connect(state_every=_STATE_EVERY)
        answer = self.session.arm(lambda: True)
        if answer != Result.OK:
            raise LinkError(f"The emulated robot does not arm: {reason(answer)}.")
