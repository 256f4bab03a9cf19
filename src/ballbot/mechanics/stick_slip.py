"""A step in which friction may stick: the minimiser of a strictly convex function (docs/mechanics.md).

    nu+ = argmin 1/2 (nu - nu_free)^T M (nu - nu_free) + h sum_i g_i |C_i nu| + h rho |nu_xy|

with C_i the row that gives wheel i's speed, g_i its dry friction at the step's start and rho = N C_rr. A friction that
differs with direction, g+ and g-, is the symmetric one of (g+ + g-)/2 about the force (g+ - g-)/2, which belongs to
nu_free: g+ max(v, 0) + g- max(-v, 0) = (g+ + g-)/2 |v| + (g+ - g-)/2 v. Where the
ball may pivot, its spin is a sixth velocity and pivoting friction one more box (a row of C and its limit, after the
wheels'). It is the implicit step of set-valued friction (J. J. Moreau, Unilateral contact and dry friction in
finite freedom dynamics, 1988). It dissipates always and needs no smoothing. The engine takes it twice, the second time
with the forces half way through the step (`ballbot.mechanics.contacts`), which makes it one of order two.

The holding forces of full stick are tried first, and then rest is exactly zero. Otherwise the unknowns are the friction
forces, lambda in the boxes and r in the disc, with the speeds at the contacts C nu_free - h G lambda, G = C M^-1 C^T
(here C has rows for the ball's x and y, last). Given which boxes stick and the signs of the others, those that stick
are eliminated and the disc is solved in closed form but for one number; the boxes that disagree with the guess make
the next one. If guesses go round in circles, every one is tried.

A guess is good enough by how far from the minimiser it can be. Forces beyond their limits by e put nu off by at most
|h M^-1 C^T e| in the norm of the kinetic energy, since the step is a projection in that norm.
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ballbot.arrays import real_array, real_number
from ballbot.errors import InputError
from ballbot.mechanics.engine.compiled import called, compiled
from ballbot.mechanics.engine.tracing import both, either, greatest, least, root, traced, where
from ballbot.mechanics.engine.vector import advanced, inner, scale, solve_dense, summed
from ballbot.mechanics.friction import sign

_GUESSES = 12
_ACCURATE = 1e-14  # distance to the minimiser, over |nu_free|, at which the search for a better guess ends
_AT_REST = 1e-12  # of a speed's terms, below which the speed is rounding
_DISC_STEPS = 60

# Matrices are tuples of rows. The contacts are (C, Y, G): the boxes' rows, and `mobility` of all.


@traced
def rest_is_held(M, free, C, limits, rolling_force, h):
    """Return True where friction can hold the whole robot at rest.

    The forces that stop it, f = M nu_free / h, must come from wheels within their limits and a ground force
    within `rolling_force`: C_w^T lambda = f_w, then r = f_v - C_v^T lambda, and pivoting likewise. Four wheels leave
    one freedom in lambda.
    """
    needed = [inner(row, free) / h for row in M]
    wheels = C[: _wheel_count(C)]
    K = [[summed(row[2 + i] * row[2 + j] for row in wheels) for j in range(3)] for i in range(3)]
    x = solve_dense(K, needed[2:5])
    forces = [inner(row[2:5], x) for row in wheels]
    r_x, r_y = (needed[i] - summed(row[i] * f for row, f in zip(wheels, forces, strict=True)) for i in (0, 1))
    held = r_x * r_x + r_y * r_y <= rolling_force * rolling_force
    if len(wheels) == 4:
        low, high = _idle_range(C, limits, forces)
        held = both(held, low <= high)
    else:
        held = both(held, *(abs(force) <= limit for force, limit in zip(forces, limits, strict=False)))
    if len(C[0]) == 5:
        return held
    pivot = needed[5] - summed(row[5] * f for row, f in zip(wheels, forces, strict=True))
    return both(held, abs(pivot) <= limits[-1])


def _wheel_count(C):
    """Return the number of wheels: all rows of C, but for the spin's where there is a sixth velocity."""
    return len(C) - (len(C[0]) == 6)


def _idle_force(C, wheel):
    """Return the wheel's part in the forces of four wheels that add up to no torque."""
    a, b, c = (C[(wheel + i) % 4] for i in (1, 2, 3))
    volume = (
        a[2] * (b[3] * c[4] - b[4] * c[3])
        - a[3] * (b[2] * c[4] - b[4] * c[2])
        + a[4] * (b[2] * c[3] - b[3] * c[2])
    )
    return volume if wheel % 2 == 0 else -volume


