/* Reference shaping: a jump becomes a smooth motion that the robot can follow.
 *
 * For x, y [m] and psi [rad] alike, the reference r passes a limit of speed, p follows r, and four equal lags
 *
 *     s_1' = w (p* - s_1),  s_2' = w (s_1 - s_2),  ..  s = s_4
 *     p* = p + (4/w + tau) r' + (6/w^2 + 4 tau/w + tau^2/2) r''
 *
 * so that s has four derivatives. The lead p* - p takes away what the lags and a predicted delay tau cost a motion
 * within the limit of speed. With d_i = s_i - p* and g = w h the lags are stepped exactly:
 *
 *     d_i(h) = exp(-g) (d_i + g d_(i-1) + g^2/2 d_(i-2) + g^3/6 d_(i-3))
 *
 * p and the lags are sums of many small steps: what rounding takes from one is added with the next.
 */
#include "compensated_sum.h"
#include "parts/parts.h"

/* rounding by which a motion at the limit of speed may exceed it */
#define ROUNDING (1e-3f)

/* The numbers of one axis's lags. */
struct lags {
    float frequency; /* w [rad/s] */
    float decay;     /* exp(-w h) */
    float gone;      /* 1 - exp(-w h), which a difference would round */
    float step;      /* g = w h */
};

/* Let the motion start at rest at a pose. */
static void start_at(struct ballbot_shaping_state *state, const float pose[3], const float r[3])
{
    for (int axis = 0; axis < 3; ++axis) {
        for (int i = 0; i < 4; ++i) {
            state->lags[axis][i] = pose[axis];
            state->lags_rest[axis][i] = 0.0f;
        }
        state->followed[axis] = pose[axis];
        state->followed_rest[axis] = 0.0f;
        state->last[axis] = r[axis];
    }
    state->started = 1;
}

void ballbot_shaping_restart(struct ballbot_memory *memory, const struct ballbot_sample *now)
{
    struct ballbot_shaping_state *state = &memory->shaping;
    const float r[3] = { now->reference[0], now->reference[1], now->reference[4] };

    start_at(state, r, r);
    for (int axis = 0; axis < 3; ++axis) {
        state->change[axis] = 0.0f;
        state->bend[axis] = 0.0f;
    }
}

/* Return how much of a bend counts, whose size is over the limit's. */
static float counted(float size)
{
    return ballbot_larger(0.0f, ballbot_smaller(1.0f, 2.0f - size));
}

/* Let the bends follow the change of the reference's changes since the last sample. */
static void follow_bends(const struct ballbot_shaping_record *own, struct ballbot_shaping_state *state,
                         const float change[3])
{
    const float n[3] = { change[0] - state->change[0], change[1] - state->change[1], change[2] - state->change[2] };
    const float moving = counted(ballbot_square_root(n[0] * n[0] + n[1] * n[1]) / own->kink);
    const float turning = counted(ballbot_magnitude(n[2]) / own->turning_kink);

    state->bend[0] += own->late * (moving * n[0] - state->bend[0]);
    state->bend[1] += own->late * (moving * n[1] - state->bend[1]);
    state->bend[2] += own->late * (turning * n[2] - state->bend[2]);
}

/* How far p* is ahead of p for the reference's change in a sample [1], and for that change's own [1]. */
struct leads {
    float of_change;
    float of_bend;
};

static struct leads leads_of(const struct ballbot_shaping_record *own, const struct lags *lags)
{
    const float w = lags->frequency;
    const float tau = own->delay;
    const float rate = own->rate;
    const struct leads found = {
        (4.0f / w + tau) * rate,
        (6.0f / (w * w) + 4.0f * tau / w + 0.5f * tau * tau) * rate * rate,
    };

    return found;
}

/* Fill how far p goes towards r within the limits of speed (3), and let it go. */
static void follow(const struct ballbot_shaping_record *own, struct ballbot_shaping_state *state, const float r[3],
                   float steps[3])
{
    float *const p = state->followed;
    float *const rest = state->followed_rest;
    const float d_x = (r[0] - p[0]) - rest[0];
    const float d_y = (r[1] - p[1]) - rest[1];
    const float distance = ballbot_square_root(d_x * d_x + d_y * d_y);
    const float share = (distance > own->speed) ? own->speed / distance : 1.0f;

    steps[0] = share * d_x;
    steps[1] = share * d_y;
    steps[2] = ballbot_clipped((r[2] - p[2]) - rest[2], own->turn);
    for (int axis = 0; axis < 3; ++axis) {
        ballbot_add(&p[axis], &rest[axis], steps[axis]);
    }
}

