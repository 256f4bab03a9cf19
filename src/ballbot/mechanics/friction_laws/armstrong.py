"""Armstrong's law with seven parameters: rising static friction and frictional memory.

    at rest:  tau = k_t x                        until |tau| = c + s(t_2),  x the turn since rest began
    sliding:  tau = (c + b |w| + s / (1 + (w(t - tau_L)/v_s)^2)) sgn(w)
    s(t_2) = s_a + (s_inf - s_a) t_2 / (t_2 + gamma)      t_2 the time at rest, s_a the Stribeck part as it stopped

B. Armstrong-Helouvry, P. Dupont and C. Canudas de Wit, A survey of models, analysis tools and compensation methods
for the control of machines with friction, Automatica 30, 1994. Choices that the survey leaves open: sliding
ends where the speed passes zero, and x starts from zero there, so that no energy comes from nothing; s keeps its
value of break-away while sliding; the rest may be damped (d, zero in the survey, where an inertia on the spring
swings for ever).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.errors import InputError
from ballbot.mechanics.engine.compiled import inlined
from ballbot.mechanics.friction import sign
from ballbot.mechanics.friction_laws.interface import (
    Bristles,
    available,
    check_values,
    crossing,
    linear_motion,
    register,
)

# Places in the state; the speeds at the last ends of steps follow, in a ring
_DIRECTION, _TURN, _DWELL, _LEVEL, _STEP, _NEWEST, _RING = 0, 1, 2, 3, 4, 5, 6

_LONGEST_MEMORY = 100_000  # steps


class ArmstrongNumbers(NamedTuple):
    """Armstrong's law in compiled code."""

    b: float
    c: float
    s: float
    inv_vs: float
    k_t: float
    d: float
    tau_L: float
    gamma: float


@dataclass(frozen=True, kw_only=True)
class Armstrong:
    """A spring at rest; sliding with Stribeck friction that lags behind the speed and grows with the time at rest.

    Its state (6 + memory,): direction of sliding or 0, turn since rest began [rad], time at rest [s], Stribeck
    part [N m], step [s], place of the newest of the speeds [rad/s] that follow.

    Raises
    ------
    InputError
        If a value is negative or not finite, or one that divides is zero.
    """

    viscous: float  #: b, the survey's F_v [N m s/rad]
    coulomb: float  #: c, F_C [N m]
    stribeck: float  #: s_inf, F_S,inf [N m], the Stribeck part after a long rest
    stribeck_speed: float  #: v_s [rad/s]
    stiffness: float  #: k_t [N m/rad]
    memory: float = 0.0  #: tau_L [s], by which the Stribeck part lags behind the speed
    rise_time: float = 0.0  #: gamma [s], after which half of the static friction has come back
    rest_damping: float = 0.0  #: d [N m s/rad], beside the spring; not in the survey

    def __post_init__(self) -> None:
        check_values(
            self,
            positive=("stribeck_speed", "stiffness"),
            not_negative=("viscous", "coulomb", "stribeck", "memory", "rise_time", "rest_damping"),
        )

    def numbers(self) -> ArmstrongNumbers:
        """Return the law's numbers for compiled code."""
        return ArmstrongNumbers(
            b=self.viscous,
            c=self.coulomb,
            s=self.stribeck,
            inv_vs=1.0 / self.stribeck_speed,
            k_t=self.stiffness,
            d=self.rest_damping,
            tau_L=self.memory,
            gamma=self.rise_time,
        )

    def initial_state(self, step: float) -> NDArray[np.float64]:
        """Return the state at rest, static friction fully risen, with room for the speeds of the memory.

        Raises
        ------
        InputError
            If the step is so short that the memory holds over a hundred thousand of them.
        """
        remembered = math.ceil(self.memory / step) + 2
        if remembered > _LONGEST_MEMORY:
            raise InputError(
                f"Armstrong's memory of {self.memory:g} s spans {remembered} steps of {step:g} s, which is too "
                "many; use a longer step."
            )
        state = np.zeros(_RING + remembered)
        state[_LEVEL], state[_STEP] = self.stribeck, step
        return state

    def steady_friction(self, speed: ArrayLike) -> NDArray[np.float64]:
        """Return the friction [N m] of long sliding, after a long rest, at speeds (...); 0 at rest."""
        w = np.asarray(speed, dtype=float)
        part = self.stribeck / (1.0 + (w / self.stribeck_speed) ** 2)
        return self.viscous * w + (self.coulomb + part) * np.sign(w)

    def explicit_slope(self) -> float:
        """Return a bound [N m s/rad] of the slope while sliding."""
        return self.viscous + self.stribeck / self.stribeck_speed


@inlined
def _stribeck_part(law, state, speed):
    ratio = speed * law.inv_vs
    return state[_LEVEL] / (1.0 + ratio * ratio)


@inlined
def _risen(law, state, dwell):
    """Return s(t_2)."""
    share = dwell / (dwell + law.gamma) if dwell > 0.0 else 0.0
    return state[_LEVEL] + (law.s - state[_LEVEL]) * share


@inlined
def _past_speed(state, steps):
    """Return the speed so many steps (not negative, not whole) before the newest one that is remembered."""
    count = len(state) - _RING
    whole = min(int(steps), count - 1)
    newest = int(state[_NEWEST])
    near = state[_RING + (newest - whole) % count]
    far = state[_RING + (newest - min(whole + 1, count - 1)) % count]
    return near + (far - near) * (steps - whole)


