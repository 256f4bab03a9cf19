"""Contacts that slip: wheels on the ball and the ball on the floor have Coulomb friction (docs/mechanics.md).

Where a contact slips, wheels and ball are bodies of their own. With v the ball's centre, w the body, Omega the ball and
q_i the wheels, the speeds at the contacts and the friction there are

    wheels  sigma_i = q_i - a_i . (R^T Omega - w)         |l_i| <= mu r_w N_i, against sigma_i
    floor   c = v - r_b Omega x e_z                       |F| <= mu_f N, against c

(a_i: the rows of A). The loads N_i and N follow from the accelerations and from l (`loads`), and so do the limits.

A step is first taken without slip. If a contact would need more than its limit (`mark_slips`), or slips already, the
lane's step is taken again by `slip_step`: one implicit solution for gears, dry friction of the drivelines, tractions and
loads, at velocities of the step's end. As in `contacts`, it is found twice, the second time with the forces half way, so
that it has order two while each contact stays as it is. Rigid gears are gears without play.

The forces are f = law(K f + k), block by block: a wheel's gear torque and traction, the floor's force, the friction of a
spin that there is. A round is a sweep (Gauss and Seidel's method) and a step of Newton's method, whose derivatives are
differences, exact where a law is linear; the one with the smaller error counts.
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
from ballbot.mechanics.parameters import Pivoting
from ballbot.mechanics.stick_slip import largest_of

_ROUNDS = 12
_ACCURATE = 1e-13  # error of the forces, over the largest
_FAR = 1e12  # of a slip, beyond each limit
_DIFFERENCE = 1e-6  # of what a law is given, for its derivative
_E = (0.0, 0.0, 1.0)
_TWO = (0.0, 0.0)


class Moving(NamedTuple):
    """Velocities or accelerations of the bodies."""

    v: tuple  #: (2) of the ball's centre
    w: tuple  #: (3) of the body, in its frame
    ball: tuple  #: (3) Omega
    wheels: tuple  #: (n) relative to the body


class Reference(NamedTuple):
    """Where a step's forces are taken: at its start, or half way."""

    moving: Moving
    motors: tuple  #: (n)
    last: tuple  #: (3) Omega by which the contacts' directions turn
    slides: tuple  #: (2) how the ball slides on, zero where it may stop within the step


class SlipProblem(NamedTuple):
    """The forces sought are law(K f + k); a block has two forces, and its law is given three numbers."""

    K: tuple
    k: tuple
    own: tuple  #: of each wheel: what its law has besides


class _Step(NamedTuple):
    """A lane's robot at a reference."""

    P: tuple
    j_w: float
    a: Attitude
    system: Terms
    free: Moving  #: accelerations without the forces sought
    pressing: tuple  #: a row of `pack_contacts`
    h: float


def loads(R, ml, pressing, v_dot, turning, body_weight, floor_weight, traction):
    """Return N_i of each wheel and N of the floor [N]; `turning` is w_dot x e + w x (w x e), `traction` f_i r_w."""
    n, m = len(traction), pressing[0]
    straight = (m * v_dot[0] + body_weight[0], m * v_dot[1] + body_weight[1], body_weight[2])
    force = add(rotate_back(R, straight), scale(turning, ml))
    rows = ((pressing[2 + 3 * i : 5 + 3 * i], pressing[2 + 3 * n + n * i :][:n]) for i in range(n))
    return tuple(dot(row, force) + inner(by, traction) for row, by in rows), floor_weight + ml * dot(
        R[2], turning
    )


def _pressing_in(selected, work, lane):
    n = len(selected.wheels)
    return restored((0.0,) * (2 + 3 * n + n * n), work, PRESSING, lane)


