/* Reference shaping: whatever the reference does becomes a motion that the robot can follow.
 *
 * For x and y [m] together and for psi [rad] alike, a point p with velocity v follows a target, and four lags follow p:
 *
 *     target = r + (1 - l) (t r' + c r'') - l (r'^2/(2 b) + t_0 r')    t = 4/w + tau,  c = 6/w^2 + 4 tau/w + tau^2/2
 *     p' = v,  |v'| <= a,  |v| <= the speed limit
 *     s_1' = w (p - s_1),  s_2' = w (s_1 - s_2),  ..  s = s_4
 *
 * so that s has four derivatives. Slow references are followed without delay (l = 0), fast ones as far behind as a stop
 * needs (l = 1). The torque against lasting disturbances takes its share of a. With d_i = s_i - p and g = w h the lags
 * are stepped exactly:
 *
 *     d_i(h) = exp(-g) (d_i + g d_(i-1) + g^2/2 d_(i-2) + g^3/6 d_(i-3))
 *
 * p and the lags are sums of many small steps: what rounding takes from one is added with the next.
 */
#include "compensated_sum.h"
#include "parts/parts.h"

/* as in ballbot.control.parts.reference_shaping */
#define ROUNDING (1e-3f)
#define LAG (0.046875f)
#define NOTICED (2.0f * LAG)
#define BRAKING (0.875f)
#define FAST (1.5f)
#define RESERVE (1.5f)
#define LASTING (1.0f)
#define LEAST_LEFT (0.25f)

/* Lags and limits of the position or of the heading. */
struct limits {
    float frequency; /* w [rad/s] */
    float decay;     /* exp(-w h) */
    float gone;      /* 1 - exp(-w h), which a difference would round */
    float step;      /* g = w h */
    float speed;
    float acceleration;
    float prompt;
    int first; /* its axes */
    int end;
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
        state->velocity[axis] = 0.0f;
        state->change[axis] = 0.0f;
        state->bend[axis] = 0.0f;
    }
}

/* Return the fraction of the limit of acceleration that lasting disturbances leave, and follow them. */
static float left(const struct ballbot_law *law, struct ballbot_memory *memory, struct ballbot_heading a)
{
    const float *sums = memory->integral.sums;
    const struct ballbot_pair I = ballbot_to_heading(a, sums[0], sums[1]);
    struct ballbot_shaping_state *state = &memory->shaping;
    float most = 0.0f;

    for (int i = 0; i < BALLBOT_MAX_WHEELS; ++i) {
        const float *gain = law->integral.gain[i];
        const float *more = memory->tuning.integral[i];
        const float lost = memory->disturbance_observer.estimate[i] + (gain[0] + more[0]) * I.x +
                           (gain[1] + more[1]) * I.y + (gain[2] + more[2]) * sums[2];

        most = ballbot_larger(most, ballbot_magnitude(lost));
    }
    state->lost += (most - state->lost) / (LASTING * law->shaping.rate + 1.0f);
    return ballbot_larger(LEAST_LEFT, 1.0f - RESERVE * state->lost / law->torque_limit);
}

void ballbot_shaping_slow(const struct ballbot_law *law, struct ballbot_memory *memory)
{
    memory->shaping.lost = law->torque_limit;
}

/* Return the length of the axes' part of a vector. */
static float length(const struct limits *of, const float v[3])
{
    float squared = 0.0f;

    for (int axis = of->first; axis < of->end; ++axis) {
        squared += v[axis] * v[axis];
    }
    return ballbot_square_root(squared);
}

/* Return by how much a vector of a length is to be multiplied, so that it is no longer than a limit. */
static float share(float of, float most)
{
    return (of > most) ? most / of : 1.0f;
}

/* Let r' and r'' follow the reference; a jump has no velocity. */
static void notice(const struct ballbot_shaping_record *own, const struct limits *of,
                   struct ballbot_shaping_state *state, const float r[3])
{
    float n[3];

    for (int axis = of->first; axis < of->end; ++axis) {
        n[axis] = own->rate * (r[axis] - state->last[axis]);
    }
    const float moves = (length(of, n) <= (1.0f + ROUNDING) * of->speed) ? 1.0f : 0.0f;

    for (int axis = of->first; axis < of->end; ++axis) {
        n[axis] = moves * n[axis] - state->change[axis];
    }
    const float size = 2.0f * own->late * own->rate * length(of, n) / of->acceleration;
    const float counts = ballbot_larger(0.0f, ballbot_smaller(1.0f, 2.0f - size));

    for (int axis = of->first; axis < of->end; ++axis) {
        state->bend[axis] += own->late * (counts * own->late * own->rate * n[axis] - state->bend[axis]);
        state->change[axis] += own->late * n[axis];
        state->last[axis] = r[axis];
    }
}

