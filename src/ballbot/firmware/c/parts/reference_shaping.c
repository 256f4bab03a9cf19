/* Generated from ballbot/control/parts/reference_shaping.py by
 * `python -m tests.support.firmware_headers`; do not edit.
 *
 * Reference shaping: whatever the reference does becomes a motion that the robot can follow.
 *
 * For x and y together and for psi alike, a point p with velocity v follows a target, and four lags follow p:
 *
 *     target = r + (1 - l) (t r' + c r'') - l (r'^2/(2 b) + t_0 r')    t = 4/w + tau,  c = 6/w^2 + 4 tau/w + tau^2/2
 *     p' = v,  v' = w (asked - v),  |v'| <= a,  |v| <= the speed limit
 *     s_1' = w (p - s_1),  s_2' = w (s_1 - s_2),  ..  s = s_4
 *
 * so that s has four derivatives, which the feed-forward needs. Far from its target p moves as fast as a deceleration of b
 * can still stop it, near it at the approach rate; b is somewhat below a. v follows what is asked of it by a fifth lag, so
 * that a change from accelerating to braking is no jump of v'. What torque a wheel needs against lasting
 * disturbances, as on a slope, takes its share of a, so that the motors are left what a motion needs; so does the viscous
 * friction of a motion that speeds up (drag). While errors command more than the lean limit, as after a push, the robot
 * needs its torque to catch itself: a is least then, and comes back within a second. (Without this, a jump of the
 * reference soon after a push let robots fall that stand both with it.)
 *
 * A reference that moves slowly, such as a figure of eight, is followed without delay: then l is zero, and the target is
 * ahead of r by what the lags and a delay tau cost, which is predicted over. One that moves fast may stop at any time, and
 * a robot that is not to overshoot must brake first: then l is one, and s is behind r by what it needs to stop, with t_0
 * to notice it.
 *
 * r' and r'' are the reference's changes from sample to sample through lags of _LAG, in which the steps of a rounded
 * reference vanish. A change faster than the speed limit is a jump, which has no velocity; a change of velocity counts in
 * full as r'' up to half of a, and not at all from a on.
 *
 * With p held over a sample of h, d_i = s_i - p and g = w h, the lags are stepped exactly:
 *
 *     d_i(h) = exp(-g) (d_i + g d_(i-1) + g^2/2 d_(i-2) + g^3/6 d_(i-3))
 *
 * and s'''' is that of the mean of p before and after its step.
 */
#include "parts/steps.h"

/* rounding by which a motion at the limit of speed may exceed it */
#define ROUNDING 0.001f
/* deceleration b that p expects of itself, over the limit a */
#define BRAKING 0.875f
/* lag of r' and r'' [s] */
#define LAG 0.046875f
/* ratio of the speeds at which l is one and zero */
#define FAST 1.5f
/* t_0 [s]: by then most of r' is gone after a stop */
#define NOTICED 0.09375f
/* least fraction of the limit of acceleration that disturbances leave, and of these the drag */
#define LEAST_LEFT 0.25f
/* lag of the torque against disturbances [s] */
#define LASTING 1.0f
/* weight of the torque against disturbances: a motion that changes needs more than its acceleration does */
#define RESERVE 1.5f

/* Lags and limits of the position or of the heading. */
struct limits {
    float frequency; /* w [rad/s] */
    float decay; /* exp(-w h) */
    float gone; /* 1 - exp(-w h), which a difference would round */
    float step; /* g = w h */
    float speed;
    float acceleration;
    float drag;
    float prompt;
    float offset; /* of the flat output from the position, over the acceleration [s^2] */
};

/* The motion of the position or of the heading, whose second numbers are zero. */
struct motion {
    struct ballbot_pair velocity;
    struct ballbot_pair last;
    struct ballbot_pair change;
    struct ballbot_pair bend;
};

/* Let the motion start at rest at a pose. */
static void start(struct ballbot_shaping_state *state, struct ballbot_pose pose, struct ballbot_pose wanted)
{
    for (int32_t i = 0; i < 4; ++i) {
        state->lags[0][i] = pose.x;
        state->lags[1][i] = pose.y;
        state->lags[2][i] = pose.psi;
        state->lags_rest[0][i] = 0.0f;
        state->lags_rest[1][i] = 0.0f;
        state->lags_rest[2][i] = 0.0f;
    }
    state->followed[0] = pose.x;
    state->followed[1] = pose.y;
    state->followed[2] = pose.psi;
    state->followed_rest[0] = 0.0f;
    state->followed_rest[1] = 0.0f;
    state->followed_rest[2] = 0.0f;
    state->last[0] = wanted.x;
    state->last[1] = wanted.y;
    state->last[2] = wanted.psi;
    state->started = 1;
}

