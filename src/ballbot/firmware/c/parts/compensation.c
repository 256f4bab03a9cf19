/* Friction compensation: what is added to the feedback's torques [N m].
 *
 * For wheel i with encoder speed w_i [rad/s] and the feedback's own torque u_i,
 *
 *     full       b w + (c + s exp(-|w/v_s|^delta)) ramp(w)
 *     partial    the same, only while u_i w_i > 0: where friction works against the intended motion
 *
 * and the wheel torques that carry the rolling friction N C_rr v/|v| (partial: only while they do not oppose u). Below
 * the speed band the sign of a speed is a ramp, so that a wheel at rest is not compensated. Friction that differs with
 * direction adds (d + e E) |ramp|, and the load of a drive mu |u| ramp. By another friction law than this, a table over
 * the speed stands for c + s E.
 */
#include "parts/parts.h"

/* In place of a speed of zero [m/s], which has no direction. */
#define NO_SPEED 1e-30f

/* A wheel's friction, and the fraction of it that is compensated. */
struct friction {
    float torque;
    float fraction;
};

/* Fill the ball's angular velocity relative to the body (3) [rad/s], body frame. */
static void relative_rate(const struct ballbot_compensation_record *own, const struct ballbot_sample *now,
                          float relative[3])
{
    const float *rates = &now->state[5];
    const float ball[3] = { -rates[1] * own->inv_rb, rates[0] * own->inv_rb, 0.0f };
    struct ballbot_attitude a;
    float body[3];

    a = ballbot_attitude_of(now->state[2], now->state[3], now->a);
    ballbot_body_rates(&a, &rates[2], body);
    ballbot_rotate_back(&a, ball, relative);
    for (int i = 0; i < 3; ++i) {
        relative[i] -= body[i];
    }
}

/* Return N C_rr v/|v| [N] in the heading frame, v/|v| a ramp around zero. */
static struct ballbot_pair rolling_force(const struct ballbot_compensation_record *own,
                                         const struct ballbot_sample *now)
{
    const float v_x = now->state[5];
    const float v_y = now->state[6];
    const float speed = ballbot_square_root(v_x * v_x + v_y * v_y);
    const float share = ballbot_smaller(1.0f, speed * own->rolling_steepness);
    const float size = own->rolling * share / ballbot_larger(speed, NO_SPEED);
    const struct ballbot_pair v = ballbot_to_heading(now->a, v_x, v_y);
    const struct ballbot_pair force = { size * v.x, size * v.y };

    return force;
}

/* Return a wheel's part in carrying the rolling friction [N m]. */
static float rolling_torque(const struct ballbot_compensation_record *own, int32_t i, struct ballbot_pair force)
{
    return own->for_rolling[i][0] * force.x + own->for_rolling[i][1] * force.y;
}

/* Return a wheel's friction by the table [N m], at a speed of zero or more. */
static float tabulated(const struct ballbot_compensation_record *own, int32_t i, float speed)
{
    const int32_t last = BALLBOT_TABLE_SPEEDS - 1;
    int32_t place = 0;

    for (int32_t width = BALLBOT_TABLE_SPEEDS / 2; width > 0; width /= 2) {
        if (((place + width) < last) && (own->table_speeds[place + width] <= speed)) {
            place += width;
        }
    }
    const float first = own->table_speeds[place];
    const float share = ballbot_smaller((speed - first) / (own->table_speeds[place + 1] - first), 1.0f);
    const float size = own->table_sizes[i][place];

    return size + share * (own->table_sizes[i][place + 1] - size);
}

/* Return a wheel's friction where the feedback's torque is `torque`. */
static struct friction wheel_friction(const struct ballbot_compensation_record *own, int32_t i,
                                      const float relative[3], float torque)
{
    const float *axle = own->axles[i];
    const float speed = axle[0] * relative[0] + axle[1] * relative[1] + axle[2] * relative[2];
    const float ramp = ballbot_clipped(speed * own->steepness, 1.0f);
    const float decay = ballbot_exponential(-ballbot_power(ballbot_magnitude(speed) * own->inv_vs, own->delta));
    struct friction found;

    found.torque = own->viscous[i] * speed + (own->coulomb[i] + own->stribeck[i] * decay) * ramp;
    if (own->tabulated > 0.0f) {
        found.torque += tabulated(own, i, ballbot_magnitude(speed)) * ramp;
    }
    if (own->directed > 0.0f) {
        found.torque += (own->coulomb_asymmetry[i] + own->stribeck_asymmetry[i] * decay) * ballbot_magnitude(ramp);
        found.torque += own->load[i] * ballbot_magnitude(torque + found.torque) * ramp;
    }
    const bool works_against = torque * found.torque > 0.0f;

    found.fraction = own->full + (works_against ? own->partial : 0.0f);
    return found;
}

void ballbot_compensate(const struct ballbot_law *law, struct ballbot_memory *memory,
                        const struct ballbot_sample *now, float torques[], int32_t n)
{
    const struct ballbot_compensation_record *own = &law->compensation;
    const struct ballbot_pair force = rolling_force(own, now);
    float relative[3];
    float agreement = 0.0f; /* u . rolling */

    relative_rate(own, now, relative);
    for (int32_t i = 0; i < n; ++i) {
        agreement += torques[i] * rolling_torque(own, i, force);
    }
    const float share = ballbot_share(memory->tuning.now[BALLBOT_TUNING_COMPENSATION]);
    const float rolls = own->full + ((agreement > 0.0f) ? own->partial : 0.0f);

    for (int32_t i = 0; i < n; ++i) {
        const struct friction found = wheel_friction(own, i, relative, torques[i]);
        const float more = share * (found.fraction * found.torque + rolls * rolling_torque(own, i, force));

        torques[i] += more;
        memory->history.friction_compensation[0][i] = more;
    }
}
