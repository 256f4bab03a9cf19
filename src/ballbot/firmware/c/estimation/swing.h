/* Generated from ballbot/estimation/swing.py by
 * `python -m tests.support.firmware_headers`; do not edit.
 *
 * Attitudes as lean and heading, and the robot's state.
 */
#ifndef BALLBOT_SWING_H
#define BALLBOT_SWING_H

#include "estimation/kalman_model.h"

/* An attitude as lean and heading. */
struct ballbot_swing_twist {
    float g_x;
    float g_y;
    float heading; /* psi_s [rad], with the turns of psi */
};

/* An attitude as angles, and what their rates need of them. */
struct ballbot_attitude_angles {
    float theta; /* [rad] */
    float phi; /* [rad] */
    float psi; /* [rad], with the turns of psi_s */
    float s2; /* sin phi */
    float c2; /* cos phi */
    float c2_c3; /* cos phi cos psi */
    float c2_s3; /* cos phi sin psi */
};

/* Return lean and heading of the angles of R = Rx(theta) Ry(phi) Rz(psi). */
struct ballbot_swing_twist ballbot_swing_of(float theta, float phi, float psi);

/* Return C w, component k [m/s]. */
float ballbot_lever_speed(const float lever[2][3], int32_t k, float w_x, float w_y, float w_z);

/* Let a filter's state x (14) begin with an attitude, at rest: v = 0. */
void ballbot_begin_filter(const float lever[2][3], struct ballbot_swing_twist swing, const float gyro[3],
        float x[STATES]);

/* Return the cosine with this square. */
float ballbot_root_of(float square);

/* Return the angles of a lean and a heading. */
struct ballbot_attitude_angles ballbot_attitude_of(float g_x, float g_y, float heading);

/* Fill the state (10) that the robot is controlled by, from a filter's (14) and the gyro's reading (3) [rad/s]. */
void ballbot_robot_state(const float lever[2][3], const float x[STATES], const float gyro[3], float state[10]);

#endif
