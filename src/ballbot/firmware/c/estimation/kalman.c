/* The on-board state by a Kalman filter; see kalman.h. */
#include "estimation/kalman.h"

#include "ballbot_math.h"
#include "compensated_sum.h"
#include "estimation/kalman_model.h"
#include "estimation/known.h"
#include "estimation/slip.h"
#include "estimation/swing.h"

/* Values of `started`. */
enum { LOST = -1, NOT_STARTED = 0, RUNNING = 1 };

/* Largest sum of the magnitudes of all states and variances; beyond it the filter is lost. */
#define LARGEST 1.0e12f

/* Smallest fraction of a variance that a sample leaves; readings that no sensor gives could leave less */
#define LEAST_KEPT 1.0e-6f

/* Largest count of samples without encoders; beyond it a float skips whole numbers */
#define MOST_MISSED 0x1000000

/* ---- the motion ---- */

/* Overwrite the covariance P by F P F^T + Q, less what is forgotten. */
static void propagate(const struct ballbot_kalman_record *record, const float f[F_ENTRIES], float P[STATES][STATES])
{
    float FP[STATES][STATES];
    faded(record->forgotten, P);
    for (int32_t j = 0; j < STATES; ++j) {
        carried(f, P[j], FP[j]);
    }
    propagated(record, f, FP, P);
}

/* Move the state on by a sample and give the mean of v (2) [m/s] over it. */
static void advance(const struct ballbot_kalman_record *record, struct ballbot_kalman_memory *memory,
                    const float gyro[3], float velocity[2])
{
    float change[STATES];
    moved(record, memory->x, gyro, change, velocity);
    for (int32_t i = 0; i < STATES; ++i) {
        ballbot_add(&memory->x[i], &memory->rest[i], change[i]);
    }
}

/* ---- what is seen ---- */

/* What all sensors show in a sample. */
struct seen {
    float residual[NUMBERS]; /* seen less expected; not known where it is missing */
    float h[H_ENTRIES];
    float variance[NUMBERS]; /* of each number's own error */
    float change[STATES];    /* of the state, by the numbers that were taken in */
    float kept;              /* of a variance, at least: by Cauchy and Schwarz, each number leaves r / s of it */
};

/* Take in one number: P+ = P - q q^T / s with q = P h and s = h^T q + r. */
static void take_in(float P[STATES][STATES], struct seen *seen, int32_t number)
{
    float q[STATES];
    float spread;
    float known;
    projected(number, P, seen->h, seen->change, q, &spread, &known);
    spread = (spread > 0.0f) ? spread : 0.0f; /* but for rounding */
    const float inverse = 1.0f / (spread + seen->variance[number]);
    seen->kept *= seen->variance[number] * inverse;
    corrected(q, seen->residual[number] - known, inverse, P, seen->change);
}

/* Take in all that was seen, one number after the other. A number that is missing changes nothing. */
static void absorb(struct ballbot_kalman_memory *memory, struct seen *seen)
{
    float before[STATES]; /* variances */
    for (int32_t i = 0; i < STATES; ++i) {
        before[i] = memory->P[i][i];
        seen->change[i] = memory->rest[i];
        memory->rest[i] = 0.0f;
    }
    seen->kept = 1.0f;
    for (int32_t number = 0; number < NUMBERS; ++number) {
        if (ballbot_is_known(seen->residual[number]) && (seen->variance[number] > 0.0f)) {
            take_in(memory->P, seen, number);
        }
    }
    const float kept = (seen->kept > LEAST_KEPT) ? seen->kept : LEAST_KEPT;
    float smallest = LARGEST; /* variance */
    float size = 0.0f;        /* of all variances and states */
    for (int32_t i = 0; i < STATES; ++i) {
        float *const variance = &memory->P[i][i];
        *variance = (*variance > kept * before[i]) ? *variance : (kept * before[i]);
        smallest = (*variance < smallest) ? *variance : smallest;
        ballbot_add(&memory->x[i], &memory->rest[i], seen->change[i]);
        size += *variance + ballbot_magnitude(memory->x[i]);
    }
    if (!(smallest > 0.0f) || !(size <= LARGEST)) {
        memory->started = LOST; /* by readings that no sensor gives */
    }
}

/* ---- a sample ---- */

