"""The safety layer between a controller and the motors: it bridges a short gap and stops on everything worse.

    sample without a valid measurement    up to `max_missing` in a row are bridged; one more stops
    lean beyond the limit                 stops at once
    torque that is not a finite number    stops at once

A gap is bridged by the estimator, which predicts the state; if no state comes at all, the torques are zero for so long
and the controller is not asked. A stop is latched: every torque is zero until `reset`, and `stop` says why. `Safety` is
plain logic on scalars, so that firmware has the same; `SafeController` puts it around a controller, and `simulate`
does so with every controller that it runs.
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
from ballbot.estimation.named import EstimatorName
from ballbot.robot import Robot

#: lean [rad] past which no wheel holds the ball any more, the model's own end
_LARGEST_LEAN = 1.2


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
        _LARGEST_LEAN  #: largest |theta| and |phi| [rad]; on a robot choose the lean it can recover from
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
            Measured, or predicted by an estimator; NaN if there is none.
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
