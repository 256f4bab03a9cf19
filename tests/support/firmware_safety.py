"""The firmware's safety layer in Python: what its C is compared with."""

import math
from collections.abc import Sequence

from ballbot.control.safety import SafetyLimits, StopReason


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