/* Begin at the first whole reading: its attitude, v = 0. */
static void start(const struct ballbot_kalman_record *record, struct ballbot_kalman_memory *memory, const float gyro[3],
                  struct ballbot_swing_twist shown)
{
    const float position[2] = {memory->x[X], memory->x[Y]};
    for (int32_t i = 0; i < STATES; ++i) {
        memory->x[i] = 0.0f;
        memory->rest[i] = 0.0f;
        for (int32_t j = 0; j < STATES; ++j) {
            memory->P[i][j] = 0.0f;
        }
        memory->P[i][i] = record->start_variances[i];
    }
    for (int32_t k = 0; k < 4; ++k) {
        memory->P[TOGETHER[k][0]][TOGETHER[k][1]] = record->start_covariances[k];
    }
    memory->x[X] = position[0];
    memory->x[Y] = position[1];
    ballbot_begin_filter(record->lever, shown, gyro, memory->x);
    memory->pivoting = 0.0f;
    memory->pivoted = 0.0f;
    memory->slip.left_out = 0.0f;
    memory->slip.lasting = 0.0f;
    memory->slip.faster[0] = 0.0f;
    memory->slip.faster[1] = 0.0f;
}

/* Give the ball's mean turning relative to the body (3) [rad/s] since the encoders last had all counts. */
static void ball_rate_of(const struct ballbot_kalman_record *record, const struct ballbot_kalman_memory *memory,
                         int32_t wheel_count, const int32_t counts[BALLBOT_MAX_WHEELS], float ball_rate[3])
{
    const float time = record->sample_time * (float)(1 + memory->missed);
    float turns[3] = {0.0f, 0.0f, 0.0f};
    for (int32_t i = 0; i < wheel_count; ++i) {
        /* modulo 2^32, so that a counter may wrap around */
        const uint32_t forward = (uint32_t)counts[i] - (uint32_t)memory->wheel_counts[i];
        const uint32_t backward = (uint32_t)memory->wheel_counts[i] - (uint32_t)counts[i];
        const float turn = (forward < backward) ? (float)forward : -(float)backward;
        for (int32_t k = 0; k < 3; ++k) {
            turns[k] += record->ball_turn[k][i] * turn;
        }
    }
    for (int32_t k = 0; k < 3; ++k) {
        ball_rate[k] = turns[k] / time;
    }
}

/* Give the numbers of a fix, not a number where one is missing, and their variances. */
static void fix_of(const struct ballbot_kalman_memory *memory, const struct ballbot_reading_record *reading,
                   float fix[3], float variance[3])
{
    const float *const x = memory->x;
    fix[0] = reading->fix_position[0];
    fix[1] = reading->fix_position[1];
    fix[2] = x[PSI] + ballbot_within_half_turn(reading->fix_heading - x[PSI]);
    variance[0] = reading->fix_position_deviation * reading->fix_position_deviation;
    variance[1] = variance[0];
    variance[2] = reading->fix_heading_deviation * reading->fix_heading_deviation;
    for (int32_t k = 0; k < 3; ++k) {
        const float given = (k < 2) ? reading->fix_position[k] : reading->fix_heading;
        fix[k] = ballbot_is_known(given) ? fix[k] : ballbot_not_a_number();
    }
}

/*
 * Take in what the sensors show. Means over the sample: the ball's turning relative to the body and the gyro [rad/s], and
 * v [m/s].
 */
static void see(const struct ballbot_kalman_record *record, struct ballbot_kalman_memory *memory,
                const struct ballbot_reading_record *reading, const float wheels[3],
                struct ballbot_swing_twist shown, const float gyro[3], const float velocity[2])
{
    const float attitude[3] = {shown.g_x, shown.g_y, shown.heading};
    struct seen seen;
    float fix[3];
    for (int32_t k = 0; k < FIX; ++k) {
        seen.variance[k] = record->variances[k];
    }
    /* the more the ball lately turned on the spot by the wheels, the less they correct the heading */
    seen.variance[PIVOTING_SEEN] += record->pivoting_variance * memory->pivoted;
    fix_of(memory, reading, fix, &seen.variance[FIX]);
    expected(record, memory->x, gyro, velocity, reading, wheels, attitude, fix, seen.residual, seen.h);
    for (int32_t k = 0; (memory->started != RUNNING) && (k < FIX); ++k) {
        seen.residual[k] = ballbot_not_a_number(); /* the start is made of the first reading; only a fix corrects it */
    }
    absorb(memory, &seen);
    if (ballbot_is_known(seen.residual[PIVOTING_SEEN])) {
        memory->pivoting += record->pivoting_share * (seen.residual[PIVOTING_SEEN] - memory->pivoting);
        memory->pivoted += record->pivoted_share * (memory->pivoting * memory->pivoting - memory->pivoted);
    }
}

