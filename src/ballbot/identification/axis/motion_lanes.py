"""The compiled loops of `ballbot.identification.axis.motion`: an axis under recorded forces, and in its loop.

Two laws of one kind, one for each direction. Within the one step in which the direction changes, the law is that of
its start; with steps of a sample or less this is far below what a record can show.
"""

from ballbot.mechanics.compiled import compiled
from ballbot.mechanics.friction_laws.interface import move


@compiled
def follow_forces(plus, minus, inertia, state, position, speed, forces, h, steps, positions):
    """Move under forces (n,) held over samples; `positions` (n,) takes the position after each."""
    part = h / steps
    for k in range(len(forces)):
        force = forces[k]
        for _ in range(steps):
            if speed > 0.0 or (speed == 0.0 and force > 0.0):
                speed, travel = move(plus, inertia, force, state, speed, part)
            else:
                speed, travel = move(minus, inertia, force, state, speed, part)
            position += travel
        positions[k] = position


@compiled
def follow_loop(
    plus,
    minus,
    inertia,
    state,
    position,
    speed,
    offset,
    reference,
    added,
    gains,
    span,
    h,
    steps,
    positions,
    forces,
):
    """Move in closed loop along a reference (n,); `positions` and `forces` (n,) are those of each row.

    `added` (n,) are forces beside the loop's; `gains` (4,) are k_p, k_v, force per input and the input's limit.
    """
    part = h / steps
    started, start_speed = position, speed
    for k in range(len(reference)):
        positions[k] = position
        before = positions[k - span] if k >= span else started + (k - span) * h * start_speed
        velocity = (position - before) / (span * h)
        u = gains[1] * (gains[0] * (reference[k] - position) - velocity)
        forces[k] = gains[2] * min(max(u, -gains[3]), gains[3]) + added[k]
        force = forces[k] - offset
        for _ in range(steps):
            if speed > 0.0 or (speed == 0.0 and force > 0.0):
                speed, travel = move(plus, inertia, force, state, speed, part)
            else:
                speed, travel = move(minus, inertia, force, state, speed, part)
            position += travel
