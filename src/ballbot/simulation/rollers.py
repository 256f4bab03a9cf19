"""What rollers do at a wheel's angle: one law, of `ballbot.simulation.imperfections`, for the loop and for logs."""

import math

from ballbot.mechanics.engine.compiled import compiled, inlined
from ballbot.simulation.imperfections import LOOP

_LOOP_TYPE = LOOP.dtype()


@inlined
def touch(record, angles, wheels, rolled, rings):
    """Fill the rollers' torques (n,) on wheels at these angles and speeds, and which ring bears (n,): -1 to 1."""
    n = len(angles)
    for i in range(n):
        rolled[i] = 0.0
    for i in range(n):
        nearest = math.floor(angles[i] / record.pitch + 0.5)
        away = angles[i] - nearest * record.pitch
        x = abs(away)
        y = record.pitch - x  # to the next roller
        further = record.out_of_round * (y * y * y * y - x * x * x * x)
        nearing = (
            4.0 * record.out_of_round * (y * y * y + x * x * x) * math.copysign(wheels[i], away * wheels[i])
        )
        share = min(max(0.5 + 0.5 * (further - record.relaxation * nearing) / record.give, 0.0), 1.0)
        size = 4.0 * record.out_of_round * record.pressure * (share * x * x * x - (1.0 - share) * y * y * y)
        rolled[i] += math.copysign(1.0, away) * size
        # of neighbouring rollers one is of the first ring, one of the second
        rings[i] = (2.0 * share - 1.0) * (2.0 * (nearest - 2.0 * math.floor(0.5 * nearest)) - 1.0)
        turning = 0.0
        for j in range(n):
            turning += record.about_normal[i, j] * wheels[j]
        most = record.grip * min(share, 1.0 - share) * record.pressure
        moment = 2.0 * record.lever * min(max(record.creep * record.lever * turning, -most), most)
        for j in range(n):
            rolled[j] -= record.about_normal[i, j] * moment


@compiled
def touch_rows(record, angles, wheels, rolled, rings):
    """Fill what `touch` does for each row of angles and speeds (N, n); `record` is that of a loop."""
    numbers = record.view(_LOOP_TYPE)[0]
    for row in range(len(angles)):
        touch(numbers, angles[row], wheels[row], rolled[row], rings[row])
