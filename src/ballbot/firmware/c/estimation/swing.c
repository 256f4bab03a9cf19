/* Generated from ballbot/estimation/swing.py by
 * `python -m tests.support.firmware_headers`; do not edit.
 *
 * An attitude as a lean and a heading that are independent, as the Kalman filter has it, and the robot's state from it.
 *
 *     R = Rz(psi_s) M(g)     g = R^T e_z,  psi_s = psi + 2 atan(tan(theta / 2) tan(phi / 2))
 *
 * g is the upward direction in the body's frame, M(g) the shortest turn that takes it upright. Turning the robot about the
 * vertical changes psi_s and nothing else; of theta, phi, psi it changes all three. The firmware's C is written from this
 * file (tests.support.firmware_law).
 */
#include "estimation/swing.h"

/* least square of a cosine: beyond 90 degrees, where only noise can take a lean, it is nearly zero */
#define LEAST_SQUARE 1e-06f

/* Return lean and heading of the angles of R = Rx(theta) Ry(phi) Rz(psi). */
struct ballbot_swing_twist ballbot_swing_of(float theta, float phi, float psi)
{
    float s1;
    float c1;

    ballbot_sine_cosine(theta, &s1, &c1);
    float s2;
    float c2;

    ballbot_sine_cosine(phi, &s2, &c2);
    float s3;
    float c3;

    ballbot_sine_cosine(psi, &s3, &c3);
    const float forward = -c1 * s2; /* before the turn by psi */
    const float heading = psi + 2.0f * ballbot_arctangent(s1 * s2, (1.0f + c1) * (1.0f + c2));

    return (struct ballbot_swing_twist){ c3 * forward + s3 * s1, c3 * s1 - s3 * forward, heading };
}

/* Return C w, component k [m/s]. */
float ballbot_lever_speed(const float lever[2][3], int32_t k, float w_x, float w_y, float w_z)
{
    return lever[k][0] * w_x + lever[k][1] * w_y + lever[k][2] * w_z;
}

/* Let a filter's state x (14) begin with an attitude, at rest: v = 0. */
void ballbot_begin_filter(const float lever[2][3], struct ballbot_swing_twist swing, const float gyro[3],
        float x[STATES])
{
    x[G_X] = swing.g_x;
    x[G_X + 1] = swing.g_y;
    x[S_X] = ballbot_lever_speed(lever, 0, gyro[0], gyro[1], gyro[2]);
    x[S_X + 1] = ballbot_lever_speed(lever, 1, gyro[0], gyro[1], gyro[2]);
    x[PSI] = swing.heading;
    x[SHOWN_PSI] = swing.heading;
}

/* Return the cosine with this square. */
float ballbot_root_of(float square)
{
    return ballbot_square_root(ballbot_larger(square, LEAST_SQUARE));
}

/* Return the angles of a lean and a heading. */
struct ballbot_attitude_angles ballbot_attitude_of(float g_x, float g_y, float heading)
{
    float s;
    float c;

    ballbot_sine_cosine(heading, &s, &c);
    const float g_z = ballbot_root_of(1.0f - g_x * g_x - g_y * g_y);
    const float share = 1.0f / (1.0f + g_z);
    /* of R = Rz(psi_s) M: its last column is (s2, -s1 c2, c1 c2), its first row (c2 c3, -c2 s3, s2) */
    const float s1_c2 = s * g_x + c * g_y;
    const float s2 = s * g_y - c * g_x;
    const float c2 = ballbot_root_of((1.0f - s2) * (1.0f + s2));
    const float m_12 = -share * g_x * g_y;
    const float psi = heading - 2.0f * ballbot_arctangent(s1_c2 * s2, (c2 + g_z) * (1.0f + c2));

    return (struct ballbot_attitude_angles){ ballbot_arctangent(s1_c2, g_z), ballbot_arctangent(s2, c2), psi, s2, c2,
        c * (1.0f - share * g_x * g_x) - s * m_12, s * (1.0f - share * g_y * g_y) - c * m_12 };
}

/* Fill the state (10) that the robot is controlled by, from a filter's (14) and the gyro's reading (3) [rad/s]. */
void ballbot_robot_state(const float lever[2][3], const float x[STATES], const float gyro[3], float state[10])
{
    const float w_x = gyro[0] - x[B_X];
    const float w_y = gyro[1] - x[B_X + 1];
    const float w_z = gyro[2] - x[B_X + 2];
    const float v_x = x[S_X] - ballbot_lever_speed(lever, 0, w_x, w_y, w_z);
    const float v_y = x[S_X + 1] - ballbot_lever_speed(lever, 1, w_x, w_y, w_z);
    const struct ballbot_attitude_angles a = ballbot_attitude_of(x[G_X], x[G_X + 1], x[PSI]);
    float s;
    float c;

    ballbot_sine_cosine(x[PSI], &s, &c);

    state[0] = x[X];
    state[1] = x[X + 1];
    state[2] = a.theta;
    state[3] = a.phi;
    state[4] = a.psi;
    state[5] = c * v_x - s * v_y;
    state[6] = s * v_x + c * v_y;
    state[7] = (a.c2_c3 * w_x - a.c2_s3 * w_y) / (a.c2 * a.c2);
    state[8] = (a.c2_s3 * w_x + a.c2_c3 * w_y) / a.c2;
    state[9] = w_z - a.s2 * state[7];
}
