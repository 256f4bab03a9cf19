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

import math

from ballbot.mechanics.accelerations import solve
from ballbot.mechanics.contacts import (
    contact_matrix,
    contact_speeds,
    finished,
    free_motion,
    half_turned,
    of_boxes,
    parted,
    responses,
)
from ballbot.mechanics.engine.compiled import by_types_of, called, inlined, shared
from ballbot.mechanics.engine.convex import less_response
from ballbot.mechanics.engine.lanes import (
    AHEAD,
    ANGLE,
    GROUP,
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
    entry,
    put,
    restored,
    stored,
)
from ballbot.mechanics.engine.loading import load, state_like
from ballbot.mechanics.engine.smooth import ball_velocity, body_velocity
from ballbot.mechanics.engine.vector import add, advanced, each, each_with, scale, second, written
from ballbot.mechanics.equations import LARGEST_LEAN, balancing_attitude
from ballbot.mechanics.friction import NO_TERMS, dry_friction, friction_shift, has_directions
from ballbot.mechanics.parameters import MAX_WHEELS, DirectedWheel, Parameters, Pivoting, Wheel

_SWEEPS = 100
#: a sweep that changes no contact's speed by more than this is the last [rad/s, m/s]
_SETTLED = 1e-10

# Scratch rows: the velocities ahead, Y, G, the contacts' speeds before and now, what stays of the disc, the motors, and
# whether the lane has settled
_FREE = SCRATCH
_Y = _FREE + 6
_G = _Y + 7 * 6
_BEFORE = _G + 7 * 7
_SPEEDS = _BEFORE + 7
_STIFFEST = _SPEEDS + 7
_MOMENTUM = (
    _STIFFEST + 1
)  # of each motor before torque and dry friction, and the momentum that these can take
_DRY = _MOMENTUM + MAX_WHEELS
_INERTIA = _DRY + MAX_WHEELS
_LOW = _INERTIA + MAX_WHEELS  # lowest and highest speed relative to its wheel
_HIGH = _LOW + MAX_WHEELS
_SPEED = _HIGH + MAX_WHEELS  # at the step's end
_MOVED = _SPEED + MAX_WHEELS
assert _MOVED < ROWS  # compiled code does not look whether a row is in the array


def _bare(wheel) -> Wheel:  # pragma: no cover (compiled form below)
    """Return a wheel of the same kind, whose friction is on the motor's side of the play."""
    raise NotImplementedError("compiled code only")


@by_types_of(_bare)
def _bare_of(wheel):
    if has_directions(wheel):
        return lambda wheel: DirectedWheel(wheel.axle, 0.0, 0.0, 0.0, 1.0, 1.0, NO_TERMS)
    return lambda wheel: Wheel(wheel.axle, 0.0, 0.0, 0.0, 1.0, 1.0)


@inlined
def wheel_side(P, rotor):
    """Return the robot beyond its gears: without rotors and their friction."""
    return Parameters(
        P.inv_rb,
        P.k,
        P.m_t,
        P.ml,
        P.g,
        P.d1 - rotor,
        P.d2 - rotor,
        P.d3 - rotor,
        P.decay,
        P.rolling_force,
        P.ml2,
        P.j_b,
        P.pivoting,
        P.J,
        P.D,
        each(_bare, P.wheels),
    )


@inlined
def passed_torques(selected, work, lane):
    """Return the torques (n) that drive a lane's wheels: what their gears pass on, less their loads."""
    passed, loads = restored(selected.wheels, work, PASSED, lane), restored(selected.wheels, work, LOAD, lane)
    return each(_difference, passed, loads)


@inlined
def _difference(a, b):
    return a - b


@inlined
def _contacts_like(selected):
    """Return zeros, one for each contact: the wheels, the spin where the ball pivots, the ball's x and y."""
    return of_boxes(selected, each(_zero, selected.wheels), 0.0) + (0.0, 0.0)


@inlined
def _zero(_):
    return 0.0


def _velocities_like(selected) -> tuple:  # pragma: no cover (compiled form below)
    """Return zeros, as many as the robot has velocities."""
    raise NotImplementedError("compiled code only")


@by_types_of(_velocities_like)
def _velocities_like_of(selected):
    size = 6 if selected.instance_class is Pivoting else 5
    return written("selected", "(" + "0.0, " * size + ")")


@inlined
def _negative(value):
    return -value


