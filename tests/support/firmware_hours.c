/* Drives the Kalman filter over hours with what the sensors of a robot show that sways, turns and rolls. */
#include "estimation/kalman.h"

#include <math.h>
#include <stdint.h>

#undef float
#undef int32_t

/* The robot and its sensors; numbers of this file are of double precision in either build. */
struct world {
    double sample_time, radius, step, gyro_noise, attitude_noise, fix_chance;
    double wheels[4][3]; /* T_owb: wheel speed from the ball's angular velocity relative to the body */
    double angles[4];    /* of the wheels [rad] */
    double time, wheel_count;
    uint64_t random;
};

/* What the sensors show, rounded to single precision. */
struct shown {
    double gyro[3], attitude[3], fix_position[2], fix_heading;
    int64_t counts[4];
};

static double uniform(struct world *world)
{
    world->random = world->random * 6364136223846793005u + 1442695040888963407u;
    return (double)(world->random >> 11) * 0x1p-53;
}

/* Return a number of the normal distribution, nearly. */
static double normal(struct world *world, double deviation)
{
    double sum = -6.0;
    for (int i = 0; i < 12; ++i) {
        sum += uniform(world);
    }
    return deviation * sum;
}

static double rounded(double value)
{
    return (double)(float)value;
}

static void next(struct world *world, struct shown *shown)
{
    const double t = world->time;
    const double angle[3] = {0.04 * sin(1.3 * t), -0.03 * cos(1.7 * t), 0.3 * sin(t) - 1.5 * cos(0.2 * t)};
    const double rate[3] = {0.052 * cos(1.3 * t), 0.051 * sin(1.7 * t), 0.3 * cos(t) + 0.3 * sin(0.2 * t)};
    const double s1 = sin(angle[0]), c1 = cos(angle[0]), s2 = sin(angle[1]), c2 = cos(angle[1]);
    const double s3 = sin(angle[2]), c3 = cos(angle[2]);
    const double gyro[3] = {c2 * c3 * rate[0] + s3 * rate[1], c3 * rate[1] - c2 * s3 * rate[0],
                            s2 * rate[0] + rate[2]};
    const double ball[2] = {-0.3 * cos(0.3 * t) / world->radius, 0.4 * sin(0.5 * t) / world->radius};
    /* R^T (ball, 0) - gyro, R = Rx(theta) Ry(phi) Rz(psi) */
    const double relative[3] = {
        c2 * c3 * ball[0] + (c1 * s3 + s1 * s2 * c3) * ball[1] - gyro[0],
        -c2 * s3 * ball[0] + (c1 * c3 - s1 * s2 * s3) * ball[1] - gyro[1],
        s2 * ball[0] - s1 * c2 * ball[1] - gyro[2],
    };
    for (int i = 0; i < 4; ++i) {
        for (int k = 0; k < 3; ++k) {
            world->angles[i] += world->sample_time * world->wheels[i][k] * relative[k];
        }
        shown->counts[i] = (int64_t)floor(world->angles[i] / world->step);
    }
    for (int k = 0; k < 3; ++k) {
        shown->gyro[k] = rounded(gyro[k] + 1e-3 * (k + 1) + normal(world, world->gyro_noise));
        shown->attitude[k] = rounded(angle[k] + normal(world, world->attitude_noise) + ((k == 2) ? 1.5e-3 * t : 0.0));
    }
    const int fix = uniform(world) < world->fix_chance;
    shown->fix_position[0] = fix ? rounded(0.8 - 0.8 * cos(0.5 * t) + normal(world, 0.005)) : NAN;
    shown->fix_position[1] = fix ? rounded(sin(0.3 * t) + normal(world, 0.005)) : NAN;
    shown->fix_heading = fix ? rounded(angle[2] + normal(world, 0.02)) : NAN;
    world->time += world->sample_time;
}

#ifdef BALLBOT_DOUBLE
#define float double
#define int32_t int64_t
#endif

void run(const struct ballbot_kalman_record *record, struct ballbot_kalman_memory *memory, struct world *world,
         int64_t samples, float state[10]);

/* Take so many samples and give the last state. */
void run(const struct ballbot_kalman_record *record, struct ballbot_kalman_memory *memory, struct world *world,
         int64_t samples, float state[10])
{
    for (int64_t n = 0; n < samples; ++n) {
        struct shown shown;
        struct ballbot_reading_record reading = BALLBOT_NO_READING;
        reading.encoders_valid = 1;
        next(world, &shown);
        for (int i = 0; i < 4; ++i) {
            reading.wheel_counts[i] = (int32_t)shown.counts[i];
        }
        for (int k = 0; k < 3; ++k) {
            reading.gyro[k] = (float)shown.gyro[k];
            reading.attitude[k] = (float)shown.attitude[k];
        }
        reading.fix_position[0] = (float)shown.fix_position[0];
        reading.fix_position[1] = (float)shown.fix_position[1];
        reading.fix_heading = (float)shown.fix_heading;
        reading.fix_position_deviation = (float)rounded(0.005);
        reading.fix_heading_deviation = (float)rounded(0.02);
        (void)ballbot_kalman_update(record, memory, (int32_t)world->wheel_count, &reading, state);
    }
}
