"""Where friction acts: at the wheels, at the spin where the ball pivots, and at the ball's x and y, in this order.

C nu are the speeds there, C^T lambda the generalised forces of friction forces there, and G = C M^-1 C^T. A step in
which friction may stick is found in two passes: with the forces at its start (`first_ahead`), and with those half way
to where these lead (`corrected_ahead`), all at the attitude half way. It ends with `finished`.

So it has order two, also where a contact changes its sign. A contact that comes to rest and stays has no speed at the
end, whenever it stopped. One that turns about has its friction one way up to the instant of its stop, and the other way
after it: the second pass gives it the mean (`turns_about`).
"""

import math
from typing import NamedTuple

from ballbot.mechanics.accelerations import forces_in, solve
from ballbot.mechanics.engine.compiled import by_types_of, inlined
from ballbot.mechanics.engine.smooth import ball_velocity, body_velocity, in_state_order
from ballbot.mechanics.engine.vector import add, advanced, each, scale, solve_dense, subtract, written
from ballbot.mechanics.equations import (
    Attitude,
    balancing_attitude,
    ball_torque,
    rates_of_angles,
    terms,
    wheel_force,
    wheel_speeds,
)
from ballbot.mechanics.floor import REST, rolling_brake
from ballbot.mechanics.friction import dry_friction, friction_shift, has_directions, sign
from ballbot.mechanics.parameters import Pivoting


def contact_speeds(selected, P, a, v, w) -> tuple:  # pragma: no cover (compiled form below)
    """Return C nu: the speed at each contact."""
    raise NotImplementedError("compiled code only")


@by_types_of(contact_speeds)
def _contact_speeds(selected, P, a, v, w):
    if selected.instance_class is Pivoting:
        return lambda selected, P, a, v, w: wheel_speeds(selected, P, a, v, w) + (v[2], v[0], v[1])
    return lambda selected, P, a, v, w: wheel_speeds(selected, P, a, v, w) + (v[0], v[1])


def of_boxes(selected, of_wheels, of_spin) -> tuple:  # pragma: no cover
    """Return the boxes' numbers: those of the wheels, and that of the spin where the ball pivots."""
    raise NotImplementedError("compiled code only")


@by_types_of(of_boxes)
def _of_boxes(selected, of_wheels, of_spin):
    if selected.instance_class is Pivoting:
        return lambda selected, of_wheels, of_spin: of_wheels + (of_spin,)
    return lambda selected, of_wheels, of_spin: of_wheels


def contact_forces(selected, P, a, forces) -> tuple:  # pragma: no cover
    """Return C^T lambda as (force on v, force on w)."""
    raise NotImplementedError("compiled code only")


@by_types_of(contact_forces)
def _contact_forces(selected, P, a, forces):
    n = len(selected.types[0])
    torques = "(" + ", ".join(f"forces[{i}]" for i in range(n)) + ",)"
    last = len(forces) - 2
    pivots = selected.instance_class is Pivoting
    spin = f", F[2] + forces[{n}]" if pivots else ""
    return written(
        "selected, P, a, forces",
        f"(F[0] + forces[{last}], F[1] + forces[{last + 1}]{spin}), L",
        f"F, L = wheel_force(selected, P, a, ball_torque(P, {torques}))",
        wheel_force=wheel_force,
        ball_torque=ball_torque,
    )


def responses(selected, P, a, system, like) -> tuple:  # pragma: no cover
    """Return M^-1 C^T by rows, one for each of `like`: accelerations v_dot + w_dot under a unit force at a contact."""
    raise NotImplementedError("compiled code only")


@by_types_of(responses)
def _responses(selected, P, a, system, like):
    m = len(like)
    units = ["(" + ", ".join("1.0" if i == j else "0.0" for j in range(m)) + ",)" for i in range(m)]
    rows = "(" + ", ".join(f"response(selected, P, a, system, {unit})" for unit in units) + ",)"
    return written("selected, P, a, system, like", rows, response=_response)


@inlined
def _response(selected, P, a, system, forces):
    f_v, f_w = contact_forces(selected, P, a, forces)
    v_dot, w_dot = solve(system, f_v, f_w)
    return v_dot + w_dot


def contact_matrix(selected, P, a, Y) -> tuple:  # pragma: no cover
    """Return G = C M^-1 C^T by rows, from Y = M^-1 C^T as `responses` returns it."""
    raise NotImplementedError("compiled code only")


@by_types_of(contact_matrix)
def _contact_matrix(selected, P, a, Y):
    rows = "".join(f"speeds(selected, P, a, Y[{i}]), " for i in range(len(Y)))
    return written("selected, P, a, Y", f"({rows})", speeds=_speeds_of_response)


@inlined
def _speeds_of_response(selected, P, a, response):
    v, w = parted(response)
    return contact_speeds(selected, P, a, v, w)


def parted(nu) -> tuple:  # pragma: no cover
    """Return (v, w) of velocities or accelerations v + w."""
    raise NotImplementedError("compiled code only")


