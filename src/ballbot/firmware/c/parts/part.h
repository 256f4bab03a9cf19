/* Generated from ballbot/control/parts/part.py by
 * `python -m tests.support.firmware_headers`; do not edit.
 *
 * What the parts of the control law share.
 */
#ifndef BALLBOT_PART_H
#define BALLBOT_PART_H

#include <stdbool.h>

#include "ballbot_math.h"
#include "ballbot_types.h"
#include "compensated_sum.h"

/* The world's frame turned by psi about the vertical. */
struct ballbot_heading_frame {
    float sin_psi;
    float cos_psi;
};

/* Place and heading. */
struct ballbot_pose {
    float x; /* [m] */
    float y; /* [m] */
    float psi; /* [rad] */
};

/* A state, or an error of one. */
struct ballbot_robot_state {
    float x; /* [m] */
    float y; /* [m] */
    float theta; /* [rad] */
    float phi; /* [rad] */
    float psi; /* [rad] */
    float x_dot; /* [m/s] */
    float y_dot; /* [m/s] */
    float theta_dot; /* [rad/s] */
    float phi_dot; /* [rad/s] */
    float psi_dot; /* [rad/s] */
};

/* A vector over the floor. */
struct ballbot_pair {
    float x;
    float y;
};

/* The reference of x, y or psi with its derivatives. */
struct ballbot_smooth_reference {
    float value; /* [m] or [rad] */
    float rate;
    float second;
    float third;
    float fourth;
};

/* The motion that is followed, relative to the measured pose. */
struct ballbot_followed_motion {
    struct ballbot_smooth_reference x;
    struct ballbot_smooth_reference y;
    struct ballbot_smooth_reference psi;
};

/* The values from which torques are computed; places are relative to the measured pose.
 *
 * A difference of two places is then rounded in proportion to itself, and not to their distance from the origin.
 */
struct ballbot_sample {
    struct ballbot_heading_frame a; /* of the state */
    struct ballbot_robot_state state; /* that is fed back */
    struct ballbot_followed_motion to;
    struct ballbot_robot_state e; /* error, heading frame */
};

/* Return the heading frame of psi. */
static inline struct ballbot_heading_frame ballbot_heading_frame(float psi)
{
    float sin_psi;
    float cos_psi;

    ballbot_sine_cosine(psi, &sin_psi, &cos_psi);

    return (struct ballbot_heading_frame){ sin_psi, cos_psi };
}

/* Return a vector of the world in the heading frame. */
static inline struct ballbot_pair ballbot_turned(struct ballbot_heading_frame a, float v_x, float v_y)
{
    return (struct ballbot_pair){ a.cos_psi * v_x + a.sin_psi * v_y, a.cos_psi * v_y - a.sin_psi * v_x };
}

/* Return a value within -limit .. limit; NaN stays NaN. */
static inline float ballbot_clipped(float value, float limit)
{
    return (value > limit) ? limit : ((value < -limit) ? -limit : value);
}

/* Return a state or an error of the world in the heading frame. */
static inline struct ballbot_robot_state ballbot_turned_state(struct ballbot_heading_frame a,
        const struct ballbot_robot_state *v)
{
    const struct ballbot_pair place = ballbot_turned(a, v->x, v->y);
    const struct ballbot_pair lean = ballbot_turned(a, v->theta, v->phi);
    const struct ballbot_pair speed = ballbot_turned(a, v->x_dot, v->y_dot);
    const struct ballbot_pair lean_rate = ballbot_turned(a, v->theta_dot, v->phi_dot);

    return (struct ballbot_robot_state){ place.x, place.y, lean.x, lean.y, v->psi, speed.x, speed.y, lean_rate.x,
        lean_rate.y, v->psi_dot };
}

/* Return the heading frame after a small turn; the sum of a large psi and a small turn would be rounded. */
static inline struct ballbot_heading_frame ballbot_heading_frame_after(struct ballbot_heading_frame a, float turn)
{
    const struct ballbot_heading_frame small = ballbot_heading_frame(turn);

    return (struct ballbot_heading_frame){ small.cos_psi * a.sin_psi + small.sin_psi * a.cos_psi,
        small.cos_psi * a.cos_psi - small.sin_psi * a.sin_psi };
}

/* Return the product of two rows of two and a vector. */
static inline struct ballbot_pair ballbot_pair_times(const float M[2][2], struct ballbot_pair v)
{
    return (struct ballbot_pair){ M[0][0] * v.x + M[0][1] * v.y, M[1][0] * v.x + M[1][1] * v.y };
}

/* Return a vector of the heading frame in the world. */
static inline struct ballbot_pair ballbot_turned_back(struct ballbot_heading_frame a, float v_x, float v_y)
{
    return (struct ballbot_pair){ a.cos_psi * v_x - a.sin_psi * v_y, a.sin_psi * v_x + a.cos_psi * v_y };
}

#endif
