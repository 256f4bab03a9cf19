#include "imu_check.h"

#include <stdbool.h>

#include "ballbot_math.h"
#include "law.h"

/* How long each position is held [s]. */
#define STILL_TIME 0.5f
/* Below this angular velocity a robot in somebody's hands is still [rad/s]. */
#define STILL 0.08f
/* Largest theta and phi that count as upright [rad]. */
#define LEVEL 0.0873f
/* Sine of half a turn: of 6 degrees, the smallest movement, and of 3, below which there is no turn at all. */
#define LEAST_TURN 0.0523f
#define NO_TURN 0.0262f
/* Share of a turn that must be about its axis. */
#define ABOUT_AXIS 0.8f
/* Allowed ratio of the gyro's turn to the attitude's. */
#define LEAST_SCALE 0.75f
#define LARGEST_SCALE 1.33f

/* A turn as a quaternion: cosine of half its angle, and the axis times the sine. */
struct turn {
    float w;
    float v[3];
};

static struct turn after(struct turn a, struct turn b)
{
    const struct turn both = { a.w * b.w - a.v[0] * b.v[0] - a.v[1] * b.v[1] - a.v[2] * b.v[2],
                               { a.w * b.v[0] + b.w * a.v[0] + a.v[1] * b.v[2] - a.v[2] * b.v[1],
                                 a.w * b.v[1] + b.w * a.v[1] + a.v[2] * b.v[0] - a.v[0] * b.v[2],
                                 a.w * b.v[2] + b.w * a.v[2] + a.v[0] * b.v[1] - a.v[1] * b.v[0] } };

    return both;
}

static struct turn about(int axis, float angle)
{
    struct turn found = { 1.0f, { 0.0f, 0.0f, 0.0f } };

    ballbot_sine_cosine(0.5f * angle, &found.v[axis], &found.w);
    return found;
}

/* Return the turn from one attitude (theta, phi, psi) to another, in the frame of the first body. */
static struct turn between(const float from[3], const float to[3])
{
    const struct turn back = after(after(about(2, -from[2]), about(1, -from[1])), about(0, -from[0]));

    return after(back, after(after(about(0, to[0]), about(1, to[1])), about(2, to[2])));
}

static float norm_of(const float v[3])
{
    return ballbot_square_root(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
}

void ballbot_imu_check_start(struct ballbot_imu_check_state *check)
{
    const struct ballbot_imu_check_state start = { .stage = (int32_t)BALLBOT_IMU_UPRIGHT, .turned = { 1.0f, 0.0f, 0.0f, 0.0f } };

    *check = start;
}

/* Forget the samples of the last position, and begin a stage. */
static void enter(struct ballbot_imu_check_state *check, int32_t stage)
{
    check->stage = stage;
    check->still = 0;
    check->moved = 0;
    check->turned[0] = 1.0f;
    for (int k = 0; k < 3; ++k) {
        check->turned[k + 1] = 0.0f;
        check->attitude_sum[k] = 0.0f;
    }
}

/* Return the stage that follows a movement from the last upright position to an attitude. */
static int32_t judged(const struct ballbot_imu_check_state *check, const float attitude[3])
{
    static const int axes[] = { 1, 0, 2 }; /* forward, to the left, turned to the left */
    static const float signs[] = { 1.0f, -1.0f, 1.0f };
    const int32_t movement = check->stage / 2 - 1;
    const struct turn made = between(check->rest, attitude);
    const float sign = (made.w < 0.0f) ? -1.0f : 1.0f; /* both quaternions of a turn are one turn */
    const float size = norm_of(made.v);
    const float *gyro = &check->turned[1];
    const float gyro_size = norm_of(gyro);
    const float agreement = sign * (made.v[0] * gyro[0] + made.v[1] * gyro[1] + made.v[2] * gyro[2]);

    if (size < NO_TURN || sign * signs[movement] * made.v[axes[movement]] < ABOUT_AXIS * size) {
        return (int32_t)BALLBOT_IMU_WRONG_AXES;
    }
    if (agreement < ABOUT_AXIS * size * gyro_size || gyro_size < LEAST_SCALE * size ||
        gyro_size > LARGEST_SCALE * size) {
        return (int32_t)BALLBOT_IMU_WRONG_GYRO;
    }
    return check->stage + 1;
}

/* Add a sample to the turn of the gyro. */
static void integrate(struct ballbot_imu_check_state *check, float sample_time, const float gyro[3])
{
    const float half = 0.5f * sample_time;
    const struct turn step = { 1.0f, { half * gyro[0], half * gyro[1], half * gyro[2] } };
    const struct turn before = { check->turned[0], { check->turned[1], check->turned[2], check->turned[3] } };
    const struct turn turned = after(before, step);
    const float size =
        ballbot_square_root(turned.w * turned.w + turned.v[0] * turned.v[0] + turned.v[1] * turned.v[1] + turned.v[2] * turned.v[2]);

    check->turned[0] = turned.w / size;
    for (int k = 0; k < 3; ++k) {
        check->turned[k + 1] = turned.v[k] / size;
    }
}

/* Count a sample in which the robot is still where it is to be; return for how many in a row it was. */
static int32_t rested(struct ballbot_imu_check_state *check, const float gyro[3], const float attitude[3], bool there)
{
    const bool still = there && norm_of(gyro) < STILL;

    check->still = still ? check->still + 1 : 0;
    for (int k = 0; k < 3; ++k) {
        check->attitude_sum[k] = still ? check->attitude_sum[k] + attitude[k] : 0.0f;
    }
    return check->still;
}

void ballbot_imu_check_step(struct ballbot_imu_check_state *check, float sample_time, const float gyro[3],
                            const float attitude[3])
{
    bool known = check->stage >= (int32_t)BALLBOT_IMU_UPRIGHT && check->stage < (int32_t)BALLBOT_IMU_DONE;

    for (int k = 0; k < 3; ++k) {
        known = known && ballbot_magnitude(gyro[k]) <= BALLBOT_LARGEST_STATE &&
                ballbot_magnitude(attitude[k]) <= BALLBOT_LARGEST_STATE;
    }
    if (!known) {
        return;
    }
    const bool upright = check->stage % 2 != 0;
    bool there = upright && ballbot_magnitude(attitude[0]) <= LEVEL && ballbot_magnitude(attitude[1]) <= LEVEL;

    if (!upright) {
        integrate(check, sample_time, gyro);
        if (norm_of(&check->turned[1]) > LEAST_TURN || norm_of(between(check->rest, attitude).v) > LEAST_TURN) {
            check->moved = 1;
        }
        there = check->moved != 0;
    }
    const int32_t samples = rested(check, gyro, attitude, there);

    if (samples < 1 || ((float)samples + 0.5f) * sample_time < STILL_TIME) {
        return;
    }
    float mean[3];

    for (int k = 0; k < 3; ++k) {
        mean[k] = check->attitude_sum[k] / (float)samples;
    }
    if (upright) {
        for (int k = 0; k < 3; ++k) {
            check->rest[k] = mean[k];
        }
        enter(check, check->stage + 1);
    } else {
        const int32_t next = judged(check, mean);

        enter(check, next);
        check->passed = (next == (int32_t)BALLBOT_IMU_DONE) ? 1 : 0;
    }
}
