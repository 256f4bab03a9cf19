"""Where friction acts: at the wheels, at the spin where the ball pivots, and at the ball's x and y, in this order.

C nu are the speeds there, C^T lambda the generalised forces of friction forces there, and G = C M^-1 C^T. A step in
which friction may stick is found in two passes: with the forces at its start (`first_ahead`), and with those half way
to where these lead (`corrected_ahead`), all at the attitude half way. It ends with `finished`.

So it has order two, also where a contact changes its sign. A contact that comes to rest and stays has no speed at the
end, whenever it stopped. One that turns about has its friction one way up to the instant of its stop, and the other way
after it: the second pass gives it the mean (`turns_about`).
"""

from typing import NamedTuple

from ballbot.mechanics.engine.smooth import ball_velocity, body_velocity, in_state_order
from ballbot.mechanics.engine.tracing import both, either, root, traced, where
from ballbot.mechanics.engine.vector import add, advanced, each, inner, scale, solve_dense, subtract
from ballbot.mechanics.equations import (
    Attitude,
    balancing_attitude,
    ball_torque,
    forces_in,
    rates_of_angles,
    solve,
    terms,
    wheel_force,
    wheel_speeds,
)
from ballbot.mechanics.floor import REST, rolling_brake
from ballbot.mechanics.friction import NO_TERMS, OwnWheel, Wheel, dry_friction, friction_shift, sign
from ballbot.mechanics.parameters import Pivoting


def contact_speeds(selected, P, a, v, w):
    """Return C nu: the speed at each contact."""
    return of_boxes(selected, wheel_speeds(selected, P, a, v, w), v[-1]) + (v[0], v[1])


def of_boxes(selected, of_wheels, of_spin):
    """Return the boxes' numbers: those of the wheels, and that of the spin where the ball pivots."""
    return (*of_wheels, of_spin) if isinstance(selected, Pivoting) else of_wheels


def contact_forces(selected, P, a, forces):
    """Return C^T lambda as (force on v, force on w)."""
    n = len(selected.wheels)
    F, L = wheel_force(selected, P, a, ball_torque(P, forces[:n]))
    on_floor = (F[0] + forces[-2], F[1] + forces[-1])
    return (on_floor + (F[2] + forces[n],) if len(F) == 3 else on_floor), L


def responses(selected, P, a, system, count):
    """Return M^-1 C^T by rows: accelerations v_dot + w_dot under a unit force at each of so many contacts."""
    rows = []
    for i in range(count):
        unit = tuple(1.0 if i == j else 0.0 for j in range(count))
        v_dot, w_dot = solve(system, *contact_forces(selected, P, a, unit))
        rows.append(v_dot + w_dot)
    return tuple(rows)


def contact_matrix(selected, P, a, Y):
    """Return G = C M^-1 C^T by rows, from Y = M^-1 C^T as `responses` returns it."""
    return tuple(contact_speeds(selected, P, a, *parted(row)) for row in Y)


def parted(nu):
    """Return (v, w) of velocities or accelerations v + w."""
    return nu[:-3], nu[-3:]


@traced
def wheel_side(P, rotor):
    """Return the robot beyond its gears: without rotors and their friction, which is on the motor's side."""
    bare = (
        wheel._replace(b=0.0, coulomb_asymmetry=0.0, factor=0.0)
        if isinstance(wheel, OwnWheel)
        else Wheel(wheel.axle, 0.0, 0.0, 0.0, NO_TERMS, 1.0, 1.0)
        for wheel in P.wheels
    )
    return P._replace(d1=P.d1 - rotor, d2=P.d2 - rotor, d3=P.d3 - rotor, wheels=tuple(bare))


class FreeMotion(NamedTuple):
    """A robot's mass matrix, its forces other than dry friction, and the limits of that."""

    system: tuple  #: `Terms` or `SpinTerms`
    f_v: tuple
    f_w: tuple
    limits: tuple  #: of the boxes: the wheels' c + s exp(..), and pivoting [N m]


