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

import math
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
from ballbot.mechanics.engine.compiled import by_types_of, called, inlined
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
from ballbot.mechanics.engine.vector import each, each_with, second, solve_dense, written
from ballbot.mechanics.equations import attitude_of, sines
from ballbot.mechanics.floor import REST, rolling_brake
from ballbot.mechanics.friction import sign

#: Newton rounds at most
ROUNDS = 5

_DISC_TOLERANCE = 1e-13  # of the disc's force, change in the last round


@inlined
def _box_derivative(s, limit):
    """Return T of a box: 1 inside, where the contact sticks."""
    return 1.0 if abs(s) < limit else 0.0


@inlined
def _box_projection(s, limit):
    return min(max(s, -limit), limit)


@inlined
def _disc_derivative(s_x, s_y, limit):
    """Return T of the disc (xx, yy, xy): the unit matrix inside, else limit/|s| (1 - s s^T/|s|^2)."""
    size2 = s_x * s_x + s_y * s_y
    inside = size2 < limit * limit
    inverse = 1.0 / max(size2, 1e-300)
    share = limit * math.sqrt(inverse)
    n_xx, n_yy, n_xy = s_x * s_x * inverse, s_y * s_y * inverse, s_x * s_y * inverse
    return (
        1.0 if inside else share * (1.0 - n_xx),
        1.0 if inside else share * (1.0 - n_yy),
        0.0 if inside else -share * n_xy,
    )


@inlined
def _disc_projection(s_x, s_y, limit):
    size2 = s_x * s_x + s_y * s_y
    share = 1.0 if size2 < limit * limit else limit / math.sqrt(max(size2, 1e-300))
    return s_x * share, s_y * share


def newton_round(s, G, b, limits, rolling_force) -> tuple:  # pragma: no cover
    """Return (forces, their probe s, settled): one round from a probe, and 1 where it left every contact's state.

    G and b are those of the module's head, each row multiplied by kappa h and kappa.
    """
    raise NotImplementedError("compiled code only")


@by_types_of(newton_round)
def _newton_round(s, G, b, limits, rolling_force):
    k, m = len(limits), len(s)
    x, y = k, k + 1
    lines = [f"t{i} = box_derivative(s[{i}], limits[{i}])" for i in range(k)]
    lines += [f"p{i} = box_projection(s[{i}], limits[{i}])" for i in range(k)]
    lines += [f"t_xx, t_yy, t_xy = disc_derivative(s[{x}], s[{y}], rolling_force)"]
    lines += [f"p{x}, p{y} = disc_projection(s[{x}], s[{y}], rolling_force)"]
    rows, right = [], []
    for i in range(k):
        row = [f"t{i} * G[{i}][{j}]" + (f" + 1.0 - t{i}" if i == j else "") for j in range(m)]
        rows.append(f"({', '.join(row)},)")
        right.append(f"t{i} * (b[{i}] - s[{i}]) + p{i}")
    for i, own, other_i, other in ((x, "t_xx", y, "t_xy"), (y, "t_yy", x, "t_xy")):
        row = [f"{own} * G[{i}][{j}] + {other} * G[{other_i}][{j}]" for j in range(m)]
        row[i] += f" + 1.0 - {own}"
        row[other_i] += f" - {other}"
        rows.append(f"({', '.join(row)},)")
        right.append(f"{own} * (b[{i}] - s[{i}]) + {other} * (b[{other_i}] - s[{other_i}]) + p{i}")
    lines.append(f"found = solve_dense(({', '.join(rows)},), ({', '.join(right)},))")
    lines.append("after = probe(found, G, b)")
    same = " * ".join(f"agrees(s[{i}], after[{i}], limits[{i}])" for i in range(k))
    disc = f"disc_agrees(s[{x}], s[{y}], after[{x}], after[{y}], found[{x}], found[{y}], rolling_force)"
    return written(
        "s, G, b, limits, rolling_force",
        f"found, after, {same} * {disc}",
        *lines,
        box_derivative=_box_derivative,
        box_projection=_box_projection,
        disc_derivative=_disc_derivative,
        disc_projection=_disc_projection,
        solve_dense=solve_dense,
        probe=probe,
        agrees=_agrees,
        disc_agrees=_disc_agrees,
    )


