"""Contacts that slip: wheels on the ball and the ball on the floor have Coulomb friction (docs/mechanics.md).

Where a contact slips, wheels and ball are bodies of their own. With v the ball's centre, w the body, Omega the ball and
q_i the wheels, the speeds at the contacts and the friction there are

    wheels  sigma_i = q_i - a_i . (R^T Omega - w)         |l_i| <= mu r_w N_i, against sigma_i
    floor   c = v - r_b Omega x e_z                       |F| <= mu_f N, against c

(a_i: the rows of A). The loads N_i and N, and so the limits, follow from the accelerations and the l_i (`loads`).

A step is first taken without slip. If a contact would need more than its limit, or slips already (`mark_slips`), the
lane's step is taken again (`slip_steps`): one implicit solution for the gears, the drivelines' dry friction, tractions
and loads. As in `contacts`, it is found twice, the second time with the forces half way, so that it has order two while
each contact stays as it is. Rigid gears are gears without play. A wheel that is lifted has no traction.

Forces come in blocks of two: a wheel's gear torque and traction, the floor's force, the friction of a spin that there
is. Each block is law(K f + k). A round is a sweep (Gauss and Seidel's method) and a step of Newton's method, whose
derivatives are differences, exact where a law is linear; the one with the smaller error counts.
"""

from typing import NamedTuple

