/* Policy: a learned network of two layers of tanh units decides torques.
 *
 *     u = f (K S(psi) (r - x) + parts) + s N(o)      f: 0 for a policy alone, 1 for one that is added
 *
 * It sees the measured state and the reference that is asked for, before prediction and plans: errors in the heading
 * frame over the sizes that count as 1, then its last torques over their limit. It decides every so many samples. Beyond the lean and the speed at
 * which it was trained the linear law acts alone. Its weights are a table in flash (ballbot_policy_weights.h), by rows, each with
 * its bias at the end.
 */
#include "parts/policy.h"

#include "ballbot_policy_weights.h"

bool ballbot_policy_is_known(const struct ballbot_policy_record *own, int32_t n)
{
    return own->on == 0 ||
           (own->checksum == BALLBOT_POLICY_CHECKSUM && own->hidden == BALLBOT_POLICY_HIDDEN &&
            own->wheels == BALLBOT_POLICY_WHEELS && own->wheels == n && own->period >= 1 && own->torque_limit > 0.0f);
}

#if BALLBOT_POLICY_HIDDEN > 0

/* Entries of an observation: errors, and torques of the last decisions. */
#define ERRORS 10
#define HISTORY 3
#define HIDDEN BALLBOT_POLICY_HIDDEN
#define WHEELS BALLBOT_POLICY_WHEELS
#define INPUTS (ERRORS + HISTORY * WHEELS)
/* A reference that moves faster jumps: then no velocity is asked for [m/s, rad/s]. */
#define JUMP_RATE 3.0f

typedef char ballbot_policy_weights_fit[
    (BALLBOT_POLICY_SIZE == (INPUTS + 1) * HIDDEN + (HIDDEN + 1) * (HIDDEN + WHEELS)) ? 1 : -1];

/* One over the size that counts as 1, and how many of these sizes are shown. */
static const float PER_SIZE[ERRORS] = { 4.0f, 4.0f, 10.0f, 10.0f, 2.0f, 2.0f, 2.0f, 2.0f, 2.0f, 1.0f };
static const float SHOWN[ERRORS] = { 2.0f, 2.0f, 4.0f, 4.0f, 4.0f, 4.0f, 4.0f, 4.0f, 4.0f, 4.0f };

/* Fill the rates at which the reference of x, y and psi changes, and keep it. */
static void watch_reference(struct ballbot_policy_state *state, const float asked[3], float rate, float rates[3])
{
    for (int axis = 0; axis < 3; ++axis) {
        const float change = (state->started != 0) ? asked[axis] - state->asked[axis] : 0.0f;

        rates[axis] = rate * ((axis == 2) ? ballbot_within_half_turn(change) : change);
        if (!(ballbot_magnitude(rates[axis]) <= JUMP_RATE)) {
            rates[axis] = 0.0f;
        }
        state->asked[axis] = asked[axis];
    }
}

/* Fill the observation. */
static void observe(const struct ballbot_policy_record *own, const struct ballbot_policy_state *state,
                    struct ballbot_heading_frame a, const struct ballbot_robot_state *error, float o[INPUTS])
{
    const struct ballbot_robot_state turned = ballbot_turned_state(a, error);
    const float e[ERRORS] = { turned.x,     turned.y,     turned.theta,     turned.phi,     turned.psi,
                              turned.x_dot, turned.y_dot, turned.theta_dot, turned.phi_dot, turned.psi_dot };

    for (int i = 0; i < ERRORS; ++i) {
        o[i] = ballbot_clipped(e[i] * PER_SIZE[i], SHOWN[i]);
    }
    for (int k = 0; k < HISTORY; ++k) {
        for (int i = 0; i < WHEELS; ++i) {
            o[ERRORS + k * WHEELS + i] = state->past[k][i] / own->torque_limit;
        }
    }
}

