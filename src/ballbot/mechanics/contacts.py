"""Where friction acts: at the wheels, at the spin where the ball pivots, and at the ball's x and y, in this order.

C nu are the speeds there, C^T lambda the generalised forces of friction forces there, and G = C M^-1 C^T. A step in
which friction may stick begins with the motion free of dry friction (`free_motion`) and ends with the state after it
(`finished`).
"""

from typing import NamedTuple

from ballbot.mechanics.accelerations import forces_in, solve
from ballbot.mechanics.engine.compiled import by_types_of, inlined
from ballbot.mechanics.engine.smooth import ball_velocity, body_velocity, in_state_order
from ballbot.mechanics.engine.vector import add, advanced, each, scale, written
from ballbot.mechanics.equations import (
    balancing_attitude,
    ball_torque,
    rates_of_angles,
    terms,
    wheel_force,
    wheel_speeds,
)
from ballbot.mechanics.friction import dry_friction, friction_shift, has_directions
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
    """A robot at a step's start: velocities, mass matrix, forces other than dry friction, and its limits."""

    v: tuple
    w: tuple
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
def free_motion(selected, P, a, state, u):
    """Return the `FreeMotion` of a state with that attitude under wheel torques u; viscous friction is in it."""
    v, w = ball_velocity(state), body_velocity(state)
    system = terms(selected, P, a, v, w)
    speeds = wheel_speeds(selected, P, a, v, w)
    F, L = wheel_force(selected, P, a, ball_torque(P, each(free_torque, P.wheels, u, speeds)))
    f_v, f_w = forces_in(system)
    limits = of_boxes(selected, each(dry_friction, P.wheels, speeds), P.pivoting)
    return FreeMotion(v, w, system, each(_sum, f_v, F), add(f_w, L), limits)


@inlined
def finished(selected, state, a, v_after, w_after, h):
    """Return the state after a step: positions by the mean velocity, angles by the midpoint rule; rest stays rest.

    `a` is the attitude of the state before.
    """
    v = ball_velocity(state)
    middle = scale(add(body_velocity(state), w_after), 0.5)
    rates = rates_of_angles(selected, a, middle)
    half = 0.5 * h
    a = balancing_attitude(
        (state[2] + half * rates[0], state[3] + half * rates[1], state[4] + half * rates[2])
    )
    angles = advanced((state[2], state[3], state[4]), rates_of_angles(selected, a, middle), h)
    x, y = state[0] + half * (v[0] + v_after[0]), state[1] + half * (v[1] + v_after[1])
    return in_state_order((x, y), angles, v_after, w_after)
