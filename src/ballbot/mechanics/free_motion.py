"""The two ends of a step in which friction may stick: the motion free of dry friction, and the state after."""

from typing import NamedTuple

from ballbot.mechanics.accelerations import forces_in
from ballbot.mechanics.compiled import by_types_of, inlined
from ballbot.mechanics.contacts import of_boxes
from ballbot.mechanics.equations import (
    balancing_attitude,
    ball_torque,
    rates_of_angles,
    terms,
    wheel_force,
    wheel_speeds,
)
from ballbot.mechanics.friction import dry_friction
from ballbot.mechanics.smooth import ball_velocity, body_velocity
from ballbot.mechanics.vector import add, advanced, each, scale


class FreeMotion(NamedTuple):
    """A robot at a step's start: velocities, mass matrix, forces other than dry friction, and its limits."""

    v: tuple
    w: tuple
    system: tuple  #: `Terms` or `SpinTerms`
    f_v: tuple
    f_w: tuple
    limits: tuple  #: of the boxes: the wheels' c + s exp(..), and pivoting [N m]


@inlined
def _free_torque(wheel, u, speed):
    return u - wheel.b * speed


@inlined
def _sum(a, b):
    return a + b


@inlined
def free_motion(selected, P, a, state, u):
    """Return the `FreeMotion` of a state with that attitude under wheel torques u; viscous friction is in it."""
    v, w = ball_velocity(state), body_velocity(state)
    system = terms(selected, P, a, v, w)
    speeds = wheel_speeds(selected, P, a, v, w)
    F, L = wheel_force(selected, P, a, ball_torque(P, each(_free_torque, P.wheels, u, speeds)))
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


def in_state_order(position, angles, v, w) -> tuple:  # pragma: no cover (compiled form below)
    """Return a state from its parts."""
    raise NotImplementedError("compiled code only")


@by_types_of(in_state_order)
def _in_state_order(position, angles, v, w):
    if len(v) == 2:
        return lambda position, angles, v, w: position + angles + v + w
    return lambda position, angles, v, w: position + angles + (v[0], v[1]) + w + (v[2],)