/* Let v follow what takes p to its target, and fill how far p goes. */
static void follow(const struct ballbot_shaping_record *own, const struct limits *of,
                   struct ballbot_shaping_state *state, const float r[3], float steps[3])
{
    const float w = of->frequency;
    const float tau = own->delay;
    const float braking = BRAKING * of->acceleration;
    const float near = braking / own->approach;
    float moving[3];
    float e[3];

    for (int axis = of->first; axis < of->end; ++axis) {
        moving[axis] = state->change[axis] + LAG * state->bend[axis];
    }
    const float speed = length(of, moving);
    const float prompt =
        ballbot_larger(0.0f, ballbot_smaller(1.0f, (FAST - speed / of->prompt) / (FAST - 1.0f)));
    const float t = prompt * (4.0f / w + tau);
    const float c = prompt * (6.0f / (w * w) + 4.0f * tau / w + 0.5f * tau * tau);
    const float ahead = t - (1.0f - prompt) * (0.5f * speed / braking + NOTICED);

    for (int axis = of->first; axis < of->end; ++axis) {
        const float away = (r[axis] - state->followed[axis]) - state->followed_rest[axis];

        e[axis] = away + ahead * moving[axis] + c * state->bend[axis];
    }
    const float pull = 2.0f * braking / (near + ballbot_square_root(near * near + 2.0f * braking * length(of, e)));

    for (int axis = of->first; axis < of->end; ++axis) {
        moving[axis] += t * state->bend[axis] + pull * e[axis];
    }
    const float slower = share(length(of, moving), of->speed);

    for (int axis = of->first; axis < of->end; ++axis) {
        moving[axis] = slower * moving[axis] - state->velocity[axis];
    }
    const float gently = share(length(of, moving), of->acceleration / own->rate);

    for (int axis = of->first; axis < of->end; ++axis) {
        state->velocity[axis] += gently * moving[axis];
        steps[axis] = state->velocity[axis] / own->rate;
    }
}

/* A place that is a sum, and what rounding has taken from it. */
struct sum {
    float value;
    float rest;
};

/* Return an axis's motion at the sample, relative to the pose, and step its four lags on to the next.
 *
 * `before` is p before the sample, `step` how far it has gone. Only differences of neighbouring places are
 * taken, which are exact in floating point, so that it does not matter how far from the origin the motion is.
 */
static struct ballbot_smooth lagged(const struct limits *lags, float s[4], float rest[4], struct sum before, float step,
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
    const float d_1 = ((s[0] - before.value) + (rest[0] - before.rest)) - step;
    const float d_2 = d_1 - first;
    const float d_3 = d_2 - second;
    const float d_4 = d_3 - third;
    const struct ballbot_smooth motion = {
        (s[3] - pose) + rest[3],
        w * third,
        w_2 * (second - third),
        w_2 * w * (first - 2.0f * second + third),
        w_2 * w_2 * (3.0f * (second - first) - third - d_1 - 0.5f * step),
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
    const struct limits place = {
        own->frequency, own->decay, own->gone, own->frequency / own->rate, own->speed,
        left(law, memory, now->a) * own->acceleration, own->prompt, 0, 2,
    };
    const struct limits heading = {
        own->yaw_frequency, own->yaw_decay, own->yaw_gone, own->yaw_frequency / own->rate, own->yaw_rate,
        own->yaw_acceleration, own->yaw_prompt, 2, 3,
    };
    const float r[3] = { now->reference[0], now->reference[1], now->reference[4] };
    float steps[3];
    struct sum before[3];

    if (state->started == 0) {
        const float pose[3] = { now->pose[0] + now->state[0], now->pose[1] + now->state[1],
                                now->pose[2] + now->state[4] };

        start_at(state, pose, r);
    }
    notice(own, &place, state, r);
    notice(own, &heading, state, r);
    follow(own, &place, state, r, steps);
    follow(own, &heading, state, r, steps);
    for (int axis = 0; axis < 3; ++axis) {
        before[axis].value = state->followed[axis];
        before[axis].rest = state->followed_rest[axis];
        ballbot_add(&state->followed[axis], &state->followed_rest[axis], steps[axis]);
    }
    now->x = lagged(&place, state->lags[0], state->lags_rest[0], before[0], steps[0], now->pose[0]);
    now->y = lagged(&place, state->lags[1], state->lags_rest[1], before[1], steps[1], now->pose[1]);
    now->psi = lagged(&heading, state->lags[2], state->lags_rest[2], before[2], steps[2], now->pose[2]);
}
