"""The firmware's estimators, compiled for this computer, with the interface of Python's; and the filter over hours.

The difference of two filters that get the same readings comes from rounding alone. It is given in the filter's own
standard deviations: a difference that is small against them is of no use to notice.
"""

import ctypes
import tempfile
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ballbot import Robot
from ballbot.arrays import Floats
from ballbot.estimation.interface import EstimatorName, Reading
from ballbot.estimation.kalman import kalman_record
from ballbot.estimation.kalman_model import KalmanRecord
from ballbot.estimation.onboard import ONBOARD_MEMORY, OnboardRecord, onboard_record
from ballbot.firmware.build import compile_sources
from ballbot.firmware.estimators import KALMAN_MEMORY, reading_record
from ballbot.firmware.header import SOURCES
from ballbot.mechanics.geometry import transforms
from ballbot.records import Precision, converted, fill_record, schema_of
from ballbot.robot.derived import encoder_step
from tests.support.compiled_firmware import library

H = 0.005  #: [s]
#: included before a source, it is compiled in double precision
DOUBLE = Path(__file__).with_name("firmware_double.h")
MEMORIES = {"onboard": ONBOARD_MEMORY, "kalman": KALMAN_MEMORY}

_REAL = {"single": np.float32, "double": np.float64}


def record_of(numbers: OnboardRecord | KalmanRecord, precision: Precision) -> NDArray[np.void]:
    """Return an estimator's numbers as a record (1,)."""
    schema = schema_of(type(numbers))
    record = schema.zeros()
    fill_record(record, numbers)
    return converted(record, schema) if precision == "single" else record


def address(array: NDArray) -> ctypes.c_void_p:
    """Return the address of an array's first number."""
    return ctypes.c_void_p(array.ctypes.data)


class Compiled:
    """An estimator in C, with the interface of one in Python."""

    def __init__(
        self, name: EstimatorName, robot: Robot, *, sample_time: float = H, precision: Precision = "single"
    ) -> None:
        make = {"onboard": onboard_record, "kalman": kalman_record}[name]
        self.robot, self.name = robot, name
        self.precision: Precision = precision
        numbers = make(robot, sample_time=sample_time)
        self.record = record_of(numbers, precision)
        self.memory = np.zeros(1, MEMORIES[name].dtype(precision))
        self._state = np.zeros(10, _REAL[precision])
        functions = library().functions if precision == "single" else hours_library(precision)
        self._update, self._reset = (getattr(functions, f"ballbot_{name}_{do}") for do in ("update", "reset"))
        self._update.restype = ctypes.c_int32

    def reset(self, *, position: tuple[float, float] = (0.0, 0.0)) -> None:
        """Reset: the robot stands still at (x, y) [m] when the next reading comes."""
        self._reset(address(self.memory), address(np.array(position, dtype=self._state.dtype)))

    def update(self, reading: Reading) -> Floats:
        """Take one sample and return the state (10,)."""
        return self.take(reading_record(reading, robot=self.robot, precision=self.precision))[0]

    def take(self, record: NDArray[np.void]) -> tuple[Floats, bool]:
        """Take a reading's record; return the state and whether the reading was whole."""
        given = (address(self.record), address(self.memory), self.robot.wheel_count, address(record))
        whole = self._update(*given, address(self._state))
        return self._state.astype(np.float64), bool(whole)


#: greatest relative rounding error of one operation in single precision
ROUNDOFF = 2.0**-24


def covariance_in(memory: NDArray[np.void]) -> Floats:
    """Return the covariance (14, 14) in a filter's memory, of which what lies below the diagonal is not used."""
    above = np.triu(memory["P"][0].astype(np.float64))
    return above + np.triu(above, 1).T


@cache
def hours_library(precision: Precision) -> ctypes.CDLL:
    """Return the estimators in C in one precision, with what drives it (`firmware_hours.c`)."""
    here = Path(__file__).parent
    sources = [
        *(SOURCES / "estimation" / name for name in ("kalman.c", "onboard.c", "slip.c", "swing.c")),
        here / "firmware_hours.c",
    ]
    flags = ["-O2", "-fPIC", "-shared", "-Wno-conversion", "-Wno-double-promotion"]
    if precision == "double":
        flags += ["-include", str(DOUBLE), "-Wno-float-conversion"]
    else:
        sources.append(SOURCES / "ballbot_math.c")
    with tempfile.TemporaryDirectory(prefix="ballbot-hours-", ignore_cleanup_errors=True) as folder:
        target = Path(folder) / "hours.so"
        compile_sources(target, sources, flags=[*flags, "-lm"])
        return ctypes.CDLL(str(target))


class Driven:
    """The Kalman filter in C in one precision, over a long run that it drives itself.

    Parameters
    ----------
    robot : Robot
    precision : {"single", "double"}
    h : float
        Sample time [s].
    fixes : float
        Chance of a fix in a sample.
    """

    def __init__(self, robot: Robot, precision: Precision, *, h: float = H, fixes: float = 0.0) -> None:
        self.record = record_of(kalman_record(robot, sample_time=h), precision)
        self.memory = np.zeros(1, KALMAN_MEMORY.dtype(precision))
        self.state = np.zeros(10, _REAL[precision])
        wheels = np.zeros((4, 3))
        wheels[: robot.wheel_count] = transforms(robot).T_owb
        sensors = robot.sensors
        sizes = (h, robot.ball.radius, encoder_step(robot), sensors.gyro_noise, sensors.attitude_noise, fixes)
        self._world = np.concatenate([sizes, wheels.ravel(), np.zeros(4), [0.0, robot.wheel_count], [0.0]])
        self._run = hours_library(precision).run
        self._run.restype = None

    def run(self, samples: int) -> None:
        """Take so many samples more."""
        given = (address(self.record), address(self.memory), address(self._world))
        self._run(*given, ctypes.c_int64(samples), address(self.state))


def driven_run(
    robot: Robot, *, minutes: float, h: float = H, fixes: float = 0.0, looks: int = 20
) -> tuple[float, float, float]:
    """Return how the filter in single precision leaves that in double over one run, of what `looks` instants show.

    The largest difference of a state, in standard deviations; of an element of the covariance, over both; and the
    smallest ratio of the correlation matrices' smallest eigenvalues.
    """
    state, covariance, ratio = 0.0, 0.0, np.inf
    filters = [Driven(robot, precision, h=h, fixes=fixes) for precision in ("single", "double")]
    for _ in range(looks):
        for one in filters:
            one.run(round(60.0 * minutes / h / looks))
        (P, x), (exact, true) = (
            (covariance_in(one.memory), one.memory["x"][0].astype(np.float64) + one.memory["rest"][0])
            for one in filters
        )
        deviations = np.sqrt(np.diagonal(exact))
        scale = np.outer(deviations, deviations)
        state = max(state, float((np.abs(x - true) / deviations).max()))
        covariance = max(covariance, float(np.abs((P - exact) / scale).max()))
        ratio = min(ratio, float(np.linalg.eigvalsh(P / scale)[0] / np.linalg.eigvalsh(exact / scale)[0]))
    return state, covariance, ratio