/* Let the shaping go on from a pose at rest: a plan, which is followed without it, ends there. */
void ballbot_restart_shaping(struct ballbot_memory *memory, struct ballbot_pose wanted)
{
    struct ballbot_shaping_state *own = &memory->shaping;

    start(own, wanted, wanted);
    for (int32_t axis = 0; axis < 3; ++axis) {
        own->velocity[axis] = 0.0f;
        own->change[axis] = 0.0f;
        own->bend[axis] = 0.0f;
    }
}

/* Return the motion of the position that the memory holds. */
static struct motion place_of(const struct ballbot_shaping_state *state)
{
    const float *v = state->velocity;
    const float *r = state->last;
    const float *change = state->change;
    const float *bend = state->bend;

    return (struct motion){ (struct ballbot_pair){ v[0], v[1] }, (struct ballbot_pair){ r[0], r[1] },
        (struct ballbot_pair){ change[0], change[1] }, (struct ballbot_pair){ bend[0], bend[1] } };
}

/* Return the motion of the heading that the memory holds. */
static struct motion turn_of(const struct ballbot_shaping_state *state)
{
    return (struct motion){ (struct ballbot_pair){ state->velocity[2], 0.0f }, (struct ballbot_pair){ state->last[2],
        0.0f }, (struct ballbot_pair){ state->change[2], 0.0f }, (struct ballbot_pair){ state->bend[2], 0.0f } };
}

/* Return v and a multiple of another vector. */
static struct ballbot_pair plus(struct ballbot_pair v, float factor, struct ballbot_pair other)
{
    return (struct ballbot_pair){ v.x + factor * other.x, v.y + factor * other.y };
}

/* Return the length of a vector. */
static float length(struct ballbot_pair v)
{
    return ballbot_square_root(v.x * v.x + v.y * v.y);
}

/* Return a motion with r' and r'' filtered; a jump has no velocity, and r'' counts up to the limit. */
static struct motion notice(const struct ballbot_shaping_record *own, const struct limits *limits,
        const struct motion *motion, struct ballbot_pair r)
{
    const struct ballbot_pair d = plus(r, -1.0f, motion->last);
    const float rate = (own->rate * length(d) <= (1.0f + ROUNDING) * limits->speed) ? own->rate : 0.0f;
    const struct ballbot_pair n = { rate * d.x - motion->change.x, rate * d.y - motion->change.y };
    const float counts = ballbot_larger(0.0f, ballbot_smaller(1.0f,
        2.0f - 2.0f * own->late * own->rate * length(n) / limits->acceleration));
    const float wanted = counts * own->late * own->rate;
    const struct ballbot_pair bend = { motion->bend.x + own->late * (wanted * n.x - motion->bend.x),
        motion->bend.y + own->late * (wanted * n.y - motion->bend.y) };

    return (struct motion){ motion->velocity, motion->last, plus(motion->change, own->late, n), bend };
}

/* Return a vector that is no longer than a limit. */
static struct ballbot_pair limited(struct ballbot_pair v, float most)
{
    const float size = length(v);
    const float share = (size > most) ? most / size : 1.0f;

    return (struct ballbot_pair){ share * v.x, share * v.y };
}

/* Return the velocity that is asked of p once its lag has passed: that of its target, and what takes it there. */
static struct ballbot_pair ask(const struct ballbot_shaping_record *own, const struct limits *limits,
        const struct motion *motion, struct ballbot_pair away)
{
    const float w = limits->frequency;
    const float tau = own->delay;
    const float braking = BRAKING * limits->acceleration;
    const float lag = ballbot_larger(1.0f / w, 1.0f / own->rate);
    const struct ballbot_pair now = plus(motion->change, LAG, motion->bend);
    const float speed = length(now);
    const float prompt = ballbot_larger(0.0f, ballbot_smaller(1.0f, (FAST - speed / limits->prompt) / (FAST - 1.0f)));
    const float t = prompt * (4.0f / w + tau);
    const float c = prompt * (6.0f / (w * w) + 4.0f * tau / w + 0.5f * tau * tau + limits->offset);
    const float ahead = t - (1.0f - prompt) * (0.5f * speed / braking + NOTICED);
    /* how far p is from its target once the lag has passed */
    const struct ballbot_pair closing = plus(plus(now, t, motion->bend), -1.0f, motion->velocity);
    const struct ballbot_pair e = plus(plus(plus(away, ahead, now), c, motion->bend), lag, closing);
    const float near = braking / own->approach;
    const float pull = 2.0f * braking / (near + ballbot_square_root(near * near + 2.0f * braking * length(e)));

    return limited(plus(plus(now, t + lag, motion->bend), pull, e), limits->speed);
}

