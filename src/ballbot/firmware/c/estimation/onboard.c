/* Generated from ballbot/estimation/onboard.py by
 * `python -m tests.support.firmware_headers`; do not edit.
 *
 * The on-board state, the thesis's way (Appendices I and V): an AHRS and wheel encoders, nothing else.
 *
 *     z = T_obw wheel_speed + w      ball's angular velocity, body frame (wheels see z - w) [rad/s]
 *     Omega = R z                    the same, world frame
 *     v = r_b (Omega_y, -Omega_x)    velocity of a ball that rolls without slip, world frame [m/s]
 *     Phi_dot = B^-1 w               rates of theta, phi, psi [rad/s]
 *     x, y                           the sum of v from the start: an error here is never corrected [m]
 *
 * It cannot measure slip, the play between encoder and wheel, or the drift of its own heading. A value that is missing
 * (NaN, or beyond any sensor) is predicted: the gyro's and v stay as they were, theta, phi and psi go on at their last
 * rates. The firmware's C is written from this file (tests.support.firmware_law).
 */
#include "estimation/onboard.h"

#include "estimation/known.h"

/* Sines and cosines of theta, phi and psi. */
struct turns {
    float s1;
    float c1;
    float s2;
    float c2;
    float s3;
    float c3;
};

/* Rates of theta, phi and psi. */
struct rates {
    float theta; /* [rad/s] */
    float phi; /* [rad/s] */
    float psi; /* [rad/s] */
};

/* A velocity over the floor. */
struct velocity {
    float x; /* [m/s] */
    float y; /* [m/s] */
};

/* Forget the past; the robot stands at a position x, y [m], world frame. */
void ballbot_onboard_reset(struct ballbot_onboard_memory *memory, const float position[2])
{
    memory->started = 0;
    for (int32_t k = 0; k < 2; ++k) {
        memory->position[k] = position[k];
        memory->position_rest[k] = 0.0f;
    }
}

/* Return sines and cosines of theta, phi, psi [rad]. */
static struct turns turns_of(const float angles[3])
{
    float s1;
    float c1;

    ballbot_sine_cosine(angles[0], &s1, &c1);
    float s2;
    float c2;

    ballbot_sine_cosine(angles[1], &s2, &c2);
    float s3;
    float c3;

    ballbot_sine_cosine(angles[2], &s3, &c3);

    return (struct turns){ s1, c1, s2, c2, s3, c3 };
}

/* Return Phi_dot = B^-1 w of the body's angular velocity w [rad/s] in its own frame. */
static struct rates rates_of(const struct turns *a, const float w[3])
{
    const float theta = (a->c3 * w[0] - a->s3 * w[1]) / a->c2;

    return (struct rates){ theta, a->s3 * w[0] + a->c3 * w[1], w[2] - a->s2 * theta };
}

/* Remember gyro and attitude; what they lack is predicted. */
static void remember(const struct ballbot_onboard_record *record, struct ballbot_onboard_memory *memory,
        const struct ballbot_reading_record *reading)
{
    if (!ballbot_are_known(reading->attitude, 3)) {
        const struct turns before = turns_of(memory->attitude);
        const struct rates ahead = rates_of(&before, memory->gyro);

        memory->attitude[0] += record->sample_time * ahead.theta;
        memory->attitude[1] += record->sample_time * ahead.phi;
        memory->attitude[2] += record->sample_time * ahead.psi;
    }
    for (int32_t k = 0; k < 3; ++k) {
        if (ballbot_is_known(reading->attitude[k])) {
            memory->attitude[k] = reading->attitude[k];
        }
        if (ballbot_is_known(reading->gyro[k])) {
            memory->gyro[k] = reading->gyro[k];
        }
    }
}

/* Return the ball's turning relative to the body. */
struct ballbot_turning ballbot_ball_rate(const float ball_from_wheels[3][4], int32_t wheel_count,
        const float speeds[BALLBOT_MAX_WHEELS])
{
    float x = 0.0f;
    float y = 0.0f;
    float z = 0.0f;

    for (int32_t i = 0; i < wheel_count; ++i) {
        x += ball_from_wheels[0][i] * speeds[i];
        y += ball_from_wheels[1][i] * speeds[i];
        z += ball_from_wheels[2][i] * speeds[i];
    }
    return (struct ballbot_turning){ x, y, z };
}

/* Return v of a ball that rolls without slip. */
static struct velocity rolling(const struct ballbot_onboard_record *record, const struct turns *a,
        int32_t wheel_count, const float speeds[BALLBOT_MAX_WHEELS], const float gyro[3])
{
    const struct ballbot_turning relative = ballbot_ball_rate(record->ball_from_wheels, wheel_count, speeds);
    const struct ballbot_turning z = { relative.x + gyro[0], relative.y + gyro[1], relative.z + gyro[2] };
    /* R = Rx(theta) Ry(phi) Rz(psi); first Rz z, then Ry, then Rx */
    const float forward = a->c3 * z.x - a->s3 * z.y;
    const float left = a->s3 * z.x + a->c3 * z.y;
    const float up = a->c2 * z.z - a->s2 * forward;

    return (struct velocity){ record->radius * (a->c1 * left - a->s1 * up),
        -record->radius * (a->c2 * forward + a->s2 * z.z) };
}

/* Take one sample and fill the state: x, y [m], theta, phi, psi [rad] and their rates, world frame.
 *
 * All are NaN until a reading is whole. Return 1 if it is whole, 0 if something in it is predicted or missing.
 */
int32_t ballbot_onboard_update(const struct ballbot_onboard_record *record, struct ballbot_onboard_memory *memory,
        int32_t wheel_count, const struct ballbot_reading_record *reading, float state[10])
{
    const bool rolls = ballbot_are_known(reading->wheel_speeds, wheel_count);
    const bool complete = rolls && ballbot_are_known(reading->gyro, 3) && ballbot_are_known(reading->attitude, 3);

    if (memory->started == 0 && !complete) {
        for (int32_t k = 0; k < 10; ++k) {
            state[k] = ballbot_not_a_number();
        }
        return 0;
    }
    remember(record, memory, reading);
    const struct turns a = turns_of(memory->attitude);
    struct velocity v = { memory->velocity[0], memory->velocity[1] };

    if (rolls) {
        v = rolling(record, &a, wheel_count, reading->wheel_speeds, memory->gyro);
    }
    if (memory->started == 1) {
        /* trapezoid between this sample and the one before */
        ballbot_add(&memory->position[0], &memory->position_rest[0],
            0.5f * record->sample_time * (v.x + memory->velocity[0]));
        ballbot_add(&memory->position[1], &memory->position_rest[1],
            0.5f * record->sample_time * (v.y + memory->velocity[1]));
    }
    memory->started = 1;
    memory->velocity[0] = v.x;
    memory->velocity[1] = v.y;
    state[0] = memory->position[0];
    state[1] = memory->position[1];
    state[5] = v.x;
    state[6] = v.y;
    for (int32_t k = 0; k < 3; ++k) {
        state[2 + k] = memory->attitude[k];
    }
    const struct rates rates = rates_of(&a, memory->gyro);

    state[7] = rates.theta;
    state[8] = rates.phi;
    state[9] = rates.psi;
    return complete ? 1 : 0;
}