def probe(forces, G, b) -> tuple:  # pragma: no cover (compiled form below)
    """Return s = lambda + kappa (b - h G lambda)."""
    raise NotImplementedError("compiled code only")


@by_types_of(probe)
def _probe(forces, G, b):
    m = len(b)
    rows = (
        f"forces[{i}] + b[{i}] - ({' + '.join(f'G[{i}][{j}] * forces[{j}]' for j in range(m))})"
        for i in range(m)
    )
    return written("forces, G, b", f"({', '.join(rows)},)")


def first_probe(speeds, held, rests, limits, rolling_force) -> tuple:  # pragma: no cover
    """Return where to begin: contacts that move are taken to slide on, the others to stick with the forces `held`.

    `speeds` are those of the contacts at the step's start, `rests` those of the boxes below which they are at rest.
    """
    raise NotImplementedError("compiled code only")


@by_types_of(first_probe)
def _first_probe(speeds, held, rests, limits, rolling_force):
    k = len(limits)
    slides = [
        f"(limits[{i}] + 1.0) * sign(speeds[{i}]) if abs(speeds[{i}]) > rests[{i}] else held[{i}]"
        for i in range(k)
    ]
    lines = [
        f"speed = sqrt(speeds[{k}] * speeds[{k}] + speeds[{k + 1}] * speeds[{k + 1}])",
        "size = brake(rolling_force + 1.0, speed)",
    ]
    disc = [f"size * speeds[{k + i}] if speed > {REST} else held[{k + i}]" for i in range(2)]
    return written(
        "speeds, held, rests, limits, rolling_force",
        f"({', '.join(slides + disc)},)",
        *lines,
        brake=rolling_brake,
        sign=sign,
        sqrt=math.sqrt,
    )


@inlined
def _agrees(s, after, limit):
    """Return 1 where a box's contact is in the same state before and after a round, else 0."""
    inside = abs(s) < limit
    return 1.0 if (abs(after) < limit) == inside and (inside or s * after > 0.0 or limit == 0.0) else 0.0


@inlined
def _disc_agrees(s_x, s_y, after_x, after_y, r_x, r_y, limit):
    """Return 1 where the disc's state is the same and its force is the projection to rounding, else 0."""
    p_x, p_y = _disc_projection(after_x, after_y, limit)
    error = abs(p_x - r_x) + abs(p_y - r_y)
    same = (s_x * s_x + s_y * s_y < limit * limit) == (after_x * after_x + after_y * after_y < limit * limit)
    return 1.0 if same and error <= _DISC_TOLERANCE * limit else 0.0


def scaled_matrix(G, h) -> tuple:  # pragma: no cover
    """Return (kappa h G, kappa) with kappa = 1/(h G_ii) in each box, and one for both of the disc."""
    raise NotImplementedError("compiled code only")


@by_types_of(scaled_matrix)
def _scaled_matrix(G, h):
    m = len(G)
    disc = f"1.0 / max(G[{m - 2}][{m - 2}], G[{m - 1}][{m - 1}])"
    lines = [f"c{i} = 1.0 / G[{i}][{i}]" for i in range(m - 2)] + [
        f"c{m - 2} = {disc}",
        f"c{m - 1} = c{m - 2}",
        "rate = 1.0 / h",
    ]
    rows = ", ".join("(" + ", ".join(f"c{i} * G[{i}][{j}]" for j in range(m)) + ",)" for i in range(m))
    rates = ", ".join(f"c{i} * rate" for i in range(m))
    return written("G, h", f"({rows},), ({rates},)", *lines)


def all_stick(forces, limits, rolling_force) -> float:  # pragma: no cover
    """Return 1 where the forces are inside every limit: the whole robot is held, else 0."""
    raise NotImplementedError("compiled code only")


