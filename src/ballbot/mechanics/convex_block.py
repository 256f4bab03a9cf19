"""The convex step of `proximal` for the robots of a block, in three loops: the problem, Newton rounds, the end."""

from ballbot.mechanics.compiled import by_types_of, called, inlined
from ballbot.mechanics.contacts import of_boxes
from ballbot.mechanics.equations import balancing_attitude
from ballbot.mechanics.lanes import (
    MARGIN,
    ROWS,
    SCRATCH,
    STATE,
    STEP,
    TORQUE,
    TRIAL,
    entry,
    put,
    restored,
    stored,
)
from ballbot.mechanics.parameters import load, state_like
from ballbot.mechanics.proximal import ROUNDS, ConvexProblem, convex_end, convex_problem, newton_round
from ballbot.mechanics.vector import each, each_with, second

# Scratch rows: the problem, the forces and their probe, and which lanes have settled
_PROBLEM = SCRATCH
_PROBE = _PROBLEM + 89
_FORCES = _PROBE + 6
_SETTLED = _FORCES + 6
assert _SETTLED < ROWS  # compiled code does not look whether a row is in the array


@inlined
def _boxes_like(selected):
    """Return zeros, one for each box."""
    return of_boxes(selected, each(_zero, selected.wheels), 0.0)


@inlined
def _contacts_like(selected):
    """Return zeros, one for each contact; three wheels have as many contacts as the robot has velocities."""
    return _boxes_like(selected) + (0.0, 0.0)


@inlined
def _zero(wheel):
    return 0.0


@inlined
def _problem_like(selected):
    boxes, contacts = _boxes_like(selected), _contacts_like(selected)
    matrix = each_with(second, contacts, contacts)
    return ConvexProblem(contacts, matrix, matrix, contacts, boxes, 0.0)


@called
def _problems(selected, work, first, last):
    for lane in range(first, last):
        P, state = load(selected, work, lane), restored(state_like(selected), work, STATE, lane)
        u, h = restored(selected.wheels, work, TORQUE, lane), entry(work, STEP, lane)
        a = balancing_attitude((state[2], state[3], state[4]))
        problem, s = convex_problem(selected, P, a, state, u, h)
        stored(work, _PROBLEM, lane, problem)
        stored(work, _PROBE, lane, s)
        stored(work, _FORCES, lane, _contacts_like(selected))  # what takes no round has none
        # a lane whose trial counts, or that does not move, asks for no rounds
        counts = entry(work, MARGIN, lane) > 0.0
        put(work, _SETTLED, lane, 1.0 if counts or problem.rests > 0.0 or not h > 0.0 else 0.0)


@called
def _round(selected, work, first, last):
    """Take one Newton round; what has settled stays as it is, whatever its neighbours need."""
    for lane in range(first, last):
        P, settled = load(selected, work, lane), entry(work, _SETTLED, lane)
        problem = restored(_problem_like(selected), work, _PROBLEM, lane)
        s = restored(_contacts_like(selected), work, _PROBE, lane)
        forces = restored(_contacts_like(selected), work, _FORCES, lane)
        new_forces, new_s, agrees = newton_round(s, problem.G, problem.b, problem.limits, P.rolling)
        stored(work, _FORCES, lane, each_with(_chosen, each(_pair, forces, new_forces), settled > 0.0))
        stored(work, _PROBE, lane, each_with(_chosen, each(_pair, s, new_s), settled > 0.0))
        put(work, _SETTLED, lane, max(settled, agrees))


@inlined
def _all_settled(work, first, last):
    least = 1.0
    for lane in range(first, last):
        least = min(least, entry(work, _SETTLED, lane))
    return least > 0.0


@called
def _ends(selected, work, first, last):
    for lane in range(first, last):
        P, state = load(selected, work, lane), restored(state_like(selected), work, STATE, lane)
        a = balancing_attitude((state[2], state[3], state[4]))
        problem = restored(_problem_like(selected), work, _PROBLEM, lane)
        s = restored(_contacts_like(selected), work, _PROBE, lane)
        forces = restored(_contacts_like(selected), work, _FORCES, lane)
        end = convex_end(selected, P, a, state, problem, forces, s, entry(work, STEP, lane))
        counts = entry(work, MARGIN, lane) > 0.0
        trial = restored(state_like(selected), work, TRIAL, lane)
        stored(work, TRIAL, lane, each_with(_chosen, each(_pair, trial, end), counts))
        put(work, MARGIN, lane, 1.0 if counts else entry(work, _SETTLED, lane))


@inlined
def _pair(a, b):
    return (a, b)


@inlined
def _chosen(pair, first):
    return pair[0] if first else pair[1]


@called
def convex_block(selected, work, first, last):
    """Take the convex step of lanes first .. last - 1 whose trial does not count; margins then say which settled."""
    _convex_block(selected, work, first, last)


def _convex_block(selected, work, first, last) -> None:  # pragma: no cover (compiled form below)
    raise NotImplementedError("compiled code only")


@by_types_of(_convex_block)
def _block_by_wheels(selected, work, first, last):
    if len(selected.types[0]) == 4:  # four wheels can strain against each other: G is singular
        return lambda selected, work, first, last: None
    return lambda selected, work, first, last: _three_wheeled_block(selected, work, first, last)


@inlined
def _three_wheeled_block(selected, work, first, last):
    _problems(selected, work, first, last)
    for _ in range(ROUNDS):
        if _all_settled(work, first, last):
            break
        _round(selected, work, first, last)
    _ends(selected, work, first, last)
