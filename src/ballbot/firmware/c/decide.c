/* Generated from ballbot/control/law.py by
 * `python -m tests.support.firmware_headers`; do not edit.
 *
 * The control law, compiled once for one robot and for batches of robots.
 *
 *     u = K S(psi) (r_s - x) + parts' torques + friction compensation,  filtered and limited
 *
 * A policy scales these torques and adds its own before they are limited.
 *
 * S(psi) turns the pairs (x y), (theta phi) of the error and their rates by -psi into the heading frame: K is designed at
 * psi = 0 and the wheels turn with the body. decide calls the steps of the parts in order; the steps of a missing part
 * have no effect.
 *
 * A controller's numbers are one record (LAW), so that every robot in a batch can have its own law; its memory between
 * updates is another (MEMORY). Both are derived from the parts' dataclasses (ballbot.records). The
 * firmware's C, decide.c and parts/, is written from this file and those of the parts (tests.support.firmware_law).
 */
#include "law.h"

#include "estimation/heading.h"
#include "parts/policy.h"
#include "parts/steps.h"

/* Return the reference of an axis without a planner. */
static struct ballbot_smooth_reference at_rest(float value)
{
    return (struct ballbot_smooth_reference){ value, 0.0f, 0.0f, 0.0f, 0.0f };
}

/* Return the motion that is followed: a plan as it is, or the planned one to the pose that is asked for. */
static struct ballbot_followed_motion followed(const struct ballbot_law *law, struct ballbot_memory *memory,
        struct ballbot_pose pose, const struct ballbot_predicted *ahead, const float reference[10],
        struct ballbot_pose wanted)
{
    const struct ballbot_pose asked = { wanted.x - pose.x, wanted.y - pose.y, wanted.psi - pose.psi };

    if (ballbot_follows_plan(law, memory, reference)) {
        ballbot_restart_planner(memory, wanted);
        return ballbot_planned(law, memory, ahead->a, reference, asked);
    }
    if (law->planner.on == 0) {
        return (struct ballbot_followed_motion){ at_rest(asked.x), at_rest(asked.y), at_rest(asked.psi) };
    }
    return ballbot_plan_motion(law, memory, pose, ahead, wanted);
}

/* Return S(psi) (r_s - x). */
static struct ballbot_robot_state heading_error(struct ballbot_heading_frame a,
        const struct ballbot_robot_state *state, const struct ballbot_followed_motion *to)
{
    const struct ballbot_robot_state error = { to->x.value - state->x, to->y.value - state->y, -state->theta,
        -state->phi, to->psi.value - state->psi, to->x.rate - state->x_dot, to->y.rate - state->y_dot,
        -state->theta_dot, -state->phi_dot, to->psi.rate - state->psi_dot };

    return ballbot_turned_state(a, &error);
}

/* Return the torque K e of a wheel. */
static float feedback(const float gain[10], const struct ballbot_robot_state *e)
{
    const float for_pose = gain[0] * e->x + gain[1] * e->y + gain[2] * e->theta + gain[3] * e->phi + gain[4] * e->psi;
    const float for_speed = gain[5] * e->x_dot + gain[6] * e->y_dot;

    return for_pose + for_speed + gain[7] * e->theta_dot + gain[8] * e->phi_dot + gain[9] * e->psi_dot;
}

/* Limit the torques of all wheels so that the lean's come first and nothing turns the robot that was not asked for.
 *
 * Their mean turns the robot, and what they differ by moves it. If more than twice the limit is asked for, the robot
 * is about to fall: the more is asked, the more each wheel gives what it can, though that turns the robot.
 */
