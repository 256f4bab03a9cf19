/* Generated from ballbot/control/tuning.py by
 * `python -m tests.support.firmware_headers`; do not edit.
 *
 * Changes while the robot balances: a mixture of gains, and less compensation.
 *
 * A Setting is relative to the controller as it was made: weights of its own gain and of the others that it has, and
 * a share of its compensation. Its limits stay: a robot at speed could not be caught with lower ones. The law moves from
 * the setting in use to the one that is asked for along a straight line, at most 1/CHANGE_TIME a second in each number,
 * so that no torque jumps and every setting on the way is a mixture, too. The lean that errors command is mixed like the
 * gain; it is exact for each gain by itself.
 *
 * In the memory every number is a difference from the controller as it was made, so that zeros are the start of a run.
 */
#include "parts/steps.h"

/* Move the setting in use towards the one that is asked for. */
void ballbot_tune(const struct ballbot_law *law, struct ballbot_memory *memory)
{
    const struct ballbot_tuning_record *own = &law->tuning;
    struct ballbot_tuning_state *state = &memory->tuning;
    float largest = 0.0f;

    for (int32_t k = 0; k < BALLBOT_TUNING_NUMBERS; ++k) {
        largest = ballbot_larger(largest, ballbot_magnitude(state->wanted[k] - state->now[k]));
    }
    if (largest == 0.0f) {
        return;
    }
    for (int32_t k = 0; k < BALLBOT_TUNING_NUMBERS; ++k) {
        if (largest <= own->step) {
            state->now[k] = state->wanted[k];
        } else {
            state->now[k] += own->step / largest * (state->wanted[k] - state->now[k]);
        }
    }
    if (own->others == 0) {
        return;
    }
    const float first = state->now[0];
    const float second = state->now[1];

    for (int32_t i = 0; i < BALLBOT_MAX_WHEELS; ++i) {
        for (int32_t j = 0; j < 10; ++j) {
            state->gain[i][j] = first * own->gain[0][i][j] + second * own->gain[1][i][j];
        }
        for (int32_t j = 0; j < 3; ++j) {
            state->integral[i][j] = first * own->integral[0][i][j] + second * own->integral[1][i][j];
        }
    }
    for (int32_t i = 0; i < 2; ++i) {
        for (int32_t j = 0; j < 4; ++j) {
            state->asked[i][j] = first * own->asked[0][i][j] + second * own->asked[1][i][j];
        }
    }
    state->turn_rate = first * own->turn_rate[0] + second * own->turn_rate[1];
}

/* Return the share of the compensation in use: whatever a memory holds, none and no more than the law's own. */
float ballbot_compensated_share(const struct ballbot_memory *memory)
{
    return ballbot_larger(0.0f, ballbot_smaller(1.0f, 1.0f - memory->tuning.now[BALLBOT_TUNING_COMPENSATION]));
}
