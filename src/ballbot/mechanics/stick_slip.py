"""A step in which friction may stick: the minimiser of a strictly convex function (docs/mechanics.md).

    nu+ = argmin 1/2 (nu - nu_free)^T M (nu - nu_free) + h sum_i g_i |C_i nu| + h rho |nu_xy|

with C_i the row that gives wheel i's speed, g_i its dry friction at the step's start and rho = N C_rr. A friction that
differs with direction, g+ and g-, is the symmetric one of (g+ + g-)/2 about the force (g+ - g-)/2, which belongs to
nu_free: g+ max(v, 0) + g- max(-v, 0) = (g+ + g-)/2 |v| + (g+ - g-)/2 v. Where the
ball may pivot, its spin is a sixth velocity and pivoting friction one more box (a row of C and its limit, after the
wheels'). It is the implicit step of set-valued friction (J. J. Moreau, Unilateral contact and dry friction in
finite freedom dynamics, 1988). It dissipates always and needs no smoothing. The engine takes it twice, the second time
with the forces half way through the step (`ballbot.mechanics.contacts`), which makes it one of order two.

The unknowns are the friction forces lambda: one in each box (wheels, and the spin where the ball pivots) and the two
of the disc. With G = C M^-1 C^T (C with rows for the ball's x and y, last), b = C nu_free and any kappa > 0 the
optimality conditions are

    lambda = P(s),   s = lambda + kappa (b - h G lambda),   P the projection on boxes and disc.

`newton_round` is a round of a semi-smooth Newton method (L. Qi and J. Sun, A nonsmooth version of Newton's method,
1993): with T the derivative of P, it solves (I - T + T kappa h G) lambda = T kappa b + P(s) - T s. From a good guess
few rounds suffice, none with a branch, so that a loop over robots is vector code (`engine/convex.py`). They may go
round in circles, and G is singular for four wheels, which can strain against each other. `found_forces` therefore
begins its rounds after sweeps of Gauss and Seidel's method, which always converges, and goes on from the best of what
lies between them and the rounds' forces (as in J. J. More and G. Toraldo, On the solution of large quadratic
programming problems with bound constraints, 1991). It eases G by a little in its sticking contacts, about the forces
before, so that the eased solution has no error once these no longer change.

The error of the optimality conditions bounds that of nu, since the step is a projection in the norm of the kinetic
energy. Here G and b are those above with each row multiplied by kappa h and kappa (`scaled_matrix`).
"""

import numpy as np

from ballbot.mechanics.engine.compiled import inlined
from ballbot.mechanics.engine.tracing import both, either, greatest, least, root, traced, where
from ballbot.mechanics.engine.vector import inner, scale, solve_dense, subtract, summed

_DISC_TOLERANCE = 1e-13  # of the disc's force, change in the last round
_TRIES, _SWEEPS, _ROUNDS = 100, 2, 4  # of Newton's method, each after so many sweeps and of so many rounds
_SHARES = (1.0, 0.5, 0.25, 0.1)  # of the way to what the rounds found
_EASING = 1e-8  # of G_ii
_ACCURATE = 5e-14  # error of the optimality conditions, over |b|
_AT_REST = 1e-12  # speed of every contact, over |b|, at which the whole robot rests


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


def _projection(s, limits, rolling_force):
    """Return P(s)."""
    boxes = tuple(least(greatest(value, -limit), limit) for value, limit in zip(s, limits, strict=False))
    return boxes + _disc_projection(s[-2], s[-1], rolling_force)