def _idle_range(C, limits, forces):
    """Return how much of the idle forces may be added to those of four wheels: from low to high, if low <= high."""
    low, high = -_WIDE, _WIDE
    for wheel in range(4):
        idle, force, limit = _idle_force(C, wheel), forces[wheel], limits[wheel]
        one, other = (-limit - force) / idle, (limit - force) / idle
        allowed = where(abs(force) <= limit, _WIDE, -_WIDE)  # by a wheel that has no part in them
        low = greatest(low, where(idle == 0.0, -allowed, least(one, other)))
        high = least(high, where(idle == 0.0, allowed, greatest(one, other)))
    return low, high


_WIDE = 1e300


@traced
def mobility(M, C):
    """Return Y (contacts, m) and G (contacts, contacts): velocities and contact speeds per unit force at each.

    The contacts are the boxes, of rows C, then the ball's x and y.
    """
    m = len(M)
    rows = (*C, *(tuple(1.0 if i == j else 0.0 for j in range(m)) for i in (0, 1)))
    Y = tuple(solve_dense(M, row) for row in rows)
    return Y, tuple(tuple(inner(row, one) for one in Y) for row in rows)


@called
def _disc_force(v_x, v_y, a, c, b, rolling_force, h):
    """Return the disc's force and the velocity left: v = v_0 - h G r for the 2 x 2 mobility G = [[a, b], [b, c]].

    Sticking, r = G^-1 v_0 / h. Sliding, r = rho n with (s + h rho G) n = v_0 and |n| = 1; the speed s is where
    1/|n(s)| = 1, by Newton's method from s = 0 (as J. J. More and D. C. Sorensen do, Computing a trust region step,
    1983).
    """
    if rolling_force <= 0.0:
        return 0.0, 0.0, v_x, v_y
    angle = 0.5 * math.atan2(2.0 * b, a - c)
    cos, sin = math.cos(angle), math.sin(angle)
    largest = 0.5 * (a + c) + math.hypot(0.5 * (a - c), b)
    smallest = (a * c - b * b) / largest
    p, q = cos * v_x + sin * v_y, cos * v_y - sin * v_x
    hold_p, hold_q = p / (h * largest), q / (h * smallest)
    if math.hypot(hold_p, hold_q) <= rolling_force:
        return cos * hold_p - sin * hold_q, sin * hold_p + cos * hold_q, 0.0, 0.0
    speed = 0.0
    n_p = n_q = length = 0.0
    for _ in range(_DISC_STEPS):
        d_p, d_q = speed + h * rolling_force * largest, speed + h * rolling_force * smallest
        n_p, n_q = p / d_p, q / d_q
        length = math.hypot(n_p, n_q)
        step = (length - 1.0) * length * length / (n_p * n_p / d_p + n_q * n_q / d_q)
        speed = max(speed + step, 0.0)
        if abs(step) <= 1e-16 * d_p:
            break
    n_x, n_y = (cos * n_p - sin * n_q) / length, (sin * n_p + cos * n_q) / length
    return rolling_force * n_x, rolling_force * n_y, speed * n_x, speed * n_y


@traced
def _eliminated(signs, C, G, ahead, limits, h):
    """Return what follows from a guess but for the disc's force r: signs[i] is 0 where a box sticks.

    The sticking boxes' forces are X_0 - X_1 r_x - X_2 r_y. Of four sticking wheels, which can strain against each
    other, the last is left out, and has no force of its own.

    Returns
    -------
    X, forces, speeds, disc
        `forces` of the boxes that slide, `speeds` at all contacts under them, `disc` the velocity and mobility there.
    """
    k = len(limits)
    sticks = [both(one == 0.0, limit > 0.0) for one, limit in zip(signs, limits, strict=True)]
    if _wheel_count(C) == 4:
        sticks[3] = both(sticks[3], ~both(*sticks[:3]))
    stuck = [where(one, 1.0, 0.0) for one in sticks]
    forces = tuple(limit * one for limit, one in zip(limits, signs, strict=True))
    speeds = tuple(ahead[i] - h * inner(G[i][:k], forces) for i in range(k + 2))
    K = [[stuck[i] * stuck[j] * G[i][j] for j in range(k)] for i in range(k)]
    for i in range(k):
        K[i][i] = K[i][i] + (1.0 - stuck[i])
    right = ([speeds[i] / h for i in range(k)], [G[i][k] for i in range(k)], [G[i][k + 1] for i in range(k)])
    X = tuple(solve_dense(K, [one * x for one, x in zip(stuck, side, strict=True)]) for side in right)
    v = [speeds[k + i] - h * inner(G[k + i][:k], X[0]) for i in (0, 1)]
    a, c = (G[k + i][k + i] - inner(G[k + i][:k], X[1 + i]) for i in (0, 1))
    b = G[k][k + 1] - inner(G[k][:k], X[2])
    return X, forces, speeds, (v[0], v[1], a, c, b)


