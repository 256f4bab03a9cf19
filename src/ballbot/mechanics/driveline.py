"""The motion of one driveline: an inertia under a motor's torque and its wheel's friction, set-valued at rest.

`move` turns an inertia, J w_dot = T(u, w) - tau, where the drive's speed limit is a torque-speed curve, |T| up to
T_stall (1 -+ w/w_0); without a limit it is far away. A step is RK4 of known sign; where the speed reaches zero within
it, which under a held torque it does at most once, the moment is found to rounding, and from there the inertia rests
exactly or leaves the other way. That is the minimiser of the convex step (docs/mechanics.md) with the step ended where
the sign changes, so that order four holds through stops (for v_s's power delta below four, the start from rest leaves
order 1 + delta, because the law itself is no smoother there).
"""

from typing import NamedTuple

from ballbot.mechanics.engine.compiled import inlined
from ballbot.mechanics.engine.tracing import greatest, least, traced, where
from ballbot.mechanics.friction import breakaway, directed_friction, friction_shift, sign, under_load

#: stands for "no limit"; finite, so that it stays a number when multiplied by zero
UNLIMITED = 1e200


class Inertia(NamedTuple):
    """A driven inertia, in compiled code."""

    inv_J: float  #: 1/J [1/(kg m^2)]
    stall: float  #: torque available at rest [N m]
    inv_no_load: float  #: 1/w_0 [s/rad]


@inlined
def available(inertia, torque, speed):
    """Return the torque [N m] that the supply lets through at that speed."""
    lost = inertia.stall * (speed * inertia.inv_no_load)
    return min(max(torque, -inertia.stall - lost), inertia.stall - lost)


@inlined
def move(wheel, inertia, torque, speed, h) -> tuple[float, float]:
    """Advance an inertia with a `Wheel`'s friction by h [s], the torque held; return its speed and the angle turned."""
    loaded = under_load(wheel, torque)
    holds = abs(available(inertia, torque, 0.0) - friction_shift(loaded, 0.0)) <= breakaway(loaded)
    if speed == 0.0 and holds:
        return 0.0, 0.0
    direction = sign(torque) if speed == 0.0 else sign(speed)
    end, travel = _slide(loaded, inertia, torque, speed, direction, h)
    if direction * end > 0.0 or speed == 0.0:
        return end, travel
    stop = _time_to_stop(loaded, inertia, torque, speed, direction, h)
    _, travel = _slide(loaded, inertia, torque, speed, direction, stop)
    if holds:
        return 0.0, travel
    end, back = _slide(loaded, inertia, torque, 0.0, sign(torque), h - stop)
    return end, travel + back


@inlined
def _acceleration(wheel, inertia, torque, speed, direction):
    friction = wheel.b * speed + direction * directed_friction(wheel, speed, direction)
    return inertia.inv_J * (available(inertia, torque, speed) - friction)


@inlined
def _slide(wheel, inertia, torque, speed, direction, h) -> tuple[float, float]:
    """Return speed and angle travelled after h [s] of sliding with friction against `direction` (1 or -1), by RK4."""
    half = 0.5 * h
    a1 = _acceleration(wheel, inertia, torque, speed, direction)
    w2 = speed + half * a1
    a2 = _acceleration(wheel, inertia, torque, w2, direction)
    w3 = speed + half * a2
    a3 = _acceleration(wheel, inertia, torque, w3, direction)
    w4 = speed + h * a3
    a4 = _acceleration(wheel, inertia, torque, w4, direction)
    travel = h / 6.0 * (speed + 2.0 * (w2 + w3) + w4)
    return speed + h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4), travel


_MOST_TRIALS = 60
_EPS = 2.220446049250313e-16


@inlined
def _time_to_stop(wheel, inertia, torque, speed, direction, h):
    """Return when, within h [s], the speed in `direction` has fallen to zero, which it does by then.

    Newton's method, or half of the bracket where it would leave that.
    """
    low, high, time = 0.0, h, 0.5 * h
    for _ in range(_MOST_TRIALS):
        end, _ = _slide(wheel, inertia, torque, speed, direction, time)
        if direction * end > 0.0:
            low = time
        else:
            high = time
        after = time - end / _acceleration(wheel, inertia, torque, end, direction)
        if not low <= after <= high:
            after = 0.5 * (low + high)
        settled = abs(after - time) <= _EPS * high
        time = after
        if settled:
            break
    return time


@traced
def braked(momentum, dry):
    """Return a momentum less the part that dry friction takes."""
    return momentum - least(greatest(momentum, -dry), dry)


@traced
def through_play(free, rate, momentum, dry, alone, low, high, wheel, together):
    """Return the torque from a motor to its wheel, which would turn at speed `free` without it, and the motor's speed.

    In contact at the stop with relative speed c, the wheel's inertia being j: m rho = N - h T + friction and
    rho = free + h T / j + c.
    """
    relative = least(greatest(alone - free, low), high)
    speed = braked(momentum + (relative + free) * wheel, dry) * together
    touches = relative != alone - free
    return where(touches, ((speed - relative - free) * wheel * rate, speed), (0.0, alone))