/* Leave out the ball's turning by wheels that slip; what they and pushes hide makes the momentum unknown. */
static void without_slip(const struct ballbot_kalman_record *record, struct ballbot_kalman_memory *memory,
                         const float gyro[3], float wheels[3])
{
    const struct ballbot_angular_velocity turned = {wheels[0], wheels[1], wheels[2]};
    const struct ballbot_angular_velocity rolled =
        ballbot_without_slip(record, &memory->slip, memory->pivoted, memory->x, gyro, turned);
    wheels[0] = rolled.x;
    wheels[1] = rolled.y;
    wheels[2] = rolled.z;
    for (int32_t k = 0; k < 2; ++k) {
        memory->P[S_X + k][S_X + k] += memory->slip.unknown;
    }
}

/* Predict the state over a sample, and correct it by what is seen. */
static void sample(const struct ballbot_kalman_record *record, struct ballbot_kalman_memory *memory,
                   const struct ballbot_reading_record *reading, const float wheels[3],
                   struct ballbot_swing_twist shown, const float gyro[3])
{
    float mean[3];
    float f[F_ENTRIES];
    float velocity[2];
    for (int32_t k = 0; k < 3; ++k) {
        mean[k] = 0.5f * (memory->gyro[k] + gyro[k]);
    }
    linearized(record, memory->x, mean, f);
    advance(record, memory, mean, velocity);
    propagate(record, f, memory->P);
    see(record, memory, reading, wheels, shown, mean, velocity);
}

void ballbot_kalman_reset(struct ballbot_kalman_memory *memory, const float position[2])
{
    memory->started = NOT_STARTED;
    memory->x[X] = position[0];
    memory->x[Y] = position[1];
}

int32_t ballbot_kalman_update(const struct ballbot_kalman_record *record, struct ballbot_kalman_memory *memory,
                              int32_t wheel_count, const struct ballbot_reading_record *reading, float state[10])
{
    const float unknown = ballbot_not_a_number();
    const bool leans = ballbot_are_known(reading->attitude, 3);
    const bool turned = reading->encoders_valid != 0;
    const bool whole = leans && turned && ballbot_are_known(reading->gyro, 3);
    float wheels[3] = {unknown, unknown, unknown};
    struct ballbot_swing_twist shown = {unknown, unknown, unknown};
    float gyro[3];
    for (int32_t k = 0; k < 3; ++k) {
        gyro[k] = ballbot_is_known(reading->gyro[k]) ? reading->gyro[k] : memory->gyro[k];
    }
    if ((memory->started == RUNNING) || ((memory->started == NOT_STARTED) && whole)) {
        if (leans) {
            shown = ballbot_swing_of(reading->attitude[0], reading->attitude[1], reading->attitude[2]);
        }
        if (memory->started == RUNNING) {
            if (turned) {
                ball_rate_of(record, memory, wheel_count, reading->wheel_counts, wheels);
                without_slip(record, memory, gyro, wheels);
            }
            sample(record, memory, reading, wheels, shown, gyro);
        } else {
            start(record, memory, gyro, shown);
            const float at_rest[2] = {0.0f, 0.0f};
            see(record, memory, reading, wheels, shown, gyro, at_rest);
            memory->started = RUNNING;
        }
        memory->missed = turned ? 0 : (memory->missed + ((memory->missed < MOST_MISSED) ? 1 : 0));
        for (int32_t k = 0; k < 3; ++k) {
            memory->gyro[k] = gyro[k];
        }
        for (int32_t i = 0; turned && (i < wheel_count); ++i) {
            memory->wheel_counts[i] = reading->wheel_counts[i];
        }
    }
    if (memory->started == RUNNING) {
        ballbot_robot_state(record->lever, memory->x, memory->gyro, state);
    } else {
        for (int32_t k = 0; k < 10; ++k) {
            state[k] = unknown;
        }
    }
    return whole ? 1 : 0;
}
