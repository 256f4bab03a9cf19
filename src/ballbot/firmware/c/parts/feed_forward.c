/* Generated from ballbot/control/parts/feed_forward.py by
 * `python -m tests.support.firmware_headers`; do not edit.
 *
 * Feed-forward: the lean and the torques that a planned motion needs, from the exact model.
 *
 * Linearised about upright and without friction, with p = (x, y), l = (theta, phi, psi) and torques u,
 *
 *     p'' = A_p l + B_p u        l'' = A_l l + B_l u
 *
 * the point s = p + C l with B_p + C B_l = 0 does not depend on the torques: s'' = (A_p + C A_l) l = G (theta, phi). (It
 * is a flat output: state and torques follow from it and its derivatives.) A motion s(t) of it therefore needs
 *
 *     (theta, phi) = G^-1 s''       p = s - C (theta, phi)       u = B^+ (r' - A r)
 *
 * with B^+ the pseudoinverse. At rest p = s. A rolling ball needs the lean kappa besides, which carries its friction
 * (ballbot.mechanics.model.contact_momentum). All quantities are in the heading frame; the feedback covers the small
 * additional torques of a robot that moves and turns at once, and a body's small coupling of yaw with lean.
 *
 * A planned reference (ballbot.workflows.plan) has leans and rates itself. Then s and its derivatives follow from them,
 *
 *     s = p + C l        s' = p' + C l'        s'' = G l        s''' = G l'        s'''' = G l''
 *
 * with l'' from the change of the rates since the last row. A row that is there again, as when the frame with the next
 * one is lost, is followed along its Taylor series; after 50 ms the plan counts as broken off, and the robot goes to rest
 * at the row's pose.
 */
#include "parts/steps.h"

/* for which a row of a plan is followed without the next one [s] */
#define LAPSE 0.05f
#define SLOW 0.046875f

/* Return whether a reference has leans or rates, for no longer than LAPSE, and remember it. */
bool ballbot_follows_plan(const struct ballbot_law *law, struct ballbot_memory *memory, const float reference[10])
{
    const struct ballbot_feed_forward_record *own = &law->feed_forward;
    struct ballbot_feed_forward_state *state = &memory->feed_forward;
    bool moves = reference[2] != 0.0f || reference[3] != 0.0f;

    for (int32_t i = 5; i < 10; ++i) {
        moves = moves || reference[i] != 0.0f;
    }
    if (own->on == 0 || !moves) {
        state->started = 0;
        return false;
    }
    bool again = state->started == 1;

    for (int32_t i = 0; i < 10; ++i) {
        again = again && reference[i] == state->row[i];
    }
    const float most = LAPSE * own->rate + 0.5f;

    if (again) {
        state->age += ((float)state->age < most) ? 1 : 0;
    } else {
        const bool goes_on = state->started == 1 && (float)state->age < most;
        const float per_second = goes_on ? own->rate / (float)(state->age + 1) : 0.0f;

        for (int32_t i = 0; i < 3; ++i) {
            state->changes[i] = per_second * (reference[7 + i] - state->row[7 + i]);
        }
        for (int32_t i = 0; i < 10; ++i) {
            state->row[i] = reference[i];
        }
        state->started = 1;
        state->age = 0;
    }
    return (float)state->age < most;
}

/* Return the lean theta, phi that carries the rolling friction at a velocity. */
static struct ballbot_pair rolling_lean(const struct ballbot_feed_forward_record *own, float v_x, float v_y)
{
    const float share = own->rolling / ballbot_larger(ballbot_square_root(v_x * v_x + v_y * v_y), SLOW);

    return (struct ballbot_pair){ -share * v_y, share * v_x };
}

/* Return the product of a matrix of the heading frame and a vector of the world, in the world. */
static struct ballbot_pair in_world(const float M[2][2], struct ballbot_heading_frame a, float x, float y)
{
    const struct ballbot_pair product = ballbot_pair_times(M, ballbot_turned(a, x, y));

    return ballbot_turned_back(a, product.x, product.y);
}

/* Return a motion after a delay, by its Taylor series. */
static struct ballbot_smooth_reference after(float delay, struct ballbot_smooth_reference s)
{
    const float rest = s.second + delay * (s.third + 0.25f * delay * s.fourth) / 3.0f;