@traced
def _completed(signs, C, G, ahead, limits, h, X, forces, disc):
    """Return the forces and speeds at all contacts; `disc` are its force and the velocity left."""
    k = len(limits)
    r_x, r_y, v_x, v_y = disc
    sticks = [both(one == 0.0, limit > 0.0) for one, limit in zip(signs, limits, strict=True)]
    stuck = [X[0][i] - X[1][i] * r_x - X[2][i] * r_y for i in range(k)]
    found = [where(sticks[i], stuck[i], forces[i]) for i in range(k)]
    speeds = [ahead[i] - h * inner(G[i], (*found, r_x, r_y)) for i in range(k)]
    speeds = [where(one, 0.0, speed) for one, speed in zip(sticks, speeds, strict=True)]
    if _wheel_count(C) == 4:  # without effect: to the middle of the range that the limits allow
        low, high = _idle_range(C, limits, found)
        share = where(both(*sticks[:4]), 0.5 * (low + high), 0.0)
        found = [found[i] + share * _idle_force(C, i) for i in range(4)] + found[4:]
    return (*found, r_x, r_y), (*speeds, v_x, v_y)


@traced
def _distance_at_most(signs, G, limits, forces, speeds, h):
    """Return how far a guess can be from the minimiser, in the norm of the kinetic energy.

    A sticking force beyond its limit leaves a residual. A box that slides against its friction's sign must first be
    stopped, which moves nu, and the residual with it.
    """
    distance = 0.0
    for i, limit in enumerate(limits):
        size = root(G[i][i])
        sticking = h * greatest(abs(forces[i]) - limit, 0.0) * size
        sliding = 2.0 * greatest(-signs[i] * speeds[i], 0.0) / size
        distance = distance + where(limit > 0.0, where(signs[i] == 0.0, sticking, sliding), 0.0)
    return distance


@traced
def _corrected(signs, limits, forces, speeds):
    """Return the next guess: overloaded boxes slide, boxes that slide against their friction stick."""
    found = []
    for i, limit in enumerate(limits):
        stuck = where(abs(forces[i]) > limit, sign(forces[i]), 0.0)
        slides = where(signs[i] * speeds[i] < 0.0, 0.0, signs[i])
        found.append(where(limit > 0.0, where(signs[i] == 0.0, stuck, slides), signs[i]))
    return tuple(found)


@traced
def _first_guess(C, limits, start):
    """Return the boxes' signs if they slide as they do at the step's start."""
    found = []
    for row, limit in zip(C, limits, strict=True):
        terms = [one * rate for one, rate in zip(row, start, strict=True)]
        speed, size = summed(terms), summed(abs(one) for one in terms)
        found.append(where(both(abs(speed) > _AT_REST * size, limit > 0.0), sign(speed), 0.0))
    return tuple(found)


