/* Generated from ballbot/control/parts/planner.py by
 * `python -m tests.support.firmware_headers`; do not edit.
 *
 * The planner: the motion of x and y is planned on line, within the limits of the motors, from where the plan is.
 *
 * s is the flat output (ballbot.control.parts.feed_forward). Along each axis the motors give
 *
 *     a = s'' - s''''/p^2        W = s - s''/p^2        W'' = a        s'' = (b + f)/2        s''' = p (b - f)/2
 *     f' = -p (f - a)            b' = p (b - a)         the ball's place  y = W + (1/p^2 - c) s''
 *
 * with c the offset of s from the ball. f runs forward in time, b backward from zero at the horizon's end: where b is now
 * is one linear condition on a, which takes the place of a long horizon. a is linear between KNOTS knots, which stay
 * where they are in time; every few samples the plan is made again from where it has come to:
 *
 *     least  h sum (s_k - r_k)^2 + q sum (a_k+1 - a_k)^2      r_k: the reference, extrapolated
 *     the largest wheel's torque, less friction and what lasting disturbances take, within its limit
 *     |a_k+1 - a_k| <= a reversal's rate        |y_k'| <= speed limit        (y_k - r) d <= 0
 *
 * The last is a wall at the place where a motion in the direction d is to end, so that the ball does not overshoot it.
 * (What the last plan needs beyond the wall, it is given half of.) A reference that moves faster than the prompt speed may
 * stop at any time: it is planned to end where it is now. A slower one is followed without delay.
 *
 * The solver is the alternating direction method of multipliers: a fixed number of steps from the last solution, a few a
 * sample, each a product with a constant matrix. What is stepped are t = z + u, with z what the limits allow and u the
 * scaled multipliers. A multiplier's force is bounded (exact penalties), so that limits that cannot be kept, as after a
 * push, are kept as far as possible, the torques before the wall. The torques' limit is a disc, as large
 * as the wheels allow in the direction of the last plan: at a corner of the wheels' hexagon a motion would go aside.
 */
#include "parts/steps.h"

/* knots of the horizon, and plans from one to the next */
#define KNOTS 24
#define ROUNDING 0.001f
/* fraction of the largest acceleration up to which a reference's bend counts */
#define BEND 0.34375f
/* acceleration up to which disturbances are looked at [m/s^2] */
#define QUIET 0.125f
/* plan at rest: way [m], speed [m/s], acceleration [m/s^2] */
#define STILL 2e-06f
#define STILL_SPEED 1e-05f
/* plan at rest: way [m], speed [m/s], acceleration [m/s^2] */
#define STILL_FORCE 1e-04f
/* the rows' weights and largest forces: torque, change, speed, wall */
#define WALL 3
/* intervals of the record: of each phase, and these */
#define KNOT 4
/* way per speed in which the motion ends beyond the horizon [s] */
#define TAIL 0.625f
/* unknowns of an axis: the last knot is at rest */
#define FREE 23
/* wheel speed over which friction turns from one sign to the other [rad/s] */
#define CREEPING 0.5f
/* lag of disturbances, time to come back from catching itself [s], and the least fraction of the torque meanwhile */
#define LEAST_LEFT 0.25f
#define LAG 0.046875f
#define FAST 1.5f
/* time in which a reference that was fast counts as slow again [s], and the ratio by which it first does not: until
 * then r' of one that has stopped is gone */
#define HELD 1.25f
/* time in which a reference that was fast counts as slow again [s], and the ratio by which it first does not: until
 * then r' of one that has stopped is gone */
#define HEDGED 1.0f
/* time that a motion takes to turn, by which the wall's direction looks ahead [s] */
#define TURNS 0.75f
/* distance over which the wall has a direction [m] */
#define NEAR 0.01f
/* part of the way beyond the wall that the next plan is given */
#define GIVEN 0.5f
#define SPEED 2
#define CHANGE 1
/* the rows' weights and largest forces: torque, change, speed, wall */
#define TORQUE 0
/* over-relaxation */
#define OVER 1.625f
/* knots of the horizon, and plans from one to the next */
#define PHASES 4
#define SAMPLE 5

