"""References of a live robot: a named course, a file, or the arrow keys.

A live reference is asked once a sample for the state (10,) that the robot is to have, from the start of the run on. It
is in the frame of the start: the robot begins at (0, 0) with psi = 0, and `in_start_frame` and `in_robot_frame`
convert. Only x, y and psi are other than zero, as in `ballbot.control.references`; a plan has leans and rates too.

    named course, file     as `ballbot simulate` has them
    keyboard               arrow keys move it by 5 cm, comma and full stop turn it by 10 degrees, e ends the run

Keys move the reference as the driver sees the robot: forward is along its own heading.
"""

import importlib.util
import math
import os
import select
import sys
from collections.abc import Callable
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from ballbot.control.references import REFERENCES, Reference, as_reference, is_reference_file
from ballbot.errors import InputError, suggest
from ballbot.estimation.swing import turned_about_vertical
from ballbot.mechanics.geometry import body_rates_matrix

#: the name of the arrow keys as a reference
KEYBOARD = "keyboard"
#: a key press moves the reference by this [m, rad]
KEY_STEP, KEY_TURN = 0.05, math.radians(10.0)


class CourseReference:
    """A named course or a file, followed from the start of the run on."""

    ended = False  #: whether the driver has asked for the end of the run

    def __init__(self, course: Reference) -> None:
        self._course = course

    def update(self, t: float) -> NDArray[np.float64]:
        """Return the course's state (10,) at a time [s]."""
        return self._course(t)

    def close(self) -> None:
        """Do nothing."""


#: bytes that a key sends, with the movement: forward, left [m], turn [rad]
_KEYS = {
    b"\x1b[A": (KEY_STEP, 0.0, 0.0),
    b"\x1b[B": (-KEY_STEP, 0.0, 0.0),
    b"\x1b[D": (0.0, KEY_STEP, 0.0),
    b"\x1b[C": (0.0, -KEY_STEP, 0.0),
    b",": (0.0, 0.0, KEY_TURN),
    b".": (0.0, 0.0, -KEY_TURN),
}
_END_KEY = b"e"


class KeyboardReference:
    """The arrow keys of a terminal, read one by one and without echo from the first update on.

    InputError if it is not a terminal of Linux or macOS.
    """

    def __init__(
        self,
        descriptor: int,  # of the terminal's input
    ) -> None:
        self.ended = False  #: whether e was pressed
        self._gone = False  # the terminal; the reference then stays where it is
        self._pose = np.zeros(10)
        self._descriptor, self._waiting = descriptor, b""
        self._restore: Callable[[], None] | None = None
        require_terminal(descriptor, "--reference keyboard")

    def update(self, t: float) -> NDArray[np.float64]:  # noqa: ARG002
        """Return the pose (10,) after all keys that were pressed."""
        if self._restore is None:
            self._restore = _keys_at_once(self._descriptor)
        self._waiting += self._new_bytes()
        while self._waiting:
            key = next((key for key in (*_KEYS, _END_KEY) if self._waiting.startswith(key)), None)
            if key is None and any(sequence.startswith(self._waiting) for sequence in _KEYS):
                break  # the rest of an arrow key is still to come
            if key == _END_KEY:
                self.ended = True
            elif key:
                step = np.zeros(10)
                step[[0, 1, 4]] = _KEYS[key]
                self._pose = in_robot_frame(step, self._pose[[0, 1, 4]])  # along its own heading
            self._waiting = self._waiting[len(key or b"?") :]
        return self._pose.copy()

    def close(self) -> None:
        """Give the terminal back as it was."""
        if self._restore is not None:
            self._restore()

    def _new_bytes(self) -> bytes:
        data = b""
        if not self._gone and select.select([self._descriptor], [], [], 0.0)[0]:
            with suppress(OSError):
                data = os.read(self._descriptor, 1024)
            self._gone = not data
        return data


def require_terminal(descriptor: int, option: str) -> None:
    """Raise InputError unless the input is a terminal that can be read while a robot runs."""
    if importlib.util.find_spec("termios") is None or not os.isatty(descriptor):
        raise InputError(f"{option} needs a terminal of Linux or macOS; give another value.")


def _keys_at_once(descriptor: int) -> Callable[[], None]:
    """Read keys one by one and without echo; return a function that restores the terminal."""
    import termios
    import tty

    before = termios.tcgetattr(descriptor)
    tty.setcbreak(descriptor)
    return lambda: termios.tcsetattr(descriptor, termios.TCSADRAIN, before)


#: gives the state (10,) asked for at a time since the start of a live run [s], in the frame of the start
LiveReference = CourseReference | KeyboardReference


def live_reference(source: str) -> LiveReference:
    """Return the reference that a text names: a course, a file or the keyboard.

    InputError if there is no such course, file or terminal.
    """
    if source == KEYBOARD:
        return KeyboardReference(sys.stdin.fileno())
    if not is_reference_file(source) and source.replace("-", "_") not in REFERENCES:
        hint = suggest(source, [*REFERENCES, KEYBOARD], otherwise="the names are")
        raise InputError(f"There is no reference {source!r}; {hint}")
    return CourseReference(as_reference(source))


def in_robot_frame(
    reference: NDArray[np.float64],  # (10,)
    start: NDArray[np.float64],  # (3,) x, y [m] and psi [rad] of the robot at the start
) -> NDArray[np.float64]:
    """Return a reference (10,) in the frame of the start, in the frame in which the robot estimates its state."""
    turned = _turned_state(reference, float(start[2]))
    turned[:2] += start[:2]
    return turned


def in_start_frame(state: NDArray[np.float64], start: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a state (10,), as the robot estimates it, in the frame of the start.

    The frame is turned about the vertical: x, y and their rates turn, and so do theta and phi, which are about the
    frame's axes.
    """
    moved = state.copy()
    moved[:2] -= start[:2]
    return _turned_state(moved, -float(start[2]))


def _turned_state(state: NDArray[np.float64], angle: float) -> NDArray[np.float64]:
    """Return a state (10,) turned about the vertical through the origin by an angle."""
    turned = state.copy()
    turned[0:2], turned[5:7] = _turned(state[0:2], angle), _turned(state[5:7], angle)
    if angle != 0.0:
        turned[2:5] = turned_about_vertical(state[2:5], angle)
        body_rates = body_rates_matrix(*state[2:5]) @ state[7:10]  # body rates do not depend on the frame
        turned[7:10] = np.linalg.solve(body_rates_matrix(*turned[2:5]), body_rates)
    return turned


def _turned(pair: NDArray[np.float64], psi: float) -> NDArray[np.float64]:
    """Return x and y (2,) turned by an angle."""
    cosine, sine = math.cos(psi), math.sin(psi)
    return np.array([cosine * pair[0] - sine * pair[1], sine * pair[0] + cosine * pair[1]])
