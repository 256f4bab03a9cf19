/* Feed-forward: the lean and the torques that a shaped or planned motion s(t) needs, from the exact model without friction.
 *
 *     (theta, phi) = lean s''      position = s - offset s''      u = by_second s'' + by_fourth s'''' + by_turning psi''
 *
 * s is the motion of the flat output, the point that feels no torque. Quantities are those of the heading frame. Of a plan,
 * which has leans l and rates itself,
 *
 *     s = position + offset s''      s'' = pull l      s''' = pull l'      s'''' = pull l''
 *
 * with l'' from the change of the rates since the last row. A row that is there again, as when the frame with the next one is
 * lost, is followed along its Taylor series, for LAPSE at most.
 */
#include "parts/parts.h"

/* For which a row of a plan is followed without the next one [s]. */
#define LAPSE 0.05f

static struct ballbot_pair times(const float M[2][2], struct ballbot_pair v)
{
    const struct ballbot_pair product = { M[0][0] * v.x + M[0][1] * v.y, M[1][0] * v.x + M[1][1] * v.y };

    return product;
}

bool ballbot_follows_plan(const struct ballbot_law *law, struct ballbot_memory *memory, const float reference[10])
{
    const float rate = law->feed_forward.rate;
    const float most = LAPSE * rate + 0.5f;
    struct ballbot_feed_forward_state *state = &memory->feed_forward;
    bool moves = false;
    bool again = state->started != 0;

    for (int i = 0; i < 10; ++i) {
        const bool is_pose = i == 0 || i == 1 || i == 4;

        moves = moves || (!is_pose && ballbot_magnitude(reference[i]) > 0.0f);
        again = again && !(ballbot_magnitude(reference[i] - state->row[i]) > 0.0f);
    }
    if (law->feed_forward.on == 0 || !moves) {
        state->started = 0;
        return false;
    }
    if (again) {
        state->age += ((float)state->age < most) ? 1 : 0;
    } else {
        const bool goes_on = state->started != 0 && (float)state->age < most;
        const float per_second = goes_on ? rate / (float)(state->age + 1) : 0.0f;

        for (int i = 0; i < 3; ++i) {
            state->changes[i] = per_second * (reference[7 + i] - state->row[7 + i]);
        }
        for (int i = 0; i < 10; ++i) {
            state->row[i] = reference[i];
        }
        state->started = 1;
        state->age = 0;
    }
    return (float)state->age < most;
}

/* Return a motion after a delay, by its Taylor series. */
static struct ballbot_smooth advanced(float delay, struct ballbot_smooth s)
{
    const float rest = s.second + delay * (s.third + 0.25f * delay * s.fourth) / 3.0f;
    const struct ballbot_smooth later = {
        s.value + delay * (s.rate + 0.5f * delay * rest),
        s.rate + delay * (s.second + 0.5f * delay * (s.third + delay * s.fourth / 3.0f)),
        s.second + delay * (s.third + 0.5f * delay * s.fourth),
        s.third + delay * s.fourth,
        s.fourth,
    };

    return later;
}

/* Return M times a vector of the world, in the world: M acts in the heading frame. */
static struct ballbot_pair times_in_heading(const float M[2][2], struct ballbot_heading a, float x, float y)
{
    const struct ballbot_pair product = times(M, ballbot_to_heading(a, x, y));

    return ballbot_from_heading(a, product.x, product.y);
}

void ballbot_feed_forward_plan(const struct ballbot_law *law, const struct ballbot_memory *memory, struct ballbot_sample *now)
{
    const struct ballbot_feed_forward_record *own = &law->feed_forward;
    const struct ballbot_feed_forward_state *state = &memory->feed_forward;
    const float *r = now->reference;
    const float *changes = state->changes;
    const float ahead_by = own->delay + (float)state->age / own->rate;
    const struct ballbot_pair second = times_in_heading(own->pull, now->a, r[2], r[3]);
    const struct ballbot_pair third = times_in_heading(own->pull, now->a, r[7], r[8]);
    const struct ballbot_pair fourth = times_in_heading(own->pull, now->a, changes[0], changes[1]);
    const struct ballbot_pair ahead = times_in_heading(own->offset, now->a, second.x, second.y);
    const struct ballbot_pair ahead_rate = times_in_heading(own->offset, now->a, third.x, third.y);
    const struct ballbot_smooth x = { now->x.value + ahead.x, r[5] + ahead_rate.x, second.x, third.x, fourth.x };
    const struct ballbot_smooth y = { now->y.value + ahead.y, r[6] + ahead_rate.y, second.y, third.y, fourth.y };
    const struct ballbot_smooth psi = { now->psi.value, r[9], changes[2], 0.0f, 0.0f };

    now->x = advanced(ahead_by, x);
    now->y = advanced(ahead_by, y);
    now->psi = advanced(ahead_by, psi);
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