@traced
def mark_slips(selected, work, width):
    """Leave each lane's floor load, and take away the step of one that slips, or would, on its way to the trial state."""
    for lane in lanes(0, width):
        P, state, h = (
            load(selected, work, lane),
            restored(state_like(selected), work, STATE, lane),
            entry(work, STEP, lane),
        )
        trial, grip = restored(state_like(selected), work, TRIAL, lane), restored(_TWO, work, GRIP, lane)
        rate = where(h > 0.0, 1.0 / h, 0.0)
        a = balancing_attitude((state[2], state[3], state[4]))
        v_dot, w_dot = (scale(subtract(of(trial), of(state)), rate) for of in (ball_velocity, body_velocity))
        v, w = (scale(add(of(trial), of(state)), 0.5) for of in (ball_velocity, body_velocity))
        z = rotate_back(a.R, ball_rate(P.inv_rb, v))
        z_dot = add(rotate_back(a.R, ball_rate(P.inv_rb, v_dot)), cross(z, w))
        # angular momentum of the body and its change give the torque A^T l on the ball
        H, H_dot = (
            add(symmetric_times(P.J, one), scale(symmetric_times(P.D, subtract(one, other)), P.d3 - P.d2))
            for one, other in ((w, z), (w_dot, z_dot))
        )
        up = rotate_back(a.R, subtract(scale(P.gravity, -1.0), (v_dot[0], v_dot[1], 0.0)))
        torque = subtract(scale(cross(_E, up), P.ml), add(H_dot, cross(w, H)))
        even = solve_symmetric(P.D, torque)
        traction, pressing = (
            tuple(dot(wheel.axle, even) for wheel in P.wheels),
            _pressing_in(selected, work, lane),
        )
        turning = add(cross(w_dot, _E), cross(w, cross(w, _E)))
        N, floor = loads(
            a.R, P.ml, pressing, v_dot, turning, restored(_E, work, BODY, lane), P.weight[2], traction
        )
        along = add(scale((v_dot[0], v_dot[1]), P.weighed), scale(rotate(a.R, turning)[:2], P.ml))
        F, most = add(along, P.weight[:2]), grip[1] * greatest(floor, 0.0)
        slips = either(
            F[0] * F[0] + F[1] * F[1] > most * most,
            *(
                abs(l) * pressing[1] > grip[0] * greatest(N_i, 0.0)
                for l, N_i in zip(traction, N, strict=True)
            ),
            largest_of(restored((*selected.wheels, *_TWO), work, SLIP, lane)) > 0.0,
        )
        slips = both(slips, grip[0] > 0.0)
        put(work, FLOOR, lane, floor)
        put(work, SLIDES, lane, where(slips, h, 0.0))
        put(work, STEP, lane, where(slips, 0.0, h))


@traced
def _start(selected, work, lane):
    """Return the `Reference` at a lane's start."""
    P, state = load(selected, work, lane), restored(state_like(selected), work, STATE, lane)
    a, v, w = balancing_attitude((state[2], state[3], state[4])), ball_velocity(state), body_velocity(state)
    slip = _slips_in(selected, work, lane)
    rolling = (v[0] - slip[-2], v[1] - slip[-1], *v[2:])
    wheels = add(wheel_speeds(selected, P, a, rolling, w), slip[:-2])
    plays = entry(work, PLAY, lane) > 0.0
    motors = where(plays, restored(selected.wheels, work, MOTOR, lane), wheels)
    ball = ball_rate(P.inv_rb, rolling)
    return Reference(Moving(v[:2], w, ball, wheels), motors, ball, _TWO)


def _slips_in(selected, work, lane):
    """Return the slip of a lane's wheels, and of its ball in x and y."""
    n = len(selected.wheels)
    slip = restored((0.0,) * 6, work, SLIP, lane)
    return (*slip[:n], *slip[4:])


def _step(selected, work, lane, at):
    """Return the `_Step` of a lane."""
    state, h = restored(state_like(selected), work, STATE, lane), entry(work, SLIDES, lane)
    P, moving = wheel_side(load(selected, work, lane), entry(work, ROTOR, lane)), at.moving
    j_w, more, w = P.d1, P.k - 1.0, moving.w
    # the wheels' spin about their axles is taken out of the body
    P = P._replace(m_t=P.weighed, d1=0.0, d2=0.0, d3=0.0, J=advanced(P.J, P.D, -more * more * j_w))
    a = half_turned(selected, state, balancing_attitude((state[2], state[3], state[4])), w, h)
    system = terms_exact(P, a, moving.v, w)
    spins = (q - more * dot(wheel.axle, w) for q, wheel in zip(moving.wheels, P.wheels, strict=True))
    burden = scale(restored(selected.wheels, work, LOAD, lane), -1.0)
    f_v, f_w = forces_in(system)
    f_w = add(f_w, scale(cross(w, ball_torque(P, spins)), j_w * more))
    v_dot, w_dot = solve(system, f_v, add(f_w, scale(ball_torque(P, burden), more)))
    x, y, _ = moving.ball
    brake = P.rolling_force / P.inv_rb / P.j_b
    brake = brake / greatest(root(x * x + y * y), h * brake)  # stops the ball at most
    wheels = tuple(b / j_w + more * dot(wheel.axle, w_dot) for b, wheel in zip(burden, P.wheels, strict=True))
    free = Moving(v_dot, w_dot, (-brake * x, -brake * y, 0.0), wheels)
    return _Step(P, j_w, a, system, free, _pressing_in(selected, work, lane), h)


