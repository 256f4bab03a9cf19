/* Generated from ballbot/control/parts/lean_limit.py by
 * `python -m tests.support.firmware_headers`; do not edit.
 *
 * A limit of the lean that errors command, so that no error of position or speed commands more than is available.
 *
 * The part of K e for position and speed, K_p (e_x e_y e_x' e_y'), equals the torques of a lean error, the commanded lean
 * a = K_l^+ K_p (e_x e_y e_x' e_y'). First the position errors are scaled down together if they alone command more than
 * the limit, so that a distant robot approaches no faster than it can be stopped; then all four if |a| still exceeds it.
 * While a fall or a push must be caught, the wheels' torque is thus available for the lean. (Saturations one within
 * another: A. Teel, Systems & Control Letters 18 (1992) 165-171.) The heading's error and its rate are limited by the turn
 * that they command. Within the limits nothing changes; beyond them integrals do not grow.
 */
#include "parts/steps.h"

/* Return a lean that errors of position and speed command. */
static float commanded(const float asked[4], float x, float y, float v_x, float v_y)
{
    return asked[0] * x + asked[1] * y + asked[2] * v_x + asked[3] * v_y;
}

/* Return limit / |(a, b)|, or 1 within the limit. */
static float fraction(float limit, float a, float b)
{
    const float size = ballbot_square_root(a * a + b * b);

    return (size > limit) ? limit / size : 1.0f;
}

/* Return the fraction that is kept of errors of position and speed. */
static float lean_fraction(const struct ballbot_lean_limit_record *own, const struct ballbot_tuning_state *tuned,
        float x, float y, float v_x, float v_y)
{
    const float first = commanded(own->asked[0], x, y, v_x, v_y) + commanded(tuned->asked[0], x, y, v_x, v_y);
    const float second = commanded(own->asked[1], x, y, v_x, v_y) + commanded(tuned->asked[1], x, y, v_x, v_y);

    return fraction(own->lean, first, second);
}

/* Return the error with position, speed and heading within the limits. */
struct ballbot_limited_error ballbot_limit_error(const struct ballbot_law *law, const struct ballbot_memory *memory,
        const struct ballbot_robot_state *e)
{
    const struct ballbot_lean_limit_record *own = &law->lean_limit;
    const struct ballbot_tuning_state *tuned = &memory->tuning;

    if (own->on == 0) {
        return (struct ballbot_limited_error){ *e, false };
    }
    const float near = lean_fraction(own, tuned, e->x, e->y, 0.0f, 0.0f);
    const float both = lean_fraction(own, tuned, near * e->x, near * e->y, e->x_dot, e->y_dot);
    const float heading = fraction(own->turn, e->psi + (own->turn_rate + tuned->turn_rate) * e->psi_dot, 0.0f);
    const struct ballbot_robot_state less = { near * both * e->x, near * both * e->y, e->theta, e->phi,
        heading * e->psi, both * e->x_dot, both * e->y_dot, e->theta_dot, e->phi_dot, heading * e->psi_dot };

    return (struct ballbot_limited_error){ less, near * both * heading < 1.0f };
}
