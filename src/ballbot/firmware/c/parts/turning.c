/* Generated from ballbot/control/parts/turning.py by
 * `python -m tests.support.firmware_headers`; do not edit.
 *
 * Turning: whatever the reference's heading does becomes a motion that the robot can follow.
 *
 * A point p with rate v follows a target, and four lags follow p:
 *
 *     target = r + (1 - l) (t r' + c r'') - l (r'^2/(2 b) + t_0 r')    t = 4/w + tau,  c = 6/w^2 + 4 tau/w + tau^2/2
 *     p' = v,  v' = w (asked - v),  |v'| <= a,  |v| <= the limit of the rate
 *     s_1' = w (p - s_1),  s_2' = w (s_1 - s_2),  ..  s = s_4
 *
 * so that s has four derivatives. Far from its target p moves as fast as a deceleration of b can still stop it, near it at
 * the approach rate; b is somewhat below a. A heading that turns slowly is followed without delay (l is zero), over a
 * delay tau that is predicted over; one that turns fast may stop at any time, and is followed as far behind as a stop
 * needs (l is one), with t_0 to notice it.
 *
 * r' and r'' are the reference's changes from sample to sample through lags of LAG, in which the steps of a rounded
 * reference vanish. A change faster than the limit is a jump, which has no rate; a change of the rate counts in full as
 * r'' up to half of a, and not at all from a on. With p held over a sample of h, d_i = s_i - p and g = w h, the lags are
 * stepped exactly:
 *
 *     d_i(h) = exp(-g) (d_i + g d_(i-1) + g^2/2 d_(i-2) + g^3/6 d_(i-3))
 *
 * and s'''' is that of the mean of p before and after its step.
 */
#include "parts/steps.h"

/* rounding by which a motion at its limit may exceed it */
#define ROUNDING 0.001f
/* deceleration b that p expects of itself, over the limit a */
#define BRAKING 0.875f
/* lag of r' and r'' [s] */
#define LAG 0.046875f
/* ratio of the rates at which l is one and zero */
#define FAST 1.5f
/* t_0 [s]: by then most of r' is gone after a stop */
#define NOTICED 0.09375f
/* rate at which p comes to a target that is near [1/s] */
#define APPROACH 4.0f

/* Let the heading rest at an angle, with a reference elsewhere. */
void ballbot_start_turning(struct ballbot_planner_state *state, float psi, float wanted)
{
    for (int32_t i = 0; i < 4; ++i) {
        state->lags[i] = psi;
        state->lags_rest[i] = 0.0f;
    }
    state->turned[0] = psi;
    state->turned_rest[0] = 0.0f;
    state->turning = 0.0f;
    state->turn_change = 0.0f;
    state->turn_bend = 0.0f;
    state->last_psi = wanted;
}

/* Filter r' and r''; a jump has no rate, and r'' counts up to the limit. */
static void notice(const struct ballbot_planner_record *own, struct ballbot_planner_state *state, float r)
{
    const float d = r - state->last_psi;
    const float rate = (own->rate * ballbot_magnitude(d) <= (1.0f + ROUNDING) * own->yaw_rate) ? own->rate : 0.0f;
    const float n = rate * d - state->turn_change;
    const float counts = ballbot_larger(0.0f, ballbot_smaller(1.0f,
        2.0f - 2.0f * own->late_reference * own->rate * ballbot_magnitude(n) / own->yaw_acceleration));
    const float bend = counts * own->late_reference * own->rate * n;

    state->turn_bend += own->late_reference * (bend - state->turn_bend);
    state->turn_change += own->late_reference * n;
    state->last_psi = r;
}

/* Return the rate asked of p once its lag has passed: that of its target, and what takes it there. */
static float asked(const struct ballbot_planner_record *own, const struct ballbot_planner_state *state, float away)
{
    const float w = own->yaw_frequency;
    const float tau = own->delay;
    const float braking = BRAKING * own->yaw_acceleration;
    const float lag = ballbot_larger(1.0f / w, 1.0f / own->rate);
    const float now = state->turn_change + LAG * state->turn_bend;
    const float bend = state->turn_bend;
    const float prompt = ballbot_larger(0.0f, ballbot_smaller(1.0f,
        (FAST - ballbot_magnitude(now) / own->yaw_prompt) / (FAST - 1.0f)));
    const float t = prompt * (4.0f / w + tau);
    const float c = prompt * (6.0f / (w * w) + 4.0f * tau / w + 0.5f * tau * tau);
    const float ahead = t - (1.0f - prompt) * (0.5f * ballbot_magnitude(now) / braking + NOTICED);
    /* how far p is from its target once the lag has passed */
    const float e = away + ahead * now + c * bend + lag * (now + t * bend - state->turning);
    const float near = braking / APPROACH;
    const float pull = 2.0f * braking / (near + ballbot_square_root(near * near
        + 2.0f * braking * ballbot_magnitude(e)));

    return ballbot_clipped(now + (t + lag) * bend + pull * e, own->yaw_rate);
}

/* Return the motion at the sample, relative to a heading; let p make a step, and its four lags follow.
 *
 * Only differences of neighbouring angles are taken, which are exact in floating point.
 */
static struct ballbot_smooth_reference lagged(const struct ballbot_planner_record *own,
        struct ballbot_planner_state *state, float step, float psi)
{
    float *s = state->lags;
    float *rest = state->lags_rest;
    const float w = own->yaw_frequency;
    const float a = own->yaw_decay;
    const float gone = own->yaw_gone;
    const float g = w / own->rate;
    const float half = 0.5f * g * g;
    const float sixth = g * g * g / 6.0f;
    const float first = s[0] - s[1] + (rest[0] - rest[1]);
    const float second = s[1] - s[2] + (rest[1] - rest[2]);
    const float third = s[2] - s[3] + (rest[2] - rest[3]);
    const float d_1 = s[0] - state->turned[0] + (rest[0] - state->turned_rest[0]) - step;
    const float d_2 = d_1 - first;
    const float d_3 = d_2 - second;
    const float d_4 = d_3 - third;
    const float w_2 = w * w;
    const struct ballbot_smooth_reference motion = { s[3] - psi + rest[3], w * third, w_2 * (second - third),
        w_2 * w * (first - 2.0f * second + third),
        w_2 * w_2 * (3.0f * (second - first) - third - d_1 - 0.5f * step) };

    ballbot_add(&state->turned[0], &state->turned_rest[0], step);
    ballbot_add(&s[0], &rest[0], -gone * d_1);
    ballbot_add(&s[1], &rest[1], a * g * d_1 - gone * d_2);
    ballbot_add(&s[2], &rest[2], a * (g * d_2 + half * d_1) - gone * d_3);
    ballbot_add(&s[3], &rest[3], a * (g * d_3 + half * d_2 + sixth * d_1) - gone * d_4);
    return motion;
}

/* Return the motion to a heading, relative to the measured one, and advance the memory. */
struct ballbot_smooth_reference ballbot_turn(const struct ballbot_planner_record *own,
        struct ballbot_planner_state *state, float psi, float wanted)
{
    const float away = wanted - state->turned[0] - state->turned_rest[0];

    notice(own, state, wanted);
    const float missing = asked(own, state, away) - state->turning;
    const float share = ballbot_smaller(1.0f, own->yaw_frequency / own->rate);

    state->turning += ballbot_clipped(share * missing, own->yaw_acceleration / own->rate);
    return lagged(own, state, state->turning / own->rate, psi);
}