def _response(selected, step, forces):
    """Return the accelerations by forces: gear torque and traction of each wheel, the floor's force, the spin's."""
    P, n = step.P, len(selected.wheels)
    gears, tractions = forces[: 2 * n : 2], forces[1 : 2 * n : 2]
    more, (F_x, F_y) = P.k - 1.0, forces[2 * n : 2 * n + 2]
    on_body = tuple(more * T + P.k * l for T, l in zip(gears, tractions, strict=True))
    v_dot, w_dot = solve(step.system, (F_x, F_y), ball_torque(P, on_body))
    x, y, z = rotate(step.a.R, ball_torque(P, tractions))
    spin = forces[2 * n + 2] - z if isinstance(selected, Pivoting) else 0.0
    ball = scale((F_y / P.inv_rb - x, -F_x / P.inv_rb - y, spin), 1.0 / P.j_b)
    wheels = tuple(
        (T + l) / step.j_w + more * dot(wheel.axle, w_dot)
        for T, l, wheel in zip(gears, tractions, P.wheels, strict=True)
    )
    return Moving(v_dot, w_dot, ball, wheels)


def _speeds(selected, step, moving):
    """Return the speed at each force: a wheel's and its slip, the floor's slip, the spin."""
    relative = subtract(rotate_back(step.a.R, moving.ball), moving.w)
    of_wheels = (
        (q, q - dot(wheel.axle, relative)) for q, wheel in zip(moving.wheels, step.P.wheels, strict=True)
    )
    x, y, spin = moving.ball
    floor = (moving.v[0] - y / step.P.inv_rb, moving.v[1] + x / step.P.inv_rb)
    return sum(of_wheels, ()) + floor + ((spin, 0.0) if isinstance(selected, Pivoting) else ())


def _limits(selected, work, lane, step, accelerations, forces, w):
    """Return the limit of each block's friction; w is zero for what a force alone adds to it."""
    P, n = step.P, len(selected.wheels)
    body, floor = (restored(_E, work, BODY, lane), P.weight[2]) if w else (_E[:2] + (0.0,), 0.0)
    turning = cross(accelerations.w, _E)
    turning = add(turning, cross(w, cross(w, _E))) if w else turning
    traction = scale(forces[1 : 2 * n : 2], -1.0)
    N, floor = loads(step.a.R, P.ml, step.pressing, accelerations.v, turning, body, floor, traction)
    grip = restored(_TWO, work, GRIP, lane)
    limits = (*scale(N, grip[0] / step.pressing[1]), grip[1] * floor)
    return limits + ((P.pivoting if w else 0.0,) if isinstance(selected, Pivoting) else ())


def _after(moving, accelerations, h):
    return Moving(*(advanced(one, rate, h) for one, rate in zip(moving, accelerations, strict=True)))


def _turned(step, state, at):
    """Return what the turning of the contacts' directions adds to the wheels' slip at the step's end."""
    before = balancing_attitude((state[2], state[3], state[4]))
    by = subtract(rotate_back(before.R, at.last), rotate_back(step.a.R, at.last))
    return tuple(dot(wheel.axle, by) for wheel in step.P.wheels)


