"""Safety: the layer between a controller and the motors, and a self-test before the first balance.

The layer bridges a short gap in the measurements (NaN, infinite or beyond a million) and stops on everything worse::

    sample without a valid measurement    up to `max_missing` in a row are bridged; one more stops
    lean beyond the limit                 stops at once
    torque that is not a finite number    stops at once
    late sample                           stops, if more than `max_interval` has passed since the last
    stuck sensor                          stops after `max_unchanged` samples: an IMU that repeats itself, or an
                                          encoder that does not count while its wheel must turn
    silent host                           stops, if the application calls `halt`; firmware does so after 50 ms

A gap is bridged by the estimator, which predicts the state. If there is no state at all, the torques are zero for as
long and the controller is not called. A stop is latched: every torque is zero until `reset`, and `stop` has the reason.
`Safety` is plain logic on scalars, so that firmware can have the same. `SafeController` puts it around a controller,
and `simulate` does so with every controller that it runs.

The self-test (`SelfTest`, half a second) checks that each encoder turns as its motor is pushed. It pushes one wheel
after the other forward and back and gives the others no torque. A motor or an encoder with the wrong sign, or cables
in the wrong order, would turn the balance's feedback into a push away from upright; here they move a wheel by a
degree or two. Hold the robot meanwhile, or let it stand upright by itself. The axes of the IMU are checked before it,
while a person moves the robot: `ballbot.control.imu_check`.

Examples
--------
>>> from ballbot import Robot, simulate
>>> from ballbot.control.presets import nominal_controller
>>> from ballbot.control.references import hold
>>> from ballbot.twin import Twin
>>> robot = Robot.load("alten")
>>> safe = SafeController(nominal_controller(robot), robot, SafetyLimits(lean=0.35))
>>> plant = Twin(robot)  # or your own robot behind the interface of a plant
>>> log = simulate(plant, SelfTest(robot), hold(), duration=SELF_TEST_DURATION)
>>> evaluate_self_test(robot, log).passed  # otherwise its findings name the wiring errors
True
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.arrays import positive_number, real_array, whole_number
from ballbot.control.interface import LARGEST_STATE, Feedback, estimator_of
from ballbot.errors import InputError
from ballbot.estimation.interface import EstimatorName
from ballbot.findings import Finding
from ballbot.log import Log
from ballbot.log.columns import wheel_angle_names
from ballbot.robot import Robot
from ballbot.robot.derived import encoder_step

#: lean [rad] beyond which no wheel holds the ball: the end of the model
_MAX_LEAN = 1.2


class StopReason(StrEnum):
    """Why the torques were stopped."""

    MISSING = "missing"  #: more samples in a row without a valid measurement than are bridged
    LEAN = "lean"  #: theta or phi beyond the limit
    TORQUE = "torque"  #: a torque that is not a finite number
    LATE = "late"  #: more time between two samples than is allowed
    STUCK = "stuck"  #: a sensor that gives the same value sample after sample
    LINK = "link"  #: no valid frame from the host for too long


@dataclass(frozen=True, kw_only=True)
class Stop:
    """A latched stop."""

    reason: StopReason
    t: float  #: when [s]
    text: str  #: one sentence, with the time


@dataclass(frozen=True, kw_only=True)
class SafetyLimits:
    """Limits beyond which the safety layer sets all torques to zero until `SafeController.reset`.

    Raises
    ------
    InputError
        If `max_missing` or `max_unchanged` is not a whole number, zero or more, or another limit is not above zero.
    """

    max_missing: int = 2  #: samples in a row without a valid measurement that are bridged
    #: largest |theta| and |phi| [rad]; on a robot choose the lean it can recover from
    lean: float = _MAX_LEAN
    max_interval: float = math.inf  #: longest time between two samples [s]
    #: samples in a row in which a sensor may repeat itself; 0: any number, as perfect sensors at rest do
    max_unchanged: int = 0
    turning_torque: float = math.inf  #: torque [N m] in one direction under which a wheel must turn

    def __post_init__(self) -> None:
        whole_number(self.max_missing, "max_missing of the safety limits", least=0)
        whole_number(self.max_unchanged, "max_unchanged of the safety limits", least=0)
        positive_number(self.lean, "lean of the safety limits")
        for name in ("max_interval", "turning_torque"):
            if getattr(self, name) != math.inf:
                positive_number(getattr(self, name), f"{name} of the safety limits")

    @classmethod
    def on_robot(cls, robot: Robot, *, sample_time: float, lean: float = 0.35) -> SafetyLimits:
        """Return the limits for a real robot, whose sensors have noise and whose loop may be late.

        A sample may be as late as a gap that is bridged. A sensor may repeat itself for `_STUCK_TIME`. A wheel must
        turn under twice its break-away torque, and under a quarter of the torque limit if that is more.

        Parameters
        ----------
        robot : Robot
        sample_time : float
            [s]
        lean : float
            Largest |theta| and |phi| [rad]; `ballbot limits` finds the lean that a robot recovers from.

        Raises
        ------
        InputError
            If the lean is not above zero and at most 1.2 rad.
        """
        if lean > _MAX_LEAN:
            raise InputError(
                f"lean of the safety limits is {lean:g} rad; it must be at most {_MAX_LEAN:g} rad, beyond which no "
                "wheel holds the ball."
            )
        torque = max(_TURNING * max(robot.friction.breakaway), 0.25 * robot.drive.torque_limit)
        return cls(
            lean=lean,
            max_interval=(cls.max_missing + 1.5) * sample_time,
            max_unchanged=max(3, math.ceil(_STUCK_TIME / sample_time - 1e-9)),
            turning_torque=min(torque, robot.drive.torque_limit),
        )


#: for which a sensor of a real robot may repeat itself [s]; an IMU of 100 Hz does so for 0.01 s
_STUCK_TIME = 0.1
#: torque over the break-away torque under which a wheel must turn
_TURNING = 2.0


class Safety:
    """The logic, a sample at a time: `watch` and `admit` before the controller is asked, `release` with its answer."""

    def __init__(self, limits: SafetyLimits = SafetyLimits()) -> None:
        self.limits = limits
        self.reset()

    def reset(self) -> None:
        """Forget a stop and the past samples."""
        self._stop: Stop | None = None
        self._missing = 0
        self._t: float | None = None
        self._imu: tuple[float, ...] = ()
        self._angles: tuple[float, ...] = ()
        self._imu_unchanged = 0
        self._pushed: list[int] = []

    @property
    def stop(self) -> Stop | None:
        """The stop that is latched, or None."""
        return self._stop

    @property
    def missing(self) -> int:
        """How many samples in a row, up to the last, came without a valid measurement."""
        return self._missing

    def watch(
        self, t: float, *, imu: Sequence[float], angles: Sequence[float], torques: Sequence[float]
    ) -> None:
        """Take what the sensors gave in a sample, and stop if one of them is stuck. Optional; call it before `admit`.

        Parameters
        ----------
        t : float
            [s]
        imu : sequence of float
            All values of the IMU, the same ones in each sample; NaN if missing.
        angles : sequence of float
            The encoders' (n,), in any unit; NaN if missing.
        torques : sequence of float
            Those of the wheels since the last sample (n,) [N m].
        """
        if self._stop is not None:
            return
        repeated = len(self._imu) == len(imu) and all(a == b for a, b in zip(self._imu, imu, strict=True))
        self._imu_unchanged = self._imu_unchanged + 1 if repeated else 0
        still = self._angles or (math.nan,) * len(angles)
        before = self._pushed or [0] * len(angles)
        self._pushed = [
            self._pushed_on(count, torque) if angle == last else 0
            for count, torque, angle, last in zip(before, torques, angles, still, strict=True)
        ]
        self._imu, self._angles = tuple(imu), tuple(angles)
        most = self.limits.max_unchanged
        if most and self._imu_unchanged >= most:
            self._latch(StopReason.STUCK, t, f"the IMU has given the same values for {most + 1} samples")
        for wheel, count in enumerate(self._pushed):
            if most and abs(count) >= most and self._stop is None:
                self._latch(
                    StopReason.STUCK,
                    t,
                    f"wheel {wheel + 1} was driven for {most} samples and its encoder did not count",
                )

    def _pushed_on(self, count: int, torque: float) -> int:
        """Return for how many samples a wheel that did not turn was pushed, negative if backward."""
        if torque >= self.limits.turning_torque:
            return max(count, 0) + 1
        return min(count, 0) - 1 if torque <= -self.limits.turning_torque else 0

    def admit(self, t: float, *, measured: bool, theta: float, phi: float) -> bool:
        """Take a sample; return whether torques may follow from it.

        Parameters
        ----------
        t : float
            [s]
        measured : bool
            Whether the sensors gave all that the state needs; if not, the state is a prediction.
        theta, phi : float
            Of the state, measured or predicted [rad]; not finite if there is no state.
        """
        if self._stop is not None:
            return False
        interval = 0.0 if self._t is None else t - self._t
        self._t = t
        known = math.isfinite(theta) and math.isfinite(phi)
        self._missing = 0 if measured and known else self._missing + 1
        if not interval <= self.limits.max_interval:  # a NaN is late
            limit = self.limits.max_interval
            self._latch(
                StopReason.LATE,
                t,
                f"{interval:.3g} s since the last sample; at most {limit:.3g} s are allowed",
            )
        elif self._missing > self.limits.max_missing:
            bridged = self.limits.max_missing
            self._latch(
                StopReason.MISSING,
                t,
                f"no valid measurement for {bridged + 1} samples; {bridged} are bridged",
            )
        elif known and max(abs(theta), abs(phi)) > self.limits.lean:
            lean = max(abs(theta), abs(phi))
            self._latch(
                StopReason.LEAN, t, f"the lean is {lean:.3g} rad; the limit is {self.limits.lean:g} rad"
            )
        return self._stop is None and known

    def halt(self, t: float, reason: StopReason, why: str) -> None:
        """Stop for a reason outside the layer, as a silent host is; `why` is a clause. A stop that is latched stays."""
        if self._stop is None:
            self._latch(reason, t, why)

    def release(self, t: float, wheel: int, torque: float) -> float:
        """Return a wheel's torque [N m] for the motor: zero after a stop, which a torque that is no number causes."""
        if self._stop is None and not math.isfinite(torque):
            self._latch(
                StopReason.TORQUE,
                t,
                f"the controller's torque {torque} on wheel {wheel} is not a finite number",
            )
        return torque if self._stop is None else 0.0

    def _latch(self, reason: StopReason, t: float, why: str) -> None:
        self._stop = Stop(reason=reason, t=t, text=f"stopped at t = {t:.3f} s: {why}.")