/* How the heading goes on. */
struct turn {
    float rate; /* [rad/s] */
    float left; /* [rad] */
};

/* Let the plan be at rest at a place. */
static void rest(struct ballbot_planner_state *state, float x, float y)
{
    state->place[0] = x;
    state->place[1] = y;
    for (int32_t j = 0; j < 2; ++j) {
        state->place_rest[j] = 0.0f;
        state->moved[j] = 0.0f;
        state->motion[j] = 0.0f;
        state->lag[j] = 0.0f;
        state->lead[j] = 0.0f;
        state->now[j] = 0.0f;
        for (int32_t k = 0; k < KNOTS; ++k) {
            state->a[j][k] = 0.0f;
            for (int32_t row = 0; row < 4; ++row) {
                state->t[row][k][j] = 0.0f;
                state->z[row][k][j] = 0.0f;
            }
        }
    }
    state->started = 1;
    state->since = 0;
    state->solving = 0;
}

/* Let the planner go on from a pose at rest: a plan, which is followed without it, ends there. */
void ballbot_restart_planner(struct ballbot_memory *memory, struct ballbot_pose wanted)
{
    struct ballbot_planner_state *own = &memory->planner;

    rest(own, wanted.x, wanted.y);
    for (int32_t j = 0; j < 2; ++j) {
        own->reference[j] = 0.0f;
        own->bend[j] = 0.0f;
    }
    own->hedge = 0.0f;
    own->last[0] = wanted.x;
    own->last[1] = wanted.y;
    ballbot_start_turning(own, wanted.psi, wanted.psi);
}

/* Filter r' and r''; a jump has no velocity, and r'' counts up to a part of the limit. */
static void notice(const struct ballbot_planner_record *own, struct ballbot_planner_state *state,
        struct ballbot_pose wanted)
{
    const float d_x = wanted.x - state->last[0];
    const float d_y = wanted.y - state->last[1];
    const float moved = own->rate * ballbot_square_root(d_x * d_x + d_y * d_y);
    const float rate = (moved <= (1.0f + ROUNDING) * own->speed) ? own->rate : 0.0f;
    const struct ballbot_pair n = { rate * d_x - state->reference[0], rate * d_y - state->reference[1] };
    const float bent = own->late_reference * own->rate * ballbot_square_root(n.x * n.x + n.y * n.y);
    const float counts = ballbot_larger(0.0f, ballbot_smaller(1.0f, 2.0f - 2.0f * bent / (BEND * own->most)));
    const float scale = counts * own->late_reference * own->rate;

    state->bend[0] += own->late_reference * (scale * n.x - state->bend[0]);
    state->bend[1] += own->late_reference * (scale * n.y - state->bend[1]);
    state->reference[0] += own->late_reference * n.x;
    state->reference[1] += own->late_reference * n.y;
    state->last[0] = wanted.x;
    state->last[1] = wanted.y;
}

/* Follow what lasting disturbances take of a, as a slope does, and how the robot catches itself.
 *
 * They take what the motors gave besides the motion's torques and the compensation of friction. While a motion speeds
 * up or brakes that is what its model lacks, which does not last.
 */
