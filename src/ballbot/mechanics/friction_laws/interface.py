"""The interface of the friction laws: values, a steady curve, and three compiled functions.

A law may carry internal states (a bristle's deflection, a dwell time); at constant speed it settles on its steady
curve. Laws that can stick read the torque that is applied: at rest their friction balances it, up to a limit.
Each law has its own way to move an inertia (sticking, breaking away, stiff bristles), so the step of a driven inertia
belongs to the interface too.

In compiled code a law is a named tuple of its numbers, and its type chooses the functions (`register`). A law's
state is an array, empty where it has none, that these functions change in place.

`friction_at`, `advance` and `follow` evaluate a law by itself. The inertia that a law slows down obeys
J w_dot = T(u, w) - tau, where the drive's speed limit is a torque-speed curve, |T| up to T_stall (1 -+ w/w_0), or the
thesis's clamp (3.2) of the speed that friction and sensors see while the integrated one runs on; without a limit both
are far away. Laws share two ways to move it:

- Sliding one way (`slide`): friction is a smooth function of speed there, and RK4 has order four. For laws whose
  numbers name b, c, s, inv_vs and delta. Under a held torque the speed of one inertia is monotone, so within a step it
  passes zero at most once; `time_to_stop` finds when, to rounding.
- On bristles (`linear_motion`), however stiff they are:

      z_dot = rho (w - r z)          J w_dot = T - sigma_0 z - sigma_1 z_dot - b w          r >= 0, rho > 0

  r, the bristles' rate of relaxing, and rho depend on speed and deflection. With r, rho, sigma_1 and T frozen this is
  linear with two states, and its exponential is closed: exact before sliding (r = 0), stable for every step, because
  trace and determinant keep their signs. Frozen at the middle of the step, found by half a step frozen at its start,
  it has order two.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.arrays import positive_number, real_array, real_number
from ballbot.errors import InputError
from ballbot.mechanics.engine.compiled import by_types_of, compiled, inlined
from ballbot.mechanics.engine.elementary import exponential, sine_cosine
from ballbot.mechanics.friction import directed_friction


class FrictionLaw(Protocol):
    """A friction law's values. Speeds may be [rad/s] or [m/s]; torques are then [N m] or [N], and so on."""

    def numbers(self) -> tuple[object, ...]:
        """Return the named tuple that compiled code reads."""
        ...

    def initial_state(self, step: float) -> NDArray[np.float64]:
        """Return the state (m,) after a long rest without load, for time steps of `step` [s]."""
        ...

    def steady_friction(self, speed: ArrayLike) -> NDArray[np.float64]:
        """Return the friction [N m] at speeds (...) that have been constant for long; 0 at rest."""
        ...

    def explicit_slope(self) -> float:
        """Return the steepest slope [N m s/rad] of friction against speed that the law's step takes explicitly."""
        ...


def friction_of(
    law, state, speed, applied
) -> float:  # pragma: no cover (compiled forms come from `register`)
    """Return the friction; if the law sticks, it balances the torque `applied`, within the law's limit."""
    raise NotImplementedError("compiled code only")


def settle(law, state, before, after, h) -> None:  # pragma: no cover
    """Advance a law's state by h [s] while the speed goes from `before` to `after`; exact where they are equal."""
    raise NotImplementedError("compiled code only")


def move(law, inertia, torque, state, speed, h) -> tuple[float, float]:  # pragma: no cover
    """Advance an inertia under the law by h [s] with the torque held; return its speed and the angle travelled."""
    raise NotImplementedError("compiled code only")


def register(
    numbers: type,
    *,
    friction: Callable,
    settling: Callable,
    moving: Callable,
) -> None:
    """Make compiled functions those of the laws whose numbers are of that type.

    Parameters
    ----------
    numbers : type
        A named tuple.
    friction, settling, moving : callable
        Inlined functions with the arguments of `friction_of`, `settle` and `move`.
    """

    @by_types_of(friction_of)
    def _friction_of(law, state, speed, applied):
        if law.instance_class is numbers:
            return lambda law, state, speed, applied: friction(law, state, speed, applied)
        return None

    @by_types_of(settle)
    def _settle(law, state, before, after, h):
        if law.instance_class is numbers:
            return lambda law, state, before, after, h: settling(law, state, before, after, h)
        return None

    @by_types_of(move)
    def _move(law, inertia, torque, state, speed, h):
        if law.instance_class is numbers:
            return lambda law, inertia, torque, state, speed, h: moving(law, inertia, torque, state, speed, h)
        return None


def check_values(law: object, *, positive: Sequence[str], not_negative: Sequence[str]) -> None:
    """Raise InputError unless these attributes of a law are finite and above zero, or at least zero."""
    for name in (*positive, *not_negative):
        value = getattr(law, name)
        if not math.isfinite(value) or value < 0.0 or (value == 0.0 and name in positive):
            wanted = "above zero" if name in positive else "zero or more"
            raise InputError(
                f"{type(law).__name__}'s {name} is {value:g}; it must be a finite number, {wanted}."
            )


