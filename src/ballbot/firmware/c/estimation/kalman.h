/*
 * The on-board state by a Kalman filter of 14 states: IMU, encoders and, where there is one, a fix from outside.
 *
 *     x y      place of the ball, world frame [m]
 *     psi      heading: R = Rz(psi) M(g), M the shortest turn that takes g upright [rad]
 *     g        (2) x and y of the upward direction in the body's frame, its lean [-]
 *     s        (2) momentum about the floor's contact as a speed, heading frame [m/s]
 *     b        (3) gyro bias, body frame [rad/s]
 *     psi + d  the AHRS's heading [rad], and r, the rate of its error d [rad/s]
 *     g + a    (2) the AHRS's lean [-], a its slow error
 *
 *     motion        w = gyro - b                   g_dot = g x w
 *                   psi_dot = w . (g + e_z) / (1 + g_z)
 *                   v = s - C w                    s_dot = -Lambda g - psi_dot e_z x s
 *                   (x, y)_dot = Rz(psi) v         a_dot = -a / tau,  d_dot = r
 *
 *     the wheels    Omega = M(g) (T_obw wheel_speed + w)      the ball's angular velocity, heading frame [rad/s]
 *                   v = r_b (Omega_y, -Omega_x)    Omega_z = 0
 *
 * ballbot/estimation/kalman_model.py has the reasons. There, d and a are states; here, the values that the AHRS shows are.
 * So each of its values is a state, and no difference of two large and nearly equal covariances is taken.
 *
 * Numbers that are seen at the same time are taken in together, as rows of H with variances R:
 *
 *     H P H^T + R = L D L^T    V = P H^T L^-T    P+ = P - V D^-1 V^T    x+ = x + V D^-1 L^-1 (seen - expected)
 *
 * No matrix is inverted. P is symmetric to the bit; of x and y, what lies below its diagonal is not kept. A variance is
 * never let below the part of it that the numbers must leave by the inequality of Cauchy and Schwarz, so that rounding
 * makes none negative. Once heading or place is unknown by 0.2 rad or 0.2 m, without a fix, that grows no more: it would
 * outgrow a float.
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
