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

import numpy as np
from numpy.typing import NDArray

from ballbot.control.lqr import held
from ballbot.control.parts.part import MAX_PAST, LawSettings, Measured, Part
from ballbot.control.records import MAX_WHEELS, number, whole
from ballbot.errors import InputError
from ballbot.mechanics.engine.compiled import inlined
from ballbot.mechanics.equations import attitude
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
    """The predicted state, and the buffers in which it is computed."""

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


@inlined
def predict(law, memory, seen, n):
    """Return the state at which the torques will act, and make room for them in the history."""
    own = law.prediction
    if own.on == 0:
        return seen
    _look_ahead(own, memory.prediction, memory.history, seen.a, seen.state, n)
    _grow_older(memory.history, own.samples + 1)
    state = memory.prediction.ahead[:]  # a slice is an array of the same type as `seen.state`
    return Measured(attitude((state[2], state[3], state[4])), state)


@inlined
def _look_ahead(own, work, past, a, state, n):
    """Compute `work.ahead` (10,), the state at which the torque that is computed now will act."""
    turned, after = work.turned, work.after
    for i in range(10):
        turned[i] = state[i]
    _turn(turned, a.cos_psi, a.sin_psi)
    for i in range(10):
        after[i] = 0.0
        for j in range(10):
            after[i] += own.transition[i, j] * turned[j]
    for ago in range(own.count):
        for wheel in range(n):
            v = past.acting[ago, wheel] - past.friction_compensation[ago, wheel]
            v -= past.disturbance_compensation[ago, wheel]
            for i in range(10):
                after[i] += own.by_torque[wheel, ago, i] * v
    _turn(after, a.cos_psi, -a.sin_psi)
    for i in range(10):
        work.ahead[i] = after[i]


@inlined
def _turn(values, c, s):
    """Turn the pairs (x y), (theta phi) of a state and their rates by -psi, whose cosine and sine these are."""
    for i in (0, 2, 5, 7):
        x, y = values[i], values[i + 1]
        values[i] = c * x + s * y
        values[i + 1] = c * y - s * x


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
