/* Changes while the robot balances: a mixture of gains, and less compensation.
 *
 * The setting in use moves to the one that is asked for along a straight line, so that every setting on the way is a mixture,
 * and at a limited rate, so that no torque jumps. All numbers are differences from the law's own: zeros at the start.
 */
#include "parts/parts.h"

/* Move the setting in use; return whether it moved. */
static bool move(const struct ballbot_tuning_record *own, struct ballbot_tuning_state *state)
{
    float largest = 0.0f;

    for (int k = 0; k < BALLBOT_TUNING_NUMBERS; ++k) {
        largest = ballbot_larger(largest, ballbot_magnitude(state->wanted[k] - state->now[k]));
    }
    if (!(largest > 0.0f)) {
        return false;
    }
    for (int k = 0; k < BALLBOT_TUNING_NUMBERS; ++k) {
        if (largest <= own->step) {
            state->now[k] = state->wanted[k];
        } else {
            state->now[k] += own->step / largest * (state->wanted[k] - state->now[k]);
        }
    }
    return true;
}

void ballbot_tune(const struct ballbot_law *law, struct ballbot_memory *memory)
{
    const struct ballbot_tuning_record *own = &law->tuning;
    struct ballbot_tuning_state *state = &memory->tuning;

    if (!move(own, state) || own->others == 0) {
        return;
    }
    const float first = state->now[0];
    const float second = state->now[1];

    for (int i = 0; i < BALLBOT_MAX_WHEELS; ++i) {
        for (int j = 0; j < 10; ++j) {
            state->gain[i][j] = first * own->gain[0][i][j] + second * own->gain[1][i][j];
        }
        for (int j = 0; j < 3; ++j) {
            state->integral[i][j] = first * own->integral[0][i][j] + second * own->integral[1][i][j];
        }
    }
    for (int i = 0; i < 2; ++i) {
        for (int j = 0; j < 4; ++j) {
            state->asked[i][j] = first * own->asked[0][i][j] + second * own->asked[1][i][j];
        }
    }
    state->turn_rate = first * own->turn_rate[0] + second * own->turn_rate[1];
}