@called
def _problems(selected, work, first, last):
    """Leave the motion without the gears' torques and the floor's friction, and what a force at each contact does."""
    for lane in range(first, last):
        whole, state = load(selected, work, lane), restored(state_like(selected), work, STATE, lane)
        h, P = entry(work, STEP, lane), wheel_side(whole, entry(work, ROTOR, lane))
        a = balancing_attitude((state[2], state[3], state[4]))
        burden = each(_negative, restored(selected.wheels, work, LOAD, lane))
        v_before, w_before = ball_velocity(state), body_velocity(state)
        free = free_motion(selected, P, a, v_before, w_before, burden)
        v_dot, w_dot = solve(free.system, free.f_v, free.f_w)
        v, w = advanced(v_before, v_dot, h), advanced(w_before, w_dot, h)
        Y = responses(selected, P, a, free.system, _contacts_like(selected))
        stored(work, _FREE, lane, v + w)
        stored(work, _Y, lane, Y)
        stored(work, _G, lane, contact_matrix(selected, P, a, Y))
        stored(work, _BEFORE, lane, contact_speeds(selected, P, a, v_before, w_before))
        stored(work, _SPEEDS, lane, contact_speeds(selected, P, a, v, w))
        put(work, _MOVED, lane, 1.0 if h > 0.0 else 0.0)


@called
def _motors(selected, work, first, last):
    """Leave the motors' numbers at the step's start."""
    for lane in range(first, last):
        whole, h = load(selected, work, lane), entry(work, STEP, lane)
        rotor, half = entry(work, ROTOR, lane), 0.5 * entry(work, PLAY, lane)
        speeds = restored(selected.wheels, work, MOTOR, lane)
        ahead = restored(selected.wheels, work, AHEAD, lane)
        torques = restored(selected.wheels, work, TORQUE, lane)
        shift, dry = each(friction_shift, whole.wheels, speeds), each(dry_friction, whole.wheels, speeds)
        stored(work, _MOMENTUM, lane, each_with(_momentum, each(_triple, speeds, torques, shift), (rotor, h)))
        stored(work, _DRY, lane, each_with(_times, dry, h))
        stored(work, _INERTIA, lane, each_with(_inertia, whole.wheels, (rotor, h)))
        rate = 1.0 / h if h > 0.0 else 0.0
        stored(work, _LOW, lane, each_with(_room, ahead, (-half, rate)))
        stored(work, _HIGH, lane, each_with(_room, ahead, (half, rate)))


@inlined
def _triple(a, b, c):
    return (a, b, c)


@inlined
def _momentum(numbers, inertia_and_step):
    return inertia_and_step[0] * numbers[0] + inertia_and_step[1] * (numbers[1] - numbers[2])


@inlined
def _times(a, b):
    return a * b


@inlined
def _inertia(wheel, inertia_and_step):
    return inertia_and_step[0] + inertia_and_step[1] * wheel.b


@inlined
def _room(ahead, stop_and_rate):
    return (stop_and_rate[0] - ahead) * stop_and_rate[1]


@inlined
def _braked(momentum, dry):
    """Return a momentum less the part that dry friction takes."""
    return momentum - min(max(momentum, -dry), dry)


@inlined
def through_play(wheel, mobility, h, momentum, dry, inertia, low, high):
    """Return the torque from a motor to its wheel, which would turn at speed `wheel` without it, and the motor's speed.

    In contact at the stop with relative speed c: m rho = N - h T + friction and rho = wheel + h mobility T + c.
    """
    alone = _braked(momentum, dry) / inertia
    relative = min(max(alone - wheel, low), high)
    inverse = 1.0 / mobility
    together = _braked(momentum + (relative + wheel) * inverse, dry) / (inertia + inverse)
    touches = relative != alone - wheel
    torque = (together - relative - wheel) * inverse / h
    return (torque if touches else 0.0), (together if touches else alone)


#: names of rows and numbers in the text of a sweep
_ROWS_OF_A_SWEEP = {
    "SPEEDS": _SPEEDS,
    "PASSED": PASSED,
    "G": _G,
    "MOMENTUM": _MOMENTUM,
    "DRY": _DRY,
    "INERTIA": _INERTIA,
    "LOW": _LOW,
    "HIGH": _HIGH,
    "SPEED": _SPEED,
    "MOVED": _MOVED,
    "STEP": STEP,
    "SETTLED": _SETTLED,
}


def _sweep_lane(selected, work, lane) -> None:  # pragma: no cover (compiled form below)
    """Solve each contact of a lane once, unless it has settled."""
    raise NotImplementedError("compiled code only")