static void lose(const struct ballbot_law *law, struct ballbot_memory *memory, struct ballbot_heading_frame a)
{
    const struct ballbot_planner_record *own = &law->planner;
    struct ballbot_planner_state *state = &memory->planner;
    const struct ballbot_torque_history *past = &memory->history;
    float lost_x = 0.0f;
    float lost_y = 0.0f;

    for (int32_t i = 0; i < BALLBOT_MAX_WHEELS; ++i) {
        const float torque = past->acting[0][i] - past->friction_compensation[0][i];

        lost_x += own->torque * own->frame[i][0] * torque;
        lost_y += own->torque * own->frame[i][1] * torque;
    }
    const struct ballbot_pair given = ballbot_turned_back(a, lost_x, lost_y);
    const struct ballbot_pair second = { 0.5f * (state->lead[0] + state->lag[0]),
        0.5f * (state->lead[1] + state->lag[1]) };
    const float share = (second.x * second.x + second.y * second.y < QUIET * QUIET) ? own->late_lost : 0.0f;
    const float x = state->lost[0] + share * (given.x - state->now[0] - state->lost[0]);
    const float y = state->lost[1] + share * (given.y - state->now[1] - state->lost[1]);
    const float size = ballbot_square_root(x * x + y * y);
    const float counts = (size > own->largest_lost) ? own->largest_lost / size : 1.0f;

    state->lost[0] = counts * x;
    state->lost[1] = counts * y;
    state->catching -= own->late_lost * state->catching;
}

/* Return whether plan and reference are at rest at one place. */
static bool is_still(const struct ballbot_planner_state *state, struct ballbot_pair away)
{
    bool still = ballbot_magnitude(away.x) < STILL && ballbot_magnitude(away.y) < STILL;

    for (int32_t j = 0; j < 2; ++j) {
        still = still && ballbot_magnitude(state->motion[j]) < STILL_SPEED
            && ballbot_magnitude(state->lag[j]) < STILL_FORCE;
        still = still && ballbot_magnitude(state->lead[j]) < STILL_FORCE
            && ballbot_magnitude(state->now[j]) < STILL_FORCE;
        still = still && ballbot_magnitude(state->reference[j]) < STILL_SPEED;
    }
    return still;
}

/* Fill the velocities and the ball's places at the knots for an axis's a. */
static void see(const struct ballbot_planner_record *own, struct ballbot_planner_state *state, int32_t phase,
        int32_t j, const float a[24], float v[24][2], float y[24][2])
{
    float *lead = state->ahead;
    const float p = own->falling;

    lead[KNOTS - 1] = 0.0f;
    for (int32_t k = KNOTS - 2; k > -1; --k) {
        lead[k] = own->kept[KNOT] * lead[k + 1] + own->late[KNOT] * a[k] + own->early[KNOT] * a[k + 1];
    }
    float W = state->begun[j][0];
    float w = state->begun[j][1];
    float lag = state->begun[j][2];
    float before = state->begun[j][3];

    for (int32_t k = 0; k < KNOTS; ++k) {
        const int32_t at = (k == 0) ? phase : KNOT;
        const float h = own->interval[at];

        W += h * (w + h * (2.0f * before + a[k]) / 6.0f);
        w += 0.5f * h * (before + a[k]);
        lag = own->kept[at] * lag + own->early[at] * before + own->late[at] * a[k];
        before = a[k];
        v[k][j] = w + 0.5f * own->ball * p * (lead[k] - lag);
        y[k][j] = W + 0.5f * own->ball * (lead[k] + lag);
    }
    y[KNOTS - 1][j] += TAIL * v[KNOTS - 1][j];
}

