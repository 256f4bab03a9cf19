"""A disturbance observer: it estimates the torque lost to any cause and adds it, without a friction model.

    d' = w (lost - d),      u += d      d within its limit

By the linearised exact model without friction, x' = A x + B u in the heading frame, the change of the rates over a
sample needed the torques B^+ (x' - A x). B^+ is the least-squares left inverse: three torques cannot match the changes
of five rates, and these minimise the sum of squares, in which m/s^2 and rad/s^2 have the same weight. The excess of the
motors' torques was lost to friction, a slope or a push. Four wheels can push against each other without moving the
robot; the motion does not show such torques, so they are left out of d. Unlike friction compensation the observer needs
no friction model and also corrects slope and payload, but with a lag of 1/w, and it passes the sensors' noise on.
Beside a compensation it adds the remainder.
"""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import null_space

from ballbot.control.parts.part import LawSettings, Part, clipped, turned
from ballbot.control.parts.prediction import over_last_sample
from ballbot.mechanics.engine.compiled import inlined
from ballbot.records import MAX_WHEELS, number, whole
from ballbot.robot.parameters import parameter, parameter_class

#: effect of torques, over the largest, that counts as none
_IDLE = 1e-9


def idle_torques(B: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return torques (n, 1 or 0) of length 1 that move nothing, by the input matrix (10, n): four wheels have one."""
    return np.asarray(null_space(B, rcond=_IDLE), dtype=np.float64)


@dataclass(frozen=True, kw_only=True, eq=False)
class ObserverRecord:
    """The sampled observer, and the torques that a motion needs, heading frame."""

    on: int = field(default=1, metadata=whole())
    #: fraction of the difference that d changes by in a sample
    fraction: float = field(metadata=number("1"))
    limit: float = field(metadata=number("N m"))
    #: B^+ for the change of the rates
    by_acceleration: NDArray[np.float64] = field(metadata=number("N m s^2/m", MAX_WHEELS, 5))
    #: -B^+ A for theta, phi
    by_lean: NDArray[np.float64] = field(metadata=number("N m/rad", MAX_WHEELS, 2))
    #: torques of length 1 that move nothing; zero for three wheels
    idle: NDArray[np.float64] = field(metadata=number("1", MAX_WHEELS))


@dataclass(frozen=True, kw_only=True, eq=False)
class ObserverState:
    """The rates of the last sample, whether they are known, and d, the estimate that is added."""

    rates: NDArray[np.float64] = field(metadata=number("m/s", 5))
    started: int = field(metadata=whole())
    estimate: NDArray[np.float64] = field(metadata=number("N m", MAX_WHEELS))


class _Changes(NamedTuple):
    """The rates' change, heading frame."""

    x: float  # [m/s^2]
    y: float
    theta: float  # [rad/s^2]
    phi: float
    psi: float


@inlined
def observe(law, memory, a, seen, n):
    """Estimate the torque lost in the sample that has passed, and step the torque added."""
    own, state = law.disturbance_observer, memory.disturbance_observer
    if own.on == 0:
        return
    if state.started > 0:
        _step_estimates(law, memory, a, seen, n)
    state.rates[0], state.rates[1], state.rates[2] = seen.x_dot, seen.y_dot, seen.theta_dot
    state.rates[3], state.rates[4] = seen.phi_dot, seen.psi_dot
    state.started = 1


@inlined
def _step_estimates(law, memory, a, seen, n):
    """Step the estimate of each wheel."""
    own, past, found = law.disturbance_observer, memory.history, memory.disturbance_observer.estimate
    changes = _rate_changes(a, memory.disturbance_observer.rates, seen, law.rate)
    lean = turned(a, seen.theta, seen.phi)
    for i in range(n):
        if over_last_sample(law.prediction, past.limited, i) > 0.0:
            continue  # a sample at the limit does not determine the lost torque
        lost = over_last_sample(law.prediction, past.acting, i) - _needed(own, i, changes, lean)
        compensated = over_last_sample(law.prediction, past.friction_compensation, i)
        found[i] += own.fraction * (lost - compensated - found[i])
    idle = 0.0
    for i in range(n):
        idle += own.idle[i] * found[i]
    for i in range(n):
        found[i] = clipped(found[i] - idle * own.idle[i], own.limit)


@inlined
def _rate_changes(a, rates, seen, rate):
    """Return the rates' change since the last sample; `rate` is samples a second."""
    speed = turned(a, rate * (seen.x_dot - rates[0]), rate * (seen.y_dot - rates[1]))
    lean = turned(a, rate * (seen.theta_dot - rates[2]), rate * (seen.phi_dot - rates[3]))
    return _Changes(speed.x, speed.y, lean.x, lean.y, rate * (seen.psi_dot - rates[4]))


@inlined
def _needed(own, i, changes, lean):
    """Return a wheel's torque for those changes at that lean."""
    row, by_lean = own.by_acceleration[i], own.by_lean[i]
    for_speed = row[0] * changes.x + row[1] * changes.y
    for_lean = row[2] * changes.theta + row[3] * changes.phi + row[4] * changes.psi
    return for_speed + for_lean + by_lean[0] * lean.x + by_lean[1] * lean.y


@inlined
def add_estimate(memory, torque, i):
    """Return a wheel's torque with the lost one, which is recorded in the history; zero without an observer."""
    estimate = memory.disturbance_observer.estimate[i]
    memory.history.disturbance_compensation[0, i] += estimate
    return torque + estimate


@parameter_class
class DisturbanceObserver(Part):
    """Estimate the torque that is lost to friction, a slope or a push, and add it; no friction model is needed.

    Compares the torques (n,) [N m] of the last sample with those that the change of the five rates [m/s, rad/s] needed
    by the exact model without friction, heading frame. The difference of each wheel passes a lag of `frequency`, is
    bounded by `limit`, and is added to the torques.

    InputError if a number is not positive.
    """

    label = "disturbance observer"
    comment = "The torque that is lost is estimated and added."
    record = ObserverRecord
    state = ObserverState

    frequency: float = parameter("w of the lag", "rad/s", default=10.0)
    limit: float = parameter("largest torque added to a wheel", "N m")

    def numbers(self, settings: LawSettings) -> ObserverRecord:
        """Return the sampled observer for the robot."""
        B = settings.linear.B
        back, idle = np.asarray(np.linalg.pinv(B), dtype=np.float64), idle_torques(B)
        return ObserverRecord(
            fraction=-math.expm1(-self.frequency * settings.sample_time),
            limit=self.limit,
            by_acceleration=back[:, 5:],
            by_lean=-(back @ settings.linear.A)[:, 2:4],
            idle=idle[:, 0] if idle.size else np.zeros(settings.robot.wheel_count),
        )
