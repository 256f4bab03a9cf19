"""Prediction over the delay: the LQR for a plant whose torques act late.

A torque computed from the state measured at t_k acts from t_k + tau on, tau the time of transport, filters and
computation together. What is computed cannot change what happens before, so the optimal law is the undelayed one at
the state that the robot will then be in,

    u_k = K (r - x(t_k + tau)),     x(t_k + tau) = exp(A tau) x(t_k) + sum over j of G_j v_(k-j)

with G_j what the torque of j updates ago still does until t_k + tau, held from its own t_(k-j) + tau on for a
sample time: exact for any tau. (For whole samples it is the gain that the Riccati equation of the state with the
torques under way gives.) A and B are those of the exact model without friction in the heading frame, and v the
acting torques less what friction compensation and disturbance observer added: the losses take that. The prediction is
linear: what friction beyond that and a turn of the robot do meanwhile is not foreseen.
"""

from __future__ import annotations

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

#: torques that may be under way; the past must have the sample before them as well, and room for one
MAX_DELAY_SAMPLES = MAX_PAST - 2
#: of a sample time, by which rounding may make a delay of whole samples longer
_ROUNDING = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class PredictionRecord:
    """What is known of the state at which a torque will act, heading frame."""

    on: int = field(default=1, metadata=whole())
    #: m, how many torques are under way
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
    """The state to come, and what it is made in."""

    ahead: NDArray[np.float64] = field(metadata=number("1", 10))
    turned: NDArray[np.float64] = field(metadata=number("1", 10))
    after: NDArray[np.float64] = field(metadata=number("1", 10))


def _updates_within(delay: float, sample_time: float) -> int:
    """Return how many updates' torques are under way."""
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
    """Return what a torque given `ago` [s] does to the state from now on until `delay` from now (10, n)."""
    first, last = max(0.0, delay - ago), delay - ago + sample_time  # it acts in between
    still = held(A, B, last - first)[1]
    after = delay - last
    return still if after <= 0.0 else held(A, B, after)[0] @ still


@inlined
def predict(law, memory, seen, n):
    """Return the state in which the torques will act, and make room for them in the history."""
    own = law.prediction
    if own.on == 0:
        return seen
    _look_ahead(own, memory.prediction, memory.history, seen.a, seen.state, n)
    _grow_older(memory.history, own.samples + 1)
    state = memory.prediction.ahead[:]  # a slice is an array of the same type as `seen.state`
    return Measured(attitude((state[2], state[3], state[4])), state)


@inlined
def _look_ahead(own, work, past, a, state, n):
    """Compute the state (10,) in which the torque that is computed now will act, `work.ahead`."""
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
        one, other = values[i], values[i + 1]
        values[i] = c * one + s * other
        values[i + 1] = c * other - s * one


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
    torques (n,) [N m] that are still under way. It helps from a delay of about 30 ms on; `ballbot identify --estimate
    delays` finds the delay.

    InputError if the delay is not positive; when the controller is made, if it is longer than the samples that are
    kept.
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
