/* Generated from ballbot/estimation/slip.py by
 * `python -m tests.support.firmware_headers`; do not edit.
 *
 * Wheels that slip, and pushes.
 */
#ifndef BALLBOT_SLIP_H
#define BALLBOT_SLIP_H

#include "estimation/kalman_model.h"
#include "estimation/onboard.h"

/* Return the ball's turning relative to the body [rad/s], NaN while wheels slip; the memory has what was seen.
 *
 * turned is that by all wheels, pivoted the mean square of its pivoting lately, x the filter's state before the
 * sample, and gyro (3) [rad/s] at its end.
 */
struct ballbot_angular_velocity ballbot_without_slip(const struct ballbot_kalman_record *record,
        struct ballbot_slip_memory *memory, float pivoted, const float x[STATES], const float gyro[3],
        struct ballbot_angular_velocity turned);

#endif
