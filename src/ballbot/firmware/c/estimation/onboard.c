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

/* Fill the state's rates, Phi_dot = B^-1 w of the body's angular velocity w [rad/s] in its own frame. */
static void fill_rates(const struct turns *a, const float w[3], float state[10])
{
    state[7] = (a->c3 * w[0] - a->s3 * w[1]) / a->c2;
    state[8] = a->s3 * w[0] + a->c3 * w[1];
    state[9] = w[2] - a->s2 * state[7];
}

/* Remember gyro and attitude; what they lack is predicted. */
static void remember(const struct ballbot_onboard_record *record, struct ballbot_onboard_memory *memory,
        const struct ballbot_reading_record *reading, float state[10])
{
    if (!ballbot_are_known(reading->attitude, 3)) {
        const struct turns before = turns_of(memory->attitude);

        fill_rates(&before, memory->gyro, state);
        for (int32_t k = 0; k < 3; ++k) {
            memory->attitude[k] += record->sample_time * state[7 + k];
        }
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

/* Return the ball's angular velocity relative to the body, in its frame [rad/s]. */
struct ballbot_angular_velocity ballbot_ball_rate(const float ball_from_wheels[3][4], int32_t wheel_count,
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
    return (struct ballbot_angular_velocity){ x, y, z };
}

/* Return Omega [rad/s], world frame, of a ball with this angular velocity relative to the body. */
static struct ballbot_angular_velocity ball_turning(const struct turns *a, struct ballbot_angular_velocity relative,
        const float gyro[3])
{
    const float z_x = relative.x + gyro[0];
    const float z_y = relative.y + gyro[1];
    const float z_z = relative.z + gyro[2];
    /* R = Rx(theta) Ry(phi) Rz(psi); first Rz z, then Ry, then Rx */
    const float forward = a->c3 * z_x - a->s3 * z_y;
    const float left = a->s3 * z_x + a->c3 * z_y;
    const float up = a->c2 * z_z - a->s2 * forward;

    return (struct ballbot_angular_velocity){ a->c2 * forward + a->s2 * z_z, a->c1 * left - a->s1 * up,
        a->s1 * left + a->c1 * up };
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
    remember(record, memory, reading, state);
    const struct turns a = turns_of(memory->attitude);

    state[5] = memory->velocity[0];
    state[6] = memory->velocity[1];
    if (rolls) {
        const struct ballbot_angular_velocity relative = ballbot_ball_rate(record->ball_from_wheels, wheel_count,
            reading->wheel_speeds);
        const struct ballbot_angular_velocity omega = ball_turning(&a, relative, memory->gyro);

        state[5] = record->radius * omega.y;
        state[6] = -record->radius * omega.x;
    }
    for (int32_t k = 0; k < 2; ++k) {
        if (memory->started == 1) {
            /* trapezoid between this sample and the one before */
            const float passed = 0.5f * record->sample_time * (state[5 + k] + memory->velocity[k]);

            ballbot_add(&memory->position[k], &memory->position_rest[k], passed);
        }
        memory->velocity[k] = state[5 + k];
        state[k] = memory->position[k];
    }
    for (int32_t k = 0; k < 3; ++k) {
        state[2 + k] = memory->attitude[k];
    }
    fill_rates(&a, memory->gyro, state);
    memory->started = 1;
    return complete ? 1 : 0;
}
