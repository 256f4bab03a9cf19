"""Where friction acts: at the wheels, at the spin where the ball pivots, and at the ball's x and y, in this order.

C nu are the speeds there, C^T lambda the generalised forces of friction forces there, and G = C M^-1 C^T.
"""

from ballbot.mechanics.accelerations import solve
from ballbot.mechanics.compiled import by_types_of, inlined
from ballbot.mechanics.equations import ball_torque, wheel_force, wheel_speeds
from ballbot.mechanics.parameters import Pivoting
from ballbot.mechanics.vector import written


def contact_speeds(selected, P, a, v, w) -> tuple:  # pragma: no cover (compiled form below)
    """Return C nu: the speed at each contact."""
    raise NotImplementedError("compiled code only")


@by_types_of(contact_speeds)
def _contact_speeds(selected, P, a, v, w):
    if selected.instance_class is Pivoting:
        return lambda selected, P, a, v, w: wheel_speeds(selected, P, a, v, w) + (v[2], v[0], v[1])
    return lambda selected, P, a, v, w: wheel_speeds(selected, P, a, v, w) + (v[0], v[1])


def box_limits_of(selected, P, dry) -> tuple:  # pragma: no cover
    """Return the limits of the boxes, from the wheels' dry friction."""
    raise NotImplementedError("compiled code only")


@by_types_of(box_limits_of)
def _box_limits_of(selected, P, dry):
    if selected.instance_class is Pivoting:
        return lambda selected, P, dry: dry + (P.pivoting,)
    return lambda selected, P, dry: dry


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


def contact_matrix(selected, P, a, system, like) -> tuple:  # pragma: no cover
    """Return G = C M^-1 C^T by rows, one for each number of `like`."""
    raise NotImplementedError("compiled code only")


@by_types_of(contact_matrix)
def _contact_matrix(selected, P, a, system, like):
    m = len(like)
    units = ["(" + ", ".join("1.0" if i == j else "0.0" for j in range(m)) + ",)" for i in range(m)]
    rows = "(" + ", ".join(f"response(selected, P, a, system, {unit})" for unit in units) + ",)"
    return written("selected, P, a, system, like", rows, response=_response)


@inlined
def _response(selected, P, a, system, forces):
    """Return the accelerations at the contacts under forces there."""
    f_v, f_w = contact_forces(selected, P, a, forces)
    v_dot, w_dot = solve(system, f_v, f_w)
    return contact_speeds(selected, P, a, v_dot, w_dot)
