"""A real robot in the live view: the states that it sends, as frames, and nothing back.

The page of a monitor has no controls, and what it sends in spite of that is dropped here: `RobotMonitor.send` passes
nothing on. The link's own checks stand behind it: a robot is armed at a terminal only.
"""

from __future__ import annotations

import math
import threading

import numpy as np

from ballbot.errors import InputError
from ballbot.link.live import STOPS, LiveRobot, Samples
from ballbot.link.messages import State
from ballbot.link.session import stop_reason
from ballbot.mechanics.friction import wheel_friction
from ballbot.robot import Robot
from ballbot.viewer.live import WORLD_NAMES, has_friction, robot_names
from ballbot.viewer.live_process import Frames, Request, Status
from ballbot.viewer.motion import INTERVAL, integrated_rotation
from ballbot.viewer.page import LiveLayout, LivePage, live_page

#: for which the thread that reads the robot may take to end [s]
_PATIENCE = 5.0


def monitor_names(wheel_count: int) -> tuple[str, ...]:
    """Return the names of a robot's values in a frame: all but those of pushes and of the floor's force."""
    unknown = ("push_x", "push_y", "push_height", "floor_x", "floor_y")
    return tuple(name for name in robot_names(wheel_count) if name not in unknown)


def monitor_page(robot: Robot, port: str) -> LivePage:
    """Return the page of a real robot at a port."""
    notes = (
        f"The robot at {port}, as it sends its state: position and heading from where it was first heard, by its own "
        "estimate; without one, the attitude of its IMU.",
        "The ball turns as it rolls without slip.",
        *(() if has_friction(robot) else ("The robot file has no friction, and none is drawn.",)),
    )
    layout = LiveLayout(
        world=WORLD_NAMES,
        robots=(monitor_names(robot.wheel_count),),
        homes=((0.0, 0.0),),
        notes=notes,
        monitor=True,
    )
    return live_page({robot.name: robot}, layout, title=f"{robot.name} at {port}")


class RobotMonitor:
    """A robot at a link as a source of frames. Use it in a `with` statement.

    Parameters
    ----------
    link : LiveRobot
        Connected. Another thread uses it while the block runs.
    robot : Robot
        Its description.

    Raises
    ------
    InputError
        If they do not have the same number of wheels.
    """

    def __init__(self, link: LiveRobot, robot: Robot) -> None:
        if link.wheel_count != robot.wheel_count:
            raise InputError(
                f"The robot at the port has {link.wheel_count} wheels, and {robot.name} {robot.wheel_count}."
            )
        self._link, self._robot = link, robot
        self._frames = Frames(len(WORLD_NAMES) + len(monitor_names(robot.wheel_count)))
        self._samples: Samples | None = None
        self._next = 0.0  # time of the next frame [s]
        self._ball = np.array([1.0, 0.0, 0.0, 0.0])
        self._place = np.zeros(2)
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="monitor of a robot", daemon=True)
        self.status = Status(phase="running", message="The robot has sent nothing yet.", ended=(None,))

    def __enter__(self) -> RobotMonitor:
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._ends.set()
        self._thread.join(_PATIENCE)

    def poll(self) -> None:
        """Do nothing: the thread changes the status."""

    def frames_after(self, number: int) -> tuple[bytes, int]:
        """Return the frames after one, and the newest one's number."""
        return self._frames.after(number)

    def send(self, request: Request) -> bool:  # noqa: ARG002 (the interface's)
        """Return that nothing was passed on."""
        return False

    def _watch(self) -> None:
        try:
            self._link.watch(self._take, duration=math.inf)
        except _EndedError:
            return
        except InputError as error:
            self.status = Status(phase="ended", message=str(error), ended=(None,))

    def _take(self, state: State) -> None:
        """Show a state, if an interval has passed since the last one that was shown."""
        if self._ends.is_set():
            raise _EndedError
        if self._samples is None:
            self._samples = Samples(
                state, wheel_count=self._robot.wheel_count, encoder_step=self._link.encoder_step
            )
        sample = self._samples.sample(state)
        message = _message(state)
        if message != self.status.message:
            self.status = Status(phase="running", message=message, ended=(None,))
        if sample.t < self._next - 1e-6:
            return
        self._next = max(self._next + INTERVAL, sample.t)
        pose = sample.state[:5]
        if not np.isfinite(pose).all():
            pose = np.array([*self._place, *state.attitude.astype(np.float64)])
        moved = pose[:2] - self._place
        turn = np.array([[-moved[1], moved[0], 0.0]]) / self._robot.ball.radius
        self._ball, self._place = integrated_rotation(turn, first=self._ball)[-1], pose[:2]
        friction = wheel_friction(sample.wheel_speeds, self._robot.friction, torque=sample.torques)
        values = [
            *(0.0, *pose.tolist(), *self._ball.tolist(), *sample.reference[[0, 1, 4]].tolist()),
            *(*np.nan_to_num(sample.wheel_angles).tolist(), *sample.torques.tolist(), *friction.tolist()),
        ]
        self._frames.write([sample.t, 0.0, 1.0, *values])


class _EndedError(Exception):
    """The view has ended."""


def _message(state: State) -> str:
    """Return in a sentence what a robot does."""
    stop = stop_reason(state)
    if stop is not None:
        return f"The robot has stopped: {STOPS[stop]}."
    return "The robot is armed." if state.armed else "The robot is not armed."