/* Fill how large a may be at the knots, in the last plan's direction there, and what friction takes of it. */
static void resist(const struct ballbot_planner_record *own, struct ballbot_planner_state *state, int32_t phase,
        struct ballbot_heading_frame a, struct turn turn)
{
    for (int32_t k = 0; k < FREE; ++k) {
        const float later = own->interval[phase] + own->interval[KNOT] * (float)k;
        const struct ballbot_heading_frame at = ballbot_heading_frame_after(a,
            ballbot_larger(-ballbot_magnitude(turn.left), ballbot_smaller(ballbot_magnitude(turn.left),
            turn.rate * later)));
        const struct ballbot_pair v = ballbot_turned(at, state->v[k][0], state->v[k][1]);
        const struct ballbot_pair force = ballbot_turned(at, state->a[0][k], state->a[1][k]);
        const float size = ballbot_square_root(force.x * force.x + force.y * force.y);
        float largest = 0.0f;
        float drag_x = 0.0f;
        float drag_y = 0.0f;

        for (int32_t i = 0; i < BALLBOT_MAX_WHEELS; ++i) {
            const float speed = own->rolling[i][0] * v.x + own->rolling[i][1] * v.y;
            const float dry = own->dry * speed / ballbot_square_root(speed * speed + CREEPING * CREEPING);

            drag_x += own->frame[i][0] * (own->viscous * speed + dry);
            drag_y += own->frame[i][1] * (own->viscous * speed + dry);
            const float share = ballbot_magnitude(own->frame[i][0] * force.x + own->frame[i][1] * force.y);

            largest = ballbot_larger(largest, (size > STILL_FORCE) ? share / size : own->worst);
        }
        const struct ballbot_pair drag = ballbot_turned_back(at, drag_x, drag_y);

        state->drag[k][0] = drag.x + state->lost[0];
        state->drag[k][1] = drag.y + state->lost[1];
        state->radius[k] = own->most * ballbot_larger(LEAST_LEFT, 1.0f - state->catching) / largest;
    }
}

/* Return s'. */
static float speed_of(const struct ballbot_planner_record *own, const struct ballbot_planner_state *state, int32_t j)
{
    return state->motion[j] + 0.5f * (state->lead[j] - state->lag[j]) / own->falling;
}

/* Return the time until a knot's wall, which for the last one is where the motion ends. */
static float until(const struct ballbot_planner_record *own, int32_t phase, int32_t k)
{
    return own->interval[phase] + own->interval[KNOT] * (float)k + ((k == FREE) ? TAIL : 0.0f);
}

/* Fill the pulls of the start and of the reference, and the wall. */
static void aim(const struct ballbot_planner_record *own, struct ballbot_planner_state *state, int32_t phase,
        struct ballbot_pair away)
{
    const struct ballbot_pair now = { state->reference[0] + LAG * state->bend[0],
        state->reference[1] + LAG * state->bend[1] };
    const float speed = ballbot_square_root(now.x * now.x + now.y * now.y);
    const struct ballbot_pair v = { speed_of(own, state, 0), speed_of(own, state, 1) };
    const float fast = ballbot_larger(0.0f, ballbot_smaller(1.0f, (speed / own->prompt - 1.0f) / (FAST - 1.0f)));

    state->hedge = ballbot_larger(HELD * fast, state->hedge - (float)own->every / (HEDGED * own->rate));
    const float prompt = ballbot_larger(0.0f, 1.0f - state->hedge);
    const float ahead = prompt * own->delay;
    const struct ballbot_pair r = { away.x + ahead * now.x, away.y + ahead * now.y };
    const float distance = ballbot_square_root(r.x * r.x + r.y * r.y);
    const float near = ballbot_smaller(1.0f, own->far / ballbot_larger(distance, own->far));

    for (int32_t j = 0; j < 2; ++j) {
        const float near_place = near * ((j == 0) ? r.x : r.y);
        const float rate = prompt * ((j == 0) ? now.x : now.y);
        const float bend = prompt * state->bend[j];
        const float *begun = state->begun[j];

        for (int32_t k = 0; k < FREE; ++k) {
            const float *by = own->by_start[phase][k];
            const float *of = own->by_reference[phase][k];
            const float start = by[0] * begun[0] + by[1] * begun[1] + by[2] * begun[2] + by[3] * begun[3];

            state->start[j][k] = start - of[0] * near_place - of[1] * rate - of[2] * bend;
        }
    }
    const struct ballbot_pair to = { r.x + TURNS * (v.x - prompt * now.x), r.y + TURNS * (v.y - prompt * now.y) };
    const float size = ballbot_square_root(to.x * to.x + to.y * to.y);

    if (size < NEAR) {
        state->wall[0] = 0.0f;
        state->wall[1] = 0.0f;
        state->wall[2] = 0.0f;
        state->wall[3] = 0.0f;
        return;
    }
    const struct ballbot_pair d = { to.x / size, to.y / size };
    const float place = r.x * d.x + r.y * d.y;
    const float going = prompt * (now.x * d.x + now.y * d.y);
    float beyond = 0.0f;

