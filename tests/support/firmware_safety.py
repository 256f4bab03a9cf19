"""The firmware's safety layer and the pushes of its self-test in Python: what its C is compared with."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ballbot.control.safety import SafetyLimits, StopReason
from ballbot.robot import Robot


class Safety:
    """The layer of a robot with one wheel: `watch` and `admit` before the controller is asked, `release` after it."""

    def __init__(self, limits: SafetyLimits) -> None:
        self.limits = limits
        self.stop: StopReason | None = None
        self._missing, self._repeated, self._pushed = 0, 0, 0
        self._t: float | None = None
        self._imu: list[float] = []
        self._angle = math.nan

    def watch(self, imu: Sequence[float], angle: float, torque: float) -> None:
        """Stop if a sensor is stuck: the IMU's values, or the wheel's angle under the torque since the last sample."""
        if self.stop is not None:
            return
        self._repeated = self._repeated + 1 if list(imu) == self._imu else 0
        pushes = abs(torque) >= self.limits.turning_torque and angle == self._angle
        forward = math.copysign(1, torque)
        self._pushed = (max(int(forward * self._pushed), 0) + 1) * int(forward) if pushes else 0
        self._imu, self._angle = list(imu), angle
        most = self.limits.max_unchanged
        if most and max(self._repeated, abs(self._pushed)) >= most:
            self.stop = StopReason.STUCK

    def admit(self, t: float, *, measured: bool, theta: float, phi: float) -> bool:
        """Take a sample; return whether torques may follow from it."""
        if self.stop is not None:
            return False
        interval = 0.0 if self._t is None else t - self._t
        self._t = t
        known = math.isfinite(theta) and math.isfinite(phi)
        self._missing = 0 if measured and known else self._missing + 1
        if not interval <= self.limits.max_interval:  # a NaN is late
            self.stop = StopReason.LATE
        elif self._missing > self.limits.max_missing:
            self.stop = StopReason.MISSING
        elif known and max(abs(theta), abs(phi)) > self.limits.lean:
            self.stop = StopReason.LEAN
        return self.stop is None and known

    def release(self, torque: float) -> float:
        """Return the torque for the motor: zero after a stop, which a torque that is no number causes."""
        if self.stop is None and not math.isfinite(torque):
            self.stop = StopReason.TORQUE
        return torque if self.stop is None else 0.0


#: of the whole self-test [s]
SELF_TEST_DURATION = 0.5
#: share of a wheel's turn at the test in which it is pushed forward, and then back
_PUSH_FRACTION = 0.2


def self_test_torques(robot: Robot, t: float) -> NDArray[np.float64]:
    """Return the torques (n,) at time t [s] since the self-test's start [N m]: one wheel after the other, 1 N m."""
    torques = np.zeros(robot.wheel_count)
    turn, within = divmod(t * robot.wheel_count / SELF_TEST_DURATION + 1e-9, 1.0)
    if turn < robot.wheel_count and within < 2.0 * _PUSH_FRACTION:
        torques[int(turn)] = 1.0 if within < _PUSH_FRACTION else -1.0
    return torques
