"""Sums of many small steps, as the robot has them in single precision."""

from ballbot.mechanics.engine.compiled import inlined


@inlined
def add_to(sums, rests, i, value):
    """Add to a sum of many small steps; what rounding takes from one is added with the next (Kahan, CACM 8, 1965).

    Double precision does not need it: there the compiler leaves the rests zero.
    """
    wanted, before = value + rests[i], sums[i]
    sums[i] = before + wanted
    rests[i] = wanted - (sums[i] - before)
