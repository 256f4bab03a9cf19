"""Safety: the layer between a controller and the motors.

It bridges short gaps in the measurements (NaN, infinite or beyond a million) and stops on any other fault::

    sample without a valid measurement    up to `max_missing` in a row are bridged; one more stops
    lean beyond the limit                 stops at once
    torque that is not a finite number    stops at once
    late sample                           stops, if more than `max_interval` has passed since the last

and in the firmware, which has the limits of `SafetyLimits.on_robot`::

    stuck sensor                          stops after `max_unchanged` samples: an IMU that repeats itself, or an
                                          encoder that does not count while its wheel must turn
    silent host                           stops after 50 ms without a valid frame

The estimator bridges a gap by predicting the state. Without any state the torques are zero and the controller is not
called. A stop is latched: every torque is zero until `reset`, and `stop` has the reason.
`simulate` puts a `SafeController` around every controller that it runs.

Examples
--------
>>> from ballbot import Robot
>>> from ballbot.control.presets import nominal_controller
>>> robot = Robot.load("alten")
>>> safe = SafeController(nominal_controller(robot), robot, SafetyLimits(lean=0.35))
>>> safe.update(0.0, [0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0] * 10)
array([0., 0., 0.])
>>> safe.stop.text
'stopped at t = 0.000 s: the lean is 0.5 rad; the limit is 0.35 rad.'
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
from ballbot.mechanics.held_ball import wheel_mobility
from ballbot.robot import Robot
from ballbot.robot.derived import encoder_step

#: lean [rad] beyond which the wheels lose the ball and the model ends
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

    InputError if `max_missing` or `max_unchanged` is not a whole number, or another limit is not above zero.
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
    def on_robot(
        cls,
        robot: Robot,
        *,
        sample_time: float,  # of the loop [s]
        lean: float = 0.35,  # [rad]; `ballbot limits` finds the lean that a robot recovers from
        torque_limit: float | None = None,  # of the controller [N m]; by default the motors'
    ) -> SafetyLimits:
        """Return the limits for a real robot, whose sensors have noise and whose loop may be late.

        A sample may be late by as much as a bridged gap lasts. A wheel must turn under somewhat more than the
        break-away torque of all wheels, as the ball couples them, but never only under more than three quarters of the
        way from its own to the limit. It may take as long as a wheel that turns round within a count of its encoder.

        InputError if the lean is not above zero and at most 1.2 rad, or a wheel does not break away under the limit.
        """
        if lean > _MAX_LEAN:
            raise InputError(
                f"lean of the safety limits is {lean:g} rad; it must be at most {_MAX_LEAN:g} rad, beyond which no "
                "wheel holds the ball."
            )
        limit = robot.drive.torque_limit if torque_limit is None else torque_limit
        friction = max(robot.friction.breakaway)
        if friction >= limit:
            raise InputError(
                f"The controller's torque limit is {limit:.3g} N m, and a wheel of {robot.name} breaks away under "
                f"{friction:.3g} N m: no wheel would turn, nor could one that is stuck be found. Design a controller "
                "with a higher torque limit."
            )
        friction = friction or min(UNKNOWN_FRICTION * robot.drive.torque_limit, _MOST_UNKNOWN * limit)
        mobility = np.abs(wheel_mobility(robot))
        own = mobility.diagonal()
        together = friction * float((mobility / own).sum(axis=0).max())
        turning = min(_ABOVE * together, friction + _REACHED * (limit - friction))
        # from one count into the next and back, under the least torque that counts
        acceleration = float(own.min()) * max(turning - together, _LEAST_SPARE * turning)
        count = encoder_step(robot)
        turned_round = 2.0 * math.sqrt(2.0 * count / acceleration)
        unchanged = max(_STUCK_TIME, _MARGIN * turned_round)
        return cls(
            lean=lean,
            max_interval=(cls.max_missing + 1.5) * sample_time,
            max_unchanged=max(3, math.ceil(unchanged / sample_time - 1e-9)),
            turning_torque=turning,
        )


#: longest time for which a sensor of a real robot may repeat itself [s]; an IMU of 100 Hz does so for 0.01 s
_STUCK_TIME = 0.1
#: part of the way from break-away to the controller's limit that the torque on a wheel that is stuck reaches
_REACHED = 0.75
#: ratio to the torque at which a sound wheel turns, for friction that the file does not have exactly; and the part of
#: the torque that moves it, at least. With 1.25 one wheel of 80 that stuck was not found in 10 s; with twice a wheel's
#: own break-away torque, 0.69 of the friction of all four, a sound one was called stuck
#: (`python -m campaigns.board_matrix --seed 68`)
_ABOVE, _LEAST_SPARE = 1.1, 0.1
#: ratio to the time in which a sound wheel turns round, for friction and inertia that the file does not have exactly
_MARGIN = 1.5
#: break-away torque of a wheel whose file states no friction, over its motor's limit; geared motors have 3 to 15 %
UNKNOWN_FRICTION = 0.15
#: most of a controller's torque limit that it can be: the robot balances with the rest
_MOST_UNKNOWN = 0.75


class SafeController:
    """A controller behind the safety layer; it is a controller itself. The robot gives the number of wheels."""

    def __init__(self, controller: Feedback, robot: Robot, limits: SafetyLimits = SafetyLimits()) -> None:
        self.controller = controller
        self.robot = robot
        self.limits = limits
        self.stop: Stop | None = None  #: why the torques are zero until `reset`
        self._missing = 0
        self._t: float | None = None

    @property
    def sample_time(self) -> float:
        """Time between two updates [s], the controller's."""
        return self.controller.sample_time

    @property
    def estimator(self) -> EstimatorName:
        """Name of the estimator that the controller is designed for."""
        return estimator_of(self.controller)

    def reset(self) -> None:
        """Clear the latched stop and the controller's memory."""
        self.stop, self._missing, self._t = None, 0, None
        self.controller.reset()

    def update(
        self, t: float, state: ArrayLike, reference: NDArray[np.float64], *, measured: bool = True
    ) -> NDArray[np.float64]:
        """Return the wheel torques (n,) [N m] that may go to the motors at t [s].

        The state (10,) is `measured`, or predicted by an estimator, NaN without one. InputError if it is not ten
        numbers, or the controller returns anything but n.
        """
        n = self.robot.wheel_count
        x = real_array(state, (10,), "The state", finite=False)
        known = bool((np.abs(x) <= LARGEST_STATE).all())
        if self.stop is None:
            self._check_sample(t, x, known=known, measured=measured)
        if self.stop is not None or not known:
            return np.zeros(n)
        answer = self.controller.update(t, x, reference)
        if np.shape(answer) != (n,):
            raise InputError(
                f"The controller returned torques of the shape {np.shape(answer)} at t = {t:g} s; the robot has {n} "
                "wheels."
            )
        torques = real_array(answer, (n,), "The array of the controller's torques", finite=False)
        if not np.isfinite(torques).all():
            wheel = int(np.flatnonzero(~np.isfinite(torques))[0])
            why = f"the controller's torque {torques[wheel]} on wheel {wheel + 1} is not a finite number"
            self._latch(StopReason.TORQUE, t, why)
            return np.zeros(n)
        return torques

    def _check_sample(self, t: float, x: NDArray[np.float64], *, known: bool, measured: bool) -> None:
        """Stop if a sample is late, one too many is missing, or the robot leans too far."""
        limits = self.limits
        interval = 0.0 if self._t is None else t - self._t
        self._t = t
        self._missing = 0 if measured and known else self._missing + 1
        lean = float(np.abs(x[2:4]).max())
        if not interval <= limits.max_interval:  # a NaN is late
            why = f"{interval:.3g} s since the last sample; at most {limits.max_interval:.3g} s are allowed"
            self._latch(StopReason.LATE, t, why)
        elif self._missing > limits.max_missing:
            bridged = limits.max_missing
            why = f"no valid measurement for {bridged + 1} samples; {bridged} are bridged"
            self._latch(StopReason.MISSING, t, why)
        elif known and lean > limits.lean:
            why = f"the lean is {lean:.3g} rad; the limit is {limits.lean:g} rad"
            self._latch(StopReason.LEAN, t, why)

    def _latch(self, reason: StopReason, t: float, why: str) -> None:
        self.stop = Stop(reason=reason, t=t, text=f"stopped at t = {t:.3f} s: {why}.")