/* Fill the sums of a layer whose rows of weights begin at a place; return where they end. */
static int layer(int at, const float inputs[], int width, float sums[], int count)
{
    int place = at;

    for (int k = 0; k < count; ++k) {
        float sum = 0.0f;

        for (int j = 0; j < width; ++j) {
            sum += ballbot_policy_weights[place + j] * inputs[j];
        }
        sums[k] = sum + ballbot_policy_weights[place + width];
        place += width + 1;
    }
    return place;
}

/* Bend the sums of a hidden layer. */
static void bend(float sums[HIDDEN])
{
    for (int k = 0; k < HIDDEN; ++k) {
        sums[k] = ballbot_hyperbolic_tangent(sums[k]);
    }
}

/* Fill the outputs for an observation. */
static void evaluate(const float o[INPUTS], float outputs[WHEELS])
{
    float first[HIDDEN];
    float second[HIDDEN];
    int at = layer(0, o, INPUTS, first, HIDDEN);

    bend(first);
    at = layer(at, first, HIDDEN, second, HIDDEN);
    bend(second);
    (void)layer(at, second, HIDDEN, outputs, WHEELS);
}

void ballbot_act(const struct ballbot_law *law, struct ballbot_memory *memory, struct ballbot_heading_frame a,
                 const struct ballbot_robot_state *seen, struct ballbot_pose pose, struct ballbot_pose wanted)
{
    const struct ballbot_policy_record *own = &law->policy;
    struct ballbot_policy_state *state = &memory->policy;
    /* the heading as it was asked for: single precision rounds one of many turns by too much */
    const float asked[3] = { wanted.x, wanted.y, memory->reference_heading.last };
    float rates[3];

    if (own->on == 0) {
        return;
    }
    watch_reference(state, asked, own->rate, rates);
    state->waited = (state->started != 0) ? state->waited + 1 : own->period;
    state->started = 1;
    if (state->waited >= own->period) {
        const struct ballbot_robot_state error = {
            wanted.x - pose.x,       wanted.y - pose.y,       -seen->theta,     -seen->phi,     wanted.psi - pose.psi,
            rates[0] - seen->x_dot, rates[1] - seen->y_dot, -seen->theta_dot, -seen->phi_dot, rates[2] - seen->psi_dot,
        };
        float o[INPUTS];
        float outputs[WHEELS];

        state->waited = 0;
        observe(own, state, a, &error, o);
        evaluate(o, outputs);
        for (int i = 0; i < WHEELS; ++i) {
            for (int k = HISTORY - 1; k > 0; --k) {
                state->past[k][i] = state->past[k - 1][i];
            }
            state->past[0][i] = ballbot_clipped(own->torque_scale * outputs[i], own->torque_limit);
        }
    }
}

bool ballbot_within_policy(const struct ballbot_law *law, const struct ballbot_robot_state *seen)
{
    const float lean = ballbot_larger(ballbot_magnitude(seen->theta), ballbot_magnitude(seen->phi));
    const float speed = ballbot_square_root(seen->x_dot * seen->x_dot + seen->y_dot * seen->y_dot);

    return law->policy.on != 0 && lean <= law->policy.largest_lean && speed <= law->policy.largest_speed;
}

#else

/* There are no weights; ballbot_policy_is_known refuses a policy. */
void ballbot_act(const struct ballbot_law *law, struct ballbot_memory *memory, struct ballbot_heading_frame a,
                 const struct ballbot_robot_state *seen, struct ballbot_pose pose, struct ballbot_pose wanted)
{
    (void)law;
    (void)memory;
    (void)a;
    (void)seen;
    (void)pose;
    (void)wanted;
}

bool ballbot_within_policy(const struct ballbot_law *law, const struct ballbot_robot_state *seen)
{
    (void)law;
    (void)seen;
    return false;
}

#endif

float ballbot_with_policy(const struct ballbot_law *law, const struct ballbot_memory *memory, float torque, int32_t i)
{
    return law->policy.feedback * torque + memory->policy.past[0][i];
}