class SafeController:
    """A controller behind the safety layer; it is a controller itself.

    Parameters
    ----------
    controller : Feedback
        A `Controller`, or any object with `sample_time`, `reset()` and `update(t, state, reference)`.
    robot : Robot
        Gives the number of wheels.
    limits : SafetyLimits
    """

    def __init__(
        self,
        controller: Feedback,
        robot: Robot,
        limits: SafetyLimits = SafetyLimits(),
    ) -> None:
        self.controller = controller
        self.robot = robot
        self.safety = Safety(limits)

    @property
    def sample_time(self) -> float:
        """Time between two updates [s], the controller's."""
        return self.controller.sample_time

    @property
    def estimator(self) -> EstimatorName:
        """Name of the on-board state that the controller is made for."""
        return estimator_of(self.controller)

    @property
    def stop(self) -> Stop | None:
        """Why the torques are zero until `reset`, or None."""
        return self.safety.stop

    def reset(self) -> None:
        """Start anew: a stop is forgotten, and what the controller remembers too."""
        self.safety.reset()
        self.controller.reset()

    def update(
        self, t: float, state: ArrayLike, reference: NDArray[np.float64], *, measured: bool = True
    ) -> NDArray[np.float64]:
        """Return the wheel torques (n,) [N m] that may go to the motors.

        Parameters
        ----------
        t : float
            [s]
        state : array_like (10,)
            Measured, or predicted by an estimator; NaN without an estimator.
        reference : array (10,)
        measured : bool
            Whether the state is measured. A state with a value that is not finite is not.

        Raises
        ------
        InputError
            If the state is not ten numbers, or the controller returns anything but n.
        """
        n = self.robot.wheel_count
        x = real_array(state, (10,), "The state", finite=False)
        valid = bool((np.abs(x) <= LARGEST_STATE).all())
        theta, phi = (float(x[2]), float(x[3])) if valid else (math.nan, math.nan)
        if not self.safety.admit(t, measured=measured, theta=theta, phi=phi):
            return np.zeros(n)
        answer = self.controller.update(t, x, reference)
        if np.shape(answer) != (n,):
            raise InputError(
                f"The controller returned torques of the shape {np.shape(answer)} at t = {t:g} s; the robot has {n} "
                "wheels."
            )
        torques = real_array(answer, (n,), "The array of the controller's torques", finite=False)
        released = [self.safety.release(t, wheel + 1, float(u)) for wheel, u in enumerate(torques)]
        # a torque that is no number stops the wheels before it as well
        return np.zeros(n) if self.safety.stop is not None else np.array(released)


