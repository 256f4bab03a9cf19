"""The convex step of `stick_slip` for many robots side by side.

`convex_block` takes the step for the robots of a block, in loops over lanes: the problem, Newton rounds, the problem
with the forces half way (`contacts.corrected_ahead`), Newton rounds, the end. Full stick is tried first, and then rest
is exactly zero. At most five rounds are taken of all lanes together. They do not suffice in some steps of a thousand,
nor with four wheels, where G is singular: `stick_slip.found_forces` takes these lanes one by one.
"""

from typing import NamedTuple

from ballbot.mechanics.contacts import (
    FirstForces,
    StepStart,
    contact_matrix,
    contact_speeds,
    corrected_ahead,
    finished,
    first_ahead,
    free_motion,
    of_boxes,
    parted,
    responses,
    step_start,
)
from ballbot.mechanics.engine.compiled import inlined
from ballbot.mechanics.engine.lanes import (
    MARGIN,
    ROWS,
    SCRATCH,
    STATE,
    STEP,
    TORQUE,
    TRIAL,
    entry,
    load,
    put,
    restored,
    state_like,
    stored,
)
from ballbot.mechanics.engine.smooth import ball_velocity, body_velocity, rest_speeds
from ballbot.mechanics.engine.tracing import both, either, greatest, lanes, root, traced, where
from ballbot.mechanics.engine.vector import each, scale, solve_dense
from ballbot.mechanics.equations import attitude_of, sines
from ballbot.mechanics.floor import REST, rolling_brake
from ballbot.mechanics.friction import sign
from ballbot.mechanics.stick_slip import (
    all_rest,
    found_forces,
    less_response,
    newton_round,
    scaled_matrix,
    still_where_held,
)

#: Newton rounds at most
ROUNDS = 5


def first_probe(speeds, held, rests, limits, rolling_force):
    """Return the initial probe: contacts that move are taken to slide on, the others to stick with the forces `held`.

    `speeds` are those of the contacts at the step's start, `rests` those of the boxes below which they are at rest.
    """
    slides = [
        where(abs(speeds[i]) > rests[i], (limits[i] + 1.0) * sign(speeds[i]), held[i])
        for i in range(len(limits))
    ]
    v_x, v_y = speeds[-2:]
    speed = root(v_x * v_x + v_y * v_y)
    size = rolling_brake(rolling_force + 1.0, speed)
    return (*slides, *where(speed > REST, (size * v_x, size * v_y), held[-2:]))


def all_stick(forces, limits, rolling_force):
    """Return 1 where the forces are inside every limit: the whole robot is held, else 0."""
    r_x, r_y = forces[-2:]
    held = r_x * r_x + r_y * r_y <= rolling_force * rolling_force
    for force, limit in zip(forces[:-2], limits, strict=True):
        held = both(held, abs(force) <= limit)
    return where(held, 1.0, 0.0)


class ConvexProblem(NamedTuple):
    """What both passes of a step's Newton rounds share."""

    Y: tuple  #: M^-1 C^T, a row for each contact
    G: tuple  #: kappa h C M^-1 C^T, by rows
    rates: tuple  #: kappa of each contact
    before: tuple  #: sines of the attitude before the step, and half way through it
    middle: tuple


class ConvexPass(NamedTuple):
    """What differs between the passes."""

    free: tuple  #: velocities v + w at the step's end without the friction that is to be found
    b: tuple  #: kappa C nu_free
    limits: tuple  #: of the boxes
    rolling_force: float  #: of the disc


def convex_problem(selected, P, state, u, h):
    """Return the `ConvexProblem` of a step from a state, its first `ConvexPass`, the first probe and if all rests."""
    start = step_start(selected, state, h)
    a, free = start.middle, free_motion(selected, P, start.middle, start.v, start.w, u)
    ahead = first_ahead(selected, P, start, free, h)
    Y = responses(selected, P, a, free.system, len(ahead.speeds))
    G, rates = scaled_matrix(contact_matrix(selected, P, a, Y), h)
    b = each(_product, rates, ahead.speeds)
    if len(selected.wheels) == 4:  # G is singular
        held, rests = scale(b, 0.0), 0.0
    else:
        held = solve_dense(G, b)
        rests = all_stick(held, free.limits, P.rolling_force)
    rests_below = of_boxes(selected, rest_speeds(P, h), REST)
    speeds = contact_speeds(selected, P, start.before, start.v, start.w)
    s = first_probe(speeds, held, rests_below, free.limits, P.rolling_force)
    problem = ConvexProblem(Y, G, rates, sines(start.before), sines(a))
    return problem, ConvexPass(ahead.v + ahead.w, b, ahead.limits, ahead.rolling_force), s, rests


def second_pass(selected, P, state, u, problem, first, forces, s, h):
    """Return the second `ConvexPass` of a step, from the forces of the first and their probe s."""
    end = less_response(first.free, problem.Y, forces, h)
    before, middle = attitude_of(problem.before), attitude_of(problem.middle)
    start = StepStart(ball_velocity(state), body_velocity(state), before, middle)
    solution = FirstForces(forces, s, problem.G, problem.rates, first.limits)
    ahead = corrected_ahead(selected, P, start, end, solution, u, h)
    b = each(_product, problem.rates, ahead.speeds)
    return ConvexPass(ahead.v + ahead.w, b, ahead.limits, ahead.rolling_force)


def _product(a, factor):
    return a * factor


