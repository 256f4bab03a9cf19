"""Gears with play, for robots side by side: motors and wheels are two bodies that touch at the stops of the play.

Each motor i has its own speed rho_i and is delta_i ahead of its wheel. T_i is the torque that it passes on:

    M_w nu_dot + bias_w = W^T (T - T_load) + rolling friction          M_w, bias_w without the rotors
    j_r rho_dot = u - tau(rho) - T                                     tau: the robot's driveline friction
    |delta| <= p/2,  delta_dot = rho - omega                           T > 0 only where delta = p/2, T < 0 at -p/2

A motor in the gap transmits nothing. At a stop the two go on at one speed: the momentum along the wheel is conserved,
the impact is without rebound. In contact the equations are those of the model.

A step has one implicit solution for the torques T, the set-valued friction of motors and floor and the stops. It is
found contact by contact (Gauss and Seidel's method; each contact is solved exactly), as in J. J. Moreau, Unilateral
contact and dry friction in finite freedom dynamics, 1988. Velocities are of first order in the step.

`play_block` takes a step for the robots of a block, in loops over lanes that become vector code: the problem, sweeps
over its contacts, the end. A lane that has settled stays as it is while its neighbours go on.
"""

from functools import cache

from ballbot.mechanics.contacts import (
    contact_matrix,
    contact_speeds,
    finished,
    free_motion,
    half_turned,
    of_boxes,
    parted,
    responses,
    wheel_side,
)
from ballbot.mechanics.driveline import braked, through_play
from ballbot.mechanics.engine.compiled import c_code, inlined
from ballbot.mechanics.engine.convex import less_response
from ballbot.mechanics.engine.lanes import (
    AHEAD,
    ANGLE,
    LOAD,
    MOTOR,
    PASSED,
    PLAY,
    ROTOR,
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
from ballbot.mechanics.engine.slip import mark_slips, slip_steps
from ballbot.mechanics.engine.smooth import ball_velocity, body_velocity, is_upright
from ballbot.mechanics.engine.tracing import greatest, lanes, least, outside, root, traced, where
from ballbot.mechanics.engine.vector import add, advanced, each, inner, scale, subtract
from ballbot.mechanics.equations import balancing_attitude, solve
from ballbot.mechanics.friction import dry_friction, friction_shift
from ballbot.mechanics.parameters import MAX_WHEELS, Exact, Pivoting, Thesis

_SWEEPS = 100
#: a sweep that changes no contact's speed by more than this is the last [rad/s, m/s]
_SETTLED = 1e-10
#: in the first of them the changes of every third are extrapolated (Aitken's method). Wheels and floor that both hold
#: the ball share its x and y: what is wrong with the shares falls by 2.4 % a sweep only (preset alten)
_EXTRAPOLATED = 30
#: of two sweeps' changes, above the 0.976 of those
_LARGEST_RATIO = 0.99

# Scratch rows: the velocities ahead, Y, h G, the contacts' speeds before and now, what stays of the disc, the motors,
# and whether the lane has settled. A sweep is a chain of operations that wait for each other: it divides but once
_FREE = SCRATCH
_Y = _FREE + 6
_G = _Y + 7 * 6
_BEFORE = _G + 7 * 7
_SPEEDS = _BEFORE + 7
_STIFFEST = _SPEEDS + 7  # reciprocal
_RATE = _STIFFEST + 1  # 1/h
# of each motor: before dry friction, the momentum that this can take, its speed in the gap
_MOMENTUM = _RATE + 1
_DRY = _MOMENTUM + MAX_WHEELS
_ALONE = _DRY + MAX_WHEELS
_LOW = _ALONE + MAX_WHEELS  # lowest and highest speed relative to its wheel
_HIGH = _LOW + MAX_WHEELS
_WHEEL = _HIGH + MAX_WHEELS  # inertia of the wheel, and the reciprocal one of both
_TOGETHER = _WHEEL + MAX_WHEELS
_SPEED = _TOGETHER + MAX_WHEELS  # at the step's end
_MOVED = _SPEED + MAX_WHEELS
_CHANGES = _MOVED + 1  # of each force by the last sweep
_RATIO = _CHANGES + 7  # of these changes to those of the sweep before
assert _RATIO < ROWS  # compiled code does not look whether a row is in the array


@traced
def passed_torques(selected, work, lane):
    """Return the torques (n) that drive a lane's wheels: what their gears pass on, less their loads."""
    return subtract(
        restored(selected.wheels, work, PASSED, lane), restored(selected.wheels, work, LOAD, lane)
    )


def _contacts_like(selected):
    """Return zeros, one for each contact: the wheels, the spin where the ball pivots, the ball's x and y."""
    return of_boxes(selected, (0.0,) * len(selected.wheels), 0.0) + (0.0, 0.0)


@traced
def _problems(selected, work, width):
    """Leave the motion without the gears' torques and the floor's friction, and what a force at each contact does."""
    for lane in lanes(0, width):
        whole, state = load(selected, work, lane), restored(state_like(selected), work, STATE, lane)
        h, P = entry(work, STEP, lane), wheel_side(whole, entry(work, ROTOR, lane))
        a = balancing_attitude((state[2], state[3], state[4]))
        burden = scale(restored(selected.wheels, work, LOAD, lane), -1.0)
        v_before, w_before = ball_velocity(state), body_velocity(state)
        free = free_motion(selected, P, a, v_before, w_before, burden)
        v_dot, w_dot = solve(free.system, free.f_v, free.f_w)
        v, w = advanced(v_before, v_dot, h), advanced(w_before, w_dot, h)
        Y = responses(selected, P, a, free.system, len(_contacts_like(selected)))
        G = contact_matrix(selected, P, a, Y)
        (xx, xy), (_, yy) = G[-2][-2:], G[-1][-2:]
        stored(work, _FREE, lane, v + w)
        stored(work, _Y, lane, Y)
        stored(work, _G, lane, each(scale, G, (h,) * len(G)))
        put(work, _STIFFEST, lane, 1.0 / (h * (greatest(xx, yy) + abs(xy))))
        stored(work, _BEFORE, lane, contact_speeds(selected, P, a, v_before, w_before))
        stored(work, _SPEEDS, lane, contact_speeds(selected, P, a, v, w))
        put(work, _MOVED, lane, where(h > 0.0, 1.0, 0.0))


@traced
def _motors(selected, work, width):
    """Leave the motors' numbers at the step's start, after `_problems`."""
    count = len(_contacts_like(selected))
    for lane in lanes(0, width):
        whole, h = load(selected, work, lane), entry(work, STEP, lane)
        rotor, half = entry(work, ROTOR, lane), 0.5 * entry(work, PLAY, lane)
        rate = where(h > 0.0, 1.0 / h, 0.0)
        for i, wheel in enumerate(whole.wheels):
            speed, ahead = entry(work, MOTOR + i, lane), entry(work, AHEAD + i, lane)
            torque = entry(work, TORQUE + i, lane) - friction_shift(wheel, speed)
            momentum, dry = rotor * speed + h * torque, dry_friction(wheel, speed) * h
            inertia, beyond = rotor + h * wheel.b, h / entry(work, _G + (count + 1) * i, lane)
            put(work, _MOMENTUM + i, lane, momentum)
            put(work, _DRY + i, lane, dry)
            put(work, _ALONE + i, lane, braked(momentum, dry) / inertia)
            put(work, _LOW + i, lane, (-half - ahead) * rate)
            put(work, _HIGH + i, lane, (half - ahead) * rate)
            put(work, _WHEEL + i, lane, beyond)
            put(work, _TOGETHER + i, lane, 1.0 / (inertia + beyond))
        put(work, _RATE, lane, rate)


@traced
def _sweep(selected, work, width):
    """Solve each contact of each lane once, unless the lane has settled."""
    for lane in lanes(0, width):
        _sweep_lane(selected, work, lane)


def _sweep_lane(selected, work, lane):
    n, count = len(selected.wheels), len(_contacts_like(selected))
    x, y = count - 2, count - 1
    P, rate = load(selected, work, lane), entry(work, _RATE, lane)
    before = [entry(work, row + i, lane) for row in (_SPEEDS, PASSED) for i in range(count)]
    speeds, forces = before[:count], before[count:]
    g = [[entry(work, _G + count * i + j, lane) for j in range(count)] for i in range(count)]
    most, motors = 0.0, []

    def change(contact: int, by) -> None:
        nonlocal most
        for i in range(count):
            speeds[i] = speeds[i] + g[i][contact] * by
        most = greatest(most, abs(g[contact][contact] * by))
        forces[contact] = forces[contact] + by

    for i in range(n):
        rows = (_MOMENTUM, _DRY, _ALONE, _LOW, _HIGH, _WHEEL, _TOGETHER)
        numbers = (entry(work, row + i, lane) for row in rows)
        force, motor = through_play(speeds[i] - g[i][i] * forces[i], rate, *numbers)
        motors.append(motor)
        change(i, force - forces[i])
    if count == n + 3:  # the ball pivots
        force = forces[n] - speeds[n] / g[n][n]
        change(n, least(greatest(force, -P.pivoting), P.pivoting) - forces[n])
    stiffest = entry(work, _STIFFEST, lane)
    p, q = forces[x] - speeds[x] * stiffest, forces[y] - speeds[y] * stiffest
    share = least(1.0, P.rolling_force / greatest(root(p * p + q * q), 1e-300))
    by_x, by_y = share * p - forces[x], share * q - forces[y]
    change(x, by_x)
    change(y, by_y)
    moving = entry(work, _MOVED, lane) > _SETTLED
    last = [entry(work, _CHANGES + i, lane) for i in range(count)]
    changes = [after - then for after, then in zip(forces, before[count:], strict=True)]
    ratio = inner(changes, last) / greatest(inner(last, last), 1e-300)
    rows = ((_SPEEDS, speeds), (PASSED, forces), (_SPEED, motors), (_MOVED, [most]), (_CHANGES, changes))
    for row, numbers in (*rows, (_RATIO, [ratio])):
        for i, number in enumerate(numbers):
            put(work, row + i, lane, where(moving, number, entry(work, row + i, lane)))


@traced
def _moving(work, lane):
    return where(entry(work, _MOVED, lane) > _SETTLED, 1.0, 0.0)


@inlined
def _any_moves(work, width):
    count = 0.0
    for lane in range(width):
        count += _moving(work, lane)
    return count > 0.0


@traced
def _extrapolate(selected, work, width):
    """Make all further changes at once, as if each were the last one times the ratio of the last two."""
    count = len(_contacts_like(selected))
    for lane in lanes(0, width):
        ratio = least(greatest(entry(work, _RATIO, lane), 0.0), _LARGEST_RATIO)
        more = where(entry(work, _MOVED, lane) > _SETTLED, ratio / (1.0 - ratio), 0.0)
        changes = scale(restored((0.0,) * count, work, _CHANGES, lane), more)
        forces, speeds = (restored((0.0,) * count, work, row, lane) for row in (PASSED, _SPEEDS))
        G = restored(((0.0,) * count,) * count, work, _G, lane)
        by = tuple(inner(row, changes) for row in G)
        stored(work, PASSED, lane, add(forces, changes))
        stored(work, _SPEEDS, lane, add(speeds, by))


@traced
def _start_from_last_forces(selected, work, width):
    """Let the forces of the step before act: the guess that the sweeps begin with."""
    count = len(_contacts_like(selected))
    for i in range(count):
        for lane in lanes(0, width):
            forces = restored((0.0,) * count, work, PASSED, lane)
            by = inner(restored((0.0,) * count, work, _G + count * i, lane), forces)
            put(work, _SPEEDS + i, lane, entry(work, _SPEEDS + i, lane) + by)


def _velocities(selected, work, lane):
    """Return (v, w) at a step's end under the forces found."""
    contacts, velocities = _contacts_like(selected), state_like(selected)[5:]
    forces = restored(contacts, work, PASSED, lane)
    Y = restored((velocities,) * len(contacts), work, _Y, lane)
    return parted(less_response(restored(velocities, work, _FREE, lane), Y, forces, -entry(work, STEP, lane)))


@traced
def _trials(selected, work, width):
    """Leave the velocities in the trial rows."""
    for lane in lanes(0, width):
        v, w = _velocities(selected, work, lane)
        stored(work, TRIAL + 5, lane, v[:2] + w + v[2:])


@traced
def _ends(selected, work, width):
    """Make the velocities under the forces found the state; past the largest lean a lane stays where it is."""
    for lane in lanes(0, width):
        state, h = restored(state_like(selected), work, STATE, lane), entry(work, STEP, lane)
        v, w = _velocities(selected, work, lane)
        a = balancing_attitude((state[2], state[3], state[4]))
        middle = half_turned(selected, state, a, scale(add(body_velocity(state), w), 0.5), h)
        end = finished(selected, state, middle, v, w, h)
        moves = h > 0.0
        stored(work, STATE, lane, where(moves, end, state))
        put(work, STEP, lane, where(is_upright(end), h, 0.0))
        for i in range(len(selected.wheels)):
            after, motor = entry(work, _SPEEDS + i, lane), entry(work, _SPEED + i, lane)
            half = 0.5 * entry(work, PLAY, lane)
            ahead = entry(work, AHEAD + i, lane) + h * (motor - after)
            put(work, AHEAD + i, lane, least(greatest(ahead, -half), half))
            put(work, MOTOR + i, lane, where(moves, motor, entry(work, MOTOR + i, lane)))
            turned = 0.5 * h * (entry(work, _BEFORE + i, lane) + after)
            put(work, ANGLE + i, lane, entry(work, ANGLE + i, lane) + turned)


def play_code_of(selected: Exact | Thesis | Pivoting, *, slips: bool = False) -> int:
    """Return the address of the code for `play_block`, as `run.code_of` does of that for `take_steps`."""
    return _play_code_of(selected, type(selected), slips)


@cache
def _play_code_of(selected: Exact | Thesis | Pivoting, kind: type, slips: bool) -> int:
    # tuples with the same numbers are equal, whatever their kind
    @c_code("void(CPointer(float64), int64)")
    def address(work, width):
        # all lanes together: most settle by the same sweep, and while one waits for its numbers, others go on
        _problems(selected, work, width)
        _motors(selected, work, width)
        _start_from_last_forces(selected, work, width)
        for sweep in range(_SWEEPS):
            if not _any_moves(work, width):
                break
            _sweep(selected, work, width)
            if sweep % 3 == 2 and sweep < _EXTRAPOLATED:
                _extrapolate(selected, work, width)
        if slips:
            _trials(selected, work, width)
            mark_slips(selected, work, width)
        _ends(selected, work, width)
        if slips:
            slip_steps(selected, work, width)

    return address


@traced
def play_block(code, work, width):
    """Advance every lane of a block by one step with its motors' torques and its wheels' loads held."""
    outside(code, work, width)
