/* The robot's attitude, and vectors between its frames.
 *
 *     R = Rx(theta) Ry(phi) Rz(psi)      takes the body's frame to the world's
 *     w = B(theta, phi, psi) (theta_dot, phi_dot, psi_dot)      angular velocity, body frame
 *
 * The heading frame is the world's frame turned by psi about the vertical. Angles in rad, rates in rad/s.
 */
#ifndef BALLBOT_ATTITUDE_H
#define BALLBOT_ATTITUDE_H

struct ballbot_attitude {
    float R[3][3];
    float sin_phi;
    float cos_phi;
    float sin_psi;
    float cos_psi;
};

/* A vector over the floor. */
struct ballbot_pair {
    float x;
    float y;
};

/* Return the attitude for three angles. */
struct ballbot_attitude ballbot_attitude_of(float theta, float phi, float psi);

/* Return the attitude for theta, phi, and the psi of another attitude with a small turn [rad] added.
 *
 * The sum of a large psi and a small turn would be rounded; their sines and cosines are not.
 */
struct ballbot_attitude ballbot_attitude_after(const struct ballbot_attitude *a, float theta, float phi, float turn);

/* Fill a body's angular velocity w (3), body frame, from the rates of theta, phi and psi. */
void ballbot_body_rates(const struct ballbot_attitude *a, const float angle_rates[3], float w[3]);

/* Fill R^T v: a vector of the world in the body's frame. */
void ballbot_rotate_back(const struct ballbot_attitude *a, const float v[3], float turned[3]);

/* Return a vector of the world in the heading frame. */
struct ballbot_pair ballbot_to_heading(const struct ballbot_attitude *a, float x, float y);

/* Return a vector of the heading frame in the world. */
struct ballbot_pair ballbot_from_heading(const struct ballbot_attitude *a, float x, float y);

#endif