@by_types_of(_sweep_lane)
def _sweep_lane_of(selected, work, lane):
    n = len(selected.types[0])
    pivots = selected.instance_class is Pivoting
    x, y, count = n + pivots, n + pivots + 1, n + pivots + 2
    lines = [
        "P, h = load(selected, work, lane), entry(work, STEP, lane)",
        "moving = entry(work, MOVED, lane) > SETTLED",
    ]
    for i in range(count):
        lines += [f"s{i} = entry(work, SPEEDS + {i}, lane)", f"f{i} = entry(work, PASSED + {i}, lane)"]
        lines += [f"g{i}_{j} = h * entry(work, G + {count * i + j}, lane)" for j in range(count)]
    lines.append("moved = 0.0")

    def change(contact: int) -> None:
        lines.extend(f"s{i} = s{i} + g{i}_{contact} * by" for i in range(count))
        lines.append(f"moved = max(moved, abs(g{contact}_{contact} * by))")
        lines.append(f"f{contact} = f{contact} + by")

    for i in range(n):
        numbers = ", ".join(
            f"entry(work, {row} + {i}, lane)" for row in ("MOMENTUM", "DRY", "INERTIA", "LOW", "HIGH")
        )
        lines += [
            f"force, m{i} = through_play(s{i} - g{i}_{i} * f{i}, g{i}_{i} / h, h, {numbers})",
            f"by = force - f{i}",
        ]
        change(i)
    if pivots:
        lines += [
            f"force = f{n} - s{n} / g{n}_{n}",
            f"by = min(max(force, -P.pivoting), P.pivoting) - f{n}",
        ]
        change(n)
    lines += [
        f"stiffest = max(g{x}_{x}, g{y}_{y}) + abs(g{x}_{y})",
        f"p, q = f{x} - s{x} / stiffest, f{y} - s{y} / stiffest",
        "share = min(1.0, P.rolling_force / max(sqrt(p * p + q * q), 1e-300))",
        f"by, by_y = share * p - f{x}, share * q - f{y}",
    ]
    change(x)
    lines.append("by = by_y")
    change(y)
    for i in range(count):
        for row, name in (("SPEEDS", f"s{i}"), ("PASSED", f"f{i}")):
            lines.append(
                f"put(work, {row} + {i}, lane, {name} if moving else entry(work, {row} + {i}, lane))"
            )
    for i in range(n):
        lines.append(f"put(work, SPEED + {i}, lane, m{i} if moving else entry(work, SPEED + {i}, lane))")
    lines.append("put(work, MOVED, lane, moved if moving else entry(work, MOVED, lane))")
    return written(
        "selected, work, lane",
        "None",
        *lines,
        load=load,
        entry=entry,
        put=put,
        through_play=through_play,
        sqrt=math.sqrt,
        **_ROWS_OF_A_SWEEP,
    )


@called
def _sweep(selected, work, first, last):
    for lane in range(first, last):
        _sweep_lane(selected, work, lane)


@inlined
def _moves(work, first, last):
    most = 0.0
    for lane in range(first, last):
        most = max(most, entry(work, _MOVED, lane))
    return most > _SETTLED


@called
def _start_from_last_forces(selected, work, first, last):
    """Let the forces of the step before act: the guess that the sweeps begin with."""
    count = len(_contacts_like(selected))
    for i in range(count):
        for j in range(count):
            for lane in range(first, last):
                by = (
                    entry(work, STEP, lane)
                    * entry(work, _G + count * i + j, lane)
                    * entry(work, PASSED + j, lane)
                )
                put(work, _SPEEDS + i, lane, entry(work, _SPEEDS + i, lane) + by)


@called
def _ends(selected, work, first, last):
    """Make the velocities under the forces found the state; past the largest lean a lane stays where it is."""
    for lane in range(first, last):
        state, h = restored(state_like(selected), work, STATE, lane), entry(work, STEP, lane)
        contacts, velocities = _contacts_like(selected), _velocities_like(selected)
        forces = restored(contacts, work, PASSED, lane)
        Y = restored(each_with(second, contacts, velocities), work, _Y, lane)
        v, w = parted(less_response(restored(velocities, work, _FREE, lane), Y, forces, -h))
        a = balancing_attitude((state[2], state[3], state[4]))
        middle = half_turned(selected, state, a, scale(add(body_velocity(state), w), 0.5), h)
        end = finished(selected, state, middle, v, w, h)
        moves = h > 0.0
        stored(work, STATE, lane, each_with(_chosen, each(_pair, end, state), moves))
        upright = abs(end[2]) <= LARGEST_LEAN and abs(end[3]) <= LARGEST_LEAN
        put(work, STEP, lane, h if upright else 0.0)
        for i in range(len(selected.wheels)):
            after, motor = entry(work, _SPEEDS + i, lane), entry(work, _SPEED + i, lane)
            half = 0.5 * entry(work, PLAY, lane)
            ahead = entry(work, AHEAD + i, lane) + h * (motor - after)
            put(work, AHEAD + i, lane, min(max(ahead, -half), half))
            put(work, MOTOR + i, lane, motor if moves else entry(work, MOTOR + i, lane))
            turned = 0.5 * h * (entry(work, _BEFORE + i, lane) + after)
            put(work, ANGLE + i, lane, entry(work, ANGLE + i, lane) + turned)


@inlined
def _pair(a, b):
    return (a, b)


@inlined
def _chosen(pair, first):
    return pair[0] if first else pair[1]


@shared
def play_block(selected, work, width):
    """Advance every lane of a block by one step with its motors' torques and its wheels' loads held."""
    for first in range(0, width, GROUP):
        last = min(first + GROUP, width)
        _problems(selected, work, first, last)
        _motors(selected, work, first, last)
        _start_from_last_forces(selected, work, first, last)
        for _ in range(_SWEEPS):
            if not _moves(work, first, last):
                break
            _sweep(selected, work, first, last)
        _ends(selected, work, first, last)
