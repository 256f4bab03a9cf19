/* Policy: a learned network of two layers of tanh units decides torques.
 *
 *     u = f (K S(psi) (r - x) + parts) + s N(o)      f: 0 for a policy alone, 1 for one that is added
 *
 * It sees the measured state and the reference that is asked for, before prediction, shaping and plans: errors in the heading
 * frame over the sizes that count as 1, then its last torques over their limit. It decides every so many samples. Beyond the lean and the speed at
 * which it was trained the linear law acts alone. Its weights are a table in flash (ballbot_policy_weights.h), by rows, each with
 * its bias at the end.
 */
#include "parts/parts.h"

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
                    const struct ballbot_sample *now, const float rates[3], float o[INPUTS])
{
    const float *x = now->state;
    const float error[ERRORS] = { now->x.value,    now->y.value,    -x[2], -x[3], now->psi.value,
                                  rates[0] - x[5], rates[1] - x[6], -x[7], -x[8], rates[2] - x[9] };
    float e[ERRORS];

    ballbot_state_to_heading(now->a, error, e);
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

bool ballbot_policy_decide(const struct ballbot_law *law, struct ballbot_memory *memory, const struct ballbot_sample *now)
{
    const struct ballbot_policy_record *own = &law->policy;
    struct ballbot_policy_state *state = &memory->policy;
    const float *x = now->state;
    const float asked[3] = { now->reference[0], now->reference[1], memory->reference_heading.last };
    float rates[3];

    if (own->on == 0) {
        return false;
    }
    watch_reference(state, asked, own->rate, rates);
    state->waited = (state->started != 0) ? state->waited + 1 : own->period;
    state->started = 1;
    if (state->waited >= own->period) {
        float o[INPUTS];
        float outputs[WHEELS];

        state->waited = 0;
        observe(own, state, now, rates, o);
        evaluate(o, outputs);
        for (int i = 0; i < WHEELS; ++i) {
            for (int k = HISTORY - 1; k > 0; --k) {
                state->past[k][i] = state->past[k - 1][i];
            }
            state->past[0][i] = ballbot_clipped(own->torque_scale * outputs[i], own->torque_limit);
        }
    }
    return ballbot_larger(ballbot_magnitude(x[2]), ballbot_magnitude(x[3])) <= own->largest_lean &&
           ballbot_square_root(x[5] * x[5] + x[6] * x[6]) <= own->largest_speed;
}

#else

bool ballbot_policy_decide(const struct ballbot_law *law, struct ballbot_memory *memory, const struct ballbot_sample *now)
{
    (void)law;
    (void)memory;
    (void)now;
    return false; /* there are no weights; ballbot_policy_is_known refuses a policy */
}

#endif

float ballbot_policy_filter(const struct ballbot_law *law, const struct ballbot_memory *memory, float torque, int32_t i)
{
    return law->policy.feedback * torque + memory->policy.past[0][i];
}
