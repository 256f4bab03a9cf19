#include "safety.h"

#include <float.h>

#include "parts/part.h"

void ballbot_safety_reset(struct ballbot_safety_state *state)
{
    const struct ballbot_safety_state start = { .stop = BALLBOT_STOP_NONE };

    *state = start;
}

void ballbot_safety_latch(struct ballbot_safety_state *state, enum ballbot_stop reason, int32_t wheel)
{
    if (state->stop == BALLBOT_STOP_NONE) {
        state->stop = (int32_t)reason;
        state->stop_wheel = wheel;
    }
}

/* Return whether two numbers are the same; a NaN is like no other. */
static bool same(float a, float b)
{
    return a <= b && a >= b;
}

/* Return for how many samples the IMU has repeated itself, and remember its values. */
static int32_t imu_repeated(struct ballbot_safety_state *state, const float imu[])
{
    bool repeated = state->watched != 0;

    for (int k = 0; k < BALLBOT_IMU_VALUES; ++k) {
        repeated = repeated && same(imu[k], state->imu[k]);
        state->imu[k] = imu[k];
    }
    return repeated ? state->imu_unchanged + 1 : 0;
}

/* Return for how many samples a wheel that did not turn was pushed, negative if backward. */
static int32_t pushed_on(int32_t count, float torque, float turning_torque)
{
    if (torque >= turning_torque) {
        return ((count > 0) ? count : 0) + 1;
    }
    if (torque <= -turning_torque) {
        return ((count < 0) ? count : 0) - 1;
    }
    return 0;
}

void ballbot_safety_watch(const struct ballbot_safety_record *own, struct ballbot_safety_state *state, int32_t n,
                          const float imu[], const int32_t counts[], bool counts_valid, const float torques[])
{
    if (state->stop != BALLBOT_STOP_NONE || own->max_unchanged <= 0) {
        return; /* without a limit, nothing is counted and no counter overflows */
    }
    state->imu_unchanged = imu_repeated(state, imu);
    if (state->imu_unchanged >= own->max_unchanged) {
        ballbot_safety_latch(state, BALLBOT_STOP_STUCK, 0);
    }
    for (int32_t i = 0; i < n; ++i) {
        const bool still = counts_valid && state->counts_valid != 0 && counts[i] == state->counts[i];

        state->pushed[i] = still ? pushed_on(state->pushed[i], torques[i], own->turning_torque) : 0;
        state->counts[i] = counts[i];
        if (state->pushed[i] >= own->max_unchanged || state->pushed[i] <= -own->max_unchanged) {
            ballbot_safety_latch(state, BALLBOT_STOP_STUCK, i + 1);
        }
    }
    state->counts_valid = counts_valid ? 1 : 0;
    state->watched = 1;
}

bool ballbot_safety_admit(const struct ballbot_safety_record *own, struct ballbot_safety_state *state, float interval,
                          bool measured, bool known, float theta, float phi)
{
    if (state->stop != BALLBOT_STOP_NONE) {
        return false;
    }
    state->missing = (measured && known) ? 0 : state->missing + 1;
    if (!(interval <= own->max_interval)) { /* an interval of NaN is late */
        ballbot_safety_latch(state, BALLBOT_STOP_LATE, 0);
    } else if (state->missing > own->max_missing) {
        ballbot_safety_latch(state, BALLBOT_STOP_MISSING, 0);
    } else if (known && ballbot_larger(ballbot_magnitude(theta), ballbot_magnitude(phi)) > own->lean) {
        ballbot_safety_latch(state, BALLBOT_STOP_LEAN, 0);
    } else {
        /* a sample as it should be */
    }
    return state->stop == BALLBOT_STOP_NONE && known;
}

void ballbot_safety_release(struct ballbot_safety_state *state, int32_t n, float torques[])
{
    for (int32_t i = 0; i < n; ++i) {
        if (!(ballbot_magnitude(torques[i]) <= FLT_MAX)) {
            ballbot_safety_latch(state, BALLBOT_STOP_TORQUE, i + 1);
        }
    }
    if (state->stop != BALLBOT_STOP_NONE) {
        for (int32_t i = 0; i < n; ++i) {
            torques[i] = 0.0f;
        }
    }
}
