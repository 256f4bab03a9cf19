"""Sliding one way: friction is a smooth function of speed there, and RK4 has order four.

For laws whose numbers name b, c, s, inv_vs and delta. Under a held torque the speed of one inertia is monotone, so
within a step it passes a level (zero, or the edge of a dead zone) at most once; where, is found to rounding.
"""

from ballbot.mechanics.compiled import inlined
from ballbot.mechanics.friction import dry_friction
from ballbot.mechanics.friction_laws.inertia import available, clamped
from ballbot.mechanics.friction_laws.root import crossing


@inlined
def _acceleration(law, inertia, torque, speed, direction):
    seen = clamped(inertia, speed)
    friction = law.b * seen + direction * dry_friction(law, seen)
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
def _above_level(h, context):
    law, inertia, torque, speed, direction, level = context
    return direction * slide(law, inertia, torque, speed, direction, h)[0] - level


@inlined
def time_to_slow(law, inertia, torque, speed, direction, level, h):
    """Return when, within h [s], the speed in `direction` has fallen to `level`, which it does by then."""
    return crossing(_above_level, (law, inertia, torque, speed, direction, level), 0.0, h)