@traced
def free_torque(wheel, u, speed):
    """Return a motor's torque less all friction that is a function of speed; the rest is in the symmetric box."""
    return u - wheel.b * speed - friction_shift(wheel, speed)


@traced
def free_motion(selected, P, a, v, w, u):
    """Return the `FreeMotion` at an attitude and velocities under wheel torques u; viscous friction is in it."""
    system = terms(selected, P, a, v, w)
    speeds = wheel_speeds(selected, P, a, v, w)
    F, L = wheel_force(selected, P, a, ball_torque(P, each(free_torque, P.wheels, u, speeds)))
    f_v, f_w = forces_in(system)
    limits = of_boxes(selected, each(dry_friction, P.wheels, speeds), P.pivoting)
    return FreeMotion(system, add(f_v, F), add(f_w, L), limits)


class StepStart(NamedTuple):
    """Where a step begins, and the attitude half way through it."""

    v: tuple
    w: tuple
    before: Attitude
    middle: Attitude  #: at the velocities of the start


@traced
def step_start(selected, state, h):
    """Return the `StepStart` of a state."""
    v, w = ball_velocity(state), body_velocity(state)
    before = balancing_attitude((state[2], state[3], state[4]))
    return StepStart(v, w, before, half_turned(selected, state, before, w, h))


def half_turned(selected, state, a, w, h):
    """Return the attitude half a step after that of a state, `a`, at body velocity w."""
    rates, half = rates_of_angles(selected, a, w), 0.5 * h
    return balancing_attitude(
        (state[2] + half * rates[0], state[3] + half * rates[1], state[4] + half * rates[2])
    )


class Ahead(NamedTuple):
    """Where a step would end without the friction that is still unknown, and the limits of that friction."""

    v: tuple
    w: tuple
    speeds: tuple  #: of the contacts
    limits: tuple  #: of the boxes; zero where the contact turns about and its friction is known
    rolling_force: float  #: of the disc; zero where the ball rolls on and its friction is known


@traced
def first_ahead(selected, P, start, free, h):
    """Return the `Ahead` of a step under the forces of its start, `free`."""
    v_dot, w_dot = solve(free.system, free.f_v, free.f_w)
    v, w = advanced(start.v, v_dot, h), advanced(start.w, w_dot, h)
    speeds = contact_speeds(selected, P, start.middle, v, w)
    return Ahead(v, w, speeds, free.limits, P.rolling_force)


class FirstForces(NamedTuple):
    """The first forces of a step; speeds are in units of forces, times kappa_i = 1/(h G_ii)."""

    forces: tuple  #: lambda of the contacts
    probes: tuple  #: s = lambda + kappa C nu
    G: tuple  #: kappa h G, by rows
    rates: tuple  #: kappa
    limits: tuple  #: of the boxes


@traced
def corrected_ahead(selected, P, start, end, solution, u, h):
    """Return the `Ahead` of a step under the forces half way to the velocities `end` that the first ones led to.

    The speeds at the step's end are those at its attitude: C_end nu = C nu + (C - C_before) nu to second order, with C
    half way.
    """
    v_end, w_end = parted(end)
    v, w = scale(add(start.v, v_end), 0.5), scale(add(start.w, w_end), 0.5)
    free = free_motion(selected, P, start.middle, v, w, u)
    later = contact_speeds(selected, P, start.middle, v_end, w_end)
    turning = subtract(later, contact_speeds(selected, P, start.before, v_end, w_end))
    first = contact_speeds(selected, P, start.before, start.v, start.w)
    turns, known = turns_about(selected, free.limits, P.rolling_force, solution, first, turning)
    on = start.v[0] * v_end[0] + start.v[1] * v_end[1] > REST * REST
    brake = where(on, rolling_brake(P.rolling_force, root(v[0] * v[0] + v[1] * v[1])), 0.0)
    F, L = contact_forces(selected, P, start.middle, (*known, brake * v[0], brake * v[1]))
    v_dot, w_dot = solve(free.system, subtract(free.f_v, F), subtract(free.f_w, L))
    v, w = advanced(start.v, v_dot, h), advanced(start.w, w_dot, h)
    speeds = add(contact_speeds(selected, P, start.middle, v, w), turning)
    limits = tuple(where(turn, 0.0, limit) for turn, limit in zip(turns, free.limits, strict=True))
    return Ahead(v, w, speeds, limits, where(on, 0.0, P.rolling_force))