from ballbot.mechanics.contacts import finished, half_turned, wheel_side
from ballbot.mechanics.driveline import braked, through_play
from ballbot.mechanics.engine.compiled import inlined
from ballbot.mechanics.engine.lanes import (
    AHEAD,
    ANGLE,
    BODY,
    FLOOR,
    GRIP,
    LOAD,
    MOTOR,
    PLAY,
    PRESSING,
    ROTOR,
    SLIDES,
    SLIP,
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
from ballbot.mechanics.engine.smooth import ball_velocity, body_velocity, is_upright
from ballbot.mechanics.engine.tracing import both, either, greatest, lanes, least, root, traced, where
from ballbot.mechanics.engine.vector import (
    add,
    advanced,
    cross,
    dot,
    inner,
    rotate,
    rotate_back,
    scale,
    solve_dense,
    subtract,
    symmetric_times,
)
from ballbot.mechanics.equations import (
    Attitude,
    Terms,
    balancing_attitude,
    ball_rate,
    ball_torque,
    forces_in,
    solve,
    solve_symmetric,
    terms_exact,
    wheel_speeds,
)
from ballbot.mechanics.friction import dry_friction, friction_shift
from ballbot.mechanics.parameters import Pivoting, RobotNumbers
from ballbot.mechanics.stick_slip import largest_of

_ROUNDS = 32
_ACCURATE = 1e-13  # error of the forces, over the largest
_FAR = 1e12  # of a slip, beyond each limit
_DIFFERENCE = 1e-6  # of what a law is given, for its derivative
_E, _ZEROS = (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)


@traced
def loads(P, R, pressing, body, w, accelerations, traction):
    """Return N_i of each wheel and the floor's force (3) on the ball [N].

    `pressing` is a row of `pack_contacts`, `body` the body's weight less what pushes it [N], `accelerations`
    (v_dot, w_dot), and `traction` what each wheel drives the ball with, f_i r_w [N m].
    """
    n, (v_dot, w_dot) = len(traction), accelerations
    along, turning = (v_dot[0], v_dot[1], 0.0), add(cross(w_dot, _E), cross(w, cross(w, _E)))
    force = add(rotate_back(R, advanced(body, along, pressing[0])), scale(turning, P.ml))
    rows = [[pressing[2 + 3 * i + j] for j in range(3)] for i in range(n)]
    more = [[pressing[2 + 3 * n + n * i + j] for j in range(n)] for i in range(n)]
    pressed = tuple(dot(row, force) + inner(by, traction) for row, by in zip(rows, more, strict=True))
    return pressed, add(advanced(P.weight, along, P.weighed), scale(rotate(R, turning), P.ml))


def _pressing_in(selected, work, lane):
    n = len(selected.wheels)
    return restored((0.0,) * (2 + 3 * n + n * n), work, PRESSING, lane)


def _slip_in(selected, work, lane):
    """Return the slip of a lane's wheels, and of its ball in x and y."""
    slip = restored((0.0,) * 6, work, SLIP, lane)
    return (*slip[: len(selected.wheels)], *slip[4:])


@traced
def mark_slips(selected, work, width):
    """Leave each lane's floor load, and mark those that slip, or would on the way to the trial: their step is zero."""
    for lane in lanes(0, width):
        P, state = load(selected, work, lane), restored(state_like(selected), work, STATE, lane)
        trial, h = restored(state_like(selected), work, TRIAL, lane), entry(work, STEP, lane)
        rate, a = where(h > 0.0, 1.0 / h, 0.0), balancing_attitude((state[2], state[3], state[4]))
        v_dot, w_dot = (scale(subtract(of(trial), of(state)), rate) for of in (ball_velocity, body_velocity))
        v, w = (scale(add(of(trial), of(state)), 0.5) for of in (ball_velocity, body_velocity))
        z = rotate_back(a.R, ball_rate(P.inv_rb, v))
        z_dot = add(rotate_back(a.R, ball_rate(P.inv_rb, v_dot)), cross(z, w))
        # the body's angular momentum gives the torque A^T l on the ball; of four wheels, the tractions of least norm
        H, H_dot = (
            add(symmetric_times(P.J, of_body), scale(symmetric_times(P.D, subtract(of_body, z)), P.d3 - P.d2))
            for of_body, z in ((w, z), (w_dot, z_dot))
        )
        falling = rotate_back(a.R, add(P.gravity, (v_dot[0], v_dot[1], 0.0)))
        torque = subtract(scale(cross(falling, _E), P.ml), add(H_dot, cross(w, H)))
        even = solve_symmetric(P.D, torque)
        traction = tuple(dot(wheel.axle, even) for wheel in P.wheels)
        pressing, body = _pressing_in(selected, work, lane), restored(_E, work, BODY, lane)
        N, F = loads(P, a.R, pressing, body, w, (v_dot, w_dot), traction)
        grip, floor_grip = restored((0.0, 0.0), work, GRIP, lane)
        most = tuple(greatest(one, 0.0) * grip / pressing[1] for one in N)
        most_F = greatest(F[2], 0.0) * floor_grip
        slips = either(
            F[0] * F[0] + F[1] * F[1] > most_F * most_F,
            largest_of(_slip_in(selected, work, lane)) > 0.0,
            *(abs(one) > limit for one, limit in zip(traction, most, strict=True)),
        )
        slips = both(slips, grip > 0.0)
        put(work, FLOOR, lane, F[2])
        put(work, SLIDES, lane, where(slips, h, 0.0))
        put(work, STEP, lane, where(slips, 0.0, h))


class SlipProblem(NamedTuple):
    """The equation f = law(K f + k) of the forces f. Each block's law takes three numbers, the last one its limit."""

    K: tuple
    k: tuple
    own: tuple  #: of each wheel: what its law has besides


class _Step(NamedTuple):
    """A lane's robot with its contacts apart, where a step's forces are taken.

    Velocities and accelerations are flat: of the ball's centre (2), the body (3, in its frame), the ball (3) and the
    wheels (n, relative to the body).
    """

    P: RobotNumbers  #: the wheels' spin about their axles is not in it
    j_w: float
    a: Attitude
    system: Terms
    f_w: tuple
    brake: tuple  #: the ball's acceleration by rolling friction
    burden: tuple  #: torques on the wheels themselves
    w: tuple
    body: tuple  #: see `loads`
    turned: tuple  #: what the turning of the contacts' directions adds to the wheels' slip by the step's end


@traced
def _start(selected, work, lane):
    """Return the velocities at a lane's start, and the motors' speeds."""
    P, state = load(selected, work, lane), restored(state_like(selected), work, STATE, lane)
    a, v, w = balancing_attitude((state[2], state[3], state[4])), ball_velocity(state), body_velocity(state)
    *slip, c_x, c_y = _slip_in(selected, work, lane)
    rolling = (v[0] - c_x, v[1] - c_y, *v[2:])
    wheels = add(wheel_speeds(selected, P, a, rolling, w), slip)
    plays = entry(work, PLAY, lane) > 0.0
    motors = where(plays, restored(selected.wheels, work, MOTOR, lane), wheels)
    return (*v[:2], *w, *ball_rate(P.inv_rb, rolling), *wheels), motors


def _step(selected, work, lane, start, at):
    """Return the `_Step` of a lane from the velocities `start`, with the forces at the velocities `at`."""
    state, h = restored(state_like(selected), work, STATE, lane), entry(work, SLIDES, lane)
    P, w, ball = wheel_side(load(selected, work, lane), entry(work, ROTOR, lane)), at[2:5], at[5:8]
    j_w, more = P.d1, P.k - 1.0
    P = P._replace(m_t=P.weighed, d1=0.0, d2=0.0, d3=0.0, J=advanced(P.J, P.D, -more * more * j_w))
    before = balancing_attitude((state[2], state[3], state[4]))
    a = half_turned(selected, state, before, w, h)
    system = terms_exact(P, a, at[:2], w)
    spins = tuple(q - more * dot(wheel.axle, w) for q, wheel in zip(at[8:], P.wheels, strict=True))
    f_w = add(forces_in(system)[1], scale(cross(w, ball_torque(P, spins)), j_w * more))
    brake = P.rolling_force / P.inv_rb / P.j_b
    rolls = root(ball[0] * ball[0] + ball[1] * ball[1])
    brake = brake / greatest(rolls, h * brake + 1e-300)  # stops the ball at most
    burden = scale(restored(selected.wheels, work, LOAD, lane), -1.0)
    last = subtract(scale(ball, 2.0), start[5:8])
    by = subtract(rotate_back(a.R, last), rotate_back(half_turned(selected, state, a, w, 2.0 * h).R, last))
    turned = tuple(dot(wheel.axle, by) for wheel in P.wheels)
    body, slowed = restored(_E, work, BODY, lane), (-brake * ball[0], -brake * ball[1], 0.0)
    return _Step(P, j_w, a, system, f_w, slowed, burden, w, body, turned)


def _accelerations(selected, step, forces):
    """Return the accelerations by the forces of all blocks, added to what the step has besides."""
    P, n = step.P, len(selected.wheels)
    gears, tractions = add(forces[: 2 * n : 2], step.burden), forces[1 : 2 * n : 2]
    more, (F_x, F_y) = P.k - 1.0, forces[2 * n : 2 * n + 2]
    on_body = add(scale(gears, more), scale(tractions, P.k))
    v_dot, w_dot = solve(
        step.system, add(step.system.f_v, (F_x, F_y)), add(step.f_w, ball_torque(P, on_body))
    )
    x, y, z = rotate(step.a.R, ball_torque(P, tractions))
    spin = forces[2 * n + 2] - z if isinstance(selected, Pivoting) else 0.0
    ball = advanced(step.brake, (F_y / P.inv_rb - x, -F_x / P.inv_rb - y, spin), 1.0 / P.j_b)
    driven = scale(add(gears, tractions), 1.0 / step.j_w)
    return (
        *v_dot,
        *w_dot,
        *ball,
        *(q + more * dot(wheel.axle, w_dot) for q, wheel in zip(driven, P.wheels, strict=True)),
    )


def _speeds(selected, step, moving):
    """Return the speed at each force: a wheel's and its slip, the floor's slip, the spin."""
    (x, y, spin), speeds = moving[5:8], []
    relative = subtract(rotate_back(step.a.R, moving[5:8]), moving[2:5])
    for q, wheel, turned in zip(moving[8:], step.P.wheels, step.turned, strict=True):
        speeds += [q, q - dot(wheel.axle, relative) + turned]
    speeds += [moving[0] - y / step.P.inv_rb, moving[1] + x / step.P.inv_rb]
    return (*speeds, spin, 0.0) if isinstance(selected, Pivoting) else tuple(speeds)


def _limits(selected, work, lane, step, accelerations, forces):
    """Return the limit of each block's friction."""
    P, n, pressing = step.P, len(selected.wheels), _pressing_in(selected, work, lane)
    parts, traction = (accelerations[:2], accelerations[2:5]), scale(forces[1 : 2 * n : 2], -1.0)
    N, F = loads(P, step.a.R, pressing, step.body, step.w, parts, traction)
    grip, floor_grip = restored((0.0, 0.0), work, GRIP, lane)
    limits = (*scale(N, grip / pressing[1]), floor_grip * F[2])
    return (*limits, P.pivoting) if isinstance(selected, Pivoting) else limits


@traced
def _problem(selected, work, lane, start, at):
    """Return the `SlipProblem` of a step with the forces at the velocities and motors' speeds `at`."""
    step, n, h = _step(selected, work, lane, start[0], at[0]), len(selected.wheels), entry(work, SLIDES, lane)
    none = no_forces(selected)
    rates = _accelerations(selected, step, none)
    speeds = _speeds(selected, step, advanced(start[0], rates, h))
    # responses to unit forces alone: weight, friction and velocities are zero
    still = step.system._replace(f_v=(0.0, 0.0))
    P = step.P._replace(weight=_ZEROS, pivoting=0.0)
    bare = step._replace(P=P, system=still, f_w=_ZEROS, brake=_ZEROS, w=_ZEROS, body=_ZEROS)
    bare = bare._replace(burden=none[:n], turned=none[:n])
    units = [tuple(1.0 if i == j else 0.0 for i in range(len(none))) for j in range(len(none))]
    responses = [_accelerations(selected, bare, unit) for unit in units]
    G = [scale(_speeds(selected, bare, response), h) for response in responses]
    by_force = [_limits(selected, work, lane, bare, *pair) for pair in zip(responses, units, strict=True)]
    # a ball that slides on does so in the direction half way
    before, middle = _slip_in(selected, work, lane)[-2:], _speeds(selected, step, at[0])[2 * n : 2 * n + 2]
    on = inner(before, subtract(scale(middle, 2.0), before)) > 0.0
    K, k = [], []
    for block, limit in enumerate(_limits(selected, work, lane, step, rates, none)):
        first = 2 * block
        stiffest = greatest(G[first][first], G[first + 1][first + 1]) + abs(G[first][first + 1])
        for i in (first, first + 1):
            row, known = tuple(column[i] for column in G), speeds[i]
            if block < n:  # the law of a wheel has what its own forces do
                row = (*row[:first], 0.0, 0.0, *row[first + 2 :])
            else:
                row, known = subtract(units[i], scale(row, 1.0 / stiffest)), -known / stiffest
            if block == n:
                row, known = where(on, (none, -_FAR * middle[i - first]), (row, known))
            K.append(row)
            k.append(known)
        K.append(tuple(limits[block] for limits in by_force))
        k.append(limit)
    motors = _motors(selected, work, lane, start[1], at[1])
    own = tuple(
        (G[i][i], G[i][i + 1], G[i + 1][i + 1], *motor)
        for i, motor in zip(range(0, 2 * n, 2), motors, strict=True)
    )
    return SlipProblem(tuple(K), tuple(k), own)


def _motors(selected, work, lane, start, at):
    """Yield each motor's numbers, as `through_play` takes them, and its inertia, from its speeds at start and `at`."""
    h, rotor, half = entry(work, SLIDES, lane), entry(work, ROTOR, lane), 0.5 * entry(work, PLAY, lane)
    for i, wheel in enumerate(load(selected, work, lane).wheels):
        torque = entry(work, TORQUE + i, lane) - friction_shift(wheel, at[i])
        viscous, ahead, rate = 0.5 * h * wheel.b, entry(work, AHEAD + i, lane), 1.0 / h
        momentum, dry = (rotor - viscous) * start[i] + h * torque, dry_friction(wheel, at[i]) * h
        alone = braked(momentum, dry) / greatest(rotor + viscous, 1e-200)
        yield rate, momentum, dry, alone, (-half - ahead) * rate, (half - ahead) * rate, rotor + viscous


def _given(problem, block, forces):
    """Return what a block's law is given under forces."""
    rows = range(3 * block, 3 * block + 3)
    return tuple(inner(problem.K[i], forces) + problem.k[i] for i in rows)


def _law(problem, block, given):
    """Return a block's two forces, whether the contact holds, and a wheel's motor speed."""
    p, q, limit = given[0], given[1], greatest(given[2], 0.0)
    if block >= len(problem.own):
        size2 = p * p + q * q
        share = where(size2 < limit * limit, 1.0, limit / root(greatest(size2, 1e-300)))
        return p * share, q * share, size2 < limit * limit, 0.0
    a, b, c, rate, momentum, dry, alone, low, high, inertia = problem.own[block]

    def gear(free, by_torque):
        beyond = 1.0 / (rate * by_torque)
        return through_play(free, rate, momentum, dry, alone, low, high, beyond, 1.0 / (inertia + beyond))

    torque, _ = gear(p - b / c * q, a - b * b / c)  # of a wheel that holds
    held = -(q + b * torque) / c
    traction = least(greatest(held, -limit), limit)
    torque, motor = gear(p + b * traction, a)
    return torque, traction, abs(held) < limit, motor


def _by_law(problem, forces):
    """Return what the laws give for each block under forces, and the largest error of these."""
    laws = [_law(problem, block, _given(problem, block, forces)) for block in range(len(forces) // 2)]
    return laws, largest_of(subtract(sum((law[:2] for law in laws), ()), forces))


@traced
def _round(problem, forces):
    """Return the forces after a round, and 1 if they are accurate, else 0."""
    swept, rows, right = list(forces), [], []
    for block in range(len(forces) // 2):
        swept[2 * block : 2 * block + 2] = _law(problem, block, _given(problem, block, swept))[:2]
    laws, error = _by_law(problem, swept)
    for block, (*here, _, _) in enumerate(laws):
        given, slopes = _given(problem, block, swept), []
        for i in range(3):
            by = _DIFFERENCE * (1.0 + abs(given[i]))
            moved = _law(problem, block, (*given[:i], given[i] + by, *given[i + 1 :]))[:2]
            slopes.append(scale(subtract(moved, here), 1.0 / by))
        columns = list(zip(*problem.K[3 * block : 3 * block + 3], strict=True))
        for i in (0, 1):
            row = tuple(inner([slope[i] for slope in slopes], column) for column in columns)
            rows.append([(1.0 if j == 2 * block + i else 0.0) - by for j, by in enumerate(row)])
            right.append(here[i] - inner(row, swept))
    found = solve_dense(rows, right)
    _, less = _by_law(problem, found)
    forces, error = where(less < error, (found, less), (tuple(swept), error))
    return forces, where(error <= _ACCURATE * largest_of(forces), 1.0, 0.0)


@traced
def _with_limits(problem, held, forces):
    """Return a problem with limits that no force changes: half way from those held to what the forces give."""
    K, k = list(problem.K), list(problem.k)
    for block in range(len(forces) // 2):
        i = 3 * block + 2
        K[i], k[i] = scale(K[i], 0.0), 0.5 * (held.k[i] + problem.k[i] + inner(problem.K[i], forces))
    return SlipProblem(tuple(K), tuple(k), problem.own)


@inlined
def _found(problem, guess):
    """Return the forces, from a guess.

    With much grip, loads and tractions may chase one another. Every other four rounds the limits are held, which
    leaves a convex problem, and follow by halves.
    """
    forces, held = guess, _with_limits(problem, problem, guess)
    for k in range(_ROUNDS):
        holds = k % 8 > 3
        forces, accurate = _round(held if holds else problem, guess if k % 8 == 4 else forces)
        if holds:
            guess, held = forces, _with_limits(problem, held, forces)
        elif accurate > 0.0:
            break
    return forces


@traced
def no_forces(selected):
    """Return zeros, two for each block."""
    return (0.0,) * (2 * len(selected.wheels) + (4 if isinstance(selected, Pivoting) else 2))


@traced
def _half_way(selected, work, lane, start, problem, forces):
    """Return the velocities and motors' speeds half way to where the first forces lead."""
    rates = _accelerations(selected, _step(selected, work, lane, start[0], start[0]), forces)
    laws, _ = _by_law(problem, forces)
    motors = tuple(law[3] for law in laws[: len(selected.wheels)])
    return advanced(start[0], rates, 0.5 * entry(work, SLIDES, lane)), scale(add(start[1], motors), 0.5)


@traced
def _finish(selected, work, lane, start, at, problem, forces):
    """Make the end of the step the lane's state."""
    n, h, state = (
        len(selected.wheels),
        entry(work, SLIDES, lane),
        restored(state_like(selected), work, STATE, lane),
    )
    step, (laws, _) = _step(selected, work, lane, start[0], at[0]), _by_law(problem, forces)
    rates = _accelerations(selected, step, forces)
    end = advanced(start[0], rates, h)
    v = (*end[:2], end[7]) if isinstance(selected, Pivoting) else end[:2]
    after = finished(selected, state, step.a, v, end[2:5], h)
    there = step._replace(
        a=balancing_attitude((after[2], after[3], after[4])), turned=no_forces(selected)[:n]
    )
    speeds = _speeds(selected, there, end)
    for i, (_, _, holds, motor) in enumerate(laws[:n]):
        half, ahead = 0.5 * entry(work, PLAY, lane), entry(work, AHEAD + i, lane) + h * (motor - end[8 + i])
        turned = entry(work, ANGLE + i, lane) + 0.5 * h * (start[0][8 + i] + end[8 + i])
        put(work, SLIP + i, lane, where(holds, 0.0, speeds[2 * i + 1]))
        put(work, MOTOR + i, lane, motor)
        put(work, AHEAD + i, lane, least(greatest(ahead, -half), half))
        put(work, ANGLE + i, lane, turned)
    stored(work, SLIP + 4, lane, where(laws[n][2], (0.0, 0.0), speeds[2 * n : 2 * n + 2]))
    put(
        work, FLOOR, lane, _limits(selected, work, lane, step, rates, forces)[n] / entry(work, GRIP + 1, lane)
    )
    stored(work, STATE, lane, after)
    put(work, STEP, lane, where(is_upright(after), h, 0.0))


@inlined
def slip_steps(selected, work, width):
    """Take the steps of the lanes that were marked."""
    for lane in range(width):
        if entry(work, SLIDES, lane) > 0.0:
            start, forces = _start(selected, work, lane), no_forces(selected)
            at = start
            for again in range(2):
                problem = _problem(selected, work, lane, start, at)
                forces = _found(problem, forces)
                if again == 0:
                    at = _half_way(selected, work, lane, start, problem, forces)
                else:
                    _finish(selected, work, lane, start, at, problem, forces)
