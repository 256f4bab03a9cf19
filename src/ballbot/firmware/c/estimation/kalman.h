/*
 * The on-board state by a Kalman filter of 14 states: IMU, encoders and, where there is one, a fix from outside.
 *
 * States, equations and sensors are those of ballbot/estimation/kalman_model.py, which explains them; kalman_model.h is
 * made from it. The filter of the Python package is the same, in double precision.
 *
 * Numbers that are seen are taken in one after the other. What lies below the diagonal of the covariance P is not kept.
 * A variance is never let below the part of it that the numbers must leave by the inequality of Cauchy and Schwarz, so
 * that rounding makes none negative. A state is a compensated sum. Once heading or place is unknown by 0.2 rad or 0.2 m,
 * without a fix, that grows no more: it would outgrow a float.
 */
#ifndef BALLBOT_ESTIMATION_KALMAN_H
#define BALLBOT_ESTIMATION_KALMAN_H

#include "ballbot_types.h"

/* Forget the past; the robot stands still at a position x, y [m], world frame, when the next reading comes. */
void ballbot_kalman_reset(struct ballbot_kalman_memory *memory, const float position[2]);

/*
 * Take one sample and give the state: x, y [m], theta, phi, psi [rad] and their rates, world frame.
 *
 * What a reading lacks is predicted: the gyro stays as it was, and encoders or attitude correct nothing. All states are
 * NaN until a reading is whole, and from readings that no sensor gives and that leave no state, until the next reset.
 * Return 1 if the reading is whole, 0 if not.
 */
int32_t ballbot_kalman_update(const struct ballbot_kalman_record *record, struct ballbot_kalman_memory *memory,
                              int32_t wheel_count, const struct ballbot_reading_record *reading, float state[10]);

#endif
