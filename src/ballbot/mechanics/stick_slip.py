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
from ballbot.mechanics.engine.arrays import fill
from ballbot.mechanics.engine.compiled import called, compiled
from ballbot.mechanics.friction import sign

_GUESSES = 12
_ACCURATE = 1e-14  # distance to the minimiser, over |nu_free|, at which the search for a better guess ends
_AT_REST = 1e-12  # of a speed's terms, below which the speed is rounding
_DISC_STEPS = 60


@called
def solve_in_place(K, right, size):
    """Solve K x = right by Gaussian elimination with partial pivoting; both are overwritten, x is in `right`.

    Returns False where K is singular.
    """
    for column in range(size):
        pivot = column
        for row in range(column + 1, size):
            if abs(K[row, column]) > abs(K[pivot, column]):
                pivot = row
        if not abs(K[pivot, column]) > 0.0:
            return False
        if pivot != column:
            for j in range(column, size):
                K[column, j], K[pivot, j] = K[pivot, j], K[column, j]
            right[column], right[pivot] = right[pivot], right[column]
        for row in range(column + 1, size):
            factor = K[row, column] / K[column, column]
            for j in range(column + 1, size):
                K[row, j] -= factor * K[column, j]
            right[row] -= factor * right[column]
    for row in range(size - 1, -1, -1):
        for j in range(row + 1, size):
            right[row] -= K[row, j] * right[j]
        right[row] /= K[row, row]
    return True


@called
def rest_is_held(M, free, C, limits, rolling_force, h):
    """Return True where friction can hold the whole robot at rest.

    The forces that stop it, f = M nu_free / h, must come from wheels within their limits and a ground force
    within `rolling_force`: C_w^T lambda = f_w, then r = f_v - C_v^T lambda, and pivoting likewise. Four wheels leave
    one freedom in lambda.
    """
    size = len(free)
    n = _wheel_count(C)
    needed = np.zeros(6)
    for i in range(size):
        for j in range(size):
            needed[i] += M[i, j] * free[j] / h
    held = needed[2:5].copy()
    K = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            for wheel in range(n):
                K[i, j] += C[wheel, 2 + i] * C[wheel, 2 + j]
    if not solve_in_place(K, held, len(held)):
        return False
    r_x, r_y, pivot = needed[0], needed[1], needed[5]
    low, high = -np.inf, np.inf
    for wheel in range(n):
        force = C[wheel, 2] * held[0] + C[wheel, 3] * held[1] + C[wheel, 4] * held[2]
        r_x -= C[wheel, 0] * force
        r_y -= C[wheel, 1] * force
        if size == 6:
            pivot -= C[wheel, 5] * force
        idle = _idle_force(C, wheel) if n == 4 else 0.0
        if idle == 0.0:
            if not abs(force) <= limits[wheel]:
                return False
        else:
            ends = (-limits[wheel] - force) / idle, (limits[wheel] - force) / idle
            low, high = max(low, min(ends)), min(high, max(ends))
    pivots = size == 6 and not abs(pivot) <= limits[n]
    return low <= high and r_x * r_x + r_y * r_y <= rolling_force * rolling_force and not pivots


@called
def _wheel_count(C):
    """Return the number of wheels: all rows of C, but for the spin's where there is a sixth velocity."""
    return C.shape[0] - (1 if C.shape[1] == 6 else 0)


@called
def _idle_force(C, wheel):
    """Return the wheel's part in the forces of four wheels that add up to no torque."""
    a, b, c = (wheel + 1) % 4, (wheel + 2) % 4, (wheel + 3) % 4
    volume = (
        C[a, 2] * (C[b, 3] * C[c, 4] - C[b, 4] * C[c, 3])
        - C[a, 3] * (C[b, 2] * C[c, 4] - C[b, 4] * C[c, 2])
        + C[a, 4] * (C[b, 2] * C[c, 3] - C[b, 3] * C[c, 2])
    )
    return volume if wheel % 2 == 0 else -volume


@called
def contact_rows(C):
    """Return the rows (n + 2, m) that give the speeds at all contacts: those of the boxes, then the ball's x and y."""
    n, m = C.shape
    rows = np.zeros((n + 2, m))
    for box in range(n):
        fill(rows[box], C[box])
    rows[n, 0] = rows[n + 1, 1] = 1.0
    return rows


