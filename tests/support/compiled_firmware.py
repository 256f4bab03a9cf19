"""The firmware's library on this computer: compiled as a shared library and called with records of NumPy.

It is the same code that runs on the robot, for tests and for software in the loop. A record of
`Schema.dtype("single")` has the bytes of its struct (`ballbot.firmware.header`), so that addresses are all that is
passed.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot.control.law import ALLOWED
from ballbot.control.records import MAX_WHEELS
from ballbot.control.safety import StopReason
from ballbot.errors import InputError
from ballbot.firmware.build import shared_library, source_files
from ballbot.firmware.records import STATE, SelfTestOutcome


@dataclass(frozen=True)
class Library:
    """The compiled library, of which every function takes rows of records."""

    functions: ctypes.CDLL

    @classmethod
    def open(cls, path: Path) -> Library:
        """Return the library in a file."""
        return cls.of(ctypes.CDLL(str(path)))

    @classmethod
    def of(cls, functions: ctypes.CDLL) -> Library:
        """Return a library that is loaded."""
        pointer, whole = ctypes.c_void_p, ctypes.c_int32
        functions.ballbot_control_law.argtypes = (pointer, pointer, whole, pointer, pointer, pointer)
        functions.ballbot_control_law.restype = whole
        return cls(functions)

    def control_law(
        self,
        law: NDArray[np.void],
        memory: NDArray[np.void],
        measured: NDArray[np.float32],
        reference: NDArray[np.float32],
        torques: NDArray[np.float32],
    ) -> NDArray[np.int32]:
        """Call the control law once for each row, as `ballbot.control.law.control_law`.

        Parameters
        ----------
        law : structured array (1,)
            Of `LAW` in single precision.
        memory : structured array (N,)
            Of `MEMORY` in single precision; changed.
        measured, reference : arrays (N, 10)
        torques : array (N, n)
            Overwritten [N m].

        Returns
        -------
        array (N,)
            `ALLOWED`, or the place at which a reference is refused.
        """
        arrays = (memory, measured, reference, torques)
        assert all(one.flags.c_contiguous and one.itemsize * one.size for one in (law, *arrays))
        call, numbers = self.functions.ballbot_control_law, law.ctypes.data
        memories, states, references, answers = (one.ctypes.data for one in arrays)
        size, width = memory.itemsize, torques.shape[1]
        results = np.full(len(memory), ALLOWED, dtype=np.int32)
        for k in range(len(memory)):
            results[k] = call(
                numbers,
                memories + k * size,
                width,
                states + 40 * k,
                references + 40 * k,
                answers + 4 * width * k,
            )
        return results


def _typed(functions: ctypes.CDLL) -> ctypes.CDLL:
    """Give the functions of ballbot.h the types of their arguments and results."""
    pointer = ctypes.c_void_p
    functions.ballbot_init.argtypes = (pointer, pointer)
    functions.ballbot_init.restype = ctypes.c_bool
    actions = (
        "ballbot_start_self_test",
        "ballbot_skip_self_test",
        "ballbot_skip_imu_check",
        "ballbot_disarm",
    )
    answers = {"ballbot_arm": ctypes.c_bool, "ballbot_self_test_of": ctypes.c_int}
    for name, result in (dict.fromkeys(actions) | answers).items():
        getattr(functions, name).argtypes = (pointer,)
        getattr(functions, name).restype = result
    functions.ballbot_update.argtypes = (pointer, pointer, pointer, ctypes.c_uint32, pointer, pointer)
    functions.ballbot_update.restype = ctypes.c_bool
    functions.ballbot_stop_of.argtypes = (pointer,)
    functions.ballbot_stop_of.restype = ctypes.c_int
    functions.ballbot_stop_word.argtypes = (ctypes.c_int,)
    functions.ballbot_stop_word.restype = ctypes.c_char_p
    return functions


@cache
def library() -> Library:
    """Return the library, compiled by the first of this computer's compilers unless that is kept.

    Raises
    ------
    InputError
        If this computer has no C compiler, or the compiler refuses the sources.
    """
    return Library.of(shared_library("library", source_files()))


class Firmware:
    """The firmware of one robot, running on this computer; it starts disarmed.

    Parameters
    ----------
    parameters : structured array (1,)
        Of `ballbot.firmware.records.PARAMETERS` in single precision.

    Raises
    ------
    InputError
        If there is no compiler, or the parameters are not those of the library.
    """

    def __init__(self, parameters: NDArray[np.void]) -> None:
        self.parameters = parameters
        self.state = np.zeros(1, STATE.dtype("single"))
        self._functions = _typed(library().functions)
        self._torques = np.zeros(MAX_WHEELS, dtype=np.float32)
        self._wheels = int(parameters["wheel_count"][0])
        if not self._functions.ballbot_init(self.state.ctypes.data, parameters.ctypes.data):
            raise InputError("The firmware does not know these parameters: they are of another version.")

    def arm(self) -> bool:
        """Forget a stop, and give torques from the next update on; return False unless the self-test has passed."""
        return bool(self._functions.ballbot_arm(self.state.ctypes.data))

    def start_self_test(self) -> None:
        """Let the next updates be the self-test."""
        self._functions.ballbot_start_self_test(self.state.ctypes.data)

    def skip_self_test(self) -> None:
        """Count the self-test as passed."""
        self._functions.ballbot_skip_self_test(self.state.ctypes.data)

    def skip_imu_check(self) -> None:
        """Count the IMU's axes as checked."""
        self._functions.ballbot_skip_imu_check(self.state.ctypes.data)

    @property
    def self_test(self) -> SelfTestOutcome:
        """The result of the self-test."""
        return SelfTestOutcome(self._functions.ballbot_self_test_of(self.state.ctypes.data))

    def disarm(self) -> None:
        """Give no torques until armed again."""
        self._functions.ballbot_disarm(self.state.ctypes.data)

    def update(
        self, reading: NDArray[np.void], time: int, reference: NDArray[np.float64] | None
    ) -> NDArray[np.float32]:
        """Take one sample and return the torques (n,) [N m].

        Parameters
        ----------
        reading : structured array (1,)
            Of `ballbot.firmware.records.READING` in single precision.
        time : int
            [us]
        reference : array (10,), optional
            The last one holds if it is not given.
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
        number = self._functions.ballbot_stop_of(self.state.ctypes.data)
        word = self._functions.ballbot_stop_word(number).decode()
        return StopReason(word) if word else None