    for (int32_t k = 0; k < KNOTS; ++k) {
        const float over = state->y[k][0] * d.x + state->y[k][1] * d.y - place - until(own, phase, k) * going;

        beyond = ballbot_larger(beyond, over);
    }
    state->wall[0] = d.x;
    state->wall[1] = d.y;
    state->wall[2] = place + GIVEN * beyond;
    state->wall[3] = going;
}

/* Begin a new plan, from the last one. */
static void begin(const struct ballbot_planner_record *own, struct ballbot_planner_state *state, int32_t phase,
        struct ballbot_heading_frame a, struct turn turn, struct ballbot_pair away)
{
    for (int32_t j = 0; j < 2; ++j) {
        for (int32_t k = 0; k < KNOTS; ++k) {
            state->t[WALL][k][j] -= state->moved[j];
            state->z[WALL][k][j] -= state->moved[j];
        }
        state->moved[j] = 0.0f;
        state->begun[j][0] = -0.5f * own->square * (state->lead[j] + state->lag[j]);
        state->begun[j][1] = state->motion[j];
        state->begun[j][2] = state->lag[j];
        state->begun[j][3] = state->now[j];
        state->needs[j] = state->lead[j] - own->late[phase] * state->now[j];
        see(own, state, phase, j, state->a[j], state->v, state->y);
        see(own, state, phase, j, state->none, state->free_v, state->free_y);
    }
    resist(own, state, phase, a, turn);
    aim(own, state, phase, away);
}

/* Return what a row asks for. */
static float wanted(const struct ballbot_planner_state *state, int32_t row, int32_t k, int32_t j)
{
    return 2.0f * state->z[row][k][j] - state->t[row][k][j];
}

/* Fill what the rows and the costs pull at an axis's a. */
static void pull(const struct ballbot_planner_record *own, struct ballbot_planner_state *state, int32_t phase,
        int32_t j)
{
    const float p = own->falling;
    const float *weight = own->weight;
    float *pull = state->pull;

    for (int32_t k = 0; k < KNOTS; ++k) {
        state->force_v[k] = weight[SPEED] * (wanted(state, SPEED, k, j) - state->free_v[k][j]);
        state->force_y[k] = weight[WALL] * (wanted(state, WALL, k, j) - state->free_y[k][j]);
    }
    state->force_v[KNOTS - 1] += TAIL * state->force_y[KNOTS - 1];
    const float h = own->interval[KNOT];
    float W = 0.0f;
    float w = 0.0f;
    float lag = 0.0f;

    for (int32_t k = KNOTS - 1; k > -1; --k) {
        const int32_t at = (k == 0) ? phase : KNOT;
        const float first = own->interval[at];
        const float held = h * (0.5f * w + h * W / 3.0f) + own->early[KNOT] * lag;

        w += state->force_v[k] + h * W;
        W += state->force_y[k];
        lag = own->kept[KNOT] * lag + 0.5f * own->ball * (state->force_y[k] - p * state->force_v[k]);
        pull[k] = held + first * (0.5f * w + first * W / 6.0f) + own->late[at] * lag;
    }
    float lead = 0.0f;

    for (int32_t k = 0; k < FREE; ++k) {
        const float before = lead;

        lead = own->kept[KNOT] * lead + 0.5f * own->ball * (state->force_y[k] + p * state->force_v[k]);
        pull[k] += own->late[KNOT] * lead + own->early[KNOT] * before - state->start[j][k];
        const float start = (k == 0) ? state->begun[j][3] : 0.0f;
        const float changes = start + wanted(state, CHANGE, k, j) - wanted(state, CHANGE, k + 1, j);
        const float torques = wanted(state, TORQUE, k, j) - state->drag[k][j];

        pull[k] += weight[CHANGE] * changes + weight[TORQUE] * torques;
    }
}