@called
def mobility(M, rows):
    """Return Y (contacts, m) and G (contacts, contacts): velocities and contact speeds per unit force at each."""
    count, m = rows.shape
    Y, G = np.empty((count, m)), np.zeros((count, count))
    for contact in range(count):
        K = M.copy()
        fill(Y[contact], rows[contact])
        solve_in_place(K, Y[contact], m)
    for i in range(count):
        for j in range(count):
            for velocity in range(m):
                G[i, j] += rows[i, velocity] * Y[j, velocity]
    return Y, G


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


@called
def _sticking(signs, C, limits, stuck):
    """Fill `stuck` with the boxes that stick; return their number, and whether four wheels do.

    Four sticking wheels can strain against each other: then the last is left out, and has no force of its own.
    """
    count = 0
    four = False
    for i in range(len(limits)):
        if signs[i] == 0.0 and limits[i] > 0.0:
            if i == 3 and count == 3 and _wheel_count(C) == 4:
                four = True
            else:
                stuck[count] = i
                count += 1
    return count, four


@called
def _speeds_under(forces, G, ahead, h, count, speeds):
    """Fill the speeds at all contacts under the first `count` contacts' forces."""
    for i in range(len(ahead)):
        speeds[i] = ahead[i]
        for j in range(count):
            speeds[i] -= h * G[i, j] * forces[j]


@called
def _forces_of_guess(signs, C, G, ahead, limits, rolling_force, h, forces, speeds):
    """Fill the forces and speeds that follow from a guess: signs[i] is 0 where a box sticks. Returns False if none do.

    The sticking boxes' forces are X_0 - X_1 r_x - X_2 r_y, with r the disc's.
    """
    n = len(limits)
    stuck = np.empty(n, np.int64)
    count, four = _sticking(signs, C, limits, stuck)
    for i in range(n):
        forces[i] = limits[i] * signs[i]
    _speeds_under(forces, G, ahead, h, n, speeds)
    X, K = np.zeros((3, n)), np.empty((n, n))
    for column in range(3):
        for i in range(count):
            X[column, i] = speeds[stuck[i]] / h if column == 0 else G[stuck[i], n + column - 1]
            for j in range(count):
                K[i, j] = G[stuck[i], stuck[j]]
        if not solve_in_place(K, X[column], count):
            return False
    v_x, v_y, a, c, b = speeds[n], speeds[n + 1], G[n, n], G[n + 1, n + 1], G[n, n + 1]
    for i in range(count):
        v_x -= h * G[n, stuck[i]] * X[0, i]
        v_y -= h * G[n + 1, stuck[i]] * X[0, i]
        a -= G[n, stuck[i]] * X[1, i]
        c -= G[n + 1, stuck[i]] * X[2, i]
        b -= G[n, stuck[i]] * X[2, i]
    forces[n], forces[n + 1], v_x, v_y = _disc_force(v_x, v_y, a, c, b, rolling_force, h)
    for i in range(count):
        forces[stuck[i]] = X[0, i] - X[1, i] * forces[n] - X[2, i] * forces[n + 1]
    _speeds_under(forces, G, ahead, h, n + 2, speeds)
    for i in range(count):
        speeds[stuck[i]] = 0.0
    speeds[n], speeds[n + 1] = v_x, v_y
    if four:
        speeds[3] = 0.0
        _share_idle_force(C, limits, forces)
    return True


@called
def _share_idle_force(C, limits, forces):
    """Add forces without effect to those of four sticking wheels, to the middle of the range that the limits allow."""
    low, high = -np.inf, np.inf
    for wheel in range(4):
        idle = _idle_force(C, wheel)
        if idle != 0.0 and limits[wheel] > 0.0:
            ends = (-limits[wheel] - forces[wheel]) / idle, (limits[wheel] - forces[wheel]) / idle
            low, high = max(low, min(ends)), min(high, max(ends))
    for wheel in range(4):
        forces[wheel] += 0.5 * (low + high) * _idle_force(C, wheel)


@called
def _distance_at_most(signs, G, limits, forces, speeds, h):
    """Return how far a guess can be from the minimiser, in the norm of the kinetic energy.

    A sticking force beyond its limit leaves a residual. A box that slides against its friction's sign must first be
    stopped, which moves nu, and the residual with it.
    """
    distance = 0.0
    for i in range(len(limits)):
        if limits[i] > 0.0:
            if signs[i] == 0.0:
                distance += h * max(abs(forces[i]) - limits[i], 0.0) * math.sqrt(G[i, i])
            else:
                distance += 2.0 * max(-signs[i] * speeds[i], 0.0) / math.sqrt(G[i, i])
    return distance


