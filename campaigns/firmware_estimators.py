"""The firmware's estimators over hours, against the float64 ones of Python.

.venv/bin/python -m campaigns.evidence firmware_estimators

The difference of two filters that get the same readings comes from rounding alone. It is given in the filter's own
standard deviations: a difference that is small against them is of no use to notice.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot import Robot
from ballbot.control.records import schema_of
from ballbot.estimation import OnboardState
from ballbot.estimation.interface import EstimatorName, Fix, Reading
from ballbot.estimation.kalman import KalmanFilter
from ballbot.firmware.estimators import (
    KalmanMemory,
    OnboardMemory,
    firmware_states,
    kalman_record,
    onboard_record,
    reading_record,
    single,
    step_of,
)
from ballbot.firmware.host import library
from ballbot.mechanics.geometry import body_rates_matrix, rotation, transforms
from campaigns.section import Section

H = 0.005  #: [s]
MEMORIES = {"onboard": OnboardMemory, "kalman": KalmanMemory}
#: when the long run is looked at [min]
_MINUTES = (1, 10, 60, 120)


def address(array: NDArray) -> ctypes.c_void_p:
    """Return the address of an array's first number."""
    return ctypes.c_void_p(array.ctypes.data)


class Compiled:
    """An estimator in C, with the interface of one in Python."""

    def __init__(self, name: EstimatorName, robot: Robot, *, sample_time: float = H) -> None:
        make = {"onboard": onboard_record, "kalman": kalman_record}[name]
        self.robot, self.name = robot, name
        self.record = single(make(robot, sample_time=sample_time))
        self.memory = np.zeros(1, schema_of(MEMORIES[name]).dtype("single"))
        self._update = getattr(library().functions, f"ballbot_{name}_update")
        self._update.restype = ctypes.c_int32

    def reset(self, *, position: tuple[float, float] = (0.0, 0.0)) -> None:
        """Reset: the robot stands still at (x, y) [m] when the next reading comes."""
        call = getattr(library().functions, f"ballbot_{self.name}_reset")
        call(address(self.memory), address(np.array(position, dtype=np.float32)))

    def update(self, reading: Reading) -> NDArray[np.float64]:
        """Take one sample and return the state (10,)."""
        return self.take(reading_record(reading, robot=self.robot))[0]

    def take(self, record: NDArray[np.void]) -> tuple[NDArray[np.float64], bool]:
        """Take a reading's record; return the state and whether the reading was whole."""
        state = np.zeros(10, dtype=np.float32)
        given = (address(self.record), address(self.memory), self.robot.wheel_count, address(record))
        whole = self._update(*given, address(state))
        return state.astype(np.float64), bool(whole)


def readings(
    robot: Robot, *, samples: int, seed: int = 1, missing: float = 0.0, fixes: float = 0.0, h: float = H
) -> Iterator[Reading]:
    """Return what the sensors of a robot show that sways, turns and rolls; single-precision numbers, whole counts.

    Parameters
    ----------
    robot : Robot
    samples, seed : int
    missing : float
        Chance that encoders, gyro or attitude are missing in a sample.
    fixes : float
        Chance of a fix in a sample.
    h : float
        Sample time [s].
    """
    random = np.random.default_rng(seed)
    step, wheels = step_of(robot), transforms(robot).T_owb
    bias, drift = random.normal(0.0, 2e-3, 3), 1.5e-3
    angles = counted = np.zeros(robot.wheel_count)
    for k in range(samples):
        t = k * h
        attitude = np.array(
            [0.04 * np.sin(1.3 * t), -0.03 * np.cos(1.7 * t), 0.3 * np.sin(t) - 1.5 * np.cos(0.2 * t)]
        )
        rate = np.array(
            [0.052 * np.cos(1.3 * t), 0.051 * np.sin(1.7 * t), 0.3 * np.cos(t) + 0.3 * np.sin(0.2 * t)]
        )
        gyro = body_rates_matrix(*attitude) @ rate
        v_x, v_y = 0.4 * np.sin(0.5 * t), 0.3 * np.cos(0.3 * t)
        ball = rotation(*attitude).T @ np.array([-v_y, v_x, 0.0]) / robot.ball.radius
        angles = angles + h * (wheels @ (ball - gyro))
        before, counted = counted, np.floor(angles / step) * step
        gyro = gyro + bias + random.normal(0.0, robot.sensors.gyro_noise, 3)
        shown = attitude + random.normal(0.0, robot.sensors.attitude_noise, 3) + [0.0, 0.0, drift * t]
        speeds, gyro, shown = (
            one.astype(np.float32).astype(np.float64) for one in ((counted - before) / h, gyro, shown)
        )
        lost = random.random(3) < missing
        heading = float(attitude[2]) + 2.0 * np.pi * random.integers(-2, 3)
        position = np.array([0.8 - 0.8 * np.cos(0.5 * t), np.sin(0.3 * t)]) + random.normal(0.0, 0.005, 2)
        yield Reading(
            wheel_angles=np.full_like(counted, np.nan) if lost[0] else counted,
            wheel_speeds=np.full_like(speeds, np.nan) if lost[0] else speeds,
            gyro=np.array([gyro[0], np.nan, 1e9]) if lost[1] else gyro,
            attitude=np.array([shown[0], np.nan, shown[2]]) if lost[2] else shown,
            fix=Fix(position=position, heading=heading) if random.random() < fixes else None,
        )