#: of the whole test [s]
SELF_TEST_DURATION = 0.5
#: share of a wheel's turn at the test in which it is pushed forward, and then back
_PUSH_FRACTION = 0.2
#: a wheel that turns by fewer encoder counts than this has not moved
_MIN_COUNTS = 20


class SelfTest:
    """A controller that pushes one wheel after the other, for `ballbot.simulate` and robots alike.

    Run it for `SELF_TEST_DURATION`.

    Parameters
    ----------
    robot : Robot
    torque : float
        Of each push [N m]: it must move its wheel, and with it the ball and the other wheels.

    Raises
    ------
    InputError
        If the torque is not within the drive's limit, or not above the robot's break-away torque.
    """

    sample_time: float

    def __init__(self, robot: Robot, *, torque: float = 1.0) -> None:
        stuck = float(np.add(robot.friction.coulomb, robot.friction.stribeck).max())
        if not stuck < torque <= robot.drive.torque_limit:
            raise InputError(
                f"The self-test's torque is {torque:g} N m; it must be above the largest break-away torque, "
                f"{stuck:g} N m, and at most the torque limit of the drive, {robot.drive.torque_limit:g} N m."
            )
        self.robot = robot
        self.torque = torque
        self.sample_time = robot.sensors.sample_time

    def reset(self) -> None:
        """Do nothing: the self-test has no memory."""

    def update(
        self,
        t: float,
        state: NDArray[np.float64],  # noqa: ARG002
        reference: NDArray[np.float64],  # noqa: ARG002
    ) -> NDArray[np.float64]:
        """Return the torques (n,) at time t [s] since the test's start [N m]."""
        n = self.robot.wheel_count
        torques = np.zeros(n)
        turn, within = divmod(t * n / SELF_TEST_DURATION + 1e-9, 1.0)
        if turn < n and within < 2.0 * _PUSH_FRACTION:
            torques[int(turn)] = self.torque if within < _PUSH_FRACTION else -self.torque
        return torques