    return (struct ballbot_smooth_reference){ s.value + delay * (s.rate + 0.5f * delay * rest),
        s.rate + delay * (s.second + 0.5f * delay * (s.third + delay * s.fourth / 3.0f)),
        s.second + delay * (s.third + 0.5f * delay * s.fourth), s.third + delay * s.fourth, s.fourth };
}

/* Return a planned reference, of which asked is the pose relative to the measured one; after follows_plan. */
struct ballbot_followed_motion ballbot_planned(const struct ballbot_law *law, const struct ballbot_memory *memory,
        struct ballbot_heading_frame a, const float reference[10], struct ballbot_pose asked)
{
    const struct ballbot_feed_forward_record *own = &law->feed_forward;
    const float *changes = memory->feed_forward.changes;
    const struct ballbot_pair rolling = rolling_lean(own, reference[5], reference[6]); /* which a plan's leans have */
    const struct ballbot_pair second = in_world(own->pull, a, reference[2] - rolling.x, reference[3] - rolling.y);
    const struct ballbot_pair third = in_world(own->pull, a, reference[7], reference[8]);
    const struct ballbot_pair fourth = in_world(own->pull, a, changes[0], changes[1]);
    const struct ballbot_pair ahead = in_world(own->offset, a, second.x, second.y);
    const struct ballbot_pair ahead_rate = in_world(own->offset, a, third.x, third.y);
    const struct ballbot_smooth_reference x = { asked.x + ahead.x, reference[5] + ahead_rate.x, second.x, third.x,
        fourth.x };
    const struct ballbot_smooth_reference y = { asked.y + ahead.y, reference[6] + ahead_rate.y, second.y, third.y,
        fourth.y };
    const struct ballbot_smooth_reference psi = { asked.psi, reference[9], changes[2], 0.0f, 0.0f };
    const float ahead_by = own->delay + (float)memory->feed_forward.age / own->rate;

    return (struct ballbot_followed_motion){ after(ahead_by, x), after(ahead_by, y), after(ahead_by, psi) };
}

/* Return the error with respect to the lean and the position that the motion needs; see the module's docstring. */
struct ballbot_robot_state ballbot_lean_error(const struct ballbot_law *law, struct ballbot_heading_frame a,
        const struct ballbot_followed_motion *to, const struct ballbot_robot_state *e)
{
    const struct ballbot_feed_forward_record *own = &law->feed_forward;

    if (own->on == 0) {
        return *e;
    }
    const struct ballbot_pair second = ballbot_turned(a, to->x.second, to->y.second);
    const struct ballbot_pair third = ballbot_turned(a, to->x.third, to->y.third);
    const struct ballbot_pair lean = ballbot_pair_times(own->lean, second);
    const struct ballbot_pair lean_rate = ballbot_pair_times(own->lean, third);
    const struct ballbot_pair ahead = ballbot_pair_times(own->offset, second);
    const struct ballbot_pair ahead_rate = ballbot_pair_times(own->offset, third);
    const struct ballbot_pair v = ballbot_turned(a, to->x.rate, to->y.rate);
    const struct ballbot_pair rolling = rolling_lean(own, v.x - ahead_rate.x, v.y - ahead_rate.y);

    return (struct ballbot_robot_state){ e->x - ahead.x, e->y - ahead.y, e->theta + lean.x + rolling.x,
        e->phi + lean.y + rolling.y, e->psi, e->x_dot - ahead_rate.x, e->y_dot - ahead_rate.y,
        e->theta_dot + lean_rate.x, e->phi_dot + lean_rate.y, e->psi_dot };
}

/* Add the torques for the second and fourth derivative of s, heading frame, and the second of psi. */
void ballbot_add_feed_forward(const struct ballbot_law *law, const struct ballbot_sample *now, float torques[],
        int32_t n)
{
    const struct ballbot_feed_forward_record *own = &law->feed_forward;

    if (own->on == 0) {
        return;
    }
    const struct ballbot_pair second = ballbot_turned(now->a, now->to.x.second, now->to.y.second);
    const struct ballbot_pair fourth = ballbot_turned(now->a, now->to.x.fourth, now->to.y.fourth);

    for (int32_t i = 0; i < n; ++i) {
        const float *by_second = own->by_second[i];
        const float *by_fourth = own->by_fourth[i];
        const float motion = by_second[0] * second.x + by_second[1] * second.y + by_fourth[0] * fourth.x;

        torques[i] += motion + by_fourth[1] * fourth.y + own->by_turning[i] * now->to.psi.second;
    }
}