@by_types_of(all_stick)
def _all_stick(forces, limits, rolling_force):
    k = len(limits)
    boxes = " and ".join(f"abs(forces[{i}]) <= limits[{i}]" for i in range(k))
    disc = f"forces[{k}] * forces[{k}] + forces[{k + 1}] * forces[{k + 1}] <= rolling_force * rolling_force"
    return written("forces, limits, rolling_force", f"1.0 if {boxes} and {disc} else 0.0")


def still_where_held(v, s, limits, rolling_force) -> tuple:  # pragma: no cover (compiled form below)
    """Return v with zero, to the bit, where the floor holds the ball's path or its spin.

    The probe decides, not the force: a sliding contact's force is at its limit but for rounding, its probe beyond.
    """
    raise NotImplementedError("compiled code only")


@by_types_of(still_where_held)
def _still_where_held(v, s, limits, rolling_force):
    x = len(limits)
    lines = [
        f"path = 0.0 if s[{x}] * s[{x}] + s[{x + 1}] * s[{x + 1}] < rolling_force * rolling_force else 1.0"
    ]
    values = ["v[0] * path", "v[1] * path"]
    if len(v) == 3:
        lines.append(f"turns = 0.0 if abs(s[{x - 1}]) < limits[{x - 1}] else 1.0")
        values.append("v[2] * turns")
    return written("v, s, limits, rolling_force", f"({', '.join(values)},)", *lines)


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


@inlined
def convex_problem(selected, P, state, u, h):
    """Return the `ConvexProblem` of a step from a state, its first `ConvexPass`, and the first probe."""
    start = step_start(selected, state, h)
    a, free = start.middle, free_motion(selected, P, start.middle, start.v, start.w, u)
    ahead = first_ahead(selected, P, start, free, h)
    Y = responses(selected, P, a, free.system, ahead.speeds)
    G, rates = scaled_matrix(contact_matrix(selected, P, a, Y), h)
    b = each(_product, rates, ahead.speeds)
    held = solve_dense(G, b)
    rests = all_stick(held, free.limits, P.rolling_force)
    rests_below = of_boxes(selected, rest_speeds(P, h), REST)
    speeds = contact_speeds(selected, P, start.before, start.v, start.w)
    s = first_probe(speeds, held, rests_below, free.limits, P.rolling_force)
    problem = ConvexProblem(Y, G, rates, sines(start.before), sines(a), rests)
    return problem, ConvexPass(ahead.v + ahead.w, b, ahead.limits, ahead.rolling_force), s


@inlined
def second_pass(selected, P, state, u, problem, one, forces, s, h):
    """Return the second `ConvexPass` of a step of whose first these are the forces and their probe s."""
    end = less_response(one.free, problem.Y, forces, h)
    before, middle = attitude_of(problem.before), attitude_of(problem.middle)
    start = StepStart(ball_velocity(state), body_velocity(state), before, middle)
    found = Found(forces, s, problem.G, problem.rates, one.limits)
    ahead = corrected_ahead(selected, P, start, end, found, u, h)
    b = each(_product, problem.rates, ahead.speeds)
    return ConvexPass(ahead.v + ahead.w, b, ahead.limits, ahead.rolling_force)


def less_response(free, Y, forces, h) -> tuple:  # pragma: no cover (compiled form below)
    """Return nu_free - h Y^T lambda."""
    raise NotImplementedError("compiled code only")


@by_types_of(less_response)
def _less_response(free, Y, forces, h):
    m, contacts = len(free), len(forces)
    sums = (" + ".join(f"Y[{i}][{j}] * forces[{i}]" for i in range(contacts)) for j in range(m))
    return written(
        "free, Y, forces, h", "(" + "".join(f"free[{j}] - h * ({one}), " for j, one in enumerate(sums)) + ")"
    )


@inlined
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
_SIX = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


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
    contacts = _contacts_like(selected)
    matrix = each_with(second, contacts, contacts)
    return ConvexProblem(matrix, matrix, contacts, _SIX, _SIX, 0.0)