@dataclass(frozen=True, kw_only=True)
class SelfTestResult:
    """The result of a self-test."""

    turned: tuple[tuple[float, ...], ...]  #: by the wheel pushed, by how much each encoder turned [rad]
    findings: tuple[Finding, ...]  #: an error for each wheel that is wrong

    @property
    def passed(self) -> bool:
        """Whether the robot may balance."""
        return not self.findings


def evaluate_self_test(robot: Robot, log: Log) -> SelfTestResult:
    """Return the result of a self-test from the encoders in its log.

    Parameters
    ----------
    robot : Robot
    log : Log
        Of at least `SELF_TEST_DURATION`, from the test's start on.

    Raises
    ------
    InputError
        If the log is shorter.
    """
    n = robot.wheel_count
    if len(log) * log.sample_time < SELF_TEST_DURATION - 0.5 * log.sample_time:
        raise InputError(
            f"The self-test's log lasts {len(log) * log.sample_time:g} s; it must last {SELF_TEST_DURATION:g} s."
        )
    angles = np.column_stack([log[name] for name in wheel_angle_names(n)])
    least = _MIN_COUNTS * encoder_step(
        encoder_counts=robot.sensors.encoder_counts, gear_ratio=robot.drive.gear_ratio
    )
    turned, findings = [], []
    for wheel in range(n):
        first, last = (
            round((wheel + share) * SELF_TEST_DURATION / n / log.sample_time)
            for share in (0.0, _PUSH_FRACTION)
        )
        turns = angles[last] - angles[first]
        turned.append(tuple(turns.tolist()))
        if finding := _wheel_finding(wheel, turns, least):
            findings.append(finding)
    return SelfTestResult(turned=tuple(turned), findings=tuple(findings))


def _wheel_finding(wheel: int, turns: NDArray[np.float64], least: float) -> Finding | None:
    fastest = int(np.argmax(np.abs(turns)))
    motor = f"Motor {wheel + 1} was driven"
    if abs(turns[fastest]) < least:
        return _error(
            "dead-motor", f"{motor} and no encoder turned: the motor has no power, or its wheel is stuck."
        )
    if fastest != wheel:
        return _error(
            "torque-order",
            f"{motor} and encoder {fastest + 1} turned the most: cables are in the wrong order.",
        )
    if turns[wheel] < 0.0:
        return _error(
            "torque-sign",
            f"{motor} forward and its encoder turned backward: one of the two has the wrong sign.",
        )
    return None


def _error(code: str, text: str) -> Finding:
    return Finding(code=code, severity="error", text=text)