@traced
def _guess_of(code, limits):
    """Return one of all guesses, by its number."""
    return tuple(1.0 * (code // 3**i % 3) - 1.0 for i in range(len(limits)))


@traced
def _guess_count(limits):
    return 3 ** len(limits)


def minimise(
    M: ArrayLike,
    free: ArrayLike,
    C: ArrayLike,
    limits: ArrayLike,
    rolling_force: float,
    h: float,
    start: ArrayLike,
) -> NDArray[np.float64]:
    """Return the velocities after a step with set-valued friction.

    Parameters
    ----------
    M : array_like (5, 5) or (6, 6)
        Mass matrix of (v_x, v_y, w_1, w_2, w_3) and, where the ball may pivot, its spin.
    free : array_like (5,) or (6,)
        Velocities that the step would end with without dry friction.
    C : array_like (n, 5) or (n + 1, 6)
        Rows that give the wheel speeds and, where the ball may pivot, its spin.
    limits : array_like (n,) or (n + 1,), or of as many pairs
        g_i and the largest pivoting friction [N m], not negative; a pair is the limit for a forward and for a
        backward speed.
    rolling_force : float
        N C_rr [N], not negative.
    h : float
        Step [s].
    start : array_like, like `free`
        Velocities at the step's start; a guess of the signs.

    Returns
    -------
    ndarray, like `free`
        Exactly zero where the whole robot sticks.

    Raises
    ------
    InputError
        If shapes disagree, a number is not finite, or a friction or the step is negative.
    """
    mass = real_array(M, ("m", "m"), "The mass matrix")
    m = len(mass)
    if mass.shape not in ((5, 5), (6, 6)):
        raise InputError(f"The mass matrix has the shape {mass.shape}; it must be (5, 5) or (6, 6).")
    rows = real_array(C, ("contacts", m), "The array of the contacts' rows")
    by_direction = np.ndim(limits) == 2
    sizes = real_array(limits, (len(rows), 2)[: 1 + by_direction], "The array of friction limits")
    first, end = real_array(start, (m,), "The start"), real_array(free, (m,), "The array of free velocities")
    rolls, step = real_number(rolling_force, "The rolling friction"), real_number(h, "The step")
    if min(sizes.min(), rolls, step) < 0.0:
        raise InputError(
            "A friction limit, the rolling friction or the step is negative; each must be zero or more."
        )
    if by_direction:  # an asymmetric box is a symmetric one about a force of its own
        end = end - step * np.linalg.solve(mass, rows.T @ (0.5 * (sizes[:, 0] - sizes[:, 1])))
        sizes = 0.5 * sizes.sum(axis=1)
    mass_rows, box_rows = tuple(map(tuple, mass.tolist())), tuple(map(tuple, rows.tolist()))
    ends = (tuple(end.tolist()), tuple(sizes.tolist()), tuple(first.tolist()))
    return np.array(_minimise(mass_rows, ends[0], box_rows, ends[1], rolls, step, ends[2]))


@compiled
def _minimise(M, free, C, limits, rolling_force, h, start):
    return minimiser(M, free, C, limits, rolling_force, h, start)


@called
def minimiser(M, free, C, limits, rolling_force, h, start):
    """Return the velocities of `minimise`, to compiled code."""
    if rest_is_held(M, free, C, limits, rolling_force, h):
        return scale(free, 0.0)
    Y, G = mobility(M, C)
    contacts = (C, Y, G)
    return moving_minimiser(M, free, contacts, _speeds_at(C, free), limits, rolling_force, h, start)[0]


@traced
def _speeds_at(C, nu):
    return (*(inner(row, nu) for row in C), nu[0], nu[1])


@traced
def _energy(M, nu):
    return inner(nu, [inner(row, nu) for row in M])


@called
def moving_minimiser(M, free, contacts, ahead, limits, rolling_force, h, start):
    """Return the velocities of `minimise` for a robot that does not rest, and the contacts' forces and speeds.

    To compiled code; `ahead` are the contacts' speeds at the velocities `free`.
    """
    C, Y, G = contacts
    energy = _energy(M, free)
    forces, speeds = scale(ahead, np.nan), scale(ahead, np.nan)
    if not energy < np.inf:
        return free, forces, speeds  # no number, and it stays to be seen
    enough = _ACCURATE * math.sqrt(energy)

    best_distance = np.inf
    signs = _first_guess(C, limits, start)
    for attempt in range(_GUESSES + _guess_count(limits)):
        if attempt >= _GUESSES:  # the guesses go round in circles: try all
            signs = _guess_of(attempt - _GUESSES, limits)
        X, sliding, _, disc = _eliminated(signs, C, G, ahead, limits, h)
        v_x, v_y, a, c, b = disc
        on_floor = _disc_force(v_x, v_y, a, c, b, rolling_force, h)
        these, those = _completed(signs, C, G, ahead, limits, h, X, sliding, on_floor)
        distance = _distance_at_most(signs, G, limits, these, those, h)
        if distance < best_distance:
            forces, speeds, best_distance = these, those, distance
        if best_distance <= enough:
            break
        signs = _corrected(signs, limits, these, those)
    return _velocities(free, Y, forces, speeds, h), forces, speeds


@traced
def _velocities(free, Y, forces, speeds, h):
    """Return nu_free - h M^-1 C^T lambda; zero, to the bit, where the ball's path or its spin sticks, or everything."""
    nu = list(free)
    for force, row in zip(forces, Y, strict=True):
        nu = advanced(nu, row, -h * force)
    rests = both(speeds[-2] == 0.0, speeds[-1] == 0.0)
    turns = (where(speeds[-3] == 0.0, 0.0, nu[5]),) if len(nu) == 6 else ()
    nu = (where(rests, 0.0, nu[0]), where(rests, 0.0, nu[1]), *nu[2:5], *turns)
    moves = either(*(speed != 0.0 for speed in speeds))
    return where(moves, nu, (0.0,) * len(nu))