/* Return a motion after a sample with the reference r, which is away from p. */
static struct motion moved(const struct ballbot_shaping_record *own, const struct limits *limits,
        const struct motion *motion, struct ballbot_pair r, struct ballbot_pair away)
{
    const struct motion noticed = notice(own, limits, motion, r);
    const struct ballbot_pair asked = ask(own, limits, &noticed, away);
    const float share = ballbot_smaller(1.0f, limits->step);
    const struct ballbot_pair missing = plus(asked, -1.0f, motion->velocity);
    const float along = missing.x * motion->velocity.x + missing.y * motion->velocity.y;
    const float dragged = limits->drag * ballbot_larger(0.0f, along) / ballbot_larger(length(missing),
        ROUNDING * limits->speed);
    const float most = ballbot_larger(limits->acceleration - dragged, LEAST_LEFT * limits->acceleration);
    const struct ballbot_pair change = limited((struct ballbot_pair){ share * missing.x, share * missing.y },
        most / own->rate);

    return (struct motion){ plus(motion->velocity, 1.0f, change), r, noticed.change, noticed.bend };
}

/* Put both motions into the memory. */
static void keep(struct ballbot_shaping_state *state, const struct motion *place, const struct motion *turn)
{
    float *v = state->velocity;
    float *r = state->last;
    float *change = state->change;
    float *bend = state->bend;

    v[0] = place->velocity.x;
    v[1] = place->velocity.y;
    v[2] = turn->velocity.x;
    r[0] = place->last.x;
    r[1] = place->last.y;
    r[2] = turn->last.x;
    change[0] = place->change.x;
    change[1] = place->change.y;
    change[2] = turn->change.x;
    bend[0] = place->bend.x;
    bend[1] = place->bend.y;
    bend[2] = turn->bend.x;
}

/* Return an axis's motion at the sample, relative to the pose; let p make a step, and its four lags follow.
 *
 * Only differences of neighbouring places are taken, which are exact in floating point, so that it does not matter
 * how far from the origin the motion is.
 */
static struct ballbot_smooth_reference lagged(const struct limits *lags, struct ballbot_shaping_state *state,
        int32_t axis, float step, float pose)
{
    float *s = state->lags[axis];
    float *rest = state->lags_rest[axis];
    const float w = lags->frequency;
    const float a = lags->decay;
    const float g = lags->step;
    const float gone = lags->gone;
    const float half = 0.5f * g * g;
    const float sixth = g * g * g / 6.0f;
    const float first = s[0] - s[1] + (rest[0] - rest[1]);
    const float second = s[1] - s[2] + (rest[1] - rest[2]);
    const float third = s[2] - s[3] + (rest[2] - rest[3]);
    const float d_1 = s[0] - state->followed[axis] + (rest[0] - state->followed_rest[axis]) - step;
    const float d_2 = d_1 - first;
    const float d_3 = d_2 - second;
    const float d_4 = d_3 - third;
    const float w_2 = w * w;
    const struct ballbot_smooth_reference motion = { s[3] - pose + rest[3], w * third, w_2 * (second - third),
        w_2 * w * (first - 2.0f * second + third),
        w_2 * w_2 * (3.0f * (second - first) - third - d_1 - 0.5f * step) };

    ballbot_add(&state->followed[axis], &state->followed_rest[axis], step);
    ballbot_add(&s[0], &rest[0], -gone * d_1);
    ballbot_add(&s[1], &rest[1], a * g * d_1 - gone * d_2);
    ballbot_add(&s[2], &rest[2], a * (g * d_2 + half * d_1) - gone * d_3);
    ballbot_add(&s[3], &rest[3], a * (g * d_3 + half * d_2 + sixth * d_1) - gone * d_4);
    return motion;
}

/* Return the shaped heading, relative to the measured one, and advance the memory. */
struct ballbot_smooth_reference ballbot_shape_heading(const struct ballbot_law *law, struct ballbot_memory *memory,
        struct ballbot_pose pose, const struct ballbot_predicted *ahead, struct ballbot_pose wanted)
{
    const struct ballbot_shaping_record *own = &law->shaping;
    struct ballbot_shaping_state *state = &memory->shaping;

