/* Feed-forward: the lean and the torques that a shaped motion s(t) needs, from the exact model without friction.
 *
 *     (theta, phi) = lean s''      position = s - offset s''      u = by_second s'' + by_fourth s'''' + by_turning psi''
 *
 * s is the motion of the flat output, the point that feels no torque. Quantities are those of the heading frame.
 */
#include "parts/parts.h"

static struct ballbot_pair times(const float M[2][2], struct ballbot_pair v)
{
    const struct ballbot_pair product = { M[0][0] * v.x + M[0][1] * v.y, M[1][0] * v.x + M[1][1] * v.y };

    return product;
}

void ballbot_feed_forward_error(const struct ballbot_law *law, struct ballbot_sample *now)
{
    const struct ballbot_feed_forward_record *own = &law->feed_forward;

    if (own->on == 0) {
        return;
    }
    const struct ballbot_pair second = ballbot_to_heading(now->a, now->x.second, now->y.second);
    const struct ballbot_pair third = ballbot_to_heading(now->a, now->x.third, now->y.third);
    const struct ballbot_pair lean = times(own->lean, second);
    const struct ballbot_pair lean_rate = times(own->lean, third);
    const struct ballbot_pair ahead = times(own->offset, second);
    const struct ballbot_pair ahead_rate = times(own->offset, third);
    float *e = now->e;

    e[0] -= ahead.x;
    e[1] -= ahead.y;
    e[2] += lean.x;
    e[3] += lean.y;
    e[5] -= ahead_rate.x;
    e[6] -= ahead_rate.y;
    e[7] += lean_rate.x;
    e[8] += lean_rate.y;
}

void ballbot_feed_forward_torque(const struct ballbot_law *law, const struct ballbot_sample *now, float torques[],
                                 int32_t n)
{
    const struct ballbot_feed_forward_record *own = &law->feed_forward;

    if (own->on == 0) {
        return;
    }
    const struct ballbot_pair second = ballbot_to_heading(now->a, now->x.second, now->y.second);
    const struct ballbot_pair fourth = ballbot_to_heading(now->a, now->x.fourth, now->y.fourth);

    for (int32_t i = 0; i < n; ++i) {
        torques[i] += own->by_second[i][0] * second.x + own->by_second[i][1] * second.y +
                      own->by_fourth[i][0] * fourth.x + own->by_fourth[i][1] * fourth.y +
                      own->by_turning[i] * now->psi.second;
    }
}