def friction_at(
    law: FrictionLaw, speed: float, *, state: ArrayLike | None = None, applied: float = 0.0
) -> float:
    """Return the friction [N m] at a speed [rad/s]; it acts against positive speeds where it is positive.

    Parameters
    ----------
    state : ndarray (m,), optional
        The law's internal state; after a long rest by default.
    applied : float
        The torque [N m] on the inertia. A law that sticks balances it up to its limit.

    Raises
    ------
    InputError
        If the state is not the law's, or a number is not finite.
    """
    state = law.initial_state(1.0) if state is None else _state_of(law, state)
    at, on = real_number(speed, "The speed"), real_number(applied, "The applied torque")
    return float(_friction_at(law.numbers(), state, at, on))


def advance(law: FrictionLaw, state: ArrayLike, *, speed: float, step: float) -> NDArray[np.float64]:
    """Return the law's state (m,) after `step` [s] at constant speed [rad/s], exactly.

    Raises
    ------
    InputError
        If the state (m,) is not the law's, a number is not finite, or the step is negative.
    """
    at, h = real_number(speed, "The speed"), real_number(step, "The step")
    if h < 0.0:
        raise InputError(f"The step is {h:g} s; it must not be negative.")
    return _advance(law.numbers(), _state_of(law, state), at, h)


def follow(
    law: FrictionLaw, speeds: ArrayLike, *, sample_time: float, applied: ArrayLike = 0.0
) -> NDArray[np.float64]:
    """Return the friction [N m] along a history of speeds, from a long rest.

    Parameters
    ----------
    speeds : array_like (N,)
        [rad/s]; between two samples the law takes their mean, which is of order two.
    sample_time : float
        [s]
    applied : array_like, () or (N,)
        Torque on the inertia [N m], read where the law sticks.

    Returns
    -------
    ndarray (N,)

    Raises
    ------
    InputError
        If the speeds are not a row of finite numbers, or the sample time is not above zero.
    """
    history = real_array(speeds, ("samples",), "The row of speeds")
    h = positive_number(sample_time, "The sample time")
    if np.ndim(applied) == 0:
        torques = np.full(len(history), real_number(applied, "The applied torque"))
    else:
        torques = real_array(applied, history.shape, "The row of applied torques")
    return _follow(law.numbers(), law.initial_state(h), history, torques, h)


def _state_of(law: FrictionLaw, state: ArrayLike) -> NDArray[np.float64]:
    return real_array(state, law.initial_state(1.0).shape, "The friction law's state")


@compiled
def _friction_at(law, state, speed, applied):
    return friction_of(law, state, speed, applied)


@compiled
def _advance(law, state, speed, h):
    end = state.copy()
    settle(law, end, speed, speed, h)
    return end


@compiled
def _follow(law, state, speeds, applied, h):
    out = np.empty(len(speeds))
    for k in range(len(speeds)):
        if k > 0:
            settle(law, state, speeds[k - 1], speeds[k], h)
        out[k] = friction_of(law, state, speeds[k], applied[k])
    return out


#: stands for "no limit"; finite, so that it stays a number when multiplied by zero
UNLIMITED = 1e200


class Inertia(NamedTuple):
    """A driven inertia, in compiled code."""

    inv_J: float  #: 1/J [1/(kg m^2)]
    clamp: float  #: l of (3.2) [rad/s]
    stall: float  #: torque available at rest [N m]
    inv_no_load: float  #: 1/w_0 [s/rad]


@inlined
def available(inertia, torque, speed):
    """Return the torque [N m] that the supply lets through at that speed."""
    lost = inertia.stall * (speed * inertia.inv_no_load)
    return min(max(torque, -inertia.stall - lost), inertia.stall - lost)


@inlined
def clamped(inertia, speed):
    """Return the speed within the thesis's clamp."""
    return min(max(speed, -inertia.clamp), inertia.clamp)


_MAX_ROOT_STEPS = 100
_EPS = 2.220446049250313e-16


@inlined
def crossing(function, context, low, high):
    """Return where function(x, context) is zero, between `low` and `high`, at which its signs differ.

    Ridders' method (C. Ridders, A new algorithm for computing a single root of a real continuous function, IEEE
    Transactions on Circuits and Systems 26, 1979): each step at least halves the bracket. Of the last bracket, the
    end is returned at which the function is smaller.
    """
    f_low, f_high = function(low, context), function(high, context)
    if f_low == 0.0:
        return low
    if f_high == 0.0:
        return high
    for _ in range(_MAX_ROOT_STEPS):
        middle = 0.5 * (low + high)
        f_middle = function(middle, context)
        if f_middle == 0.0:
            return middle
        root = (f_middle * f_middle - f_low * f_high) ** 0.5
        step = f_middle / root if root > 0.0 else 0.0  # the squares of values below 1e-162 are zero: halve
        x = middle + (middle - low) * (step if f_low > f_high else -step)
        f_x = function(x, context)
        if f_x == 0.0:
            return x
        if (f_middle > 0.0) != (f_x > 0.0):
            low, f_low, high, f_high = (
                (middle, f_middle, x, f_x) if middle < x else (x, f_x, middle, f_middle)
            )
        elif (f_low > 0.0) != (f_x > 0.0):
            high, f_high = x, f_x
        else:
            low, f_low = x, f_x
        if high - low <= 2.0 * _EPS * max(abs(low), abs(high)):
            break
    return low if abs(f_low) < abs(f_high) else high