static void limit_together(float torques[], float limit, int32_t n)
{
    float mean = 0.0f;
    float least = 0.0f;
    float most = 0.0f;

    for (int32_t i = 0; i < n; ++i) {
        mean += torques[i] / (float)n;
    }
    for (int32_t i = 0; i < n; ++i) {
        least = ballbot_smaller(least, torques[i] - mean);
        most = ballbot_larger(most, torques[i] - mean);
    }
    const float largest = ballbot_larger(most, -least);
    const float share = (largest > limit) ? limit / largest : 1.0f;
    const float turning = ballbot_smaller(ballbot_larger(mean, -limit - share * least), limit - share * most);
    const float falling = ballbot_larger(0.0f, 1.0f - 2.0f * share);

    for (int32_t i = 0; i < n; ++i) {
        const float together = turning + share * (torques[i] - mean);

        torques[i] = ballbot_clipped(together + falling * (ballbot_clipped(torques[i], limit) - together), limit);
    }
}

/* Filter, limit and remember the torques, learned ones among them; return whether one exceeded the limit. */
static bool filter_and_limit(const struct ballbot_law *law, struct ballbot_memory *memory, float torques[],
        int32_t n, bool learned)
{
    struct ballbot_torque_history *history = &memory->history;
    const float limit = law->torque_limit;
    bool limited = false;

    for (int32_t i = 0; i < n; ++i) {
        history->disturbance_compensation[0][i] = 0.0f; /* the observer adds to it */
        torques[i] = ballbot_notched(law, memory, ballbot_add_estimate(memory, torques[i], i), i);
        if (learned) {
            torques[i] = ballbot_with_policy(law, memory, torques[i], i);
        }
        limited = limited || ballbot_magnitude(torques[i]) > limit;
    }
    if (limited) {
        limit_together(torques, limit, n);
    }
    for (int32_t i = 0; i < n; ++i) {
        history->acting[0][i] = torques[i];
        history->limited[0][i] = limited ? 1.0f : 0.0f;
    }
    return limited;
}

/* Fill the torques of n wheels for a state and a reference that are valid. A policy has weights. */
void ballbot_decide(const struct ballbot_law *law, struct ballbot_memory *memory, const float measured[10],
        const float reference[10], float torques[], int32_t n)
{
    ballbot_tune(law, memory);
    const struct ballbot_heading_frame a = ballbot_heading_frame(measured[4]);
    const float psi = ballbot_unwrapped(&memory->measured_heading, measured[4]);
    const struct ballbot_pose pose = { measured[0], measured[1], psi };
    const struct ballbot_pose wanted = { reference[0], reference[1], ballbot_unwrapped(&memory->reference_heading,
        reference[4]) };
    /* relative to the pose */
    const struct ballbot_robot_state seen = { 0.0f, 0.0f, measured[2], measured[3], 0.0f, measured[5], measured[6],
        measured[7], measured[8], measured[9] };

    ballbot_observe(law, memory, a, &seen, n);
    ballbot_act(law, memory, a, &seen, pose, wanted);
    const struct ballbot_predicted ahead = ballbot_predict(law, memory, a, &seen, n);
    const struct ballbot_followed_motion to = followed(law, memory, pose, &ahead, reference, wanted);
    const struct ballbot_robot_state error = heading_error(ahead.a, &ahead.state, &to);
    const struct ballbot_robot_state error_with_lean = ballbot_lean_error(law, ahead.a, &to, &error);
    const struct ballbot_limited_error less = ballbot_limit_error(law, memory, &error_with_lean);

    if (less.limited) {
        ballbot_plan_gently(memory);
    }
    const struct ballbot_sample now = { ahead.a, ahead.state, to, less.e };

    for (int32_t i = 0; i < n; ++i) {
        torques[i] = feedback(law->gain[i], &now.e);
        if (law->tuning.others > 0) {
            torques[i] += feedback(memory->tuning.gain[i], &now.e);
        }
    }
    ballbot_add_feed_forward(law, &now, torques, n);
    ballbot_add_integral(law, memory, &now, torques, n);
    if (law->compensation.full + law->compensation.partial > 0.0f) {
        ballbot_compensate(law, memory, &now, torques, n);
    }
    const bool limited = filter_and_limit(law, memory, torques, n, ballbot_within_policy(law, &seen));

    ballbot_learn_integral(law, memory, &now, limited || less.limited);
}
