"""Prediction over the delay: the LQR for a plant whose torques act late.

A torque computed from the state measured at t_k acts from t_k + tau on, tau the time of transport, filters and
computation together. What is computed cannot change what happens before, so the optimal law is the undelayed one at
the state that the robot will then be in,

    u_k = K (r - x(t_k + tau)),     x(t_k + tau) = exp(A tau) x(t_k) + sum over j of G_j v_(k-j)

with G_j what the torque of j updates ago still does until t_k + tau, held from its own t_(k-j) + tau on for a
sample time: exact for any tau. (For whole samples it is the gain that the Riccati equation of the state with the
torques under way gives.) A and B are those of the exact model without friction in the heading frame, and v the
torques without what compensation and observer add, which friction takes. It is linear: what friction beyond that and a
turn of the robot do meanwhile is not foreseen.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ballbot.arrays import real_array
from ballbot.control.lqr import held
from ballbot.control.parts.past import EFFECTIVE, MAX_PAST, past
from ballbot.errors import InputError
from ballbot.mechanics.engine.compiled import called, inlined
from ballbot.mechanics.model import Model
from ballbot.robot import Friction, Robot

#: torques that may be under way; the past must tell of the sample before them as well, and make room for one
_MOST = MAX_PAST - 2
#: of a sample time, by which rounding may make a delay of whole samples longer
_ROUNDING = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class DelayPrediction:
    """What is known of the state at which a torque will act, heading frame.

    Raises
    ------
    InputError
        If a time is not above zero, the delay is longer than the torques that a controller remembers, or an array has
        another shape or a value that is not finite.
    """

    delay: float  #: tau [s]
    sample_time: float  #: of the controller [s]
    transition: NDArray[np.float64]  #: exp(A tau) (10, 10)
    by_torque: NDArray[np.float64]  #: G_j (m, 10, n) for the torques of 1, 2 .. m updates ago [1/(N m)]

    def __post_init__(self) -> None:
        count = _updates_within(self.delay, self.sample_time)
        arrays = {"transition": (10, 10), "by_torque": (count, 10, "n")}
        for name, shape in arrays.items():
            checked = real_array(getattr(self, name), shape, f"{name} of a prediction")
            object.__setattr__(self, name, checked)

    @staticmethod
    def of(robot: Robot, *, delay: float, sample_time: float | None = None) -> DelayPrediction:
        """Return that of a robot's exact model without friction, linearised about upright.

        Parameters
        ----------
        robot : Robot
        delay : float
            From a measurement to the action of the torque computed from it [s].
        sample_time : float, optional
            [s]; the robot's own where not given.

        Raises
        ------
        InputError
            Where the delay is not positive, or longer than the torques that a controller remembers.
        """
        time = robot.sensors.sample_time if sample_time is None else sample_time
        count = _updates_within(delay, time)
        linear = Model(robot.replace(friction=Friction.none(robot.wheel_count))).linearize()
        A, B = np.asarray(linear.A), np.asarray(linear.B)
        return DelayPrediction(
            delay=delay,
            sample_time=time,
            transition=held(A, B, delay)[0],
            by_torque=np.array([_effect(A, B, ago * time, time, delay) for ago in range(1, count + 1)]),
        )


def _updates_within(delay: float, sample_time: float) -> int:
    """Return how many updates' torques are under way."""
    if not (math.isfinite(delay) and delay > 0.0):
        raise InputError(f"The delay to predict over is {delay:g} s; it must be positive.")
    if not (math.isfinite(sample_time) and sample_time > 0.0):
        raise InputError(f"The sample time to predict with is {sample_time:g} s; it must be positive.")
    count = max(1, math.ceil(min(delay / sample_time, 2.0 * _MOST) - _ROUNDING))
    if count > _MOST:
        raise InputError(
            f"The delay to predict over is {delay:g} s; with a sample time of {sample_time:g} s it can be at most "
            f"{_MOST * sample_time:g} s."
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


#: numbers that `pack_prediction` returns for all wheels together, and for each
PREDICTION_SIZE, PREDICTION_PER_WHEEL = 3 + 100, 10 * _MOST
# places in a row: m, how many torques are under way; whole samples and the share of another one that tau is
_COUNT, _WHOLE, _SHARE, _TRANSITION = 0, 1, 2, 3


def pack_prediction(
    prediction: DelayPrediction | None, wheel_count: int
) -> tuple[list[float], NDArray[np.float64]]:
    """Return what the wheels share (103,) and each wheel's effects (n, 200); all zero where nothing is predicted."""
    own = np.zeros((wheel_count, PREDICTION_PER_WHEEL))
    if prediction is None:
        return [0.0] * PREDICTION_SIZE, own
    count = len(prediction.by_torque)
    own[:, : 10 * count] = prediction.by_torque.transpose(2, 0, 1).reshape(wheel_count, -1)
    samples = prediction.delay / prediction.sample_time
    whole = math.floor(samples + _ROUNDING)
    share = max(0.0, samples - whole)
    return [float(count), float(whole), share, *prediction.transition.ravel().tolist()], own


#: numbers that `predict` works in: the state to come first (10,)
PREDICTION_MEMORY = 30


@called
def predict(row, place, own, step, memory, first, ahead, a, state, n):
    """Put the state (10,) in which the torque that is computed now will act into the memory, at `ahead`.

    Each wheel's numbers stand `step` after those of the wheel before, the first's at `own`; the past is at `first`.
    """
    turned, after = ahead + 10, ahead + 20
    for i in range(10):
        memory[turned + i] = state[i]
    _turn(memory, turned, a.cos_psi, a.sin_psi)
    for i in range(10):
        memory[after + i] = 0.0
        for j in range(10):
            memory[after + i] += row[place + _TRANSITION + 10 * i + j] * memory[turned + j]
    for ago in range(int(row[place + _COUNT])):
        for wheel in range(n):
            v = memory[past(first, ago, EFFECTIVE, wheel)]
            effect = own + step * wheel + 10 * ago
            for i in range(10):
                memory[after + i] += row[effect + i] * v
    _turn(memory, after, a.cos_psi, -a.sin_psi)
    for i in range(10):
        memory[ahead + i] = memory[after + i]


@called
def _turn(memory, first, c, s):
    """Turn the pairs (x y), (theta phi) of a state and their rates by -psi, whose cosine and sine these are."""
    for i in (0, 2, 5, 7):
        one, other = memory[first + i], memory[first + i + 1]
        memory[first + i] = c * one + s * other
        memory[first + i + 1] = c * other - s * one


@inlined
def remembered(row, place):
    """Return how many updates must be remembered besides the last one."""
    return int(row[place + _WHOLE]) + 1


@inlined
def as_it_acted(row, place, memory, first, kind, wheel):
    """Return one kind of the past as it was on the way to the motors while the last sample passed."""
    whole, share = int(row[place + _WHOLE]), row[place + _SHARE]
    last = memory[past(first, whole, kind, wheel)]
    return (
        last if share == 0.0 else (1.0 - share) * last + share * memory[past(first, whole + 1, kind, wheel)]
    )
