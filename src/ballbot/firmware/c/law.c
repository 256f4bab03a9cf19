/* The control law: the stages in order, each with the steps of its parts. See law.h. */
#include "law.h"

#include "parts/parts.h"

bool ballbot_is_state(const float state[10])
{
    for (int i = 0; i < 10; ++i) {
        if (!(ballbot_magnitude(state[i]) <= BALLBOT_LARGEST_STATE)) {
            return false;
        }
    }
    return true;
}

int32_t ballbot_refused_place(const struct ballbot_law *law, const float reference[10])
{
    for (int32_t i = 0; i < 10; ++i) {
        const bool allowed = i == 0 || i == 1 || i == 4 || law->feed_forward.on != 0;

        if (!(ballbot_magnitude(reference[i]) <= (allowed ? BALLBOT_LARGEST_STATE : 0.0f))) {
            return i;
        }
    }
    return BALLBOT_ALLOWED;
}

/* Fill the pose, its heading unwrapped, and the state relative to the pose. */
static void observed(struct ballbot_sample *now, const float measured[10], float psi)
{
    now->a = ballbot_heading_of(measured[4]);
    for (int i = 0; i < 10; ++i) {
        now->state[i] = measured[i];
    }
    now->pose[0] = measured[0];
    now->pose[1] = measured[1];
    now->pose[2] = psi;
    now->state[0] = 0.0f;
    now->state[1] = 0.0f;
    now->state[4] = 0.0f;
}

/* Return the reference of an axis without shaping. */
static struct ballbot_smooth at_rest(float value)
{
    const struct ballbot_smooth still = { value, 0.0f, 0.0f, 0.0f, 0.0f };

    return still;
}

/* Fill now->e with S(psi) (r_s - x). */
static void heading_error(struct ballbot_sample *now)
{
    const float *state = now->state;
    const float error[10] = { now->x.value - state[0], now->y.value - state[1], -state[2], -state[3], now->psi.value - state[4],
                              now->x.rate - state[5],  now->y.rate - state[6],  -state[7], -state[8], now->psi.rate - state[9] };

    ballbot_state_to_heading(now->a, error, now->e);
}

/* Return the torque K e of a wheel. */
static float feedback(const float gain[10], const float e[10])
{
    float torque = gain[0] * e[0];

    for (int j = 1; j < 10; ++j) {
        torque += gain[j] * e[j];
    }
    return torque;
}

/* Filter, limit and remember the torques, `learned` ones among them; return whether one exceeded the limit. */
static bool filter_and_limit(const struct ballbot_law *law, struct ballbot_memory *memory, float torques[],
                             int32_t n, bool learned)
{
    struct ballbot_torque_history *history = &memory->history;
    const float limit = law->torque_limit;
    bool limited = false;

    for (int32_t i = 0; i < n; ++i) {
        history->disturbance_compensation[0][i] = 0.0f; /* the stage adds to it */
        torques[i] = ballbot_disturbance_observer_filter(memory, torques[i], i);
        torques[i] = ballbot_notch_filter(law, memory, torques[i], i);
        if (learned) {
            torques[i] = ballbot_policy_filter(law, memory, torques[i], i);
        }
        limited = limited || ballbot_magnitude(torques[i]) > limit;
        torques[i] = ballbot_clipped(torques[i], limit);
        history->acting[0][i] = torques[i];
    }
    for (int32_t i = 0; i < n; ++i) {
        history->limited[0][i] = limited ? 1.0f : 0.0f;
    }
    return limited;
}

/* Fill the torques for a state and a reference that are valid. */
static void decide(const struct ballbot_law *law, struct ballbot_memory *memory, int32_t n, const float measured[10],
                   const float reference[10], float torques[])
{
    struct ballbot_sample now;
    float wanted[10];

    ballbot_tune(law, memory);
    observed(&now, measured, ballbot_unwrapped(&memory->measured_heading, measured[4]));
    ballbot_disturbance_observer_observe(law, memory, &now, n);

    for (int i = 0; i < 10; ++i) {
        wanted[i] = reference[i];
    }
    wanted[4] = ballbot_unwrapped(&memory->reference_heading, reference[4]);
    now.reference = wanted;
    now.x = at_rest(wanted[0] - now.pose[0]);
    now.y = at_rest(wanted[1] - now.pose[1]);
    now.psi = at_rest(wanted[4] - now.pose[2]);

    const bool learned = ballbot_policy_decide(law, memory, &now);

    ballbot_prediction_predict(law, memory, &now, n);
    if (ballbot_follows_plan(law, memory, reference)) {
        ballbot_shaping_restart(memory, &now);
        ballbot_feed_forward_plan(law, memory, &now);
    } else {
        ballbot_shaping_shape(law, memory, &now);
    }

    heading_error(&now);
    now.error_limited = false;
    ballbot_feed_forward_error(law, &now);
    ballbot_lean_limit_error(law, memory, &now);

    for (int32_t i = 0; i < n; ++i) {
        torques[i] = feedback(law->gain[i], now.e);
        if (law->tuning.others > 0) {
            torques[i] += feedback(memory->tuning.gain[i], now.e);
        }
    }
    ballbot_feed_forward_torque(law, &now, torques, n);
    ballbot_integral_torque(law, memory, &now, torques, n);
    if (law->compensation.full + law->compensation.partial > 0.0f) {
        ballbot_compensate(law, memory, &now, torques, n);
    }
    const bool limited = filter_and_limit(law, memory, torques, n, learned) || now.error_limited;

    ballbot_integral_learn(law, memory, &now, limited);
}

int32_t ballbot_control_law(const struct ballbot_law *law, struct ballbot_memory *memory, const float measured[10],
                            const float reference[10], float torques[], int32_t n)
{
    const int32_t refused = ballbot_refused_place(law, reference);

    if (refused != BALLBOT_ALLOWED || !ballbot_is_state(measured)) {
        for (int32_t i = 0; i < n; ++i) {
            torques[i] = 0.0f;
        }
        return refused;
    }
    decide(law, memory, n, measured, reference, torques);
    return BALLBOT_ALLOWED;
}
