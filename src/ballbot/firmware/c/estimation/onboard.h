/* Generated from ballbot/estimation/onboard.py by
 * `python -m tests.support.firmware_headers`; do not edit.
 *
 * The on-board state, the thesis's way.
 */
#ifndef BALLBOT_ONBOARD_H
#define BALLBOT_ONBOARD_H

#include <stdbool.h>

#include "ballbot_math.h"
#include "ballbot_types.h"
#include "compensated_sum.h"

/* An angular velocity. */
struct ballbot_angular_velocity {
    float x; /* [rad/s] */
    float y; /* [rad/s] */
    float z; /* [rad/s] */
};

/* Forget the past; the robot stands at a position x, y [m], world frame. */
void ballbot_onboard_reset(struct ballbot_onboard_memory *memory, const float position[2]);

/* Return the ball's angular velocity relative to the body, in its frame [rad/s]. */
struct ballbot_angular_velocity ballbot_ball_rate(const float ball_from_wheels[3][4], int32_t wheel_count,
        const float speeds[BALLBOT_MAX_WHEELS]);

/* Take one sample and fill the state: x, y [m], theta, phi, psi [rad] and their rates, world frame.
 *
 * All are NaN until a reading is whole. Return 1 if it is whole, 0 if something in it is predicted or missing.
 */
int32_t ballbot_onboard_update(const struct ballbot_onboard_record *record, struct ballbot_onboard_memory *memory,
        int32_t wheel_count, const struct ballbot_reading_record *reading, float state[10]);

#endif