/* A place that is a sum, and what rounding has taken from it. */
struct sum {
    float value;
    float rest;
};

/* Return an axis's motion at the sample, relative to the pose, and step its four lags on to the next.
 *
 * `before` is p before the sample, `ahead` how far p* is ahead of that. Only differences of neighbouring places are
 * taken, which are exact in floating point, so that it does not matter how far from the origin the motion is.
 */
static struct ballbot_smooth lagged(const struct lags *lags, float s[4], float rest[4], struct sum before, float ahead,
                                    float pose)
{
    const float w = lags->frequency;
    const float a = lags->decay;
    const float gone = lags->gone;
    const float g = lags->step;
    const float half = 0.5f * g * g;
    const float sixth = g * g * g / 6.0f;
    const float w_2 = w * w;
    const float first = (s[0] - s[1]) + (rest[0] - rest[1]);
    const float second = (s[1] - s[2]) + (rest[1] - rest[2]);
    const float third = (s[2] - s[3]) + (rest[2] - rest[3]);
    const float d_1 = ((s[0] - before.value) + (rest[0] - before.rest)) - ahead;
    const float d_2 = d_1 - first;
    const float d_3 = d_2 - second;
    const float d_4 = d_3 - third;
    const struct ballbot_smooth motion = {
        (s[3] - pose) + rest[3],
        w * third,
        w_2 * (second - third),
        w_2 * w * (first - 2.0f * second + third),
        w_2 * w_2 * (3.0f * (second - first) - third - d_1),
    };

    ballbot_add(&s[0], &rest[0], -gone * d_1);
    ballbot_add(&s[1], &rest[1], a * g * d_1 - gone * d_2);
    ballbot_add(&s[2], &rest[2], a * (g * d_2 + half * d_1) - gone * d_3);
    ballbot_add(&s[3], &rest[3], a * (g * d_3 + half * d_2 + sixth * d_1) - gone * d_4);
    return motion;
}

void ballbot_shaping_shape(const struct ballbot_law *law, struct ballbot_memory *memory, struct ballbot_sample *now)
{
    const struct ballbot_shaping_record *own = &law->shaping;
    struct ballbot_shaping_state *state = &memory->shaping;

    if (own->on == 0) {
        return;
    }
    const struct lags place = { own->frequency, own->decay, own->gone, own->frequency / own->rate };
    const struct lags heading = { own->yaw_frequency, own->yaw_decay, own->yaw_gone, own->yaw_frequency / own->rate };
    const float r[3] = { now->reference[0], now->reference[1], now->reference[4] };
    float steps[3];

    if (state->started == 0) {
        const float pose[3] = { now->pose[0] + now->state[0], now->pose[1] + now->state[1],
                                now->pose[2] + now->state[4] };

        start_at(state, pose, r);
    }
    const float change[3] = { r[0] - state->last[0], r[1] - state->last[1], r[2] - state->last[2] };
    struct sum before[3];

    for (int axis = 0; axis < 3; ++axis) {
        before[axis].value = state->followed[axis];
        before[axis].rest = state->followed_rest[axis];
    }
    const float fastest = (1.0f + ROUNDING) * own->speed;
    const bool moves = change[0] * change[0] + change[1] * change[1] <= fastest * fastest;
    const bool turns = ballbot_magnitude(change[2]) <= (1.0f + ROUNDING) * own->turn;

    follow_bends(own, state, change);
    follow(own, state, r, steps);
    for (int axis = 0; axis < 3; ++axis) {
        state->last[axis] = r[axis];
        state->change[axis] = change[axis];
    }
    const struct leads moving = leads_of(own, &place);
    const struct leads turning = leads_of(own, &heading);
    const float lead_x = moves ? moving.of_change * change[0] + moving.of_bend * state->bend[0] : 0.0f;
    const float lead_y = moves ? moving.of_change * change[1] + moving.of_bend * state->bend[1] : 0.0f;
    const float lead_psi = turns ? turning.of_change * change[2] + turning.of_bend * state->bend[2] : 0.0f;

    now->x = lagged(&place, state->lags[0], state->lags_rest[0], before[0], steps[0] + lead_x, now->pose[0]);
    now->y = lagged(&place, state->lags[1], state->lags_rest[1], before[1], steps[1] + lead_y, now->pose[1]);
    now->psi = lagged(&heading, state->lags[2], state->lags_rest[2], before[2], steps[2] + lead_psi, now->pose[2]);
}
