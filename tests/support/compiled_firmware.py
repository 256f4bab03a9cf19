"""The firmware's library on this computer: compiled as a shared library and called with records of NumPy.

It is the same code that runs on the robot, for tests and for software in the loop. A record of
`Schema.dtype("single")` has the bytes of its struct (`ballbot.firmware.header`), so that addresses are all that is
passed.
"""

import ctypes
from dataclasses import dataclass
from functools import cache, partialmethod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import Floats
from ballbot.control.controller import Controller
from ballbot.control.law import ALLOWED
from ballbot.control.safety import StopReason
from ballbot.errors import InputError
from ballbot.firmware.build import shared_library, source_files
from ballbot.firmware.header import weights_header
from ballbot.firmware.records import STATE, SelfTestOutcome
from ballbot.records import MAX_WHEELS


@dataclass(frozen=True)
class Library:
    """The compiled library."""

    functions: ctypes.CDLL

    def control_law(
        self,
        law: NDArray[np.void],
        memory: NDArray[np.void],
        measured: NDArray[np.floating],
        reference: NDArray[np.floating],
        torques: NDArray[np.floating],
    ) -> NDArray[np.int32]:
        """Call the control law once for each row, as `ballbot.control.law.control_law`.

        `law` (1,) is of `LAW`, `memory` (N,) of `MEMORY` and changed; measured and reference are (N, 10), torques
        (N, n) [N m] is overwritten. Returns `ALLOWED`, or the place at which a reference is refused (N,).
        """
        arrays = (memory, measured, reference, torques)
        assert all(one.flags.c_contiguous and one.itemsize * one.size for one in (law, *arrays))
        call, numbers = self.functions.ballbot_control_law, ctypes.c_void_p(law.ctypes.data)
        results = np.full(len(memory), ALLOWED, dtype=np.int32)
        for k in range(len(memory)):
            m, x, r, u = (ctypes.c_void_p(one[k : k + 1].ctypes.data) for one in arrays)
            results[k] = call(numbers, m, x, r, u, torques.shape[1])
        return results


def _typed(functions: ctypes.CDLL) -> ctypes.CDLL:
    """Give the functions of ballbot.h the types of their arguments and results."""
    pointer, number, truth = ctypes.c_void_p, ctypes.c_int, ctypes.c_bool
    actions = ("start_self_test", "skip_self_test", "skip_imu_check", "disarm")
    types = dict.fromkeys(actions, (None, pointer)) | {
        "init": (truth, pointer, pointer),
        "update": (truth, pointer, pointer, pointer, ctypes.c_uint32, pointer, pointer),
        "arm": (truth, pointer),
        "halt": (None, pointer, number),
        "self_test_of": (number, pointer),
        "stop_of": (number, pointer),
        "stop_word": (ctypes.c_char_p, number),
    }
    for name, (result, *arguments) in types.items():
        function = getattr(functions, f"ballbot_{name}")
        function.restype, function.argtypes = result, arguments
    return functions


@cache
def library(weights: str = "") -> Library:
    """Return the library, compiled by the first of this computer's compilers unless that is kept."""
    return Library(shared_library("library", source_files(), weights=weights))


def library_of(controller: Controller) -> Library:
    """Return the library with the weights of a controller's policy."""
    return library(weights_of(controller))


def weights_of(controller: Controller) -> str:
    """Return the header of the weights of a controller's policy; "" without one."""
    return weights_header(controller.parts.policy) if controller.parts.policy else ""


class Firmware:
    """The firmware of one robot, running on this computer, by its parameters (1,) of `PARAMETERS`; it starts disarmed.

    `weights` is the header of a policy's weights, by default of none.

    Raises
    ------
    InputError
        If the parameters are not those of the library.
    """

    def __init__(self, parameters: NDArray[np.void], *, weights: str = "") -> None:
        self.parameters = parameters
        self.state = np.zeros(1, STATE.dtype("single"))
        self._functions = _typed(library(weights).functions)
        self._torques = np.zeros(MAX_WHEELS, dtype=np.float32)
        self._wheels = int(parameters["wheel_count"][0])
        if not self._functions.ballbot_init(self.state.ctypes.data, parameters.ctypes.data):
            raise InputError("The firmware does not know these parameters: they are of another version.")

    def _call(self, name: str) -> Any:
        return getattr(self._functions, f"ballbot_{name}")(self.state.ctypes.data)

    #: commands without an answer, as of ballbot.h
    start_self_test = partialmethod(_call, "start_self_test")
    skip_self_test = partialmethod(_call, "skip_self_test")
    skip_imu_check = partialmethod(_call, "skip_imu_check")
    disarm = partialmethod(_call, "disarm")

    def arm(self) -> bool:
        """Forget a stop, and give torques from the next update on; return False unless the self-test has passed."""
        return bool(self._call("arm"))

    def halt(self, reason: StopReason) -> None:
        """Stop for a reason outside the library."""
        self._functions.ballbot_halt(self.state.ctypes.data, 1 + list(StopReason).index(reason))

    @property
    def self_test(self) -> SelfTestOutcome:
        """The result of the self-test."""
        return SelfTestOutcome(self._call("self_test_of"))

    def update(self, reading: NDArray[np.void], time: int, reference: Floats | None) -> NDArray[np.float32]:
        """Take one sample, a reading (1,) of `READING` at a time [us]; return the torques (n,) [N m].

        The last reference (10,) holds if none is given.
        """
        wanted = None if reference is None else np.ascontiguousarray(reference, dtype=np.float32)
        self._functions.ballbot_update(
            self.state.ctypes.data,
            self.parameters.ctypes.data,
            reading.ctypes.data,
            time % 2**32,
            None if wanted is None else wanted.ctypes.data,
            self._torques.ctypes.data,
        )
        return self._torques[: self._wheels].copy()

    @property
    def estimate(self) -> NDArray[np.float32]:
        """The state (10,) that the last update estimated."""
        return self.state["run"]["estimate"][0].copy()

    @property
    def stop(self) -> StopReason | None:
        """Why the robot was stopped, or None."""
        word = self._functions.ballbot_stop_word(self._call("stop_of")).decode()
        return StopReason(word) if word else None
