/* Lean limit: errors of position and speed command at most a certain lean, errors of the heading a certain turn.
 *
 * The commanded lean is asked (e_x, e_y, e_x', e_y') [rad], heading frame. First the errors of position are reduced if
 * they alone command more than the limit, then all four. Within the limits nothing changes.
 */
#include "parts/parts.h"

/* Return limit / |(a, b)|, or 1 within the limit. */
static float fraction(float limit, float a, float b)
{
    const float size = ballbot_square_root(a * a + b * b);

    return (size > limit) ? limit / size : 1.0f;
}

/* Return a lean that errors of position [m] and speed [m/s] command. */
static float commanded(const float asked[4], const float errors[4])
{
    return asked[0] * errors[0] + asked[1] * errors[1] + asked[2] * errors[2] + asked[3] * errors[3];
}

/* Return what is left of errors of position [m] and speed [m/s]. */
static float lean_fraction(const struct ballbot_lean_limit_record *own, const struct ballbot_tuning_state *tuned, float x,
                           float y, float v_x, float v_y)
{
    const float errors[4] = { x, y, v_x, v_y };

    return fraction(own->lean, commanded(own->asked[0], errors) + commanded(tuned->asked[0], errors),
                    commanded(own->asked[1], errors) + commanded(tuned->asked[1], errors));
}

void ballbot_lean_limit_error(const struct ballbot_law *law, const struct ballbot_memory *memory,
                              struct ballbot_sample *now)
{
    const struct ballbot_lean_limit_record *own = &law->lean_limit;
    const struct ballbot_tuning_state *tuned = &memory->tuning;
    float *e = now->e;

    if (own->on == 0) {
        return;
    }
    const float near = lean_fraction(own, tuned, e[0], e[1], 0.0f, 0.0f);
    const float both = lean_fraction(own, tuned, near * e[0], near * e[1], e[5], e[6]);
    const float heading = fraction(own->turn, e[4] + (own->turn_rate + tuned->turn_rate) * e[9], 0.0f);

    e[0] *= near * both;
    e[1] *= near * both;
    e[5] *= both;
    e[6] *= both;
    e[4] *= heading;
    e[9] *= heading;
    now->error_limited = now->error_limited || (near * both * heading < 1.0f);
}