/* Solve for an axis's a. */
static void step(const struct ballbot_planner_record *own, struct ballbot_planner_state *state, int32_t phase,
        int32_t j)
{
    const float needs = state->needs[j];

    for (int32_t k = 0; k < FREE; ++k) {
        const float *row = own->inverse[phase][k];
        float a = own->by_lead[phase][k] * needs;

        for (int32_t m = 0; m < FREE; ++m) {
            a += row[m] * state->pull[m];
        }
        state->a[j][k] = a;
    }
}

/* Step a row of vectors, and return it. */
static struct ballbot_pair stepped(struct ballbot_planner_state *state, int32_t row, int32_t k,
        struct ballbot_pair given)
{
    float *t = state->t[row][k];
    const float *z = state->z[row][k];

    t[0] += OVER * (given.x - z[0]);
    t[1] += OVER * (given.y - z[1]);
    return (struct ballbot_pair){ t[0], t[1] };
}

/* Step a row of vectors whose length is limited. */
static void limit_length(const struct ballbot_planner_record *own, struct ballbot_planner_state *state, int32_t row,
        int32_t k, struct ballbot_pair given, float most)
{
    const struct ballbot_pair t = stepped(state, row, k, given);
    const float size = ballbot_square_root(t.x * t.x + t.y * t.y);
    const float share = (size > most) ? ballbot_smaller(size - most, own->bound[row]) / size : 0.0f;

    state->z[row][k][0] = t.x - share * t.x;
    state->z[row][k][1] = t.y - share * t.y;
}

/* Step the rows, and find what the limits allow of them. */
static void limit(const struct ballbot_planner_record *own, struct ballbot_planner_state *state, int32_t phase)
{
    const float *wall = state->wall;
    struct ballbot_pair before = { state->begun[0][3], state->begun[1][3] };

    for (int32_t k = 0; k < KNOTS; ++k) {
        const struct ballbot_pair a = { state->a[0][k], state->a[1][k] };

        if (k < FREE) {
            const struct ballbot_pair torque = { a.x + state->drag[k][0], a.y + state->drag[k][1] };

            limit_length(own, state, TORQUE, k, torque, state->radius[k]);
        }
        const float change = (k == 0) ? own->change * own->interval[phase] / own->interval[KNOT] : own->change;

        limit_length(own, state, CHANGE, k, (struct ballbot_pair){ a.x - before.x, a.y - before.y }, change);
        limit_length(own, state, SPEED, k, (struct ballbot_pair){ state->v[k][0], state->v[k][1] }, own->speed);
        const struct ballbot_pair t = stepped(state, WALL, k, (struct ballbot_pair){ state->y[k][0],
            state->y[k][1] });
        float over = ballbot_larger(0.0f, t.x * wall[0] + t.y * wall[1] - wall[2] - until(own, phase, k) * wall[3]);

        over = ballbot_smaller(over, own->bound[WALL]);
        state->z[WALL][k][0] = t.x - over * wall[0];
        state->z[WALL][k][1] = t.y - over * wall[1];
        before = a;
    }
}

/* Take a sample's share of the steps; the plan's first samples are followed meanwhile. */
static void solve(const struct ballbot_planner_record *own, struct ballbot_planner_state *state, int32_t phase)
{
    for (int32_t count = 0; count < own->steps; ++count) {
        for (int32_t j = 0; j < 2; ++j) {
            pull(own, state, phase, j);
            step(own, state, phase, j);
            see(own, state, phase, j, state->a[j], state->v, state->y);
        }
        limit(own, state, phase);
    }
}

/* Return an axis's motion now, relative to the pose. */
static struct ballbot_smooth_reference motion(const struct ballbot_planner_record *own,
        const struct ballbot_planner_state *state, int32_t j, float pose)
{
    const float p = own->falling;
    const float second = 0.5f * (state->lead[j] + state->lag[j]);
    const float third = 0.5f * p * (state->lead[j] - state->lag[j]);

    return (struct ballbot_smooth_reference){ state->place[j] - pose + state->place_rest[j], speed_of(own, state, j),
        second, third, p * p * (second - state->now[j]) };
}

