/* Prediction: feed back the state in which late torques will act.
 *
 *     x(t + tau) = transition x(t) + sum over j of by_torque_j v_j
 *
 * v_j [N m] is what acted j updates ago less both compensations. Linear model without friction, heading frame. The
 * model does not depend on x, y and psi: they are predicted relative to the measured pose. The state's change is summed
 * and then added, because it is small and so is its rounding.
 */
#include "parts/parts.h"

/* Fill by how much the state changes until the torque that is computed now will act, heading frame. */
static void change_until(const struct ballbot_prediction_record *own, const struct ballbot_torque_history *past,
                         const float turned[10], float change[10], int32_t n)
{
    for (int i = 0; i < 10; ++i) {
        change[i] = 0.0f;
        for (int j = 0; j < 10; ++j) {
            const float by_state = (i == j) ? own->transition[i][j] - 1.0f : own->transition[i][j];

            change[i] += by_state * turned[j];
        }
    }
    for (int32_t ago = 0; ago < own->count; ++ago) {
        for (int32_t wheel = 0; wheel < n; ++wheel) {
            const float v = past->acting[ago][wheel] - past->friction_compensation[ago][wheel] -
                            past->disturbance_compensation[ago][wheel];

            for (int i = 0; i < 10; ++i) {
                change[i] += own->by_torque[wheel][ago][i] * v;
            }
        }
    }
}

/* Make room for another update, the last `updates` kept. */
static void grow_older(struct ballbot_torque_history *past, int32_t updates)
{
    for (int32_t ago = updates; ago > 0; --ago) {
        for (int i = 0; i < BALLBOT_MAX_WHEELS; ++i) {
            past->acting[ago][i] = past->acting[ago - 1][i];
            past->friction_compensation[ago][i] = past->friction_compensation[ago - 1][i];
            past->disturbance_compensation[ago][i] = past->disturbance_compensation[ago - 1][i];
            past->limited[ago][i] = past->limited[ago - 1][i];
        }
    }
}

void ballbot_prediction_predict(const struct ballbot_law *law, struct ballbot_memory *memory,
                                struct ballbot_sample *now, int32_t n)
{
    const struct ballbot_prediction_record *own = &law->prediction;
    struct ballbot_prediction_state *work = &memory->prediction;
    const struct ballbot_heading back = { -now->a.sine, now->a.cosine }; /* from the heading frame to the world */

    if (own->on == 0) {
        return;
    }
    ballbot_state_to_heading(now->a, now->state, work->turned);
    change_until(own, &memory->history, work->turned, work->after, n);
    ballbot_state_to_heading(back, work->after, work->turned);
    for (int i = 0; i < 10; ++i) {
        now->state[i] += work->turned[i];
        work->ahead[i] = now->state[i];
    }
    work->ahead[0] += now->pose[0];
    work->ahead[1] += now->pose[1];
    work->ahead[4] += now->pose[2];
    now->a = ballbot_heading_after(now->a, now->state[4]);
    grow_older(&memory->history, own->samples + 1);
}

float ballbot_over_last_sample(const struct ballbot_prediction_record *own,
                               const float values[BALLBOT_MAX_PAST][BALLBOT_MAX_WHEELS], int32_t wheel)
{
    const float last = values[own->samples][wheel];

    if (!(own->fraction > 0.0f)) {
        return last;
    }
    return (1.0f - own->fraction) * last + own->fraction * values[own->samples + 1][wheel];
}
