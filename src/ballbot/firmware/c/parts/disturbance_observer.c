/* Disturbance observer: the torque that is lost to any cause is estimated and added.
 *
 *     needed = by_acceleration (change of the rates) + by_lean (theta, phi)      of a robot without friction
 *     d += fraction (acted - needed - compensated - d)      each wheel's, within its limit [N m]
 *
 * The change of the rates is that of the last sample, in [m/s^2] and [rad/s^2], heading frame. A sample in which a
 * torque was at its limit does not determine the lost torque. Of torques that move nothing, as four wheels have them,
 * d has none.
 */
#include "parts/parts.h"

/* Fill the rates' change since the last sample (5), heading frame; `rate` is samples a second. */
static void accelerations(const struct ballbot_sample *now, const float rates[5], float rate, float changes[5])
{
    const float *seen = &now->state[5];
    const struct ballbot_pair speed =
        ballbot_to_heading(now->a, rate * (seen[0] - rates[0]), rate * (seen[1] - rates[1]));
    const struct ballbot_pair lean =
        ballbot_to_heading(now->a, rate * (seen[2] - rates[2]), rate * (seen[3] - rates[3]));

    changes[0] = speed.x;
    changes[1] = speed.y;
    changes[2] = lean.x;
    changes[3] = lean.y;
    changes[4] = rate * (seen[4] - rates[4]);
}

/* Return a wheel's torque for those accelerations at that lean. */
static float torque_needed(const struct ballbot_observer_record *own, int32_t i, const float changes[5],
                           struct ballbot_pair lean)
{
    float torque = own->by_acceleration[i][0] * changes[0];

    for (int j = 1; j < 5; ++j) {
        torque += own->by_acceleration[i][j] * changes[j];
    }
    return torque + own->by_lean[i][0] * lean.x + own->by_lean[i][1] * lean.y;
}

/* Step the estimate of each wheel. */
static void step_estimates(const struct ballbot_law *law, struct ballbot_memory *memory,
                           const struct ballbot_sample *now, int32_t n)
{
    const struct ballbot_observer_record *own = &law->disturbance_observer;
    const struct ballbot_torque_history *past = &memory->history;
    const struct ballbot_pair lean = ballbot_to_heading(now->a, now->state[2], now->state[3]);
    float *found = memory->disturbance_observer.estimate;
    float changes[5];
    float idle = 0.0f;

    accelerations(now, memory->disturbance_observer.rates, law->rate, changes);
    for (int32_t i = 0; i < n; ++i) {
        if (ballbot_over_last_sample(&law->prediction, past->limited, i) > 0.0f) {
            continue;
        }
        const float lost = ballbot_over_last_sample(&law->prediction, past->acting, i) -
                           torque_needed(own, i, changes, lean);
        const float compensated = ballbot_over_last_sample(&law->prediction, past->friction_compensation, i);
        const float error = lost - compensated - found[i];

        found[i] += own->fraction * error;
    }
    for (int32_t i = 0; i < n; ++i) {
        idle += own->idle[i] * found[i];
    }
    for (int32_t i = 0; i < n; ++i) {
        found[i] = ballbot_clipped(found[i] - idle * own->idle[i], own->limit);
    }
}

void ballbot_disturbance_observer_observe(const struct ballbot_law *law, struct ballbot_memory *memory,
                                          const struct ballbot_sample *now, int32_t n)
{
    struct ballbot_observer_state *state = &memory->disturbance_observer;

    if (law->disturbance_observer.on == 0) {
        return;
    }
    if (state->started > 0) {
        step_estimates(law, memory, now, n);
    }
    for (int j = 0; j < 5; ++j) {
        state->rates[j] = now->state[5 + j];
    }
    state->started = 1;
}

float ballbot_disturbance_observer_filter(struct ballbot_memory *memory, float torque, int32_t i)
{
    const float estimate = memory->disturbance_observer.estimate[i];

    memory->history.disturbance_compensation[0][i] += estimate;
    return torque + estimate;
}
