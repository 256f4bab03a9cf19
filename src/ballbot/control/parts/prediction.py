"""Prediction over the delay: the LQR for a plant whose torques act late.

A torque computed from the state measured at t_k acts from t_k + tau on, with tau the delay of transport, filters and
computation. It cannot influence the motion before that, so the optimal law is the undelayed law applied to the state at
t_k + tau,

    u_k = K (r - x(t_k + tau)),     x(t_k + tau) = exp(A tau) x(t_k) + sum over j of G_j v_(k-j)

with G_j the effect until t_k + tau of the torque of j updates ago, which acts for a sample time from t_(k-j) + tau on:
exact for any tau. (For whole samples it is the gain that the Riccati equation of the state with the torques under way
gives.) A and B are those of the exact model without friction in the heading frame, and v are the acting torques less
what friction compensation and disturbance observer added, which the losses consume. The prediction is linear and
ignores other friction and the robot's turning meanwhile.
"""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ballbot.control.lqr import held
from ballbot.control.parts.part import (
    MAX_PAST,
    HeadingFrame,
    LawSettings,
    Part,
    RobotState,
    heading_frame_after,
    turned_state,
)
from ballbot.errors import InputError
from ballbot.mechanics.engine.compiled import inlined
from ballbot.records import MAX_WHEELS, number, whole
from ballbot.robot.parameters import parameter, parameter_class

#: most pending torques; the history also holds the sample before them and room for the new one
MAX_DELAY_SAMPLES = MAX_PAST - 2
#: fraction of a sample time by which rounding may lengthen a delay of whole samples
_ROUNDING = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class PredictionRecord:
    """The numbers of the prediction, heading frame."""

    on: int = field(default=1, metadata=whole())
    #: m, the number of pending torques
    count: int = field(metadata=whole())
    #: whole samples of the delay, and the fraction of another one
    samples: int = field(metadata=whole())
    fraction: float = field(metadata=number("1"))
    #: exp(A tau)
    transition: NDArray[np.float64] = field(metadata=number("1", 10, 10))
    #: G_j for the torques of each wheel 1, 2 .. m updates ago
    by_torque: NDArray[np.float64] = field(metadata=number("1/(N m)", MAX_WHEELS, MAX_DELAY_SAMPLES, 10))


@dataclass(frozen=True, kw_only=True, eq=False)
class PredictionState:
    """The predicted state, relative to the measured pose, and the buffers in which it is computed."""

    ahead: NDArray[np.float64] = field(metadata=number("1", 10))
    turned: NDArray[np.float64] = field(metadata=number("1", 10))
    after: NDArray[np.float64] = field(metadata=number("1", 10))


def _updates_within(delay: float, sample_time: float) -> int:
    """Return the number of pending torques."""
    count = max(1, math.ceil(min(delay / sample_time, 2.0 * MAX_DELAY_SAMPLES) - _ROUNDING))
    if count > MAX_DELAY_SAMPLES:
        raise InputError(
            f"The delay to predict over is {delay:g} s; with a sample time of {sample_time:g} s it can be at most "
            f"{MAX_DELAY_SAMPLES * sample_time:g} s."
        )
    return count


def _effect(
    A: NDArray[np.float64], B: NDArray[np.float64], ago: float, sample_time: float, delay: float
) -> NDArray[np.float64]:
    """Return the effect (10, n) on the state from now until `delay` from now of a torque commanded `ago` [s]."""
    first, last = max(0.0, delay - ago), delay - ago + sample_time  # it acts in between
    still = held(A, B, last - first)[1]
    after = delay - last
    return still if after <= 0.0 else held(A, B, after)[0] @ still


class Predicted(NamedTuple):
    """The state that is fed back, relative to the measured pose, and its heading frame."""

    a: HeadingFrame
    state: RobotState