@inlined
def _pass_like(selected):
    contacts = _contacts_like(selected)
    return ConvexPass(contacts, contacts, _boxes_like(selected), 0.0)


@called
def _problems(selected, work, first, last):
    for lane in range(first, last):
        P, state = load(selected, work, lane), restored(state_like(selected), work, STATE, lane)
        u, h = restored(selected.wheels, work, TORQUE, lane), entry(work, STEP, lane)
        problem, first_pass, s = convex_problem(selected, P, state, u, h)
        stored(work, _PROBLEM, lane, problem)
        stored(work, _PASS, lane, first_pass)
        stored(work, _PROBE, lane, s)
        stored(work, _FORCES, lane, _contacts_like(selected))  # zero if the lane takes no round
        # a lane whose trial counts, or that does not move, asks for no rounds
        counts = entry(work, MARGIN, lane) > 0.0
        put(work, _SETTLED, lane, 1.0 if counts or problem.rests > 0.0 or not h > 0.0 else 0.0)


@called
def _second_passes(selected, work, first, last):
    for lane in range(first, last):
        P, state = load(selected, work, lane), restored(state_like(selected), work, STATE, lane)
        u, h = restored(selected.wheels, work, TORQUE, lane), entry(work, STEP, lane)
        problem = restored(_problem_like(selected), work, _PROBLEM, lane)
        one = restored(_pass_like(selected), work, _PASS, lane)
        s = restored(_contacts_like(selected), work, _PROBE, lane)
        forces = restored(_contacts_like(selected), work, _FORCES, lane)
        stored(work, _PASS, lane, second_pass(selected, P, state, u, problem, one, forces, s, h))
        settled = entry(work, _SETTLED, lane)
        put(work, _SETTLED_FIRST, lane, settled)
        still = entry(work, MARGIN, lane) > 0.0 or problem.rests > 0.0 or not h > 0.0
        put(work, _SETTLED, lane, 1.0 if still or settled == 0.0 else 0.0)


@called
def _round(selected, work, first, last):
    """Take one Newton round; lanes that have settled stay as they are."""
    for lane in range(first, last):
        settled = entry(work, _SETTLED, lane)
        G = restored(_problem_like(selected), work, _PROBLEM, lane).G
        one = restored(_pass_like(selected), work, _PASS, lane)
        s = restored(_contacts_like(selected), work, _PROBE, lane)
        forces = restored(_contacts_like(selected), work, _FORCES, lane)
        new_forces, new_s, agrees = newton_round(s, G, one.b, one.limits, one.rolling_force)
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
        state = restored(state_like(selected), work, STATE, lane)
        problem = restored(_problem_like(selected), work, _PROBLEM, lane)
        one = restored(_pass_like(selected), work, _PASS, lane)
        s = restored(_contacts_like(selected), work, _PROBE, lane)
        forces = restored(_contacts_like(selected), work, _FORCES, lane)
        h, moves = entry(work, STEP, lane), 1.0 - problem.rests
        v, w = parted(each_with(_product, less_response(one.free, problem.Y, forces, h), moves))
        v = still_where_held(v, s, one.limits, one.rolling_force)
        end = finished(selected, state, attitude_of(problem.middle), v, w, h)
        counts = entry(work, MARGIN, lane) > 0.0
        trial = restored(state_like(selected), work, TRIAL, lane)
        stored(work, TRIAL, lane, each_with(_chosen, each(_pair, trial, end), counts))
        settled = min(entry(work, _SETTLED, lane), entry(work, _SETTLED_FIRST, lane))
        put(work, MARGIN, lane, 1.0 if counts else settled)


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
    _rounds(selected, work, first, last)
    _second_passes(selected, work, first, last)
    _rounds(selected, work, first, last)
    _ends(selected, work, first, last)


@called
def _rounds(selected, work, first, last):
    for _ in range(ROUNDS):
        if _all_settled(work, first, last):
            break
        _round(selected, work, first, last)