/* Begin the interval after the next knot. */
static void pass_knot(struct ballbot_planner_state *state)
{
    state->since = 0;
    for (int32_t j = 0; j < 2; ++j) {
        for (int32_t k = 0; k < FREE; ++k) {
            state->a[j][k] = state->a[j][k + 1];
            for (int32_t row = 0; row < 4; ++row) {
                state->t[row][k][j] = state->t[row][k + 1][j];
                state->z[row][k][j] = state->z[row][k + 1][j];
            }
        }
        state->t[CHANGE][FREE][j] = 0.0f;
        state->z[CHANGE][FREE][j] = 0.0f;
    }
}

/* Let a sample pass; after a knot, the next one is the first. */
static void advance(const struct ballbot_planner_record *own, struct ballbot_planner_state *state)
{
    const float dt = 1.0f / own->rate;
    const int32_t left = PHASES * own->every - state->since;

    for (int32_t j = 0; j < 2; ++j) {
        const float before = state->now[j];
        const float after = before + (state->a[j][0] - before) / (float)left;
        const float second = 0.5f * (state->lead[j] + state->lag[j]);
        float moved = dt * (state->motion[j] + dt * (2.0f * before + after) / 6.0f);

        state->motion[j] += 0.5f * dt * (before + after);
        const float kept = own->kept[SAMPLE];
        const float early = own->early[SAMPLE];
        const float late = own->late[SAMPLE];

        state->lag[j] = kept * state->lag[j] + early * before + late * after;
        state->lead[j] = (state->lead[j] - late * before - early * after) / kept;
        state->now[j] = after;
        moved += own->square * (0.5f * (state->lead[j] + state->lag[j]) - second);
        ballbot_add(&state->place[j], &state->place_rest[j], moved);
        state->moved[j] += moved;
    }
    state->since += 1;
    if (left == 1) {
        pass_knot(state);
    }
}

/* Return the motion to a pose, relative to the measured one, and advance the memory. */
struct ballbot_followed_motion ballbot_plan_motion(const struct ballbot_law *law, struct ballbot_memory *memory,
        struct ballbot_pose pose, const struct ballbot_predicted *ahead, struct ballbot_pose wanted)
{
    const struct ballbot_planner_record *own = &law->planner;
    struct ballbot_planner_state *state = &memory->planner;

    if (state->started == 0) {
        rest(state, pose.x + ahead->state.x, pose.y + ahead->state.y);
        state->last[0] = wanted.x;
        state->last[1] = wanted.y;
        ballbot_start_turning(state, pose.psi + ahead->state.psi, wanted.psi);
    }
    notice(own, state, wanted);
    lose(law, memory, ahead->a);
    const struct ballbot_pair away = { wanted.x - state->place[0] - state->place_rest[0],
        wanted.y - state->place[1] - state->place_rest[1] };
    const int32_t phase = state->since / own->every;

    if (phase * own->every == state->since) {
        state->solving = is_still(state, away) ? 0 : 1;
        if (state->solving == 0) {
            rest(state, wanted.x, wanted.y);
        } else {
            begin(own, state, phase, ahead->a, (struct turn){ state->turning, wanted.psi - state->lags[3] }, away);
        }
    }
    if (state->solving == 1) {
        solve(own, state, phase);
    }
    const struct ballbot_smooth_reference x = motion(own, state, 0, pose.x);
    const struct ballbot_smooth_reference y = motion(own, state, 1, pose.y);

    advance(own, state);
    return (struct ballbot_followed_motion){ x, y, ballbot_turn(own, state, pose.psi, wanted.psi) };
}

/* Leave motions the least torque: the robot needs its torque to catch itself. */
void ballbot_plan_gently(struct ballbot_memory *memory)
{
    memory->planner.catching = 1.0f;
}