def newton_round(s, G, b, limits, rolling_force, easing=0.0):
    """Return (forces, their probe s, settled): one round from a probe, and 1 where it left every contact's state.

    `easing` is added to G_ii where a contact sticks, about the forces P(s).
    """
    k, m = len(limits), len(s)
    x, y = k, k + 1
    T = [[0.0] * m for _ in range(m)]
    for i, limit in enumerate(limits):
        T[i][i] = where(abs(s[i]) < limit, 1.0, 0.0)  # 1 inside, where the contact sticks
    T[x][x], T[y][y], T[x][y] = _disc_derivative(s[x], s[y], rolling_force)
    T[y][x] = T[x][y]
    P = _projection(s, limits, rolling_force)
    rows, right = [], []
    for i in range(m):
        coupled = (i,) if i < k else (i, x + y - i)
        row = [inner([T[i][j] for j in coupled], [G[j][column] for j in coupled]) for column in range(m)]
        for j in coupled:
            row[j] = row[j] + (1.0 - T[i][j] if i == j else -T[i][j])
        known = [b[j] - s[j] for j in coupled]
        if easing:
            row[i] = row[i] + easing * T[i][i]
            known[0] = known[0] + easing * P[i]
        rows.append(row)
        right.append(inner([T[i][j] for j in coupled], known) + P[i])
    forces = solve_dense(rows, right)
    after = probe_of(forces, G, b)
    same = _disc_agrees(s[x], s[y], after[x], after[y], forces[x], forces[y], rolling_force)
    for i, limit in enumerate(limits):
        same = both(same, _agrees(s[i], after[i], limit))
    return forces, after, where(same, 1.0, 0.0)


@traced
def probe_of(forces, G, b):
    """Return s of forces."""
    return tuple(force + b_i - inner(row, forces) for force, b_i, row in zip(forces, b, G, strict=True))


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


@traced
def _sweep(forces, G, b, limits, rolling_force):
    """Return the forces after one sweep of Gauss and Seidel's method: each box, then the disc, by itself."""
    x = list(forces)
    for i, limit in enumerate(limits):
        x[i] = least(greatest(x[i] + b[i] - inner(G[i], x), -limit), limit)
    k = len(limits)
    rate = 1.0 / (1.0 + abs(G[k][k + 1]))  # 1 is the larger of both G_ii
    p, q = (x[i] + rate * (b[i] - inner(G[i], x)) for i in (k, k + 1))
    return (*x[:k], *_disc_projection(p, q, rolling_force))


@traced
def _eased_round(s, G, b, limits, rolling_force):
    """Return the forces after one eased round, their probe and the error of the optimality conditions."""
    forces, after, _ = newton_round(s, G, b, limits, rolling_force, _EASING)
    return forces, after, largest_of(subtract(_projection(after, limits, rolling_force), forces))


@traced
def largest_of(numbers):
    """Return the largest size of numbers; NaN if the sum of all is."""
    most, total = 0.0, 0.0
    for number in numbers:
        most, total = greatest(most, abs(number)), total + number
    return where(total == total, most, total)


@traced
def _best_between(forces, target, G, b, rates, limits, rolling_force):
    """Return what has the least energy of these forces and of those allowed on the way to the forces `target`."""
    best, least_energy = forces, _energy(forces, G, b, rates)
    for share in _SHARES:
        way = tuple(force + share * (other - force) for force, other in zip(forces, target, strict=True))
        allowed = _projection(way, limits, rolling_force)
        energy = _energy(allowed, G, b, rates)
        best, least_energy = where(energy < least_energy, (allowed, energy), (best, least_energy))
    return best


def _energy(forces, G, b, rates):
    """Return 1/2 h lambda^T G lambda - lambda^T C nu_free, which the forces sought make least."""
    return summed(
        force * (0.5 * inner(row, forces) - b_i) / rate
        for force, row, b_i, rate in zip(forces, G, b, rates, strict=True)
    )