@inlined
def _lagging_speed(law, state, speed, since):
    """Return w(t - tau_L), where w(t) is `speed` and t is `since` [s] after the newest speed that is remembered."""
    back = law.tau_L - since
    if back >= 0.0:
        return _past_speed(state, back / state[_STEP])
    newest = _past_speed(state, 0.0)
    return newest + (speed - newest) * (-back / since)


@inlined
def _remember(state, speed):
    count = len(state) - _RING
    newest = (int(state[_NEWEST]) + 1) % count
    state[_NEWEST] = newest
    state[_RING + newest] = speed


@inlined
def _come_to_rest(law, state, lagging):
    state[_LEVEL] = _stribeck_part(law, state, lagging)
    state[_DIRECTION] = state[_TURN] = state[_DWELL] = 0.0


@inlined
def _break_away(law, state):
    state[_LEVEL] = _risen(law, state, state[_DWELL])
    state[_DIRECTION] = sign(state[_TURN])


@inlined
def _sliding_friction(law, state, speed, since):
    part = _stribeck_part(law, state, _lagging_speed(law, state, speed, since))
    return law.b * speed + state[_DIRECTION] * (law.c + part)


@inlined
def _friction(law, state, speed, applied):
    if state[_DIRECTION] == 0.0:
        return law.k_t * state[_TURN] + law.d * speed
    return _sliding_friction(law, state, speed, 0.0)


@inlined
def _settle(law, state, before, after, h):
    speed = 0.5 * (before + after)
    if state[_DIRECTION] * after <= 0.0 and state[_DIRECTION] != 0.0:
        _come_to_rest(law, state, _lagging_speed(law, state, after, h))
    if state[_DIRECTION] == 0.0:
        state[_TURN] += speed * h
        state[_DWELL] += h
        if law.k_t * abs(state[_TURN]) >= law.c + _risen(law, state, state[_DWELL]):
            _break_away(law, state)
    _remember(state, after)


@inlined
def _slide(law, inertia, torque, state, speed, since, h) -> tuple[float, float]:
    """Return speed and travel after h of sliding by RK4, which starts `since` [s] after the newest remembered speed."""
    half, inv_J = 0.5 * h, inertia.inv_J
    a1 = inv_J * (available(inertia, torque, speed) - _sliding_friction(law, state, speed, since))
    w2 = speed + half * a1
    a2 = inv_J * (available(inertia, torque, w2) - _sliding_friction(law, state, w2, since + half))
    w3 = speed + half * a2
    a3 = inv_J * (available(inertia, torque, w3) - _sliding_friction(law, state, w3, since + half))
    w4 = speed + h * a3
    a4 = inv_J * (available(inertia, torque, w4) - _sliding_friction(law, state, w4, since + h))
    return speed + h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4), h / 6.0 * (speed + 2.0 * (w2 + w3) + w4)


@inlined
def _forward_speed(h, context):
    law, inertia, torque, state, speed, since = context
    return state[_DIRECTION] * _slide(law, inertia, torque, state, speed, since, h)[0]


@inlined
def _swing(law, inertia, torque, state, speed, h) -> tuple[float, float, float]:
    """Return turn, speed and travel after h of rest on the spring."""
    spring, T = Bristles(law.k_t, 0.0, law.d, 0.0, 1.0), available(inertia, torque, speed)
    return linear_motion(spring, T, inertia.inv_J, state[_TURN], speed, h)


@inlined
def _held(h, context):
    """Return how far the spring is from break-away after h of rest."""
    law, inertia, torque, state, speed = context
    turn, _, _ = _swing(law, inertia, torque, state, speed, h)
    return law.c + _risen(law, state, state[_DWELL] + h) - law.k_t * abs(turn)


@inlined
def _slide_on(law, inertia, torque, state, speed, since, h) -> tuple[float, float, float]:
    """Slide for h, or until the speed passes zero; return speed, travel and the time taken."""
    end, travel = _slide(law, inertia, torque, state, speed, since, h)
    if state[_DIRECTION] * end > 0.0 or speed == 0.0:
        return end, travel, h
    stop = crossing(_forward_speed, (law, inertia, torque, state, speed, since), 0.0, h)
    _, travel = _slide(law, inertia, torque, state, speed, since, stop)
    _come_to_rest(law, state, _lagging_speed(law, state, 0.0, since + stop))
    return 0.0, travel, stop


@inlined
def _rest_on(law, inertia, torque, state, speed, h) -> tuple[float, float, float]:
    """Rest for h, or until break-away; return speed, travel and the time taken."""
    quarter_swing = 1.5707963267948966 / (law.k_t * inertia.inv_J) ** 0.5
    time = min(
        h, 0.5 * quarter_swing
    )  # short enough that the spring's force cannot pass the limit and return
    context = (law, inertia, torque, state, speed)
    breaks = _held(time, context) <= 0.0
    if breaks and _held(0.0, context) > 0.0:
        time = crossing(_held, context, 0.0, time)
    turn, end, travel = _swing(law, inertia, torque, state, speed, time)
    state[_TURN] = turn
    state[_DWELL] += time
    if breaks:
        _break_away(law, state)
    return end, travel, time


@inlined
def _move(law, inertia, torque, state, speed, h):
    since = travel = 0.0
    while since < h * (1.0 - 1e-15):  # every turn takes time: a spring must load before it breaks away
        if state[_DIRECTION] != 0.0:
            speed, part, time = _slide_on(law, inertia, torque, state, speed, since, h - since)
        else:
            speed, part, time = _rest_on(law, inertia, torque, state, speed, h - since)
        travel += part
        since += time
    _remember(state, speed)
    return speed, travel


register(ArmstrongNumbers, friction=_friction, settling=_settle, moving=_move)
