/* Generated from ballbot/estimation/slip.py by
 * `python -m tests.support.firmware_headers`; do not edit.
 *
 * Wheels that slip, and pushes: what the Kalman filter sees before it takes in what the wheels show.
 *
 * A wheel that slips on the ball seems to turn it about the vertical, about which the ball hardly pivots, and to move it
 * faster than lean and momentum let expect. From then on the wheels are left out, until the ball has not pivoted for a
 * while: which of them slip changes from sample to sample, two often slip together, and the ball pivots under them. The
 * momentum stays known from the lean but for what a push gave it just before or meanwhile, so it becomes unknown by that
 * much; the filter knows position and momentum together, and once the wheels roll again they correct both. A push changes
 * the speed and leaves Omega_z as it is: the wheels are then followed at once.
 *
 * Two wheels that slip such that Omega_z stays zero look like a push, and a ball that slides on the floor is not seen. The
 * firmware's C is written from this file (tests.support.firmware_law).
 */
#include "estimation/slip.h"

#include "estimation/swing.h"

/* over their deviations, Omega_z and the ball's speed beyond that expected from which wheels slip. Play of 2 degrees
 * makes both 12 by itself at times, on ordinary courses; with more of either a part of a slip passes */
#define SLIPS 14.0f
/* over their deviations, Omega_z and the ball's speed beyond that expected from which wheels slip. Play of 2 degrees
 * makes both 12 by itself at times, on ordinary courses; with more of either a part of a slip passes */
#define PIVOTS 14.0f
/* time without slip after which the wheels count again, and the longest for which they are left out [s]: after
 * pushes they slip for up to half a second, by turns. With 25 ms a part of a slip passes; 100 ms miss too much of a
 * push */
#define LONGEST 1.0f
/* time over which the speed beyond that expected is averaged [s], and over its deviation that from which it is a
 * push. Without the mean, a robot chatters through its play after a push until its wheels slip. Wheels with 1.6
 * degrees of play make it 8 by themselves on ordinary courses; with 6 such a robot chattered until its wheels
 * slipped */
#define PUSHED 12.0f
/* time without slip after which the wheels count again, and the longest for which they are left out [s]: after
 * pushes they slip for up to half a second, by turns. With 25 ms a part of a slip passes; 100 ms miss too much of a
 * push */
#define STEADY 0.04f
/* by which pushes change the momentum while the wheels are left out [m/s/sqrt(s)] */
#define UNSEEN_PUSH 0.4f
/* time over which the speed beyond that expected is averaged [s], and over its deviation that from which it is a
 * push. Without the mean, a robot chatters through its play after a push until its wheels slip. Wheels with 1.6
 * degrees of play make it 8 by themselves on ordinary courses; with 6 such a robot chattered until its wheels
 * slipped */
#define PUSH_TIME 0.02f

/* Return M(g) of a vector, level in the heading frame. */
static struct ballbot_angular_velocity levelled(float g_x, float g_y, float x, float y, float z)
{
    const float g_z = ballbot_root_of(1.0f - g_x * g_x - g_y * g_y);
    const float share = (g_x * x + g_y * y) / (1.0f + g_z) + z;

    return (struct ballbot_angular_velocity){ x - g_x * share, y - g_y * share, g_x * x + g_y * y + g_z * z };
}

/* Return a speed from its components [m/s]. */
static float size(float x, float y)
{
    return ballbot_square_root(x * x + y * y);
}

/* Return the ball's turning relative to the body [rad/s], NaN while wheels slip; the memory has what was seen.
 *
 * turned is that by all wheels, pivoted the mean square of its pivoting lately, x the filter's state before the
 * sample, and gyro (3) [rad/s] at its end.
 */
struct ballbot_angular_velocity ballbot_without_slip(const struct ballbot_kalman_record *record,
        struct ballbot_slip_memory *memory, float pivoted, const float x[STATES], const float gyro[3],
        struct ballbot_angular_velocity turned)
{
    const float h = record->sample_time;
    const float deviation = ballbot_square_root(record->variances[0]);
    const float w_x = gyro[0] - x[B_X];
    const float w_y = gyro[1] - x[B_X + 1];
    const float w_z = gyro[2] - x[B_X + 2];
    const struct ballbot_angular_velocity ball = levelled(x[G_X], x[G_X + 1], turned.x + w_x, turned.y + w_y,
        turned.z + w_z);
    const float forward = record->radius * ball.y - (x[S_X] - ballbot_lever_speed(record->lever, 0, w_x, w_y, w_z));
    const float left = -record->radius * ball.x - (x[S_X + 1] - ballbot_lever_speed(record->lever, 1, w_x, w_y, w_z));
    const float of_pivoting = ballbot_square_root(record->variances[PIVOTING_SEEN]
        + record->pivoting_variance * pivoted);

    memory->unknown = 0.0f;
    const bool slips = memory->lasting > 0.0f || size(forward, left) > SLIPS * deviation;

    if (slips && ballbot_magnitude(ball.z) > PIVOTS * of_pivoting && memory->lasting < LONGEST - 0.5f * h) {
        if (memory->lasting == 0.0f) {
            /* what a push gave that was not one yet, and what of the slip was taken in */
            const float hidden = (PUSHED + SLIPS) * deviation;

            memory->unknown = hidden * hidden;
        }
        memory->left_out = STEADY;
    }
    if (memory->left_out > 0.5f * h) {
        memory->left_out -= h;
        memory->lasting += h;
        memory->unknown += UNSEEN_PUSH * UNSEEN_PUSH * h;
        memory->faster[0] = 0.0f;
        memory->faster[1] = 0.0f;
        const float nothing = ballbot_not_a_number();

        return (struct ballbot_angular_velocity){ nothing, nothing, nothing };
    }
    memory->lasting = 0.0f;
    const float share = ballbot_smaller(h / PUSH_TIME, 1.0f);

    memory->faster[0] += share * (forward - memory->faster[0]);
    memory->faster[1] += share * (left - memory->faster[1]);
    const float push = size(memory->faster[0], memory->faster[1]);

    if (push > PUSHED * deviation) {
        memory->unknown = push * push;
    }
    return turned;
}
