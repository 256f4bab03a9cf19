/* Generated from ballbot/estimation/slip.py by
 * `python -m tests.support.firmware_headers`; do not edit.
 *
 * Wheels that slip, and pushes: what the Kalman filter sees before it takes in what the wheels show.
 *
 * A wheel that slips on the ball by sigma seems to turn the ball by T_obw e_i sigma more than it turns. The ball rolls
 * without pivoting, so from Omega_z each wheel has one sigma that it would slip by; the wheel is taken to slip without
 * which the ball's speed is nearest to the one expected by lean and momentum. If the ball does pivot, its speed is
 * near that with all wheels. A push changes the speed and leaves Omega_z as it is.
 *
 * What one wheel slips by is taken off, Omega_z shows nothing then, and a push makes the momentum unknown by so much. Two
 * wheels that slip, or a ball that slides on the floor, look like one or a push. The firmware's C is written from this
 * file (tests.support.firmware_law).
 */
#include "estimation/slip.h"

#include "estimation/swing.h"

/* over their deviations, Omega_z from which the ball pivots or a wheel slips, and the ball's speed beyond that
 * expected from which it is a slip. With 8 and 6, wheels that cross their play are taken to slip, and the heading is
 * worse by a third on the square; with 16 and 8, a part of a slip passes */
#define PIVOTS 12.0f
/* the part of that speed below which it must be without the wheel, and a factor in favour of the wheel before */
#define NEARER 0.8f
/* over their deviations, Omega_z from which the ball pivots or a wheel slips, and the ball's speed beyond that
 * expected from which it is a slip. With 8 and 6, wheels that cross their play are taken to slip, and the heading is
 * worse by a third on the square; with 16 and 8, a part of a slip passes */
#define SLIPS 8.0f
/* the part of that speed below which it must be without the wheel, and a factor in favour of the wheel before */
#define SAME 0.5f
/* time over which the speed beyond that expected is averaged [s], and over its deviation that from which it is a
 * push. Without the mean, a robot chatters through its play after a push until its wheels slip. Wheels with 1.6
 * degrees of play make it 8 by themselves on ordinary courses; with 6 such a robot chattered until its wheels
 * slipped */
#define PUSH_TIME 0.02f
/* time over which the speed beyond that expected is averaged [s], and over its deviation that from which it is a
 * push. Without the mean, a robot chatters through its play after a push until its wheels slip. Wheels with 1.6
 * degrees of play make it 8 by themselves on ordinary courses; with 6 such a robot chattered until its wheels
 * slipped */
#define PUSHED 12.0f

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

/* Return the ball's turning relative to the body less what a wheel slips by [rad/s]; the memory has what was seen.
 *
 * turned is that by all n wheels, pivoted the mean square of its pivoting lately, x the filter's state before the
 * sample, and gyro (3) [rad/s] at its end.
 */
struct ballbot_angular_velocity ballbot_without_slip(const struct ballbot_kalman_record *record,
        struct ballbot_slip_memory *memory, float pivoted, const float x[STATES], const float gyro[3],
        struct ballbot_angular_velocity turned, int32_t n)
{
    const float w_x = gyro[0] - x[B_X];
    const float w_y = gyro[1] - x[B_X + 1];
    const float w_z = gyro[2] - x[B_X + 2];
    const struct ballbot_angular_velocity ball = levelled(x[G_X], x[G_X + 1], turned.x + w_x, turned.y + w_y,
        turned.z + w_z);
    const float forward = record->radius * ball.y - (x[S_X] - ballbot_lever_speed(record->lever, 0, w_x, w_y, w_z));
    const float left = -record->radius * ball.x - (x[S_X + 1] - ballbot_lever_speed(record->lever, 1, w_x, w_y, w_z));
    const float deviation = ballbot_square_root(record->variances[0]);
    const float of_pivoting = ballbot_square_root(record->variances[PIVOTING_SEEN]
        + record->pivoting_variance * pivoted);
    const bool pivots = ballbot_magnitude(ball.z) > PIVOTS * of_pivoting;
    const int32_t before = memory->wheel;
    float least = NEARER * size(forward, left);
    float slip = 0.0f;
    float first = forward;
    float second = left;

    memory->wheel = 0;
    const int32_t candidates = (pivots && size(forward, left) > SLIPS * deviation) ? n : 0;

    for (int32_t i = 0; i < candidates; ++i) {
        const struct ballbot_angular_velocity by = levelled(x[G_X], x[G_X + 1], record->ball_turn[0][i],
            record->ball_turn[1][i], record->ball_turn[2][i]);
        const float speed = ball.z / by.z;
        const float others_forward = forward - record->radius * speed * by.y;
        const float others_left = left + record->radius * speed * by.x;
        const float off = size(others_forward, others_left) * ((before == i + 1) ? SAME : 1.0f);

        if (off < least) {
            least = off;
            slip = speed;
            first = others_forward;
            second = others_left;
            memory->wheel = i + 1;
        }
    }
    const float share = ballbot_smaller(record->sample_time / PUSH_TIME, 1.0f);

    memory->faster[0] += share * (first - memory->faster[0]);
    memory->faster[1] += share * (second - memory->faster[1]);
    const float push = size(memory->faster[0], memory->faster[1]);
    const bool unclear = pivots && memory->wheel == 0; /* which wheel slips */

    memory->push = (push < PUSHED * deviation || unclear) ? 0.0f : push;
    if (memory->wheel == 0) {
        return turned;
    }
    const int32_t wheel = memory->wheel - 1;

    return (struct ballbot_angular_velocity){ turned.x - slip * record->ball_turn[0][wheel],
        turned.y - slip * record->ball_turn[1][wheel], turned.z - slip * record->ball_turn[2][wheel] };
}