@traced
def _problem(selected, work, lane, start, at):
    """Return the `SlipProblem` of a lane's step with the forces at a reference."""
    step, n, h = _step(selected, work, lane, at), len(selected.wheels), entry(work, SLIDES, lane)
    count = 2 * n + (4 if isinstance(selected, Pivoting) else 2)
    none = (0.0,) * count
    state = restored(state_like(selected), work, STATE, lane)
    speeds = list(_speeds(selected, step, _after(start.moving, step.free, h)))
    for i, turned in enumerate(_turned(step, state, at)):
        speeds[2 * i + 1] = speeds[2 * i + 1] + turned
    limits = _limits(selected, work, lane, step, step.free, none, at.moving.w)
    G, by_force = [], []
    for j in range(count):
        unit = tuple(1.0 if i == j else 0.0 for i in range(count))
        response = _response(selected, step, unit)
        G.append(scale(_speeds(selected, step, response), h))
        by_force.append(_limits(selected, work, lane, step, response, unit, ()))
    K, k = [], []
    for block in range(count // 2):
        first = 2 * block
        stiffest = greatest(G[first][first], G[first + 1][first + 1]) + abs(G[first][first + 1])
        for i in (first, first + 1):
            row = [G[j][i] for j in range(count)]
            if block < n:  # the law of a wheel has what its own forces do
                row[first], row[first + 1] = 0.0, 0.0
                K.append(tuple(row))
                k.append(speeds[i])
            else:
                row, known = scale(row, -1.0 / stiffest), -speeds[i] / stiffest
                row = (*row[:i], row[i] + 1.0, *row[i + 1 :])
                if block == n:
                    on = -_FAR * at.slides[i - first]
                    row, known = where(inner(at.slides, at.slides) > 0.0, (none, on), (row, known))
                K.append(row)
                k.append(known)
        K.append(tuple(row[block] for row in by_force))
        k.append(limits[block])
    own = tuple(
        (G[2 * i][2 * i], G[2 * i][2 * i + 1], G[2 * i + 1][2 * i + 1], *motor)
        for i, motor in enumerate(_motors(selected, work, lane, start, at))
    )
    return SlipProblem(tuple(K), tuple(k), own)


def _motors(selected, work, lane, start, at):
    """Yield each motor's numbers as `through_play` takes them, its inertia in place of what is beyond the gears."""
    whole, h, rotor = load(selected, work, lane), entry(work, SLIDES, lane), entry(work, ROTOR, lane)
    half, rate = 0.5 * entry(work, PLAY, lane), 1.0 / h
    for i, wheel in enumerate(whole.wheels):
        torque = entry(work, TORQUE + i, lane) - friction_shift(wheel, at.motors[i])
        viscous = 0.5 * h * wheel.b
        momentum, dry = (
            (rotor - viscous) * start.motors[i] + h * torque,
            dry_friction(wheel, at.motors[i]) * h,
        )
        inertia, ahead = rotor + viscous, entry(work, AHEAD + i, lane)
        alone = braked(momentum, dry) / greatest(inertia, 1e-200)
        yield rate, momentum, dry, alone, (-half - ahead) * rate, (half - ahead) * rate, inertia


def _given(problem, block, forces):
    """Return what a block's law is given under forces."""
    rows = range(3 * block, 3 * block + 3)
    return tuple(inner(problem.K[i], forces) + problem.k[i] for i in rows)


def _law(problem, block, given):
    """Return a block's two forces, a wheel's motor speed, and whether the contact holds."""
    p, q, limit = given[0], given[1], greatest(given[2], 0.0)
    if block >= len(problem.own):
        size2 = p * p + q * q
        holds = size2 < limit * limit
        share = where(holds, 1.0, limit / root(greatest(size2, 1e-300)))
        return p * share, q * share, 0.0, where(holds, 1.0, 0.0)
    a, b, c, rate, momentum, dry, alone, low, high, inertia = problem.own[block]

    def gear(free, per_torque):
        beyond = 1.0 / (rate * per_torque)
        return through_play(free, rate, momentum, dry, alone, low, high, beyond, 1.0 / (inertia + beyond))

    torque, _ = gear(p - b / c * q, a - b * b / c)
    traction = -(q + b * torque) / c
    sliding = least(greatest(traction, -limit), limit)
    torque, motor = gear(p + b * sliding, a)
    return torque, sliding, motor, where(abs(traction) < limit, 1.0, 0.0)


def _errors(problem, forces):
    """Return the forces that the laws give at these, and the largest error of these."""
    blocks = range(len(forces) // 2)
    by_law = sum((_law(problem, block, _given(problem, block, forces))[:2] for block in blocks), ())
    return by_law, largest_of(subtract(by_law, forces))


@traced
def _round(problem, forces):
    """Return the forces after a round, and whether they are accurate (1) or not (0)."""
    swept = list(forces)
    for block in range(len(forces) // 2):
        swept[2 * block : 2 * block + 2] = _law(problem, block, _given(problem, block, swept))[:2]
    by_law, error = _errors(problem, swept)
    rows, right = [], []
    for block in range(len(forces) // 2):
        given, at = _given(problem, block, swept), by_law[2 * block : 2 * block + 2]
        changes = []
        for i in range(3):
            by = _DIFFERENCE * (1.0 + abs(given[i]))
            moved = _law(problem, block, (*given[:i], given[i] + by, *given[i + 1 :]))[:2]
            changes.append(scale(subtract(moved, at), 1.0 / by))
        mine = problem.K[3 * block : 3 * block + 3]
        for i in (0, 1):
            slopes = tuple(change[i] for change in changes)
            by_force = [inner(slopes, column) for column in zip(*mine, strict=True)]
            rows.append([(1.0 if j == 2 * block + i else 0.0) - slope for j, slope in enumerate(by_force)])
            right.append(at[i] - inner(by_force, swept))
    found = solve_dense(rows, right)
    _, less = _errors(problem, found)
    better = less < error
    forces = where(better, found, tuple(swept))
    return forces, where(where(better, less, error) <= _ACCURATE * largest_of(forces), 1.0, 0.0)


@inlined
def _found(problem, forces):
    """Return the forces, from a guess."""
    for _ in range(_ROUNDS):
        forces, accurate = _round(problem, forces)
        if accurate > 0.0:
            break
    return forces


@traced
def _no_forces(selected):
    return (0.0,) * (2 * len(selected.wheels) + (4 if isinstance(selected, Pivoting) else 2))


@traced
def _half_way(selected, work, lane, start, problem, forces):
    """Return the `Reference` half way to where the first forces lead."""
    step, _, end, motors, _ = _end(selected, work, lane, start, start, problem, forces)
    half = Moving(*(scale(add(one, other), 0.5) for one, other in zip(start.moving, end, strict=True)))
    n, before = len(selected.wheels), restored(_TWO, work, SLIP + 4, lane)
    after = _speeds(selected, step, end)[2 * n : 2 * n + 2]
    slides = where(inner(before, after) > 0.0, scale(add(before, after), 0.5), _TWO)
    return Reference(half, scale(add(start.motors, motors), 0.5), end.ball, slides)


def _end(selected, work, lane, start, at, problem, forces):
    """Return the step, its accelerations, its end, the motors' speeds there and whether each contact holds."""
    step, laws = _step(selected, work, lane, at), []
    by = _response(selected, step, forces)
    rates = Moving(*(add(one, other) for one, other in zip(step.free, by, strict=True)))
    for block in range(len(forces) // 2):
        laws.append(_law(problem, block, _given(problem, block, forces)))
    n = len(selected.wheels)
    motors, holds = tuple(law[2] for law in laws[:n]), tuple(law[3] for law in laws)
    return step, rates, _after(start.moving, rates, step.h), motors, holds


@traced
def _finish(selected, work, lane, start, at, problem, forces):
    """Make the end of the step the lane's state."""
    n, state = len(selected.wheels), restored(state_like(selected), work, STATE, lane)
    step, rates, end, motors, holds = _end(selected, work, lane, start, at, problem, forces)
    speeds, turned = _speeds(selected, step, end), _turned(step, state, at)
    for i in range(n):
        put(work, SLIP + i, lane, where(holds[i] > 0.0, 0.0, speeds[2 * i + 1] + turned[i]))
        put(work, MOTOR + i, lane, motors[i])
        half, ahead = 0.5 * entry(work, PLAY, lane), entry(work, AHEAD + i, lane)
        ahead = ahead + step.h * (motors[i] - end.wheels[i])
        put(work, AHEAD + i, lane, least(greatest(ahead, -half), half))
        by = 0.5 * step.h * (start.moving.wheels[i] + end.wheels[i])
        put(work, ANGLE + i, lane, entry(work, ANGLE + i, lane) + by)
    stored(work, SLIP + 4, lane, where(holds[n] > 0.0, _TWO, speeds[2 * n : 2 * n + 2]))
    turning = add(cross(rates.w, _E), cross(at.moving.w, cross(at.moving.w, _E)))
    put(work, FLOOR, lane, step.P.weight[2] + step.P.ml * dot(step.a.R[2], turning))
    v = end.v + end.ball[2:] if isinstance(selected, Pivoting) else end.v
    after = finished(selected, state, step.a, v, end.w, step.h)
    stored(work, STATE, lane, after)
    put(work, STEP, lane, where(is_upright(after), step.h, 0.0))


@inlined
def slip_steps(selected, work, width):
    """Take the steps of the lanes that were marked."""
    for lane in range(width):
        if entry(work, SLIDES, lane) > 0.0:
            start = _start(selected, work, lane)
            problem = _problem(selected, work, lane, start, start)
            forces = _found(problem, _no_forces(selected))
            at = _half_way(selected, work, lane, start, problem, forces)
            problem = _problem(selected, work, lane, start, at)
            forces = _found(problem, forces)
            _finish(selected, work, lane, start, at, problem, forces)
