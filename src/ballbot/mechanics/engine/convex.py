"""The convex step of `stick_slip` for many robots side by side: the same minimiser, found without branches.

The unknowns are the friction forces lambda: one in each box (wheels, and the spin where the ball pivots) and the two
of the disc. With G = C M^-1 C^T, b = C nu_free and any kappa > 0 the optimality conditions are

    lambda = P(s),   s = lambda + kappa (b - h G lambda),   P the projection on boxes and disc,

solved by a semi-smooth Newton method (L. Qi and J. Sun, A nonsmooth version of Newton's method, 1993): with T the
derivative of P, each round solves (I - T + T kappa h G) lambda = T kappa b + P(s) - T s. Full stick is tried first, and
then rest is exactly zero. At most five rounds follow, none with a branch, so that a loop over robots is vector code.
They do not suffice in some steps of a thousand, nor with four wheels, where G is singular: `stick_slip.minimiser` takes
these.

`convex_block` takes the step for the robots of a block, in loops over lanes: the problem, Newton rounds, the problem
with the forces half way (`contacts.corrected_ahead`), Newton rounds, the end.
"""

from typing import NamedTuple

from ballbot.mechanics.contacts import (
    Found,
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
from ballbot.mechanics.engine.compiled import called
from ballbot.mechanics.engine.lanes import (
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
from ballbot.mechanics.engine.loading import load, state_like
from ballbot.mechanics.engine.smooth import ball_velocity, body_velocity, rest_speeds
from ballbot.mechanics.engine.tracing import both, either, greatest, lanes, least, root, traced, where
from ballbot.mechanics.engine.vector import each, inner, scale, solve_dense
from ballbot.mechanics.equations import attitude_of, sines
from ballbot.mechanics.floor import REST, rolling_brake
from ballbot.mechanics.friction import sign

#: Newton rounds at most
ROUNDS = 5

_DISC_TOLERANCE = 1e-13  # of the disc's force, change in the last round


def _disc_derivative(s_x, s_y, limit):
    """Return T of the disc (xx, yy, xy): the unit matrix inside, else limit/|s| (1 - s s^T/|s|^2)."""
    size2 = s_x * s_x + s_y * s_y
    inside = size2 < limit * limit
    inverse = 1.0 / greatest(size2, 1e-300)
    share = limit * root(inverse)
    n_xx, n_yy, n_xy = s_x * s_x * inverse, s_y * s_y * inverse, s_x * s_y * inverse
    return where(inside, (1.0, 1.0, 0.0), (share * (1.0 - n_xx), share * (1.0 - n_yy), -share * n_xy))


def _disc_projection(s_x, s_y, limit):
    size2 = s_x * s_x + s_y * s_y
    share = where(size2 < limit * limit, 1.0, limit / root(greatest(size2, 1e-300)))
    return s_x * share, s_y * share


def newton_round(s, G, b, limits, rolling_force):
    """Return (forces, their probe s, settled): one round from a probe, and 1 where it left every contact's state.

    G and b are those of the module's head, each row multiplied by kappa h and kappa.
    """
    k, m = len(limits), len(s)
    x, y = k, k + 1
    T = [[0.0] * m for _ in range(m)]
    P = []
    for i, limit in enumerate(limits):
        T[i][i] = where(abs(s[i]) < limit, 1.0, 0.0)  # 1 inside, where the contact sticks
        P.append(least(greatest(s[i], -limit), limit))
    T[x][x], T[y][y], T[x][y] = _disc_derivative(s[x], s[y], rolling_force)
    T[y][x] = T[x][y]
    P += _disc_projection(s[x], s[y], rolling_force)
    rows, right = [], []
    for i in range(m):
        coupled = (i,) if i < k else (i, x + y - i)
        row = [inner([T[i][j] for j in coupled], [G[j][column] for j in coupled]) for column in range(m)]
        for j in coupled:
            row[j] = row[j] + (1.0 - T[i][j] if i == j else -T[i][j])
        rows.append(row)
        right.append(inner([T[i][j] for j in coupled], [b[j] - s[j] for j in coupled]) + P[i])
    found = solve_dense(rows, right)
    after = tuple(found[i] + b[i] - inner(G[i], found) for i in range(m))
    same = _disc_agrees(s[x], s[y], after[x], after[y], found[x], found[y], rolling_force)
    for i, limit in enumerate(limits):
        same = both(same, _agrees(s[i], after[i], limit))
    return found, after, where(same, 1.0, 0.0)


def first_probe(speeds, held, rests, limits, rolling_force):
    """Return where to begin: contacts that move are taken to slide on, the others to stick with the forces `held`.

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


def _agrees(s, after, limit):
    """Return whether a box's contact is in the same state before and after a round."""
    inside = abs(s) < limit
    stays = either(inside, s * after > 0.0, limit == 0.0)
    return both((abs(after) < limit) == inside, stays)


def _disc_agrees(s_x, s_y, after_x, after_y, r_x, r_y, limit):
    """Return whether the disc's state is the same and its force is the projection to rounding."""
    p_x, p_y = _disc_projection(after_x, after_y, limit)
    error = abs(p_x - r_x) + abs(p_y - r_y)
    same = (s_x * s_x + s_y * s_y < limit * limit) == (after_x * after_x + after_y * after_y < limit * limit)
    return both(same, error <= _DISC_TOLERANCE * limit)


def scaled_matrix(G, h):
    """Return (kappa h G, kappa) with kappa = 1/(h G_ii) in each box, and one for both of the disc."""
    stiffest = greatest(G[-2][-2], G[-1][-1])
    inverses = [1.0 / G[i][i] for i in range(len(G) - 2)] + [1.0 / stiffest] * 2
    rate = 1.0 / h
    return tuple(scale(row, one) for row, one in zip(G, inverses, strict=True)), scale(inverses, rate)


def all_stick(forces, limits, rolling_force):
    """Return 1 where the forces are inside every limit: the whole robot is held, else 0."""
    r_x, r_y = forces[-2:]
    held = r_x * r_x + r_y * r_y <= rolling_force * rolling_force
    for force, limit in zip(forces[:-2], limits, strict=True):
        held = both(held, abs(force) <= limit)
    return where(held, 1.0, 0.0)


def still_where_held(v, s, limits, rolling_force):
    """Return v with zero, to the bit, where the floor holds the ball's path or its spin.

    The probe decides, not the force: a sliding contact's force is at its limit but for rounding, its probe beyond.
    """
    path = where(s[-2] * s[-2] + s[-1] * s[-1] < rolling_force * rolling_force, 0.0, 1.0)
    if len(v) == 2:
        return v[0] * path, v[1] * path
    return v[0] * path, v[1] * path, v[2] * where(abs(s[-3]) < limits[-1], 0.0, 1.0)


class ConvexProblem(NamedTuple):
    """What both passes of a step's Newton rounds share."""

    Y: tuple  #: M^-1 C^T, a row for each contact
    G: tuple  #: kappa h C M^-1 C^T, by rows
    rates: tuple  #: kappa of each contact
    before: tuple  #: sines of the attitude before the step, and half way through it
    middle: tuple
    rests: float  #: 1 where friction holds the whole robot


class ConvexPass(NamedTuple):
    """What differs between the passes."""

    free: tuple  #: velocities v + w at the step's end without the friction that is to be found
    b: tuple  #: kappa C nu_free
    limits: tuple  #: of the boxes
    rolling_force: float  #: of the disc


def convex_problem(selected, P, state, u, h):
    """Return the `ConvexProblem` of a step from a state, its first `ConvexPass`, and the first probe."""
    start = step_start(selected, state, h)
    a, free = start.middle, free_motion(selected, P, start.middle, start.v, start.w, u)
    ahead = first_ahead(selected, P, start, free, h)
    Y = responses(selected, P, a, free.system, len(ahead.speeds))
    G, rates = scaled_matrix(contact_matrix(selected, P, a, Y), h)
    b = each(_product, rates, ahead.speeds)
    held = solve_dense(G, b)
    rests = all_stick(held, free.limits, P.rolling_force)
    rests_below = of_boxes(selected, rest_speeds(P, h), REST)
    speeds = contact_speeds(selected, P, start.before, start.v, start.w)
    s = first_probe(speeds, held, rests_below, free.limits, P.rolling_force)
    problem = ConvexProblem(Y, G, rates, sines(start.before), sines(a), rests)
    return problem, ConvexPass(ahead.v + ahead.w, b, ahead.limits, ahead.rolling_force), s


def second_pass(selected, P, state, u, problem, one, forces, s, h):
    """Return the second `ConvexPass` of a step of whose first these are the forces and their probe s."""
    end = less_response(one.free, problem.Y, forces, h)
    before, middle = attitude_of(problem.before), attitude_of(problem.middle)
    start = StepStart(ball_velocity(state), body_velocity(state), before, middle)
    found = Found(forces, s, problem.G, problem.rates, one.limits)
    ahead = corrected_ahead(selected, P, start, end, found, u, h)
    b = each(_product, problem.rates, ahead.speeds)
    return ConvexPass(ahead.v + ahead.w, b, ahead.limits, ahead.rolling_force)


def less_response(free, Y, forces, h):
    """Return nu_free - h Y^T lambda."""
    return tuple(free[j] - h * inner([row[j] for row in Y], forces) for j in range(len(free)))


def _product(a, factor):
    return a * factor


# Scratch rows: the problem, a pass, its forces and their probe, whether the lane has settled, and did in both passes
_PROBLEM = SCRATCH
_PASS = _PROBLEM + 6 * 6 + 6 * 6 + 6 + 6 + 6 + 1
_PROBE = _PASS + 6 + 6 + 4 + 1
_FORCES = _PROBE + 6
_SETTLED = _FORCES + 6
_SETTLED_FIRST = _SETTLED + 1
assert _SETTLED_FIRST < ROWS  # compiled code does not look whether a row is in the array
_SIX = (0.0,) * 6


def _zeros(selected):
    """Return zeros, one for each box and one for each contact; with three wheels those are as many as velocities."""
    boxes = of_boxes(selected, (0.0,) * len(selected.wheels), 0.0)
    return boxes, (*boxes, 0.0, 0.0)


def _problem_in(selected, work, lane):
    """Return a lane's problem, pass, probe and forces."""
    boxes, contacts = _zeros(selected)
    matrix = (contacts,) * len(contacts)
    shapes = (
        (_PROBLEM, ConvexProblem(matrix, matrix, contacts, _SIX, _SIX, 0.0)),
        (_PASS, ConvexPass(contacts, contacts, boxes, 0.0)),
        (_PROBE, contacts),
        (_FORCES, contacts),
    )
    return tuple(restored(shape, work, row, lane) for row, shape in shapes)


@traced
def robot_in_lane(selected, work, lane):
    """Return a lane's parameters, state, torques and step."""
    state, u = (
        restored(state_like(selected), work, STATE, lane),
        restored(selected.wheels, work, TORQUE, lane),
    )
    return load(selected, work, lane), state, u, entry(work, STEP, lane)


def _lanes(selected, first, last):
    """Return `lanes`, but none with four wheels: they can strain against each other, and G is singular."""
    return () if len(selected.wheels) == 4 else lanes(first, last)


@traced
def _problems(selected, work, first, last):
    for lane in _lanes(selected, first, last):
        P, state, u, h = robot_in_lane(selected, work, lane)
        problem, first_pass, s = convex_problem(selected, P, state, u, h)
        stored(work, _PROBLEM, lane, problem)
        stored(work, _PASS, lane, first_pass)
        stored(work, _PROBE, lane, s)
        stored(work, _FORCES, lane, _zeros(selected)[1])  # zero if the lane takes no round
        # a lane whose trial counts, or that does not move, asks for no rounds
        counts = entry(work, MARGIN, lane) > 0.0
        none = either(counts, problem.rests > 0.0, ~(h > 0.0))
        put(work, _SETTLED, lane, where(none, 1.0, 0.0))


@traced
def _second_passes(selected, work, first, last):
    for lane in _lanes(selected, first, last):
        P, state, u, h = robot_in_lane(selected, work, lane)
        problem, one, s, forces = _problem_in(selected, work, lane)
        settled = entry(work, _SETTLED, lane)
        stored(work, _PASS, lane, second_pass(selected, P, state, u, problem, one, forces, s, h))
        put(work, _SETTLED_FIRST, lane, settled)
        still = either(entry(work, MARGIN, lane) > 0.0, problem.rests > 0.0, ~(h > 0.0))
        put(work, _SETTLED, lane, where(either(still, settled == 0.0), 1.0, 0.0))


@traced
def _round(selected, work, first, last):
    """Take one Newton round; lanes that have settled stay as they are."""
    for lane in _lanes(selected, first, last):
        settled = entry(work, _SETTLED, lane)
        problem, one, s, forces = _problem_in(selected, work, lane)
        new_forces, new_s, agrees = newton_round(s, problem.G, one.b, one.limits, one.rolling_force)
        stored(work, _FORCES, lane, where(settled > 0.0, forces, new_forces))
        stored(work, _PROBE, lane, where(settled > 0.0, s, new_s))
        put(work, _SETTLED, lane, greatest(settled, agrees))


@called
def _rounds(selected, work, first, last):
    for _ in range(ROUNDS):
        least_settled = 1.0
        for lane in range(first, last):
            least_settled = min(least_settled, entry(work, _SETTLED, lane))
        if least_settled > 0.0:
            break
        _round(selected, work, first, last)


@traced
def _ends(selected, work, first, last):
    for lane in _lanes(selected, first, last):
        state, h = restored(state_like(selected), work, STATE, lane), entry(work, STEP, lane)
        problem, one, s, forces = _problem_in(selected, work, lane)
        moves = 1.0 - problem.rests
        v, w = parted(scale(less_response(one.free, problem.Y, forces, h), moves))
        v = still_where_held(v, s, one.limits, one.rolling_force)
        end = finished(selected, state, attitude_of(problem.middle), v, w, h)
        counts = entry(work, MARGIN, lane) > 0.0
        trial = restored(state_like(selected), work, TRIAL, lane)
        stored(work, TRIAL, lane, where(counts, trial, end))
        settled = least(entry(work, _SETTLED, lane), entry(work, _SETTLED_FIRST, lane))
        put(work, MARGIN, lane, where(counts, 1.0, settled))


@called
def convex_block(selected, work, first, last):
    """Take the convex step of lanes first .. last - 1 whose trial does not count; margins then say which settled."""
    _problems(selected, work, first, last)
    _rounds(selected, work, first, last)
    _second_passes(selected, work, first, last)
    _rounds(selected, work, first, last)
    _ends(selected, work, first, last)