def covariances(compiled: Compiled, exact: KalmanFilter) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the covariances (14, 14) of the filter in C and of the one in Python in the firmware's states."""
    upper = np.triu(compiled.memory["P"][0].astype(np.float64))
    T = firmware_states()
    return upper + np.triu(upper, 1).T, T @ exact._P @ T.T


@dataclass(frozen=True, kw_only=True)
class Look:
    """The filter in C at an instant of a long run."""

    minutes: float
    state: float  #: largest difference of x, y, theta, phi, psi and v so far, in standard deviations
    covariance: float  #: largest difference of an element over both standard deviations
    correlation: float  #: smallest eigenvalue of the correlation matrix
    exact_correlation: float  #: the same in float64
    onboard: float  #: largest difference of the thesis's on-board position so far [m]


def long_run(robot: Robot, *, minutes: Sequence[float], fixes: float = 0.0, seed: int = 1) -> list[Look]:
    """Return how the estimators in C differ from those in Python, at some instants of one run."""
    filters = Compiled("kalman", robot), KalmanFilter(robot, sample_time=H)
    plain = Compiled("onboard", robot), OnboardState(robot, sample_time=H)
    looks = [round(60.0 * one / H) for one in minutes]
    found, state, place = [], 0.0, 0.0
    for k, reading in enumerate(readings(robot, samples=max(looks), seed=seed, fixes=fixes), start=1):
        a, b = (one.update(reading) for one in filters)
        c, d = (one.update(reading) for one in plain)
        place = max(place, float(np.abs(c - d)[:2].max()))
        if k % 20 == 0 or k in looks:
            deviation = np.sqrt(np.diagonal(filters[1].covariance))
            state = max(state, float((np.abs(a - b)[:7] / deviation).max()))
        if k in looks:
            P, exact = covariances(*filters)
            scale = np.sqrt(np.outer(np.diagonal(exact), np.diagonal(exact)))
            found.append(
                Look(
                    minutes=k * H / 60.0,
                    state=state,
                    covariance=float(np.abs((P - exact) / scale).max()),
                    correlation=float(np.linalg.eigvalsh(P / scale)[0]),
                    exact_correlation=float(np.linalg.eigvalsh(exact / scale)[0]),
                    onboard=place,
                )
            )
    return found


def campaign() -> Section:
    """Return the differences over two hours, without a fix and with one every 100 s."""
    robot = Robot.load("alten")
    rows = []
    for name, fixes in (("none", 0.0), ("one in 100 s", H / 100.0)):
        rows += [
            [
                name,
                f"{look.minutes:g}",
                f"{look.state:.4f}",
                f"{look.covariance:.4f}",
                f"{look.correlation:.2e}",
                f"{look.exact_correlation:.2e}",
                f"{1e6 * look.onboard:.2f}",
            ]
            for look in long_run(robot, minutes=_MINUTES, fixes=fixes)
        ]
    return Section(
        title="The firmware's estimators",
        before="The estimators of the firmware, in single precision, and those of Python, in float64, take the same "
        "readings of a robot (alten, 200 Hz) that sways, rolls and turns. Differences of the Kalman filter's place, "
        "attitude and velocity are the largest so far, in its own standard deviations; those of its covariance are "
        "over both standard deviations. The smallest eigenvalue of the correlation matrix is positive as long as "
        "the covariance is.",
        columns=[
            "fixes", "minutes", "state, deviations", "covariance", "smallest eigenvalue", "in float64",
            "thesis's position, um",
        ],
        rows=rows,
    )  # fmt: skip
