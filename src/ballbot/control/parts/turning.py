"""Turning: whatever the reference's heading does becomes a motion that the robot can follow.

A point p with rate v follows a target, and four lags follow p:

    target = r + (1 - l) (t r' + c r'') - l (r'^2/(2 b) + t_0 r')    t = 4/w + tau,  c = 6/w^2 + 4 tau/w + tau^2/2
    p' = v,  v' = w (asked - v),  |v'| <= a,  |v| <= the limit of the rate
    s_1' = w (p - s_1),  s_2' = w (s_1 - s_2),  ..  s = s_4

so that s has four derivatives. Far from its target p moves as fast as a deceleration of b can still stop it, near it at
the approach rate; b is somewhat below a. A heading that turns slowly is followed without delay (l is zero), over a
delay tau that is predicted over; one that turns fast may stop at any time, and is followed as far behind as a stop
needs (l is one), with t_0 to notice it.

r' and r'' are the reference's changes from sample to sample through lags of `LAG`, in which the steps of a rounded
reference vanish. A change faster than the limit is a jump, which has no rate; a change of the rate counts in full as
r'' up to half of a, and not at all from a on. With p held over a sample of h, d_i = s_i - p and g = w h, the lags are
stepped exactly:

    d_i(h) = exp(-g) (d_i + g d_(i-1) + g^2/2 d_(i-2) + g^3/6 d_(i-3))

and s'''' is that of the mean of p before and after its step.
"""

from ballbot.control.parts.part import SmoothReference, clipped
from ballbot.mechanics.engine.compensated_sum import add_to
from ballbot.mechanics.engine.compiled import inlined

# constants that single precision holds exactly, so that the firmware's are these
#: rounding by which a motion at its limit may exceed it
ROUNDING = 1e-3
#: lag of r' and r'' [s]
LAG = 0.046875
#: t_0 [s]: by then most of r' is gone after a stop
_NOTICED = 2.0 * LAG
#: deceleration b that p expects of itself, over the limit a
_BRAKING = 0.875
#: rate at which p comes to a target that is near [1/s]
_APPROACH = 4.0
#: ratio of the rates at which l is one and zero
FAST = 1.5


@inlined
def start_turning(state, psi, wanted):
    """Let the heading rest at an angle, with a reference elsewhere."""
    for i in range(4):
        state.lags[i], state.lags_rest[i] = psi, 0.0
    state.turned[0], state.turned_rest[0] = psi, 0.0
    state.turning, state.turn_change, state.turn_bend = 0.0, 0.0, 0.0
    state.last_psi = wanted


@inlined
def turn(own, state, psi, wanted):
    """Return the motion to a heading, relative to the measured one, and advance the memory."""
    away = wanted - state.turned[0] - state.turned_rest[0]
    _notice(own, state, wanted)
    missing = _asked(own, state, away) - state.turning
    share = min(1.0, own.yaw_frequency / own.rate)
    state.turning += clipped(share * missing, own.yaw_acceleration / own.rate)
    return _lagged(own, state, state.turning / own.rate, psi)


@inlined
def _notice(own, state, r):
    """Filter r' and r''; a jump has no rate, and r'' counts up to the limit."""
    d = r - state.last_psi
    rate = own.rate if own.rate * abs(d) <= (1.0 + ROUNDING) * own.yaw_rate else 0.0
    n = rate * d - state.turn_change
    counts = max(0.0, min(1.0, 2.0 - 2.0 * own.late_reference * own.rate * abs(n) / own.yaw_acceleration))
    bend = counts * own.late_reference * own.rate * n
    state.turn_bend += own.late_reference * (bend - state.turn_bend)
    state.turn_change += own.late_reference * n
    state.last_psi = r


@inlined
def _asked(own, state, away):
    """Return the rate asked of p once its lag has passed: that of its target, and what takes it there."""
    w, tau, braking = own.yaw_frequency, own.delay, _BRAKING * own.yaw_acceleration
    lag = max(1.0 / w, 1.0 / own.rate)
    now, bend = state.turn_change + LAG * state.turn_bend, state.turn_bend
    prompt = max(0.0, min(1.0, (FAST - abs(now) / own.yaw_prompt) / (FAST - 1.0)))
    t = prompt * (4.0 / w + tau)
    c = prompt * (6.0 / (w * w) + 4.0 * tau / w + 0.5 * tau * tau)
    ahead = t - (1.0 - prompt) * (0.5 * abs(now) / braking + _NOTICED)
    # how far p is from its target once the lag has passed
    e = away + ahead * now + c * bend + lag * (now + t * bend - state.turning)
    near = braking / _APPROACH
    pull = 2.0 * braking / (near + (near * near + 2.0 * braking * abs(e)) ** 0.5)
    return clipped(now + (t + lag) * bend + pull * e, own.yaw_rate)


@inlined
def _lagged(own, state, step, psi):
    """Return the motion at the sample, relative to a heading; let p make a step, and its four lags follow.

    Only differences of neighbouring angles are taken, which are exact in floating point.
    """
    s, rest = state.lags, state.lags_rest
    w, a, gone = own.yaw_frequency, own.yaw_decay, own.yaw_gone
    g = w / own.rate
    half, sixth = 0.5 * g * g, g * g * g / 6.0
    first = (s[0] - s[1]) + (rest[0] - rest[1])
    second = (s[1] - s[2]) + (rest[1] - rest[2])
    third = (s[2] - s[3]) + (rest[2] - rest[3])
    d_1 = ((s[0] - state.turned[0]) + (rest[0] - state.turned_rest[0])) - step
    d_2 = d_1 - first
    d_3 = d_2 - second
    d_4 = d_3 - third
    w_2 = w * w
    motion = SmoothReference(
        (s[3] - psi) + rest[3],
        w * third,
        w_2 * (second - third),
        w_2 * w * (first - 2.0 * second + third),
        w_2 * w_2 * (3.0 * (second - first) - third - d_1 - 0.5 * step),
    )
    add_to(state.turned, state.turned_rest, 0, step)
    add_to(s, rest, 0, -gone * d_1)
    add_to(s, rest, 1, a * g * d_1 - gone * d_2)
    add_to(s, rest, 2, a * (g * d_2 + half * d_1) - gone * d_3)
    add_to(s, rest, 3, a * (g * d_3 + half * d_2 + sixth * d_1) - gone * d_4)
    return motion
