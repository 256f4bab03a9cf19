"""A step in which friction may stick: the minimiser of a strictly convex function (design section 5).

    nu+ = argmin 1/2 (nu - nu_free)^T M (nu - nu_free) + h sum_i g_i |C_i nu| + h rho |nu_xy|

with C_i the row that gives wheel i's speed, g_i = c_i + s_i exp(..) at the step's start and rho = N C_rr. Where the
ball may pivot, its spin is a sixth velocity and pivoting friction one more box (a row of C and its limit, after the
wheels'). It is the implicit Euler step of set-valued friction (J. J. Moreau, Unilateral contact and dry friction in
finite freedom dynamics, 1988). It dissipates always and needs no smoothing.

The holding forces of full stick are tried first, and then rest is exactly zero. Otherwise projected Gauss-Seidel
on the dual (the friction forces) finds which contacts stick, and Newton's method on that set ends in rounding error.
"""

import numpy as np

from ballbot.mechanics.compiled import compiled

_ROUNDS = 40  # Gauss-Seidel sweeps double from round to round up to _MOST_SWEEPS
_MOST_SWEEPS = 512
_NEWTON_STEPS = 25
_LARGEST_SYSTEM = 13  # six velocities, four wheels, the spin, two of the disc


@compiled
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


@compiled
def rest_is_held(M, free, C, limits, rolling, h):
    """Return True where friction can hold the whole robot at rest.

    The forces that stop it, f = M nu_free / h, must come from wheels within their limits and a ground force
    within `rolling`: C_w^T lambda = f_w, then r = f_v - C_v^T lambda, and pivoting likewise. Four wheels leave one
    freedom in lambda.
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
    if not solve_in_place(K, held, 3):
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
    return low <= high and r_x * r_x + r_y * r_y <= rolling * rolling and not pivots


@compiled
def _wheel_count(C):
    """Return the number of wheels: all rows of C, but for the spin's where there is a sixth velocity."""
    return C.shape[0] - (1 if C.shape[1] == 6 else 0)


@compiled
def _idle_force(C, wheel):
    """Return the wheel's part in the forces of four wheels that add up to no torque."""
    a, b, c = (wheel + 1) % 4, (wheel + 2) % 4, (wheel + 3) % 4
    volume = (
        C[a, 2] * (C[b, 3] * C[c, 4] - C[b, 4] * C[c, 3])
        - C[a, 3] * (C[b, 2] * C[c, 4] - C[b, 4] * C[c, 2])
        + C[a, 4] * (C[b, 2] * C[c, 3] - C[b, 3] * C[c, 2])
    )
    return volume if wheel % 2 == 0 else -volume


@compiled
def _responses(M, C):
    """Return M^-1 C_i^T for each wheel and for the ball's x and y, as rows."""
    n, size = C.shape
    Y = np.zeros((n + 2, size))
    for contact in range(n + 2):
        K = M.copy()
        if contact < n:
            Y[contact] = C[contact]
        else:
            Y[contact, contact - n] = 1.0
        solve_in_place(K, Y[contact], size)
    return Y


@compiled
def _sweep(nu, forces, C, Y, limits, rolling, h):
    """One projected Gauss-Seidel pass over the boxes and the disc; returns the largest relative change."""
    n, size = C.shape
    change = 0.0
    for i in range(n):
        if limits[i] > 0.0:
            speed = mobility = 0.0
            for j in range(size):
                speed += C[i, j] * nu[j]
                mobility += C[i, j] * Y[i, j]
            new = min(max(forces[i] + speed / (h * mobility), -limits[i]), limits[i])
            change = max(change, abs(new - forces[i]) / limits[i])
            for j in range(size):
                nu[j] -= h * (new - forces[i]) * Y[i, j]
            forces[i] = new
    if rolling > 0.0:
        # the disc's 2 x 2 mobility is bounded by its largest eigenvalue, which keeps the step a descent
        a, b, c = Y[n, 0], Y[n, 1], Y[n + 1, 1]
        largest = 0.5 * (a + c) + (0.25 * (a - c) ** 2 + b * b) ** 0.5
        r_x, r_y = forces[n] + nu[0] / (h * largest), forces[n + 1] + nu[1] / (h * largest)
        r = (r_x * r_x + r_y * r_y) ** 0.5
        if r > rolling:
            r_x, r_y = r_x * rolling / r, r_y * rolling / r
        change = max(change, (abs(r_x - forces[n]) + abs(r_y - forces[n + 1])) / rolling)
        for j in range(size):
            nu[j] -= h * ((r_x - forces[n]) * Y[n, j] + (r_y - forces[n + 1]) * Y[n + 1, j])
        forces[n], forces[n + 1] = r_x, r_y
    return change