@inlined
def _acceleration(law, inertia, torque, speed, direction):
    seen = clamped(inertia, speed)
    friction = law.b * seen + direction * directed_friction(law, seen, direction)
    return inertia.inv_J * (available(inertia, torque, speed) - friction)


@inlined
def slide(law, inertia, torque, speed, direction, h) -> tuple[float, float]:
    """Return speed and angle travelled after h [s] of sliding with friction against `direction` (1 or -1)."""
    half = 0.5 * h
    a1 = _acceleration(law, inertia, torque, speed, direction)
    w2 = speed + half * a1
    a2 = _acceleration(law, inertia, torque, w2, direction)
    w3 = speed + half * a2
    a3 = _acceleration(law, inertia, torque, w3, direction)
    w4 = speed + h * a3
    a4 = _acceleration(law, inertia, torque, w4, direction)
    middle = clamped(inertia, w2) + clamped(inertia, w3)
    travel = h / 6.0 * (clamped(inertia, speed) + 2.0 * middle + clamped(inertia, w4))
    return speed + h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4), travel


@inlined
def _speed_ahead(h, context):
    law, inertia, torque, speed, direction = context
    return direction * slide(law, inertia, torque, speed, direction, h)[0]


@inlined
def time_to_stop(law, inertia, torque, speed, direction, h):
    """Return when, within h [s], the speed in `direction` has fallen to zero, which it does by then."""
    return crossing(_speed_ahead, (law, inertia, torque, speed, direction), 0.0, h)


@inlined
def _propagator(m, d, h) -> tuple[float, float]:
    """Return C and S with exp(M h) = C I + S (M - m I), for a 2 x 2 M of half trace m < 0 and m^2 - det = d."""
    if d * h * h > 1e-6:
        q = d**0.5
        fast, slow = m - q, (m * m - d) / (m - q)  # both eigenvalues, without cancellation
        e_slow, e_fast = exponential(slow * h), exponential(fast * h)
        return 0.5 * (e_slow + e_fast), (e_slow - e_fast) / (2.0 * q)
    decay = exponential(m * h)
    if d * h * h < -1e-6:
        q = (-d) ** 0.5
        sine, cosine = sine_cosine(q * h)
        return decay * cosine, decay * sine / q
    x = d * h * h  # the series of cosh and sinh(..)/.., to rounding
    return decay * (1.0 + x * (0.5 + x / 24.0)), decay * h * (1.0 + x / 6.0 * (1.0 + x / 20.0))


class Bristles(NamedTuple):
    """A law's bristles and viscous damping in compiled code, with r, rho and sigma_1 frozen."""

    sigma_0: float  #: stiffness [N m/rad], above zero
    sigma_1: float  #: damping of their rate [N m s/rad]
    b: float  #: damping of the speed [N m s/rad]
    r: float  #: rate of relaxing [1/s]
    rho: float  #: bending per turn [-]


@inlined
def linear_motion(bristles, T, inv_J, z, w, h) -> tuple[float, float, float]:
    """Return z, w and the angle travelled after h [s], with the bristles and T frozen.

    Parameters
    ----------
    bristles : Bristles
    T : float
        [N m]
    inv_J : float
        [1/(kg m^2)]
    z, w : float
        [rad], [rad/s] at the start.
    """
    sigma_0, sigma_1, b, r, rho = bristles
    a, k, d = rho * r, inv_J * (sigma_0 - sigma_1 * rho * r), inv_J * (sigma_1 * rho + b)
    half_trace = -0.5 * (a + d)
    determinant = inv_J * rho * (sigma_0 + r * b)
    C, S = _propagator(half_trace, half_trace * half_trace - determinant, h)
    z_still = T / (sigma_0 + r * b)
    x, y = z - z_still, w - r * z_still
    z_end = z_still + C * x + S * ((-a - half_trace) * x + rho * y)
    w_end = r * z_still + C * y + S * (-k * x + (-d - half_trace) * y)
    # integrals of both equations over the step give the integrals of z and w
    change = z_end - z
    z_integral = (T * h - (w_end - w) / inv_J - (sigma_1 + b / rho) * change) / (sigma_0 + r * b)
    return z_end, w_end, change / rho + r * z_integral
