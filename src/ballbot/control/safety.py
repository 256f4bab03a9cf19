"""Safety: the layer between a controller and the motors, and a self-test before the first balance.

The layer bridges a short gap in the measurements and stops on everything worse:

    sample without a valid measurement    up to `max_missing` in a row are bridged; one more stops
    lean beyond the limit                 stops at once
    torque that is not a finite number    stops at once

A gap is bridged by the estimator, which predicts the state. If there is no state at all, the torques are zero for as
long and the controller is not called. A stop is latched: every torque is zero until `reset`, and `stop` has the reason.
`Safety` is plain logic on scalars, so that firmware can have the same. `SafeController` puts it around a controller,
and `simulate` does so with every controller that it runs.

The self-test (`SelfTest`, half a second) checks that each encoder turns as its motor is pushed. It pushes one wheel
after the other forward and back and gives the others no torque. A motor or an encoder with the wrong sign, or cables
in the wrong order, would turn the balance's feedback into a push away from upright; here they move a wheel by a
degree or two. Hold the robot meanwhile, or let it stand upright by itself.
"""

from __future__ import annotations

import math
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

#: lean [rad] past which no wheel holds the ball any more, the model's own end
_MAX_LEAN = 1.2


class StopReason(StrEnum):
    """Why the torques were stopped."""

    MISSING = "missing"  #: more samples in a row without a valid measurement than are bridged
    LEAN = "lean"  #: theta or phi beyond the limit
    TORQUE = "torque"  #: a torque that is not a finite number


@dataclass(frozen=True, kw_only=True)
class Stop:
    """A latched stop."""

    reason: StopReason
    t: float  #: when [s]
    text: str  #: one sentence, with the time


@dataclass(frozen=True, kw_only=True)
class SafetyLimits:
    """What the safety layer lets pass.

    Raises
    ------
    InputError
        If `max_missing` is not a whole number, zero or more, or the lean is not above zero.
    """

    max_missing: int = 2  #: samples in a row without a valid measurement that are bridged
    lean: float = (
        _MAX_LEAN  #: largest |theta| and |phi| [rad]; on a robot choose the lean it can recover from
    )

    def __post_init__(self) -> None:
        whole_number(self.max_missing, "max_missing of the safety limits", least=0)
        positive_number(self.lean, "lean of the safety limits")


class Safety:
    """The logic, a sample at a time: `admit` before the controller is asked, `release` with what it answers."""

    def __init__(self, limits: SafetyLimits = SafetyLimits()) -> None:
        self.limits = limits
        self.reset()

    def reset(self) -> None:
        """Forget a stop and the samples that were missing."""
        self._stop: Stop | None = None
        self._missing = 0

    @property
    def stop(self) -> Stop | None:
        """The stop that is latched, or None."""
        return self._stop

    @property
    def missing(self) -> int:
        """How many samples in a row, up to the last, came without a valid measurement."""
        return self._missing

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
        known = math.isfinite(theta) and math.isfinite(phi)
        self._missing = 0 if measured and known else self._missing + 1
        if self._missing > self.limits.max_missing:
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
    """A controller that pushes one wheel after the other, for `ballbot.simulate` and robots alike; run for `DURATION`.

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
        Of at least `DURATION`, from the test's start on.

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
