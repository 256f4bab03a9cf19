/* Generated from ballbot/control/parts/prediction.py by
 * `python -m tests.support.firmware_headers`; do not edit.
 *
 * Prediction over the delay: the LQR for a plant whose torques act late.
 *
 * A torque computed from the state measured at t_k acts from t_k + tau on, with tau the delay of transport, filters and
 * computation. It cannot influence the motion before that, so the optimal law is the undelayed law applied to the state at
 * t_k + tau,
 *
 *     u_k = K (r - x(t_k + tau)),     x(t_k + tau) = exp(A tau) x(t_k) + sum over j of G_j v_(k-j)
 *
 * with G_j the effect until t_k + tau of the torque of j updates ago, which acts for a sample time from t_(k-j) + tau on:
 * exact for any tau. (For whole samples it is the gain that the Riccati equation of the state with the torques under way
 * gives.) A and B are those of the exact model without friction in the heading frame, and v are the acting torques less
 * what friction compensation and disturbance observer added, which the losses consume. The prediction is linear and
 * ignores other friction and the robot's turning meanwhile.
 */
#include "parts/steps.h"

/* Return a number of the torque history for the torques that acted over the last sample, their mean in time.
 *
 * own is a PredictionRecord; without a prediction these are the torques of the last update.
 */
float ballbot_over_last_sample(const struct ballbot_prediction_record *own,
        const float values[BALLBOT_MAX_PAST][BALLBOT_MAX_WHEELS], int32_t wheel)
{
    const float last = values[own->samples][wheel];

    if (own->fraction == 0.0f) {
        return last;
    }
    return (1.0f - own->fraction) * last + own->fraction * values[own->samples + 1][wheel];
}

/* Fill ten numbers with a state. */
static void fill(float numbers[10], const struct ballbot_robot_state *state)
{
    numbers[0] = state->x;
    numbers[1] = state->y;
    numbers[2] = state->theta;
    numbers[3] = state->phi;
    numbers[4] = state->psi;
    numbers[5] = state->x_dot;
    numbers[6] = state->y_dot;
    numbers[7] = state->theta_dot;
    numbers[8] = state->phi_dot;
    numbers[9] = state->psi_dot;
}

/* Compute by how much the state changes until the torque that is computed now will act, heading frame. */
static void change_until(const struct ballbot_prediction_record *own, const struct ballbot_torque_history *past,
        const float turned_numbers[10], float change[10], int32_t n)
{
    for (int32_t i = 0; i < 10; ++i) {
        change[i] = 0.0f;
        for (int32_t j = 0; j < 10; ++j) {
            const float by_state = (i == j) ? own->transition[i][j] - 1.0f : own->transition[i][j];

            change[i] += by_state * turned_numbers[j];
        }
    }
    for (int32_t ago = 0; ago < own->count; ++ago) {
        for (int32_t wheel = 0; wheel < n; ++wheel) {
            const float added = past->friction_compensation[ago][wheel] + past->disturbance_compensation[ago][wheel];
            const float v = past->acting[ago][wheel] - added;

            for (int32_t i = 0; i < 10; ++i) {
                change[i] += own->by_torque[wheel][ago][i] * v;
            }
        }
    }
}

/* Return ten numbers as a state. */
static struct ballbot_robot_state state_of(const float v[10])
{
    return (struct ballbot_robot_state){ v[0], v[1], v[2], v[3], v[4], v[5], v[6], v[7], v[8], v[9] };
}

/* Make room for another update, the last updates kept. */
static void grow_older(struct ballbot_torque_history *past, int32_t updates)
{
    for (int32_t ago = updates; ago > 0; --ago) {
        for (int32_t i = 0; i < BALLBOT_MAX_WHEELS; ++i) {
            past->acting[ago][i] = past->acting[ago - 1][i];
            past->friction_compensation[ago][i] = past->friction_compensation[ago - 1][i];
            past->disturbance_compensation[ago][i] = past->disturbance_compensation[ago - 1][i];
            past->limited[ago][i] = past->limited[ago - 1][i];
        }
    }
}

/* Return the state at which the torques will act, and make room for them in the history. */
struct ballbot_predicted ballbot_predict(const struct ballbot_law *law, struct ballbot_memory *memory,
        struct ballbot_heading_frame a, const struct ballbot_robot_state *seen, int32_t n)
{
    const struct ballbot_prediction_record *own = &law->prediction;
    struct ballbot_prediction_state *work = &memory->prediction;

    if (own->on == 0) {
        return (struct ballbot_predicted){ a, *seen };
    }
    const struct ballbot_robot_state before = ballbot_turned_state(a, seen);

    fill(work->turned, &before);
    change_until(own, &memory->history, work->turned, work->after, n);
    /* the change is small, and so is its rounding */
    const struct ballbot_heading_frame back = { -a.sin_psi, a.cos_psi };
    const struct ballbot_robot_state change = state_of(work->after);
    const struct ballbot_robot_state change_in_world = ballbot_turned_state(back, &change);

    fill(work->turned, &change_in_world);
    fill(work->ahead, seen);
    for (int32_t i = 0; i < 10; ++i) {
        work->ahead[i] += work->turned[i];
    }
    grow_older(&memory->history, own->samples + 1);
    return (struct ballbot_predicted){ ballbot_heading_frame_after(a, work->ahead[4]), state_of(work->ahead) };
}