    if (state->started == 0) {
        start(state, (struct ballbot_pose){ pose.x, pose.y, pose.psi + ahead->state.psi }, wanted);
    }
    const struct limits heading = { own->yaw_frequency, own->yaw_decay, own->yaw_gone,
        own->yaw_frequency / own->rate, own->yaw_rate, own->yaw_acceleration, 0.0f, own->yaw_prompt, 0.0f };
    const struct ballbot_pair turn = { wanted.psi - state->followed[2] - state->followed_rest[2], 0.0f };
    const struct motion place = place_of(state);
    const struct motion turn_before = turn_of(state);
    const struct motion turn_after = moved(own, &heading, &turn_before, (struct ballbot_pair){ wanted.psi, 0.0f },
        turn);

    keep(state, &place, &turn_after);
    return lagged(&heading, state, 2, state->velocity[2] / own->rate, pose.psi);
}

/* Return the fraction of the limit of acceleration that lasting disturbances leave, and follow them. */
static float left(const struct ballbot_law *law, struct ballbot_memory *memory, struct ballbot_heading_frame a)
{
    struct ballbot_shaping_state *own = &memory->shaping;
    const float *sums = memory->integral.sums;
    float most = 0.0f;
    const struct ballbot_pair I = ballbot_turned(a, sums[0], sums[1]);

    for (int32_t i = 0; i < BALLBOT_MAX_WHEELS; ++i) {
        const float *gain = law->integral.gain[i];
        const float *more = memory->tuning.integral[i];
        const float by_place = (gain[0] + more[0]) * I.x + (gain[1] + more[1]) * I.y;
        const float lost = memory->disturbance_observer.estimate[i] + by_place + (gain[2] + more[2]) * sums[2];

        most = ballbot_larger(most, ballbot_magnitude(lost));
    }
    own->lost += (most - own->lost) / (LASTING * law->shaping.rate + 1.0f);
    return ballbot_larger(LEAST_LEFT, 1.0f - RESERVE * own->lost / law->torque_limit);
}

/* Return the shaped motion to a pose, relative to the measured one, and advance the memory. */
struct ballbot_followed_motion ballbot_shape(const struct ballbot_law *law, struct ballbot_memory *memory,
        struct ballbot_pose pose, const struct ballbot_predicted *ahead, struct ballbot_pose wanted)
{
    const struct ballbot_shaping_record *own = &law->shaping;
    struct ballbot_shaping_state *state = &memory->shaping;
    const float h = 1.0f / own->rate;
    const float acceleration = left(law, memory, ahead->a) * own->acceleration;
    const float offset = law->feed_forward.offset[0][0]; /* along y hardly another */
    const float w = own->frequency;
    const float g = own->frequency * h;
    const float drag = own->drag;
    const struct limits place = { w, own->decay, own->gone, g, own->speed, acceleration, drag, own->prompt, offset };
    const struct limits heading = { own->yaw_frequency, own->yaw_decay, own->yaw_gone, own->yaw_frequency * h,
        own->yaw_rate, own->yaw_acceleration, 0.0f, own->yaw_prompt, 0.0f };

    if (state->started == 0) {
        const struct ballbot_pose begun = { pose.x + ahead->state.x, pose.y + ahead->state.y,
            pose.psi + ahead->state.psi };

        start(state, begun, wanted);
    }
    const float *p = state->followed;
    const float *rest = state->followed_rest;
    const struct ballbot_pair away = { wanted.x - p[0] - rest[0], wanted.y - p[1] - rest[1] };
    const struct ballbot_pair turn = { wanted.psi - p[2] - rest[2], 0.0f };
    const struct motion place_before = place_of(state);
    const struct motion turn_before = turn_of(state);
    const struct motion place_after = moved(own, &place, &place_before, (struct ballbot_pair){ wanted.x, wanted.y },
        away);
    const struct motion turn_after = moved(own, &heading, &turn_before, (struct ballbot_pair){ wanted.psi, 0.0f },
        turn);

    keep(state, &place_after, &turn_after);
    return (struct ballbot_followed_motion){ lagged(&place, state, 0, h * state->velocity[0], pose.x), lagged(&place,
        state, 1, h * state->velocity[1], pose.y), lagged(&heading, state, 2, h * state->velocity[2], pose.psi) };
}

/* Leave motions the least acceleration: the robot needs its torque to catch itself. */
void ballbot_slow_motion(const struct ballbot_law *law, struct ballbot_memory *memory)
{
    memory->shaping.lost = law->torque_limit;
}
