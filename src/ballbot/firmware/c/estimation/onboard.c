/* The on-board state, the thesis's way; see onboard.h. */
#include "estimation/onboard.h"

#include "ballbot_math.h"
#include "compensated_sum.h"
#include "estimation/known.h"

/* Sines and cosines of theta, phi and psi. */
struct attitude {
    float s1, c1, s2, c2, s3, c3;
};

/* Return sines and cosines of theta, phi, psi [rad]. */
static struct attitude attitude_of(const float angles[3])
{
    struct attitude a;
    ballbot_sine_cosine(angles[0], &a.s1, &a.c1);
    ballbot_sine_cosine(angles[1], &a.s2, &a.c2);
    ballbot_sine_cosine(angles[2], &a.s3, &a.c3);
    return a;
}

/* Give Phi_dot = B^-1 w, the rates of theta, phi, psi [rad/s], of the body's angular velocity w in its own frame. */
static void angle_rates(const struct attitude *a, const float w[3], float rates[3])
{
    rates[0] = (a->c3 * w[0] - a->s3 * w[1]) / a->c2;
    rates[1] = a->s3 * w[0] + a->c3 * w[1];
    rates[2] = w[2] - a->s2 * rates[0];
}

/* Give v [m/s] of a ball that rolls without slip. */
static void rolling(const struct ballbot_onboard_record *record, const struct attitude *a, int32_t wheel_count,
                    const float speeds[BALLBOT_MAX_WHEELS], const float gyro[3], float velocity[2])
{
    float z[3];
    for (int32_t k = 0; k < 3; ++k) {
        z[k] = 0.0f;
        for (int32_t i = 0; i < wheel_count; ++i) {
            z[k] += record->ball_from_wheels[k][i] * speeds[i];
        }
        z[k] += gyro[k];
    }
    /* R = Rx(theta) Ry(phi) Rz(psi); first Rz z, then Ry, then Rx */
    const float forward = a->c3 * z[0] - a->s3 * z[1];
    const float left = a->s3 * z[0] + a->c3 * z[1];
    const float up = a->c2 * z[2] - a->s2 * forward;
    velocity[0] = record->radius * (a->c1 * left - a->s1 * up);
    velocity[1] = -record->radius * (a->c2 * forward + a->s2 * z[2]);
}

void ballbot_onboard_reset(struct ballbot_onboard_memory *memory, const float position[2])
{
    memory->started = 0;
    for (int32_t k = 0; k < 2; ++k) {
        memory->position[k] = position[k];
        memory->position_rest[k] = 0.0f;
    }
}

/* Replace what gyro and attitude lack by predictions, and remember both. */
static void complete(const struct ballbot_onboard_record *record, struct ballbot_onboard_memory *memory,
                     const struct ballbot_reading_record *reading)
{
    if (ballbot_all_known(reading->attitude, 3) != 0) {
        for (int32_t k = 0; k < 3; ++k) {
            memory->attitude[k] = reading->attitude[k];
        }
    } else {
        const struct attitude before = attitude_of(memory->attitude);
        float rates[3];
        angle_rates(&before, memory->gyro, rates);
        for (int32_t k = 0; k < 3; ++k) {
            memory->attitude[k] = (ballbot_known(reading->attitude[k]) != 0)
                                      ? reading->attitude[k]
                                      : (memory->attitude[k] + record->sample_time * rates[k]);
        }
    }
    for (int32_t k = 0; k < 3; ++k) {
        memory->gyro[k] = (ballbot_known(reading->gyro[k]) != 0) ? reading->gyro[k] : memory->gyro[k];
    }
}

int32_t ballbot_onboard_update(const struct ballbot_onboard_record *record, struct ballbot_onboard_memory *memory,
                               int32_t wheel_count, const struct ballbot_reading_record *reading, float state[10])
{
    const int32_t rolls = ballbot_all_known(reading->wheel_speeds, wheel_count);
    const int32_t whole = rolls & ballbot_all_known(reading->gyro, 3) & ballbot_all_known(reading->attitude, 3);
    if ((memory->started == 0) && (whole == 0)) {
        for (int32_t k = 0; k < 10; ++k) {
            state[k] = ballbot_not_a_number();
        }
    } else {
        complete(record, memory, reading);
        const struct attitude a = attitude_of(memory->attitude);
        float velocity[2] = {memory->velocity[0], memory->velocity[1]};
        if (rolls != 0) {
            rolling(record, &a, wheel_count, reading->wheel_speeds, memory->gyro, velocity);
        }
        for (int32_t k = 0; k < 2; ++k) {
            if (memory->started != 0) { /* trapezoid between this sample and the one before */
                ballbot_add(&memory->position[k], &memory->position_rest[k],
                            0.5f * record->sample_time * (velocity[k] + memory->velocity[k]));
            }
            memory->velocity[k] = velocity[k];
            state[k] = memory->position[k];
            state[5 + k] = velocity[k];
        }
        for (int32_t k = 0; k < 3; ++k) {
            state[2 + k] = memory->attitude[k];
        }
        angle_rates(&a, memory->gyro, &state[7]);
        memory->started = 1;
    }
    return whole;
}
