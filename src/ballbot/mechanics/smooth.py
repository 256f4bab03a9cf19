"""The motion between two changes of sign: friction is a smooth force there, and RK4 has order four.

A trial step is taken with the signs of its start. It counts only if no speed whose friction matters has
crossed zero at any stage or at the end; otherwise `ballbot.mechanics.stick_slip` takes the step.
"""

from ballbot.mechanics.compiled import inlined
from ballbot.mechanics.equations import (
    attitude,
    ball_torque,
    rates_of_angles,
    solve,
    terms,
    wheel_force,
    wheel_speeds,
)
from ballbot.mechanics.friction import dry_friction, sign
from ballbot.mechanics.vector import add, each_of_four, each_pair, smallest

# A state here is the ten numbers (x, y, theta, phi, psi, v_x, v_y, w_1, w_2, w_3).


@inlined
def known_sign(wheel, speed):
    """Return the sign of a wheel's speed, or 2 where it has no dry friction and signs do not matter."""
    return sign(speed) if wheel.c + wheel.s > 0.0 else 2.0


@inlined
def _keeps_sign(sign_at_start, speed):
    """Return what stays positive while the speed keeps its sign."""
    return 1.0 if sign_at_start == 2.0 else sign_at_start * speed


@inlined
def _wheel_torque(wheel, u, speed, sign_at_start):
    """Return u - tau(w) of one wheel."""
    direction = 0.0 if sign_at_start == 2.0 else sign_at_start
    return u - wheel.b * speed - direction * dry_friction(wheel, speed)


@inlined
def acceleration(selected, P, a, v, w, u, signs, rolling):
    """Return (v_dot, w_dot) with friction of known signs, and the wheel speeds.

    `rolling` is N C_rr, or zero to leave rolling friction out; the ball must be moving for it.
    """
    system = terms(selected, P, a, v, w)
    speeds = wheel_speeds(selected, P, a, v, w)
    T = ball_torque(P, each_of_four(_wheel_torque, P.wheels, u, speeds, signs))
    F, L = wheel_force(selected, P, a, T)
    brake = rolling / max((v[0] * v[0] + v[1] * v[1]) ** 0.5, 1e-300)
    force_v = (system.f_v[0] + F[0] - brake * v[0], system.f_v[1] + F[1] - brake * v[1])
    v_dot, w_dot = solve(system, force_v, add(system.f_w, L))
    return v_dot, w_dot, speeds


@inlined
def derivative(selected, P, state, u, signs, rolling):
    """Return the state's rate of change and the wheel speeds."""
    a = attitude((state[2], state[3], state[4]))
    v, w = (state[5], state[6]), (state[7], state[8], state[9])
    v_dot, w_dot, speeds = acceleration(selected, P, a, v, w, u, signs, rolling)
    rates = rates_of_angles(selected, a, w)
    return (
        v[0],
        v[1],
        rates[0],
        rates[1],
        rates[2],
        v_dot[0],
        v_dot[1],
        w_dot[0],
        w_dot[1],
        w_dot[2],
    ), speeds


@inlined
def moved(state, rate, h):
    """Return state + h rate."""
    return (
        state[0] + h * rate[0],
        state[1] + h * rate[1],
        state[2] + h * rate[2],
        state[3] + h * rate[3],
        state[4] + h * rate[4],
        state[5] + h * rate[5],
        state[6] + h * rate[6],
        state[7] + h * rate[7],
        state[8] + h * rate[8],
        state[9] + h * rate[9],
    )


@inlined
def _weighted(k1, k2, k3, k4):
    return (k1 + 2.0 * (k2 + k3) + k4) * (1.0 / 6.0)


@inlined
def mean_rate(k1, k2, k3, k4):
    """Return (k1 + 2 k2 + 2 k3 + k4)/6."""
    return (
        _weighted(k1[0], k2[0], k3[0], k4[0]),
        _weighted(k1[1], k2[1], k3[1], k4[1]),
        _weighted(k1[2], k2[2], k3[2], k4[2]),
        _weighted(k1[3], k2[3], k3[3], k4[3]),
        _weighted(k1[4], k2[4], k3[4], k4[4]),
        _weighted(k1[5], k2[5], k3[5], k4[5]),
        _weighted(k1[6], k2[6], k3[6], k4[6]),
        _weighted(k1[7], k2[7], k3[7], k4[7]),
        _weighted(k1[8], k2[8], k3[8], k4[8]),
        _weighted(k1[9], k2[9], k3[9], k4[9]),
    )


@inlined
def _smallest_kept(signs, speeds):
    return smallest(each_pair(_keeps_sign, signs, speeds))


@inlined
def speeds_of_state(selected, P, state):
    """Return the wheel speeds of a state."""
    a = attitude((state[2], state[3], state[4]))
    return wheel_speeds(selected, P, a, (state[5], state[6]), (state[7], state[8], state[9]))


@inlined
def _still_rolling(rolling, start, state):
    """Return what stays positive while the ball keeps rolling forward."""
    return start[5] * state[5] + start[6] * state[6] if rolling > 0.0 else 1.0


@inlined
def runge_kutta_step(selected, P, state, u, h):
    """Take one RK4 step with the friction's signs of its start.

    Returns
    -------
    state : tuple of 10
    margin : float
        Positive where no friction changed its sign within the step, so that the step counts.
    """
    speeds = speeds_of_state(selected, P, state)
    signs = each_pair(known_sign, P.wheels, speeds)

    k1, speeds1 = derivative(selected, P, state, u, signs, P.rolling)
    second = moved(state, k1, 0.5 * h)
    k2, speeds2 = derivative(selected, P, second, u, signs, P.rolling)
    third = moved(state, k2, 0.5 * h)
    k3, speeds3 = derivative(selected, P, third, u, signs, P.rolling)
    fourth = moved(state, k3, h)
    k4, speeds4 = derivative(selected, P, fourth, u, signs, P.rolling)
    end = moved(state, mean_rate(k1, k2, k3, k4), h)
    margin = min(
        min(_smallest_kept(signs, speeds1), _smallest_kept(signs, speeds2)),
        min(_smallest_kept(signs, speeds3), _smallest_kept(signs, speeds4)),
    )
    margin = min(margin, _smallest_kept(signs, speeds_of_state(selected, P, end)))
    margin = min(
        margin, min(_still_rolling(P.rolling, state, second), _still_rolling(P.rolling, state, third))
    )
    margin = min(margin, min(_still_rolling(P.rolling, state, fourth), _still_rolling(P.rolling, state, end)))
    margin = min(margin, _still_rolling(P.rolling, state, state))
    return end, margin
