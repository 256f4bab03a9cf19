"""Floor adaptation: what the floor takes is told from what a slope takes, and turns with the motion.

Rolling friction acts against the motion: where that turns or ends, it does so at once, and an integral that carries
it is wrong until it has forgotten it. A slope's push stays. So the integral action's sum G (2,), world frame, is taken
for a part b that stays and a drag kappa along the motion asked for,

    G = b + kappa d + noise        d = v_r/|v_r|, a ramp below the speed from which it counts as motion

b and kappa are random walks, which a Kalman filter tells apart: at rest G shows b alone, and what comes with a motion
is kappa. What is given is I + kappa d in the integral's place, I = G - kappa d, so that nothing jumps as kappa changes
(within the integral's limit), and a motion that turns or ends takes its drag with it. For each axis, phi being
(1, 0, d_x) or (0, 1, d_y),

    p = P phi     (b, kappa) += p (G_i - phi.(b, kappa)) / (R + phi.p)     P -= p p^T / (R + phi.p)

and before it P_jj += Q_j, never above where it began: what a slope takes at the start is learnt as quickly as what the
floor does, and later slowly. kappa stays within its bound; it rests while nothing is asked to
move, and all rest while a torque or the lean is at its limit. Times are those after which a small change has been
followed to 63 %: in units of a second's noise R = 1/h, Q = h/T^2 and P begins at 1/T. (kappa also takes what else
turns with the motion: what the wheels' compensation leaves, and what feedback of the lean makes of it.)
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from ballbot.errors import InputError
from ballbot.mechanics.engine.compiled import called, inlined


@dataclass(frozen=True, kw_only=True)
class FloorAdaptation:
    """How fast and how far the floor is followed.

    Raises
    ------
    InputError
        Where a number is not positive.
    """

    time: float = 3.0  #: over which kappa follows, of motion [s]
    slope_time: float = 20.0  #: over which b follows, once it is known [s]
    highest: float = 0.15  #: bound of |kappa|, in the place of so much of the error's integral [m s]
    full_speed: float = 0.02  #: asked for, from which on the drag is given whole [m/s]

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value > 0.0):
                raise InputError(f"{field.name} of the floor adaptation is {value:g}; it must be positive.")


#: |d|^2 below which nothing is asked to move: a shaped motion never ends altogether
_MOVES = 1e-2

#: numbers that `pack_floor` returns
FLOOR_SIZE = 7
#: numbers that it remembers: kappa first, b (2), P less what it was at the start (xx, yy, kk, xy, xk, yk)
FLOOR_MEMORY = 9
# places in a row: R (0 where there is no floor adaptation), Q and P at the start of b, then of kappa, and the others
_NOISE, _SLOPE, _DRAG, _HIGHEST, _STEEPNESS = 0, 1, 3, 5, 6


def pack_floor(floor: FloorAdaptation | None, sample_time: float) -> list[float]:
    """Return the numbers that `tell_apart` reads; all zero where there is none."""
    if floor is None:
        return [0.0] * FLOOR_SIZE
    return [
        1.0 / sample_time,
        sample_time / floor.slope_time**2,
        1.0 / floor.time,
        sample_time / floor.time**2,
        1.0 / floor.time,
        floor.highest,
        1.0 / floor.full_speed,
    ]


@inlined
def direction(row, place, v_x, v_y):
    """Return d (2,) for the velocity asked for."""
    speed = (v_x * v_x + v_y * v_y) ** 0.5
    share = min(1.0, speed * row[place + _STEEPNESS]) / max(speed, 1e-300)
    return share * v_x, share * v_y


@called
def tell_apart(row, place, memory, drag, sums, d_x, d_y):
    """Step the filter by a sample; kappa is at `drag`, the integral of x and y at `sums`."""
    kappa, b_x, b_y = memory[drag], memory[drag + 1], memory[drag + 2]
    start_b, start_k = row[place + _SLOPE + 1], row[place + _DRAG + 1]
    G_x, G_y = memory[sums] + kappa * d_x, memory[sums + 1] + kappa * d_y
    moves = d_x * d_x + d_y * d_y > _MOVES
    xx = start_b + min(0.0, memory[drag + 3] + row[place + _SLOPE])
    yy = start_b + min(0.0, memory[drag + 4] + row[place + _SLOPE])
    kk = start_k + min(0.0, memory[drag + 5] + (row[place + _DRAG] if moves else 0.0))
    xy, xk, yk = memory[drag + 6], memory[drag + 7], memory[drag + 8]
    for axis in range(2):
        if axis == 0:
            miss = G_x - b_x - kappa * d_x
            p_x, p_y, p_k = xx + xk * d_x, xy + yk * d_x, xk + kk * d_x
            size = row[place + _NOISE] + p_x + d_x * p_k
        else:
            miss = G_y - b_y - kappa * d_y
            p_x, p_y, p_k = xy + xk * d_y, yy + yk * d_y, yk + kk * d_y
            size = row[place + _NOISE] + p_y + d_y * p_k
        b_x, b_y = b_x + p_x * miss / size, b_y + p_y * miss / size
        kappa += p_k * miss / size if moves else 0.0
        xx, yy, kk = xx - p_x * p_x / size, yy - p_y * p_y / size, kk - p_k * p_k / size
        xy, xk, yk = xy - p_x * p_y / size, xk - p_x * p_k / size, yk - p_y * p_k / size
    kappa = max(-row[place + _HIGHEST], min(row[place + _HIGHEST], kappa))
    memory[drag], memory[drag + 1], memory[drag + 2] = kappa, b_x, b_y
    memory[drag + 3], memory[drag + 4], memory[drag + 5] = xx - start_b, yy - start_b, kk - start_k
    memory[drag + 6], memory[drag + 7], memory[drag + 8] = xy, xk, yk
    memory[sums], memory[sums + 1] = G_x - kappa * d_x, G_y - kappa * d_y