@inlined
def found_forces(G, b, rates, limits, rolling_force):
    """Return the friction forces and their probe, whatever the problem; NaN if a number of b is."""
    largest, forces = largest_of(b), scale(b, 0.0)
    if not largest < np.inf:
        return scale(b, np.nan), scale(b, np.nan)
    for _ in range(_TRIES):
        for _ in range(_SWEEPS):
            forces = _sweep(forces, G, b, limits, rolling_force)
        first, s = forces, probe_of(forces, G, b)
        eased = forces
        for k in range(_ROUNDS):
            eased, s, error = _eased_round(s, G, b, limits, rolling_force)
            if error <= _ACCURATE * largest:
                return eased, s
            if k == 0:
                first = eased
        forces = _best_between(forces, first, G, b, rates, limits, rolling_force)
        forces = _best_between(forces, eased, G, b, rates, limits, rolling_force)
    return forces, probe_of(forces, G, b)


@traced
def all_rest(forces, s, b):
    """Return 1 if every contact's speed is rounding, else 0."""
    return where(largest_of(subtract(s, forces)) <= _AT_REST * largest_of(b), 1.0, 0.0)


@traced
def scaled_matrix(G, h):
    """Return (kappa h G, kappa) with kappa = 1/(h G_ii) in each box, and one for both of the disc."""
    stiffest = greatest(G[-2][-2], G[-1][-1])
    inverses = [1.0 / G[i][i] for i in range(len(G) - 2)] + [1.0 / stiffest] * 2
    rate = 1.0 / h
    return tuple(scale(row, inverse) for row, inverse in zip(G, inverses, strict=True)), scale(inverses, rate)


@traced
def less_response(free, Y, forces, h):
    """Return nu_free - h Y^T lambda, Y = M^-1 C^T by rows."""
    return tuple(free[j] - h * inner([row[j] for row in Y], forces) for j in range(len(free)))


@traced
def still_where_held(v, s, limits, rolling_force):
    """Return v with zero, to the bit, where the floor holds the ball's path or its spin.

    The probe decides, not the force: a sliding contact's force is at its limit but for rounding, its probe beyond.
    """
    path = where(s[-2] * s[-2] + s[-1] * s[-1] < rolling_force * rolling_force, 0.0, 1.0)
    if len(v) == 2:
        return v[0] * path, v[1] * path
    return v[0] * path, v[1] * path, v[2] * where(abs(s[-3]) < limits[-1], 0.0, 1.0)


@inlined
def minimiser(M, free, C, limits, rolling_force, h):
    """Return the velocities after a step h [s] with set-valued friction, as tuples; exactly zero where all sticks.

    M by rows is the mass matrix of (v_x, v_y, w_1, w_2, w_3) and, where the ball may pivot, its spin; `free` the
    velocities that the step would end with without dry friction. The rows C give the wheel speeds and the spin;
    `limits` are g_i and the largest pivoting friction [N m]; `rolling_force` is N C_rr [N].
    """
    Y, G, b, rates = _problem(M, free, C, h)
    forces, s = found_forces(G, b, rates, limits, rolling_force)
    return _velocities(free, Y, forces, s, b, limits, rolling_force, h)


@traced
def _problem(M, free, C, h):
    """Return Y = M^-1 C^T by rows, G, b and kappa; the contacts are the boxes, of rows C, then the ball's x and y."""
    m = len(M)
    rows = (*C, *(tuple(1.0 if i == j else 0.0 for j in range(m)) for i in (0, 1)))
    Y = tuple(solve_dense(M, row) for row in rows)
    G, rates = scaled_matrix(tuple(tuple(inner(row, response) for response in Y) for row in rows), h)
    return Y, G, tuple(rate * inner(row, free) for rate, row in zip(rates, rows, strict=True)), rates


@traced
def _velocities(free, Y, forces, s, b, limits, rolling_force, h):
    """Return nu_free - h M^-1 C^T lambda; zero, to the bit, where the ball's path or its spin sticks, or everything."""
    nu = scale(less_response(free, Y, forces, h), 1.0 - all_rest(forces, s, b))
    v = still_where_held(nu[:2] + nu[5:], s, limits, rolling_force)
    return v[:2] + nu[2:5] + v[2:]
