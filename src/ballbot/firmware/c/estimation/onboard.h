/*
 * The on-board state, the thesis's way: an AHRS and wheel encoders, nothing else.
 *
 *     z = T_obw wheel_speed + w      ball's angular velocity, body frame [rad/s]
 *     Omega = R z                    the same, world frame
 *     v = r_b (Omega_y, -Omega_x)    velocity of a ball that rolls without slip, world frame [m/s]
 *     Phi_dot = B^-1 w               rates of theta, phi, psi [rad/s]
 *     x, y                           the sum of v from the start [m]
 *
 * A value that is missing (NaN, or beyond any sensor) is predicted: the gyro's and v stay as they were, theta, phi and
 * psi go on at their last rates. The Python package has the same estimator in ballbot/estimation/onboard.py.
 */
#ifndef BALLBOT_ESTIMATION_ONBOARD_H
#define BALLBOT_ESTIMATION_ONBOARD_H

#include "ballbot_types.h"

/* Forget the past; the robot stands at a position x, y [m], world frame. */
void ballbot_onboard_reset(struct ballbot_onboard_memory *memory, const float position[2]);

/*
 * Take one sample and give the state: x, y [m], theta, phi, psi [rad] and their rates, world frame.
 *
 * All are NaN until a reading is whole. Return 1 if the reading is whole, 0 if something in it is predicted or missing.
 */
int32_t ballbot_onboard_update(const struct ballbot_onboard_record *record, struct ballbot_onboard_memory *memory,
                               int32_t wheel_count, const struct ballbot_reading_record *reading, float state[10]);

#endif