@by_types_of(parted)
def _parted(nu):
    if len(nu) == 5:
        return lambda nu: ((nu[0], nu[1]), (nu[2], nu[3], nu[4]))
    return lambda nu: ((nu[0], nu[1], nu[2]), (nu[3], nu[4], nu[5]))


class FreeMotion(NamedTuple):
    """A robot's mass matrix, its forces other than dry friction, and the limits of that."""

    system: tuple  #: `Terms` or `SpinTerms`
    f_v: tuple
    f_w: tuple
    limits: tuple  #: of the boxes: the wheels' c + s exp(..), and pivoting [N m]


def free_torque(wheel, u, speed) -> float:  # pragma: no cover (compiled form below)
    """Return a motor's torque less all friction that is a function of speed; the rest is in the symmetric box."""
    raise NotImplementedError("compiled code only")


@by_types_of(free_torque)
def _free_torque(wheel, u, speed):
    if not has_directions(wheel):  # not "- 0.0", which rounds otherwise
        return lambda wheel, u, speed: u - wheel.b * speed
    return lambda wheel, u, speed: u - wheel.b * speed - friction_shift(wheel, speed)


@inlined
def _sum(a, b):
    return a + b


@inlined
def free_motion(selected, P, a, v, w, u):
    """Return the `FreeMotion` at an attitude and velocities under wheel torques u; viscous friction is in it."""
    system = terms(selected, P, a, v, w)
    speeds = wheel_speeds(selected, P, a, v, w)
    F, L = wheel_force(selected, P, a, ball_torque(P, each(free_torque, P.wheels, u, speeds)))
    f_v, f_w = forces_in(system)
    limits = of_boxes(selected, each(dry_friction, P.wheels, speeds), P.pivoting)
    return FreeMotion(system, each(_sum, f_v, F), add(f_w, L), limits)


class StepStart(NamedTuple):
    """Where a step begins, and the attitude half way through it."""

    v: tuple
    w: tuple
    before: Attitude
    middle: Attitude  #: at the velocities of the start


@inlined
def step_start(selected, state, h):
    """Return the `StepStart` of a state."""
    v, w = ball_velocity(state), body_velocity(state)
    before = balancing_attitude((state[2], state[3], state[4]))
    return StepStart(v, w, before, half_turned(selected, state, before, w, h))


@inlined
def half_turned(selected, state, a, w, h):
    """Return the attitude half a step after that of a state, `a`, at body velocity w."""
    rates, half = rates_of_angles(selected, a, w), 0.5 * h
    return balancing_attitude(
        (state[2] + half * rates[0], state[3] + half * rates[1], state[4] + half * rates[2])
    )


class Ahead(NamedTuple):
    """Where a step would end but for the friction that is still to be found, and what that can be."""

    v: tuple
    w: tuple
    speeds: tuple  #: of the contacts
    limits: tuple  #: of the boxes; zero where the contact turns about and its friction is known
    rolling_force: float  #: of the disc; zero where the ball rolls on and its friction is known


@inlined
def first_ahead(selected, P, start, free, h):
    """Return the `Ahead` of a step under the forces of its start, `free`."""
    v_dot, w_dot = solve(free.system, free.f_v, free.f_w)
    v, w = advanced(start.v, v_dot, h), advanced(start.w, w_dot, h)
    speeds = contact_speeds(selected, P, start.middle, v, w)
    return Ahead(v, w, speeds, free.limits, P.rolling_force)


class Found(NamedTuple):
    """What the first forces of a step were found to be, in the units of forces: kappa_i = 1/(h G_ii) times speeds."""

    forces: tuple  #: lambda of the contacts
    probes: tuple  #: s = lambda + kappa C nu
    G: tuple  #: kappa h G, by rows
    rates: tuple  #: kappa
    limits: tuple  #: of the boxes


@inlined
def corrected_ahead(selected, P, start, end, found, u, h):
    """Return the `Ahead` of a step under the forces half way to the velocities `end` that the first ones led to.

    The speeds at the step's end are those at its attitude: C_end nu = C nu + (C - C_before) nu to second order, with C
    half way.
    """
    v_end, w_end = parted(end)
    v, w = each(_mean, start.v, v_end), each(_mean, start.w, w_end)
    free = free_motion(selected, P, start.middle, v, w, u)
    later = contact_speeds(selected, P, start.middle, v_end, w_end)
    turning = each(_difference, later, contact_speeds(selected, P, start.before, v_end, w_end))
    first = contact_speeds(selected, P, start.before, start.v, start.w)
    turns = turns_about(selected, free.limits, P.rolling_force, found, first, turning)
    on = start.v[0] * v_end[0] + start.v[1] * v_end[1] > REST * REST
    brake = rolling_brake(P.rolling_force, math.sqrt(v[0] * v[0] + v[1] * v[1])) if on else 0.0
    known = each(_known, turns) + (brake * v[0], brake * v[1])
    F, L = contact_forces(selected, P, start.middle, known)
    v_dot, w_dot = solve(free.system, each(_difference, free.f_v, F), subtract(free.f_w, L))
    v, w = advanced(start.v, v_dot, h), advanced(start.w, w_dot, h)
    speeds = each(_sum, contact_speeds(selected, P, start.middle, v, w), turning)
    return Ahead(v, w, speeds, each(_left, turns, free.limits), 0.0 if on else P.rolling_force)