# Scratch rows: the problem, a pass, its forces and their probe, and whether the lane has settled; the largest robot has
# seven contacts and six velocities
_PROBLEM = SCRATCH
_RESTS = _PROBLEM + 7 * 6 + 7 * 7 + 7 + 6 + 6
_PASS = _RESTS + 1
_PROBE = _PASS + 6 + 7 + 5 + 1
_FORCES = _PROBE + 7
_SETTLED = _FORCES + 7
assert _SETTLED < ROWS  # compiled code does not look whether a row is in the array
_SIX = (0.0,) * 6


def _zeros(selected):
    """Return zeros, one for each box and one for each contact."""
    boxes = of_boxes(selected, (0.0,) * len(selected.wheels), 0.0)
    return boxes, (*boxes, 0.0, 0.0)


@traced
def problem_in(selected, work, lane):
    """Return a lane's problem, pass, probe and forces."""
    boxes, contacts = _zeros(selected)
    velocities = state_like(selected)[5:]
    Y, G = (velocities,) * len(contacts), (contacts,) * len(contacts)
    problem = restored(ConvexProblem(Y, G, contacts, _SIX, _SIX), work, _PROBLEM, lane)
    data = restored(ConvexPass(velocities, contacts, boxes, 0.0), work, _PASS, lane)
    return problem, data, restored(contacts, work, _PROBE, lane), restored(contacts, work, _FORCES, lane)


@traced
def robot_in_lane(selected, work, lane):
    """Return a lane's parameters, state, torques and step."""
    state, u = (
        restored(state_like(selected), work, STATE, lane),
        restored(selected.wheels, work, TORQUE, lane),
    )
    return load(selected, work, lane), state, u, entry(work, STEP, lane)


def _asks_for_none(work, lane):
    """Return whether a lane asks for no rounds: its trial counts, it rests or it does not move."""
    rests = entry(work, _RESTS, lane) > 0.0
    return either(entry(work, MARGIN, lane) > 0.0, rests, ~(entry(work, STEP, lane) > 0.0))


@traced
def _problems(selected, work, first, last):
    for lane in lanes(first, last):
        P, state, u, h = robot_in_lane(selected, work, lane)
        problem, first_pass, s, rests = convex_problem(selected, P, state, u, h)
        stored(work, _PROBLEM, lane, problem)
        stored(work, _PASS, lane, first_pass)
        stored(work, _PROBE, lane, s)
        stored(work, _FORCES, lane, _zeros(selected)[1])  # zero if the lane takes no round
        put(work, _RESTS, lane, rests)
        put(work, _SETTLED, lane, where(_asks_for_none(work, lane), 1.0, 0.0))


@traced
def _second_passes(selected, work, first, last):
    for lane in lanes(first, last):
        P, state, u, h = robot_in_lane(selected, work, lane)
        problem, data, s, forces = problem_in(selected, work, lane)
        stored(work, _PASS, lane, second_pass(selected, P, state, u, problem, data, forces, s, h))
        put(work, _SETTLED, lane, where(_asks_for_none(work, lane), 1.0, 0.0))


@traced
def _round(selected, work, first, last):
    """Take one Newton round; lanes that have settled stay as they are."""
    for lane in lanes(first, last):
        settled = entry(work, _SETTLED, lane)
        problem, data, s, forces = problem_in(selected, work, lane)
        new_forces, new_s, agrees = newton_round(s, problem.G, data.b, data.limits, data.rolling_force)
        stored(work, _FORCES, lane, where(settled > 0.0, forces, new_forces))
        stored(work, _PROBE, lane, where(settled > 0.0, s, new_s))
        put(work, _SETTLED, lane, greatest(settled, agrees))


@inlined
def _rounds(selected, work, first, last):
    """Find the forces of a pass: in rounds of all lanes, but with four wheels; then one by one what has not settled."""
    for _ in range(ROUNDS if len(selected.wheels) != 4 else 0):
        least_settled = 1.0
        for lane in range(first, last):
            least_settled = min(least_settled, entry(work, _SETTLED, lane))
        if least_settled > 0.0:
            return
        _round(selected, work, first, last)
    for lane in range(first, last):
        if entry(work, _SETTLED, lane) == 0.0:
            problem, data, _, _ = problem_in(selected, work, lane)
            forces, s = found_forces(problem.G, data.b, problem.rates, data.limits, data.rolling_force)
            stored(work, _FORCES, lane, forces)
            stored(work, _PROBE, lane, s)
            put(work, _RESTS, lane, all_rest(forces, s, data.b))


@traced
def _ends(selected, work, first, last):
    for lane in lanes(first, last):
        state, h = restored(state_like(selected), work, STATE, lane), entry(work, STEP, lane)
        problem, data, s, forces = problem_in(selected, work, lane)
        moves = 1.0 - entry(work, _RESTS, lane)
        v, w = parted(scale(less_response(data.free, problem.Y, forces, h), moves))
        v = still_where_held(v, s, data.limits, data.rolling_force)
        end = finished(selected, state, attitude_of(problem.middle), v, w, h)
        counts = entry(work, MARGIN, lane) > 0.0
        trial = restored(state_like(selected), work, TRIAL, lane)
        stored(work, TRIAL, lane, where(counts, trial, end))


@inlined
def convex_block(selected, work, first, last):
    """Take the convex step of lanes first .. last - 1 whose trial does not count."""
    _problems(selected, work, first, last)
    _rounds(selected, work, first, last)
    _second_passes(selected, work, first, last)
    _rounds(selected, work, first, last)
    _ends(selected, work, first, last)