@called
def _correct(signs, limits, forces, speeds):
    """Make the next guess: overloaded boxes slide, boxes that slide against their friction stick."""
    for i in range(len(limits)):
        if limits[i] > 0.0:
            if signs[i] == 0.0:
                if abs(forces[i]) > limits[i]:
                    signs[i] = sign(forces[i])
            elif signs[i] * speeds[i] < 0.0:
                signs[i] = 0.0


@called
def _try_all(best, best_distance, enough, C, G, ahead, limits, rolling_force, h):
    """Put forces and speeds of the best guess of all into the rows of `best`."""
    n = len(limits)
    signs, forces, speeds = np.empty(n), np.empty(n + 2), np.empty(n + 2)
    for code in range(3**n):
        rest = code
        for i in range(n):
            signs[i] = rest % 3 - 1.0
            rest //= 3
        if _forces_of_guess(signs, C, G, ahead, limits, rolling_force, h, forces, speeds):
            distance = _distance_at_most(signs, G, limits, forces, speeds, h)
            if distance < best_distance:
                fill(best[0], forces)
                fill(best[1], speeds)
                best_distance = distance
            if best_distance <= enough:
                return


@called
def _first_guess(signs, C, limits, start):
    """Let boxes slide as they do at the step's start."""
    n, m = C.shape
    for i in range(n):
        speed = terms = 0.0
        for j in range(m):
            speed += C[i, j] * start[j]
            terms += abs(C[i, j] * start[j])
        signs[i] = sign(speed) if abs(speed) > _AT_REST * terms and limits[i] > 0.0 else 0.0


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
    return _minimise(mass, end, rows, sizes, rolls, step, first)


@compiled
def _minimise(M, free, C, limits, rolling_force, h, start):
    return minimiser(M, free, C, limits, rolling_force, h, start)


@called
def minimiser(M, free, C, limits, rolling_force, h, start):
    """Return the velocities of `minimise`, to compiled code."""
    n, m = C.shape
    if rest_is_held(M, free, C, limits, rolling_force, h):
        return np.zeros(m)
    Y, G = mobility(M, contact_rows(C))
    contacts = (C, Y, G)
    ahead = np.zeros(n + 2)
    ahead[n], ahead[n + 1] = free[0], free[1]
    for i in range(m):
        for j in range(n):
            ahead[j] += C[j, i] * free[i]
    return moving_minimiser(M, free, contacts, ahead, limits, rolling_force, h, start, np.empty((2, n + 2)))


@called
def moving_minimiser(M, free, contacts, ahead, limits, rolling_force, h, start, best):
    """Return the velocities of `minimise` for a robot that does not rest, to compiled code.

    `contacts` are C, and Y and G of `mobility`; `ahead` the contacts' speeds at the velocities `free`. `best`
    (2, n + 2) is filled with the contacts' friction forces and speeds.
    """
    m, (C, Y, G) = len(free), contacts
    energy = 0.0
    for i in range(m):
        for j in range(m):
            energy += free[i] * M[i, j] * free[j]
    if not energy < np.inf:
        for i in range(len(ahead)):
            best[0, i] = best[1, i] = np.nan
        return free.copy()  # no number, and it stays to be seen
    enough = _ACCURATE * math.sqrt(energy)

    n = len(limits)
    signs, forces, speeds = np.empty(n), np.zeros(n + 2), np.empty(n + 2)
    best_distance = np.inf
    _first_guess(signs, C, limits, start)
    for _ in range(_GUESSES):
        if not _forces_of_guess(signs, C, G, ahead, limits, rolling_force, h, forces, speeds):
            break
        distance = _distance_at_most(signs, G, limits, forces, speeds, h)
        if distance < best_distance:
            fill(best[0], forces)
            fill(best[1], speeds)
            best_distance = distance
        if best_distance <= enough:
            break
        _correct(signs, limits, forces, speeds)
    if best_distance > enough:
        _try_all(best, best_distance, enough, C, G, ahead, limits, rolling_force, h)
    return _velocities(free, Y, best[0], best[1], h)


@called
def _velocities(free, Y, forces, speeds, h):
    """Return nu_free - h M^-1 C^T lambda; zero, to the bit, where the ball's path or its spin sticks, or everything."""
    contacts, m = Y.shape
    nu = free.copy()
    for i in range(contacts):
        for j in range(m):
            nu[j] -= h * forces[i] * Y[i, j]
    if speeds[contacts - 2] == 0.0 and speeds[contacts - 1] == 0.0:
        nu[0] = nu[1] = 0.0
    if m == 6 and speeds[contacts - 3] == 0.0:
        nu[5] = 0.0
    moves = False
    for i in range(contacts):
        moves = moves or speeds[i] != 0.0
    return nu if moves else np.zeros(m)
