"""What a law remembers of its last updates: each wheel's torques and what of them it knows, the newest first."""

from __future__ import annotations

from ballbot.control.parts.torque_balance import MAX_WHEELS
from ballbot.mechanics.engine.compiled import called, inlined

#: updates that are remembered
MAX_PAST = 22

#: what is remembered for each wheel and update: torque given, what compensation added, the torque without what friction
#: is thought to take, friction that adaptation judges and its rolling part, whether any wheel's torque was at its limit
GIVEN, COMPENSATED, EFFECTIVE, JUDGED, JUDGED_ROLLING, BEYOND = range(6)
_KINDS = 6
_ONE = _KINDS * MAX_WHEELS

#: numbers remembered; all zero at the start of a run
PAST_MEMORY = MAX_PAST * _ONE


@inlined
def past(first, ago, kind, wheel):
    """Return the place of one number of the past that begins at `first`; `ago` is 0 for the last update."""
    return first + ago * _ONE + kind * MAX_WHEELS + wheel


@called
def grow_older(memory, first, updates):
    """Make room for another update, the last `updates` kept."""
    for place in range(first + updates * _ONE - 1, first - 1, -1):
        memory[place + _ONE] = memory[place]