#: of G_ii, what a force does to a contact's speed at least where others stick; less if these hold it themselves
_LEAST_EASING = 1e-3

#: of its friction, what takes a contact's speed away within the step if it is at rest but for the method's error
_RESTING = 1e-3


def turns_about(selected, limits, rolling_force, solution, first, turning):
    """Return whether each box turns about, and its mean friction then, as `_turn_about` does.

    What a force does to a contact's speed depends on which others stick: theirs follow, and leave them at rest. Of
    four wheels that all stick the forces are not unique; then none turns about.
    """
    forces, probes, G, rates, held = solution
    k, m = len(limits), len(limits) + 2
    starts = [first[i] * rates[i] for i in range(k)]
    changes = [probes[i] + turning[i] * rates[i] - forces[i] - starts[i] for i in range(k)]
    stops = [_stops(starts[i], forces[i] + changes[i], held[i]) for i in range(k)]
    holds = [where(abs(probes[i]) < held[i], 1.0 - stops[i], 0.0) for i in range(k)]
    on_floor = probes[k] * probes[k] + probes[k + 1] * probes[k + 1] < rolling_force * rolling_force
    holds += [where(on_floor, 1.0, 0.0)] * 2
    if len(selected.wheels) == 4:
        slides = where(either(*(abs(probes[i]) >= held[i] for i in range(4))), 1.0, 0.0)
        stops = [stop * slides for stop in stops[:4]] + stops[4:]
    rows = [
        [holds[i] * G[i][j] + (1.0 - holds[i]) if i == j else holds[i] * G[i][j] for j in range(m)]
        for i in range(m)
    ]
    x = solve_dense(rows, (*stops, 0.0, 0.0))
    turns = []
    for i in range(k):
        easing = where(stops[i] > 0.0, inner(G[i], x), 1.0)
        counts = easing > _LEAST_EASING
        stop, easing = where(counts, stops[i], 0.0), where(counts, easing, 1.0)
        turns.append(_turn_about(starts[i] / easing, forces[i] + changes[i] / easing, limits[i], stop))
    return zip(*turns, strict=True)


def _stops(start, free, limit):
    """Return 1 where a contact that moves at the step's start comes to rest in it, else 0; see `_turn_about`."""
    moves = abs(start) > _RESTING * limit
    return where(both(moves, abs(start) < limit - sign(start) * free), 1.0, 0.0)


def _turn_about(start, free, limit, stops):
    """Return whether a contact that stops within the step turns about, and its mean friction then.

    Its speed at the step's start is that which the force `start` would take away within the step. Without friction it
    would change by that of the force `free`. So, for a positive start, it stops after the share start / (limit - free)
    of the step, and turns back if free < -limit.
    """
    forward = sign(start)
    turns = both(stops > 0.0, forward * free < -limit, limit > 0.0)
    share = where(turns, abs(start) / (limit - forward * free), 0.0)
    return turns, where(turns, forward * limit * (2.0 * share - 1.0), 0.0)


@traced
def finished(selected, state, middle, v_after, w_after, h):
    """Return the state after a step, half way through which the attitude is `middle`; rest stays rest."""
    v, w = ball_velocity(state), scale(add(body_velocity(state), w_after), 0.5)
    angles = advanced((state[2], state[3], state[4]), rates_of_angles(selected, middle, w), h)
    x, y = state[0] + 0.5 * h * (v[0] + v_after[0]), state[1] + 0.5 * h * (v[1] + v_after[1])
    return in_state_order((x, y), angles, v_after, w_after)
