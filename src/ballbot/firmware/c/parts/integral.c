/* Generated from ballbot/control/parts/integral.py by
 * `python -m tests.support.firmware_headers`; do not edit.
 *
 * Integral action: it removes lasting errors of position and heading.
 *
 *     I' = e - I/T        e the error of x, y and psi, world frame; I is limited, does not grow while a wheel's
 *                         torque is at its limit (anti-windup) or the reference accelerates, and is constant while e
 *                         is in the dead band
 *     u += K_I S(psi) I
 *
 * A tilted floor, an offset of the AHRS's lean and uncompensated friction all cause such an error. The leak 1/T lets I
 * decay; with it a constant push leaves the error e = I/T instead of zero. The dead band prevents hunting of a robot that
 * sticks within it: an integral that grows until a wheel breaks away ends in a limit cycle.
 */
#include "parts/steps.h"

/* acceleration of the reference beyond which errors come from the motion, not from a lasting disturbance [m/s^2] */
#define BRISK 0.125f

/* Add the torques for the integrals. */
void ballbot_add_integral(const struct ballbot_law *law, const struct ballbot_memory *memory,
        const struct ballbot_sample *now, float torques[], int32_t n)
{
    const struct ballbot_integral_record *own = &law->integral;
    const struct ballbot_tuning_state *tuned = &memory->tuning;
    const float *sums = memory->integral.sums;

    if (own->on == 0) {
        return;
    }
    const struct ballbot_pair I = ballbot_turned(now->a, sums[0], sums[1]);

    for (int32_t i = 0; i < n; ++i) {
        const float *gain = own->gain[i];
        const float *more = tuned->integral[i];

        torques[i] += gain[0] * I.x + gain[1] * I.y + gain[2] * sums[2];
        if (law->tuning.others > 0) {
            torques[i] += more[0] * I.x + more[1] * I.y + more[2] * sums[2];
        }
    }
}

/* Return an integral after a sample. */
static float stepped(float value, float kept, float change, float limit, bool limited)
{
    const float after = ballbot_clipped(kept * value + change, limit);

    return (limited && ballbot_magnitude(after) > ballbot_magnitude(value)) ? value : after;
}

/* Step the integrals by a sample's error; while something is limited they may only shrink. */
void ballbot_learn_integral(const struct ballbot_law *law, struct ballbot_memory *memory,
        const struct ballbot_sample *now, bool limited)
{
    const struct ballbot_integral_record *own = &law->integral;
    float *sums = memory->integral.sums;

    if (own->on == 0) {
        return;
    }
    const struct ballbot_pair e = ballbot_turned_back(now->a, now->e.x, now->e.y);
    const float e_psi = now->e.psi;
    const bool still = limited || now->to.x.second * now->to.x.second
        + now->to.y.second * now->to.y.second > BRISK * BRISK;

    if (e.x * e.x + e.y * e.y > own->dead_band * own->dead_band) {
        sums[0] = stepped(sums[0], own->kept, own->step * e.x, own->limit, still);
        sums[1] = stepped(sums[1], own->kept, own->step * e.y, own->limit, still);
    }
    if (ballbot_magnitude(e_psi) > own->dead_band) {
        sums[2] = stepped(sums[2], own->kept, own->step * e_psi, own->yaw_limit, still);
    }
}