@inlined
def predict(law, memory, a, seen, n):
    """Return the state at which the torques will act, and make room for them in the history."""
    own, work = law.prediction, memory.prediction
    if own.on == 0:
        return Predicted(a, seen)
    before = turned_state(a, seen)
    _fill(work.turned, before)
    _change_until(own, memory.history, work.turned, work.after, n)
    # the change is small, and so is its rounding
    back, change = HeadingFrame(-a.sin_psi, a.cos_psi), _state_of(work.after)
    change_in_world = turned_state(back, change)
    _fill(work.turned, change_in_world)
    _fill(work.ahead, seen)
    for i in range(10):
        work.ahead[i] += work.turned[i]
    _grow_older(memory.history, own.samples + 1)
    return Predicted(heading_frame_after(a, work.ahead[4]), _state_of(work.ahead))


@inlined
def _change_until(own, past, turned_numbers, change, n):
    """Compute by how much the state changes until the torque that is computed now will act, heading frame."""
    for i in range(10):
        change[i] = 0.0
        for j in range(10):
            by_state = own.transition[i, j] - 1.0 if i == j else own.transition[i, j]
            change[i] += by_state * turned_numbers[j]
    for ago in range(own.count):
        for wheel in range(n):
            added = past.friction_compensation[ago, wheel] + past.disturbance_compensation[ago, wheel]
            v = past.acting[ago, wheel] - added
            for i in range(10):
                change[i] += own.by_torque[wheel, ago, i] * v


@inlined
def _fill(numbers, state):
    """Fill ten numbers with a state."""
    numbers[0], numbers[1], numbers[2], numbers[3] = state.x, state.y, state.theta, state.phi
    numbers[4], numbers[5], numbers[6], numbers[7] = state.psi, state.x_dot, state.y_dot, state.theta_dot
    numbers[8], numbers[9] = state.phi_dot, state.psi_dot


@inlined
def _state_of(v):
    """Return ten numbers as a state."""
    return RobotState(v[0], v[1], v[2], v[3], v[4], v[5], v[6], v[7], v[8], v[9])


@inlined
def _grow_older(past, updates):
    """Make room for another update, the last `updates` kept."""
    for ago in range(updates, 0, -1):
        for i in range(MAX_WHEELS):
            past.acting[ago, i] = past.acting[ago - 1, i]
            past.friction_compensation[ago, i] = past.friction_compensation[ago - 1, i]
            past.disturbance_compensation[ago, i] = past.disturbance_compensation[ago - 1, i]
            past.limited[ago, i] = past.limited[ago - 1, i]


@inlined
def over_last_sample(own, values, wheel):
    """Return a number of the torque history for the torques that acted over the last sample, their mean in time.

    `own` is a `PredictionRecord`; without a prediction these are the torques of the last update.
    """
    last = values[own.samples, wheel]
    if own.fraction == 0.0:
        return last
    return (1.0 - own.fraction) * last + own.fraction * values[own.samples + 1, wheel]


@parameter_class
class DelayPrediction(Part):
    """Feed back the state that the robot will have when a late torque acts.

    Replaces the state (10,), heading frame, by the one of the exact model without friction after `delay`, from the
    pending torques (n,) [N m]. It helps from a delay of about 30 ms on; `ballbot identify --estimate
    delays` finds the delay.

    InputError if the delay is not positive; when the controller is made, if it exceeds the torque history.
    """

    label = "prediction"
    comment = "Torques act late; the state fed back is the one predicted for when they act."
    record = PredictionRecord
    state = PredictionState

    delay: float = parameter("from a measurement to the action of its torque", "s")

    def numbers(self, settings: LawSettings) -> PredictionRecord:
        """Return the prediction for the robot."""
        A, B, sample_time = settings.linear.A, settings.linear.B, settings.sample_time
        count = _updates_within(self.delay, sample_time)
        effects = [_effect(A, B, ago * sample_time, sample_time, self.delay) for ago in range(1, count + 1)]
        samples = self.delay / sample_time
        complete = math.floor(samples + _ROUNDING)
        return PredictionRecord(
            count=count,
            samples=complete,
            fraction=max(0.0, samples - complete),
            transition=held(A, B, self.delay)[0],
            by_torque=np.array(effects).transpose(2, 0, 1),
        )
