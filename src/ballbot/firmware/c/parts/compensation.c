/* Generated from ballbot/control/parts/compensation.py by
 * `python -m tests.support.firmware_headers`; do not edit.
 *
 * Friction compensation, compiled: what is added to the feedback's torques.
 *
 * For wheel i with encoder speed w_i and the feedback's own torque u_i,
 *
 *     full       b w + (c + s exp(-|w/v_s|^delta)) ramp(w)
 *     partial    the same, only while u_i w_i > 0: where friction works against the intended motion (thesis 5.2)
 *
 * and the wheel torques that carry the rolling friction N C_rr v/|v| (partial: only while they do not oppose u).
 *
 * Under a registered friction law a table (ballbot.control.friction_table) stands for c + s exp(..).
 *
 * Friction that depends on direction is compensated for the direction of the speed. The load of a drive is estimated by
 * the torque about to be commanded, the feedback's plus the compensation without the load term: with full compensation
 * slightly less than the final command, and never more.
 *
 * Within the speed band the sign of the speed is a ramp, so that a wheel at rest is not compensated: it sticks until the
 * feedback alone overcomes its breakaway torque.
 */
#include "parts/steps.h"

/* The ball's angular velocity relative to the body, body frame. */
struct relative {
    float x; /* [rad/s] */
    float y;
    float z;
};

/* Return R^T Omega - w, with the ball's Omega = (-v_y, v_x, 0)/r_b and the body's w. */
static struct relative relative_rate(const struct ballbot_compensation_record *own, const struct ballbot_sample *now)
{
    const struct ballbot_robot_state state = now->state;
    float sin_theta;
    float cos_theta;

    ballbot_sine_cosine(state.theta, &sin_theta, &cos_theta);
    float sin_phi;
    float cos_phi;

    ballbot_sine_cosine(state.phi, &sin_phi, &cos_phi);
    /* after the turns by -theta and -phi, before that by -psi */
    const float Omega_x = -state.y_dot * own->inv_rb;
    const float Omega_y = state.x_dot * own->inv_rb;
    const float x = cos_phi * (Omega_x - state.theta_dot) + sin_phi * sin_theta * Omega_y;
    const float y = cos_theta * Omega_y - state.phi_dot;
    const float z = sin_phi * (Omega_x - state.theta_dot) - cos_phi * sin_theta * Omega_y - state.psi_dot;
    const struct ballbot_pair horizontal = ballbot_turned(now->a, x, y);

    return (struct relative){ horizontal.x, horizontal.y, z };
}

/* Return N C_rr v/|v| in the heading frame, v/|v| a ramp around zero. */
static struct ballbot_pair rolling_force(const struct ballbot_compensation_record *own,
        const struct ballbot_sample *now)
{
    const float v_x = now->state.x_dot;
    const float v_y = now->state.y_dot;
    const float speed = ballbot_square_root(v_x * v_x + v_y * v_y);
    const float size = own->rolling * ballbot_smaller(1.0f, speed * own->rolling_steepness) / ballbot_larger(speed,
        1e-30f);
    const struct ballbot_pair v = ballbot_turned(now->a, v_x, v_y);

    return (struct ballbot_pair){ size * v.x, size * v.y };
}

/* Return a wheel's part in carrying the rolling friction. */
static float rolling_torque(const struct ballbot_compensation_record *own, int32_t i, struct ballbot_pair force)
{
    return own->for_rolling[i][0] * force.x + own->for_rolling[i][1] * force.y;
}

/* Return a wheel's friction by the table, at a speed of zero or more. */
static float tabulated(const struct ballbot_compensation_record *own, int32_t i, float speed)
{
    int32_t index = 0;
    int32_t width = BALLBOT_TABLE_SPEEDS / 2;

    while (width > 0) {
        if (index + width < BALLBOT_TABLE_SPEEDS - 1 && own->table_speeds[index + width] <= speed) {
            index += width;
        }
        width /= 2;
    }
    const float first = own->table_speeds[index];
    const float second = own->table_speeds[index + 1];
    const float share = ballbot_smaller((speed - first) / (second - first), 1.0f);

    return own->table_sizes[i][index] + share * (own->table_sizes[i][index + 1] - own->table_sizes[i][index]);
}

/* Return a wheel's friction where the feedback's torque is torque. */
static float wheel_friction(const struct ballbot_compensation_record *own, int32_t i, struct relative relative,
        float torque)
{
    const float *axle = own->axles[i];
    const float speed = axle[0] * relative.x + axle[1] * relative.y + axle[2] * relative.z;
    const float ramp = ballbot_clipped(speed * own->steepness, 1.0f);
    const float E = ballbot_exponential(-ballbot_power(ballbot_magnitude(speed) * own->inv_vs, own->delta));
    float friction = own->viscous[i] * speed + (own->coulomb[i] + own->stribeck[i] * E) * ramp;

    if (own->tabulated > 0.0f) {
        friction += tabulated(own, i, ballbot_magnitude(speed)) * ramp;
    }
    if (own->directed > 0.0f) {
        /* the difference to the mean of both directions: added forward, subtracted backward */
        friction += (own->coulomb_asymmetry[i] + own->stribeck_asymmetry[i] * E) * ballbot_magnitude(ramp);
        friction += own->load[i] * ballbot_magnitude(torque + friction) * ramp;
    }
    return friction;
}

/* Add the friction's compensation to the feedback's torques. */
void ballbot_compensate(const struct ballbot_law *law, struct ballbot_memory *memory,
        const struct ballbot_sample *now, float torques[], int32_t n)
{
    const struct ballbot_compensation_record *own = &law->compensation;
    float (*added)[BALLBOT_MAX_WHEELS] = memory->history.friction_compensation;
    const struct relative relative = relative_rate(own, now);
    const struct ballbot_pair force = rolling_force(own, now);
    float agreement = 0.0f; /* u . rolling */

    for (int32_t i = 0; i < n; ++i) {
        agreement += torques[i] * rolling_torque(own, i, force);
    }
    const float rolls = own->full + ((agreement > 0.0f) ? own->partial : 0.0f);
    const float share = ballbot_compensated_share(memory);

    for (int32_t i = 0; i < n; ++i) {
        const float friction = wheel_friction(own, i, relative, torques[i]);
        const bool works_against = torques[i] * friction > 0.0f;
        const float fraction = own->full + (works_against ? own->partial : 0.0f);
        const float more = share * (fraction * friction + rolls * rolling_torque(own, i, force));

        torques[i] += more;
        added[0][i] = more;
    }
}