@compiled
def _newton_on_active_set(nu, forces, M, free, C, limits, rolling, h):
    """Move nu to the minimiser among motions whose sticking contacts stick and sliding ones keep their sign.

    Which they are is read off `forces` (inside or at the limit). Returns False where the guess is not the
    minimiser's: a sticking force beyond its limit, a sliding speed of the other sign, or no convergence.
    """
    n, velocities = C.shape
    compliance = -1e-13 * h if _wheel_count(C) == 4 else 0.0
    disc_slides = rolling > 0.0 and forces[n] ** 2 + forces[n + 1] ** 2 >= (rolling * (1.0 - 1e-9)) ** 2
    disc_sticks = rolling > 0.0 and not disc_slides
    K = np.empty((_LARGEST_SYSTEM, _LARGEST_SYSTEM))
    right = np.empty(_LARGEST_SYSTEM)
    stuck = np.empty(_LARGEST_SYSTEM, np.int64)
    if disc_sticks:
        nu[0] = nu[1] = 0.0
    elif disc_slides and nu[0] == 0.0 and nu[1] == 0.0:
        return False
    for _ in range(_NEWTON_STEPS):
        size = velocities
        K[:, :] = 0.0
        K[:velocities, :velocities] = M
        for i in range(velocities):
            right[i] = 0.0
            for j in range(velocities):
                right[i] -= M[i, j] * (nu[j] - free[j])
        for wheel in range(n):
            if limits[wheel] <= 0.0:
                continue
            if abs(forces[wheel]) >= limits[wheel]:
                for j in range(velocities):
                    right[j] -= h * forces[wheel] * C[wheel, j]
            else:
                right[size] = 0.0
                for j in range(velocities):
                    K[size, j] = K[j, size] = C[wheel, j]
                    right[size] -= C[wheel, j] * nu[j]
                # four wheels hold with three independent forces: a tiny compliance picks the least
                K[size, size] = compliance
                stuck[size] = wheel
                size += 1
        if disc_slides:
            speed = (nu[0] * nu[0] + nu[1] * nu[1]) ** 0.5
            n_x, n_y = nu[0] / speed, nu[1] / speed
            right[0] -= h * rolling * n_x
            right[1] -= h * rolling * n_y
            K[0, 0] += h * rolling * n_y * n_y / speed
            K[1, 1] += h * rolling * n_x * n_x / speed
            K[0, 1] -= h * rolling * n_x * n_y / speed
            K[1, 0] = K[0, 1]
        if disc_sticks:
            for axis in range(2):
                K[size, axis] = K[axis, size] = 1.0
                right[size] = 0.0
                stuck[size] = n + axis
                size += 1
        if not solve_in_place(K, right, size):
            return False
        largest = step = 0.0
        for j in range(velocities):
            nu[j] += right[j]
            step, largest = max(step, abs(right[j])), max(largest, abs(nu[j]))
        if disc_sticks:
            nu[0] = nu[1] = 0.0
        if velocities == 6 and limits[n - 1] > 0.0 and abs(forces[n - 1]) < limits[n - 1]:
            nu[5] = 0.0  # the spin's row holds nothing else: to the bit, so that RK4 sees a ball at rest
        if not step < np.inf:
            return False
        if step <= 1e-14 * largest or not disc_slides:
            return _is_minimiser(nu, forces, right, stuck, size, C, limits, rolling, h)
        if step <= 1e-12 * largest and step <= 1e-15:
            return _is_minimiser(nu, forces, right, stuck, size, C, limits, rolling, h)
    return False


@compiled
def _is_minimiser(nu, forces, multipliers, stuck, size, C, limits, rolling, h):
    """Check the optimality of Newton's point; the sticking forces go into `forces`."""
    n, velocities = C.shape
    for place in range(velocities, size):
        forces[stuck[place]] = multipliers[place] / h
    for wheel in range(n):
        if limits[wheel] <= 0.0:
            continue
        speed = scale = 0.0
        for j in range(velocities):
            speed += C[wheel, j] * nu[j]
            scale += abs(C[wheel, j] * nu[j])
        slides = True
        for place in range(velocities, size):
            slides = slides and stuck[place] != wheel
        if slides and speed * forces[wheel] < -1e-13 * scale * limits[wheel]:
            return False
        if not slides and abs(forces[wheel]) > limits[wheel] * (1.0 + 1e-12):
            return False
    disc_sticks = size > velocities and stuck[size - 1] == n + 1
    return not (disc_sticks and forces[n] ** 2 + forces[n + 1] ** 2 > (rolling * (1.0 + 1e-12)) ** 2)


@compiled
def minimise(M, free, C, limits, rolling, h, start):
    """Return the velocities after a step with set-valued friction.

    Parameters
    ----------
    M : ndarray (5, 5) or (6, 6)
        Mass matrix of (v_x, v_y, w_1, w_2, w_3) and, where the ball may pivot, its spin.
    free : ndarray (5,) or (6,)
        Velocities that the step would end with without dry friction.
    C : ndarray (n, 5) or (n + 1, 6)
        Rows that give the wheel speeds and, where the ball may pivot, its spin.
    limits : ndarray (n,) or (n + 1,)
        g_i and the largest pivoting friction [N m], not negative.
    rolling : float
        N C_rr [N], not negative.
    h : float
        Step [s].
    start : ndarray, like `free`
        Velocities at the step's start; a guess of the signs.

    Returns
    -------
    ndarray, like `free`
        Exactly zero where the whole robot sticks.
    """
    n, size = C.shape
    if rest_is_held(M, free, C, limits, rolling, h):
        return np.zeros(size)
    Y = _responses(M, C)
    nu = free.copy()
    forces = np.zeros(n + 2)
    for i in range(n):
        speed = 0.0
        for j in range(size):
            speed += C[i, j] * start[j]
        forces[i] = limits[i] * np.sign(speed)
        nu -= h * forces[i] * Y[i]
    polished, trial_forces = np.empty(size), np.empty(n + 2)
    sweeps = 2
    for _ in range(_ROUNDS):
        change = 0.0
        for _ in range(sweeps):
            change = _sweep(nu, forces, C, Y, limits, rolling, h)
        polished[:] = nu
        trial_forces[:] = forces
        if _newton_on_active_set(polished, trial_forces, M, free, C, limits, rolling, h):
            return polished
        if change < 1e-15 or not change < np.inf:
            break
        sweeps = min(2 * sweeps, _MOST_SWEEPS)
    return nu
