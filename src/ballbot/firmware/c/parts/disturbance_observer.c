/* Generated from ballbot/control/parts/disturbance_observer.py by
 * `python -m tests.support.firmware_headers`; do not edit.
 *
 * A disturbance observer: it estimates the torque lost to any cause and adds it, without a friction model.
 *
 *     d' = w (lost - d),      u += d      d within its limit
 *
 * By the linearised exact model without friction, x' = A x + B u in the heading frame, the change of the rates over a
 * sample needed the torques B^+ (x' - A x). B^+ is the least-squares left inverse: three torques cannot match the changes
 * of five rates, and these minimise the sum of squares, in which m/s^2 and rad/s^2 have the same weight. The excess of the
 * motors' torques was lost to friction, a slope or a push. Four wheels can push against each other without moving the
 * robot; the motion does not show such torques, so they are left out of d. Unlike friction compensation the observer needs
 * no friction model and also corrects slope and payload, but with a lag of 1/w, and it passes the sensors' noise on.
 * Beside a compensation it adds the remainder.
 */
#include "parts/steps.h"

/* The rates' change, heading frame. */
struct changes {
    float x; /* [m/s^2] */
    float y;
    float theta; /* [rad/s^2] */
    float phi;
    float psi;
};

/* Return the rates' change since the last sample; rate is samples a second. */
static struct changes rate_changes(struct ballbot_heading_frame a, const float rates[5],
        const struct ballbot_robot_state *seen, float rate)
{
    const struct ballbot_pair speed = ballbot_turned(a, rate * (seen->x_dot - rates[0]),
        rate * (seen->y_dot - rates[1]));
    const struct ballbot_pair lean = ballbot_turned(a, rate * (seen->theta_dot - rates[2]),
        rate * (seen->phi_dot - rates[3]));

    return (struct changes){ speed.x, speed.y, lean.x, lean.y, rate * (seen->psi_dot - rates[4]) };
}

/* Return a wheel's torque for those changes at that lean. */
static float needed(const struct ballbot_observer_record *own, int32_t i, struct changes changes,
        struct ballbot_pair lean)
{
    const float *row = own->by_acceleration[i];
    const float *by_lean = own->by_lean[i];
    const float for_speed = row[0] * changes.x + row[1] * changes.y;
    const float for_lean = row[2] * changes.theta + row[3] * changes.phi + row[4] * changes.psi;

    return for_speed + for_lean + by_lean[0] * lean.x + by_lean[1] * lean.y;
}

/* Step the estimate of each wheel. */
static void step_estimates(const struct ballbot_law *law, struct ballbot_memory *memory,
        struct ballbot_heading_frame a, const struct ballbot_robot_state *seen, int32_t n)
{
    const struct ballbot_observer_record *own = &law->disturbance_observer;
    const struct ballbot_torque_history *past = &memory->history;
    float *found = memory->disturbance_observer.estimate;
    const struct changes changes = rate_changes(a, memory->disturbance_observer.rates, seen, law->rate);
    const struct ballbot_pair lean = ballbot_turned(a, seen->theta, seen->phi);

    for (int32_t i = 0; i < n; ++i) {
        if (ballbot_over_last_sample(&law->prediction, past->limited, i) > 0.0f) {
            continue; /* a sample at the limit does not determine the lost torque */
        }
        const float lost = ballbot_over_last_sample(&law->prediction, past->acting, i) - needed(own, i, changes,
            lean);
        const float compensated = ballbot_over_last_sample(&law->prediction, past->friction_compensation, i);

        found[i] += own->fraction * (lost - compensated - found[i]);
    }
    float idle = 0.0f;

    for (int32_t i = 0; i < n; ++i) {
        idle += own->idle[i] * found[i];
    }
    for (int32_t i = 0; i < n; ++i) {
        found[i] = ballbot_clipped(found[i] - idle * own->idle[i], own->limit);
    }
}

/* Estimate the torque lost in the sample that has passed, and step the torque added. */
void ballbot_observe(const struct ballbot_law *law, struct ballbot_memory *memory, struct ballbot_heading_frame a,
        const struct ballbot_robot_state *seen, int32_t n)
{
    const struct ballbot_observer_record *own = &law->disturbance_observer;
    struct ballbot_observer_state *state = &memory->disturbance_observer;

    if (own->on == 0) {
        return;
    }
    if (state->started > 0) {
        step_estimates(law, memory, a, seen, n);
    }
    state->rates[0] = seen->x_dot;
    state->rates[1] = seen->y_dot;
    state->rates[2] = seen->theta_dot;
    state->rates[3] = seen->phi_dot;
    state->rates[4] = seen->psi_dot;
    state->started = 1;
}

/* Return a wheel's torque with the lost one, which is recorded in the history; zero without an observer. */
float ballbot_add_estimate(struct ballbot_memory *memory, float torque, int32_t i)
{
    const float estimate = memory->disturbance_observer.estimate[i];

    memory->history.disturbance_compensation[0][i] += estimate;
    return torque + estimate;
}