def turns_about(
    selected, limits, rolling_force, found, first, turning
) -> tuple:  # pragma: no cover (compiled form below)
    """Return `turn_about` of each box.

    What a force does to a contact's speed depends on which others stick: theirs follow, and leave them at rest. Of
    four wheels that all stick the forces are not unique; then none turns about.
    """
    raise NotImplementedError("compiled code only")


@by_types_of(turns_about)
def _turns_about(selected, limits, rolling_force, found, first, turning):
    k, m = len(limits), len(limits) + 2
    lines = ["forces, probes, G, rates, held = found"]
    for i in range(k):
        lines += [
            f"start{i} = first[{i}] * rates[{i}]",
            f"change{i} = probes[{i}] + turning[{i}] * rates[{i}] - forces[{i}] - start{i}",
            f"stops{i} = stops(start{i}, forces[{i}] + change{i}, held[{i}])",
            f"holds{i} = 1.0 - stops{i} if abs(probes[{i}]) < held[{i}] else 0.0",
        ]
    lines += [
        f"size2 = probes[{k}] * probes[{k}] + probes[{k + 1}] * probes[{k + 1}]",
        f"holds{k} = holds{k + 1} = 1.0 if size2 < rolling_force * rolling_force else 0.0",
    ]
    if len(selected.types[0]) == 4:
        slides = " or ".join(f"abs(probes[{i}]) >= held[{i}]" for i in range(4))
        lines += ["slides = 1.0 if " + slides + " else 0.0", *(f"stops{i} *= slides" for i in range(4))]
    rows, right = [], []
    for i in range(m):
        row = [f"holds{i} * G[{i}][{j}]" + (f" + 1.0 - holds{i}" if i == j else "") for j in range(m)]
        rows.append(f"({', '.join(row)},)")
        right.append(f"stops{i}" if i < k else "0.0")
    lines.append(f"x = solve_dense(({', '.join(rows)},), ({', '.join(right)},))")
    turns = []
    for i in range(k):
        easing = " + ".join(f"G[{i}][{j}] * x[{j}]" for j in range(m))
        lines.append(f"easing{i} = {easing} if stops{i} > 0.0 else 1.0")
        lines.append(
            f"stops{i}, easing{i} = (stops{i}, easing{i}) if easing{i} > {_LEAST_EASING} else (0.0, 1.0)"
        )
        turns.append(
            f"turn_about(start{i} / easing{i}, forces[{i}] + change{i} / easing{i}, limits[{i}], stops{i}), "
        )
    return written(
        "selected, limits, rolling_force, found, first, turning",
        f"({''.join(turns)})",
        *lines,
        stops=_stops,
        solve_dense=solve_dense,
        turn_about=_turn_about,
    )


#: of G_ii, what a force does to a contact's speed at least where others stick; less if these hold it themselves
_LEAST_EASING = 1e-3


#: of its friction, what takes a contact's speed away within the step if it is at rest but for the method's error
_RESTING = 1e-3


@inlined
def _stops(start, free, limit):
    """Return 1 where a contact that moves at the step's start comes to rest in it, else 0; see `_turn_about`."""
    moves = abs(start) > _RESTING * limit
    return 1.0 if moves and abs(start) < limit - sign(start) * free else 0.0


@inlined
def _turn_about(start, free, limit, stops):
    """Return whether a contact that stops within the step turns about, and its mean friction then.

    Its speed at the step's start is that which the force `start` would take away within the step. Without friction it
    would change by that of the force `free`. So, for a positive start, it stops after the share start / (limit - free)
    of the step, and turns back if free < -limit.
    """
    forward = sign(start)
    turns = stops > 0.0 and forward * free < -limit and limit > 0.0
    share = abs(start) / (limit - forward * free) if turns else 0.0
    return (turns, forward * limit * (2.0 * share - 1.0) if turns else 0.0)


@inlined
def _known(turn):
    return turn[1]


@inlined
def _left(turn, limit):
    return 0.0 if turn[0] else limit


@inlined
def _mean(a, b):
    return 0.5 * (a + b)


@inlined
def _difference(a, b):
    return a - b


@inlined
def finished(selected, state, middle, v_after, w_after, h):
    """Return the state after a step, half way through which the attitude is `middle`; rest stays rest."""
    v, w = ball_velocity(state), scale(add(body_velocity(state), w_after), 0.5)
    angles = advanced((state[2], state[3], state[4]), rates_of_angles(selected, middle, w), h)
    x, y = state[0] + 0.5 * h * (v[0] + v_after[0]), state[1] + 0.5 * h * (v[1] + v_after[1])
    return in_state_order((x, y), angles, v_after, w_after)
