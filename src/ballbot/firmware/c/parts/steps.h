/* Generated from ballbot/control by
 * `python -m tests.support.firmware_headers`; do not edit.
 *
 * The steps of the parts.
 */
#ifndef BALLBOT_STEPS_H
#define BALLBOT_STEPS_H

#include "parts/part.h"

/* Move the setting in use towards the one that is asked for. */
void ballbot_tune(const struct ballbot_law *law, struct ballbot_memory *memory);

/* Return the share of the compensation in use: whatever a memory holds, none and no more than the law's own. */
float ballbot_compensated_share(const struct ballbot_memory *memory);

/* Estimate the torque lost in the sample that has passed, and step the torque added. */
void ballbot_observe(const struct ballbot_law *law, struct ballbot_memory *memory, struct ballbot_heading_frame a,
        const struct ballbot_robot_state *seen, int32_t n);

/* Return a wheel's torque with the lost one, which is recorded in the history; zero without an observer. */
float ballbot_add_estimate(struct ballbot_memory *memory, float torque, int32_t i);

/* The state that is fed back, relative to the measured pose, and its heading frame. */
struct ballbot_predicted {
    struct ballbot_heading_frame a;
    struct ballbot_robot_state state;
};

/* Return a number of the torque history for the torques that acted over the last sample, their mean in time.
 *
 * own is a PredictionRecord; without a prediction these are the torques of the last update.
 */
float ballbot_over_last_sample(const struct ballbot_prediction_record *own,
        const float values[BALLBOT_MAX_PAST][BALLBOT_MAX_WHEELS], int32_t wheel);

/* Return the state at which the torques will act, and make room for them in the history. */
struct ballbot_predicted ballbot_predict(const struct ballbot_law *law, struct ballbot_memory *memory,
        struct ballbot_heading_frame a, const struct ballbot_robot_state *seen, int32_t n);

/* Let the heading rest at an angle, with a reference elsewhere. */
void ballbot_start_turning(struct ballbot_planner_state *state, float psi, float wanted);

/* Return the motion to a heading, relative to the measured one, and advance the memory. */
struct ballbot_smooth_reference ballbot_turn(const struct ballbot_planner_record *own,
        struct ballbot_planner_state *state, float psi, float wanted);

/* Let the planner go on from a pose at rest: a plan, which is followed without it, ends there. */
void ballbot_restart_planner(struct ballbot_memory *memory, struct ballbot_pose wanted);

/* Return the motion to a pose, relative to the measured one, and advance the memory. */
struct ballbot_followed_motion ballbot_plan_motion(const struct ballbot_law *law, struct ballbot_memory *memory,
        struct ballbot_pose pose, const struct ballbot_predicted *ahead, struct ballbot_pose wanted);

/* Leave motions the least torque: the robot needs its torque to catch itself. */
void ballbot_plan_gently(struct ballbot_memory *memory);

/* Return whether a reference has leans or rates, for no longer than LAPSE, and remember it. */
bool ballbot_follows_plan(const struct ballbot_law *law, struct ballbot_memory *memory, const float reference[10]);

/* Return a planned reference, of which asked is the pose relative to the measured one; after follows_plan. */
struct ballbot_followed_motion ballbot_planned(const struct ballbot_law *law, const struct ballbot_memory *memory,
        struct ballbot_heading_frame a, const float reference[10], struct ballbot_pose asked);

/* Return the error with respect to the lean and the position that the motion needs; see the module's docstring. */
struct ballbot_robot_state ballbot_lean_error(const struct ballbot_law *law, struct ballbot_heading_frame a,
        const struct ballbot_followed_motion *to, const struct ballbot_robot_state *e);

/* Add the torques for the second and fourth derivative of s, heading frame, and the second of psi. */
void ballbot_add_feed_forward(const struct ballbot_law *law, const struct ballbot_sample *now, float torques[],
        int32_t n);

/* An error within the limits, and whether it is reduced. */
struct ballbot_limited_error {
    struct ballbot_robot_state e;
    bool limited;
};

/* Return the error with position, speed and heading within the limits. */
struct ballbot_limited_error ballbot_limit_error(const struct ballbot_law *law, const struct ballbot_memory *memory,
        const struct ballbot_robot_state *e);

/* Add the torques for the integrals. */
void ballbot_add_integral(const struct ballbot_law *law, const struct ballbot_memory *memory,
        const struct ballbot_sample *now, float torques[], int32_t n);

/* Step the integrals by a sample's error; while something is limited they may only shrink. */
void ballbot_learn_integral(const struct ballbot_law *law, struct ballbot_memory *memory,
        const struct ballbot_sample *now, bool limited);

/* Add the friction's compensation to the feedback's torques. */
void ballbot_compensate(const struct ballbot_law *law, struct ballbot_memory *memory,
        const struct ballbot_sample *now, float torques[], int32_t n);

/* Return a wheel's torque through the notch, and step its state. */
float ballbot_notched(const struct ballbot_law *law, struct ballbot_memory *memory, float torque, int32_t i);

#endif
