#include "attitude.h"

#include <stdbool.h>

#include "ballbot_math.h"

/* A turn [rad], and by how much its rounding is too large. */
#define TURN 6.2831855f
#define TURN_ROUNDING 1.7484556e-7f
/* The smallest jump that is a wrap [rad]. */
#define JUMP 4.712389f
/* By which noise may take a value out of one turn [rad]. */
#define NOISE 0.1f

/* Return whether two values are within one turn that begins at an angle [rad]. */
static bool within_turn(float low, float high, float begin)
{
    return low >= begin - NOISE && high <= begin + TURN + NOISE;
}

float ballbot_unwrapped(struct ballbot_heading_memory *memory, float angle)
{
    const float last = (memory->started != 0) ? memory->last : angle;
    const float low = (angle < last) ? angle : last;
    const float high = (angle < last) ? last : angle;

    if (angle < -0.5f * TURN - NOISE || angle > TURN + NOISE) {
        memory->turns = 0;
    } else if (high - low > JUMP && (within_turn(low, high, -0.5f * TURN) || within_turn(low, high, 0.0f))) {
        memory->turns += (angle < last) ? 1 : -1;
    } else {
        /* a motion */
    }
    memory->last = angle;
    memory->started = 1;
    return (angle + TURN * (float)memory->turns) - TURN_ROUNDING * (float)memory->turns;
}

struct ballbot_heading ballbot_heading_of(float psi)
{
    struct ballbot_heading heading;

    ballbot_sine_cosine(psi, &heading.sine, &heading.cosine);
    return heading;
}

struct ballbot_heading ballbot_heading_after(struct ballbot_heading heading, float turn)
{
    const struct ballbot_heading small = ballbot_heading_of(turn);
    const struct ballbot_heading after = {
        small.cosine * heading.sine + small.sine * heading.cosine,
        small.cosine * heading.cosine - small.sine * heading.sine,
    };

    return after;
}

void ballbot_state_to_heading(struct ballbot_heading a, const float state[10], float turned[10])
{
    static const int pairs[4] = { 0, 2, 5, 7 };

    for (int k = 0; k < 4; ++k) {
        const int i = pairs[k];
        const struct ballbot_pair pair = ballbot_to_heading(a, state[i], state[i + 1]);
        turned[i] = pair.x;
        turned[i + 1] = pair.y;
    }
    turned[4] = state[4];
    turned[9] = state[9];
}

struct ballbot_attitude ballbot_attitude_of(float theta, float phi, struct ballbot_heading heading)
{
    const float ss = heading.sine;
    const float cs = heading.cosine;
    struct ballbot_attitude a;
    float st;
    float ct;
    float sp;
    float cp;

    ballbot_sine_cosine(theta, &st, &ct);
    ballbot_sine_cosine(phi, &sp, &cp);
    a.R[0][0] = cp * cs;
    a.R[0][1] = -cp * ss;
    a.R[0][2] = sp;
    a.R[1][0] = ct * ss + st * sp * cs;
    a.R[1][1] = ct * cs - st * sp * ss;
    a.R[1][2] = -st * cp;
    a.R[2][0] = st * ss - ct * sp * cs;
    a.R[2][1] = st * cs + ct * sp * ss;
    a.R[2][2] = ct * cp;
    a.sin_phi = sp;
    a.cos_phi = cp;
    a.heading = heading;
    return a;
}

void ballbot_body_rates(const struct ballbot_attitude *a, const float angle_rates[3], float w[3])
{
    const float t = angle_rates[0];
    const float p = angle_rates[1];

    w[0] = a->cos_phi * a->heading.cosine * t + a->heading.sine * p;
    w[1] = a->heading.cosine * p - a->cos_phi * a->heading.sine * t;
    w[2] = a->sin_phi * t + angle_rates[2];
}

void ballbot_rotate_back(const struct ballbot_attitude *a, const float v[3], float turned[3])
{
    for (int i = 0; i < 3; ++i) {
        turned[i] = a->R[0][i] * v[0] + a->R[1][i] * v[1] + a->R[2][i] * v[2];
    }
}
