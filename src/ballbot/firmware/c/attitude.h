/* The robot's heading and attitude, and vectors between its frames.
 *
 *     R = Rx(theta) Ry(phi) Rz(psi)      takes the body's frame to the world's
 *     w = B(theta, phi, psi) (theta_dot, phi_dot, psi_dot)      angular velocity, body frame
 *
 * The heading frame is the world's frame turned by psi about the vertical. Angles in rad, rates in rad/s.
 */
#ifndef BALLBOT_ATTITUDE_H
#define BALLBOT_ATTITUDE_H

#include "ballbot_math.h"
#include "ballbot_types.h"

/* Sine and cosine of psi. */
struct ballbot_heading {
    float sine;
    float cosine;
};

struct ballbot_attitude {
    float R[3][3];
    float sin_phi;
    float cos_phi;
    struct ballbot_heading heading;
};

/* A vector over the floor. */
struct ballbot_pair {
    float x;
    float y;
};

/* Return the heading for psi. */
struct ballbot_heading ballbot_heading_of(float psi);

/* Return the next value of a heading without a jump of a turn [rad].
 *
 * A jump of more than 1.5 pi between two values within one turn, -pi to pi or 0 to 2 pi, is a wrap. Values beyond one
 * turn stay as they are. `memory` is all zeros before the first value.
 */
float ballbot_unwrapped(struct ballbot_heading_memory *memory, float angle);

/* Return the heading after a small turn [rad].
 *
 * The sum of a large psi and a small turn would be rounded; their sines and cosines are not.
 */
struct ballbot_heading ballbot_heading_after(struct ballbot_heading heading, float turn);

/* Return a vector of the world in the heading frame. */
static inline struct ballbot_pair ballbot_to_heading(struct ballbot_heading a, float x, float y)
{
    const struct ballbot_pair turned = { a.cosine * x + a.sine * y, a.cosine * y - a.sine * x };

    return turned;
}

/* Fill the pairs (x y), (theta phi) of a state (10) and their rates in the heading frame, psi and its rate as they are. */
void ballbot_state_to_heading(struct ballbot_heading a, const float state[10], float turned[10]);

/* Return a vector of the heading frame in the world. */
static inline struct ballbot_pair ballbot_from_heading(struct ballbot_heading a, float x, float y)
{
    const struct ballbot_pair turned = { a.cosine * x - a.sine * y, a.sine * x + a.cosine * y };

    return turned;
}

/* Return the attitude for two angles and a heading. */
struct ballbot_attitude ballbot_attitude_of(float theta, float phi, struct ballbot_heading heading);

/* Fill a body's angular velocity w (3), body frame, from the rates of theta, phi and psi. */
void ballbot_body_rates(const struct ballbot_attitude *a, const float angle_rates[3], float w[3]);

/* Fill R^T v: a vector of the world in the body's frame. */
void ballbot_rotate_back(const struct ballbot_attitude *a, const float v[3], float turned[3]);

#endif
